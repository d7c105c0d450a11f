"""Named random streams: everything random in this package comes from one of these.

Users: `cosim/doors/observation.py`, `drivers/`, `nightly/repeats.py`, `record/`, `scenario/`,
`scoring/`, `extras/`.
"""

import hashlib

import numpy as np

from sumo_eval.errors import must_be


def random_stream(seed: int, *labels: str | int) -> np.random.Generator:
    """The random stream of that name: the same on every machine and in every process, in whatever
    order streams are made.

    seed: 0 or more. labels: what the stream is for, e.g. ("population", 3); different names,
        independent streams.
    """
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise must_be("`seed`", "a random stream", "a whole number of at least 0", seed)
    digest = hashlib.blake2b(repr(labels).encode(), digest_size=16).digest()
    return np.random.default_rng(np.random.SeedSequence([seed, int.from_bytes(digest, "little")]))
