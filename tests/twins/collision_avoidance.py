"""The weight r of Eq. 16 as a person would find it: walk from the most dangerous point in tiny
steps until out."""

import numpy as np


def walked_weight(point, star, inside, farthest=2.0):
    """|point - star| / |b - star| in the unit box; `inside` says which rows (n, k) are in the zone and in the space."""
    step = 2e-4
    distance = float(np.linalg.norm(point - star))
    heading = (point - star) / distance
    lengths = np.arange(1, int(farthest / step) + 1) * step
    stays = inside(star + lengths[:, None] * heading)
    out = int(np.argmin(stays))
    if stays[out]:
        raise ValueError("the walk never leaves")
    low, high = lengths[out] - step, lengths[out]
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (
            (middle, high) if inside((star + middle * heading)[None, :])[0] else (low, middle)
        )
    return distance / low
