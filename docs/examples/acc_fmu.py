"""The adaptive cruise control as an FMU: `pythonfmu build -f acc_fmu.py` makes Acc.fmu (FMI
2.0)."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Acc(Fmi2Slave):
    """Inputs v, gap, lead_speed; parameter headway; output a_cmd."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.v = self.gap = self.lead_speed = self.a_cmd = 0.0
        self.headway = 1.5
        for name in ("v", "gap", "lead_speed"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        tunable = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        self.register_variable(Real("headway", **tunable))
        self.register_variable(Real("a_cmd", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        wanted = 3.0 + self.headway * self.v
        acceleration = 0.15 * (self.gap - wanted) + 0.9 * (self.lead_speed - self.v)
        self.a_cmd = min(max(acceleration, -6.0), 0.0 if self.gap > wanted else 2.0)
        return True
