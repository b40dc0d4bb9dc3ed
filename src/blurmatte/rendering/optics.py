"""The point spread function of a lens: what it does to every linear map of a picture.

A point of light becomes a Gaussian, or a disc, or one after the other. Beyond the border the picture
is mirrored (half a pixel outside the last one), so that the sum over the picture stays, and the
operator is its own adjoint.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.rendering.coverage import cell_edges, disc_coverage

_GAUSSIAN_REACH = 5.0  # standard deviations; 6e-7 of a Gaussian lies beyond


def disc_kernel(radius: float) -> npt.NDArray[np.float64]:
    """(n, n) part of a disc of `radius` pixels that lies in each pixel; its sum is 1."""
    pixels = cell_edges(np.arange(-np.ceil(radius), np.ceil(radius) + 1))
    return np.asarray(disc_coverage(pixels, pixels, radius) / (np.pi * radius**2))


def through_psf(values: Floats, blur: float, defocus: float) -> Floats:
    """(H, W, ...) `values` convolved with a Gaussian and a disc in their first two axes.

    Parameters
    ----------
    values : (H, W) or (H, W, k) float
    blur : float
        Standard deviation of the Gaussian, pixels; 0 for none.
    defocus : float
        Radius of the disc, pixels; 0 for none.

    Returns
    -------
    float array
        Shape and dtype of `values`.
    """
    from scipy.ndimage import convolve, gaussian_filter

    result: npt.NDArray[Any] = values
    if blur > 0:
        result = gaussian_filter(
            result, blur, mode="reflect", truncate=_GAUSSIAN_REACH, axes=(0, 1)
        )
    if defocus > 0:
        disc = disc_kernel(defocus)
        result = convolve(result, disc.reshape(disc.shape + (1,) * (values.ndim - 2)))
    return np.asarray(result, dtype=values.dtype)
