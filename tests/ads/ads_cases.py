"""Folder and cases that the tests of ADSs in docs/examples share."""

from loaded import ROOT
from road_scenes import at_values

EXAMPLES = ROOT / "docs" / "examples"
SLOWER = at_values("front_vehicle_low_speed", ego_speed=20.0, lead_speed=5.0)
CUT_OUT = at_values("front_vehicle_cut_out", ego_speed=20.0, obstacle_speed=10.0, gap=60.0)
