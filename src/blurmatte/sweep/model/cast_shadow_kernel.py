"""Fraction of the exposure in which a shadow was visible, compiled."""

import numpy as np

from blurmatte.compiling import njit


@njit()
def add_shadow(centers, offset, radius, profile, step, S):  # type: ignore[no-untyped-def]
    """Add to S (h, w) the mean darkness over all centers (T, 2) where the disc does not cover it.

    The shadow's center is at `offset` from the disc's; `profile` (n,) is its darkness every `step`
    pixels from its center. Pixels at the rim are covered in part.
    """
    h, w = S.shape
    reach = step * (len(profile) - 1)
    for i in range(len(centers)):
        x0, y0 = centers[i, 0] + offset[0], centers[i, 1] + offset[1]
        for y in range(max(int(np.ceil(y0 - reach)), 0), min(int(y0 + reach) + 1, h)):
            for x in range(max(int(np.ceil(x0 - reach)), 0), min(int(x0 + reach) + 1, w)):
                at = np.sqrt((x - x0) ** 2 + (y - y0) ** 2) / step
                before = int(at)
                if before >= len(profile) - 1:
                    continue
                dark = profile[before] + (at - before) * (profile[before + 1] - profile[before])
                out = np.sqrt((x - centers[i, 0]) ** 2 + (y - centers[i, 1]) ** 2) - radius
                S[y, x] += dark * min(max(out + 0.5, 0.0), 1.0) / len(centers)
