"""Does a sweep explain the streak? What its residuals say."""

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State

Array = npt.NDArray[np.float64]

MAX_MISFIT = 2.0  # of a sweep that is believed; balls leave about 1, other shapes more than 2.5

_BLOCK = 4  # pixels: residuals of a wrong shape hang together over this and more
_MEDIAN = 0.693  # of the mean of the squares of two normal numbers
_DOUBTFUL = 13.8  # χ² of two that noise exceeds in one of a thousand pixels


def coherence(data: Data, state: State) -> tuple[float, float]:
    """How much residuals hang together within blocks: within the streak, and beside it.

    The square of a block's sum over the sum of its variances, with residuals limited as the fit
    limits them: 1 for noise of its own in each pixel, more for JPEG, and for a wrong shape. The
    median of the blocks, for a hole or a post in front is no fault of the shape.
    """
    limited = state.e[: 3 - state.frame.rank] * np.sqrt(state.weights(data))
    inside = state.swept.alpha > 0
    return _coherence(limited, inside & (data.weight > 0)), _coherence(
        limited, ~inside & (data.weight > 0)
    )


def doubtful_share(data: Data, state: State) -> float:
    """Share of the streak's pixels that the sweep does not explain."""
    inside = (state.swept.alpha > 0) & (data.weight > 0)
    return float(np.mean(state.chi2[inside] > _DOUBTFUL)) if inside.any() else 1.0


def _coherence(e: Array, use: npt.NDArray[np.bool_]) -> float:
    h, w = (side // _BLOCK * _BLOCK for side in use.shape)

    def sums(x: Array) -> Array:
        return np.asarray(x[:h, :w].reshape(h // _BLOCK, _BLOCK, w // _BLOCK, _BLOCK).sum((1, 3)))

    count = sums(use.astype(float))
    blocks = count > _BLOCK**2 / 2
    if not blocks.any():
        return 1.0
    squares = [sums(np.where(use, x, 0))[blocks] ** 2 / count[blocks] for x in e]
    return float(np.median(np.mean(squares, axis=0))) / _MEDIAN
