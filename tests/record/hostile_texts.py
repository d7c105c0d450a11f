"""ADSs whose exceptions no table, file or terminal could show as they are.

Each raises in its second step.
"""

from sumo_eval import Command
from sumo_eval.errors import ControllerError


class Own(BaseException):
    pass


class SpeechlessError(Exception):
    def __str__(self):
        raise ValueError("no words")

    __repr__ = __str__


class SurrogateError(Exception):
    def __str__(self):
        return "lost \ud800 half"

    __repr__ = __str__


class OwnControllerError(ControllerError):
    def __init__(self, one, two):
        super().__init__("two arguments")


def raising(make):
    """An ADS that raises what it makes."""

    class Raises:
        def step(self, traci, ego, time):
            if time > 0.0:
                raise make()
            return Command(0.0)

    return Raises


def printed():
    print("printed \ud800 and \x1b[2J")
    return SurrogateError()


CONTROLS = "nul \x00 escape \x1b[31m turned \u202e <script>alert(1)</script>\nsecond line"
Long = raising(lambda: ValueError("x" * 40_000_000))
Speechless = raising(SpeechlessError)
Surrogate = raising(printed)
Controls = raising(lambda: ValueError(CONTROLS))
Formula = raising(lambda: OwnControllerError("=1+2", 2))
Leaves = raising(lambda: SystemExit("=HYPERLINK()"))
Interrupts = raising(KeyboardInterrupt)
OwnBase = raising(lambda: Own("not an Exception"))
