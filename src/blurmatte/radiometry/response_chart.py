"""draw_response: a camera's curve, its error, and what is left of the pictures."""

from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry.chart import new_figure, pixels
from blurmatte.radiometry.response import ResponseFit
from blurmatte.radiometry.transfer import nearest_transfer

_SIZE, _DPI = (8.0, 8.0), 100
_ENLARGED = 10  # times the error, or nobody would see it


def draw_response(fit: ResponseFit) -> npt.NDArray[np.uint8]:
    """The curve beside the nearest named one, its error, and the residuals. Needs the `plot` extra.

    Parameters
    ----------
    fit : ResponseFit

    Returns
    -------
    (H, W, 3) uint8
        sRGB.

    Raises
    ------
    BlurmatteError
        If matplotlib is not installed.
    """
    figure = new_figure(_SIZE, _DPI)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    _draw_curve(above, fit)
    _draw_residuals(below, fit)
    return pixels(figure)


def _draw_curve(axes: Any, fit: ResponseFit) -> None:
    codes = np.arange(len(fit.std))
    light = fit.transfer.table(len(codes))
    nearest, off = nearest_transfer(fit.transfer)
    band = light - _ENLARGED * fit.std, light + _ENLARGED * fit.std
    axes.fill_between(codes, *band, alpha=0.25, label=f"{_ENLARGED} times its standard deviation")
    axes.plot(codes, light, label=fit.transfer.name)
    axes.plot(
        codes,
        nearest.table(len(codes)),
        ":",
        color="black",
        label=f"{nearest.name}, off by {off:.1%}",
    )
    for end in fit.seen:
        axes.axvline(255 * end, color="black", alpha=0.3, linewidth=0.8)
    axes.set(ylabel="light, 1 at code value 255", ylim=(-0.05, 1.1))
    axes.set_title(f"up to ± {np.max(fit.std):.2%} of full scale; seen between the gray lines")
    axes.grid(alpha=0.2)
    axes.legend(loc="upper left")


def _draw_residuals(axes: Any, fit: ResponseFit) -> None:
    count = fit.residuals.shape[1]
    codes = (np.arange(count) + 0.5) / count * 255
    for time, left in zip(fit.exposure_times, fit.residuals, strict=True):
        axes.plot(codes, 255 * left, ".-", label=f"{time:.3g} s")
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set(xlabel="code value of 255", ylabel="left over, code values")
    axes.grid(alpha=0.2)
    axes.legend(ncols=2, fontsize="small")
