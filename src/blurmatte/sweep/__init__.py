"""Path, silhouette and color of a streak in one fit."""

from blurmatte.color.model import fuse_colors as fuse_colors
from blurmatte.sweep.color_fit import fit_color as fit_color
from blurmatte.sweep.fit_sweep import fit_disc as fit_disc
from blurmatte.sweep.fit_sweep import fit_hypotheses as fit_hypotheses
from blurmatte.sweep.fit_sweep import fit_sweep as fit_sweep
from blurmatte.sweep.fit_sweep import likeliest_streak as likeliest_streak
from blurmatte.sweep.model.path import path_family as path_family
from blurmatte.sweep.model.priors import MotionPrior as MotionPrior
from blurmatte.sweep.model.priors import OpacityPrior as OpacityPrior
from blurmatte.sweep.model.priors import PathPrior as PathPrior
from blurmatte.sweep.sweep import Diagnostics as Diagnostics
from blurmatte.sweep.sweep import Sweep as Sweep
from blurmatte.sweep.transfer_fit import TransferFit as TransferFit
from blurmatte.sweep.transfer_fit import fit_transfer as fit_transfer
