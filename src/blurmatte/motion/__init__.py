"""What alpha says about the movement."""

from blurmatte.motion.measure import measure_motion as measure_motion
from blurmatte.motion.motion import Motion as Motion
from blurmatte.motion.outlines import EndSilhouettes as EndSilhouettes
from blurmatte.motion.outlines import end_silhouettes as end_silhouettes
from blurmatte.motion.units import Scale as Scale
from blurmatte.motion.units import Speed as Speed
from blurmatte.motion.words import motion_in_words as motion_in_words
from blurmatte.motion.words import speed_in_words as speed_in_words
