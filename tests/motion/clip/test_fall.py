"""fit_fall, fit_fall_in_space with a known gravity: scale, distance, errors, and rejections."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.motion.clip.sightings import sighted

import blurmatte as bm
from blurmatte.checks import DIRECTIONS
from blurmatte.motion.clip.positions_3d import BallPlace
from blurmatte.motion.picture.error_budget import Source
from blurmatte.motion.space.ball_motion import ball_motion
from blurmatte.motion.space.perspective_ball import positions

G = 9.81
RATE, SCALE = 30, 0.004  # frames per second, meters per pixel
LENS = bm.Intrinsics(900, 905, 640, 360)
RADIUS, DISTANCE = 0.03, 3.0


def sighting(place, std=0.1, readout="down"):
    return sighted(place, std=std, length_std=std, radius_std=std, readout=readout)


def flight(rng, acceleration=(0, G / SCALE), count=9, std=0.1):
    """Rows of a flight with noisy positions."""
    t = np.arange(count) / RATE
    places = 60 * t[:, None] * (4, -5) + t[:, None] ** 2 / 2 * np.array(acceleration)
    places = places + rng.normal(0, std, places.shape)
    return [
        bm.motion.FrameMotion(k, float(t[k]), sighting(places[k], std), 1, True)
        for k in range(count)
    ]


def test_gravity_gives_the_scale():
    """Honest: over many flights; the error of gravity is included."""
    rng = np.random.default_rng(0)
    falls = [bm.motion.fit_fall(flight(rng), gravity=G) for _ in range(200)]
    z = [(fall.scale.meters_per_pixel - SCALE) / fall.scale.std for fall in falls]
    assert np.std(z) == pytest.approx(1, abs=0.15)
    assert abs(np.mean(z)) < 0.2
    unsure = bm.motion.fit_fall(flight(np.random.default_rng(0)), gravity=G, gravity_std=0.5)
    relative = [fall.scale.std / fall.scale.meters_per_pixel for fall in (falls[0], unsure)]
    assert relative[1] == pytest.approx(np.hypot(relative[0], 0.5 / G))
    said = " ".join(bm.explain(falls[0]))
    assert "With a gravity of 9.81 m/s² a pixel is 4.0" in said
    assert falls[0].numbers()["meters_per_pixel"] == falls[0].scale.meters_per_pixel


@pytest.mark.parametrize("readout", DIRECTIONS)
def test_rolling_shutter_delays_later_rows(readout):
    """Exact: each position at the time of its row; without line_time the acceleration is wrong."""
    tau, rows = 2e-5, []
    velocity, acceleration = np.array([240.0, -300.0]), np.array([0, G / SCALE])
    for k in range(9):
        t = k / RATE
        for _ in range(50):  # until the row is exposed when the ball is there
            place = 50 + velocity * t + acceleration * t**2 / 2
            t = k / RATE + tau * place @ DIRECTIONS[readout]
        seen = sighting(place, readout=readout)
        rows.append(bm.motion.FrameMotion(k, k / RATE, seen, 1, True))
    fall = bm.motion.fit_fall(rows, line_time=tau)
    assert_allclose(fall.acceleration, acceleration, atol=1e-6)
    assert not np.allclose(bm.motion.fit_fall(rows).acceleration, acceleration, rtol=1e-3)
    with pytest.raises(ValueError, match="line_time must be finite seconds, got nan"):
        bm.motion.fit_fall(rows, line_time=np.nan)
    with pytest.raises(
        ValueError, match=r"a frame must be read within .* s; is it in microseconds"
    ):
        bm.motion.fit_fall(rows, line_time=2e-3)


def test_scatter_replaces_too_small_errors():
    """Honest: positions with ten times the stated errors, as in a compressed clip; most fit."""
    rng, z = np.random.default_rng(8), []
    for _ in range(150):
        rows = [
            replace(row, sighting=replace(row.sighting, place_scatter=0.1))
            for row in flight(rng, count=12, std=0.3)
        ]
        fall = bm.motion.fit_fall(rows, bm.Scale(SCALE), G)
        if fall.fits:
            assert fall.overscatter > 3
            z.append((fall.lengths[0] - 1) / fall.lengths[1])
    assert len(z) > 140
    assert np.std(z) == pytest.approx(1, abs=0.2)
    assert "the errors used are their scatter" in bm.explain(fall)[0]
    few = bm.motion.fit_fall(rows[:6])
    assert not few.fits


def test_rejects_bounce_with_noise():
    """Exact: down and up again, with noise beyond the errors."""
    rng, t = np.random.default_rng(9), np.arange(11) - 5.0
    places = np.stack([12 * t, 300 - 20 * abs(t)], axis=1) + rng.normal(0, 0.5, (11, 2))
    rows = [bm.motion.FrameMotion(k, k / RATE, sighting(p), 1) for k, p in enumerate(places)]
    assert not bm.motion.fit_fall(rows).fits


def test_rejects_path_around_circle():
    """Exact: a ball on a string, which no polynomial of low order explains."""
    t = np.arange(60)
    places = 100 + 50 * np.stack([np.cos(0.7 * t), np.sin(0.7 * t)], axis=1)
    rows = [bm.motion.FrameMotion(k, k / RATE, sighting(p), 1) for k, p in enumerate(places)]
    assert not bm.motion.fit_fall(rows).fits


def moved(row, dx, dy, doubts=(), at_border=False):
    """The row elsewhere."""
    measured = row.sighting.measured.shifted(dx, dy)
    measured = replace(measured, doubts=doubts, at_border=at_border)
    return replace(row, sighting=replace(row.sighting, measured=measured))


def test_wrong_frames_do_not_decide_a_fall():
    """Honest: one at the border, one doubtful, and one with a wrong error, all far off the parabola."""
    rng, z = np.random.default_rng(10), []
    for _ in range(60):
        rows = flight(rng, count=20)
        rows[0] = moved(rows[0], 9, 14, at_border=True)
        rows[7] = moved(rows[7], -6, 11, doubts=("It is of two parts.",))
        rows[12] = moved(rows[12], 1, 3)
        fall = bm.motion.fit_fall(rows, bm.Scale(SCALE), G)
        assert fall.fits
        assert {0, 7, 12} <= set(fall.off)
        z.append((fall.lengths[0] - 1) / fall.lengths[1])
    assert np.std(z) == pytest.approx(1, abs=0.2)
    said = " ".join(bm.explain(fall))
    assert "Frames 0, 7 and 12 have no weight: off the parabola of the others" in said
    assert fall.numbers()["frames_off"] == 3


def test_frames_off_a_fall_are_counted_and_some_are_named():
    """Exact: one frame, and many."""
    rows = flight(np.random.default_rng(11), count=30)
    rows[4] = moved(rows[4], 0, 5)
    assert "Frame 4 has no weight" in bm.explain(bm.motion.fit_fall(rows))[1]
    for k in (9, 13, 20, 21, 26):
        rows[k] = moved(rows[k], 5, 0)
    assert (
        "Frames 4, 9, 13, 20 and 2 more have no weight" in bm.explain(bm.motion.fit_fall(rows))[1]
    )


def test_fall_without_sound_frames_uses_all():
    """Exact: each has a doubt."""
    rows = [moved(row, 0, 0, doubts=("A doubt.",)) for row in flight(np.random.default_rng(12))]
    fall = bm.motion.fit_fall(rows)
    assert fall.fits
    assert fall.freedom == 12


def rolled(t):
    """A ball that rolls with friction and comes to rest after 1 s, pixels."""
    s = np.minimum(t, 1.0)
    return np.stack([50 + 400 * s - 200 * s**2, np.full(len(t), 300.0)], axis=1)


def driven(t):
    """An object on a crank."""
    return np.stack([300 + 0 * t, 200 - 80 * np.cos(2 * np.pi * t)], axis=1)


def dragged(t):
    """A light ball that air slows to its terminal velocity, 300 px/s, within a tenth of a second."""
    return np.stack([100 + 0 * t, 300 * (t + 0.1 * np.exp(-t / 0.1))], axis=1)


@pytest.mark.parametrize("path", [rolled, driven, dragged])
@pytest.mark.parametrize("stated", [0.1, 0.03])
def test_rejects_what_does_not_fall(path, stated):
    """Exact: with noise as stated, and with more; no outliers hide it."""
    t = np.arange(45) / RATE
    places = path(t) + np.random.default_rng(13).normal(0, 0.1, (45, 2))
    rows = [
        bm.motion.FrameMotion(k, float(t[k]), sighting(place, stated), 1)
        for k, place in enumerate(places)
    ]
    fall = bm.motion.fit_fall(rows)
    assert not fall.fits
    assert bm.explain(fall)[0].startswith("It does not agree with a free fall")


def test_rejects_parabolas_that_point_off_down():
    """Exact: a ball that rolls with friction and does not stop, and one at constant speed."""
    t = np.arange(20) / RATE
    noise = np.random.default_rng(14).normal(0, 0.1, (20, 2))
    rolling = [
        bm.motion.FrameMotion(k, float(t[k]), sighting(place), 1)
        for k, place in enumerate(rolled(t) + noise)
    ]
    assert bm.motion.fit_fall(rolling).fits
    (said,) = bm.explain(bm.motion.fit_fall(rolling))
    assert "It does not agree with a free fall: its acceleration points 90° off down" in said
    steady = [
        bm.motion.FrameMotion(k, float(t[k]), sighting(place), 1)
        for k, place in enumerate(300 * t[:, None] * (1, 0.3) + noise)
    ]
    (said,) = bm.explain(bm.motion.fit_fall(steady))
    assert "is not 5 times its error" in said


def test_fall_of_equal_times_is_rejected():
    """Door."""
    rows = [replace(row, time=0.5) for row in flight(np.random.default_rng(15))]
    with pytest.raises(bm.errors.MotionError, match="a fall needs 4 different times, got 1"):
        bm.motion.fit_fall(rows)


def test_gravity_in_tilted_cameras():
    """Exact: for a camera that looks down, the part parallel to the picture; for a turned one."""
    rng = np.random.default_rng(1)
    tilted = bm.motion.fit_fall(flight(rng, (0, 8 / SCALE)), gravity=(0, 8, 6))
    assert_allclose(tilted.scale.meters_per_pixel, SCALE, rtol=0.02)
    turned = bm.motion.fit_fall(flight(rng, (-G / SCALE, 0)), gravity=(-G, 0))
    assert_allclose(turned.scale.meters_per_pixel, SCALE, rtol=0.02)
    askew = (G / SCALE * np.sin(0.1), G / SCALE * np.cos(0.1))
    assert bm.motion.fit_fall(flight(rng, askew), gravity=G).rejection == ""


def test_lengths_check_a_given_scale():
    """Exact: the factor for a scale that is 10 % too small; the scale is kept."""
    fall = bm.motion.fit_fall(flight(np.random.default_rng(2)), bm.Scale(0.9 * SCALE), G, 0.01)
    ratio, std = fall.lengths
    assert abs(ratio - 1 / 0.9) < 4 * std
    assert 0.001 < std < 0.02
    assert fall.scale.meters_per_pixel == 0.9 * SCALE
    said = bm.explain(fall)
    assert "standard deviations apart" in said[1]
    assert said[2].startswith("By the fall, all lengths are 1.1")
    assert fall.numbers()["lengths_by_gravity"] == ratio
    with pytest.raises(bm.errors.MotionError, match="give both"):
        _ = bm.motion.fit_fall(flight(np.random.default_rng(2))).lengths


def test_rejected_fall_gives_no_scale():
    """Door: an arc, a straight flight, a short one, wrong directions; a given scale is kept."""
    rng = np.random.default_rng(3)
    angle = np.linspace(0, 2, 9)
    arc = [
        bm.motion.FrameMotion(k, k / RATE, sighting((60 * np.cos(a), 60 * np.sin(a))), 1)
        for k, a in enumerate(angle)
    ]
    for rows, said in (
        (arc, "times the variance of its positions: it was held"),
        (flight(rng, (0, 0)), "is not 5 times its error"),
        (flight(rng, count=4, std=3.0), "a longer flight or more frames"),
        (flight(rng, (0, -G / SCALE)), "points 180° off gravity"),
        (flight(rng, (G / SCALE, 0)), "points 90° off gravity"),
    ):
        with pytest.raises(
            bm.errors.MotionError, match="no free fall that gravity could measure"
        ) as info:
            bm.motion.fit_fall(rows, gravity=G)
        assert said in str(info.value)
        checked = bm.motion.fit_fall(rows, bm.Scale(SCALE), G)
        assert said in checked.rejection
        assert "lengths_by_gravity" not in checked.numbers()
        assert checked.rejection in " ".join(bm.explain(checked))


@pytest.mark.parametrize("gravity", [0, -G, np.inf, (1, 2, 3, 4), "down", (np.nan, 1)])
def test_invalid_gravity_is_rejected(gravity):
    """Door."""
    rows = flight(np.random.default_rng(4))
    with pytest.raises(ValueError, match=r"gravity must be a number|could not convert"):
        bm.motion.fit_fall(rows, gravity=gravity)


def test_gravity_along_axis_is_rejected():
    """Door: gravity along the optical axis; and a negative error."""
    rows = flight(np.random.default_rng(4))
    with pytest.raises(ValueError, match="gravity must have a part within the picture"):
        bm.motion.fit_fall(rows, gravity=(0, 0, G))
    with pytest.raises(ValueError, match="gravity_std must be finite and not negative"):
        bm.motion.fit_fall(rows, gravity=G, gravity_std=-1)


def balls(rng, gravity, given=RADIUS, radius_std=0.0, count=8, noise=(0.05, 0.02)):
    """BallMotions of a flight, with noise of center and radius in pixels; and their times."""
    times = np.arange(count) / RATE
    found = []
    for t in times:
        X = np.array([-0.8, 0.3, DISTANCE]) + t * np.array([3, -4, 0.5]) + t**2 / 2 * gravity
        pixels = np.tile(LENS.project(X[None]), (3, 1))
        size = RADIUS * LENS.magnification(pixels) / np.linalg.norm(X)
        errors = np.concatenate([np.full(6, noise[0]), [noise[1]]])
        values = np.concatenate([pixels.ravel(), size[:1]]) + errors * rng.standard_normal(7)

        def nodes(p, camera):
            return positions(LENS.with_values(camera), p[:6].reshape(3, 2), np.full(3, p[6]))

        picture = Source(values, np.diag(errors**2))
        found.append(ball_motion(nodes, picture, LENS, (given, radius_std), (None, 0), "disc"))
    return found, times


def test_fall_in_space_has_honest_acceleration_and_lengths():
    """Honest: a tilted camera, and a radius that is 10 % too small."""
    rng, gravity = np.random.default_rng(5), np.array([1, 9.3, 2.9])
    z, ratios, chi2 = [], [], []
    for _ in range(60):
        seen, times = balls(rng, gravity)
        fall = bm.motion.fit_fall_in_space(seen, times)
        std = np.sqrt(np.diag(fall.acceleration_covariance))
        z.append((fall.acceleration - gravity) / std)
        chi2.append(fall.chi2 / fall.freedom)
        seen, times = balls(rng, gravity, given=0.9 * RADIUS)
        ratio, ratio_std = bm.motion.fit_fall_in_space(seen, times, gravity).lengths
        ratios.append((ratio - 1 / 0.9) / ratio_std)
    assert np.std(z) == pytest.approx(1, abs=0.2)
    assert np.mean(chi2) == pytest.approx(1, abs=0.15)
    assert np.std(ratios) == pytest.approx(1, abs=0.2)
    assert abs(np.mean(ratios)) < 0.5


def test_shared_error_of_radius_does_not_average_out():
    """Exact: the relative error of the radius is in the acceleration in meters, not in `lengths`."""
    gravity = np.array([0, G, 0])
    seen, times = balls(np.random.default_rng(6), gravity, radius_std=0.05 * RADIUS)
    fall = bm.motion.fit_fall_in_space(seen, times, G)
    g, std = fall.in_meters(fall.scale)
    assert std == pytest.approx(g * np.hypot(0.05, fall.size_std / fall.size))
    assert fall.lengths[1] < 0.02
    assert fall.unit == "m"
    said = " ".join(bm.explain(fall))
    assert f"That is {g:.2f} ± {std:.2f} m/s², the errors of radius and camera included" in said
    assert "times those from the ball's radius" in said
    assert {"acceleration_z", "lengths_by_gravity"} <= fall.numbers().keys()


def places(seen, times, track=1, doubted=False):
    """BallPlaces, as from `places_in_space`."""
    return [
        replace(BallPlace.of(ball, k, t), track=track, doubted=doubted)
        for k, (ball, t) in enumerate(zip(seen, map(float, times), strict=True))
    ]


def test_positions_of_longest_track_without_doubts_are_used():
    """Exact: the same fall as from the balls; others change nothing."""
    seen, times = balls(np.random.default_rng(10), np.array([0, G, 0]))
    fall = bm.motion.fit_fall_in_space(seen, times)
    more = [*places(seen, times), None, *places(seen[:3], times[:3] + 1, track=2)]
    more += places(seen[:2], times[:2] + 2, doubted=True)
    again = bm.motion.fit_fall_in_space(more)
    assert_allclose(again.acceleration, fall.acceleration)
    assert again.freedom == fall.freedom
    assert again.scale == fall.scale


def test_gravity_in_space_as_magnitude_or_vector():
    """Exact: a magnitude fits any camera, a vector gives the tilt; door: two numbers."""
    tilted = G * np.array([0, np.cos(0.3), np.sin(0.3)])
    seen, times = balls(np.random.default_rng(11), tilted, noise=(0.005, 0.002))
    sized, aimed, aslant = (
        bm.motion.fit_fall_in_space(seen, times, g) for g in (G, tilted, (0, G, 0))
    )
    assert sized.off_gravity[0] == pytest.approx(0.3, abs=4 * sized.off_gravity[1])
    assert sized.lengths == aimed.lengths
    assert aimed.off_gravity[0] < 4 * aimed.off_gravity[1] < 0.1
    assert sized.rejection == aimed.rejection == ""
    assert "points 17° off gravity" in aslant.rejection
    assert "x,y,z, or its size alone" in aslant.rejection
    assert "off straight down in the picture; if it is gravity" in bm.explain(sized)[0]
    assert "off the gravity that was given" in bm.explain(aimed)[0]
    with pytest.raises(ValueError, match=r"gravity must be a number above 0, \(x, y, z\) in space"):
        bm.motion.fit_fall_in_space(seen, times, (0, G))


def test_wrong_option_is_named():
    """Exact: a diameter given as radius, and slow motion; nothing if it agrees with gravity."""
    seen, times = balls(np.random.default_rng(12), np.array([0, G, 0]), given=2 * RADIUS)
    for gravity in (None, G):
        (said,) = (
            w
            for w in bm.explain(bm.motion.fit_fall_in_space(seen, times, gravity))
            if "would be gravity" in w
        )
        assert "lengths were 0.5" in said or "lengths were 0.49" in said
    seen, times = balls(np.random.default_rng(12), np.array([0, G, 0]))
    slow = " ".join(bm.explain(bm.motion.fit_fall_in_space(seen, 8 * times)))
    assert "if frames came 8" in slow or "if frames came 7.9" in slow
    assert "would be gravity" not in " ".join(bm.explain(bm.motion.fit_fall_in_space(seen, times)))


def test_number_of_positions_and_times_is_checked():
    """Door: four, and a time for each."""
    seen, times = balls(np.random.default_rng(7), np.array([0, G, 0]), count=4)
    with pytest.raises(bm.errors.MotionError, match="a fall needs 4 positions in space, got 3"):
        bm.motion.fit_fall_in_space(seen[:3], times[:3])
    with pytest.raises(ValueError, match="times must be one number for each of 4 balls"):
        bm.motion.fit_fall_in_space(seen, times[:3])
    with pytest.raises(ValueError, match="times must be one number for each BallMotion, got none"):
        bm.motion.fit_fall_in_space(seen)
    of_clip = places(seen, times)
    with pytest.raises(ValueError, match="a BallPlace has its own"):
        bm.motion.fit_fall_in_space(of_clip, times)
    with pytest.raises(bm.errors.MotionError, match="the frames have no times; give the rate"):
        bm.motion.fit_fall_in_space([replace(ball, time=None) for ball in of_clip])
