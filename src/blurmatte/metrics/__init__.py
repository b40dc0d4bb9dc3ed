"""Errors of estimates, where the truth is known.

The estimate comes first and the truth second. The streak is where the true alpha is above 0. A bad
argument raises ValueError or TypeError: another size, numbers that are not finite, no streak.
"""

from blurmatte.metrics.alpha import Calibration as Calibration
from blurmatte.metrics.alpha import alpha_gradient_error as alpha_gradient_error
from blurmatte.metrics.alpha import alpha_rmse as alpha_rmse
from blurmatte.metrics.alpha import alpha_sad as alpha_sad
from blurmatte.metrics.alpha import alpha_sum_bias as alpha_sum_bias
from blurmatte.metrics.alpha import calibration as calibration
from blurmatte.metrics.alpha import false_alpha as false_alpha
from blurmatte.metrics.color import ColorDistance as ColorDistance
from blurmatte.metrics.color import color_distance as color_distance
from blurmatte.metrics.color import premultiplied_rmse as premultiplied_rmse
from blurmatte.metrics.color import recomposite_psnr as recomposite_psnr
from blurmatte.metrics.motion import subframe_psnr as subframe_psnr
from blurmatte.metrics.motion import subframe_ssim as subframe_ssim
from blurmatte.metrics.motion import trajectory_iou as trajectory_iou
