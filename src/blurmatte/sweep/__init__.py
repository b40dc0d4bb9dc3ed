"""Path, silhouette and color of a streak in one fit."""

from blurmatte.sweep.fit_sweep import fit_sweep as fit_sweep
from blurmatte.sweep.model.priors import MotionPrior as MotionPrior
from blurmatte.sweep.model.priors import OpacityPrior as OpacityPrior
from blurmatte.sweep.model.priors import PathPrior as PathPrior
from blurmatte.sweep.sweep import Sweep as Sweep
from blurmatte.sweep.transfer_fit import TransferFit as TransferFit
from blurmatte.sweep.transfer_fit import fit_transfer as fit_transfer
