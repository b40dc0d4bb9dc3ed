"""Where a static object in front of a moving one hides it.

There the plate is visible as if the object had not been there. In this file C is the image's light, B
the plate's, s² the noise variance of C − B, and o the typical light of the object. Where the object
is visible it changes a pixel by α (o − B); behind a static occluder it does not.
"""

import numpy as np
import scipy

from blurmatte.checks import Array, Bools, Floats
from blurmatte.streaks import dilated

# Settings of the search for occluded pixels; ratios are of squared change and noise variance.
_PATCH_PX = 3  # width of patches: single outliers are noise
_MIN_PATCH_RATIO = 3.0  # expected ratio from which the object is visible in a patch
_MIN_PIXEL_RATIO = 9.0  # the same of a single pixel; noise hides it in 1 of 400
_MAX_STILL_RATIO = 2.0  # measured ratio up to which only the plate is visible
_MIN_BRIGHTNESS = 0.3  # of the object, over its typical brightness
_MAX_BRIGHTNESS = 2.0  # of the object, over its typical brightness
_MIN_RELATIVE_ALPHA = 0.5  # of the largest; an occluder reaches the core of the sweep
_MAX_HIDDEN_FRACTION = 0.5  # of total alpha
_MIN_BORDER_SIGMA = 3.0  # of the mean rank of the plate's contrast at a border


def occluded(alpha: Array, light: Array, C: Array, B: Array, variance: Array, use: Bools) -> Bools:
    """(h, w) True where a sweep covers a pixel, but the plate is visible unchanged.

    Seeds are patches in which the object would be visible and the plate is; for wires narrower than a
    patch, three pixels of a patch that are clear each. Seeds grow into neighbors that look like the
    plate. Regions only at the rim of the sweep are ignored: the fitted shape may be slightly wrong.
    So are all if their borders are no edges of the plate, in which an occluder is visible.

    alpha (h, w): of the sweep.
    light (3,): of the object at alpha 1.
    C, B, variance (h, w, 3): light of image and plate, and the noise variance of their difference.
    use (h, w): pixels with valid data.
    """
    width = _PATCH_PX
    use = use & (alpha > 0)
    still = np.where(use, np.mean((C - B) ** 2 / variance, axis=-1), 1)
    # The brightness of the object at which it resembles the plate most, and is least visible.
    brightness = np.sum(light * B / variance, axis=-1) / np.maximum(
        np.sum(light**2 / variance, axis=-1), 1e-12
    )
    brightness = np.clip(brightness, _MIN_BRIGHTNESS, _MAX_BRIGHTNESS)[..., None]
    expected = np.mean((alpha[..., None] * (brightness * light - B)) ** 2 / variance, axis=-1)
    core = mean_of_neighbors(expected) > _MIN_PATCH_RATIO
    core &= mean_of_neighbors(still) < _MAX_STILL_RATIO
    single = use & (expected > _MIN_PIXEL_RATIO) & (still < _MAX_STILL_RATIO)
    several = (width - 0.5) / width**2
    core = use & (core | (single & (mean_of_neighbors(single.astype(float)) > several)))
    near = dilated(core, width // 2 + 1)
    found = core | (use & near & (still < np.minimum(expected, _MIN_PATCH_RATIO)))
    inner = alpha > _MIN_RELATIVE_ALPHA * alpha.max(initial=0)
    found = scipy.ndimage.binary_propagation(found & inner, mask=found)
    visible = _ends_at_edges(found, B, variance, use)
    fraction_ok = alpha[found & use].sum() < _MAX_HIDDEN_FRACTION * (alpha * use).sum()
    return np.asarray(found & fraction_ok & visible)


def _ends_at_edges(found: Bools, B: Array, variance: Array, use: Bools) -> bool:
    """Whether the border of a region is where the plate has edges.

    An occluder is visible in the plate; a gap in the object, or a silhouette that is too wide, ends
    anywhere. The plate's contrast has ranks 0…1 among the pixels of the sweep: uniform ones, and
    independent between patches, at a border that lies anywhere.
    """
    border = use & dilated(found, 1) & ~found
    if not border.any():
        return False
    slopes = (np.diff(B, axis=axis, append=B.take([-1], axis)) for axis in (0, 1))
    contrast = scipy.ndimage.maximum_filter(
        sum(np.mean(d**2 / variance, axis=-1) for d in slopes), _PATCH_PX
    )
    ordered, there = np.sort(contrast[use]), contrast[border]
    below, not_above = (np.searchsorted(ordered, there, side) for side in ("left", "right"))
    ranks = (below + not_above) / (2 * len(ordered))
    std = np.sqrt(_PATCH_PX / (12 * border.sum()))  # of a line of patches, with uniform ranks
    return bool(ranks.mean() > 0.5 + _MIN_BORDER_SIGMA * std)


def mean_of_neighbors(values: Floats) -> Array:
    """Mean over a patch around each pixel."""
    return np.asarray(scipy.ndimage.uniform_filter(values, _PATCH_PX))
