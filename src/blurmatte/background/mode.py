"""The light that a pixel shows most often."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os import cpu_count

import numpy as np
import numpy.typing as npt

from blurmatte.background.samples import Samples
from blurmatte.checks import Floats

_RIVAL_SHARE = 0.25  # of the samples that show the mode: fewer are no rival
_ROWS = 16
_CALM_PIXELS = 5  # a side of the square over which restlessness is averaged
_MOST_RESTLESS = 25.0  # five times the noise elsewhere: beyond it, something moves


@dataclass(frozen=True, eq=False)
class Modes:
    """What the samples of a clip show most often, pixel by pixel.

    Parameters
    ----------
    light, rival : (H, W, 3) float32
        The light most of them agree on, and the next; the rival is -1 where there is none.
    near : (H, W) int32
        How many of the samples agree.
    variance : (H, W, 3) float32
        Of one frame, light²: of its light, and of restless places such as edges in video.
    """

    light: Floats
    rival: Floats
    near: npt.NDArray[np.int32]
    variance: Floats


def find_modes(samples: Samples) -> Modes:
    """The mode of each pixel, as far as noise and gains let samples differ."""
    from scipy.ndimage import uniform_filter

    from blurmatte.background import kernel

    count, height, width, _ = samples.light.shape
    light, rival = np.empty((2, height, width, 3), np.float32)
    near, restless = np.empty((height, width), np.int32), np.empty((height, width), np.float32)
    noise = tuple(samples.noise.coefficients.astype(np.float32).ravel())
    gain = samples.gain.astype(np.float32)[:, None, None]

    def flat(row: int) -> Floats:
        return (samples.light[:, row : row + _ROWS] / gain).reshape(count, -1, 3)

    def calm(row: int) -> None:
        kernel.find_restlessness(flat(row), noise, restless[row : row + _ROWS].reshape(-1))

    def solve(row: int) -> None:
        rows = slice(row, row + _ROWS)
        kernel.find_modes(
            flat(row), noise, restless[rows].reshape(-1), np.float32(_RIVAL_SHARE),
            light[rows].reshape(-1, 3), rival[rows].reshape(-1, 3), near[rows].reshape(-1),
        )  # fmt: skip

    with ThreadPoolExecutor(cpu_count() or 1) as pool:
        list(pool.map(calm, range(0, height, _ROWS)))
        restless = np.clip(uniform_filter(restless, _CALM_PIXELS), 1, _MOST_RESTLESS)
        list(pool.map(solve, range(0, height, _ROWS)))
    return Modes(light, rival, near, samples.noise.variance(light) * restless[..., None])
