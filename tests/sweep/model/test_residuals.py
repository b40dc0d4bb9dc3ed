"""The verdict: what residuals say about sweeps that are right, and about wrong ones."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.radiometry import with_noise
from blurmatte.rendering import (
    Ball,
    Camera,
    Change,
    Scene,
    Sheet,
    Shot,
    colorful_plate,
    plain_plate,
    render,
)
from blurmatte.streaks import Streak
from blurmatte.sweep import MAX_MISFIT, verdict
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.fit.levenberg_marquardt import descend, seen, state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, LINE, PARABOLA
from blurmatte.sweep.model.silhouette import DISC
from blurmatte.sweep.model.residual_statistics import (
    BRIGHTEST,
    beyond_file,
    can_be,
    coherence,
    colors_ran_together,
    doubtful_share,
    left_beyond_noise,
    mean_light,
    means_something,
    misfit,
    mostly_seen,
    objection,
    shared_coherence,
    unclaimed_light,
    understated,
)
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
GREEN = np.array([0.25, 0.7, 0.12])
WALL = plain_plate(SIZE, (0.34, 0.33, 0.3), 4)
TILES = colorful_plate(SIZE, 2, tile=20)
WAY = Trajectory.line((44, 42), (112, 68))
BALL = Scene(WALL, WAY, Ball(11, GREEN))
PALE = Scene(WALL, WAY, Ball(11, np.array([0.9, 0.95, 0.7]), ambient=0.9))
SQUARE = Scene(WALL, WAY, Sheet(24, 24, GREEN), Change(turned=(0, 0, 0.4)))
CAMERA = Camera(code_std=1.5 / 255)


@cache
def rendered(scene):
    return render(scene, 200)


def taken(scene, seed=0, camera=CAMERA):
    """The data around a streak, photographed."""
    shot = Shot(scene, camera, plate_frames=3, seed=seed)
    truth = rendered(scene)
    image, plate = with_noise(*shot.photograph(truth))
    return observation_around(Streak(truth.layer.alpha > 0), 12, image, plate, None)


def disc(data, path=WAY, radius=11.0, color=GREEN):
    """A disc on a line, as it is."""
    frame = Frame.of(color[:, None])
    ends = path.xy[[0, -1]].ravel()
    return state_at(data, LINE, ends, DISC, DISC.start(radius), frame)


def fitted(data, bounds=(3, 40)):
    """The nearest disc that fits best to the data of something on the line."""
    return descend(data, disc(data), bounds)


@pytest.mark.parametrize("plate", [WALL, TILES], ids=["wall", "tiles"])
@pytest.mark.parametrize("seed", range(3))
def test_a_right_sweep_leaves_noise(plate, seed):
    data = taken(BALL if plate is WALL else replace(BALL, plate=plate), seed)
    state = fitted(data)
    assert 0.6 < misfit(data, state) < 1.3
    assert coherence(data, state) < 1.6
    assert doubtful_share(data, state) < 0.01


def test_a_square_is_no_disc():
    data = taken(SQUARE)
    state = fitted(data)
    assert state.converged
    assert misfit(data, state) > MAX_MISFIT
    assert coherence(data, state) > 2


@pytest.mark.parametrize("seed", range(3))
def test_noise_of_a_jpeg_is_no_misfit(seed):
    """Residuals of a right sweep hang together too, but no more than those beside it."""
    data = taken(BALL, seed, replace(CAMERA, jpeg_quality=85, chroma="4:2:0"))
    state = fitted(data)
    assert coherence(data, state) > MAX_MISFIT > misfit(data, state)


@pytest.mark.parametrize("share", [0.4, 0.6])
def test_what_lies_mostly_where_nothing_is_known_is_no_answer(share):
    data = taken(BALL)
    alpha = fitted(data).swept.alpha
    columns = np.cumsum(alpha.sum(axis=0)) < share * alpha.sum()
    valid = data.valid & ~columns
    data = replace(data, valid=valid, weight=data.weight * valid)
    state = fitted(data)
    assert mostly_seen(data, state) == (share < 0.5)
    assert ("tells nothing" in objection(data, state)) == (share > 0.5)


GRAY = plain_plate(SIZE, (0.2, 0.2, 0.2), 4)


@pytest.mark.parametrize("seed", range(3))
def test_what_compression_spares_beside_a_streak_is_no_misfit_within(seed):
    """Honest: a gray wall has no color to be lost, and its noise says nothing about a green ball's."""
    camera = replace(CAMERA, jpeg_quality=90, chroma="4:2:0")
    ball = taken(replace(BALL, plate=GRAY), seed, camera)
    assert misfit(ball, fitted(ball)) < MAX_MISFIT
    large = taken(replace(SQUARE, plate=GRAY, body=Sheet(52, 36, GREEN)), seed, camera)
    assert misfit(large, fitted(large)) > MAX_MISFIT


@pytest.mark.parametrize(("rough", "least", "most"), [(1.0, 0.7, 1.4), (1.6, 1.5, 2.56)])
def test_what_is_left_is_compared_with_what_the_file_makes_of_noise(rough, least, most):
    """Residuals that are so many times as large are up to that squared, for they are limited."""
    data = taken(BALL)
    state = disc(data)
    others = [taken(BALL, seed=seed) for seed in (1, 2, 3)]
    alpha = state.swept.alpha
    model = (1 - alpha)[..., None] * data.B + alpha[..., None] * mean_light(data, state)
    within = data.with_light(
        np.where(alpha[..., None] > 0, model + rough * (data.C - model), data.C)
    )
    everywhere = data.with_light(model + rough * (data.C - model))
    assert least < beyond_file(within, seen(within, state), others) < most
    assert_allclose(beyond_file(everywhere, seen(everywhere, state), others), 1, rtol=0.35)


@pytest.mark.parametrize("quality", [95, 90])
def test_noise_of_a_fine_file_is_not_louder_than_it_seems(quality):
    """Many pixels contradict where it is: of a file that says nothing of itself that may be noise."""
    camera = Camera(code_std=1.5 / 255, jpeg_quality=quality, chroma="4:2:0")
    data = taken(BALL, camera=camera).raised(0.1)
    state = disc(data)
    assert doubtful_share(data, state) > 0.25
    assert understated(data, state) == 1
    assert understated(replace(data, compression=None), state) > 1


@pytest.mark.parametrize(("quality", "fine"), [(None, False), (95, True), (88, True), (85, False)])
def test_fine_files_have_small_steps(quality, fine):
    assert taken(BALL, camera=Camera(jpeg_quality=quality, chroma="4:2:0")).of_fine_file == fine


@pytest.mark.parametrize("scale", [1, 2])
@pytest.mark.parametrize("size", [4, 8])
def test_shared_colors_hang_together_as_simulated_ones_do(size, scale):
    """Oracle: white noise of every other pixel, interpolated between, and summed over blocks."""
    pixels = np.random.default_rng(0).standard_normal((600, 600))
    for _ in "xy":
        before, after = np.roll(pixels, 1, axis=0), np.roll(pixels, -1, axis=0)
        twice = np.stack([3 * pixels + before, 3 * pixels + after], axis=1)
        pixels = twice.reshape(-1, pixels.shape[1]).T
    h, w = (side // scale for side in pixels.shape)
    pixels = pixels.reshape(h, scale, w, scale).mean(axis=(1, 3))
    n = len(pixels) // size * size
    blocks = pixels[:n, :n].reshape(n // size, size, n // size, size).sum(axis=(1, 3))
    simulated = np.mean(blocks**2) / (size**2 * np.mean(pixels**2))
    assert_allclose(shared_coherence(size, scale), simulated, rtol=0.08)


def test_it_does_not_matter_how_well_the_noise_is_known():
    data = taken(BALL)
    loud = replace(data, C_variance=4 * data.C_variance, B_variance=4 * data.B_variance)
    state = fitted(data)
    again = descend(loud, disc(loud, WAY, state.shape[0]), (3, 40))
    assert_allclose(misfit(loud, again), misfit(data, state), rtol=0.15)


def test_a_shape_that_is_too_small_is_too_bright():
    data = taken(PALE)
    small = replace(disc(data, WAY, 4.0), converged=True)
    assert means_something(data, small)
    assert mean_light(data, small).max() > BRIGHTEST
    assert misfit(data, small) == np.inf
    assert 0.5 < mean_light(data, fitted(data)).max() < BRIGHTEST


def test_brightness_is_the_mean_light_of_the_brightest_channel():
    data = taken(BALL)
    light = rendered(BALL).layer
    true = light.premultiplied.sum(axis=(0, 1)).max() / light.alpha.sum()
    assert_allclose(mean_light(data, disc(data)).max(), true, rtol=0.03)


def test_a_path_must_stay_in_the_streak():
    data = taken(BALL)
    detour = np.array([44, 42, 48, 115, 78, 55, 112, 68.0])
    frame = Frame.of(GREEN[:, None])
    state = state_at(data, CUBIC, detour, DISC, DISC.start(11), frame)
    assert not means_something(data, state)
    assert misfit(data, replace(state, converged=True)) == np.inf
    assert means_something(data, disc(data))


def test_a_path_may_leave_the_picture():
    leaves = replace(BALL, trajectory=Trajectory.line((112, 42), (170, 60)))
    data = taken(leaves)
    assert means_something(data, disc(data, leaves.trajectory))
    assert not means_something(data, disc(data, Trajectory.line((112, 42), (130, 110))))


def test_a_plane_must_not_hold_the_plate():
    """The object's and the wall's color together explain all that there is."""
    data = taken(BALL)
    wall = data.B.mean(axis=(0, 1))
    for other, means in ((wall, False), (np.array([0.7, 0.1, 0.1]), True)):
        frame = Frame.of(np.stack([GREEN, other], axis=1))
        state = replace(disc(data), frame=frame)
        assert means_something(data, state) is means


def test_a_descent_without_an_end_is_not_believed():
    data = taken(BALL)
    state = fitted(data)
    endless = replace(state, converged=False)
    assert misfit(data, endless) == np.inf
    assert "not determined" in objection(data, endless)
    assert objection(data, replace(state, converged=True)) == ""


def with_residuals(state, smooth, seed):
    """The same state, all of its residuals of unit variance, hanging together over some pixels."""
    from scipy.ndimage import gaussian_filter

    e = np.random.default_rng(seed).normal(size=state.e.shape)
    if smooth:
        e = gaussian_filter(e, (0, smooth, smooth))
        e /= e.std()
    e[2] = 0
    return replace(state, e=e)


def test_coherence_counts_pixels_that_say_the_same():
    """With a Gaussian of s pixels about 4π s² of them hang together, but no more than a block's."""
    data = taken(BALL)
    state = disc(data)
    white = [coherence(data, with_residuals(state, 0, seed)) for seed in range(6)]
    assert 0.85 < np.mean(white) < 1.25
    alike = [
        np.mean([coherence(data, with_residuals(state, s, seed)) for seed in range(6)])
        for s in (1, 2, 4)
    ]
    assert 4 < alike[0] < 4 * np.pi
    assert alike[0] < alike[1] < alike[2]
    assert alike[2] > 20


def test_noise_that_hangs_together_everywhere_is_no_misfit():
    data = taken(BALL)
    state = replace(fitted(data), converged=True)
    smooth = [misfit(data, with_residuals(state, 1, seed)) for seed in range(4)]
    assert np.mean(smooth) < MAX_MISFIT


def test_doubtful_is_what_the_sweep_does_not_explain():
    data = taken(BALL)
    state = fitted(data)
    C, inside = data.C.copy(), state.swept.alpha > 0
    rows = np.flatnonzero(inside.any(axis=1))
    C[rows[0] : rows[len(rows) // 2]] = (0.9, 0.1, 0.9)
    hidden = state_at(replace(data, C=C), LINE, state.path, DISC, state.shape, state.frame)
    share = inside[rows[0] : rows[len(rows) // 2]].sum() / inside.sum()
    assert_allclose(doubtful_share(data, hidden), share, atol=0.02)
    nowhere = state_at(data, LINE, np.array([-80.0, -80, -60, -60]), DISC, state.shape, state.frame)
    assert doubtful_share(data, nowhere) == 1


def test_what_goes_over_the_same_ground_again_and_again_means_nothing():
    """A Z and a loop narrower than the object; all around a wide circle, and back once, things go."""
    data = taken(BALL)

    def goes(family, path, radius):
        frame = Frame.of(GREEN[:, None])
        state = state_at(data, family, np.array(path, float), DISC, DISC.start(radius), frame)
        return means_something(data, state)

    zigzag = [68, 45, 96, 57, 60, 53, 88, 65]
    assert not goes(CUBIC, zigzag, 11)
    assert goes(CUBIC, zigzag, 2)
    around = [78, 46, 78.5, 46, 20]  # start, end, and how far its middle is off them
    assert not goes(ARC, around, 11)
    assert goes(ARC, around, 3)
    assert goes(PARABOLA, [60, 48, 88, 60, 60, 48], 11)


def test_there_and_back_within_a_radius_is_no_bounce():
    """door: a line leaves the same alpha; beyond it a ball may have come back the way that it went."""
    data = taken(BALL)
    frame = Frame.of(GREEN[:, None])
    for length, means in ((8.0, False), (24.0, True)):
        path = np.array([78, 55, 78 + length, 55, 78, 55, 0.5])
        state = state_at(data, BOUNCE, path, DISC, DISC.start(11.0), frame)
        assert means_something(data, state) is means


def test_a_plane_with_the_plates_color_in_most_places_means_nothing():
    data = taken(BALL)
    plane = Frame.of(np.stack([GREEN, data.B.mean(axis=(0, 1))], axis=1))
    right = disc(data)
    assert means_something(data, right)
    assert not means_something(data, replace(right, frame=plane))


def test_a_plane_must_claim_the_light_of_its_colors(monkeypatch):
    """What lies in the plane is light of no object where alpha is 0."""
    data = taken(Scene(TILES, WAY, Ball(11, GREEN)))
    plane = Frame.of(np.stack([GREEN, [0.9, 0.1, 0.1]], axis=1))
    ends = WAY.xy[[0, -1]]
    right, half = (
        state_at(data, LINE, path.ravel(), DISC, DISC.start(11.0), plane)
        for path in (ends, np.array([ends[0], ends.mean(axis=0)]))
    )
    assert unclaimed_light(data, right) < 0.01
    assert 0.2 < unclaimed_light(data, half) < 0.5
    right = replace(right, converged=True)
    assert misfit(data, right) <= MAX_MISFIT
    monkeypatch.setattr(verdict, "unclaimed_light", lambda data, state: 0.2)
    assert np.isinf(misfit(data, right))
    assert "leaves 20% of what changed" in objection(data, right)
    line = replace(disc(data), converged=True)  # of which light elsewhere is no light of its color
    assert misfit(data, line) <= MAX_MISFIT


def test_a_plane_must_explain_every_place(monkeypatch):
    """Where two things of one plane met, it leaves much in a few blocks."""
    data = taken(Scene(TILES, WAY, Ball(11, GREEN)))
    line, plane = disc(data), Frame.of(np.stack([GREEN, [0.9, 0.1, 0.1]], axis=1))
    alpha = line.swept.alpha
    middle = np.unravel_index(np.argmax(alpha), alpha.shape)
    spot = np.hypot(*(np.indices(alpha.shape).T - middle).T) < 3
    assert np.all(alpha[spot] > 0.2)
    marked = replace(data, C=data.C + 0.06 * spot[..., None] * plane.across[:, 0])

    def left(data, frame):
        return left_beyond_noise(data, seen(data, replace(line, frame=frame)))

    assert left(data, plane) < MAX_MISFIT < left(marked, plane)
    assert left(marked, line.frame) < MAX_MISFIT  # a hole, or a highlight of one paint


def test_a_color_of_negative_light_cannot_be():
    data = taken(BALL)
    right = disc(data)
    assert can_be(data, right)
    darker = replace(
        data, C=data.C - np.where(right.swept.alpha > 0, 0.1, 0)[..., None] * [0, 0, 1]
    )
    assert not can_be(darker, disc(darker))


@pytest.mark.parametrize("quality", [None, 100, 90])
@pytest.mark.parametrize("chroma", ["4:2:0", "4:2:2"])
def test_files_that_share_color_are_known_by_its_noise(chroma, quality):
    camera = replace(CAMERA, jpeg_quality=quality, chroma=chroma)
    data = taken(BALL, camera=camera)
    assert colors_ran_together(data, fitted(data))


def test_noise_of_single_pixels_is_no_file_s():
    """Also where light changed slowly."""
    data = taken(BALL)
    found = fitted(data)
    assert not colors_ran_together(data, found)
    ramp = np.linspace(0, 0.05, data.C.shape[1])[:, None]
    assert not colors_ran_together(replace(data, C=data.C * (1 + ramp)), found)
