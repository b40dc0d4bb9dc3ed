"""A camera's noise and response, measured from pictures."""

from blurmatte.calibration.noise_measure import NoiseFit as NoiseFit
from blurmatte.calibration.noise_measure import measure_noise as measure_noise
from blurmatte.calibration.noise_measure import measure_noise_against as measure_noise_against
from blurmatte.calibration.noise_measure import measure_noise_within as measure_noise_within
from blurmatte.calibration.noise_pair import fit_noise as fit_noise
from blurmatte.calibration.noise_pair import with_noise as with_noise
from blurmatte.calibration.response import ResponseFit as ResponseFit
from blurmatte.calibration.response import fit_response as fit_response
