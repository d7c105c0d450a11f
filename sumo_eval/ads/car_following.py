"""Following a vehicle: the Intelligent Driver Model (IDM), its enhanced form for dense traffic, and
the ADSs `idm` and `attentive`.

Users: `ads/__init__.py`, `ads/lane_changer.py`, `ads/overtaking.py`, `cosim/doors/controller.py`,
`drivers/synthetic/driver.py`, `drivers/synthetic/population.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from math import inf, isfinite, isnan, nan, sqrt, tanh
from typing import Any, ClassVar

from sumo_eval.ads.asked_change import beside, change_if_free
from sumo_eval.ads.lane_change import (
    PATH,
    curvature_kept,
    keep_lane,
    path_at,
    rear_axle_next,
    steering,
)
from sumo_eval.ads.perception import bumper_gap, coming_into_path, lead_in_path
from sumo_eval.cosim.compiled import Compiled, decides, each_row
from sumo_eval.errors import must_be
from sumo_eval.frozen import frozen
from sumo_eval.kernels import fields, flags, kernel
from sumo_eval.scenario.concrete import LEAST_CHANGE

EXPONENT = 4.0  # delta of the free-road term (Treiber, Hennecke, Helbing 2000)
COOLNESS = 0.99  # c of the enhanced IDM (Kesting, Treiber, Helbing 2010)
# s, time constant in which an accepted short headway grows back (Schakel et al. 2012, LMRS)
HEADWAY_RECOVERY = 25.0
# m, least gap to divide by: at such a gap the models ask for more than any brake can give
MIN_GAP = 0.1
MIN_SPEED = 0.1  # m/s, least speed to divide by


@frozen
class IdmParameters:
    """Parameters of the IDM.

    headway: T, s.
    standstill_gap: s0, m.
    acceleration: a, m/s2.
    deceleration: b, the comfortable one, m/s2, > 0.
    """

    headway: float = 1.2
    standstill_gap: float = 2.0
    acceleration: float = 1.5
    deceleration: float = 2.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not (isfinite(value) and value > 0.0):
                raise must_be(f"`{name}`", "the IDM", "a finite number greater than 0", value)

    @classmethod
    def of(cls, given: IdmParameters | Mapping[str, float] | None) -> IdmParameters:
        """The parameters of an ADS, from ready ones, a table of an evaluation file, or None for the
        defaults.
        """
        return given if isinstance(given, IdmParameters) else cls(**(given or {}))


@kernel
def desired_gap(
    speed: float, closing_speed: float, idm: Any, headway: float | None = None
) -> float:
    """s* = s0 + max(0, v T + v dv / (2 sqrt(a b))), m.

    speed: v, m/s.
    closing_speed: dv = v - v_lead, m/s.
    headway: T, s; None: that of `idm`.

    Source: Treiber, Hennecke, Helbing, Phys. Rev. E 62, 1805 (2000).
    """
    time = idm.headway if headway is None else headway
    braking = speed * closing_speed / (2.0 * sqrt(idm.acceleration * idm.deceleration))
    return float(idm.standstill_gap + max(0.0, speed * time + braking))


@kernel
def idm_acceleration(
    speed: float, desired_speed: float, gap: float, lead_speed: float, idm: Any
) -> float:
    """IDM: dv/dt = a (1 - (v / v0)^4 - (s* / s)^2), m/s2.

    speed: v, m/s.
    desired_speed: v0, m/s.
    gap: s, bumper to bumper, m; inf on a free road.
    lead_speed: m/s.

    Source: Treiber, Hennecke, Helbing, Phys. Rev. E 62, 1805 (2000).
    """
    free = (speed / max(desired_speed, MIN_SPEED)) ** EXPONENT
    crowding = desired_gap(speed, speed - lead_speed, idm) / max(gap, MIN_GAP)
    return float(idm.acceleration * (1.0 - free - crowding * crowding))


@kernel
def free_acceleration(speed: float, desired_speed: float, idm: Any) -> float:
    """Free-road acceleration of the improved IDM, m/s2.

        v <= v0: a (1 - (v / v0)^4)
        v > v0:  -b (1 - (v0 / v)^(4 a / b))

    Source: Treiber, Kesting, Traffic Flow Dynamics (2013), section 11.3.7.
    """
    wanted = max(desired_speed, MIN_SPEED)
    if speed <= wanted:
        return float(idm.acceleration * (1.0 - (speed / wanted) ** EXPONENT))
    power = EXPONENT * idm.acceleration / idm.deceleration
    return float(-idm.deceleration * (1.0 - (wanted / speed) ** power))


@kernel
def improved_idm_acceleration(
    speed: float,
    desired_speed: float,
    gap: float,
    lead_speed: float,
    idm: Any,
    headway: float | None = None,
) -> float:
    """Improved IDM, m/s2: as the IDM, but at v = v0 the gap settles at s* itself, not at infinity.

    With z = s* / s and f the free-road acceleration:

        v <= v0: f (1 - z^(2 a / f)) for z < 1, else a (1 - z^2)
        v > v0:  f for z < 1, else f + a (1 - z^2)

    headway: as in `desired_gap`; other arguments as in `idm_acceleration`.

    Source: Treiber, Kesting, Traffic Flow Dynamics (2013), section 11.3.7.
    """
    free = free_acceleration(speed, desired_speed, idm)
    z = desired_gap(speed, speed - lead_speed, idm, headway) / max(gap, MIN_GAP)
    crowded = float(idm.acceleration * (1.0 - z * z))
    if speed <= max(desired_speed, MIN_SPEED):
        if z >= 1.0:
            return crowded
        return float(free * (1.0 - z ** (2.0 * idm.acceleration / free))) if free > 0.0 else 0.0
    return free + (crowded if z >= 1.0 else 0.0)


@kernel
def constant_speed_heuristic(speed: float, gap: float, lead_speed: float) -> float:
    """Acceleration, m/s2, that just avoids a lead at constant speed: -dv^2 / (2 s) while closing,
    else 0.

    Source: the constant-acceleration heuristic of Kesting, Treiber, Helbing (2010) with lead
    acceleration 0.
    """
    closing = speed - lead_speed
    return -closing * closing / (2.0 * max(gap, MIN_GAP)) if closing > 0.0 else 0.0


@kernel
def constant_acceleration_heuristic(
    speed: float, gap: float, lead_speed: float, lead_braking: float
) -> float:
    """CAH: acceleration, m/s2, that just avoids a lead which keeps braking with b_l > 0 until it
    stands.

    v_l (v - v_l) <= 2 s b_l (the lead stands first): -v^2 b_l / (v_l^2 + 2 s b_l)
    else: -b_l - dv^2 / (2 s), dv = max(v - v_l, 0)

    Source: Kesting, Treiber, Helbing, Phil. Trans. R. Soc. A 368, 4585 (2010).
    """
    distance = max(gap, MIN_GAP)
    if lead_speed * (speed - lead_speed) <= 2.0 * distance * lead_braking:
        return (
            -speed
            * speed
            * lead_braking
            / (lead_speed * lead_speed + 2.0 * distance * lead_braking)
        )
    return -lead_braking + constant_speed_heuristic(speed, gap, lead_speed)


@kernel
def enhanced_idm_acceleration(
    speed: float,
    desired_speed: float,
    gap: float,
    lead_speed: float,
    idm: Any,
    headway: float | None = None,
    lead_braking: float = 0.0,
) -> float:
    """Enhanced IDM ("ACC model"), m/s2: brakes at most about b harder than the gap needs.

    i = improved IDM; h = constant-speed heuristic, or, behind a lead that brakes with
    `lead_braking`, m/s2, the constant-acceleration heuristic (CAH).

        i >= h: i
        i < h:  (1 - c) i + c (h + b tanh((i - h) / b)), c = `COOLNESS`

    The plain IDM brakes at its limit when it is suddenly close behind a lead of its own speed;
    people do not.

    Source: Kesting, Treiber, Helbing, Phil. Trans. R. Soc. A 368, 4585 (2010).
    """
    plain = improved_idm_acceleration(speed, desired_speed, gap, lead_speed, idm, headway)
    if lead_braking > 0.0:
        needed = constant_acceleration_heuristic(speed, gap, lead_speed, lead_braking)
    else:
        needed = constant_speed_heuristic(speed, gap, lead_speed)
    if plain >= needed:
        return plain
    b = idm.deceleration
    return float((1.0 - COOLNESS) * plain + COOLNESS * (needed + b * tanh((plain - needed) / b)))


FOLLOWED = fields("accepted", "gap")
"""A follower's memory of each vehicle.

accepted: headway accepted behind it, s; nan: it has not been a lead yet.
gap: bumper gap to it in this step, m.
"""


@kernel
def follow(followed: Any, me: Any, lead: Any, desired_speed: float, idm: Any, step: float) -> float:
    """The enhanced IDM with a memory of the headway accepted behind a lead, m/s2.

    Each call lets the headway grow for one step. A rule that tries several decisions in a step sets
    `followed.accepted` back before each (`lane_changer.wanted_at`).

    A follower with a lead closer than its own headway T accepts the shorter headway T' at first,
    and lets it grow back to T: dT'/dt = (T - T') / 25 s. Source: Schakel, Knoop, van Arem, Transp.
    Res. Rec. 2316 (2012), LMRS.

    followed: memory of the lead, of `FOLLOWED`; its `gap` is set.
    """
    own, accepted, gap = idm.headway, followed.accepted, followed.gap
    if isnan(accepted):
        accepted = min(own, max(gap - idm.standstill_gap, 0.0) / max(me.speed, MIN_SPEED))
    followed.accepted = accepted + (own - accepted) * (step / HEADWAY_RECOVERY)
    return enhanced_idm_acceleration(
        me.speed, desired_speed, gap, lead.along, idm, accepted, lead.braking
    )


@kernel
def change_as_asked(
    path: Any, way: Any, me: Any, others: Any, desired_speed: float, idm: Any, scenario: Any
) -> float:
    """Largest acceleration of an ego that has to change lanes, m/s2; begins the change in `path`
    where `asked_change` allows it.

    The ego follows, by the IDM, the vehicle behind which it will be in the other lane. Until the
    change has begun it brakes for that vehicle only comfortably (b). It waits before the end of its
    lane.

    path, way, others: as in `asked_change`.
    """
    changing = change_if_free(path, way, me, others, scenario)
    most = inf  # no limit yet
    lead, _ = beside(way, me, others, scenario)
    # 0 until the change may begin, and without a vehicle ahead in the other lane
    gap = bumper_gap(me, others[lead]) if lead >= 0 and me.x >= way.begin else 0.0
    if gap > 0.0:  # a vehicle alongside leaves no gap to keep
        most = idm_acceleration(me.speed, desired_speed, gap, others[lead].along, idm)
        if not changing:
            most = max(most, -idm.deceleration)
    if way.ends and not changing:
        # from its front to the last place where the shortest change can begin, m
        room = way.by - LEAST_CHANGE - me.x - me.half_length
        most = min(most, idm_acceleration(me.speed, desired_speed, room, 0.0, idm))
    return most


PARAMETERS = fields("headway", "standstill_gap", "acceleration", "deceleration")
"""`IdmParameters` as a record, for kernels."""


@kernel
def idm(ego: Any, others: Any, own: Any, watched: Any, others_then: Any, scenario: Any) -> None:
    """Write acceleration and steering wheel angle of the ego, decided once a cycle, the time
    between two decisions: a vehicle that enters the path becomes the lead at the next cycle.

    The arguments are those of every rule (`cosim.compiled.each_row`).

    scenario: two records; the step of the first is the simulation's, that of the second a cycle.
    """
    me = ego.seen
    if own.steps == 0:
        own.desired_speed = me.speed
        keep_lane(own.path, me, scenario[0].road)
        own.curvature = curvature_kept(own.path, me)
    if decides(own, scenario):
        own.commanded, own.steered = _decide(me, others, own, watched, ego.way, scenario[1])
    ego.command.acceleration, ego.command.steering = own.commanded, own.steered


@kernel
def _decide(
    me: Any, others: Any, own: Any, watched: Any, way: Any, scenario: Any
) -> tuple[float, float]:
    """Acceleration, m/s2, and steering wheel angle, rad, for a cycle: the IDM, along the path.

    With the parameter `watches`, a road user that comes into the path is the lead if it is nearer
    than the vehicle in the path.

    scenario: the `SCENARIO` record whose step is a cycle.
    """
    lead, p = lead_in_path(me, others), own.p.idm
    if own.p.watches:
        coming = coming_into_path(me, others)
        if coming >= 0 and (lead < 0 or others[coming].x < others[lead].x):
            lead = coming
    gap, lead_speed, braking = inf, 0.0, 0.0
    if lead >= 0:
        gap = bumper_gap(me, others[lead])
        lead_speed = others[lead].along
        # `last_speed` is of the last cycle, and `scenario.step` is a cycle's length, s
        if not isnan(watched[lead].last_speed):
            braking = (watched[lead].last_speed - lead_speed) / scenario.step
    for j in range(len(others)):
        watched[j].last_speed = nan if isnan(others[j].x) else others[j].along
    strongest = scenario.vehicle.max_deceleration
    now = max(idm_acceleration(me.speed, own.desired_speed, gap, lead_speed, p), -strongest)
    # Midpoint rule: move the ego with `now` and the lead with `-braking` to the middle of the
    # cycle. The acceleration that the formula gives there serves as the mean over the cycle.
    half = 0.5 * scenario.step
    gap = gap + (lead_speed - me.speed) * half - 0.5 * (braking + now) * half * half
    speed = max(me.speed + now * half, 0.0)
    # A lead that brakes slows down to 0 at most. An oncoming one, whose speed is below 0, counts
    # with its present speed if it speeds up.
    lead_speed = max(lead_speed - braking * half, min(lead_speed, 0.0))
    wanted = idm_acceleration(speed, own.desired_speed, gap, lead_speed, p)
    if way.asked:
        wanted = min(
            wanted, change_as_asked(own.path, way, me, others, own.desired_speed, p, scenario)
        )
    y, slope, bend = path_at(own.path, rear_axle_next(me, scenario))
    return max(wanted, -strongest), steering(own, me, y, slope, bend, scenario)


class Idm(Compiled):
    """ADS `idm`: keeps its lane and follows by the IDM alone.

    Its desired speed is the one it starts with.

    Its default T of 1.2 s lies between the motorway values of Treiber, Hennecke, Helbing (2000: T
    1.6 s, a 0.73, b 1.67) and of Treiber, Kesting (2013: T 1.0 s, a 1.0, b 1.5). Its a of 1.5 and b
    of 2.0 m/s2 are close to those of Kesting, Treiber, Helbing (2010: T 1.5 s, a 1.4, b 2.0). It
    brakes as hard as the formula asks, up to the vehicle's brakes.
    """

    loop = each_row(idm)
    memory: ClassVar = [
        *fields("desired_speed", "curvature", "commanded", "steered"),
        ("path", PATH),
        *flags("steps"),
    ]
    """commanded: acceleration, m/s2, and steered: steering wheel angle, rad, in this cycle.

    steps: driven so far.
    """
    watched = fields("last_speed")  # of each vehicle along the road, m/s; nan: it was not seen
    numbers: ClassVar = [("idm", PARAMETERS), *flags("watches")]
    watches = False  # whether a road user that comes into the path counts, see `Attentive`

    def __init__(self, parameters: IdmParameters | Mapping[str, float] | None = None) -> None:
        self.idm = IdmParameters.of(parameters)


class Attentive(Idm):
    """ADS `attentive`: the IDM that also brakes for road users about to enter its path, above all
    for pedestrians who cross the road.

    A road user ahead that moves towards the path becomes the lead as soon as it and the ego would
    be in the same place within a second of each other (`perception.coming_into_path`). It is seen
    even if a nearer vehicle hides up to half of it. A road user that crosses in time before or
    behind the ego is ignored. This baseline is the project's own: no regulation names one for
    pedestrians.
    """

    watches = True
