"""Path, silhouette and color of a smear in one fit."""

from blurmatte.sweep.chroma import Compressed as Compressed
from blurmatte.sweep.chroma import file_of as file_of
from blurmatte.sweep.chroma import image_before as image_before
from blurmatte.sweep.color import fit_color as fit_color
from blurmatte.sweep.fit import fit_disc as fit_disc
from blurmatte.sweep.fit import fit_piece as fit_piece
from blurmatte.sweep.fit import fit_sweep as fit_sweep
from blurmatte.sweep.path import path_family as path_family
from blurmatte.sweep.pool import pooled as pooled
from blurmatte.sweep.sweep import Sweep as Sweep
from blurmatte.sweep.transfer import TransferFit as TransferFit
from blurmatte.sweep.transfer import fit_transfer as fit_transfer
from blurmatte.sweep.verdict import MAX_MISFIT as MAX_MISFIT
