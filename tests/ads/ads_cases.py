"""Folder, scenarios and cases that tests of ADSs share."""

from loaded import ROOT
from road_scenes import at_values

from sumo_eval.scenario import catalogue

SCRIPTED = sorted(name for name in catalogue.SCENARIOS if catalogue.load(name).approach is not None)
"""Scenarios in which what the others do is known before anybody drives."""
EXAMPLES = ROOT / "docs" / "examples"
SLOWER = at_values("front_vehicle_low_speed", ego_speed=20.0, lead_speed=5.0)
CUT_OUT = at_values("front_vehicle_cut_out", ego_speed=20.0, obstacle_speed=10.0, gap=60.0)
