"""Transfer curves in words, and the accuracy of a measured one."""

import numpy as np

from blurmatte.calibration import ResponseFit
from blurmatte.radiometry import Transfer, nearest_transfer


def curve_in_words(curve: Transfer) -> list[str]:
    """Sentences."""
    nearest, off = nearest_transfer(curve)
    black, middle, white = curve.decode(np.array([0, 0.5, 1]))
    return [
        f"Nearest to {nearest.name}, which is off by up to {off:.1%} of full scale.",
        f"Light {black:.4g}, {middle:.4g} and {white:.4g} at code values 0, 1/2 and 1.",
    ]


def response_in_words(fit: ResponseFit) -> list[str]:
    """Sentences, the curve's own first."""
    low, high = fit.seen
    lines = [
        *curve_in_words(fit.transfer),
        f"The light is known to {np.max(fit.std):.1%} of full scale (one standard deviation), "
        f"{np.max(fit.std[: len(fit.std) // 2]):.1%} in the darker half of the code values.",
        f"{fit.agreement:.0%} of the places agree; noise {255 * fit.noise:.2g} of 255 code values.",
        f"Code values {255 * low:.0f} to {255 * high:.0f} of 255 were seen twice; beyond them the "
        "curve is continued as cameras do.",
        "Exposure times as the pictures have them: "
        + ", ".join(f"{time:.3g} s" for time in fit.exposure_times)
        + ".",
    ]
    if not fit.channels_agree:
        worst = max(fit.channel_difference)
        lines.append(
            f"Red, green and blue do not have one curve: alone, one differs by up to {worst:.1%}; "
            "the camera mixes colors after the curve, and light is known no better than that."
        )
    return lines
