"""Image + plate + colors → alpha and color."""

from blurmatte.matting.solution import Quality as Quality
from blurmatte.matting.solution import Solution as Solution
