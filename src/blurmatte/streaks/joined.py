"""Streaks that belong together: one object goes on behind something in front of it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from blurmatte.checks import Bools
from blurmatte.streaks.masks import widened
from blurmatte.streaks.streak import RIM, Streak


def joined_behind(streaks: Sequence[Streak], occluder: Bools) -> list[Streak]:
    """The streaks; the first with those, and the part between, in which it goes on behind an occluder.

    Parameters
    ----------
    streaks : sequence of Streak
        The strongest first, one or more.
    occluder : (H, W) bool
        Where something still is in front.
    """
    from scipy.ndimage import binary_dilation, distance_transform_edt

    if not occluder.any():
        return list(streaks)
    across = int(2 * distance_transform_edt(np.pad(occluder, 1)).max())

    def behind(mask: Bools) -> Bools:
        grown = widened(mask, RIM)
        return np.asarray(
            occluder & binary_dilation(grown, iterations=across, mask=occluder | grown)
        )

    whole, rest = streaks[0], list(streaks[1:])
    for other in list(rest):
        between = behind(whole.mask) & behind(other.mask)
        if between.any():
            mask = whole.mask | other.mask | between
            whole = replace(whole, mask=mask, evidence=whole.evidence + other.evidence)
            rest.remove(other)
    return [whole, *rest]
