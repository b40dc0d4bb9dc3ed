"""measure_motion: Solution → Motion."""

import numpy as np

from blurmatte.errors import MotionError
from blurmatte.matting import Solution
from blurmatte.motion.from_sweep import motion_of_sweep
from blurmatte.motion.moments import motion_of_alpha
from blurmatte.motion.motion import Motion


def measure_motion(solution: Solution) -> Motion:
    """Measure how something moved during the exposure: where, how far, in which direction.

    From the shape on a path that explains the streak, if there is one (`Solution.sweep`): path,
    speed over time and size, with the errors that noise and the uncertain color leave together.
    Otherwise from the moments of alpha: its sum is the area of the silhouette however it moved, its
    mean the mean place; for a straight way of length L at constant speed the variance along the way
    is L²/12 more than across, if the silhouette is about as long as wide.

    Which way it went a single picture cannot tell; the motion is given as going to the right.

    Parameters
    ----------
    solution : Solution
        What `solve` gave, or `read_solution` read.

    Returns
    -------
    Motion

    Raises
    ------
    TypeError
        If it is something else.
    MotionError
        If nothing moved: there is no streak, or alpha does not add up to more than its error.
    """
    if not isinstance(solution, Solution):
        raise TypeError(
            f"solution must be a Solution, got {type(solution).__name__}; use "
            "blurmatte.solve(image, plate) or blurmatte.read_solution(file)"
        )
    if not np.any(solution.streak & solution.known):
        raise MotionError(
            "no pixel of the streak has a known alpha, so that nothing can be measured; solve with "
            "another color, or before another background"
        )
    if solution.sweep is None:
        return motion_of_alpha(solution)
    motion = motion_of_sweep(solution.sweep, solution.stats.get("exposure_time"))
    return motion.reversed if abs(motion.angle) > np.pi / 2 else motion
