"""Samples of noise, from frames of a still scene or from an even region of one picture.

In this file e is (H, W, 3) noise, light, of the variance σ² of a pixel; v is its square, or a mean of
such squares. v is distributed about as σ² χ²_ν / ν, where ν is `freedom`.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from blurmatte.checks import (
    Array,
    Bools,
    Floats,
    Floats32,
    Indices,
    box_of,
    check_map,
    check_same_size,
    rows_columns,
)
from blurmatte.errors import NoiseError
from blurmatte.radiometry import LinearImage, NoiseModel, check_picture, rounding_noise
from blurmatte.statistics import robust_std

Rows = Indices | slice

AROUND_PX = 5  # width of the window whose mean light pixels are sorted by


# Which pixels are sampled, and limits on the change between frames.
_MAX_PIXELS = 1e6  # pixels sampled of a picture; of larger ones bands of rows are taken
_BAND_ROWS = 32  # rows of a band: a multiple of the blocks of compressed files
_MIN_PIXELS = 256  # pixels that determine a variance to a tenth
_MAX_LEVELS = 24  # levels of light: noise is a smooth function of it
# Pixels for the drift of brightness, in all and at one level of light
_DRIFT_PIXELS = 60_000
_DRIFT_PIXELS_PER_LEVEL = 500
_MAX_DRIFT = 0.2  # fraction of the light by which frames of equal exposure may differ
_TILE_PX = 32  # width of the tiles of an even region whose light is taken for a parabola
_SHIFT_TILES = 4  # tiles a side whose shifts are measured
# Fraction of a change explained by a shift by chance, times the number of pixels
_CHANCE_PIXELS = 30
# Fraction of the change's variance that a shift of the camera may explain
_MAX_SHIFT_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class Sample:
    """Noise and light of many pixels."""

    light: Array  # (H, W, 3) float: mean light
    # (H, W, 3) float: squared noise, light², and noise, light
    v: Array
    e: Array
    use: Bools  # (H, W, 3) bool: where noise is known
    freedom: float  # degrees of freedom of v
    frames: float  # number of frames averaged for `light`; infinite if it has no noise
    repeated: bool  # true if the same light was measured repeatedly
    step: Floats  # (H, W, 3) float: light per code value of the file; 0 for floats
    rounding: NoiseModel  # noise of rounding to these steps


def noise_of_frames(
    frames: Iterable[LinearImage], still: Bools | None, max_pixels: float = _MAX_PIXELS
) -> Sample:
    """Differences of successive frames, of some pixels of large ones; see `measure_noise`."""
    several = iter(frames)
    first = next(several, None)
    if first is None:
        raise ValueError("frames must be two or more pictures of a still scene, got none")
    check_picture("frame 1", first)
    rows = rows_to_measure(first, max_pixels)
    if still is not None:
        still = check_map("still", still, first.valid.shape, kinds="b")
    use = _unclipped(first, rows) & (True if still is None else still[rows][..., None])
    total = _light(first, rows).copy()
    squares, change, shifted = np.zeros_like(total), np.zeros_like(total), []
    for light, change, shift in _changes(first, several, rows, use):
        total += light
        squares += change**2
        shifted.append(shift)
    pairs = len(shifted)
    if pairs == 0:
        raise ValueError(
            "frames must be two or more pictures of a still scene, got one; of one picture, measure "
            "the noise of an even region"
        )
    _require_still(shifted)
    mean = np.asarray(total, float) / (pairs + 1)
    v, e = np.asarray(squares, float) / (2 * pairs), np.asarray(change, float) / np.sqrt(2)
    # Successive differences share a frame: E[d_t d_t+1] = -σ².
    freedom = 2 * pairs**2 / (3 * pairs - 1)
    step, rounding = first.meta.step(np.maximum(mean, 0)), rounding_noise(first)
    return Sample(mean, v, e, use, freedom, pairs + 1, True, step, rounding)


def _changes(
    first: LinearImage, several: Iterable[LinearImage], rows: Rows, use: Bools
) -> Iterator[tuple[Floats32, Floats32, tuple[float, float]]]:
    """Light of each frame, its change since the previous one, and its shift (see `_shift`).

    Pixels (h, w, 3) that are clipped in any frame are removed from `use`.
    """
    previous = _light(first, rows)
    for number, frame in enumerate(several, start=2):
        check_picture(f"frame {number}", frame)
        check_same_size("frame 1", first.size, f"frame {number}", frame.size)
        use &= _unclipped(frame, rows)
        require_pixels(use)
        light = _light(frame, rows)
        middle = np.asarray((light + previous) / 2, np.float32)
        change = _without_drift(light - previous, middle, use, number)
        yield light, change, _shift(middle, change, use)
        previous = light


def noise_within(picture: LinearImage, region: Bools) -> Sample:
    """Residuals of an even region from a parabola in each tile; see `measure_noise_within`."""
    region = check_map("region", region, picture.valid.shape, kinds="b")
    if not region.any():
        raise ValueError("region must hold some pixels, got none")
    box = box_of(region)
    picture, region = picture.crop(box), region[rows_columns(box)]
    place = rows_to_measure(picture)
    use = _unclipped(picture, place) & region[place][..., None]
    require_pixels(use)
    light, e = np.asarray(picture.rgb[place], float), np.zeros(use.shape)
    use &= use.all(axis=-1, keepdims=True)
    for y in range(0, use.shape[0], _TILE_PX):
        for x in range(0, use.shape[1], _TILE_PX):
            tile = tuple(slice(at, at + _TILE_PX) for at in (y, x))
            e[tile], use[tile] = _parabola_residuals(light[tile], use[tile])
    require_pixels(use)
    light = light - e
    step, rounding = picture.meta.step(np.maximum(light, 0)), rounding_noise(picture)
    return Sample(light, e**2, e, use, 1.0, np.inf, False, step, rounding)


def require_pixels(use: Bools) -> None:
    """Raise NoiseError unless each channel has enough pixels."""
    count = int(use.sum(axis=(0, 1)).min())
    if count < _MIN_PIXELS:
        raise NoiseError(
            f"{count} pixels are usable to measure noise, {_MIN_PIXELS} are needed: the "
            "others are clipped or changed; expose so that nothing is black or white, or select more"
        )


def parts_by_light(light: Floats, each: int) -> list[Indices]:
    """Indices of (N,) light in groups of similar light, at least `each` pixels, the darkest first."""
    count = int(np.clip(len(light) // each, 1, _MAX_LEVELS))
    return np.array_split(np.argsort(light, kind="stable"), count)


def rows_to_measure(picture: LinearImage, max_pixels: float = _MAX_PIXELS) -> Rows:
    """Rows to sample: all, or of pictures with more pixels bands spread over them."""
    every = int(np.ceil(picture.valid.size / max_pixels))
    row = np.arange(len(picture.valid))
    return slice(None) if every == 1 else np.flatnonzero(row // _BAND_ROWS % every == 0)


def _light(picture: LinearImage, rows: Rows) -> Floats32:
    return np.asarray(picture.rgb[rows], np.float32)


def _unclipped(picture: LinearImage, place: Rows) -> Bools:
    """(h, w, 3) where nothing is clipped, in files of code values also not at black."""
    valid: Bools = np.repeat(picture.valid[place][..., None], 3, axis=-1)
    if picture.meta.levels is not None:
        valid &= picture.rgb[place] > 0
    return valid


def _without_drift(change: Floats32, light: Floats32, use: Bools, number: int) -> Floats32:
    """The change minus a drift common to all pixels, as of flickering lamps or varying exposures.

    The drift is a robust straight line in light: moving objects are outliers at few levels of light.
    Pixels are grouped by the mean light around them, whose noise is nearly independent of the change.
    """
    around = scipy.ndimage.uniform_filter(light, (AROUND_PX, AROUND_PX, 1))
    rest = change.copy()
    for c in range(3):
        some = np.flatnonzero(use[..., c])
        some = some[:: max(len(some) // _DRIFT_PIXELS, 1)]
        x, d, sorted_by = (a[..., c].ravel()[some] for a in (light, change, around))
        parts = parts_by_light(sorted_by, _DRIFT_PIXELS_PER_LEVEL)
        at, drift = (np.array([np.median(a[part]) for part in parts]) for a in (x, d))
        noise = 4 * float(np.median(np.abs(d[parts[-1]] - drift[-1])))
        if at[-1] > 0 and abs(drift[-1]) > max(_MAX_DRIFT * at[-1], noise):
            raise NoiseError(
                f"the brightness of frame {number} differs from the one before by "
                f"{drift[-1] / at[-1]:+.0%}; frames must be taken alike, with the same exposure"
            )
        slope, offset = (
            scipy.stats.siegelslopes(drift, at) if len(at) > 2 else (0.0, float(np.median(drift)))
        )
        rest[..., c] -= np.float32(offset) + np.float32(slope) * light[..., c]
    return rest


def _shift(light: Floats32, change: Floats32, use: Bools) -> tuple[float, float]:
    """Shift of one frame against another, pixels, and its share of the change's variance.

    A shift s changes light by −s·∇. It is the median over tiles, of which moving objects occupy few.
    The share is corrected for the one expected by chance. It matters far below a pixel, where one
    linear step is enough; `background.camera_motion` finds larger shifts.
    """
    g = np.stack(
        np.gradient(scipy.ndimage.gaussian_filter(light.mean(axis=-1, dtype=float), 1.0)), axis=-1
    )
    d, inside = change.mean(axis=-1, dtype=float), np.asarray(use.all(axis=-1))
    if not inside.any():
        return 0.0, 0.0
    limit = 4 * robust_std(d[inside])
    count = _SHIFT_TILES
    d, g = np.where(inside, np.clip(d, -limit, limit), 0), np.where(inside[..., None], g, 0)
    tiles = [
        (np.einsum("hwi,hwj->ij", q, q), np.einsum("hwi,hw->i", q, p))
        for band, lit in zip(np.array_split(d, count), np.array_split(g, count), strict=True)
        for p, q in zip(np.array_split(band, count, 1), np.array_split(lit, count, 1), strict=True)
    ]
    textured = sorted(((float(np.linalg.det(A)), A, b) for A, b in tiles), key=lambda t: -t[0])
    textured = [tile for tile in textured if tile[0] > 0]
    if not textured:
        return 0.0, 0.0
    most = textured[: len(textured) // 2 + 1]
    s = np.median([np.linalg.solve(A, b) for _, A, b in most], axis=0)
    explained = s @ np.sum([A for A, _ in tiles], axis=0) @ s / max(np.sum(d**2), 1e-30)
    by_chance = _CHANCE_PIXELS / np.count_nonzero(inside)
    return float(np.linalg.norm(s)), float(explained) - by_chance


def _require_still(shifted: list[tuple[float, float]]) -> None:
    if np.mean([share for _, share in shifted]) > _MAX_SHIFT_SHARE:
        farthest = max(s for s, _ in shifted)
        raise NoiseError(
            f"the camera moved: frames are shifted by up to {farthest:.2g} pixels against each other; "
            "put it on a tripod, or select an even part of the scene"
        )


def _parabola_residuals(light: Array, use: Bools) -> tuple[Array, Bools]:
    """Residuals of a tile from a fitted parabola, scaled to the variance of the noise."""
    h, w = use.shape[:2]
    y, x = (np.linspace(-1, 1, n) if n > 1 else np.zeros(1) for n in (h, w))
    X, Y = np.meshgrid(x, y)
    basis = np.stack([X**0, X, Y, X * X, X * Y, Y * Y], axis=-1)
    inside = use[..., 0]
    count, terms = int(inside.sum()), basis.shape[-1]
    if count < 8 * terms:
        return np.zeros_like(light), np.zeros_like(use)
    fit, *_ = np.linalg.lstsq(basis[inside], light[inside], rcond=None)
    rest = np.where(use, light - basis @ fit, 0)
    return rest * np.sqrt(count / (count - terms)), use
