"""Skilled human drivers as controllers, and the human reference that they drive in a concrete scenario."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from sumo_eval.ads.lane_change import PathPoint, Steering, smooth_step, smooth_step_bend, smooth_step_rate
from sumo_eval.ads.overtaking import Overtaking, OvertakingHabits
from sumo_eval.ads.perception import Mover, Scene, Sensor, visible
from sumo_eval.cosim.controller import Briefing
from sumo_eval.cosim.simulate import simulate
from sumo_eval.cosim.vehicle_model import Command
from sumo_eval.drivers.population import AS_RECORDED, Driver, draw_driver
from sumo_eval.drivers.wander import SmoothNoise
from sumo_eval.errors import InputError, must_be
from sumo_eval.random_streams import random_stream
from sumo_eval.scenario.concrete import ConcreteScenario
from sumo_eval.settings import PopulationSettings, SimulationSettings
from sumo_eval.trajectory import Recording

if TYPE_CHECKING:
    from sumo_eval.drivers.packed_driver import PackedDrivers

WANDER_DEVIATION = 0.25  # m, within a driver (DLR Highway Traffic)
WANDER_CORRELATION_TIME = 2.2
"""l of exp(-t^2 / (2 l^2)), s: fits the in-lane wander of 80 recorded cars at 1, 2, 3, 4 and 5 s to 0.04. By the
usual integral measure, 2.8 s."""
WANDER_PACE = 10.0  # m/s; slower vehicles wander by distance instead of time, so that they need no sharper curves
SETTLING_TIME = 5.0
"""s. Every case begins in the middle of the lane at a given steady speed; in this time a driver's own line, own speed
and wander take over."""
FOCUS_TIME = 0.3  # s, time constant in which a driver who is about to pass something stops wandering, and starts again

PEDAL_DEVIATION = 0.39
"""Wander of the pedals, m/s2. The drive that comes of it is steadier, because the driver holds his speed: with this the
acceleration of those who overtake changes within 0.5, 1, 2, 3 and 4 s by as much as that of 64 recorded overtakers, to
3 % (root mean square 0.09, 0.18, 0.33, 0.44 and 0.51 m/s2; DLR Highway Traffic)."""
PEDAL_CORRELATION_TIME = 2.0  # s (DLR Highway Traffic: the correlation is 0.59 at 2 s, 0.28 at 3 s)
SPEED_RELAXATION = 8.0  # s in which a driver approaches the speed at which he settles

HIDING_SHARE = 0.7  # a driver recognises a vehicle once 30 % of its width shows: the lamp of one side
NOTICED_BRAKING = 0.5  # m/s2 of a vehicle ahead; brake lights tell, engine braking is hardly seen
CROSSING_SPEED = 0.3  # m/s across the road: a vehicle ahead that begins to change lane
CLOSING_SPEED = 2.0  # m/s: one that is being approached (the rule by which the recorded approaches were chosen)


class Attention:
    """What a driver knows: each vehicle as it was one reaction time ago, carried on to now as it moved then.

    So a steady vehicle is perceived exactly, and a change (a new vehicle, braking, a lane change) one reaction time
    late: the human driver model's delay with anticipation (Treiber, Kesting, Helbing, Physica A 360, 71 (2006)). The
    reaction time is the alerted one from the moment at which a vehicle ahead crosses, is closed upon or appears.
    """

    def __init__(self, driver: Driver) -> None:
        self._delay = driver.reaction_time
        self._alerted_delay = driver.alerted_reaction_time
        self._first_seen: dict[str, float] = {}
        self._memory: dict[str, deque[tuple[float, Mover]]] = {}

    def known(self, scene: Scene, time: float) -> list[Mover]:
        """Look at the true scene at `time`; return the vehicles that the driver acts upon."""
        me = scene.me
        memories = self._memory
        for other in visible(me, scene.others, HIDING_SHARE):
            memory = memories.get(other.name)
            if memory is None:
                memory = memories[other.name] = deque()
                self._first_seen[other.name] = time
                if time > 0.0:
                    self._delay = self._alerted_delay
            elif other.x > me.x and (abs(other.across) > CROSSING_SPEED or me.along - other.along > CLOSING_SPEED):
                self._delay = self._alerted_delay
            memory.append((time, _with_braking(other, memory, time)))
        past = time - self._delay + 1e-9
        known = []
        for name, memory in memories.items():
            if self._first_seen[name] > past:
                continue
            while len(memory) > 1 and memory[1][0] <= past:
                memory.popleft()
            seen, other = memory[0]
            known.append(other.after(time - seen))
        return known


def _with_braking(other: Mover, memory: deque[tuple[float, Mover]], time: float) -> Mover:
    """The vehicle with its braking since the last look, if it is strong enough to be noticed."""
    if not memory:
        return other
    before, last = memory[-1]
    braking = (last.along - other.along) / (time - before)
    return other._replace(braking=braking) if braking > NOTICED_BRAKING else other


class SyntheticDriver:
    """A driver at the wheel in one concrete scenario: the same (seed, driver, scenario) drives the same to the bit."""

    def __init__(self, driver: Driver, concrete: ConcreteScenario, seed: int) -> None:
        self.driver = driver
        stream = random_stream(seed, "driving", driver.index, concrete.scenario, *_point(concrete))
        self.wander = SmoothNoise(stream, WANDER_DEVIATION, WANDER_CORRELATION_TIME)
        self.pedal = SmoothNoise(stream, PEDAL_DEVIATION, PEDAL_CORRELATION_TIME)

    @classmethod
    def together(cls, drivers: Sequence[SyntheticDriver], scenario: Briefing) -> PackedDrivers | None:
        """The same drivers, each in a case of its own, side by side; None of a subclass, which may decide otherwise."""
        if cls is not SyntheticDriver:
            return None
        from sumo_eval.drivers.packed_driver import PackedDrivers

        return PackedDrivers(drivers, scenario)

    @property
    def habits(self) -> OvertakingHabits:
        """How the driver overtakes."""
        driver = self.driver
        return OvertakingHabits(
            inclined=driver.overtakes,
            onset_headway=driver.onset_headway,
            onset_ttc=driver.onset_ttc,
            duration=driver.lane_change_duration,
        )

    def reset(self, scenario: Briefing, traci: Any, ego: str) -> None:
        """Sit down at the wheel."""
        driver = self.driver
        self._sensor = Sensor()
        me = self._sensor.look(traci, ego).me
        self._attention = Attention(driver)
        self._overtaking = Overtaking(self.habits, driver.idm, scenario, me)
        self._steering = Steering(scenario.vehicle, scenario.step)
        self._desired_speed = driver.desired_speed(me.speed)
        self._strongest = scenario.vehicle.max_deceleration
        self._step = scenario.step
        self._clock = 0.0
        self._ease = 1.0

    def step(self, traci: Any, ego: str, time: float) -> Command:
        """Look, decide, work the pedals and the wheel."""
        scene = self._sensor.look(traci, ego)
        me = scene.me
        known = self._attention.known(scene, time)
        free = (self._desired_speed - me.speed) / SPEED_RELAXATION + self.pedal.value(time)
        free *= smooth_step(time / SETTLING_TIME)
        wanted = self._overtaking.acceleration(me, known, self._desired_speed, free)
        return Command(max(wanted, -self._strongest), self._steering.angle(me, self._line(me)))

    def _line(self, me: Mover) -> PathPoint:
        """The path, with the driver's own place in the lane and his wander on top.

        The wander runs on a clock of its own, which stands while the driver steers closely past something.
        """
        self._ease += ((0.0 if self._overtaking.passing else 1.0) - self._ease) * min(self._step / FOCUS_TIME, 1.0)
        pace = max(me.speed, WANDER_PACE) / max(self._ease, 1e-3)
        self._clock += self._step * me.speed / pace
        path = self._overtaking.path.at(self._steering.rear_axle_next(me))
        noise = self.wander.at(self._clock)
        shift = self.driver.lane_offset + noise.value
        share = self._clock / SETTLING_TIME
        if share >= 1.0:
            return PathPoint(path.y + shift, path.slope + noise.rate / pace, path.bend + noise.bend / (pace * pace))
        blend, rate, bend = smooth_step(share), smooth_step_rate(share), smooth_step_bend(share)
        rate, bend = rate / SETTLING_TIME, bend / (SETTLING_TIME * SETTLING_TIME)
        return PathPoint(
            path.y + blend * shift,
            path.slope + (rate * shift + blend * noise.rate) / pace,
            path.bend + (bend * shift + 2.0 * rate * noise.rate + blend * noise.bend) / (pace * pace),
        )


def human_controller(
    index: int, count: int, seed: int, concrete: ConcreteScenario, population: PopulationSettings = AS_RECORDED
) -> SyntheticDriver:
    """Driver number `index` of the `count` drivers of the population `seed`, ready for a concrete scenario.

    Everything is made from these, so a pool of processes can run each human run as a case of its own.
    """
    if not 0 <= index < count:
        raise must_be("`index`", f"a population of {count} drivers", f"within 0..{count - 1}", index)
    return SyntheticDriver(draw_driver(index, seed, population), concrete, seed)


def synthetic_reference(
    concrete: ConcreteScenario,
    drivers: Sequence[Driver],
    simulation_settings: SimulationSettings | None = None,
    *,
    seed: int,
) -> list[Recording]:
    """What each driver does in a concrete scenario, in the order of `drivers`, one after the other in this process."""
    if not drivers:
        raise InputError(
            f"The human reference of scenario `{concrete.scenario}` must have at least one driver, got none."
        )
    return [simulate(concrete, SyntheticDriver(driver, concrete, seed), simulation_settings) for driver in drivers]


def _point(concrete: ConcreteScenario) -> list[str]:
    return [f"{name}={float(concrete.values[name])!r}" for name in sorted(concrete.values)]
