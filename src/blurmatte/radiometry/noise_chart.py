"""The photon transfer curve: how the variance of noise grows with light."""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_kind
from blurmatte.radiometry.chart import new_figure, pixels
from blurmatte.radiometry.noise_fit import NoiseFit

_SIZE, _DPI = (8.0, 5.5), 110  # inches, pixels in each
_COLORS = ("#d62728", "#2ca02c", "#1f77b4")


def draw_noise(fit: NoiseFit) -> npt.NDArray[np.uint8]:
    """Draw measured variances, the curves that were fitted to them, and the part of rounding.

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
    """
    check_kind("fit", fit, NoiseFit, "use blurmatte.measure_noise(frames)")
    figure = new_figure(_SIZE, _DPI)
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
    for c, (name, color) in enumerate(zip(("red", "green", "blue"), _COLORS, strict=True)):
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
    return pixels(figure)
