"""A prior of radius and path from other frames of a clip."""

import numpy as np
import pytest
from tests.scenes import on_line, rendered

import blurmatte as bm
from blurmatte.rendering import Ball, Scene, colorful_plate
from blurmatte.rendering.plates import plain_plate
from blurmatte.rendering.scene import Shadow
from blurmatte.sweep import MotionPrior, PathPrior
from blurmatte.sweep.fit_sweep import fit_hypotheses
from blurmatte.sweep.hypotheses import HYPOTHESES, Hypothesis
from blurmatte.sweep.model.path import LINE, PARABOLA
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.sweep.sweep import Sweep
from blurmatte.trajectory import Trajectory


@pytest.fixture(scope="module")
def pictures():
    """A ball of radius 6 before tiles, with noise."""
    plate = colorful_plate((64, 48), 1, tile=12)
    ball = Ball(6, (0.7, 0.35, 0.1))
    light = on_line(plate, (18, 20), (44, 27), ball).image.rgb
    rng = np.random.default_rng(1)
    noise = bm.NoiseModel(read_std=0.02)
    return [bm.LinearImage(x + rng.normal(0, 0.02, x.shape), noise) for x in (light, plate)]


def path_prior(scale=1.0):
    """Three points and a covariance with correlations."""
    A = np.random.default_rng(0).normal(size=(6, 6))
    points = np.array([[18.0, 20.0], [31.0, 23.6], [44.0, 27.0]])
    return PathPrior(points, scale**2 * (A @ A.T / 6 + np.eye(6)))


@pytest.mark.parametrize("family", [LINE, PARABOLA])
def test_derivatives_are_those_of_the_cost(family):
    prior, step = MotionPrior(6.0, 0.3, path_prior(), weight=2.0), 1e-4
    path, shape = (
        family.starts(np.linspace((17.0, 21.0), (45.0, 26.0), 33))[0],
        np.array([6.4, 1.0]),
    )
    n = len(path) + 2
    H, g = prior.added(np.zeros((n, n)), np.zeros(n), family, path, shape)

    def gradient(index):
        """Central difference of the cost."""
        both = np.concatenate([path, shape])
        costs = []
        for d in (step, -step):
            moved = both.copy()
            moved[index] += d
            costs.append(prior.cost(family, moved[:-2], moved[-2:]))
        return (costs[0] - costs[1]) / (2 * step)

    assert g == pytest.approx([gradient(k) for k in range(n)], rel=1e-6, abs=1e-6)
    moved = path + step * np.eye(len(path))[1]
    _, changed = prior.added(np.zeros((n, n)), np.zeros(n), family, moved, shape)
    assert (changed - g) / step == pytest.approx(H[1], rel=1e-5, abs=1e-5)


def test_probability_is_uniform_for_frames_that_agree():
    """Honest: estimates that contain a prior, drawn from it and from a measurement."""
    rng, prior = np.random.default_rng(2), MotionPrior(6.0, 0.3, path_prior())
    P = np.zeros((7, 7))
    P[:6, :6], P[6, 6] = prior.path.covariance, 0.09
    A = rng.normal(size=(7, 7))
    R = A @ A.T / 4 + 0.1 * np.eye(7)
    mean, found = np.append(prior.path.points.ravel(), 6.0), []
    posterior = np.linalg.inv(np.linalg.inv(P) + np.linalg.inv(R))
    for _ in range(400):
        true = rng.multivariate_normal(mean, P)
        seen = rng.multivariate_normal(true, R)
        m = posterior @ (np.linalg.solve(P, mean) + np.linalg.solve(R, seen))
        found.append(prior.probability(PARABOLA, m[:6], m[6:], posterior))
    assert np.mean(found) == pytest.approx(0.5, abs=0.05)
    assert np.mean(np.array(found) < 0.05) == pytest.approx(0.05, abs=0.03)
    far = mean + np.append(np.zeros(6), 3.0)
    assert prior.probability(PARABOLA, far[:6], far[6:], posterior) < 1e-6


def test_precise_prior_sets_the_radius_and_its_error(pictures):
    free = bm.solve(*pictures, matching=bm.background.Matching.NONE).sweep
    known = bm.solve(
        *pictures, matching=bm.background.Matching.NONE, prior=MotionPrior(6.0, 0.01, is_disc=True)
    ).sweep
    assert abs(known.radius - 6) < 0.05
    assert known.radius_std < free.radius_std / 2


def test_vague_prior_changes_nothing(pictures):
    free = bm.solve(*pictures, matching=bm.background.Matching.NONE).sweep
    prior = MotionPrior(6.0, 1e4, path_prior(1e4))
    vague = bm.solve(*pictures, matching=bm.background.Matching.NONE, prior=prior).sweep
    assert vague.radius == pytest.approx(free.radius, abs=0.2 * free.radius_std)
    # Fits end at a fraction of the error, which depends on the rounding of the processor.
    ends_std = np.sqrt(np.diag(free.covariance)[:4]).reshape(2, 2).max(axis=0)
    assert np.all(np.abs(vague.trajectory.xy[64] - free.trajectory.xy[64]) < ends_std / 2)


def test_precise_prior_sets_the_path(pictures):
    wrong = PathPrior(path_prior().points + np.array([2.0, 0.0]), 1e-6 * np.eye(6))
    sweep = bm.solve(
        *pictures,
        matching=bm.background.Matching.NONE,
        start=started_at(wrong),
        prior=MotionPrior(6, 1, wrong),
    ).sweep
    ends = sweep.trajectory.xy[[0, -1]]
    assert ends == pytest.approx(wrong.points[[0, 2]], abs=0.02)
    assert sweep.diagnostics.prior_probability < 1e-3


def started_at(prior):
    """A sweep on the mean of a path."""
    model = bm.ColorModel.from_hex("#d8ff3c")
    path = prior.points.ravel()
    return Sweep(PARABOLA, path, DISC, DISC.start(6.0), model, np.zeros((7, 7)), (64, 48))


def before_wall(shadow, more_noise=0.0):
    """A ball on the path before a wall, perhaps with a shadow and with more noise where it moved."""
    size = (64, 48)
    scene = Scene(
        plain_plate(size, (0.42, 0.42, 0.4), 4),
        Trajectory.line((18, 20), (44, 27)),
        Ball(6, (0.27, 0.72, 0.13)),
        shadow=shadow,
    )
    truth, rng = rendered(scene), np.random.default_rng(1)
    scale = 1 + more_noise * (truth.layer.alpha > 0)[..., None]
    light = truth.image.rgb + scale * rng.normal(0, 0.004, truth.image.rgb.shape)
    image = bm.LinearImage(light, bm.NoiseModel(read_std=0.004))
    return image, bm.LinearImage(scene.plate, bm.NoiseModel(read_std=1e-4))


def fitted_as_known(image, plate, hypotheses=HYPOTHESES):
    """Hypotheses about a disc that other frames know."""
    known = MotionPrior(6.0, 0.1, path_prior(0.3), is_disc=True)
    streak = bm.find_streaks(image, plate)[0]
    return fit_hypotheses(image, plate, streak, None, started_at(path_prior()), known, hypotheses)


class NotNeeded(Hypothesis):
    """Fails where it is fitted."""

    def fits(self, fits):
        raise AssertionError("the disc left something to explain")


def test_known_disc_needs_no_other_hypothesis_for_more_noise():
    """Exact: residuals that are larger than stated, but no more correlated than those around."""
    found = fitted_as_known(*before_wall(None, more_noise=2.0), (*HYPOTHESES, NotNeeded()))
    assert found.best.diagnostics.variance_inflation > 1.2


def test_shadow_of_a_known_disc_is_found():
    """Honest: its residuals contradict the disc alone."""
    found = fitted_as_known(*before_wall(Shadow((0, 11), strength=(0.5, 0.5, 0.5))))
    assert found.best.cast is not None
    assert np.linalg.norm(np.subtract(found.best.cast.offset, (0, 11))) < 1.5


def test_impossible_prior_is_refused():
    with pytest.raises(ValueError, match="above 0"):
        MotionPrior(0.0, 1.0)


def test_silhouette_alone_says_little_of_the_radius():
    prior = MotionPrior(6.0, 0.1, path_prior(), is_disc=True, scatter=2.0).of_silhouette
    assert (prior.is_disc, prior.path, prior.scatter) == (True, None, 1.0)
    assert prior.cost(LINE, np.zeros(4), np.array([9.0])) < 0.2
