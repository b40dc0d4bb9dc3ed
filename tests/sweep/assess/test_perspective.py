"""The error of a disc by the perspective of an unknown camera."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose

from blurmatte.color.model import ColorModel
from blurmatte.sweep.assess.diagnostics import with_perspective_error
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE, Silhouette
from blurmatte.sweep.sweep import Sweep

SIZE, RADIUS, BLUR = (300, 200), 9.0, 1.2
CENTER = (np.array(SIZE) - 1) / 2
ASIDE = CENTER + np.array([100.0, 20.0])
GREY = ColorModel.from_hex("#808080")


def disc_at(middle, along, silhouette=DISC):
    """A disc without another error, on a line of a length and direction `along` (2,)."""
    path = np.concatenate([middle - np.asarray(along) / 2, middle + np.asarray(along) / 2])
    shape = silhouette.start(RADIUS)
    shape[silhouette.at("blur")] = BLUR
    n = len(path) + len(shape)
    return Sweep(LINE, path, silhouette, shape, GREY, np.zeros((n, n)), SIZE)


def seen_at(sweep, focal):
    """Alpha of a ball in perspective whose ellipse has the disc's area."""
    x, y = sweep.family.at(sweep.path, np.array([0.5]))[0][0] - CENTER
    size, angle = np.log(np.hypot(1, np.hypot(x, y) / focal)) / 2, 2 * np.arctan2(y, x)
    ellipse = replace(sweep.silhouette, order=2)
    shape = ellipse.start(RADIUS)
    shape[ellipse.at("stretch")] = size * np.cos(angle), size * np.sin(angle)
    shape[ellipse.at("blur")] = BLUR
    return ellipse.sweep(LINE, sweep.path, shape, Pixels.of_box(sweep.box)).alpha


def fitted_disc(sweep, alpha):
    """Parameters of the disc whose alpha is nearest."""
    n, pixels = len(sweep.path), Pixels.of_box(sweep.box)

    def swept(values):
        return sweep.silhouette.sweep(LINE, values[:n], values[n:], pixels)

    return scipy.optimize.least_squares(
        lambda values: (swept(values).alpha - alpha).ravel(),
        np.concatenate([sweep.path, sweep.shape]),
        lambda values: swept(values).by_parameters.reshape(-1, len(sweep.covariance)),
        x_scale="jac",
    ).x


def test_errors_are_the_scatter_over_focal_lengths():
    """honest: z of the radius of discs that were fitted to balls in perspective."""
    rng, z = np.random.default_rng(0), []
    for _ in range(300):
        middle = CENTER + rng.uniform(-1, 1, 2) * (110, 60)
        sweep = disc_at(middle, rng.normal(size=2) * 15)
        focal = SIZE[0] * np.exp(rng.uniform(*np.log([24 / 36, 200 / 36])))
        found = fitted_disc(sweep, seen_at(sweep, focal))
        z.append((found[-1] - RADIUS) / with_perspective_error(sweep).radius_std)
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25


@pytest.mark.parametrize("along", [(30.0, 0.0), (0.0, 30.0), (4.0, 1.0)])
@pytest.mark.parametrize("kind", [{}, {"soft": True}, {"changes": True}])
def test_disc_changes_as_its_fit_to_an_ellipse(along, kind):
    """oracle: nonlinear least squares."""
    sweep = disc_at(ASIDE, along, Silhouette(1, **kind))
    far, near = (fitted_disc(sweep, seen_at(sweep, f * SIZE[0])) for f in (1e6, 5.0))
    change = near - far
    values, axes = np.linalg.eigh(with_perspective_error(sweep).covariance)
    assert_allclose(values[:-1], 0, atol=1e-9 * values[-1])
    assert abs(change @ axes[:, -1]) / np.linalg.norm(change) > 0.999


def test_disc_in_the_center_of_the_picture_has_no_error():
    """exact"""
    found = with_perspective_error(disc_at(CENTER, (20.0, 5.0)))
    assert_allclose(found.covariance, 0, atol=1e-20)


def test_ellipses_measure_their_stretch():
    """exact: they get no error."""
    sweep = disc_at(ASIDE, (30.0, 5.0))
    n = len(sweep.path) + ELLIPSE.size
    ellipse = replace(
        sweep, silhouette=ELLIPSE, shape=ELLIPSE.start(RADIUS), covariance=np.zeros((n, n))
    )
    assert with_perspective_error(ellipse) is ellipse
