"""Scale estimates that a minority of outliers does not change."""

import numpy as np

from blurmatte.checks import Floats

MAD_TO_STD = 1.4826  # 1 / Φ⁻¹(3/4): standard deviation of normal numbers over their median size


def robust_std(deviations: Floats) -> float:
    """Standard deviation of normal numbers about zero, from the median of their absolute values.

    There is at least one deviation. Up to half may be outliers, if these are on both sides.
    """
    return MAD_TO_STD * float(np.median(np.abs(deviations)))
