"""What alpha says about the movement."""

from blurmatte.motion.ball import fit_ball as fit_ball
from blurmatte.motion.ball import measure_ball as measure_ball
from blurmatte.motion.ball_motion import BallMotion as BallMotion
from blurmatte.motion.depth import BlurDepth as BlurDepth
from blurmatte.motion.depth import depth_from_blur as depth_from_blur
from blurmatte.motion.plane_motion import Plane as Plane
from blurmatte.motion.plane_motion import PlaneMotion as PlaneMotion
from blurmatte.motion.plane_motion import measure_on_plane as measure_on_plane
from blurmatte.motion.rotation import Rotation as Rotation
from blurmatte.motion.rotation import measure_rotation as measure_rotation
from blurmatte.motion.space_words import SpaceMotion as SpaceMotion
from blurmatte.motion.space_words import space_motion_in_words as space_motion_in_words
