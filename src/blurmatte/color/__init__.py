"""The colors that an object may have, and their estimation."""

from blurmatte.color.samples import core_colors as core_colors
from blurmatte.color.samples import pick_colors as pick_colors
from blurmatte.color.streak import published_color_line as published_color_line
