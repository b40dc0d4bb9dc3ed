"""match_plate: the plate as it would have been at the moment of the image.

Between two pictures a tripod is touched, the light drifts, a camera sets its white balance anew. Of
geometry (as it is, shifted, any homography) and light (as it is, a gain per channel, and an offset, a
smooth field) the simplest is taken that the data do not clearly contradict.
"""

import logging
from dataclasses import dataclass, replace
from enum import Enum
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.background.alignment import (
    GEOMETRIES,
    LIGHTS,
    SAME_LIGHT,
    Fit,
    Level,
    descend,
    disagreement,
    first_step,
    gain_in_likelihood,
    levels,
)  # fmt: skip
from blurmatte.background.warp import ORDER, centered, homography, kept_variance, places, read_at
from blurmatte.checks import Bools, check_kind, check_same_size
from blurmatte.errors import PlateError
from blurmatte.radiometry import LinearImage, check_picture, check_same_colors
from blurmatte.statistics import robust_std

Array = npt.NDArray[np.float64]

_PRICE = (
    20.0  # log likelihood per number: neighboring residuals hang together in compressed pictures
)
_LEAST_SHIFT = 0.01  # pixels, and
_LEAST_GAIN = 0.001  # change of light, below which a plate is left as it is
_MOST_OFFSET = 0.1  # of the usual light, that flare may add
_DARKEST, _BRIGHTEST = 0.25, 4.0  # gains that a plate can bridge
_SMALLEST = 32  # pixels across: smaller pictures are left alone
_FEWEST = 100  # pixels to compare, below which nothing can be said
_FOREIGN = 0.5  # of the image's own changes of light, and
_DIFFERENT = 0.1  # of its usual light: pictures of one scene differ by less in most places
_OVERLAP = 0.5  # of the picture, that the plate must show
_WITHIN = 0.9733  # variance of a standard normal within three deviations
_AGREEMENT_PIXELS = 2.5e5  # enough to tell how well the pictures agree
_EDGES = 0.9  # quantile of the plate's gradients from which on they are edges


class Matching(Enum):
    """How a plate may be changed to match an image.

    NONE leaves it; EXPOSURE changes its light; SHIFT moves it too; FULL allows any homography and a
    smooth field of light. What is allowed beyond the least of each is done where the data ask for it.
    """

    NONE = "none"
    EXPOSURE = "exposure"
    SHIFT = "shift"
    FULL = "full"


_LEAST = {Matching.EXPOSURE: (0, 1), Matching.SHIFT: (1, 0), Matching.FULL: (2, 1)}
_MOST = {Matching.EXPOSURE: (0, 3), Matching.SHIFT: (1, 2), Matching.FULL: (2, 3)}


@dataclass(frozen=True, eq=False)
class Match:
    """Where a plate lies beside an image, and how bright it is.

    Parameters
    ----------
    size : (int, int)
        (width, height) of both, pixels.
    h : (8,) float
        How far the homography from image to plate is from doing nothing, in coordinates that are 0 in
        the center and ±1 at the ends of the longer side.
    light : (7, 3) float
        Per channel: gain, offset, and the factors of x, y, x², xy, y² in the gain, in these
        coordinates.
    h_std, light_std : as h and light
        Standard deviations; 0 of what was not fitted.

    Raises
    ------
    ValueError
        For arrays of another shape.
    """

    size: tuple[int, int]
    h: Array
    light: Array
    h_std: Array
    light_std: Array

    def __post_init__(self) -> None:
        for name, shape in (("h", (8,)), ("light", (7, 3))):
            for of in (name, f"{name}_std"):
                if np.shape(getattr(self, of)) != shape:
                    raise ValueError(
                        f"{of} must have the shape {shape}, got {np.shape(getattr(self, of))}"
                    )

    @classmethod
    def nothing(cls, size: tuple[int, int]) -> "Match":
        """Of a plate that stays as it is."""
        return cls(size, np.zeros(8), SAME_LIGHT, np.zeros(8), np.zeros((7, 3)))

    def __repr__(self) -> str:
        return f"Match({self.in_words})"

    @property
    def moves(self) -> bool:
        """Whether the plate is read at other places than its pixels."""
        return bool(self.h.any())

    @property
    def changes_light(self) -> bool:
        """Whether the plate's light is changed."""
        return bool((self.light != SAME_LIGHT).any())

    @property
    def homography(self) -> Array:
        """(3, 3) from pixels of the image to pixels of the plate, homogeneous."""
        to = centered(self.size)
        return np.asarray(np.linalg.inv(to) @ homography(self.h) @ to)

    @property
    def shift(self) -> tuple[float, float]:
        """(x, y) pixels: what is in the center of the image lies so much further in the plate."""
        middle = (np.array([self.size]) - 1) / 2
        ((x, y),) = places(self.h, middle, self.size)[0] - middle
        return float(x), float(y)

    @property
    def shift_std(self) -> tuple[float, float]:
        """Standard deviation of the shift, pixels."""
        half = max(self.size) / 2
        return float(self.h_std[2] * half), float(self.h_std[5] * half)

    @property
    def angle(self) -> float:
        """Radians by which the plate is turned against the image about the center, x towards y."""
        return float(np.arctan2(self.h[3] - self.h[1], 2 + self.h[0] + self.h[4]))

    @property
    def reach(self) -> float:
        """How far the plate is moved at most, at the corners of the picture; pixels."""
        width, height = self.size
        corners = np.array(list(product((0.0, width - 1.0), (0.0, height - 1.0))))
        return float(np.hypot(*(places(self.h, corners, self.size)[0] - corners).T).max())

    @property
    def gain(self) -> tuple[float, float, float]:
        """By how much the plate's light was multiplied in the center, per channel."""
        r, g, b = self.light[0]
        return float(r), float(g), float(b)

    def light_change(self, plate: LinearImage) -> float:
        """By which part the plate's usual light changes at most, of all channels and corners."""
        if not self.changes_light:
            return 0.0
        usual = _usual_light(plate)
        corners = np.abs(self.light[2:]).sum(axis=0)
        return float(np.max(np.abs(self.light[0] - 1) + np.abs(self.light[1]) / usual + corners))

    @property
    def in_words(self) -> str:
        """What was done, in a few words."""
        said = []
        if self.moves:
            x, y = self.shift
            said.append(f"shifted by {x:+.2f}, {y:+.2f} px")
            if self.h[[0, 1, 3, 4, 6, 7]].any():
                turned = f"turned by {np.degrees(self.angle):+.2f}°"
                said.append(f"{turned}, up to {self.reach:.2f} px at the corners")
        if self.changes_light:
            gain = ", ".join(f"{g:.3f}" for g in self.gain)
            said.append(f"light times {gain}")
            if np.abs(self.light[1]).max() >= 5e-5:  # what four places show
                said.append("plus " + ", ".join(f"{o:+.4f}" for o in self.light[1]))
            if self.light[2:].any():
                said.append("changing smoothly over the picture")
        return ", ".join(said) or "plate as it is"

    @property
    def facts(self) -> dict[str, Any]:
        """All of it as plain numbers and words, for a report."""
        return {
            "in_words": self.in_words,
            "shift": self.shift,
            "shift_std": self.shift_std,
            "angle": self.angle,
            "gain": self.gain,
            "gain_std": tuple(map(float, self.light_std[0])),
            "offset": tuple(map(float, self.light[1])),
        }

    def apply(self, plate: LinearImage) -> LinearImage:
        """The plate at the place and in the light of the image.

        Light between pixels is read by cubic splines. What the plate does not show is not `valid`.

        Parameters
        ----------
        plate : LinearImage
            Of this match's size.

        Returns
        -------
        LinearImage
            The very same plate if there is nothing to do.

        Raises
        ------
        ValueError
            If the plate has another size.
        """
        check_picture("plate", plate)
        check_same_size("plate", plate.size, "the match", self.size)
        if self.moves:
            plate = self._moved(plate)
        if not self.changes_light:
            return plate
        gain = self._gain(plate.rgb.dtype)
        noise = None if plate.noise is None else plate.variance * gain**2
        rgb = plate.rgb * gain + self.light[1].astype(plate.rgb.dtype)
        return replace(plate, rgb=rgb, noise=noise)

    def _moved(self, plate: LinearImage) -> LinearImage:
        width, height = self.size
        axes = np.arange(width, dtype=float), np.arange(height, dtype=float)
        xy = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        at = np.concatenate([places(self.h, part, self.size)[0] for part in np.array_split(xy, 64)])
        rgb = read_at(plate.rgb, at).reshape(plate.rgb.shape).astype(plate.rgb.dtype)
        noise = None
        if plate.noise is not None:
            kept = kept_variance(at[:: max(1, len(at) // 10_000)])
            noise = read_at(plate.variance, at, 1).reshape(rgb.shape).astype(rgb.dtype) * kept
        return replace(plate, rgb=rgb, noise=noise, valid=_seen(plate.valid, at))

    def _gain(self, dtype: np.dtype[np.floating]) -> npt.NDArray[np.floating]:
        """(H, W, 3) or (3,) what the light is multiplied by."""
        if not self.light[2:].any():
            return np.asarray(self.light[0], dtype=dtype)
        width, height = self.size
        to = centered(self.size)
        u = (np.arange(width) * to[0, 0] + to[0, 2])[None, :, None]
        v = (np.arange(height) * to[1, 1] + to[1, 2])[:, None, None]
        a, _, x, y, xx, xy, yy = self.light
        return np.asarray(a + x * u + y * v + xx * u * u + xy * u * v + yy * v * v, dtype=dtype)


def _usual_light(plate: LinearImage) -> Array:
    rows = slice(None, None, max(1, len(plate.rgb) // 100))
    usual = np.median(plate.rgb[rows].astype(float), axis=(0, 1))
    return np.asarray(np.maximum(usual, 1e-6))


def _seen(valid: Bools, at: Array) -> Bools:
    """(H, W) where the plate is known at points (n, 2) and as far as a cubic spline looks."""
    from scipy.ndimage import binary_dilation

    unknown = np.pad(~valid, ORDER, constant_values=True)[..., None].astype(float)
    lost = read_at(unknown, at + ORDER, 1)[:, 0]
    return np.asarray(~binary_dilation((lost > 1e-6).reshape(valid.shape)))


def match_plate(
    plate: LinearImage, image: LinearImage, matching: Matching | None = None
) -> LinearImage:
    """The plate as it would have been at the moment of the image.

    Parameters
    ----------
    plate, image : LinearImage
        The same size.
    matching : Matching, optional
        What may be changed; found from the data if not given.

    Returns
    -------
    LinearImage
        The very same plate if it matches already. `fit_match` tells what was done.

    Raises
    ------
    TypeError, ValueError
        If the sizes differ, or an argument is of another kind.
    PlateError
        If the plate shows another place or too different a light.
    """
    return fit_match(image, plate, matching).apply(plate)


def fit_match(image: LinearImage, plate: LinearImage, matching: Matching | None = None) -> Match:
    """How a plate must be moved and its light be changed to match an image.

    A joint robust fit of geometry and light to both pictures; the moving object does no harm as long as
    it covers less than about a third of the picture.

    Parameters
    ----------
    image, plate : LinearImage
        The same size.
    matching : Matching, optional
        What may be changed; found from the data if not given.

    Returns
    -------
    Match

    Raises
    ------
    ValueError
        If the sizes differ.
    PlateError
        If the plate shows another place or too different a light, or is of another camera.
    """
    check_same_colors("the image", image, "the plate", plate)
    check_same_size("image", image.size, "plate", plate.size)
    check_kind("matching", matching, Matching | None, "such as blurmatte.Matching.NONE")
    gray = image.meta.gray or plate.meta.gray  # `solve` refuses these, and says why
    if gray or matching is Matching.NONE or min(image.size) < _SMALLEST:
        return Match.nothing(image.size)
    logging.getLogger("blurmatte").info("matching the plate")
    pyramid = levels(image, plate)
    fine = next(pyramid)
    if len(fine.xy) < _FEWEST or (matching is None and not _worth(fine, plate)):
        return Match.nothing(image.size)
    best = _simplest(fine, list(pyramid), matching, _MOST_OFFSET * _usual_light(plate))
    match = _in_pixels(best, image.size)
    _refuse_the_foreign(match, best, fine, plate)
    small = match.reach <= _LEAST_SHIFT and match.light_change(plate) <= _LEAST_GAIN
    return Match.nothing(image.size) if matching is None and small else match


def _simplest(
    fine: Level, coarse: list[Level], matching: Matching | None, most_offset: Array
) -> Fit:
    """The simplest fit that nothing clearly better contradicts.

    Of a plain plate little but noise changes from pixel to pixel; a small gain and a large offset would
    take that away, and seem better for it.
    """
    least, most = _LEAST.get(matching, (0, 0)), _MOST.get(matching, (2, 3))  # type: ignore[arg-type]
    rough = _start()
    for level in reversed(coarse):
        rough = descend(level, rough, min(most[0], 1), 1)
        rough = descend(level, rough, most[0], 1)
    found: dict[tuple[int, int], Fit] = {}

    def fit(state: tuple[int, int]) -> Fit:
        if state not in found:
            start = rough if state[0] else _start()
            if state[0] == 1:
                start = replace(start, h=start.h * np.isin(np.arange(8), GEOMETRIES[1]))
            found[state] = descend(fine, replace(start, light=SAME_LIGHT), *state)
        return found[state]

    state = least
    while True:
        ways = [
            (state[0] + g, state[1] + b)
            for g, b in ((1, 0), (0, 1), (1, 1), (2, 0), (2, 1), (0, 2), (0, 3))
            if state[0] + g <= most[0] and state[1] + b <= most[1]
        ]
        gains = {
            way: gain_in_likelihood(fit(state), fit(way)) - _cost(way) + _cost(state)
            for way in ways
            if np.all(np.abs(fit(way).light[1]) <= most_offset)
        }
        if not gains or max(gains.values()) <= 0:
            return fit(state)
        state = max(gains, key=lambda way: gains[way])


def _start() -> Fit:
    return Fit(np.zeros(8), SAME_LIGHT, np.zeros((0, 3)), np.zeros((0, 0)))


def _cost(state: tuple[int, int]) -> float:
    return _PRICE * (len(GEOMETRIES[state[0]]) + 3 * LIGHTS[state[1]])


def _worth(level: Level, plate: LinearImage) -> bool:
    """Whether the first step from the plate as it is changes anything, and anything that matters."""
    h, light, likelier = first_step(level)
    step = replace(Match.nothing(level.size), h=h, light=SAME_LIGHT + light)
    matters = step.reach > _LEAST_SHIFT or step.light_change(plate) > _LEAST_GAIN
    return likelier > _PRICE * len(GEOMETRIES[1]) and matters


def _in_pixels(fit: Fit, size: tuple[int, int]) -> Match:
    geometry, light = fit.free
    h_std, light_std = np.zeros(8), np.zeros((7, 3))
    free, rows = list(GEOMETRIES[geometry]), LIGHTS[light]
    std = np.sqrt(np.diag(fit.covariance))
    h_std[free] = std[: len(free)]
    light_std[:rows] = std[len(free) :].reshape(3, rows).T
    return Match(size, fit.h, fit.light, h_std, light_std)


def _refuse_the_foreign(match: Match, fit: Fit, level: Level, plate: LinearImage) -> None:
    """Raise PlateError if the plate is none of this image."""
    left, own = disagreement(level, fit)
    if left > _FOREIGN * own and left > _DIFFERENT * float(_usual_light(plate).mean()):
        x, y = match.shift
        raise PlateError(
            "image and plate do not show the same scene from the same place: wherever the plate is "
            f"moved (at best by {x:+.0f}, {y:+.0f} pixels), they differ by {left:.2f} of white; take "
            "both from a tripod, one right after the other"
        )
    seen = float(np.mean(np.isfinite(fit.residuals)))
    if seen < _OVERLAP:
        x, y = match.shift
        raise PlateError(
            f"the camera moved: the plate lies {x:+.0f}, {y:+.0f} pixels beside the image and shows "
            f"only {seen:.0%} of it; take both from a tripod"
        )
    brighter = match.light[0] + match.light[1] / _usual_light(plate)
    if min(brighter) < _DARKEST or max(brighter) > _BRIGHTEST:
        said = ", ".join(f"{g:.2f}" for g in brighter)
        raise PlateError(
            f"the light changed too much: the image is {said} times as bright as the plate (R, G, B); "
            "expose both alike"
        )


def agreement(image: LinearImage, plate: LinearImage) -> tuple[float, float]:
    """The spread of image − plate in units of its noise: everywhere, and at the plate's edges.

    From medians, so that what moved does not count; 1 is perfect, and noise that hangs together less.

    Parameters
    ----------
    image, plate : LinearImage
        The same size, noise known.
    """
    rows = slice(None, None, max(1, round(image.valid.size / _AGREEMENT_PIXELS)))
    image, plate = (_rows_of(picture, rows) for picture in (image, plate))
    d = np.asarray(image.rgb - plate.rgb, float)
    variance = image.variance + plate.variance
    use = image.valid & plate.valid
    if not use.any():
        return float("nan"), float("nan")
    z = d / np.sqrt(np.maximum(variance, 1e-14))
    energy = sum(np.sum(np.gradient(plate.rgb, axis=axis) ** 2, axis=-1) for axis in (0, 1))
    edges = use & (energy >= np.quantile(energy[use], _EDGES))
    return _central_spread(z[use]), _central_spread(z[edges])


def _rows_of(picture: LinearImage, rows: slice) -> LinearImage:
    """Some rows of a picture, before anything is made of all."""
    noise = picture.noise
    noise = noise[rows] if isinstance(noise, np.ndarray) else noise
    return LinearImage(picture.rgb[rows], noise, picture.valid[rows], picture.meta)


def _central_spread(z: Array) -> float:
    """Standard deviation of what lies within three of it, as large as Gaussian noise would need."""
    limit = 3 * robust_std(z) + 1e-9
    within = np.abs(z) <= limit  # a median alone goes in steps where code values do
    return float(np.sqrt(np.mean(z[within] ** 2) / _WITHIN))
