"""explain: colors, solutions, plates, noise, curves and motions in plain words."""

from blurmatte.background import PlateFit
from blurmatte.calibration import NoiseFit, ResponseFit
from blurmatte.color.model import ColorModel
from blurmatte.explain.calibration import (
    curve_in_words,
    noise_in_words,
    plate_in_words,
    response_in_words,
)
from blurmatte.explain.color import color_in_words
from blurmatte.explain.fall import fall_in_words
from blurmatte.explain.motion import motion_in_words, scatter_in_words, speed_in_words
from blurmatte.explain.solution import solution_in_words
from blurmatte.explain.space import SpaceMotion, space_motion_in_words
from blurmatte.matting.solution import Solution
from blurmatte.motion.clip.fall import FreeFall
from blurmatte.motion.clip.scatter import Scatter
from blurmatte.motion.picture.motion import Motion, Speed
from blurmatte.radiometry import Transfer

Explained = (
    ColorModel
    | Solution
    | PlateFit
    | NoiseFit
    | Transfer
    | ResponseFit
    | Motion
    | Speed
    | SpaceMotion
    | FreeFall
    | Scatter
)


def explain(thing: Explained) -> list[str]:
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
    """
    if isinstance(thing, ColorModel):
        return color_in_words(thing)
    if isinstance(thing, Solution):
        return solution_in_words(thing)
    if isinstance(thing, PlateFit):
        return list(plate_in_words(thing))
    if isinstance(thing, NoiseFit):
        return noise_in_words(thing)
    if isinstance(thing, Transfer):
        return curve_in_words(thing)
    if isinstance(thing, ResponseFit):
        return response_in_words(thing)
    if isinstance(thing, Motion):
        return motion_in_words(thing)
    if isinstance(thing, Speed):
        return speed_in_words(thing)
    if isinstance(thing, SpaceMotion):
        return space_motion_in_words(thing)
    if isinstance(thing, FreeFall):
        return fall_in_words(thing)
    if isinstance(thing, Scatter):
        return scatter_in_words(thing)
    raise TypeError(
        "can explain a ColorModel, a Solution, a PlateFit, a NoiseFit, a Transfer, a ResponseFit, a "
        "Motion, a Speed, a BallMotion, a PlaneMotion, a BlurDepth, a Rotation, a FreeFall or "
        f"a Scatter, got {type(thing).__name__}"
    )
