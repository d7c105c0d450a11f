"""A controller that says which speed it wants: the lead's, corrected by the gap, and never more
than its own."""

from sumo_eval import Command


def follow(seen):
    lead = seen.lead
    if lead is None:
        return Command(speed=seen.desired_speed)
    wanted = lead.speed + 0.3 * (lead.gap - 5.0 - 1.2 * seen.ego.speed)
    return Command(speed=min(max(wanted, 0.0), seen.desired_speed))
