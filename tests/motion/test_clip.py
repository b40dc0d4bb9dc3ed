"""measure_clip: one ball through several frames, its errors, its gaps, and the fall it is in."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color import ColorModel
from blurmatte.errors import MotionError
from blurmatte.motion import (
    FrameMotion,
    FrameSightings,
    Scale,
    Sighting,
    clip_color,
    fall_in_words,
    fit_fall,
    link_sightings,
    measure_clip,
    sightings,
)
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Camera, Scene, Shadow, colorful_plate, plain_plate, render
from blurmatte.trajectory import Trajectory

SIZE, FRAMES, RATE = (160, 120), 7, 30
OPEN = 0.6  # of the time from frame to frame
START, VELOCITY, GRAVITY = np.array([24.0, 70]), np.array([17.0, -14]), np.array([0.5, 4.5])
RADIUS, COLOR = 7, (0.7, 0.95, 0.05)
GONE = 3
MODEL = ColorModel(np.array(COLOR)[:, None] / np.linalg.norm(COLOR))
CAMERA = Camera(code_std=1 / 255)


def light_of(plate, k, alone=False):
    """The exact light of a frame: a blue ball besides, and the ball but in one frame."""
    if not alone:
        way = Trajectory.line((140 - 14 * k, 16), (132 - 14 * k, 18))
        plate = render(Scene(plate, way, Ball(5, color=(0.05, 0.1, 0.9)))).image.rgb
    if k == GONE:
        return plate
    t = k - OPEN / 2
    begin = START + VELOCITY * t + GRAVITY * t**2 / 2
    way = Trajectory.parabola(begin, (VELOCITY + GRAVITY * t) * OPEN, GRAVITY * OPEN**2)
    return render(Scene(plate, way, Ball(RADIUS, color=COLOR))).image.rgb


@pytest.fixture(scope="module")
def clip():
    """Frames with noise, and their plate."""
    rng, plate = np.random.default_rng(3), colorful_plate(SIZE, 2, tile=24)
    photographs = (CAMERA.photograph(light_of(plate, k), rng) for k in range(FRAMES))
    frames = [
        replace(image, meta=replace(image.meta, time=k / RATE))
        for k, image in enumerate(photographs)
    ]
    return frames, CAMERA.photograph(plate, rng)


@pytest.fixture(scope="module")
def rows(clip):
    return measure_clip(*clip, MODEL)


def true_place(k):
    return START + VELOCITY * k + GRAVITY * (k**2 / 2 + OPEN**2 / 24)


def test_places_and_velocities_are_right(rows):
    """Honest: within their errors, each and together; and the direction of time is known."""
    off = []
    for k, row in enumerate(rows):
        if k == GONE:
            continue
        s = row.sighting
        assert row.directed
        assert (row.frame, row.time, row.track) == (k, k / RATE, 1)
        assert (s.source, s.silhouette) == ("sweep", "disc")
        velocity = (VELOCITY + GRAVITY * k) * OPEN
        off += [*(s.place - true_place(k)) / [s.x_std, s.y_std]]
        off += [
            *([s.vx, s.vy] - velocity) / [s.vx_std, s.vy_std],
            (s.radius - RADIUS) / s.radius_std,
        ]
    assert np.max(np.abs(off)) < 4
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.4


def test_a_frame_without_it_says_so(rows):
    """Exact: the row is there, with the reason."""
    row = rows[GONE]
    assert row.sighting is None
    assert "nothing of the object's color moved" in row.reason
    numbers = row.numbers()
    assert (numbers["frame"], numbers["x"], numbers["directed"]) == (GONE, None, None)
    assert numbers.keys() == rows[0].numbers().keys()


def test_its_fall_is_found(rows):
    """Honest: the acceleration within its error, and in meters; a flight fits."""
    fall = fit_fall(rows, Scale(0.002, 1e-5))
    std = np.sqrt(np.diag(fall.acceleration_covariance))
    assert_allclose((fall.acceleration - GRAVITY * RATE**2) / std, 0, atol=3.5)
    assert fall.fits
    numbers = fall.numbers()
    assert numbers["acceleration_in_m_per_s2"] == pytest.approx(fall.size * 0.002)
    relative = np.hypot(fall.size_std / fall.size, 0.005)
    assert numbers["acceleration_in_m_per_s2_std"] == pytest.approx(fall.size * 0.002 * relative)
    verdict, meters = fall_in_words(fall)
    assert verdict.startswith("It is as a free fall would be")
    assert "of standard gravity" in meters


def test_it_goes_on_where_it_stopped(clip, rows):
    """Invariant: frames that were done before change nothing."""
    frames, plate = clip
    first = list(sightings(frames[:2], plate, MODEL))
    rest = sightings(frames, plate, MODEL, skip=2)
    assert link_sightings([*first, *rest]) == rows


def test_colors_agree_to_one(clip):
    """Oracle: the paint of what is explained best, found in the frames."""
    model = clip_color(clip[0][:2], clip[1])
    paints = np.array([COLOR, (0.05, 0.1, 0.9)])
    angles = np.arccos(paints @ model.pole / np.linalg.norm(paints, axis=1))
    assert angles.min() < 0.01


def sighting(x, y, vx=10.0, vy=0.0, std=0.1, radius=5.0, energy=1.0):
    length, angle = float(np.hypot(vx, vy)), float(np.arctan2(vy, vx))
    return Sighting(
        x, y, std, std, 0.0, vx, vy, std, std, length, std, angle, std / 10, radius, std,
        x - vx / 2, y - vy / 2, x + vx / 2, y + vy / 2, "#ffffff", energy, "sweep", "parabola",
        "disc", 1.0, False, True, "",
    )  # fmt: skip


def shown(*per_frame, rate=None):
    return [
        FrameSightings(k, None if rate is None else k / rate, tuple(found), "" if found else "no")
        for k, found in enumerate(per_frame)
    ]


def test_time_runs_as_the_neighbors_say():
    """Exact: to the left, although each is given as going to the right."""
    rows = link_sightings(shown(*[[sighting(100 - 15 * k, 40)] for k in range(4)]))
    assert all(row.directed for row in rows)
    assert [row.sighting.vx for row in rows] == [-10] * 4
    assert rows[0].sighting.first_x == 105
    assert abs(rows[0].sighting.angle) == pytest.approx(np.pi)


def test_a_turning_point_has_no_direction():
    """Exact: there and back, the middle frame cannot tell."""
    rows = link_sightings(shown([sighting(50, 40)], [sighting(58, 40)], [sighting(50, 40)]))
    assert [row.directed for row in rows] == [True, False, True]


def test_another_thing_is_left_aside():
    """Exact: it is farther off than the track predicts, and weaker."""
    found = [[sighting(20 + 12 * k, 40), sighting(200, 150, energy=0.2)] for k in range(4)]
    found[2] = found[2][1:]
    rows = link_sightings(shown(*found))
    assert [row.sighting.x for row in rows] == [20, 32, 200, 56]
    assert [row.track for row in rows] == [1, 1, 2, 1]
    assert [row.others for row in rows] == [1, 1, 0, 1]
    faint = [[sighting(20 + 12 * k, 40), sighting(200, 150, energy=0.01)] for k in range(4)]
    faint[2] = faint[2][1:]
    row = link_sightings(shown(*faint))[2]
    assert row.sighting is None
    assert row.reason == "the object's track does not go there; 1 streak of its color ignored"


def test_errors_of_a_fall_are_its_scatter():
    """Honest: many flights with noise of the places alone."""
    rng, z, chi2 = np.random.default_rng(0), [], []
    for _ in range(200):
        t = np.arange(6) / 10
        places = np.stack([5 * t * 10, 40 * t**2], axis=1) + rng.normal(0, 0.1, (6, 2))
        rows = [
            FrameMotion(k, float(t[k]), sighting(*map(float, places[k])), 1, True) for k in range(6)
        ]
        fall = fit_fall(rows)
        std = np.sqrt(np.diag(fall.acceleration_covariance))
        z.append((fall.acceleration - [0, 80]) / std)
        chi2.append(fall.chi2 / fall.freedom)
    assert np.std(z) == pytest.approx(1, abs=0.12)
    assert abs(np.mean(z)) < 0.15
    assert np.mean(chi2) == pytest.approx(1, abs=0.1)


def test_what_is_no_fall_is_told():
    """Exact: an arc does not fit; three frames and frames without time tell nothing."""
    t = np.linspace(0, 3, 8)
    rows = [
        FrameMotion(k, float(s), sighting(float(50 * np.cos(s)), float(50 * np.sin(s))), 1)
        for k, s in enumerate(t)
    ]
    assert not fit_fall(rows).fits
    assert "not as a free fall" in fall_in_words(fit_fall(rows))[-1]
    with pytest.raises(MotionError, match="a fall needs 4 frames of one track, got 3"):
        fit_fall(rows[:3])
    with pytest.raises(MotionError, match="give the rate"):
        fit_fall([replace(row, time=None) for row in rows])


def test_bad_arguments_are_refused(clip):
    """Door."""
    frames, plate = clip
    with pytest.raises(ValueError, match="a frame is 160x120 pixels and plate 20x20"):
        next(sightings(frames, LinearImage(np.full((20, 20, 3), 0.5)), MODEL))
    with pytest.raises(ValueError, match="rate must be frames per second, above 0, got 0"):
        next(sightings(frames, plate, MODEL, rate=0))
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        next(sightings(frames, plate, MODEL, workers=0))


def test_several_processes_find_the_same(clip, rows):
    """Invariant: the number of processes changes nothing."""
    frames, plate = clip
    assert link_sightings(sightings(frames, plate, MODEL, workers=2)) == rows


def test_any_colors_are_told_by_what_moves(clip):
    """Oracle: both balls are seen, where nobody said which color is meant."""
    frames, plate = clip
    (seen,) = sightings(frames[:1], plate, ColorModel.any())
    places = np.array([s.place for s in seen.found])
    assert np.min(np.linalg.norm(places - true_place(0), axis=1)) < 0.5
    assert np.min(np.linalg.norm(places - (136, 17), axis=1)) < 0.5


def color_told_beside(other, ways, length, seed):
    """The color of a clip in which the ball goes so far, and something else its ways, one a frame."""
    rng, plate = np.random.default_rng(seed), colorful_plate(SIZE, 2, tile=24)
    frames = []
    for k, way in enumerate(ways):
        behind = render(Scene(plate, Trajectory.line(*way), other)).image.rgb
        own = Trajectory.line((30 + 15 * k, 40), (30 + 15 * k + length, 44))
        light = render(Scene(behind, own, Ball(RADIUS, color=COLOR))).image.rgb
        frames.append(CAMERA.photograph(light, rng))
    return clip_color(frames, CAMERA.photograph(plate, rng))


def test_what_comes_from_beyond_the_border_tells_no_color():
    """Oracle: something larger and stronger than the ball, of which the border hides a part."""
    arm = Ball(20, color=(0.9, 0.3, 0.2))
    ways = [((158, 80 - 10 * k), (150, 84 - 10 * k)) for k in range(2)]
    told = color_told_beside(arm, ways, length=12, seed=8)
    assert abs(told.pole @ MODEL.pole) > np.cos(0.05)


def test_what_hardly_moves_tells_no_color():
    """Oracle: a fist that is larger and stronger than the ball, but stays where it is."""
    fist = Ball(14, color=(0.9, 0.5, 0.3))
    ways = [((120 + k, 80), (123 + k, 84)) for k in range(2)]
    told = color_told_beside(fist, ways, length=22, seed=9)
    assert abs(told.pole @ MODEL.pole) > np.cos(0.05)


def test_what_is_no_disc_has_moments(clip):
    """Oracle: the mean of alpha of a long bar, in all of the picture."""
    plate = clip[1]
    alpha = np.zeros((SIZE[1], SIZE[0]))
    alpha[50:60, 90:140] = 0.5
    light = alpha[..., None] * COLOR + (1 - alpha[..., None]) * plate.rgb
    bar = CAMERA.photograph(light, np.random.default_rng(1))
    (seen,) = sightings([bar], plate, MODEL)
    (s,) = seen.found
    assert s.source == "moments"
    assert abs(s.x - 114.5) < max(4 * s.x_std, 0.1)
    assert abs(s.y - 54.5) < max(4 * s.y_std, 0.1)
    assert seen.time is None
    assert next(sightings([bar], plate, MODEL, numbers=[12], rate=24)).time == 0.5


def in_the_shadow(strength):
    """A ball before a gray wall, its shadow beside it, and the plate."""
    wall = plain_plate(SIZE, (0.5, 0.5, 0.48), 4)
    way = Trajectory.line((60, 40), (90, 55))
    shadow = Shadow((-6, 14), strength=(strength,) * 3) if strength else None
    light = render(Scene(wall, way, Ball(10, color=COLOR), shadow=shadow)).image.rgb
    rng = np.random.default_rng(6)
    return CAMERA.photograph(light, rng), CAMERA.photograph(wall, rng)


@pytest.mark.parametrize("strength", [0, 0.5])
def test_a_ball_that_casts_a_shadow_beside_it(strength):
    """Oracle: it is measured from a disc with the shadow as without, to a fraction of a pixel."""
    frame, plate = in_the_shadow(strength)
    (seen,) = sightings([frame], plate, MODEL)
    (s,) = seen.found
    assert s.source == "sweep"
    assert np.linalg.norm(s.place - (75, 47.5)) < 0.3
    assert abs(s.radius - 10) < 0.3


def test_half_of_a_streak_tells_where_the_ball_went():
    """Honest: the plate is not known on the other half of its way; the rim alone tells nothing."""
    frame, plate = in_the_shadow(0)
    valid = np.ones(SIZE[::-1], bool)
    valid[:, 76:] = False
    (seen,) = sightings([frame], replace(plate, valid=valid), MODEL)
    (s,) = seen.found
    off = s.place - (75, 47.5)
    assert off @ np.linalg.solve(s.covariance, off) < 13.8
    valid[:, 54:] = False
    (seen,) = sightings([frame], replace(plate, valid=valid), MODEL)
    assert seen.found == ()
    assert seen.reason == "most of the streak lies where the plate is not known"


def test_what_the_plate_does_not_know_is_no_streak():
    """Exact: nothing moved, and of a half of the plate only a pixel here and there is known."""
    _, plate = in_the_shadow(0)
    valid = np.ones(SIZE[::-1], bool)
    valid[:, 80:] = False
    valid[::12, 80::12] = True
    frame = CAMERA.photograph(np.asarray(plate.rgb, float), np.random.default_rng(2))
    (seen,) = sightings([frame], replace(plate, valid=valid), MODEL)
    assert seen.found == ()
    assert seen.reason.startswith("nothing of the object's color moved")
