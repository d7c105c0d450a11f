"""Hooks of TraCI in one SUMO have exactly what they have alone."""

import ast
import contextlib
import functools
import importlib
import logging
import math
import os
import random
import tomllib
from array import array
from collections import Counter
from dataclasses import replace
from functools import partial
from types import ModuleType, SimpleNamespace

import numba
import numpy as np
import pytest
from road_scenes import assert_as_alone, case, lead, once
from tables import in_campaign

from sumo_eval import Command, kernels
from sumo_eval.cosim import simulate, simulate_many, world
from sumo_eval.cosim.doors import traci_module, traci_view
from sumo_eval.cosim.doors.kept_state import first_change, kept_state, reached_modules
from sumo_eval.scenario import catalogue
from sumo_eval.scenario.sampling.samples import sample
from sumo_eval.settings import SimulationSettings

STEPS = SimulationSettings(step=0.1, record_interval=0.1, time_limit=6.0)


def points(name, number):
    logical = catalogue.load(name)
    values = sample(logical).points
    return list(logical.concretes(values[:: max(len(values) // number, 1)]))[:number]


def behind(lead_speed, *speeds):
    """A case for each speed, m/s, 80 m behind a lead."""
    return [case(lead(80.0, lead_speed), speed=speed) for speed in speeds]


behind_20 = partial(behind, 20.0)


def reasons_to_leave(cases, hook):
    """Why cases left their batch, in which each is driven as it is alone."""
    why = Counter()
    assert_as_alone(cases, simulate_many(cases, hook, STEPS, alone=why), hook, STEPS)
    return why


def returns_commands(traci, ego, time):
    return Command(-1.0 if traci.vehicle.getSpeed(ego) > 10.0 else 0.5, 0.001)


def sets_speeds(traci, ego, time):
    vehicle = traci.vehicle
    speed, ahead = vehicle.getSpeed(ego), vehicle.getLeader(ego, 100.0)
    limit = vehicle.getSpeed(ahead[0]) + 0.1 * ahead[1] if ahead else speed
    vehicle.setSpeed(ego, max(min(speed + 0.2, limit), speed - 0.3, 0.0))


def brakes(traci, ego, time):
    traci.vehicle.setSpeed(ego, 0.0)


def moves(traci, ego, time):
    (x, y), speed, step = (
        traci.vehicle.getPosition(ego), traci.vehicle.getSpeed(ego), traci.simulation.getDeltaT()
    )  # fmt: skip
    traci.vehicle.setSpeed(ego, speed)
    traci.vehicle.moveToXY(ego, "", -1, x + speed * step, y + 0.05 * step, 90.0, 2)


def looks_where_it_is(traci, ego, time):
    """Commands and TraCI in turns, by the place that it is shown."""
    place = traci.vehicle.getPosition(ego)[0] % 7.0
    if time > 1.0 and round(time / 0.1) % 4 == 0:
        return Command(0.02 * place)
    return traci.vehicle.setSpeed(ego, 15.0 + 0.1 * place)


class Mixture:
    """Looks at its neighbours, with a state of its own."""

    calls = 0

    def step(self, traci, ego, time):
        self.calls += 1
        vehicle = traci.vehicle
        beside = vehicle.getNeighbors(ego, 0b10) + vehicle.getNeighbors(ego, mode=0)
        assert ego in vehicle.getIDList()
        assert vehicle.getRoadID(vehID=ego).startswith("road")
        if self.calls % 2:
            return Command(-0.1 * len(beside))
        speed = vehicle.getSpeed(ego)
        return vehicle.setSpeed(ego, max(speed - 0.01 * sum(gap % 1.0 for _, gap in beside), 0.0))


def turns_left(traci, ego, time):
    return Command(0.0, 0.1 if time < 1.0 else 0.0)


HOOKS = [
    returns_commands, sets_speeds, moves, looks_where_it_is, Mixture,
    once(lambda traci: traci.vehicle.slowDown("ego", 5.0, 3.0)),
    once(lambda traci: traci.vehicle.setAcceleration("ego", -2.0, 2.0)),
    once(lambda traci: traci.vehicle.changeLane("ego", 1, 5.0)),
]  # fmt: skip


@pytest.mark.parametrize(
    "scenario", ["cut_in", "curve_braking", "pedestrian_crossing", "stop_and_go_stream"]
)
@pytest.mark.parametrize("hook", HOOKS)
def test_hooks_are_the_same_together_and_alone(hook, scenario):
    why = reasons_to_leave(points(scenario, 6), hook)
    assert {reason.why for reason in why} <= {"left_batch"}, why
    assert scenario != "cut_in" or not why


@pytest.mark.parametrize("scenario", ["cut_in_from_ramp", "making_room"])
@pytest.mark.parametrize("hook", [sets_speeds, looks_where_it_is, Mixture])
def test_hooks_stay_together_where_a_ramp_joins(hook, scenario):
    assert not reasons_to_leave(points(scenario, 4), hook)


@pytest.mark.parametrize("hook", [turns_left, moves])
def test_hook_that_leaves_the_edges_of_its_ramp_is_driven_alone(hook):
    why = reasons_to_leave(points("ramp_merge", 3), hook)
    assert {reason.why: count for reason, count in why.items()} == {"left_batch": 3}


@pytest.mark.parametrize("scenario", ["exit", "crossing_path", "oncoming_in_lane"])
def test_hooks_are_alone_where_roads_part_or_cross(scenario):
    why = reasons_to_leave(points(scenario, 2), brakes)
    assert {reason.why: count for reason, count in why.items()} == {"not_together": 2}


def test_hooks_stay_together_by_an_interpreted_loop(monkeypatch):
    monkeypatch.setattr(world, "read_rows", kernels._interpreted(world.read_rows.__wrapped__))
    assert not reasons_to_leave(points("cut_in", 3), sets_speeds)


@pytest.mark.parametrize("hook", [returns_commands, Mixture, brakes])
def test_hooks_with_own_conditions_are_the_same_together(hook):
    changes = [
        (), (("conditions.actuation_delay", 0.3),), (("conditions.sensor_range", 50.0),),
        (("vehicle.max_deceleration", 3.0),), (("vehicle.friction", 0.2),),
    ]  # fmt: skip
    cases = [replace(it, changes=changes[k % 5]) for k, it in enumerate(points("cut_in", 10))]
    assert not reasons_to_leave(cases, hook)


@pytest.mark.parametrize("ads", [brakes, "sumo:Krauss"])
def test_sumo_brakes_no_harder_than_the_tyres_hold(ads):
    slippery = replace(case(lead(60.0), speed=20.0), changes=(("vehicle.friction", 0.2),))
    assert simulate(slippery, ads).ego.acceleration.min() == pytest.approx(-0.2 * 9.81)


def below_15(action):
    """A hook that does this wherever it is slower than 15 m/s."""

    @functools.wraps(action)
    def hook(traci, ego, time):
        if traci.vehicle.getSpeed(ego) < 15.0:
            action(traci, ego)

    return hook


@below_15
def raises(traci, ego):
    raise ValueError("too slow")


@below_15
def touches(traci, ego):
    traci.vehicle.setSpeed("lead", 3.0)


def swallows(traci, ego, time):
    try:
        touches(traci, ego, time)
    except Exception:  # noqa: BLE001
        traci.vehicle.setSpeed(ego, 10.0)


@below_15
def jumps(traci, ego):
    traci.vehicle.moveToXY(ego, "road", 0, 400.0, 0.0, 90.0, 2)


@below_15
def hands_over(traci, ego):
    traci.vehicle.setSpeed(ego, -1)


@below_15
def asks_for_all(traci, ego):
    traci.vehicle.setSpeed(ego, 12.0 + traci.simulation.getMinExpectedNumber())


@below_15
def subscribes(traci, ego):
    vehicle = traci.vehicle
    vehicle.subscribe(ego, [traci.constants.VAR_SPEED])
    vehicle.setSpeed(ego, vehicle.getSubscriptionResults(ego).get(0x40, 9.0) - 0.1)


@below_15
def subscribes_to_all_near(traci, ego):
    vehicle = traci.vehicle
    vehicle.subscribeContext(ego, traci.constants.CMD_GET_VEHICLE_VARIABLE, 200.0)
    vehicle.setSpeed(ego, 10.0 - len(vehicle.getContextSubscriptionResults(ego)))


@below_15
def goes_round_the_guard(traci, ego):
    import libsumo

    libsumo.vehicle.setSpeed(ego, 10.0)


@below_15
def prints(traci, ego):
    print("slow")


LOG = logging.Logger("hook")  # without a handler


@below_15
def logs(traci, ego):
    if not LOG.handlers:  # as `logging.error` does; it keeps the stream that there is now
        LOG.addHandler(logging.StreamHandler())
    LOG.error("slow")


def keeps_libsumo(traci, ego, time, kept={}):  # noqa: B006
    if traci.vehicle.getSpeed(ego) < 15.0:
        kept.setdefault("libsumo", importlib.import_module("libsumo"))
        traci.vehicle.setSpeed(ego, kept["libsumo"].vehicle.getSpeed(ego) - 0.1)


class Closes:
    def step(self, traci, ego, time):
        self.slow = traci.vehicle.getSpeed(ego) < 15.0

    def close(self):
        if self.slow:
            raise ValueError("not closed")


@pytest.mark.parametrize(
    "hook",
    [
        raises,
        touches,
        swallows,
        jumps,
        hands_over,
        asks_for_all,
        subscribes,
        subscribes_to_all_near,
        goes_round_the_guard,
        prints,
        Closes,
    ],
)
def test_one_that_leaves_is_driven_alone_and_no_other(hook):
    cases = behind_20(10.0, 20.0, 18.0)
    for rows in (cases, cases[:1]):
        why = reasons_to_leave(rows, hook)
        assert {reason.why: count for reason, count in why.items()} == {"left_batch": 1}


def test_libsumo_bound_in_a_module_that_a_hook_imports_keeps_it_alone(tmp_path, monkeypatch):
    (tmp_path / "deep.py").write_text("import libsumo\nSPEED = libsumo.vehicle.getSpeed\n")
    (tmp_path / "between.py").write_text("import deep\nspeed = lambda ego: deep.SPEED(ego)\n")
    (tmp_path / "hook.py").write_text(
        "from between import speed\n"
        "def step(traci, ego, time): traci.vehicle.setSpeed(ego, speed(ego) - 0.1)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    cases, why = behind_20(10.0, 20.0), Counter()
    locator = f"{tmp_path / 'hook.py'}:step"
    together = list(simulate_many(cases, locator, STEPS, alone=why))
    assert [one.ego.speed[20] for one in together] == pytest.approx([8.0, 18.0], abs=0.11)
    assert {reason.why for reason in why} == {"on_traci"}


KEPT = {
    "object": "class Hook:\n"
    "    def __init__(self): self.ids = __import__('traci').vehicle.getIDList\n"
    "    def step(self, traci, ego, time): return Command(-0.01 * len(self.ids()))\n",
    "class": "class Hook:\n"
    "    ids = staticmethod(vehicle.getIDList)\n"
    "    def step(self, traci, ego, time): return Command(-0.01 * len(self.ids()))\n",
    "default": "def Hook(traci, ego, time, ids=vehicle.getIDList):\n"
    "    return Command(-0.01 * len(ids()))\n",
    "partial": "IDS = [partial(vehicle.getIDList)]\n"
    "def Hook(traci, ego, time): return Command(-0.01 * len(IDS[0]()))\n",
}  # ways to keep a function of libsumo, which lists the vehicles of all rows


@pytest.mark.parametrize("way", KEPT)
def test_call_of_libsumo_kept_anywhere_drives_a_hook_alone(way, tmp_path):
    imports = "from functools import partial\nfrom sumo_eval import Command\n"
    (tmp_path / "hook.py").write_text(f"{imports}from traci import vehicle\n{KEPT[way]}")
    why = reasons_to_leave(behind_20(10.0, 20.0), f"{tmp_path / 'hook.py'}:Hook")
    assert {reason.why for reason in why} == {"on_traci"}


class AsksAsItIsMade:
    def __init__(self):
        self.vehicle = importlib.import_module("traci").vehicle

    def step(self, traci, ego, time):
        return Command(-0.1 * self.vehicle.getSpeed(ego) / 20.0)


FASTER = numba.njit(lambda speed: speed + 0.1)
ERROR = traci_module.TRACI.TraCIException


def compiles(traci, ego, time):
    with contextlib.suppress(ERROR):
        return traci.vehicle.setSpeed(ego, FASTER(traci.vehicle.getSpeed(ego)))


@pytest.mark.parametrize("hook", [AsksAsItIsMade, compiles])
def test_hook_that_imports_traci_or_numba_stays_in_its_batch(hook):
    assert not reasons_to_leave(behind_20(10.0, 20.0), hook)


CACHE = {}
GENERATOR = random.Random(3)
CALLS = 0


def caches(traci, ego, time):
    return Command(-0.01 * CACHE.setdefault(ego, traci.vehicle.getSpeed(ego)))


def remembers(traci, ego, time):
    remembers.last = time
    return Command(-1.0)


def draws(traci, ego, time):
    return Command(GENERATOR.gauss(0.0, 0.1))


def sets_variables(traci, ego, time):
    os.environ["CALLS"] = str(int(os.environ.get("CALLS", "0")) + 1)
    return Command(-0.001)


def rebinds(traci, ego, time):
    global CALLS
    CALLS += 1
    return Command(-0.001)


def marks_traci(traci, ego, time):
    traci.last = time
    return Command(-0.001)


def enclosing(folder):
    calls = [0]

    def encloses(traci, ego, time):
        calls[0] += 1
        return Command(-0.001)

    return encloses


def writes_files(folder):
    def hook(traci, ego, time):
        file = folder / "calls"
        calls = int(file.read_text()) if file.exists() else 0
        file.write_text(str(calls + 1))
        return Command(-0.001 * (calls % 7))

    return hook


class Counts:
    calls = 0

    def step(self, traci, ego, time):
        Counts.calls += 1
        return Command(-0.001)


class Slots:
    __slots__ = ("calls",)


class AnswersAll:
    __slots__ = ()

    def __getattr__(self, name):
        return lambda *_: None


class AnswersNothing:
    def __getattr__(self, name):
        raise RuntimeError(name)


class NoLength(list):
    def __len__(self):
        raise RuntimeError


class NoMembers(list):
    def __iter__(self):
        raise RuntimeError


def test_every_way_to_keep_state_is_seen_and_nan_is_none():
    held = Slots()
    generator = (item for item in range(9))
    kept = {"nan": math.nan, "slot": held, "bytes": bytearray(1), "numbers": array("d", [0.0]),
        "space": SimpleNamespace(calls=0), "generator": generator, "method": [].append,
        "bound": Counts().step, "partial": partial(print, held), "numpy": np.random.default_rng(1),
        "all": AnswersAll(), "nothing": AnswersNothing(), "length": NoLength(),
        "members": NoMembers([1])}  # fmt: skip

    def hook():
        vars(hook)

    vars(hook).update(kept)
    derived = type("Slots", (Slots,), {"hook": hook})
    assert first_change(kept_state(derived), kept_state(derived)) is None
    changes = (
        lambda: setattr(held, "calls", 1), lambda: kept["bytes"].append(1),
        lambda: kept["numbers"].append(1.0), lambda: vars(kept["space"]).update(calls=1),
        lambda: next(generator), lambda: kept["numpy"].normal(),
        lambda: setattr(kept["bound"].__self__, "calls", 1),
        lambda: kept["partial"].args[0].__setattr__("calls", 2),
    )  # fmt: skip
    for change in changes:
        before = kept_state(derived)
        change()
        assert first_change(before, kept_state(derived)) == "Slots", change


def test_what_many_objects_hold_is_looked_into_once():
    """A map whose lanes know each other and the map would take minutes."""
    lanes = [SimpleNamespace(points=[1.0 * lane, 2.0]) for lane in range(30)]
    for lane in lanes:
        lane.map = lane.others = list(lanes)
    kind = type("Kind", (), {"map": dict(enumerate(lanes)), "now": [lanes[0].points]})
    assert len(repr(kept_state(kind)["Kind"])) < 100_000
    for change in (
        lambda: lanes[29].points.__setitem__(1, 3.0),
        lambda: kind.now.__setitem__(0, lanes[1].points),
    ):
        before = kept_state(kind)
        change()
        assert first_change(before, kept_state(kind)) == "Kind"


def test_attributes_of_a_users_own_kind_of_list_are_compared():
    history = type("History", (list,), {})([1.0])
    kind = type("Kind", (), {"history": history})
    before = kept_state(kind)
    assert first_change(before, kept_state(kind)) is None
    history.calls = 1
    assert first_change(before, kept_state(kind)) == "Kind"


@pytest.mark.parametrize(
    "folder, is_reached", [("project", True), ("site-packages", False), ("dist-packages", False)]
)
def test_installed_packages_are_not_looked_into(folder, is_reached, monkeypatch):
    package = ModuleType("a_package")
    package.__file__ = f"/home/user/{folder}/a_package.py"
    monkeypatch.setitem(globals(), "package", package)
    assert (package in reached_modules(Counts)) == is_reached


def test_a_module_may_put_an_object_in_its_place(tmp_path, monkeypatch):
    """The usual recipe for constants; the state of such a module is compared, too."""
    (tmp_path / "constants.py").write_text(
        "import sys\nCALLS = []\nclass Constants:\n    gain = -1.0\n"
        "    def count(self):\n        CALLS.append(1)\n"
        "sys.modules[__name__] = Constants()\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    constants = importlib.import_module("constants")
    monkeypatch.setitem(globals(), "constants", constants)
    before = kept_state(Counts)
    assert first_change(before, kept_state(Counts)) is None
    constants.count()
    assert first_change(before, kept_state(Counts)) == "constants.CALLS"


@pytest.mark.parametrize(
    "hook, name",
    [
        (caches, "CACHE"), (remembers, "remembers"), (draws, "GENERATOR"), (Counts, "Counts"),
        (sets_variables, "os.environ"), (rebinds, "CALLS"), (enclosing, "encloses"),
        (marks_traci, "traci"), (writes_files, "drives differently when it is alone"),
    ],
)  # fmt: skip
def test_shared_state_drives_each_case_alone_and_is_named(hook, name, tmp_path, monkeypatch):
    """Nine kinds: eight are seen in the state, that of a file in the cases compared alone."""
    monkeypatch.setenv("CALLS", "0")
    why = Counter()
    ads = hook(tmp_path) if hook in (enclosing, writes_files) else hook
    list(simulate_many(behind(0.0, 20.0, 18.0), ads, STEPS, alone=why))
    (reason,) = why
    assert why[reason] == 2
    assert reason.why == "keeps_state"
    assert name in str(reason)


def test_shared_state_is_named_with_its_file(tmp_path):
    """Beside a proxy that is not bound, whose `__class__` raises."""
    (tmp_path / "my_ads.py").write_text(
        "class Proxy:\n    __class__ = property(lambda self: 1 / 0)\n\nREQUEST = Proxy()\n"
        "CALLS = []\n"
        "def step(traci, ego, time):\n"
        "    CALLS.append(time)\n"
        "    traci.vehicle.setSpeed(ego, 10.0)\n"
    )
    (reason,) = reasons_to_leave(behind(0.0, 10.0, 10.1), f"{tmp_path / 'my_ads.py'}:step")
    assert "(my_ads.py: CALLS), so that results may depend on their order" in str(reason)


@pytest.mark.parametrize("hook", [logs, keeps_libsumo])
def test_what_a_hook_keeps_from_a_batch_works_after_it(hook):
    slow, _ = simulate_many(behind(0.0, 10.0, 20.0), hook, STEPS)
    assert slow.error is None


ARGUMENTS = tomllib.loads("""
couldChangeLane = [1]
wantsAndCouldChangeLane = [1]
getLaneChangeState = [1]
getLaneChangeStatePretty = [1]
getAdaptedTraveltime = [0.0, "road"]
getEffort = [0.0, "road"]
getDrivingDistance = ["road", 200.0]
getFollowSpeed = [10.0, 20.0, 8.0, 4.5]
getSecureGap = [10.0, 8.0, 4.5]
getStopSpeed = [10.0, 20.0]
getNeighbors = [0b10]
getParameter = ["none"]
getParameterWithKey = ["none"]
getChangePermissions = [1]
"edge.getAdaptedTraveltime" = [0.0]
"edge.getEffort" = [0.0]
""")
"""What a getter takes beside a name; the others take nothing."""
NAMES = {
    "vehicle": ("ego", "lead"), "vehicletype": ("ego", "lead"), "lane": ("road_0", "road_1"),
    "edge": ("road",), "route": ("along",),
}  # fmt: skip


LEFT_OUT = {
    "getStopParameter": "raises without a stop",
    **dict.fromkeys(traci_view._OF_MANY, "is about more than a row: the case leaves"),
}
LEFT_DOMAINS = {
    "simulation": "is about all rows", "gui": "shows all rows",
    **dict.fromkeys(
        ("busstop", "calibrator", "chargingstation", "inductionloop", "junction", "lanearea",
         "meandata", "multientryexit", "overheadwire", "parkingarea", "person", "poi", "polygon",
         "rerouter", "routeprobe", "trafficlight", "variablespeedsign"),
        "has no object of a row",
    ),
}  # fmt: skip


def getters(domain):
    """The reading calls of a domain that are a row's, each with what it takes beside a name."""
    for call in dir(getattr(traci_module.libsumo, domain)):
        if call.startswith(traci_view._READS) and call not in LEFT_OUT:
            yield call, ARGUMENTS.get(f"{domain}.{call}", ARGUMENTS.get(call, ()))


def test_each_domain_is_asked_or_has_a_reason():
    domains = {domain.__name__ for domain in traci_module.libsumo.DOMAINS}
    assert domains == NAMES.keys() | LEFT_DOMAINS.keys()
    assert not NAMES.keys() & LEFT_DOMAINS.keys()


class AsksAll:
    """Asks all that a row can be asked, and writes the answers down."""

    folder = ""

    def reset(self, briefing, traci, ego):
        vehicles = sorted(traci.vehicle.getIDList(), key=lambda name: name != ego)
        self.names = NAMES | {"vehicle": vehicles, "vehicletype": vehicles}
        self.edge = traci.vehicle.getRoadID(ego)
        if self.edge != "road":  # of a road with several sections
            edges = sorted({edge for it in vehicles for edge in traci.vehicle.getRoute(it)})
            count = traci.edge.getLaneNumber
            self.names |= {
                "edge": edges,
                "lane": [f"{edge}_{lane}" for edge in edges for lane in range(count(edge))],
                "route": [f"along_{it}" for it in vehicles],
            }
        self.case, self.answers = (
            "-".join(f"{traci.vehicle.getSpeed(it):.17g}" for it in vehicles),
            [],
        )

    def step(self, traci, ego, time):
        if round(10.0 * time) % 10 == 0:
            answers = self.answers
            answers += [f"{traci.vehicle.getIDList()} {traci.simulation.getTime()}"]
            for domain, names in self.names.items():
                for call, arguments in getters(domain):
                    arguments = [self.edge if it == "road" else it for it in arguments]
                    asleep = call in traci_view._OF_MODELS
                    for name in names[:1] if asleep else names:
                        answer = getattr(getattr(traci, domain), call)(name, *arguments)
                        answers.append(f"{domain}.{call} {name} {answer!r}")
        return traci.vehicle.setSpeed(ego, max(traci.vehicle.getSpeed(ego) - 0.1, 0.0))

    def close(self):
        with open(f"{self.folder}/{self.case}", "a") as file:
            file.write(f"{self.answers}\n")


@pytest.mark.parametrize(
    "counts, least",
    [((3, 2, 2), 5_000), in_campaign((256, 64, 64), 400_000)],
)
def test_every_getter_answers_a_row_as_it_does_alone(counts, least, tmp_path, monkeypatch):
    """Of the ego and of one, two or three others, of a pedestrian, of those that react, and on a
    road with a ramp.
    """
    monkeypatch.setattr(AsksAll, "folder", str(tmp_path))
    scenarios = "cut_in_from_ramp", "making_room", "ramp_merge", "lane_drop"
    cases, why = [*points("pedestrian_crossing", 1), *points("stop_and_go_stream", 1)], Counter()
    cases += [points(name, 3)[-1] for name in scenarios]
    for actors, count in enumerate(counts, 1):
        for speed in np.linspace(12.0, 24.0, count).tolist():
            others = [
                replace(lead(80.0 + 40.0 * k, 0.9 * speed), name=name)
                for k, name in enumerate(("lead", "second", "third")[:actors])
            ]
            cases.append(case(*others, speed=speed))
    list(simulate_many(cases, AsksAll, STEPS, alone=why))
    assert not why
    for it in cases:
        simulate(it, AsksAll, STEPS)
    answers = 0
    for file in tmp_path.iterdir():
        first, *more = (ast.literal_eval(line) for line in file.read_text().splitlines())
        answers += len(first)
        assert more
        for drive in more:
            assert [pair for pair in zip(first, drive, strict=True) if pair[0] != pair[1]] == []
    assert answers >= least
