"""Every constant of the method and of the simulation, once: default, unit, symbol, equation,
bounds.

One file a subject; all names can be imported from here.
"""

from sumo_eval.frozen import About
from sumo_eval.settings.checked import Checked, NotNegative, Positive, about
from sumo_eval.settings.drivers import DriverSettings, PopulationSettings
from sumo_eval.settings.evaluation import (
    AdsSettings,
    DeclaredDistribution,
    EvaluationSettings,
    ExposureSettings,
    SamplingSettings,
    ScenarioSettings,
)
from sumo_eval.settings.method import (
    AnthropomorphicSettings,
    CollisionSettings,
    FieldSettings,
    MethodSettings,
    PlausibilitySettings,
    RankingSettings,
    ScoreSettings,
    TaskSettings,
    ZoneSettings,
)
from sumo_eval.settings.report import ReportSettings
from sumo_eval.settings.run import RunSettings
from sumo_eval.settings.simulation import (
    ConditionSettings,
    FmuSettings,
    PlantSettings,
    SimulationSettings,
    TrackerSettings,
    VehicleSettings,
)

__all__ = [
    "About",
    "AdsSettings",
    "AnthropomorphicSettings",
    "Checked",
    "CollisionSettings",
    "ConditionSettings",
    "DeclaredDistribution",
    "DriverSettings",
    "EvaluationSettings",
    "ExposureSettings",
    "FieldSettings",
    "FmuSettings",
    "MethodSettings",
    "NotNegative",
    "PlantSettings",
    "PlausibilitySettings",
    "PopulationSettings",
    "Positive",
    "RankingSettings",
    "ReportSettings",
    "RunSettings",
    "SamplingSettings",
    "ScenarioSettings",
    "ScoreSettings",
    "SimulationSettings",
    "TaskSettings",
    "TrackerSettings",
    "VehicleSettings",
    "ZoneSettings",
    "about",
]
