"""Controllers that do what controllers under test do: the fault campaign and the tests of the pool
drive them."""

import contextlib
import ctypes
import os
import sys
import threading
import time

from sumo_eval import Command


def coast(traci, ego, now):
    return Command(0.0)


def raises(traci, ego, now):
    raise ValueError("no path found")


def gives_nan(traci, ego, now):
    return Command(float("nan"))


def wrong_type(traci, ego, now):
    return "brake"


def leaves(traci, ego, now):
    sys.exit(3)


def interrupts(traci, ego, now):
    raise KeyboardInterrupt


def vanishes(traci, ego, now):
    print("last words before vanishing")
    os._exit(7)


def segfaults(traci, ego, now):
    ctypes.string_at(0)


def hangs(traci, ego, now):
    while True:
        with contextlib.suppress(Exception):
            time.sleep(0.001)


def hangs_in_c(traci, ego, now):
    sum(range(10**18))  # one C loop that keeps the interpreter's lock and looks at no signal


def slow(traci, ego, now):
    time.sleep(0.3)


def fills_memory(traci, ego, now):
    hoard = []
    while True:
        hoard.append(bytes(64 << 20))


def chatters(traci, ego, now):
    print("x" * 100_000)
    os.write(1, b"y" * 100_000)
    os.write(2, b"z" * 100_000)
    return Command(0.0)


def leaves_threads(traci, ego, now):
    """A thread that takes the process down when the case is over."""
    if now == 0.0:
        threading.Thread(target=lambda: (time.sleep(1.0), os._exit(9)), daemon=True).start()
    return Command(0.0)


def leaves_a_process(traci, ego, now):
    if now == 0.0:
        import subprocess

        subprocess.Popen(["sleep", "3600.25"])
    return Command(0.0)


class NeedsArguments:
    def __init__(self, model):
        pass

    def step(self, traci, ego, now):
        pass


class InterruptsWhenMade:
    def __init__(self):
        raise KeyboardInterrupt

    def step(self, traci, ego, now):
        pass


class RaisesInClose:
    def step(self, traci, ego, now):
        return Command(0.0)

    def close(self):
        raise RuntimeError("late")


def random_driver(traci, ego, now):
    import random

    import numpy

    # a set of texts: its order hangs on PYTHONHASHSEED
    shift = list({"left", "right", "straight", "back"}).index("left")
    return Command(random.uniform(-0.5, 0.5) + numpy.random.uniform(-0.5, 0.5) + 0.01 * shift)  # noqa: NPY002


class PrintsPid:
    batch = False  # what it prints is its case's

    def __init__(self):
        print(os.getpid(), end="")

    def step(self, traci, ego, now):
        return Command(-5.0)


class PrintsPidBesideAThread(PrintsPid):
    def __init__(self):
        super().__init__()
        threading.Thread(target=time.sleep, args=(60.0,), daemon=True).start()
