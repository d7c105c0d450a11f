"""A car as an FMU (FMI 3.0), in place of the harness's vehicle model: `pythonfmu3 build -f
car_fmu.py` makes Car.fmu.

A point that accelerates with a lag of 0.2 s and turns as its steering wheel says; it starts at its
own origin.
"""

import math

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability


class Car(Fmi3Slave):
    """Inputs acceleration, steering; parameter v0; outputs x, y, heading, speed."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = self.x = self.y = self.heading = self.speed = self.v0 = self.a = 0.0
        self.acceleration = self.steering = 0.0
        independent = {
            "causality": Fmi3Causality.independent,
            "variability": Fmi3Variability.continuous,
        }
        self.register_variable(Float64("time", **independent))
        tunable = {"causality": Fmi3Causality.parameter, "variability": Fmi3Variability.tunable}
        self.register_variable(Float64("v0", **tunable))
        for name in ("acceleration", "steering"):
            self.register_variable(Float64(name, causality=Fmi3Causality.input))
        for name in ("x", "y", "heading", "speed"):
            self.register_variable(Float64(name, causality=Fmi3Causality.output))

    def exit_initialization_mode(self):
        self.speed = self.v0

    def do_step(self, current_time, step_size):
        self.a += (self.acceleration - self.a) * min(step_size / 0.2, 1.0)
        before, self.speed = self.speed, max(self.speed + self.a * step_size, 0.0)
        driven = 0.5 * (before + self.speed) * step_size
        turn = driven * math.tan(self.steering / 16.0) / 2.7
        self.x += driven * math.cos(self.heading + 0.5 * turn)
        self.y += driven * math.sin(self.heading + 0.5 * turn)
        self.heading += turn
        return True
