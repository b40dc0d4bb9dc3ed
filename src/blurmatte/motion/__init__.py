"""What alpha says about the movement."""

from blurmatte.motion.measure import measure_motion as measure_motion
from blurmatte.motion.motion import Motion as Motion
from blurmatte.motion.units import Scale as Scale
from blurmatte.motion.units import Speed as Speed
