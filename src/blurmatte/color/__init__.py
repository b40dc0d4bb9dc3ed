"""The colors that an object may have, and their estimation."""

from blurmatte.color.model import ColorModel as ColorModel
from blurmatte.color.samples import core_colors as core_colors
from blurmatte.color.samples import pick_colors as pick_colors
from blurmatte.color.shadow_test import darker_pixels as darker_pixels
from blurmatte.color.shadow_test import may_be_shadow as may_be_shadow
from blurmatte.color.streak import check_chroma_resolution as check_chroma_resolution
from blurmatte.color.streak import fit_color_from_hues as fit_color_from_hues
from blurmatte.color.streak import projected_energy as projected_energy
from blurmatte.color.streak import projection_vectors as projection_vectors
from blurmatte.color.streak import projection_weights as projection_weights
from blurmatte.color.streak import published_color_line as published_color_line
from blurmatte.color.streak import streak_of_color as streak_of_color
