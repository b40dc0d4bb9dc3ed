"""A rolling shutter: the stretch of a moving disc, and the readout time from stretches."""

import numpy as np
import pytest

from blurmatte.motion.clip.rolling_shutter import RollingShutter
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.silhouette import Silhouette

SIZE = 60
MIDDLE = (SIZE - 1) / 2


def exposed_in_turn(radius, displacement, readout):
    """Alpha of a disc, each row of points exposed `readout` later than that one pixel above."""
    n, times = 3, (np.arange(80) + 0.5) / 80 - 0.5
    at = (np.arange(n * SIZE) + 0.5) / n - 0.5 - MIDDLE
    alpha = np.zeros((n * SIZE, n * SIZE))
    for t in times:
        x, y = np.multiply.outer(displacement, t + readout * at)
        alpha += (at[None, :] - x[:, None]) ** 2 + ((at - y) ** 2)[:, None] < radius**2
    return alpha.reshape(SIZE, n, SIZE, n).mean(axis=(1, 3)) / len(times)


@pytest.mark.parametrize("displacement", [(20.0, 0.0), (0.0, 18.0), (-12.0, -14.0)])
def test_image_of_a_disc_is_a_stretched_disc(displacement):
    """Oracle: to second order in the stretch, and closer than the disc by three times."""
    radius, readout, v = 9.0, 0.01, np.array(displacement)
    size = 1 / (1 - readout * v[1])
    ends = np.concatenate([MIDDLE - v * size / 2, MIDDLE + v * size / 2])
    truth = exposed_in_turn(radius, v, readout)

    def error(stretch):
        """Root mean square over the streak."""
        disc = Silhouette(camera_stretch=stretch)
        shape = disc.start(radius * np.sqrt(size))
        alpha = disc.sweep(LINE, ends, shape, Pixels((SIZE, SIZE), (0.0, 0.0))).alpha
        return float(np.sqrt(np.mean((alpha - truth)[truth > 0] ** 2)))

    assert error(tuple(RollingShutter(readout).stretch(v)[0])) < min(0.01, error((0.0, 0.0)) / 3)


@pytest.mark.parametrize("rows", ["up", "left", "right"])
def test_image_of_a_turned_picture_is_a_stretched_disc(rows):
    """Oracle: the picture, path and all, turned by quarters from one that is read downwards."""
    quarters = {"right": 1, "up": 2, "left": 3}[rows]  # np.rot90 turns down to the right
    radius, readout, v = 9.0, 0.01, np.array([20.0, 6.0])
    truth = np.rot90(exposed_in_turn(radius, v, readout), quarters)
    size = 1 / (1 - readout * v[1])
    for _ in range(quarters):
        v = np.array([v[1], -v[0]])
    ends = np.concatenate([MIDDLE - v * size / 2, MIDDLE + v * size / 2])
    stretch, _ = RollingShutter(readout, rows=rows).stretch(v)
    disc = Silhouette(camera_stretch=tuple(stretch))
    shape = disc.start(radius * np.sqrt(size))
    alpha = disc.sweep(LINE, ends, shape, Pixels((SIZE, SIZE), (0.0, 0.0))).alpha
    assert np.sqrt(np.mean((alpha - truth)[truth > 0] ** 2)) < 0.01


def frames(readout, rng, count=16, std=0.02, scatter=0.0):
    """Stretches with covariances, one of them a mistake, and displacements."""
    moved = 60 * rng.normal(size=(count, 2))
    error, camera = np.hypot(std, scatter), RollingShutter(readout)
    stretches = [camera.stretch(v)[0] + error * rng.normal(size=2) for v in moved]
    stretches[3] += 1.0
    return [((s, std**2 * np.eye(2)), v) for s, v in zip(stretches, moved, strict=True)]


@pytest.mark.parametrize("scatter", [0.0, 0.04])
def test_readout_time_is_found_in_spite_of_a_mistake(scatter):
    """Honest: within three standard deviations of the mean of 16 frames; so is the scatter."""
    found = [
        RollingShutter.of(frames(0.003, np.random.default_rng(seed), scatter=scatter))
        for seed in range(20)
    ]
    error = np.hypot(0.02, scatter)
    for one in found:
        assert one.is_decisive
        assert one.readout == pytest.approx(0.003, abs=3 * error / (60 / np.sqrt(2) * 4))
    assert np.median([one.scatter for one in found]) == pytest.approx(scatter, abs=0.012)


def test_discs_of_a_global_shutter_have_none():
    for seed in range(20):
        assert not RollingShutter.of(frames(0.0, np.random.default_rng(seed))).is_decisive
    assert not RollingShutter.of([]).is_decisive


def test_stretch_is_that_of_camera_and_frame_by_their_errors():
    """Exact: the mean by inverse variances; a mistake has little weight."""
    shutter, v = RollingShutter(0.002, 0.05), np.array([50.0, 0.0])
    own = np.array([0.04, 0.05]), 1e-4 * np.eye(2)
    assert shutter.stretch(v)[0] == pytest.approx((0.0, 0.05))
    share = 0.05**2 / (1e-4 + 0.05**2)
    assert shutter.stretch(v, own)[0] == pytest.approx((0.04 * share, 0.05))
    mistake = np.array([5.0, 0.05]), 0.05**2 * np.eye(2)
    assert shutter.stretch(v, mistake)[0][0] < 0.02


def test_cost_of_a_fitted_stretch_is_its_occam_factor():
    """Oracle: the integral over stretches of likelihood and prior, on a grid."""
    shutter, v, std = RollingShutter(0.002, 0.05), np.array([50.0, 0.0]), 0.03
    own = np.array([0.06, 0.02]), std**2 * np.eye(2)
    at, cost = shutter.stretch(v, own)

    def likelihood(s):
        return np.exp(-0.5 * np.sum((s - own[0]) ** 2, axis=-1) / std**2)

    grid = np.stack(np.meshgrid(*[np.linspace(-0.4, 0.5, 400)] * 2), axis=-1)
    prior = np.exp(-0.5 * np.sum((grid - shutter.stretch(v)[0]) ** 2, axis=-1) / 0.05**2)
    mean = float(np.sum(prior * likelihood(grid)) / np.sum(prior))
    assert cost == pytest.approx(-np.log(mean / likelihood(at)), rel=1e-3)
