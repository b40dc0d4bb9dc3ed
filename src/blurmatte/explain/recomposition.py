"""Whether an assumed layer is usable over its own plate.

There alpha and light have the same error: more alpha with a color nearer to the plate's gives the same
picture. So a layer whose alpha is off by a factor gives back the image, and what it leaves of the image
is its measure.
"""

import numpy as np

from blurmatte.matting.maps import Grade
from blurmatte.matting.solution import Solution
from blurmatte.radiometry import LinearImage

_MAX_RESIDUAL_STD = 3.0  # root mean square over the streak, in standard deviations of the noise


def usable_all_the_same(image: LinearImage, plate: LinearImage, solution: Solution) -> list[str]:
    """That an assumed layer gives back the image over its plate; one line, or none if it does not.

    image, plate: what was solved, of the size of the solution.
    """
    if solution.stats.grade is not Grade.ASSUMED:
        return []
    if solution.stats.may_be_shadow or not _gives_back(image, plate, solution):
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
    pairs = (solution.stats.image_noise, C), (solution.stats.plate_noise, B)
    noise = sum(float(own.variance(light).mean()) for own, light in pairs if own is not None)
    return square <= _MAX_RESIDUAL_STD**2 * noise
