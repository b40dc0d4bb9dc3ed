"""Noise alone: what is left of frames of a still scene, or of an even region, without the scene.

In this file e is (H, W, 3) noise, light, whose variance is that of a pixel; v is its square, or a mean
of such squares. v is distributed about as σ² χ²_ν / ν, ν being `freedom`.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats, check_map, check_same_size
from blurmatte.errors import NoiseError
from blurmatte.radiometry.image import LinearImage, check_picture
from blurmatte.radiometry.noise import NoiseModel, rounding_noise
from blurmatte.radiometry.transfer import LINEAR

Array = npt.NDArray[np.float64]
Light = npt.NDArray[np.float32]
Rows = npt.NDArray[np.intp] | slice

_MOST_PIXELS = 1e6  # of larger pictures, every so many bands of rows are looked at
_BAND = 32  # rows: whole blocks, whatever their size
_LEAST = 256  # pixels: they tell a variance to a tenth
_LEVELS = 24  # of light at most: what depends on light does so smoothly
_EACH, _ENOUGH = 500, 60_000  # pixels to tell a drift at some level of light, and at all of them
_AROUND = 5  # pixels over which light is averaged to sort by it
_FLICKER = 0.2  # of the light: exposures that differ by more are not alike
_TILE = 32  # pixels over which the light of an even region is a parabola
_GRID = 4  # tiles a side in which a shift is looked for
_BY_CHANCE = 30  # over the number of pixels: the part of a change that a chance shift explains
_SHIFTED = 0.02  # of the variance: a shift of the camera that makes more of it spoils the answer


@dataclass(frozen=True, eq=False)
class Sample:
    """Noise of many pixels.

    Parameters
    ----------
    light : (H, W, 3) float
        The light that has the noise.
    v, e : (H, W, 3) float
        As above.
    use : (H, W, 3) bool
        Where they mean something.
    freedom : float
        Of v, degrees.
    frames : float
        How many were averaged for `light`; infinite where it has no noise of its own.
    repeated : bool
        Whether the same light was seen several times; else different light.
    step : (H, W, 3) float
        Light per code value of the file; 0 for floats.
    rounding : NoiseModel
        What these steps make.
    """

    light: Array
    v: Array
    e: Array
    use: Bools
    freedom: float
    frames: float
    repeated: bool
    step: Array
    rounding: NoiseModel


def noise_of_frames(frames: Iterable[LinearImage], still: Bools | None) -> Sample:
    """What differs from frame to frame; see `measure_noise`."""
    several = iter(frames)
    first = next(several, None)
    if first is None:
        raise ValueError("frames must be two or more pictures of a still scene, got none")
    check_picture("frame 1", first)
    rows = rows_to_measure(first)
    if still is not None:
        check_map("still", still, first.valid.shape, kinds="b")
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
    # Neighbors among the differences share a frame: E[d_t d_t+1] = -σ².
    freedom = 2 * pairs**2 / (3 * pairs - 1)
    step, rounding = _step(first, mean), rounding_noise(first)
    return Sample(mean, v, e, use, freedom, pairs + 1, True, step, rounding)


def _changes(
    first: LinearImage, several: Iterable[LinearImage], rows: Rows, use: Bools
) -> Iterator[tuple[Light, Light, tuple[float, float]]]:
    """Light of each frame, what changed since the one before, and by how far it is shifted.

    `use`, (h, w, 3), becomes what is unclipped in all frames.
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
    """What an even region has beyond a parabola in each tile; see `measure_noise_within`."""
    check_map("region", region, picture.valid.shape, kinds="b")
    rows, columns = (np.flatnonzero(region.any(axis=axis)) for axis in (1, 0))
    if len(rows) == 0:
        raise ValueError("region must hold some pixels, got none")
    place = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    use = _unclipped(picture, place) & region[place][..., None]
    require_pixels(use)
    light, e = np.asarray(picture.rgb[place], float), np.zeros(use.shape)
    use &= use.all(axis=-1, keepdims=True)
    for y in range(0, use.shape[0], _TILE):
        for x in range(0, use.shape[1], _TILE):
            tile = slice(y, y + _TILE), slice(x, x + _TILE)
            e[tile], use[tile] = _beyond_parabola(light[tile], use[tile])
    require_pixels(use)
    light = light - e
    return Sample(
        light, e**2, e, use, 1.0, np.inf, False, _step(picture, light), rounding_noise(picture)
    )


def require_pixels(use: Bools) -> None:
    """Raise unless there are enough pixels to measure noise in.

    Raises
    ------
    NoiseError
        If there are too few in one of the channels.
    """
    count = int(use.sum(axis=(0, 1)).min())
    if count < _LEAST:
        raise NoiseError(
            f"there are {count} pixels to measure noise in, {_LEAST} are the least: the rest is "
            "clipped, or was left out; expose so that nothing is black or white, or look at more"
        )


def parts_by_light(light: Floats, each: int) -> list[npt.NDArray[np.intp]]:
    """Indices of (N,) light, in up to 24 parts of like light, the darkest first."""
    count = int(np.clip(len(light) // each, 1, _LEVELS))
    return np.array_split(np.argsort(light, kind="stable"), count)


def rows_to_measure(picture: LinearImage) -> Rows:
    """Rows to look at: all, or of large pictures bands that are spread over them."""
    every = int(np.ceil(picture.valid.size / _MOST_PIXELS))
    row = np.arange(len(picture.valid))
    return slice(None) if every == 1 else np.flatnonzero(row // _BAND % every == 0)


def _light(picture: LinearImage, rows: Rows) -> Light:
    return np.asarray(picture.rgb[rows], np.float32)


def _unclipped(picture: LinearImage, place: Rows | tuple[slice, slice]) -> Bools:
    """(h, w, 3) where nothing is clipped: in a file also at black, from where noise goes only up."""
    valid: Bools = np.repeat(picture.valid[place][..., None], 3, axis=-1)
    if picture.meta.levels is not None:
        valid &= picture.rgb[place] > 0
    return valid


def _step(picture: LinearImage, light: Array) -> Array:
    if picture.meta.levels is None:
        return np.zeros_like(light)
    curve = picture.meta.transfer or LINEAR
    return np.asarray(curve.slope(np.maximum(light, 0)) / (picture.meta.levels - 1))


def _without_drift(change: Light, light: Light, use: Bools, number: int) -> Light:
    """Change less what all pixels have in common: lamps flicker, exposures vary.

    It is a straight line in light, found in spite of what moves, most of which has some light of its
    own. Pixels are sorted by the light around them: their own has its noise in common with the change.
    """
    from scipy.ndimage import uniform_filter
    from scipy.stats import siegelslopes

    around = uniform_filter(light, (_AROUND, _AROUND, 1))
    rest = change.copy()
    for c in range(3):
        some = np.flatnonzero(use[..., c])
        some = some[:: max(len(some) // _ENOUGH, 1)]
        x, d, sorted_by = (a[..., c].ravel()[some] for a in (light, change, around))
        parts = parts_by_light(sorted_by, _EACH)
        at, drift = (np.array([np.median(a[part]) for part in parts]) for a in (x, d))
        noise = 4 * float(np.median(np.abs(d[parts[-1]] - drift[-1])))
        if at[-1] > 0 and abs(drift[-1]) > max(_FLICKER * at[-1], noise):
            raise NoiseError(
                f"the brightness of frame {number} differs from the one before by "
                f"{drift[-1] / at[-1]:+.0%}; frames must be taken alike, with the same exposure"
            )
        slope, offset = siegelslopes(drift, at) if len(at) > 2 else (0.0, float(np.median(drift)))
        rest[..., c] -= np.float32(offset) + np.float32(slope) * light[..., c]
    return rest


def _shift(light: Light, change: Light, use: Bools) -> tuple[float, float]:
    """How far one frame is shifted against another, pixels, and its part of the change's variance.

    A shift s changes light by −s·∇. It is the median of those of tiles: things that move are in a
    few of them.
    """
    from scipy.ndimage import gaussian_filter

    g = np.stack(np.gradient(gaussian_filter(light.mean(axis=-1, dtype=float), 1.0)), axis=-1)
    d, inside = change.mean(axis=-1, dtype=float), np.asarray(use.all(axis=-1))
    if not inside.any():
        return 0.0, 0.0
    limit = 4 * 1.4826 * float(np.median(np.abs(d[inside])))
    d, g = np.where(inside, np.clip(d, -limit, limit), 0), np.where(inside[..., None], g, 0)
    tiles = [
        (np.einsum("hwi,hwj->ij", q, q), np.einsum("hwi,hw->i", q, p))
        for band, lit in zip(np.array_split(d, _GRID), np.array_split(g, _GRID), strict=True)
        for p, q in zip(np.array_split(band, _GRID, 1), np.array_split(lit, _GRID, 1), strict=True)
    ]
    told = sorted(((float(np.linalg.det(A)), A, b) for A, b in tiles), key=lambda tile: -tile[0])
    told = [tile for tile in told if tile[0] > 0]
    if not told:
        return 0.0, 0.0
    s = np.median([np.linalg.solve(A, b) for _, A, b in told[: len(told) // 2 + 1]], axis=0)
    explained = s @ np.sum([A for A, _ in tiles], axis=0) @ s / max(np.sum(d**2), 1e-30)
    return float(np.linalg.norm(s)), float(explained) - _BY_CHANCE / np.count_nonzero(inside)


def _require_still(shifted: list[tuple[float, float]]) -> None:
    if np.mean([share for _, share in shifted]) > _SHIFTED:
        farthest = max(s for s, _ in shifted)
        raise NoiseError(
            f"the camera moved: frames are shifted by up to {farthest:.2g} pixels against each other; "
            "put it on a tripod, or look where the scene is even"
        )


def _beyond_parabola(light: Array, use: Bools) -> tuple[Array, Bools]:
    """Residuals of a tile from the parabola that fits best, made as large as noise is."""
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
