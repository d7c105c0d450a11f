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


class _Raises:
    def error(self):
        raise NotImplementedError

    def step(self, traci, ego, time):
        if time > 0.0:
            raise self.error()
        return Command(0.0)


class Long(_Raises):
    def error(self):
        return ValueError("x" * 40_000_000)


class Speechless(_Raises):
    def error(self):
        return SpeechlessError()


class Surrogate(_Raises):
    def error(self):
        print("printed \ud800 and \x1b[2J")
        return SurrogateError()


class Controls(_Raises):
    def error(self):
        return ValueError(
            "nul \x00 escape \x1b[31m turned \u202e <script>alert(1)</script>\nsecond line"
        )


class Formula(_Raises):
    def error(self):
        return OwnControllerError("=1+2", 2)


class Leaves(_Raises):
    def error(self):
        return SystemExit("=HYPERLINK()")


class Interrupts(_Raises):
    def error(self):
        return KeyboardInterrupt()


class OwnBase(_Raises):
    def error(self):
        return Own("not an Exception")
