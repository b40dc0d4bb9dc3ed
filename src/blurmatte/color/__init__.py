"""Which colors the object may have."""

from blurmatte.color.model import ColorModel as ColorModel
