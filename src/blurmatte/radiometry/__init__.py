"""Numbers in a file ⇄ linear light, and how well that light is known."""

from blurmatte.radiometry.blocks import BLOCKS as BLOCKS
from blurmatte.radiometry.blocks import block_squares as block_squares
from blurmatte.radiometry.blocks import coherence as coherence
from blurmatte.radiometry.image import LinearImage as LinearImage
from blurmatte.radiometry.image import Matrix3 as Matrix3
from blurmatte.radiometry.image import Meta as Meta
from blurmatte.radiometry.image import check_same_colors as check_same_colors
from blurmatte.radiometry.image import decode as decode
from blurmatte.radiometry.image import light_in_srgb as light_in_srgb
from blurmatte.radiometry.image import smooth_variance as smooth_variance
from blurmatte.radiometry.noise import NoiseModel as NoiseModel
from blurmatte.radiometry.noise import fit_noise as fit_noise
from blurmatte.radiometry.noise import rounding_noise as rounding_noise
from blurmatte.radiometry.noise import rounding_variance as rounding_variance
from blurmatte.radiometry.noise import with_noise as with_noise
from blurmatte.radiometry.noise_chart import draw_noise as draw_noise
from blurmatte.radiometry.noise_fit import NoiseFit as NoiseFit
from blurmatte.radiometry.noise_measure import measure_noise as measure_noise
from blurmatte.radiometry.noise_measure import measure_noise_against as measure_noise_against
from blurmatte.radiometry.noise_measure import measure_noise_within as measure_noise_within
from blurmatte.radiometry.transfer import LINEAR as LINEAR
from blurmatte.radiometry.transfer import REC709 as REC709
from blurmatte.radiometry.transfer import SRGB as SRGB
from blurmatte.radiometry.transfer import Transfer as Transfer
from blurmatte.radiometry.transfer import gamma as gamma
from blurmatte.radiometry.transfer import named_transfer as named_transfer
