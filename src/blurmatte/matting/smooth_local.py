"""Where a field is rougher than elsewhere: the prior's scale is not the same everywhere.

If Γ is right, DxᵀΓDx of the mean x is, summed over a neighborhood, about what its cells tell of x: the
sum of A times the variance [MacKay 1992]. Where it is more the square of the scale is larger by that
factor, and where it is less it is smaller. A precision of each place follows edges that are known well;
this follows those of which one place knows little, and what is flat between them.
"""

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats

Array = npt.NDArray[np.float64]

TELLING = 12.0  # free numbers in a neighborhood: of so many a variance is known to 40 %
_LEAST_TOLD = 1.0  # of a whole field
BEFORE = 1.0  # as if so many had been seen that are as everywhere


def rougher(x: Floats, root: Floats, order: int, told: Floats, mask: Bools) -> Floats:
    """By how many times squared differences around a cell are what they are in the mean.

    Parameters
    ----------
    x : (h, w) float
    root : (3 or 6, h, w) float
        L of Γ = LLᵀ.
    order : int
        Of the differences.
    told : (h, w) float
        Information times variance of each cell.
    mask : (h, w) bool
    """
    from blurmatte.matting.smooth_kernel import forward, weigh  # numba takes half a second

    t = np.zeros((3, *x.shape), x.dtype)
    forward(x, order, t)
    weighed = t.copy()
    weigh(root, order, weighed)
    squares, expected = np.sum(t * weighed, axis=0, dtype=float), np.asarray(told * mask, float)
    total = expected.sum()
    if not (total > 0 and squares.sum() > 0):
        return np.ones_like(x)
    near, usual = (around(m, told, mask) for m in (squares * total / squares.sum(), expected))
    mean = total / np.count_nonzero(mask)
    prior = BEFORE / TELLING * mean
    return np.asarray((prior + near) / (prior + usual), x.dtype)


def around(values: Floats, told: Floats, mask: Bools) -> Array:
    """Means of a neighborhood in which cells tell `TELLING` numbers in the mean, by a Gaussian."""
    from scipy.ndimage import gaussian_filter

    total = max(np.sum(told * mask, dtype=float), _LEAST_TOLD)
    area = TELLING * np.count_nonzero(mask) / total  # 4πs²
    inside = np.where(mask, values, 0).astype(float)
    return np.asarray(gaussian_filter(inside, np.sqrt(area / (4 * np.pi)), mode="constant"))
