"""A sweep in the light before its file compressed it: where it ends, and how well it is known."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.radiometry import SRGB, Compression, with_noise
from blurmatte.rendering import Ball, Camera, Scene, Shot, colorful_plate, render
from blurmatte.streaks import Streak, require_streaks
from blurmatte.sweep import fit_sweep
from blurmatte.sweep.fit.jpeg_correction import _blocks, corrected_for_jpeg
from blurmatte.sweep.fit.levenberg_marquardt import descend, seen, state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.fit.multistart import Search
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.sweep.model.student_t import VARIANCE
from blurmatte.trajectory import Trajectory

RADIUS = 9
PLATE = colorful_plate((160, 112), 2, tile=20)
SCENE = Scene(PLATE, Trajectory.line((66, 50), (84, 58)), Ball(RADIUS, (0.25, 0.7, 0.12)))
NOISE = 2 / 255


@pytest.fixture(scope="module")
def truth():
    return render(SCENE, 160)


def taken(truth, seed, **camera):
    """Image and plate of a JPEG camera."""
    file = Camera(code_std=NOISE, **({"jpeg_quality": 90, "chroma": "4:2:0"} | camera))
    return with_noise(*Shot(SCENE, file, plate_frames=5, seed=seed).photograph(truth))


@pytest.fixture(scope="module")
def found(truth):
    """A search, and where a disc ends in the light as it was found."""
    image, plate = taken(truth, 1)
    search = Search.of(require_streaks(image, plate)[0], image, plate, None)
    return search, search.best(1)


def numbers(state):
    return np.concatenate([state.path, state.shape[:1]])


def test_it_ends_where_doing_so_again_and_again_does(found):
    """Oracle: 25 times what the sweep tells is put into the light, and found again there."""
    search, first = found
    end, state, covariance = corrected_for_jpeg(search, first, search.data.bled(SRGB))
    n = len(numbers(state))
    std = np.sqrt(np.diag(covariance)[:n])
    data, bled = search.data, search.data.bled(SRGB)
    slow = seen(data, first)
    for _ in range(25):
        before = data.with_light(bled.before(slow.swept.alpha, slow.frame.within))
        slow = descend(before, seen(before, slow), end.bounds)
    off = np.abs(numbers(slow) - numbers(state)) / std
    assert off.max() < 0.6  # what a file rounds makes steps of a quarter of that
    twice = data.with_light(bled.before(first.swept.alpha, first.frame.within))
    early = descend(twice, seen(twice, first), end.bounds)
    assert np.abs(numbers(early) - numbers(state)).max() > 0.05


def test_what_a_file_did_not_keep_is_not_known(found):
    """Invariant: less is known than pixels would tell if the file had kept all of them."""
    search, first = found
    end, state, covariance = corrected_for_jpeg(search, first, search.data.bled(SRGB))
    H, _ = state.information(end.data)
    full = np.diag(np.linalg.inv(H))
    assert (np.diag(covariance) > full).all()
    assert_allclose(covariance, covariance.T, atol=1e-12)


def test_a_state_that_has_not_converged_has_no_covariance(found):
    search, first = found
    tight = replace(search, bounds=(2 * RADIUS, 3 * RADIUS))
    far = replace(first, shape=np.array([4.0 * RADIUS, *first.shape[1:]]))
    _, state, covariance = corrected_for_jpeg(tight, far, tight.data.bled(SRGB))
    assert (covariance is None) == (not state.converged)


def test_radius_std_is_the_scatter_of_the_radius(truth):
    """Honest: a covariance is local, so that each descent starts at the truth."""
    z = []
    for seed in range(24):
        image, plate = taken(truth, seed)
        search = Search.of(Streak(truth.layer.alpha > 0), image, plate, None)
        frame = Frame.of(np.array(SCENE.body.color)[:, None])
        ends, shape = SCENE.trajectory.xy.ravel(), DISC.start(RADIUS)
        start = descend(
            search.data, state_at(search.data, LINE, ends, DISC, shape, frame), search.bounds
        )
        _, state, covariance = corrected_for_jpeg(search, start, search.data.bled(SRGB))
        radius = len(ends)
        z.append((state.shape[0] - RADIUS) / np.sqrt(VARIANCE * covariance[radius, radius]))
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.4


@pytest.mark.battery
def test_errors_are_what_they_are_claimed_to_be(truth):
    """Honest: of small balls whose rims are a few shared colors wide."""
    sweeps = [fit_sweep(*taken(truth, seed)) for seed in range(8)]
    off = [(s.radius - RADIUS) / s.radius_std for s in sweeps]
    assert 0.2 < np.sqrt(np.mean(np.square(off))) < 1.6
    assert all(s.silhouette.order == 1 for s in sweeps)
    alpha = [
        np.sqrt(np.mean((s.alpha - truth.layer.alpha)[truth.layer.alpha > 0] ** 2)) for s in sweeps
    ]
    assert np.median(alpha) < 0.015


def test_blocks_are_those_of_the_file():
    """Oracle: of a part of a picture that begins within a block."""
    steps = ((1,) * 8,) * 8
    compression = Compression(steps, steps, (2, 1), (37, 13))
    blocks = _blocks(compression, (20, 40))
    for y in range(20):
        for x in range(40):
            same = (blocks[y, x] == blocks[0, 0]) == ((y + 13) // 8 == 1 and (x + 37) // 16 == 2)
            assert same
    assert len(np.unique(blocks)) == 4 * 3
