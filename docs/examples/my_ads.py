from sumo_eval import Command


class MyAds:
    """Keeps two seconds to the lead vehicle."""

    def act(self, seen):
        lead = seen.lead
        if lead is None:
            return Command(acceleration=0.0)
        error = lead.gap - 2.0 * seen.ego.speed
        return Command(acceleration=max(-6.0, min(1.0, 0.1 * error + 0.8 * lead.relative_speed)))
