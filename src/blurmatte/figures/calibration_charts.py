"""Charts of calibrations: the photon transfer curve and the response curve."""

from typing import Any

import numpy as np

from blurmatte.calibration import NoiseFit, ResponseFit
from blurmatte.checks import Codes8, check_kind
from blurmatte.figures.drawing import figure_pixels, new_figure
from blurmatte.radiometry import nearest_transfer


def draw_noise(fit: NoiseFit) -> Codes8:
    """Draw the photon transfer curve: measured noise, the fitted model, and the part of rounding.

    Needs matplotlib (`pip install "blurmatte[plot]"`).

    Parameters
    ----------
    fit : NoiseFit

    Returns
    -------
    (H, W, 3) uint8
        sRGB.

    Raises
    ------
    BlurmatteError
        If matplotlib is not installed.

    Examples
    --------
    >>> sheet = bm.figures.draw_noise(bm.calibration.measure_noise_against(image, plate))
    """
    check_kind("fit", fit, NoiseFit, "use blurmatte.calibration.measure_noise(frames)")
    figure = new_figure((8.0, 5.5), dpi=110)
    axes = figure.add_subplot(
        xscale="log", yscale="log", xlabel="light, 1 is white", ylabel="standard deviation of light"
    )
    least = min(float(x[x > 0].min(initial=1.0)) for x in fit.light)
    most = max(float(x.max()) for x in fit.light)
    light = np.geomspace(max(least, 1e-5) / 1.5, most * 1.5, 200)
    model, rounding = (
        np.sqrt(noise.variance(np.repeat(light[:, None], 3, axis=1)))
        for noise in (fit.noise, fit.rounding)
    )
    colors = {"red": "#d62728", "green": "#2ca02c", "blue": "#1f77b4"}
    for c, (name, color) in enumerate(colors.items()):
        std = np.sqrt(fit.variance[c])
        std_std = fit.variance_std[c] / (2 * std + 1e-30)
        axes.errorbar(fit.light[c], std, std_std, fmt=".", color=color)
        read, gain, _ = fit.sensor.coefficients[c]
        label = f"{name}: gain {gain:.3g} ± {fit.gain_std[c]:.1g}, "
        label += f"read noise {read**0.5:.3g} ± {fit.read_std_std[c]:.1g}"
        axes.plot(light, model[:, c], color=color, label=label)
    if rounding.any():
        axes.plot(light, rounding[:, 0], ":", color="black", label="rounding alone")
    axes.grid(which="both", alpha=0.2)
    axes.legend()
    return figure_pixels(figure)


def draw_response(fit: ResponseFit) -> Codes8:
    """Draw a response curve with the nearest named one, its error, and residuals.

    Needs matplotlib (`pip install "blurmatte[plot]"`).

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

    Examples
    --------
    >>> light = np.linspace(0.02, 0.98, 64)[None, :, None] * np.ones((48, 1, 3))
    >>> half, full = (bm.LinearImage(bm.SRGB.encode(light * exposure)) for exposure in (0.5, 1))
    >>> fit = bm.calibration.fit_response([half, full], [1 / 120, 1 / 60])
    >>> sheet = bm.figures.draw_response(fit)
    """
    figure = new_figure((8.0, 8.0), dpi=100)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    _draw_curve(above, fit)
    _draw_residuals(below, fit)
    return figure_pixels(figure)


def _draw_curve(axes: Any, fit: ResponseFit) -> None:
    codes = np.arange(len(fit.std))
    light = fit.transfer.table(len(codes))
    nearest, off = nearest_transfer(fit.transfer)
    enlarged = 10 * fit.std
    band = light - enlarged, light + enlarged
    axes.fill_between(codes, *band, alpha=0.25, label="10 times its standard deviation")
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
    for time, residual in zip(fit.exposure_times, fit.residuals, strict=True):
        axes.plot(codes, 255 * residual, ".-", label=f"{time:.3g} s")
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set(xlabel="code value of 255", ylabel="residual, code values")
    axes.grid(alpha=0.2)
    axes.legend(ncols=2, fontsize="small")
