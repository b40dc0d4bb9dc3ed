"""How accurate is alpha without a plate, by a guess, by inpainting, or by matting?

A ball before several grounds is solved with its plate, and with what stands for the plate in a box
around the streak: the guess of `background.guess_plate`, or pixels that OpenCV or scikit-image paint
from the surroundings. Matting by PyMatting gets no plate but a trimap of the truth.

Run: python -m benchmarks.accuracy.without_plate
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.typing as npt
from benchmarks.accuracy.other_methods import matting, trimap_of
from benchmarks.table import Cell, Table, publish_all
from benchmarks.trials import (
    CODE,
    ORANGE,
    PLATES,
    RADIUS,
    SCENE,
    SIZE,
    ball_path,
    median,
    photograph,
    rows_over_seeds,
)

from blurmatte.background import guess_plate
from blurmatte.errors import BlurmatteError
from blurmatte.layer import Layer
from blurmatte.matting import solve
from blurmatte.metrics import alpha_rmse
from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.rendering import Ball, Camera, Rendering, Scene, render
from blurmatte.rendering.plates import textured_plate
from blurmatte.rendering.processing import encode_codes

SEEDS = 4
MARGIN = 16  # pixels of the region around the streak
REACH = 5  # pixels that OpenCV paints from
CAMERA = Camera(code_std=CODE)
Region = npt.NDArray[np.bool_]
GRASS = np.array([0.35, 0.50, 0.20])
GROUNDS = {
    **PLATES,
    "one hue": lambda size, seed: textured_plate(size, seed).mean(axis=-1, keepdims=True) * GRASS,
}

NOTES = f"""
{SCENE} 8 bits, noise of one code value. The region is a box {MARGIN} pixels around the streak; what
stands for the plate is equal to the image outside it. one hue: texture of which only the brightness
varies, as of a lawn. its plate: the plate itself. field: `blurmatte.background.guess_plate`. Telea and
Navier-Stokes: OpenCV's `inpaint` with a radius of {REACH} pixels. biharmonic: scikit-image's
`inpaint_biharmonic`. The last three have no error, and are solved as a plate with the noise of the
image. trimap: PyMatting's closed form, which gets no plate but a trimap of the truth. RMSE of alpha
over the streak: median and worst of {SEEDS} pictures. error/claim: RMSE over the stated error of alpha,
median and worst. A refused picture has neither.
"""


@dataclass(frozen=True)
class Errors:
    """Root mean square error of alpha, and the stated one; NaN where there is none."""

    rmse: float = np.nan
    claimed: float = np.nan


def telea(image: LinearImage, region: Region) -> LinearImage:
    import cv2

    return _painted_by_opencv(image, region, cv2.INPAINT_TELEA)


def navier_stokes(image: LinearImage, region: Region) -> LinearImage:
    import cv2

    return _painted_by_opencv(image, region, cv2.INPAINT_NS)


def biharmonic(image: LinearImage, region: Region) -> LinearImage:
    from skimage.restoration import inpaint_biharmonic

    rgb = np.asarray(image.rgb, float)
    return _painted(image, region, inpaint_biharmonic(rgb, region, channel_axis=-1))


def _painted_by_opencv(image: LinearImage, region: Region, method: int) -> LinearImage:
    """Painted in the code values of 8 bits, which OpenCV takes."""
    import cv2

    codes = cv2.inpaint(encode_codes(image.rgb, 8), region.astype(np.uint8), REACH, method)
    return _painted(image, region, SRGB.decode(codes / 255))


def _painted(image: LinearImage, region: Region, rgb: npt.NDArray[np.float64]) -> LinearImage:
    """The image with other light in the region."""
    light = np.where(region[..., None], rgb, image.rgb).astype(image.rgb.dtype)
    return replace(image, rgb=light, valid=image.valid | region)


GUESSES: dict[str, Callable[[LinearImage, Region], LinearImage]] = {
    "field": guess_plate,
    "Telea": telea,
    "Navier-Stokes": navier_stokes,
    "biharmonic": biharmonic,
}
METHODS = ("its plate", *GUESSES, "trimap")


def around(alpha: npt.NDArray[np.float64]) -> Region:
    """The box around a streak."""
    rows, columns = (np.flatnonzero((alpha > 0).any(axis=axis)) for axis in (1, 0))
    region = np.zeros(alpha.shape, bool)
    y, x = (slice(max(n[0] - MARGIN, 0), n[-1] + 1 + MARGIN) for n in (rows, columns))
    region[y, x] = True
    return region


@cache
def rendering(ground: str, seed: int) -> Rendering:
    """The ball before a ground."""
    return render(Scene(GROUNDS[ground](SIZE, seed), ball_path(seed), Ball(RADIUS, ORANGE)))


def trial(ground: str, method: str, seed: int) -> Errors:
    truth = rendering(ground, seed)
    image, plate = photograph(truth, CAMERA, seed)
    alpha = np.asarray(truth.layer.alpha, float)
    if method == "trimap":
        return Errors(alpha_rmse(_matted(image, truth.layer).alpha, alpha))
    if method in GUESSES:
        plate = GUESSES[method](image, around(alpha))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            solution = solve(image, plate)
        except BlurmatteError:
            return Errors()
    streak = solution.streak | (alpha > 0)
    claimed = float(np.sqrt(np.mean(np.minimum(solution.alpha_std, 1)[streak] ** 2)))
    return Errors(alpha_rmse(solution.layer.alpha, alpha), claimed)


def _matted(image: LinearImage, truth: Layer) -> Layer:
    from pymatting import estimate_alpha_cf

    return matting(estimate_alpha_cf, image, trimap_of(truth))


def row(group: list[Errors]) -> list[Cell]:
    answered = [e for e in group if np.isfinite(e.rmse)]
    rmse = [e.rmse for e in answered]
    ratios = [e.rmse / e.claimed for e in answered if np.isfinite(e.claimed)]
    worst = (max(values, default=None) for values in (rmse, ratios))
    return [len(group) - len(answered), median(rmse), next(worst), median(ratios), next(worst)]


def tables(quick: bool = False) -> list[Table]:
    settings = [(ground, method) for ground in GROUNDS for method in METHODS]
    settings = settings[-len(METHODS) :] if quick else settings
    rows = rows_over_seeds(trial, settings, row, quick, SEEDS)
    columns = ("ground", "plate", "refused", "RMSE", "RMSE worst", "error/claim", "worst")
    question = "How accurate is alpha without a plate?"
    return [Table("without_plate", question, NOTES, columns, rows)]


if __name__ == "__main__":
    publish_all(tables)
