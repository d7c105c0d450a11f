"""Policies over arrays whose answers depend on which cases they are shown together; `test_blocks`
drives them."""

import os

import numpy as np

SIZE = 4  # cases in a block there


class OfTheMean:
    """Brakes, a little harder the faster all are: what a mean over the rows is, is in the bits of
    each."""

    batch = True

    def act(self, seen):
        return (
            -1.0 - 1e-9 * np.mean(seen.ego.speed, dtype=np.float32) - 0.1 * (seen.lead.gap < 30.0)
        )


class OfTheProcess(OfTheMean):
    """Does something else in every process."""

    def act(self, seen):
        return super().act(seen) - 1e-9 * os.getpid()


class Raises(OfTheMean):
    def act(self, seen):
        if seen.time > 0.35 and len(seen.number) == SIZE:
            raise ValueError("no path found")
        return super().act(seen)


class Exits(OfTheMean):
    def act(self, seen):
        if len(seen.number) > 1:
            os._exit(7)
        return np.zeros(1)


class ByCase:
    def act(self, seen):
        return 0.0


the_object = OfTheMean()
