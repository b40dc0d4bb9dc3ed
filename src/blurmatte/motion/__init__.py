"""What alpha says about the movement."""

from blurmatte.motion.ball import fit_ball as fit_ball
from blurmatte.motion.ball import measure_ball as measure_ball
from blurmatte.motion.ball_motion import BallMotion as BallMotion
