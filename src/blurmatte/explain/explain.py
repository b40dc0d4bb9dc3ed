"""explain: colors, solutions, plates, noise, curves and motions in plain words."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from blurmatte.background import PlateFit
from blurmatte.calibration import NoiseFit, ResponseFit
from blurmatte.color.model import ColorModel
from blurmatte.explain import calibration, motion
from blurmatte.explain.solution import solution_in_words
from blurmatte.matting.solution import Solution
from blurmatte.motion.clip.fall import FreeFall
from blurmatte.motion.clip.summary import Scatter
from blurmatte.motion.picture.motion import Motion, Speed
from blurmatte.motion.space.ball_motion import BallMotion
from blurmatte.motion.space.depth import BlurDepth
from blurmatte.motion.space.plane import PlaneMotion
from blurmatte.motion.space.rotation import Rotation
from blurmatte.radiometry import Transfer

_MAX_STD_DEG = 30.0  # of evidence that is worth a number
_EVIDENCE = {
    "hue variation": "the hues of the plate behind the streak alone",
    "shape": "the shape of the streak and the hues together",
    "compression": "hues in a file that lets the colors of neighbors run together",
    "feasibility": "alpha between 0 and 1, and no negative light, alone",
    "frames": "several frames together",
    "samples": "the scatter of the sampled colors alone",
    "mixtures": "the mixture of object and plate that is farthest from the plate",
}
_ANY = (
    "Any colors: alpha follows from the shape and its motion, or from the plate's texture, not from a "
    "color."
)


def color_in_words(model: ColorModel) -> Iterator[str]:
    """Sentences: the mean color of several, which colors are possible, and their evidence."""
    if model.rank > 1 and model.color:
        yield f"On average {model.color}."
    if model.rank == 3:
        yield _ANY
        return
    yield _directions(model)
    for name, std in model.evidence.items():
        source = _EVIDENCE.get(name, f"{name} alone")
        accuracy = f"to {std:.2g}°" if std < _MAX_STD_DEG else "nothing"
        yield f"From {source}: {accuracy}."
    if not model.evidence:
        yield "The color was given, not measured."
    limits = [" and ".join(other.hex) for other in model.possible]
    if len(set(limits)) > 1:  # they differ from the color in 8 bits
        yield f"In 95 of 100 cases no further away than {limits[1]} or {limits[5]}."


def _directions(model: ColorModel) -> str:
    colors = " and ".join(
        f"({', '.join(f'{x:.3f}' for x in color)})" for color in np.round(model.rgb, 3) + 0.0
    )
    space = "linear RGB" if model.to_srgb is None else "camera's own linear RGB"
    if model.rank == 1:
        return f"One paint and its shades: all multiples of the {space} color {colors}."
    return f"Two paints and their mixtures: a plane of colors between {space} {colors}."


_WORDS: dict[type, Callable[[Any], Iterable[str]]] = {
    ColorModel: color_in_words,
    Solution: solution_in_words,
    PlateFit: calibration.plate_in_words,
    NoiseFit: calibration.noise_in_words,
    Transfer: calibration.curve_in_words,
    ResponseFit: calibration.response_in_words,
    Motion: motion.motion_in_words,
    Speed: motion.speed_in_words,
    BallMotion: motion.ball_in_words,
    PlaneMotion: motion.plane_motion_in_words,
    BlurDepth: motion.depth_in_words,
    Rotation: motion.rotation_in_words,
    FreeFall: motion.fall_in_words,
    Scatter: motion.scatter_in_words,
}


def explain(thing: object) -> list[str]:
    """Sentences about a result, for people who do not know the technical terms.

    Parameters
    ----------
    thing : ColorModel, Solution, PlateFit, NoiseFit, Transfer, ResponseFit, Motion, Speed, \
            BallMotion, PlaneMotion, BlurDepth, Rotation, FreeFall or Scatter

    Returns
    -------
    list of str
        One sentence each.

    Raises
    ------
    TypeError
        For anything else.

    Examples
    --------
    >>> for sentence in bm.explain(motion):
    ...     print(sentence)
    Measured from the shape on a path that explains the streak: a disc on a straight line at
    constant speed.
    Mean position of its center: x 58.953 ± 0.093, y 37.016 ± 0.031 px.
    Size: radius 10.014 ± 0.021 px (of a disc of its area, 315.1 ± 1.4 px), 20.029 ± 0.043 px wide
    across its path.
    It went 59.60 ± 0.21 px in the direction 13.573 ± 0.080° from right towards up (right), or the
    opposite one: one picture does not determine which.
    """
    for kind, words in _WORDS.items():
        if isinstance(thing, kind):
            return list(words(thing))
    *names, last = (f"a {kind.__name__}" for kind in _WORDS)
    raise TypeError(f"can explain {', '.join(names)} or {last}, got {type(thing).__name__}")
