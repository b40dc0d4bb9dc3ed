"""places_in_space, fit_balls: 3-D positions and velocities of a ball in a clip, and their errors."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.rendered import render_flight
from numpy.testing import assert_allclose
from tests.motion.clip.sightings import sighted

import blurmatte as bm
from blurmatte.checks import DIRECTIONS
from blurmatte.motion.clip import balls
from blurmatte.motion.picture.error_budget import Source
from blurmatte.motion.space.ball_motion import ball_motion
from blurmatte.motion.space.perspective_ball import positions, positions_of_discs
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.radiometry.coded import coded
from blurmatte.rendering import colorful_plate

LENS = bm.Intrinsics(900, 905, 640, 360, np.array([-0.1, 0.02, 1e-3, 0]))
RADIUS = 0.03
FLAT = bm.Intrinsics(900, 905, 640, 360)
START, VELOCITY = np.array([-0.8, 0.3, 3.0]), np.array([3.0, -4.0, 1.5])
GRAVITY = np.array([0.5, 9.6, 1.9])
TIMES = np.array([0, 1, 2, 4, 5, 8]) / 30  # frames may be missing


def at(t):
    return START + t * VELOCITY + t**2 / 2 * GRAVITY


def sighting(x, y, radius, std=(0.05, 0.02), doubts=(), readout="down"):
    return sighted(
        (x, y), std=std[0], radius=radius, radius_std=std[1], doubts=doubts, readout=readout
    )


def row(k, t, one, track=1):
    return bm.motion.FrameMotion(k, t, one, track, True, object=1)


def fitted(X, true, lens, radius, rng=None, noise=(0.05, 0.02)):
    """A ball fitted to a picture of the camera `true`, with the assumed camera and radius."""
    pixels = np.tile(true.project(X[None]), (3, 1))
    size = RADIUS * true.magnification(pixels)[:1] / np.linalg.norm(X)
    values = np.concatenate([pixels.ravel(), size])
    errors = np.concatenate([np.full(6, noise[0]), [noise[1]]])
    if rng is not None:
        values = values + errors * rng.standard_normal(7)

    def nodes(p, camera):
        return positions(lens.with_values(camera), p[:6].reshape(3, 2), np.full(3, p[6]))

    return ball_motion(nodes, Source(values, np.diag(errors**2)), lens, radius, (None, 0), "line")


def clip(true=LENS, lens=LENS, radius=(RADIUS, 0.0), rng=None):
    balls = [fitted(at(t), true, lens, radius, rng) for t in TIMES]
    rows = [row(k, float(t), sighting(640, 360, 9)) for k, t in enumerate(TIMES)]
    return bm.motion.places_in_space(rows, lens, *radius, balls=balls)


def test_positions_and_velocities_of_flight():
    """Exact: for constant acceleration and uneven times, also at both ends."""
    places = clip()
    assert_allclose([ball.place for ball in places], [at(t) for t in TIMES], atol=1e-9)
    true = [VELOCITY + t * GRAVITY for t in TIMES]
    assert_allclose([ball.velocity for ball in places], true, atol=1e-6)
    assert_allclose([ball.speed for ball in places], np.linalg.norm(true, axis=1))
    numbers = places[2].numbers()
    assert tuple(numbers) == bm.motion.BallPlace.names
    assert numbers["ball_z"] == places[2].place[2]
    assert numbers["ball_velocity_y_std"] == places[2].velocity_std[1]
    assert numbers["ball_source"] == "ball"


def test_errors_have_unit_z_scores():
    """Honest: independent noise of pictures, and shared errors of radius and camera."""
    spread = np.diag([9.0, 9, 16, 16])
    known = replace(FLAT, covariance=spread)
    rng, z, of_velocity, of_speed = np.random.default_rng(0), [], [], []
    for _ in range(14):
        lens = known.with_values(FLAT.values + np.sqrt(np.diag(spread)) * rng.standard_normal(4))
        radius = RADIUS * (1 + 0.02 * rng.standard_normal())
        places = clip(FLAT, lens, (radius, 0.02 * RADIUS), rng)
        for ball, t in zip(places, TIMES, strict=True):
            v = VELOCITY + t * GRAVITY
            z.append((ball.place - at(t)) / ball.place_std)
            of_velocity.append((ball.velocity - v) / ball.velocity_std)
            of_speed.append((ball.speed - np.linalg.norm(v)) / ball.speed_std)
    for scores in (z, of_velocity, of_speed):
        assert_allclose(np.sqrt(np.mean(np.square(scores), axis=0)), 1, atol=0.2)


def test_position_from_disc_without_fitted_ball():
    """Oracle: the closed form, its source, and the error of the distance."""
    places = bm.motion.places_in_space([row(0, 0.0, sighting(700, 300, 9.0))], LENS, RADIUS)
    X = RADIUS * positions_of_discs(LENS, np.array([[700.0, 300.0]]), 9.0)[0]
    assert_allclose(places[0].place, X)
    assert places[0].distance_std / places[0].distance == pytest.approx(0.02 / 9, rel=0.01)
    assert (places[0].source, places[0].velocity) == ("sweep", None)
    assert places[0].numbers()["ball_velocity_x"] is None
    with pytest.raises(
        bm.errors.MotionError, match="a velocity needs the position in two more frames"
    ):
        _ = places[0].speed


def test_doubtful_positions_do_not_change_velocities():
    """Exact: a doubtful position, a lost frame and another track do not change velocities."""
    rows = [row(k, k / 30, sighting(600 + 9 * k, 300, 9.0)) for k in range(6)]
    sound = bm.motion.places_in_space(rows, LENS, RADIUS)
    odd = row(6, 0.2, sighting(900, 100, 4.0, doubts=("Hidden.",)))
    other = row(8, 8 / 30, sighting(300, 300, 9.0), track=2)
    more = bm.motion.places_in_space([*rows, odd, row(7, 7 / 30, None), other], LENS, RADIUS)
    assert_allclose([b.velocity for b in more[:6]], [b.velocity for b in sound])
    assert more[6].doubted
    assert more[6].velocity is None
    assert more[7] is None
    assert more[8].velocity is None


@pytest.mark.parametrize("readout", ["down", "up"])
def test_rolling_shutter_delays_later_rows(readout):
    """Exact: each position at the time of its row."""
    tau, rows, balls = 2e-5, [], []
    for k in range(5):
        t = k / 30
        for _ in range(9):
            y = float(FLAT.project(at(t)[None])[0, 1])
            t = k / 30 + tau * y * DIRECTIONS[readout][1]
        balls.append(fitted(at(t), FLAT, FLAT, (RADIUS, 0.0)))
        rows.append(row(k, k / 30, sighting(640, y, 9, readout=readout)))
    seen = bm.motion.places_in_space(rows, FLAT, RADIUS, balls=balls, line_time=tau)
    assert_allclose(
        [b.velocity for b in seen], [VELOCITY + b.time * GRAVITY for b in seen], atol=1e-6
    )
    assert_allclose(bm.motion.fit_fall_in_space(seen).acceleration, GRAVITY, atol=1e-5)
    unknown = bm.motion.fit_fall_in_space(
        bm.motion.places_in_space(rows, FLAT, RADIUS, balls=balls)
    )
    assert abs(unknown.size - np.linalg.norm(GRAVITY)) > 0.1


def test_fitted_ball_removes_doubts_of_moments():
    """Exact: doubts of a sweep are kept."""
    odd = sighting(700, 300, 9.0, doubts=("Not all is known.",))
    rows = [
        row(0, 0.0, replace(odd, measured=replace(odd.measured, source="moments"))),
        row(1, 0.1, odd),
    ]
    ball = fitted(at(0), LENS, LENS, (RADIUS, 0.0))
    found = bm.motion.places_in_space(rows, LENS, RADIUS, balls=[ball, ball])
    assert [place.doubted for place in found] == [False, True]
    assert bm.motion.places_in_space(rows, LENS, RADIUS)[0].doubted


def test_no_velocity_without_times_and_no_position_beyond_the_lens():
    """Exact: no velocity, and no position where the distortion has no inverse."""
    rows = [row(k, None, sighting(600 + 9 * k, 300, 9.0)) for k in range(3)]
    assert [ball.velocity for ball in bm.motion.places_in_space(rows, LENS, RADIUS)] == [None] * 3
    barrel = bm.Intrinsics(100, 100, 0, 0, np.array([-0.3, 0, 0, 0]))
    assert bm.motion.places_in_space(rows, barrel, RADIUS) == [None] * 3
    assert bm.motion.places_in_space([], LENS, RADIUS) == []


def test_fit_balls_in_rendered_frames():
    """Oracle: two rendered frames, one far off the axis: 2 % of depth, and the direction of time."""
    size, rng, known = (200, 150), np.random.default_rng(1), NoiseModel(read_std=0.003)
    lens, color = bm.Intrinsics(400, 400, 99.5, 74.5, size=size), np.array([0.8, 0.35, 0.06])
    plate = colorful_plate(size, 4, tile=25)
    ends = np.array([[[-0.08, 0.03, 0.6], [-0.12, 0.02, 0.58]], [[0, 0, 0.6], [0.03, 0, 0.6]]])
    frames, rows = [], []
    for k, (a, b) in enumerate(ends):
        X = a + np.linspace(0.005, 0.995, 100)[:, None] * (b - a)
        light = render_flight(plate, lens, X, 0.02, color)[0].rgb
        frames.append(LinearImage(light + 0.003 * rng.standard_normal(light.shape), noise=known))
        first, last = lens.project(np.array([a, b])) + 0.4
        middle = (first + last) / 2
        one = sighted(middle, last - first, radius=13.5, ends=(first, last))
        rows.append(row(k, k / 30, one))
    frames.append(frames[0])
    rows += [row(2, 2 / 30, sighted(middle, source="moments"))]
    model = bm.ColorModel.from_samples(color, std=0)
    empty = LinearImage(plate, noise=known)
    found = list(bm.motion.fit_balls(frames, empty, rows, model, lens, 0.02))
    assert found[2] is None
    for ball, (a, b) in zip(found, ends, strict=False):
        off = ball.positions - [a, (a + b) / 2, b]
        assert np.abs(off / ball.positions_std).max() < 4.5
        assert abs(ball.depth / (a + b)[2] * 2 - 1) < 0.02
    any_color = bm.motion.fit_balls(frames, empty, rows, bm.ColorModel.any(), lens, 0.02)
    assert list(any_color) == [None] * 3


def test_invalid_input_is_rejected():
    """Door: no radius, a negative error, intrinsics of another size."""
    rows = [row(0, 0.0, sighting(700, 300, 9.0))]
    with pytest.raises(ValueError, match="radius must be finite and above 0, got 0"):
        bm.motion.places_in_space(rows, LENS, 0)
    with pytest.raises(ValueError, match="radius_std must be finite and not negative"):
        bm.motion.places_in_space(rows, LENS, RADIUS, -1)
    with pytest.raises(ValueError, match="line_time must be finite seconds, got inf"):
        bm.motion.places_in_space(rows, LENS, RADIUS, line_time=np.inf)
    with pytest.raises(ValueError, match="is it in microseconds"):
        bm.motion.places_in_space(rows, LENS, RADIUS, line_time=15e-3)
    other = replace(LENS, size=(1280, 720))
    image = LinearImage(np.zeros((4, 6, 3)))
    with pytest.raises(
        ValueError, match="calibrated with pictures of 1280x720 pixels, and this has 6x4"
    ):
        list(bm.motion.fit_balls([image], image, rows, bm.ColorModel.any(), other, RADIUS))


class Damaged(list):
    """Frames of a clip, of which number 1 cannot be decoded."""

    numbers, times = range(3), None
    as_codes = coding_errors = parts = None

    def coded(self, which):
        return (coded(n, self[n]) for n in (0, 2))


def test_balls_belong_to_the_rows_of_their_frames(monkeypatch):
    """Exact: a frame in the middle that cannot be decoded shifts no others."""
    size = 40, 30
    known = NoiseModel(read_std=0.003)
    frames = Damaged(LinearImage(np.full((30, 40, 3), 0.1 * k), noise=known) for k in range(3))
    seen = sighting(20, 15, 5)
    rows = [row(k, k / 30, seen if k != 1 else None) for k in range(3)]
    monkeypatch.setattr(balls, "fit_ball", lambda image, *_, **__: float(image.rgb.mean()))
    model = bm.ColorModel.from_samples([0.8, 0.3, 0.1], std=0)
    lens = bm.Intrinsics(60, 60, 20, 15, size=size)
    empty = LinearImage(np.full((30, 40, 3), 0.1), noise=known)
    found = list(bm.motion.fit_balls(frames, empty, rows, model, lens, 0.02))
    assert found == [pytest.approx(0.0), None, pytest.approx(0.2)]
