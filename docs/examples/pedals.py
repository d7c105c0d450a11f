"""A controller with pedals, as CARLA and MetaDrive have them: throttle 0..1, brake 0..1, steer
-1..1 to the left."""

from sumo_eval import Command


def drive(seen):
    wanted = seen.desired_speed
    if seen.lead is not None:
        wanted = min(wanted, seen.lead.speed + 0.3 * (seen.lead.gap - 5.0 - 1.2 * seen.ego.speed))
    faster = wanted - max(seen.ego.speed, 0.0)
    steer = 0.02 * seen.lanes[seen.ego.lane] - 0.2 * seen.ego.heading
    return Command.pedals(
        min(max(0.2 * faster, 0.0), 0.5), min(max(-0.2 * faster, 0.0), 1.0), steer
    )
