"""The scene without the object."""

from blurmatte.background.plate import PlateFit as PlateFit
from blurmatte.background.plate import make_plate as make_plate
