"""Occlusion: where the plate is visible as if the object had not been there.

In this file C is the image's light, B the plate's, s² the noise variance of C − B, and o the typical
light of the object. Where the object is visible it changes a pixel by α (o − B); behind a static
occluder it does not.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Array, Bools
from blurmatte.streaks import dilated


@dataclass(frozen=True)
class OcclusionSettings:
    """Settings of the search for occluded pixels; ratios are of squared change and noise variance."""

    patch_px: int = 3  #: width of patches: single outliers are noise
    min_patch_ratio: float = 3.0  #: expected ratio from which the object is visible in a patch
    min_pixel_ratio: float = 9.0  #: the same of a single pixel; noise hides it in 1 of 400
    max_still_ratio: float = 2.0  #: measured ratio up to which only the plate is visible
    min_brightness: float = 0.3  #: of the object, over its typical brightness
    max_brightness: float = 2.0  #: of the object, over its typical brightness
    min_relative_alpha: float = 0.5  #: of the largest; an occluder reaches the core of the sweep
    max_hidden_fraction: float = 0.5  #: of total alpha
    min_border_sigma: float = 3.0  #: of the mean rank of the plate's contrast at a border


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
    from scipy.ndimage import binary_propagation

    S, width = OcclusionSettings, OcclusionSettings.patch_px
    use = use & (alpha > 0)
    still = np.where(use, np.mean((C - B) ** 2 / variance, axis=-1), 1)
    # The brightness of the object at which it resembles the plate most, and is least visible.
    brightness = np.sum(light * B / variance, axis=-1) / np.maximum(
        np.sum(light**2 / variance, axis=-1), 1e-12
    )
    brightness = np.clip(brightness, S.min_brightness, S.max_brightness)[..., None]
    expected = np.mean((alpha[..., None] * (brightness * light - B)) ** 2 / variance, axis=-1)
    core = mean_of_neighbors(expected) > S.min_patch_ratio
    core &= mean_of_neighbors(still) < S.max_still_ratio
    single = use & (expected > S.min_pixel_ratio) & (still < S.max_still_ratio)
    several = (width - 0.5) / width**2
    core = use & (core | (single & (mean_of_neighbors(single.astype(float)) > several)))
    near = dilated(core, width // 2 + 1)
    found = core | (use & near & (still < np.minimum(expected, S.min_patch_ratio)))
    inner = alpha > S.min_relative_alpha * alpha.max(initial=0)
    found = binary_propagation(found & inner, mask=found)
    visible = _ends_at_edges(found, B, variance, use)
    fraction_ok = alpha[found & use].sum() < S.max_hidden_fraction * (alpha * use).sum()
    return np.asarray(found & fraction_ok & visible)


def _ends_at_edges(found: Bools, B: Array, variance: Array, use: Bools) -> bool:
    """Whether the border of a region is where the plate has edges.

    An occluder is visible in the plate; a gap in the object, or a silhouette that is too wide, ends
    anywhere. The plate's contrast has ranks 0…1 among the pixels of the sweep: uniform ones, and
    independent between patches, at a border that lies anywhere.
    """
    from scipy.ndimage import maximum_filter
    from scipy.stats import rankdata

    S = OcclusionSettings
    border = use & dilated(found, 1) & ~found
    if not border.any():
        return False
    slopes = (np.diff(B, axis=axis, append=B.take([-1], axis)) for axis in (0, 1))
    contrast = maximum_filter(sum(np.mean(d**2 / variance, axis=-1) for d in slopes), S.patch_px)
    ranks = (rankdata(contrast[use]) - 0.5) / use.sum()
    std = np.sqrt(S.patch_px / (12 * border.sum()))  # of a line of patches, with uniform ranks
    return bool(ranks[border[use]].mean() > 0.5 + S.min_border_sigma * std)


def mean_of_neighbors(values: npt.NDArray[np.floating]) -> Array:
    """Mean over a patch around each pixel."""
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(values, OcclusionSettings.patch_px))
