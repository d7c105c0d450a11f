"""Controllers with every accident that a process can have.

The table says what may become of the own row; every row beside it has to be what it is without it.
"""

import _thread
import contextlib
import ctypes
import faulthandler
import marshal
import mmap
import os
import random
import resource
import signal
import struct
import sys
import time
import zlib

import numpy

from sumo_eval import Command

ANY = {"ok", "collision", "off_road", "ads_error", "ads_timeout", "crashed", "sim_error"}
LOST = {"crashed", "ads_error"}

_ANY = """
    closes_descriptors patches_random patches_numpy leaves_a_listener leaks_descriptors closes_stdout sets_a_timer
    traces begins_a_thread changes_folder ends_its_group leaves_a_daemon leaves_a_flood leaves_by_faulthandler
    raises_from_a_signal
"""
_CRASHES = """
    dies_with_a_daemon fills_shared_memory lets_another_fill_memory sends_no_values sends_a_number
    sends_odd_rows sends_much
"""
ACCIDENTS = {
    **dict.fromkeys(_ANY.split(), ANY | {"timeout"}),
    **dict.fromkeys(("forks_in_a_step", "forks_often"), LOST),
    **{name: {"crashed"} for name in _CRASHES.split()},
    **dict.fromkeys(
        ("forks_and_leaves", "frees_what_is_not_its_own"), LOST | {"timeout", "ads_timeout"}
    ),
    "stops_itself": {"timeout"},
}
DAEMON = "3600.75"


def forks_in_a_step(traci, ego, now):
    if now == 0.0:
        os.fork()
    return Command(0.0)


def forks_often(traci, ego, now):
    if now < 0.2:
        os.fork()
    return Command(0.0)


def closes_descriptors(traci, ego, now):
    os.closerange(3, 1000)
    return Command(0.0)


def patches_random(traci, ego, now):
    random.uniform = lambda *_: 4.0
    random.seed = lambda *_: None
    return Command(0.0)


def patches_numpy(traci, ego, now):
    numpy.hypot = numpy.sqrt = lambda *_: 0.5
    numpy.seterr(all="raise")
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


def closes_stdout(traci, ego, now):
    for number in (1, 2):
        with contextlib.suppress(OSError):
            os.close(number)
    sys.stdout = sys.stderr = None
    return Command(0.0)


class ClosesStreams:
    def __init__(self):
        closes_stdout(None, None, 0.0)

    def act(self, seen):
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

    if now == 0.0:
        _thread.start_new_thread(lambda: (time.sleep(0.3), os._exit(9)), ())
    return Command(0.0)


def changes_folder(traci, ego, now):
    os.chdir("/")
    os.environ.clear()
    os.umask(0o777)
    return Command(0.0)


def ends_its_group(traci, ego, now):
    os.killpg(0, signal.SIGKILL)
    return Command(0.0)


def stops_itself(traci, ego, now):
    os.kill(os.getpid(), signal.SIGSTOP)
    return Command(0.0)


def _send(body, length=None):
    """Send a frame in the name of the child, with a right header, and wait for the end."""
    frame = sys._getframe()
    while not {"results", "number"} <= set(frame.f_locals):
        frame = frame.f_back
    pipe, number = frame.f_locals["results"], frame.f_locals["number"]
    header = struct.pack("<4sQQI", b"sevl", number, length or len(body), zlib.crc32(body))
    os.write(pipe, header + body)
    time.sleep(60.0)


def sends_no_values(traci, ego, now):
    _send(b"?")


def sends_a_number(traci, ego, now):
    _send(marshal.dumps(7))


def sends_odd_rows(traci, ego, now):
    recording = [{"map": [["ego", "text"]]}, None, "contact", [], [0.0] * 5, 1.0, "soon"]
    row = ["ok", recording, None, "", "", ""]
    _send(marshal.dumps([False, False, "", [None, [row]]]))


def sends_much(traci, ego, now):
    _send(b"", 1 << 30)


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


def leaves_by_faulthandler(traci, ego, now):
    faulthandler.dump_traceback_later(0.01, exit=True)
    time.sleep(0.1)
    return Command(0.0)


def forks_and_leaves(traci, ego, now):
    if os.fork():
        os._exit(0)
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


def hoards(seen, kept=[]):  # noqa: B006
    kept.append(bytearray(1 << 18))
    return 0.0


def limits_memory(traci, ego, now):
    resource.setrlimit(resource.RLIMIT_AS, (1 << 20, resource.RLIM_INFINITY))
    return Command(0.0)


def limits_files(traci, ego, now):
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
    return Command(0.0)
