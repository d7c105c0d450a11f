"""ADSs `eu_2022_1426`, `eu_2022_1426_bus`: the least that Regulation (EU) 2022/1426 demands of an
automated vehicle.

The automated vehicle must avoid a collision with a vehicle that cuts in if the TTC, at the instant
at which that vehicle reaches 0.30 m into the lane, is above

    v_rel / (2 a) + tau / 2 + 0.1 s,  v_rel: closing speed, m/s.

So it may respond after 0.1 s, build its braking up over tau (s) and brake with a (m/s2). With
standing or unbelted passengers a and tau are smaller. Source: Annex III, cut-in (the German AFGBV,
Annex 1, has the same). The rule itself is that of `ads/reg157.py`, with these numbers.

Users: `extras/studies/qualification/regulations.py`.
"""

from dataclasses import dataclass

from sumo_eval.ads.reg157 import LastMoment, Reg157

RESPONSE = 0.1  # s
SEATED = LastMoment("eu_2022_1426", braking=6.0, response=RESPONSE, build_up=0.3)
STANDING = LastMoment("eu_2022_1426_bus", braking=2.4, response=RESPONSE, build_up=0.12)


@dataclass(eq=False)
class Eu20221426(Reg157):
    """ADS `eu_2022_1426`: brakes with 6 m/s2, built up over 0.3 s, and responds after 0.1 s."""

    brakes = SEATED
    margin: float = 0.0  # s, added to the critical TTC: it brakes at the last moment


class Eu20221426Bus(Eu20221426):
    """ADS `eu_2022_1426_bus`: 2.4 m/s2, built up over 0.12 s, for standing or unbelted
    passengers.
    """

    brakes = STANDING
