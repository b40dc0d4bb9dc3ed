"""Numbers in a file ⇄ linear light, and how well that light is known."""

from blurmatte.radiometry.image import LinearImage as LinearImage
from blurmatte.radiometry.image import Meta as Meta
from blurmatte.radiometry.image import decode as decode
from blurmatte.radiometry.image import smooth_variance as smooth_variance
from blurmatte.radiometry.noise import NoiseModel as NoiseModel
from blurmatte.radiometry.noise import fit_noise as fit_noise
from blurmatte.radiometry.noise import rounding_noise as rounding_noise
from blurmatte.radiometry.noise import with_noise as with_noise
from blurmatte.radiometry.response import ResponseFit as ResponseFit
from blurmatte.radiometry.response import fit_response as fit_response
from blurmatte.radiometry.response_chart import draw_response as draw_response
from blurmatte.radiometry.transfer import LINEAR as LINEAR
from blurmatte.radiometry.transfer import REC709 as REC709
from blurmatte.radiometry.transfer import SRGB as SRGB
from blurmatte.radiometry.transfer import Transfer as Transfer
from blurmatte.radiometry.transfer import gamma as gamma
from blurmatte.radiometry.transfer import named_transfer as named_transfer
from blurmatte.radiometry.transfer import nearest_transfer as nearest_transfer
