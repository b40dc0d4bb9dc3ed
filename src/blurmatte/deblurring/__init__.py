"""Sharp pictures of a moving object from its blurred ones, and its point spread function."""

from blurmatte.deblurring.sharp import Sharp as Sharp
from blurmatte.deblurring.sharp import deblur as deblur
from blurmatte.deblurring.sharp import deblur_solution as deblur_solution
from blurmatte.deblurring.spin import Spin as Spin
from blurmatte.deblurring.spin_fit import fit_spin as fit_spin
from blurmatte.deblurring.spread import Dwell as Dwell
from blurmatte.deblurring.spread import fit_dwell as fit_dwell
from blurmatte.deblurring.spread import fit_psf as fit_psf
from blurmatte.trajectory import PointSpread as PointSpread
