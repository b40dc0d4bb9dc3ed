"""Compositing: backgrounds, retouching, stacks of layers, and exposures of paints."""

from blurmatte.compositing.background import cover as cover
from blurmatte.compositing.background import fade_between as fade_between
from blurmatte.compositing.background import light_gain as light_gain
from blurmatte.compositing.background import long_exposure as long_exposure
from blurmatte.compositing.background import stack as stack
from blurmatte.compositing.paints import Exposures as Exposures
from blurmatte.compositing.paints import split_exposure as split_exposure
