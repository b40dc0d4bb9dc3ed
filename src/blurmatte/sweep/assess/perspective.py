"""The error of a disc by the perspective of a camera that is not known.

A ball that is seen at an angle θ from the axis of a camera is an ellipse in its picture, longer by
1 / cos θ along the direction from the center of the picture. In this file s = ½ log(1 / cos θ) is the
logarithm of this stretch, and tan θ = d / f, with the ball's distance d from the center of the picture
and the focal length f, both in pixels.
"""

from dataclasses import replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.silhouette import as_silhouette
from blurmatte.sweep.sweep import Sweep

# Of usual lenses, 24 to 200 mm for a frame of 36 mm: over the longer side of the picture. In this range
# all ratios of two focal lengths are alike.
_FOCAL_LENGTHS = 24 / 36, 200 / 36
_NODES = 16  # of the mean over focal lengths


def with_perspective_error(sweep: Sweep) -> Sweep:
    """The sweep with what a stretch by perspective adds to the covariance of a disc's parameters.

    The parameters change as the disc does whose alpha is nearest to that of the ellipse. The stretch is
    that of a ball in the middle of the exposure, its root mean square over focal lengths. It is an
    error, for the disc need not be a ball, nor the center of the picture that of the lens.
    """
    if not sweep.silhouette.is_disc:
        return sweep
    by_parameters, by_stretch = _derivatives(sweep, _stretch(sweep))
    change = np.linalg.lstsq(by_parameters, by_stretch, rcond=None)[0]
    return replace(sweep, covariance=sweep.covariance + np.outer(change, change))


def _stretch(sweep: Sweep) -> Array:
    """(2,) s cos 2φ and s sin 2φ of the direction φ from the center of the picture."""
    center = (np.array(sweep.size) - 1) / 2
    x, y = sweep.family.at(sweep.path, np.array([0.5]))[0][0] - center
    focal = max(sweep.size) * np.geomspace(*_FOCAL_LENGTHS, _NODES)
    size = np.sqrt(np.mean(np.log(np.hypot(1, np.hypot(x, y) / focal)) ** 2)) / 2
    angle = 2 * np.arctan2(y, x)
    return np.asarray(size * np.array([np.cos(angle), np.sin(angle)]))


def _derivatives(sweep: Sweep, stretch: Array) -> tuple[Array, Array]:
    """Alpha of the pixels by the parameters (p, n + m) of a disc, and by a stretch (p,)."""
    disc, path, n = as_silhouette(sweep.silhouette), sweep.path, len(sweep.path)
    ellipse = replace(disc, order=2)
    # The first of each name are those of the disc: an ellipse has two more rates.
    own = [ellipse.names.index(name) for name in disc.names]
    shape = np.zeros(ellipse.size)
    shape[own] = sweep.shape
    J = ellipse.sweep(sweep.family, path, shape, Pixels.of_box(sweep.box)).by_parameters
    J = J.reshape(-1, J.shape[-1])
    of_path, of_shape = J[:, :n], J[:, n:]
    return np.hstack([of_path, of_shape[:, own]]), of_shape[:, ellipse.at("stretch")] @ stretch
