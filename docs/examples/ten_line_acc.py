"""An adaptive cruise control in ten lines: a function of what is seen."""


def acc(seen):
    """Keep the speed; behind a lead, its speed at 1.5 s headway."""
    lead = seen.lead
    if lead is None:
        return 0.0
    wanted_gap = 3.0 + 1.5 * seen.ego.speed
    acceleration = 0.15 * (lead.gap - wanted_gap) + 0.9 * lead.relative_speed
    return min(max(acceleration, -6.0), 0.0 if lead.gap > wanted_gap else 2.0)
