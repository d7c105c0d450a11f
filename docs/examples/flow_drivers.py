"""Controllers of FLOW (https://github.com/flow-project/flow), which nobody here wrote.

FLOW is no package of PyPI: its source has to be on Python's path (`git clone`, `PYTHONPATH=flow`).
A controller asks its environment about vehicles by name; here stands an environment of one step
that answers of what the ego sees.
"""

from types import SimpleNamespace

import flow.controllers
import numpy as np

LIMITS = SimpleNamespace(controller_params={"accel": 2.6, "decel": 4.5})
TAKES_WANTED = {
    "IDMController": "v0",
    "FollowerStopper": "v_des",
    "OVMController": "v_max",
    "BCMController": "v_des",
}


class Driver:
    """One of FLOW's controllers, by the name of its class; options go to its constructor."""

    def __init__(self, controller="IDMController", **options):
        self.kind, self.name, self.options = (
            getattr(flow.controllers, controller),
            controller,
            options,
        )

    def reset(self, scenario):
        wanted = (
            {TAKES_WANTED[self.name]: scenario.desired_speed} if self.name in TAKES_WANTED else {}
        )
        self.controller = self.kind(
            veh_id="ego", car_following_params=LIMITS, **{**wanted, **self.options}
        )
        self.step, self.limit = scenario.step, scenario.speed_limit

    def act(self, seen):
        me, lead, behind = seen.ego, seen.lead, seen.neighbours["behind"]
        speeds = {"ego": me.speed, "lead": lead and lead.speed, "behind": behind and behind.speed}
        gaps = {"ego": lead.gap if lead else 1000.0, "behind": behind.gap if behind else 1000.0}

        def speed(of):
            return (
                np.array([speeds[it] for it in of])
                if isinstance(of, list)
                else speeds.get(of, -1001.0)
            )

        vehicle = SimpleNamespace(
            get_leader=lambda _: "lead" if lead else None,
            get_follower=lambda _: "behind" if behind else None,
            get_speed=speed, get_headway=gaps.get, get_length=lambda _: me.length,
            get_edge=lambda _: "road",
            get_position=lambda _: me.x,
            get_ids=lambda: [it for it, value in speeds.items() if value is not None],
            update_accel=lambda *_, **__: None, num_vehicles=1 + len(seen.vehicles) if lead else 1,
        )  # fmt: skip
        network = SimpleNamespace(
            edge_length=lambda _: seen.road.length, speed_limit=lambda _: self.limit
        )
        return self.controller.get_action(
            SimpleNamespace(k=SimpleNamespace(vehicle=vehicle, network=network), sim_step=self.step)
        )
