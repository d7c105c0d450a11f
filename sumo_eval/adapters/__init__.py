"""ADSs with the interfaces of other tools, unchanged: `sumo_eval.adapters:CarlaAgent?options.agent=my_agent.py:Agent`.

Each adapter shows the ADS what it would be shown at home, as plain objects with the names of its tool, and takes its
answer. Places are in road coordinates. No tool needs to be installed.
"""

from sumo_eval.adapters.carla import CarlaAgent
from sumo_eval.adapters.commonroad import CommonRoadPlanner
from sumo_eval.adapters.nuplan import NuPlanPlanner
from sumo_eval.adapters.smarts import SmartsAgent

__all__ = ["CarlaAgent", "CommonRoadPlanner", "NuPlanPlanner", "SmartsAgent"]
