"""The measured traps of libsumo 1.28, one by one: that we are not caught by it."""

import contextlib
import io
import itertools
import locale
import math
import os
import sys
from dataclasses import replace

import libsumo
import pytest
from commands import python
from road_scenes import (
    HALF_SECOND,
    ROAD,
    assert_ended,
    assert_last,
    case,
    clips_of,
    half_second,
    lead,
)
from tables import values_of

import sumo_eval.cosim.sumo.session as session_module
from sumo_eval.cosim import Command, simulate
from sumo_eval.cosim.sumo import insides
from sumo_eval.cosim.sumo.session import session
from sumo_eval.cosim.sumo.sumo_files import SIMULATION_OPTIONS, routes_xml
from sumo_eval.errors import SimulationError
from sumo_eval.scenario import Actor, Start, lane_change
from sumo_eval.settings import SimulationSettings, VehicleSettings

CAR = VehicleSettings()
STEP = 0.05  # s


# 1 ------------------------------------------------------------------------------------------------

TOO_CLOSE = case(lead(gap=1.0, speed=10.0))  # 20 m/s, 1 m behind a car at 10 m/s


def test_trap_1_the_session_starts_it_as_requested():
    with session(TOO_CLOSE, SimulationSettings()) as traci:
        assert set(traci.vehicle.getIDList()) == {"ego", "lead"}
        assert traci.vehicle.getPosition("ego") == pytest.approx((52.25, 0.0))
        assert traci.vehicle.getPosition("lead") == pytest.approx((57.75, 0.0))
        assert traci.vehicle.getSpeed("ego") == 20.0
        assert traci.vehicle.getSpeed("lead") == 10.0


@pytest.mark.parametrize(
    "written, instead, sentence",
    values_of("""
    ' depart="0"', ' depart="3"', "did not insert vehicle `ego`"
    'departPos="52.25"', 'departPos="53"', "at (50.750, 0.000) m instead of (50.000, 0.000) m"
    'departSpeed="20.0"', 'departSpeed="19"', "the speed 19.000 m/s instead of 20.000 m/s"
    """),
)
def test_trap_1_a_start_that_is_not_the_requested_one_is_refused(
    monkeypatch, written, instead, sentence
):
    text = routes_xml(case(), CAR)
    assert written in text
    monkeypatch.setattr(session_module, "routes_xml", lambda *_: text.replace(written, instead))
    found = simulate(case(), lambda *_: None)
    assert_ended(found, "sim_error", sentence)


# 2 ------------------------------------------------------------------------------------------------

# both leave their lane by 0.9 m and 1.1 m towards the other's: 3.5 - 0.9 - 1.1 = 1.5 m apart, 1.8 m
# wide
ACROSS_THE_LINE = case(Actor("lead", Start(51.0, 2.4, 20.0)), y=0.9)


def test_trap_2_our_contact_test_sees_the_overlap():
    found = simulate(ACROSS_THE_LINE, lambda *_: None)
    assert found.end_reason == "contact"
    assert found.collision.other == "lead"
    assert found.collision.time == 0.0


# 3 ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [0, 2, 31, 32])
def test_trap_3_under_test_a_speed_mode_is_taken_back_and_recorded(mode):
    def tricky(traci, ego, time):
        traci.vehicle.setSpeedMode(ego, mode)
        traci.vehicle.setSpeed(ego, 0.0)

    found = half_second(tricky)
    clips = clips_of(found)
    assert clips["speed_mode"].count == 10  # each of the 10 steps
    assert clips["speed_mode"].requested == mode
    assert clips["speed_mode"].applied == 6
    # that the limit was reached is on record
    assert clips["vtype_limit"].requested == pytest.approx(-9.0)
    assert_last(found, speed=20.0 - 9.0 * 0.5)


# 4 ------------------------------------------------------------------------------------------------

ONE_METRE_BEHIND = case(lead(gap=1.0, speed=20.0))


def test_trap_4_in_our_sessions_no_vehicle_teleports():
    with session(ONE_METRE_BEHIND, SimulationSettings(), {"minGap": "2.5"}) as traci:
        for name, speed in (("ego", 20.0), ("lead", 0.0)):
            traci.vehicle.setSpeedMode(name, 32)
            traci.vehicle.setSpeed(name, speed)
        collisions = []
        for _ in range(10):
            traci.simulationStep()
            collisions.append(len(traci.simulation.getCollisions()))
        assert traci.vehicle.getIDList() == ("ego", "lead")
    assert collisions[0] == 0  # 0 m left, none lost
    assert collisions[-1] == 1  # SUMO still sees those within a lane: a TraCI ADS may ask it


# 5 ------------------------------------------------------------------------------------------------


def test_trap_5_a_nested_session_is_refused_and_the_outer_lives():
    with session(case(), SimulationSettings()) as traci:
        refused = pytest.raises(
            SimulationError, match="already running in this process; libsumo holds one at a time"
        )
        with refused, session(case(), SimulationSettings()):
            pass
        traci.simulationStep()
        assert traci.vehicle.getIDList() == ("ego",)


@pytest.mark.parametrize(
    "writer, text, quote",
    values_of("""
    "network_xml", "no network at all", "invalid document structure"
    "routes_xml", '<routes><vehicle id="ego" route="nowhere" depart="0"/></routes>', "nowhere"
    "routes_xml", "<routes>", "rou.xml"
    "routes_xml", "", "rou.xml"  # a step of what was loaded would crash, or write a file
    """),
)
def test_trap_5_a_bad_file_quotes_sumos_log_and_keeps_the_console_clean(
    monkeypatch, capfd, tmp_path, writer, text, quote
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(session_module, writer, lambda *_: text)
    with (
        pytest.raises(SimulationError, match="SUMO could not start the case") as caught,
        session(case(), HALF_SECOND),
    ):
        pass
    assert quote in str(caught.value)
    assert "Process Error" not in str(caught.value).replace("TraCIException: Process Error (", "(")
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err == ""
    monkeypatch.undo()
    assert not list(tmp_path.iterdir())
    # the next case works
    assert half_second(lambda *_: None).end_reason == "time_limit"


@pytest.mark.parametrize("closed", [None, io.StringIO()])
def test_trap_5_session_starts_with_stderr_closed(monkeypatch, closed):
    if closed is not None:
        closed.close()
    monkeypatch.setattr(sys, "stderr", closed)
    assert half_second(lambda *_: None).end_reason == "time_limit"


def test_trap_5_session_starts_though_nobody_reads_stderr(tmp_path):
    """As after `sumo-eval run ... 2>&1 | head -1`."""
    reader, writer = os.pipe()
    os.close(reader)
    console = os.dup(2)
    os.dup2(writer, 2)
    try:
        with session_module._stderr_into(tmp_path / "stderr.txt"):
            os.write(2, b"Loading done.\n")  # as SUMO prints
    finally:
        os.dup2(console, 2)
        os.close(console)
        os.close(writer)


def test_trap_5_stderr_works_again_after_a_session(capfd):
    with pytest.raises(SimulationError), session(case(speed=99.0), HALF_SECOND):
        pass
    os.write(2, b"here again\n")
    assert capfd.readouterr().err == "here again\n"


# 6 ------------------------------------------------------------------------------------------------


def test_trap_6_importing_prints_nothing_to_stdout():
    code = (
        "import os; os.environ.pop('LIBSUMO_AS_TRACI', None)\n"
        "import builtins, sys\n"
        "seen = []\n"
        "plain = builtins.__import__\n"
        "def spy(name, *rest, **named):\n"
        "    if name == 'libsumo': seen.append(os.environ.get('LIBSUMO_AS_TRACI'))\n"
        "    return plain(name, *rest, **named)\n"
        "builtins.__import__ = spy\n"
        "import sumo_eval.cosim.simulation\n"
        "assert 'libsumo' in sys.modules\n"
        "assert seen and seen[0] == 'quiet', seen\n"
    )
    done = python(code)
    assert done.stdout == ""
    assert done.stderr == ""


# 7 ------------------------------------------------------------------------------------------------


def test_trap_7_we_record_centres_and_mathematical_headings_as_commanded():
    found = half_second(lambda *_: Command(0.0, 0.2))
    assert found.ego.x[0] == 50.0
    assert found.ego.heading[0] == 0.0
    assert found.ego.heading[-1] > 0.0  # to the left
    # the centre moves where the body points, up to the slip of a mid-wheelbase point, half *
    # curvature: 0.0063 rad
    course = math.atan2(found.ego.y[-1] - found.ego.y[-2], found.ego.x[-1] - found.ego.x[-2])
    assert course == pytest.approx((found.ego.heading[-1] + found.ego.heading[-2]) / 2, abs=0.01)


def test_trap_7_scripted_lateral_motion_is_smooth_in_what_sumo_shows():
    mover = Actor("mover", Start(80.0, 0.0, 20.0), (lane_change(0.5, 3.0, 3.5),))
    seen = []
    simulate(
        case(mover),
        lambda traci, *_: seen.append(traci.vehicle.getPosition("mover")),
        SimulationSettings(time_limit=5),
    )
    across = [(b[1] - a[1]) / STEP for a, b in itertools.pairwise(seen)]
    assert seen[-1][1] == pytest.approx(3.5)
    # the quintic's greatest lateral acceleration is 5.7735 * 3.5 / 3^2 = 2.245 m/s2; SUMO shows the
    # bumper, 2.25 m ahead of the centre, so the yaw acceleration adds: v'' / v * 2.25 =
    # (60*3.5/27)/20 * 2.25 = 0.875 m/s2 at most
    assert max([abs(b - a) / STEP for a, b in itertools.pairwise(across)]) < 2.245 + 0.875
    assert max(across) < 1.875 * 3.5 / 3.0 * 1.1


# 8 ------------------------------------------------------------------------------------------------


# 9 ------------------------------------------------------------------------------------------------


def test_trap_9_the_hand_written_network_needs_no_netconvert():
    with session(case(), SimulationSettings()) as traci:
        lanes = {lane for lane in traci.lane.getIDList() if not lane.startswith(":")}
        assert lanes == {"road_0", "road_1"}
        assert traci.lane.getLength("road_0") == 6000.0
        assert traci.lane.getShape("road_1") == ((0.0, 3.5), (6000.0, 3.5))
        assert traci.lane.getWidth("road_1") == 3.5
        assert traci.lane.getMaxSpeed("road_0") == 60.0


def test_trap_9_uneven_lengths_reach_sumo_unrounded():
    road = replace(ROAD, lane_width=3.333, length=600.125)
    concrete = replace(case(Actor("lead", Start(80.0, 3.333, 5.0))), road=road)
    # which checks the start to the millimetre
    with session(concrete, SimulationSettings()) as traci:
        assert traci.lane.getLength("road_0") == 6000.125


# 10 -----------------------------------------------------------------------------------------------


def test_trap_10_no_fcd_output_is_used(monkeypatch):
    lines = []
    start = libsumo.start
    monkeypatch.setattr(libsumo, "start", lambda line: (lines.append(line), start(line)))
    with session(case(), SimulationSettings()):
        pass
    options = dict(zip(lines[0][1::2], lines[0][2::2], strict=True))
    assert set(options) == {
        "--net-file", "--route-files", "--begin", "--step-length", "--lanechange.duration",
        "--error-log", "--seed",
        "--xml-validation", "--xml-validation.net", "--xml-validation.routes", "--no-step-log",
        "--no-warnings",
        "--duration-log.disable", "--thread-rngs", *(f"--{name}" for name in SIMULATION_OPTIONS),
    }  # fmt: skip
    assert not any("fcd" in option or "parquet" in option for option in lines[0])


# what outlives a simulation -----------------------------------------------------------------------


class MovesInItsLastStep:
    """Tells SUMO to move its vehicle when no step is to come that would: before it fails, or when
    it is closed."""

    def __init__(self, fails):
        self.fails = fails

    def step(self, traci, ego, time):
        self.vehicle = traci.vehicle
        if self.fails and time > 0.2:
            self.move()
            raise ValueError("out of order")
        return Command(0.0)

    def close(self):
        if not self.fails:
            self.move()

    def move(self):
        x, y = self.vehicle.getPosition("ego")
        self.vehicle.moveToXY("ego", "", -1, x + 1.0, y, 90.0, 2)


@pytest.mark.parametrize("fails, ends", [(True, "ads_error"), (False, "time_limit")])
def test_a_move_that_no_step_carries_out_does_not_reach_the_next_case(fails, ends):
    alone = half_second("no_reaction", lead(gap=50.0))
    assert half_second(MovesInItsLastStep(fails), lead(gap=50.0)).end_reason == ends
    after = half_second("no_reaction", lead(gap=50.0))
    assert after.error is None
    assert after.end_reason == alone.end_reason
    assert after.ego.x.tobytes() == alone.ego.x.tobytes()


# what makes a start quick -------------------------------------------------------------------------


def test_one_generator_a_lane_draws_what_sumos_own_64_draw(monkeypatch):
    def drives():
        for model in ("sumo:EIDM?sigmaerror=0.5", "sumo:Krauss?sigma=0.9"):
            yield half_second(model, lead(gap=20.0, speed=15.0)).ego.x.tobytes()

    few = list(drives())
    start = libsumo.start

    def as_ever(line):
        at = line.index("--thread-rngs")
        assert line[at + 1] == "2"
        start([*line[:at], *line[at + 2 :]])

    monkeypatch.setattr(libsumo, "start", as_ever)
    assert list(drives()) == few
    assert few[0] != few[1]


def test_files_on_disk_and_in_memory_are_the_same_case(monkeypatch):
    if not hasattr(os, "memfd_create"):
        pytest.skip("this system keeps no files in memory")
    in_memory = half_second("idm", lead(gap=20.0, speed=15.0))
    monkeypatch.delattr(os, "memfd_create")
    on_disk = half_second("idm", lead(gap=20.0, speed=15.0))
    assert on_disk.error is None
    assert in_memory.ego.x.tobytes() == on_disk.ego.x.tobytes()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the library has another name")
def test_the_library_that_reads_sumos_files_is_found():
    assert insides.keep_xml_parser()


def test_sumo_reads_numbers_the_same_in_any_locale():
    own = locale.setlocale(locale.LC_NUMERIC)
    try:
        for name in ("C.UTF-8", "de_DE.UTF-8"):
            with contextlib.suppress(locale.Error):
                locale.setlocale(locale.LC_NUMERIC, name)
        assert half_second("no_reaction", lead(gap=50.0)).error is None
        assert locale.setlocale(locale.LC_NUMERIC) == "C"
    finally:
        locale.setlocale(locale.LC_NUMERIC, own)
