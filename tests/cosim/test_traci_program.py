"""`traci:`: a program of its own as a TraCI client of a real sumo process."""

import sys

import pytest
from refusals import refusal
from road_scenes import (
    HALF_SECOND,
    assert_ended,
    at_values,
    case,
    clips_of,
    half_second,
    lead,
    need_sumo,
)
from tables import in_campaign

from sumo_eval.cosim import simulate
from sumo_eval.cosim.doors import traci_program
from sumo_eval.cosim.doors.controller import load_controller
from sumo_eval.cosim.sumo import session
from sumo_eval.errors import InputError
from sumo_eval.settings import SimulationSettings

need_sumo()

DRIVE = """
def drive(traci, ego):
    speed = traci.vehicle.getSpeed(ego)
    leader = traci.vehicle.getLeader(ego, 200.0)
    if leader and leader[0] and leader[1] < 3.0 * (speed - traci.vehicle.getSpeed(leader[0])):
        traci.vehicle.setSpeed(ego, max(speed - 0.2, 0.0))

def step(traci, ego, time):
    drive(traci, ego)
"""
CLIENT = """
import os, traci
from the_drive import drive
traci.init(int(os.environ["SUMO_EVAL_PORT"]))
traci.setOrder(2)
try:
    while True:
        traci.simulationStep()
        drive(traci, "ego")
except traci.FatalTraCIError:
    pass
"""


BEHIND = case(lead(60.0, speed=10.0))
AT_THE_LANES_END = at_values(
    "lane_drop", ego_speed=24.0, other_speed=24.0, offset=-15.0, other_acceleration=0.0
)


def run(folder, text, settings=HALF_SECOND, step_timeout=10.0, concrete=BEHIND):
    (folder / "client.py").write_text(text)
    locator = f"traci:{sys.executable} client.py"
    return simulate(concrete, locator, settings, folder=folder, step_timeout=step_timeout)


@pytest.mark.parametrize(
    "concrete, limit, end",
    [(BEHIND, 9.0, ("time_limit", True)), (AT_THE_LANES_END, 60.0, ("off_road", False))],
)
def test_a_client_and_the_same_script_in_process_make_the_same_recording(
    tmp_path, own_path, concrete, limit, end
):
    (tmp_path / "the_drive.py").write_text(DRIVE)
    settings = SimulationSettings(time_limit=limit)
    there = run(tmp_path, CLIENT, settings, concrete=concrete)
    here = simulate(concrete, "the_drive.py:step", settings, folder=tmp_path)
    assert there.error is None
    assert there.end_reason == here.end_reason
    assert there.clips == here.clips
    assert (here.end_reason, here.ego.speed[-1] < 15.0) == end  # below 15 m/s it did brake
    (name,) = here.actors
    for one, two in ((there.ego, here.ego), (there.actors[name], here.actors[name])):
        for channel in ("time", "x", "y", "heading", "speed", "acceleration"):
            assert getattr(one, channel).tolist() == getattr(two, channel).tolist()
    assert there.controller_latency[0] > 0.0


TWICE = "traci.start([], label='a')\ntraci.start([], label='b')\n"
STATE = "traci.start([])\ntraci.simulationStep()\ntraci.simulation.loadState('a.xml')\n"
CLOSED = "traci.start([])\ntraci.simulationStep()\ntraci.close()\nprint('left')\ntime.sleep(60)\n"
NO_SPEED = (
    "traci.start([])\ntraci.simulationStep()\n"
    "try:\n    traci.vehicle.setSpeed('ego', float('nan'))\n"
    "except Exception:\n    time.sleep(60)\n"
)


@pytest.mark.parametrize(
    "text, how, said",
    [
        ("print('on stdout')\nsys.exit('no map')\n", "with status 1", "on stdout\nno map"),
        (TWICE, "with status 1", "a case takes one connection, got a second one"),
        (STATE, "with status 1", "do not call load, loadState or close to begin again"),
        (CLOSED, "closing its connection", "left"),
        (NO_SPEED, "with status 1", "setSpeed must be given finite numbers, got (nan,)"),
    ],
)
def test_a_client_that_breaks_ends_its_case_and_what_it_said_is_kept(tmp_path, text, how, said):
    found = run(tmp_path, f"import sys, time, traci\n{text}")
    assert found.error == f"The ADS's program ended before its case did, {how}."
    assert found.end_reason == "ads_error"
    for line in said.splitlines():
        assert line in found.log


def test_an_entry_names_the_type_of_the_vehicle_that_a_client_drives(tmp_path):
    """SUMO's IDM with a headway of its own, which the client sees; anything else is refused before
    the first case."""
    sees = CLIENT.replace("from the_drive import drive", "import sys").replace(
        'drive(traci, "ego")', "sys.exit(f\"tau {traci.vehicle.getTau('ego')}\")"
    )
    (tmp_path / "client.py").write_text(sees)
    locator = f"traci:{sys.executable} client.py?options.vehicle_type="
    named = locator + '{"carFollowModel": "IDM", "tau": 2.5}'
    assert "tau 2.5" in half_second(named, folder=tmp_path, step_timeout=10.0).log
    for wrong, sentence in (
        ('{"length": 2}', "Unknown vType parameter `length`"),
        ('{"carFollowModel": "IDMX"}', r"Did you mean `IDMM?`\?"),
        ('{"carFollowModel.ccac": 1}', r"set it with traci\.vehicle\.setParameter"),
        ("3&options.speed=2", "Unknown option `speed` of an ADS of `traci:`"),
    ):
        with refusal(sentence):
            load_controller(locator + wrong, tmp_path)


def test_a_client_that_hangs_is_ended(tmp_path):
    hangs = CLIENT.replace("from the_drive import drive", "import time").replace(
        'drive(traci, "ego")', "time.sleep(60)"
    )
    found = run(tmp_path, hangs, step_timeout=0.5)
    assert_ended(found, "ads_timeout", "each within 0.5 s; it was ended.")


@pytest.mark.parametrize(
    "step_timeout, reason, words",
    [(10.0, "time_limit", None), (0.2, "ads_timeout", "each within 0.2 s; it was ended.")],
)
def test_a_client_may_start_as_long_as_a_step_lasts(
    tmp_path, monkeypatch, step_timeout, reason, words
):
    connect = traci_program._connect

    def connected(*arguments):
        connection = connect(*arguments)  # SUMO has its usual time
        monkeypatch.setattr(traci_program, "START_TIMEOUT", 0.2)
        return connection

    monkeypatch.setattr(traci_program, "_connect", connected)
    slow = CLIENT.replace("from the_drive import drive", "import time; time.sleep(1)").replace(
        'drive(traci, "ego")', "pass"
    )
    assert_ended(run(tmp_path, slow, step_timeout=step_timeout), reason, words)


def test_a_client_that_moves_another_vehicle_is_noticed(tmp_path):
    (tmp_path / "the_drive.py").write_text(
        "def drive(traci, ego):\n    traci.vehicle.setSpeed('lead', 0.0)\n"
    )
    assert "actor_off_its_script" in clips_of(run(tmp_path, CLIENT))


def test_without_sumo_the_sentence_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "sumo", None)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(
        InputError, match=r"needs the extra `gui`, which this installs: .* -m pip install .*\[gui\]"
    ):
        simulate(case(), "traci:python client.py")


@pytest.mark.parametrize(
    "setter",
    [
        "setTau",
        "setMinGap",
        *(in_campaign(it) for it in ("setMaxSpeed", "setAccel", "setDecel", "setSpeedFactor")),
    ],
)
def test_a_client_that_sets_a_wrong_number_is_noticed(tmp_path, setter):
    (tmp_path / "the_drive.py").write_text(
        "def drive(traci, ego):\n    if traci.simulation.getTime() > 0.2:\n"
        f"        traci.vehicle.{setter}(ego, float('nan'))\n"
    )
    found = run(tmp_path, CLIENT)
    assert found.end_reason == "ads_error"
    name = setter[3].lower() + setter[4:]
    assert found.error.startswith(f"The ADS's program gave `ego` the {name} nan, seen at 0.2")
    assert found.error.endswith(" s; it must be a finite number.")


def test_a_client_may_name_the_vehicle_of_a_call(tmp_path):
    drive = "def drive(traci, ego):\n    traci.vehicle.setSpeed(vehID=ego, speed=19.5)\n"
    (tmp_path / "the_drive.py").write_text(drive)
    found = run(tmp_path, CLIENT)
    assert_ended(found)
    assert found.ego.speed[-1] == 19.5


def test_a_client_that_ends_subscriptions_is_still_checked(tmp_path):
    (tmp_path / "the_drive.py").write_text(
        "def drive(traci, ego):\n    traci.vehicle.unsubscribe(ego)\n"
        "    if traci.simulation.getTime() > 0.2:\n"
        "        traci.vehicle.setTau(ego, float('nan'))\n"
    )
    found = run(tmp_path, CLIENT)
    assert_ended(found, "ads_error", "gave `ego` the tau nan, seen at 0.2")


@pytest.mark.parametrize("call", ["setSpeed('ego', v)", "slowDown('ego', v, 1.0)"])
@pytest.mark.parametrize("value, fails", [("nan", True), ("inf", True), ("12.5", False)])
def test_a_client_in_another_language_is_checked_too(tmp_path, call, value, fails):
    """As one in another language: `-I` keeps the stand-in out. SUMO takes it for full speed."""
    (tmp_path / "client.py").write_text(
        CLIENT.replace("from the_drive import drive\n", f"v = float('{value}')\n").replace(
            'drive(traci, "ego")', f"traci.vehicle.{call}"
        )
    )
    locator = f"traci:{sys.executable} -I client.py"
    found = simulate(BEHIND, locator, HALF_SECOND, folder=tmp_path, step_timeout=10.0)
    words = (
        "The ADS's program gave `ego` nan or infinity, seen at 0.05 s; it must be a finite number."
    )
    assert found.error == (words if fails else None)


@pytest.mark.parametrize("vehicle", ["ego", "lead"])
def test_a_client_that_makes_a_vehicles_place_no_number_gives_up(tmp_path, vehicle):
    """It could end every case that gets dangerous in this way, unscored."""
    (tmp_path / "the_drive.py").write_text(
        "def drive(traci, ego):\n    if traci.simulation.getTime() > 0.2:\n"
        f"        traci.vehicle.setLateralLanePosition('{vehicle}', float('nan'))\n"
    )
    found = run(tmp_path, CLIENT)
    assert_ended(
        found, "ads_error", f"program is responsible: SUMO gave vehicle `{vehicle}` the place (nan"
    )


@pytest.mark.parametrize(
    "deed, words",
    [
        ("remove('lead')", "SUMO did not insert vehicle `lead` at the start"),
        ("remove('ego')", "SUMO did not insert vehicle `ego` at the start"),
        ("moveToXY('lead', 'road', 0, 90.0, 0.0)", "SUMO placed vehicle `lead` at (8"),
    ],
)
def test_a_client_that_spoils_the_start_gives_up(tmp_path, deed, words):
    """Its first turn comes before the vehicles are inserted; it must void no case unscored."""
    found = run(
        tmp_path,
        CLIENT.replace("try:", f"traci.vehicle.{deed}\ntry:", 1)
        .replace("from the_drive import drive\n", "")
        .replace('drive(traci, "ego")', "pass"),
    )
    assert_ended(found, "ads_error", f"The ADS's program is responsible: {words}")


@pytest.mark.parametrize("call", ["setSpeed('ego', 5.0)", "slowDown('ego', 5.0, 1.0)"])
def test_a_client_sets_its_speed_before_the_first_step(tmp_path, call):
    """As in SUMO alone: many scripts set a speed once, and then only ask for steps."""
    found = run(
        tmp_path,
        f"import traci\ntraci.start([])\ntraci.vehicle.{call}\nwhile True:\n"
        "    traci.simulationStep()\n",
    )
    assert found.ego.speed[0] == 20.0
    assert found.ego.speed[-1] < 17.0


@pytest.mark.parametrize("text", ["network", "routes"])
def test_files_that_sumo_refuses_are_no_fault_of_a_client(tmp_path, monkeypatch, text):
    """SUMO reads them only after the client has connected."""
    make = getattr(session, f"{text}_xml")
    monkeypatch.setattr(
        session, f"{text}_xml", lambda *it: make(*it).replace('"road"', '"nowhere"', 1)
    )
    found = run(tmp_path, "import traci\ntraci.start([])\ntraci.simulationStep()\n")
    assert_ended(found, "sim_error", "within the route 'along' is not known")


def test_a_clients_own_subscriptions_are_its_own_to_make_and_to_end(tmp_path):
    (tmp_path / "the_drive.py").write_text(
        "import traci.constants as tc\n"
        "def drive(traci, ego):\n"
        "    before = traci.vehicle.getSubscriptionResults(ego)\n"
        "    traci.vehicle.subscribe(ego, (tc.VAR_ROAD_ID, tc.VAR_SPEED))\n"
        "    shown = traci.vehicle.getSubscriptionResults(ego)\n"
        "    assert (shown[tc.VAR_ROAD_ID], shown[tc.VAR_SPEED]) == ('road', "
        "traci.vehicle.getSpeed(ego))\n"
        "    if traci.simulation.getTime() > 0.2:\n"
        "        traci.vehicle.unsubscribe(ego)\n"
    )
    assert_ended(run(tmp_path, CLIENT))


OPENINGS = (
    "import traci\ntraci.start(['sumo', '-c', 'none.sumocfg', '--remote-port', '1'])",
    "import traci\ntraci.start(['sumo-gui', '-n', 'x.net.xml'], label='own')",
    "import traci\ntraci.start(['sumo'], 8813, 60, 'own')\ntraci.switch('own')",
    "import sys, sumolib\nsys.path.insert(0, sumolib.__path__[0] + '/..')\nimport traci\n"
    "traci.init(8813)\ntraci.gui.setZoom('View #0', 500.0)",
    "import traci\ntraci.init(8813)",
    "import traci\nfrom traci import init\ninit(port=8813)\ntraci.setOrder(1)",
    "import libsumo as traci\ntraci.start(['sumo', '-c', 'none.sumocfg'])",
    "import traci\ntraci = traci.connect(8813)",
)


@pytest.mark.parametrize(
    "opening",
    [
        *OPENINGS[:3],
        *(in_campaign(opening) for opening in OPENINGS[3:]),
    ],
)
def test_a_script_of_a_simulation_of_its_own_drives_as_it_is(tmp_path, own_path, opening):
    """Whatever opens its connection, it drives as the same rule in process; when the case is over
    it need not care."""
    (tmp_path / "the_drive.py").write_text(DRIVE)
    text = (
        f"from the_drive import drive\n{opening}\nwhile True:\n    traci.simulationStep()\n    "
        "drive(traci, 'ego')\n"
    )
    settings = SimulationSettings(time_limit=3.0)
    there = run(tmp_path, text, settings)
    here = simulate(case(lead(60.0, speed=10.0)), "the_drive.py:step", settings, folder=tmp_path)
    assert there.error is None
    assert there.end_reason == here.end_reason
    assert there.ego.speed.tolist() == here.ego.speed.tolist()
    assert "Traceback" not in there.log
    assert len(there.log.splitlines()) <= 2


def test_a_program_that_forgets_its_order_gets_a_message(tmp_path):
    """A client that speaks TraCI by itself, from Python without our `traci`."""
    text = """
import os, socket, struct, time
s = socket.create_connection(("127.0.0.1", int(os.environ["SUMO_EVAL_PORT"])))
while True:
    s.sendall(struct.pack("!IBBd", 14, 10, 0x02, 0.0))
    if not s.recv(4096):
        time.sleep(5)
"""
    found = run(tmp_path, text)
    assert_ended(found, "ads_error", "must set its order to 2 after it has connected")


def test_the_programs_python_is_the_environments(tmp_path, monkeypatch):
    monkeypatch.delenv("VIRTUAL_ENV", raising=False)
    monkeypatch.setenv("PATH", "/usr/bin:/bin")
    (tmp_path / "client.py").write_text("import sys, traci\nprint('by', sys.prefix)\n")
    found = half_second("traci:python client.py", folder=tmp_path, step_timeout=10.0)
    assert f"by {sys.prefix}" in found.log
