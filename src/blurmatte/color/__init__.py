"""Which colors the object may have."""

from blurmatte.color.light import energy as energy
from blurmatte.color.light import light_reader as light_reader
from blurmatte.color.light import most_of_color as most_of_color
from blurmatte.color.model import ColorModel as ColorModel
from blurmatte.color.published import published_color_line as published_color_line
from blurmatte.color.samples import core_colors as core_colors
from blurmatte.color.samples import pick_colors as pick_colors
from blurmatte.color.shade import darker as darker
from blurmatte.color.shade import only_light_lost as only_light_lost
from blurmatte.color.shade import refuse_shade as refuse_shade
from blurmatte.color.streak import check_color_fit as check_color_fit
from blurmatte.color.streak import fit_color_from_hues as fit_color_from_hues
from blurmatte.color.streak import refuse_coarse as refuse_coarse
from blurmatte.color.streak import refuse_gray as refuse_gray
