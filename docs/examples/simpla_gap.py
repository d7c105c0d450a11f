"""simpla's gap controller, from SUMO's own tools, as it is: it opens a gap of 30 m and touches
nobody but the ego."""

import simpla


class OpenGap:
    """Asks simpla for the gap; simpla registers a step listener that drives the ego from then
    on."""

    def reset(self, scenario, traci, ego):
        simpla.openGap(ego, 30.0, 3.0, 2.0, 60.0)

    def step(self, traci, ego, time):
        """simpla drives."""
