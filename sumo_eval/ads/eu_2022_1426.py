"""ADSs `eu_2022_1426`, `eu_2022_1426_bus`: the least that Regulation (EU) 2022/1426 demands of an
automated vehicle.

A cut-in must be avoided when its TTC, as it reaches 0.30 m into the lane, is above v_rel / (2 a) +
tau / 2 + 0.1 s: the vehicle may take 0.1 s, build its braking up over tau and brake with a. With
standing or unbelted passengers a and tau are smaller. Source: Annex III, cut-in (the German AFGBV,
Annex 1, has the same). Everything else is as in `reg157`.
"""

from __future__ import annotations

from dataclasses import dataclass

from sumo_eval.ads.reg157 import LastMoment, Reg157

RESPONSE = 0.1  # s
SEATED = LastMoment("eu_2022_1426", braking=6.0, response=RESPONSE, build_up=0.3)
STANDING = LastMoment("eu_2022_1426_bus", braking=2.4, response=RESPONSE, build_up=0.12)


@dataclass(eq=False)
class Eu20221426(Reg157):
    """ADS `eu_2022_1426`: 6 m/s2, built up over 0.3 s, 0.1 s after the last moment to begin."""

    brakes = SEATED
    margin: float = 0.0


class Eu20221426Bus(Eu20221426):
    """ADS `eu_2022_1426_bus`: 2.4 m/s2, built up over 0.12 s, for standing or unbelted
    passengers.
    """

    brakes = STANDING
