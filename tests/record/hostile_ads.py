"""Controllers that attack the process that serves them, the one that collects, and the ADSs beside them.

The tables say what may become of the attacker's own row; every row beside it has to be what it is without it.
"""

import _thread
import contextlib
import ctypes
import faulthandler
import json
import math
import mmap
import os
import pathlib
import pickle
import random
import resource
import shutil
import signal
import struct
import sys
import tempfile
import time
import zlib

import numpy

import sumo_eval
from sumo_eval import Command

ANY = {"ok", "collision", "off_road", "ads_error", "ads_timeout", "crashed", "sim_error"}
LOST = {"crashed", "ads_error"}

_PROTOCOL = """
    writes_text writes_a_pickle claims_a_gigabyte half_a_frame answers_for_another_case
    answers_with_a_foreign_nonce answers_twice wrong_checksum no_json nested_deeply an_endless_number
    unknown_status nan_for_a_time a_text_for_a_number a_bomb_of_zeros half_a_trajectory other_vehicles
    halves_of_characters forks_in_a_step forks_often closes_descriptors
    closes_after_its_own_answer reads_files_that_cannot_be reads_after_what_it_never_told reads_no_pairs
    reads_an_endless_name
"""
PROTOCOL = dict.fromkeys(_PROTOCOL.split(), LOST)
PROTOCOL["closes_after_its_own_answer"] = ANY
PROTOCOL["a_bomb_of_zeros"] = LOST | {"ads_timeout"}  # on a busy machine it is not made in time
PROTOCOL["closes_descriptors"] = ANY  # a message that the supervisor cannot be told any more is the worst of it
PROTOCOL["reads_files_that_cannot_be"] = {"ok"}  # what it says of itself: such a case is driven again when gone on with
PROTOCOL["halves_of_characters"] = {"ok"}  # its own forged row, in characters that can be stored

_STATE = """
    changes_rounding patches_math patches_random patches_numpy patches_command patches_traci leaves_a_listener
    leaks_descriptors lowers_limits closes_stdout sets_a_timer traces begins_a_thread begins_a_thread_in_c
    poisons_modules changes_folder ends_its_supervisor ends_its_group stops_itself
"""
STATE = dict.fromkeys(_STATE.split(), ANY)
STATE["stops_itself"] = {"timeout"}

LEFTOVERS = {
    "leaves_a_daemon": ANY,
    "dies_with_a_daemon": {"crashed"},
    "leaves_a_flood": ANY,
    "leaves_a_daemon_without_a_supervisor": LOST,
    "fills_shared_memory": {"crashed"},
    "lets_another_fill_memory": {"crashed"},
}
DAEMON = "3600.75"

_OUTSIDE = """
    stops_its_supervisor stops_its_supervisor_and_ends_the_server
    stops_the_server ends_the_server removes_scratch removes_the_servers_socket
    writes_to_its_supervisor keeps_its_supervisors_pipes starves_its_supervisor a_hydra forks_in_c
    forks_under_another_name reads_orders_in_a_thread a_bomb_of_lists leaves_by_faulthandler stops_in_a_thread
    forks_and_leaves answers_in_a_copy closes_what_it_can_find raises_from_a_signal frees_what_is_not_its_own
"""
OUTSIDE = dict.fromkeys(_OUTSIDE.split(), ANY | {"timeout"})
for _name in ("a_bomb_of_lists", "forks_and_leaves", "closes_what_it_can_find", "frees_what_is_not_its_own"):
    OUTSIDE[_name] = LOST | {"timeout", "ads_timeout"}  # on a busy machine the attack itself is cut off


# --- the protocol -----------------------------------------------------------------------------------------------------


def serving():
    """The names of the function that serves this process; nothing is hidden from code in the process."""
    frame = sys._getframe()
    while frame.f_code.co_name != "_serve":
        frame = frame.f_back
    return frame.f_locals


def send(plain, blobs=(), *, text=None, rest=None, length=None, nonce=None, number=None, checksum=None, share=1.0):
    """A frame with its own nonce and number, but for what is given."""
    names = serving()
    ticket = names["ticket"]
    text = json.dumps([plain, [len(blob) for blob in blobs]]).encode() if text is None else text
    rest = b"".join(blobs) if rest is None else rest
    check = zlib.crc32(rest, zlib.crc32(text)) if checksum is None else checksum
    head = struct.pack(
        "<4s16sQIQI", b"sevl", nonce or ticket.nonce, number or ticket.number, len(text), length or len(rest), check
    )
    data = head + text + rest
    os.write(names["results"], data[: int(share * len(data))])


def drive(
    status="ok", error=None, log="", end="standstill", latency=(0.0,) * 5, time=0.1, names=("ego", "lead"), read=None
):
    row = [status, error, log, "", [end, None, [], list(latency), 0.1, time, list(names)]]
    return [False, False, [read, [row]]]


def trajectory(n=2, samples=2):
    body = numpy.arange(n, dtype="<f8").view(numpy.uint8).reshape(n, 8).T.tobytes() + bytes(28 * n)
    return struct.pack("<Idd", samples, 4.5, 1.8) + zlib.compress(body)


def wait():
    while True:
        sum(range(10**8))


def writes_text(traci, ego, now):
    os.write(serving()["results"], b"all is well\n" * 10)
    return Command(0.0)


class _Runs:
    def __reduce__(self):
        return os.system, ("touch /tmp/sumo_eval_a_pickle_ran",)


def writes_a_pickle(traci, ego, now):
    data = pickle.dumps(_Runs())
    os.write(serving()["results"], struct.pack("!i", len(data)) + data)
    return Command(0.0)


def claims_a_gigabyte(traci, ego, now):
    send([], length=1 << 30)
    return Command(0.0)


def half_a_frame(traci, ego, now):
    send(drive(), share=0.5)
    wait()


def answers_for_another_case(traci, ego, now):
    send(drive(), number=serving()["ticket"].number + 1)
    return Command(0.0)


def answers_with_a_foreign_nonce(traci, ego, now):
    send(drive(), nonce=bytes(range(16)))
    return Command(0.0)


def answers_twice(traci, ego, now):
    blobs = (trajectory(), trajectory())
    names = serving()
    begun, write = [], os.write
    os.write = lambda _, data: begun.append(data) or len(data)
    send(drive(time=1.0), blobs)
    os.write = write
    os.write(names["results"], begun[0] * 2)
    return Command(0.0)


def wrong_checksum(traci, ego, now):
    send(drive(), checksum=7)
    wait()


def no_json(traci, ego, now):
    send(None, text=b"\xff{[")
    wait()


def nested_deeply(traci, ego, now):
    send(None, text=b"[" * 100_000)
    wait()


def an_endless_number(traci, ego, now):
    send(None, text=b"[" + b"9" * 20_000 + b",[]]")
    wait()


def unknown_status(traci, ego, now):
    send(drive(status="excellent"), (trajectory(), trajectory()))
    wait()


def nan_for_a_time(traci, ego, now):
    send(drive(latency=(math.nan, *(0.0,) * 4), time=1.0), (trajectory(), trajectory()))
    wait()


def a_text_for_a_number(traci, ego, now):
    send(drive(time="1.0"), (trajectory(), trajectory()))
    wait()


def a_bomb_of_zeros(traci, ego, now):
    bomb = struct.pack("<Idd", 2, 4.5, 1.8) + zlib.compress(bytes(30 << 20), 1)
    send(drive(time=1.0), (bomb, trajectory()))
    wait()


def half_a_trajectory(traci, ego, now):
    send(drive(time=1.0), (trajectory()[:30], trajectory()))
    wait()


def other_vehicles(traci, ego, now):
    send(drive(time=1.0, names=("ego", "nobody")), (trajectory(), trajectory()))
    wait()


def halves_of_characters(traci, ego, now):
    send(drive(time=1.0, error="\ud800\x00", log="\udfff"), (trajectory(), trajectory()))
    wait()


def reads(*told):
    send(drive(time=1.0, read=list(told)), (trajectory(), trajectory()))
    wait()


def reads_files_that_cannot_be(traci, ego, now):
    reads("", [["\ud800\x00", "a"], ["/dev/zero", "b"], ["/proc/self/mem", "c"], ["../" * 500, "d"], ["", "\ud800"]])


def reads_after_what_it_never_told(traci, ego, now):
    reads("no such link", [["a", "b"]])


def reads_no_pairs(traci, ego, now):
    reads("", [["a", "b", "c"], 7])


def reads_an_endless_name(traci, ego, now):
    reads("", [["a" * 20_000, "b"]])


def forks_in_a_step(traci, ego, now):
    if now == 0.0:
        os.fork()
    return Command(0.0)


def forks_often(traci, ego, now):
    if now < 0.2:
        os.fork()
    return Command(0.0)


def closes_after_its_own_answer(traci, ego, now):
    send(drive(time=1.0), (trajectory(), trajectory()))
    os.close(serving()["results"])
    return Command(0.0)


def closes_descriptors(traci, ego, now):
    os.closerange(3, 1000)
    return Command(0.0)


# --- the state of the process -----------------------------------------------------------------------------------------


def changes_rounding(traci, ego, now):
    ctypes.CDLL("libm.so.6").fesetround(0x400)  # downwards
    return Command(0.0)


def patches_math(traci, ego, now):
    for name in ("sqrt", "hypot", "sin", "cos", "atan2", "exp"):
        setattr(math, name, lambda *_: 0.5)
    return Command(0.0)


def patches_random(traci, ego, now):
    random.uniform = lambda *_: 4.0
    random.seed = lambda *_: None
    return Command(0.0)


def patches_numpy(traci, ego, now):
    numpy.hypot = numpy.sqrt = lambda *_: 0.5
    numpy.seterr(all="raise")
    return Command(0.0)


def patches_command(traci, ego, now):
    sumo_eval.Command.__init__ = lambda self, *_: None
    sumo_eval.Command.acceleration = -9.0


def patches_traci(traci, ego, now):
    import libsumo

    libsumo.vehicle.getSpeed = lambda *_: 99.0
    libsumo.simulation.getTime = lambda *_: 99.0
    return Command(0.0)


def leaves_a_listener(traci, ego, now):
    import libsumo

    class Brakes(libsumo.StepListener):
        def step(self, t=0):
            for vehicle in libsumo.vehicle.getIDList():
                libsumo.vehicle.setSpeed(vehicle, 0.0)
            return True

    if now == 0.0:
        libsumo.addStepListener(Brakes())
    return Command(0.0)


def leaks_descriptors(traci, ego, now):
    if now == 0.0:
        while True:
            try:
                os.dup(0)
            except OSError:
                break
    return Command(0.0)


def lowers_limits(traci, ego, now):
    resource.setrlimit(resource.RLIMIT_NOFILE, (4, 4))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (1, 1))
    return Command(0.0)


def closes_stdout(traci, ego, now):
    for number in (1, 2):
        with contextlib.suppress(OSError):
            os.close(number)
    sys.stdout = sys.stderr = None
    return Command(0.0)


def sets_a_timer(traci, ego, now):
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, 0.3, 0.3)
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, 0.3, 0.3)
    return Command(0.0)


def traces(traci, ego, now):
    def tracer(frame, event, argument):
        raise RuntimeError("traced")

    sys.settrace(tracer)
    sys.setprofile(tracer)
    sys.setrecursionlimit(200)
    return Command(0.0)


def begins_a_thread(traci, ego, now):
    import _thread

    if now == 0.0:
        _thread.start_new_thread(lambda: (time.sleep(0.3), os._exit(9)), ())
    return Command(0.0)


def begins_a_thread_in_c(traci, ego, now):
    if now == 0.0:
        library = ctypes.CDLL(None)
        library.pthread_create(ctypes.byref(ctypes.c_ulong()), None, library.abort, None)
    return Command(0.0)


def poisons_modules(traci, ego, now):
    for name in list(sys.modules):
        if name.startswith(("sumo_eval.ads", "sumo_eval.cosim", "numpy.linalg")):
            sys.modules[name] = None
    return Command(0.0)


def changes_folder(traci, ego, now):
    os.chdir("/")
    os.environ.clear()
    os.umask(0o777)
    return Command(0.0)


def ends_its_supervisor(traci, ego, now):
    os.kill(os.getppid(), signal.SIGKILL)
    return Command(0.0)


def ends_its_group(traci, ego, now):
    os.killpg(0, signal.SIGKILL)
    return Command(0.0)


def stops_itself(traci, ego, now):
    os.kill(os.getpid(), signal.SIGSTOP)
    return Command(0.0)


# --- what is left behind ----------------------------------------------------------------------------------------------


def _daemon(*command):
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            os.execvp(command[0], command)
        os._exit(0)
    os.wait()


def leaves_a_daemon(traci, ego, now):
    if now == 0.0:
        _daemon("sleep", DAEMON)
    return Command(0.0)


def dies_with_a_daemon(traci, ego, now):
    _daemon("sleep", DAEMON)
    os._exit(5)


def leaves_a_daemon_without_a_supervisor(traci, ego, now):
    _daemon("sleep", DAEMON)
    os.kill(os.getppid(), signal.SIGKILL)
    return Command(0.0)


def leaves_a_flood(traci, ego, now):
    if now == 0.0:
        _daemon("sh", "-c", f"yes; : {DAEMON}")
    return Command(0.0)


_FILLS = """
import mmap, time
hoard = mmap.mmap(-1, 800 << 20)
for _ in range(800):
    hoard.write(bytes(1 << 20))
time.sleep(60)
"""


def _wait_whatever_comes():
    while True:
        with contextlib.suppress(BaseException):
            time.sleep(10.0)


def fills_shared_memory(traci, ego, now):
    hoard = mmap.mmap(-1, 800 << 20)
    ctypes.memset(ctypes.addressof(ctypes.c_char.from_buffer(hoard)), 1, len(hoard))
    _wait_whatever_comes()


def lets_another_fill_memory(traci, ego, now):
    _daemon(sys.executable, "-c", _FILLS)
    _wait_whatever_comes()


# --- what is outside: supervisor, the process that makes children, their files --------------------------------------


def _parent_of(pid):
    with open(f"/proc/{pid}/stat") as file:
        return int(file.read().rpartition(")")[2].split()[1])


def _server():
    return _parent_of(os.getppid())


def stops_its_supervisor(traci, ego, now):
    if now == 0.0:
        _daemon("sleep", DAEMON)
    os.kill(os.getppid(), signal.SIGSTOP)
    return Command(0.0)


def stops_its_supervisor_and_ends_the_server(traci, ego, now):
    if now == 0.0:
        stops_its_supervisor(traci, ego, now)
        ends_the_server(traci, ego, now)
    return Command(0.0)


def stops_the_server(traci, ego, now):
    os.kill(_server(), signal.SIGSTOP)
    return Command(0.0)


def ends_the_server(traci, ego, now):
    if now == 0.0:
        os.kill(_server(), signal.SIGKILL)
    return Command(0.0)


def removes_scratch(traci, ego, now):
    shutil.rmtree(pathlib.Path(tempfile.gettempdir()).parent, ignore_errors=True)
    return Command(0.0)


def removes_the_servers_socket(traci, ego, now):
    if now > 0.0:
        return Command(0.0)
    names = [os.readlink(f"/proc/{_server()}/fd/{name}") for name in os.listdir(f"/proc/{_server()}/fd")]
    inodes = {name[len("socket:[") : -1] for name in names if name.startswith("socket:[")}
    for line in pathlib.Path("/proc/net/unix").read_text().splitlines():
        fields = line.split()
        if len(fields) == 8 and fields[6] in inodes:
            pathlib.Path(fields[7]).unlink(missing_ok=True)
    return Command(0.0)


def _open_pipes(pid, mode):
    found = []
    for link in pathlib.Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            if os.readlink(link).startswith("pipe:"):
                found.append(os.open(link, mode | os.O_NONBLOCK))
    return found


def writes_to_its_supervisor(traci, ego, now):
    for pipe in _open_pipes(os.getppid(), os.O_WRONLY):
        with contextlib.suppress(OSError):
            os.write(pipe, struct.pack("<id", 0, 0.0))
        os.close(pipe)
    return Command(0.0)


def keeps_its_supervisors_pipes(traci, ego, now):
    if now == 0.0:
        for pipe in _open_pipes(os.getppid(), os.O_WRONLY):
            os.set_inheritable(pipe, True)
        _daemon("sleep", DAEMON)
    wait()


def starves_its_supervisor(traci, ego, now):
    for limit in (resource.RLIMIT_NOFILE, resource.RLIMIT_FSIZE, resource.RLIMIT_STACK):
        resource.prlimit(os.getppid(), limit, (0, 0))
    return Command(0.0)


_HEADS = f"""
import os, time
os.setsid()
until = time.monotonic() + 20.0
while time.monotonic() < until:  # {DAEMON}
    time.sleep(0.01)
    if os.fork():
        os._exit(0)
    os.setsid()
"""


def a_hydra(traci, ego, now):
    if now == 0.0:
        for _ in range(5):
            _daemon(sys.executable, "-c", _HEADS)
    return Command(0.0)


def forks_in_c(traci, ego, now):
    if now == 0.0:
        ctypes.PyDLL(None).fork()
    return Command(0.0)


def forks_under_another_name(traci, ego, now):
    if now == 0.0:
        me = os.getpid()
        os.getpid = lambda: me
        os.fork()
    return Command(0.0)


def reads_orders_in_a_thread(traci, ego, now):
    orders = serving()["orders"]
    if now > 0.0:
        return Command(0.0)
    _thread.start_new_thread(os.read, (orders, 1 << 20))
    return Command(0.0)


def a_bomb_of_lists(traci, ego, now):
    send(None, text=b"[" + b"[]," * 50_000_000 + b"[]]")
    wait()


def leaves_by_faulthandler(traci, ego, now):
    faulthandler.dump_traceback_later(0.01, exit=True)
    time.sleep(0.1)
    return Command(0.0)


def stops_in_a_thread(traci, ego, now):
    if now == 0.0:
        _thread.start_new_thread(lambda: (time.sleep(0.05), os.kill(os.getpid(), signal.SIGSTOP)), ())
    return Command(0.0)


def forks_and_leaves(traci, ego, now):
    if os.fork():
        os._exit(0)
    return Command(0.0)


def answers_in_a_copy(traci, ego, now):
    if now == 0.0 and os.fork() == 0:
        time.sleep(0.3)
        send(drive(time=1.0), (trajectory(), trajectory()))
        wait()
    return Command(0.0)


def closes_what_it_can_find(traci, ego, now):
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):
            os.close(int(name))
    return Command(0.0)


def raises_from_a_signal(traci, ego, now):
    def raises(*_):
        raise KeyboardInterrupt

    for number in (signal.SIGALRM, signal.SIGVTALRM, signal.SIGPROF, signal.SIGCHLD):
        signal.signal(number, raises)
    signal.setitimer(signal.ITIMER_VIRTUAL, 0.01, 0.01)
    return Command(0.0)


def frees_what_is_not_its_own(traci, ego, now):
    ctypes.memset(id(traci), 255, 64)
    ctypes.memset(id(Command), 255, 256)
    return Command(0.0)
