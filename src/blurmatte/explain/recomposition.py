"""Whether an assumed layer is usable over its own plate.

There alpha and light have the same error: more alpha with a color nearer to the plate's gives the same
picture. So a layer whose alpha is off by a factor gives back the image, and what it leaves of the image
is its measure.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from blurmatte.checks import Floats
from blurmatte.matting.maps import Grade
from blurmatte.matting.solution import Solution
from blurmatte.radiometry import LinearImage, NoiseModel

_MAX_RESIDUAL_STD = 3.0  # root mean square over the streak, in standard deviations of the noise


def usable_all_the_same(image: LinearImage, plate: LinearImage, solution: Solution) -> list[str]:
    """That an assumed layer gives back the image over its plate; one line, or none if it does not.

    image, plate: what was solved, of the size of the solution.
    """
    if "grade" not in solution.stats or solution.grade is not Grade.ASSUMED:
        return []
    if solution.stats.get("may_be_shadow", False) or not _gives_back(image, plate, solution):
        return []
    return [
        "over the same plate the layer gives back the picture, so that edits there and `remove` are "
        "usable all the same; over another background alpha may be off by that factor"
    ]


def _gives_back(image: LinearImage, plate: LinearImage, solution: Solution) -> bool:
    """Whether layer over plate differs from the image by little more than noise."""
    inside = solution.streak & image.valid & plate.valid
    if not inside.any():
        return False
    image, plate, layer = image.in_srgb(), plate.in_srgb(), solution.layer
    C, B = image.rgb[inside], plate.rgb[inside]
    given = layer.premultiplied[inside] + (1 - layer.alpha[inside])[:, None] * B
    square = float(np.mean((given - C) ** 2, dtype=float))
    stats = solution.stats
    noise = _variance(stats.get("image_noise"), C) + _variance(stats.get("plate_noise"), B)
    return square <= _MAX_RESIDUAL_STD**2 * noise


def _variance(noise: Mapping[str, Any] | None, light: Floats) -> float:
    """Mean variance of the noise of `Solution.stats` at some light (n, 3)."""
    if noise is None:
        return 0.0
    if "median_std" in noise:
        return float(noise["median_std"]) ** 2
    return float(NoiseModel(**noise).variance(light).mean())
