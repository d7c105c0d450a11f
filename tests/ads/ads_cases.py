"""Folder and cases that the tests of ADSs in docs/examples share."""

from loaded import ROOT

from sumo_eval.scenario import catalogue

EXAMPLES = ROOT / "docs" / "examples"
SLOWER = catalogue.load("front_vehicle_low_speed").concrete(ego_speed=20.0, lead_speed=5.0)
CUT_OUT = catalogue.load("front_vehicle_cut_out").concrete(
    ego_speed=20.0, obstacle_speed=10.0, gap=60.0
)
