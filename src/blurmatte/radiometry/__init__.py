"""Code values of files ⇄ linear light, and the noise of linear light."""

from blurmatte.radiometry.compression import CodingError as CodingError
from blurmatte.radiometry.compression import Compression as Compression
from blurmatte.radiometry.image import LinearImage as LinearImage
from blurmatte.radiometry.image import Meta as Meta
from blurmatte.radiometry.image import are_gray as are_gray
from blurmatte.radiometry.image import check_picture as check_picture
from blurmatte.radiometry.image import check_same_colors as check_same_colors
from blurmatte.radiometry.image import counted_once as counted_once
from blurmatte.radiometry.image import decode as decode
from blurmatte.radiometry.image import rounding_noise as rounding_noise
from blurmatte.radiometry.image import smooth_variance as smooth_variance
from blurmatte.radiometry.noise_model import Noise as Noise
from blurmatte.radiometry.noise_model import NoiseModel as NoiseModel
from blurmatte.radiometry.noise_model import rounding_variance as rounding_variance
from blurmatte.radiometry.transfer import LINEAR as LINEAR
from blurmatte.radiometry.transfer import LUMA_WEIGHTS as LUMA_WEIGHTS
from blurmatte.radiometry.transfer import REC709 as REC709
from blurmatte.radiometry.transfer import SRGB as SRGB
from blurmatte.radiometry.transfer import YCBCR as YCBCR
from blurmatte.radiometry.transfer import Transfer as Transfer
from blurmatte.radiometry.transfer import gamma as gamma
from blurmatte.radiometry.transfer import hex_of_light as hex_of_light
from blurmatte.radiometry.transfer import light_in_srgb as light_in_srgb
from blurmatte.radiometry.transfer import light_of_hex as light_of_hex
from blurmatte.radiometry.transfer import named_transfer as named_transfer
from blurmatte.radiometry.transfer import nearest_transfer as nearest_transfer
