"""explain: colors, solutions, plates, noise, curves and motions in plain words."""

from collections.abc import Callable, Iterable
from typing import Any

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
from blurmatte.explain.space import (
    ball_in_words,
    depth_in_words,
    plane_motion_in_words,
    rotation_in_words,
)
from blurmatte.matting.solution import Solution
from blurmatte.motion.clip.fall import FreeFall
from blurmatte.motion.clip.scatter import Scatter
from blurmatte.motion.picture.motion import Motion, Speed
from blurmatte.motion.space.ball_motion import BallMotion
from blurmatte.motion.space.depth import BlurDepth
from blurmatte.motion.space.plane import PlaneMotion
from blurmatte.motion.space.rotation import Rotation
from blurmatte.radiometry import Transfer

_WORDS: dict[type, Callable[[Any], Iterable[str]]] = {
    ColorModel: color_in_words,
    Solution: solution_in_words,
    PlateFit: plate_in_words,
    NoiseFit: noise_in_words,
    Transfer: curve_in_words,
    ResponseFit: response_in_words,
    Motion: motion_in_words,
    Speed: speed_in_words,
    BallMotion: ball_in_words,
    PlaneMotion: plane_motion_in_words,
    BlurDepth: depth_in_words,
    Rotation: rotation_in_words,
    FreeFall: fall_in_words,
    Scatter: scatter_in_words,
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
    """
    for kind, words in _WORDS.items():
        if isinstance(thing, kind):
            return list(words(thing))
    *names, last = (f"a {kind.__name__}" for kind in _WORDS)
    raise TypeError(f"can explain {', '.join(names)} or {last}, got {type(thing).__name__}")
