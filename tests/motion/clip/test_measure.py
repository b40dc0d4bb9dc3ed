"""measure_clip, sightings, clip_color, fit_fall: a ball through the frames of a rendered clip."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.motion.clip.sightings import sighted
from tests.scenes import on_line, rendered

from blurmatte.color.model import ColorModel
from blurmatte.errors import ColorModelError, MotionError
from blurmatte.explain import explain
from blurmatte.motion import (
    FrameMotion,
    FrameSightings,
    clip_color,
    fit_fall,
    link_sightings,
    sightings,
)
from blurmatte.motion.clip.color import seen_color
from blurmatte.motion.clip.scene import clip_plate
from blurmatte.motion.clip.steps import measure_clip
from blurmatte.motion.picture.motion import Scale
from blurmatte.radiometry import LUMA_WEIGHTS, SRGB, LinearImage, decode, light_of_hex
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate
from blurmatte.rendering.plates import plain_plate
from blurmatte.rendering.scene import Shadow
from blurmatte.trajectory import Trajectory

SIZE, FRAMES, RATE = (160, 120), 7, 30
OPEN = 0.6  # of the time from frame to frame
START, VELOCITY, GRAVITY = np.array([24.0, 70]), np.array([17.0, -14]), np.array([0.5, 4.5])
RADIUS, COLOR = 7, (0.7, 0.95, 0.05)
GONE = 3
MODEL = ColorModel(np.array(COLOR)[:, None] / np.linalg.norm(COLOR))
CAMERA = Camera(code_std=1 / 255)


def light_of(plate, k, alone=False, color=COLOR):
    """The exact light of a frame: a second, blue ball, and the ball except in one frame."""
    if not alone:
        plate = on_line(
            plate, (140 - 14 * k, 16), (132 - 14 * k, 18), Ball(5, color=(0.05, 0.1, 0.9))
        ).image.rgb
    if k == GONE:
        return plate
    t = k - OPEN / 2
    begin = START + VELOCITY * t + GRAVITY * t**2 / 2
    path = Trajectory.parabola(begin, (VELOCITY + GRAVITY * t) * OPEN, GRAVITY * OPEN**2)
    return rendered(Scene(plate, path, Ball(RADIUS, color=color))).image.rgb


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


def test_positions_and_velocities_are_within_errors(rows):
    """Honest: within their errors, each and together; and the direction of time is known."""
    off = []
    for k, row in enumerate(rows):
        if k == GONE:
            continue
        s = row.sighting
        assert row.directed
        assert (row.frame, row.time, row.track) == (k, k / RATE, 1)
        assert (s.motion.source, s.motion.silhouette) == ("sweep", "disc")
        velocity = (VELOCITY + GRAVITY * k) * OPEN
        off += [*(s.motion.center - true_place(k)) / s.motion.center_std]
        off += [
            *(s.velocity - velocity) / s.velocity_std,
            (s.motion.radius - RADIUS) / s.motion.radius_std,
        ]
    assert np.max(np.abs(off)) < 4
    assert 0.8 < np.sqrt(np.mean(np.square(off))) < 1.25


def test_frame_without_object_has_reason(rows):
    """Exact: its row has the reason."""
    row = rows[GONE]
    assert row.sighting is None
    assert "nothing of the object's color moved" in row.reason
    numbers = row.numbers()
    assert (numbers["frame"], numbers["x"], numbers["directed"]) == (GONE, None, None)
    assert numbers.keys() == rows[0].numbers().keys()


def test_fall_of_clip_has_its_acceleration(rows):
    """Honest: the acceleration within its error, and in meters; a flight fits."""
    fall = fit_fall(rows, Scale(0.002, 1e-5))
    std = np.sqrt(np.diag(fall.acceleration_covariance))
    assert_allclose((fall.acceleration - GRAVITY * RATE**2) / std, 0, atol=3.5)
    assert fall.fits
    numbers = fall.numbers()
    assert numbers["acceleration_in_m_per_s2"] == pytest.approx(fall.size * 0.002)
    relative = np.hypot(fall.size_std / fall.size, 0.005)
    assert numbers["acceleration_in_m_per_s2_std"] == pytest.approx(fall.size * 0.002 * relative)
    verdict, meters = explain(fall)
    assert verdict.startswith("It agrees with a free fall")
    assert "of standard gravity" in meters


def test_resumed_clip_gives_same_rows(clip, rows):
    """Invariant: resuming after two frames gives the same rows."""
    frames, plate = clip
    first = list(sightings(frames[:2], plate, MODEL))
    rest = sightings(frames, plate, MODEL, skip=2)
    again = link_sightings([*first, *rest])
    assert [row.numbers() for row in again] == [row.numbers() for row in rows]


def test_clip_color_is_a_paint_of_the_clip(clip):
    """Oracle: the color is that of one of the paints."""
    model = clip_color(clip[0][:2], clip[1])
    paints = np.array([COLOR, (0.05, 0.1, 0.9)])
    angles = np.arccos(paints @ model.pole / np.linalg.norm(paints, axis=1))
    assert angles.min() < 0.01


def sighting(x, y, vx=10.0, vy=0.0, std=0.1, radius=5.0, energy=1.0):
    ends = (x - vx / 2, y - vy / 2), (x + vx / 2, y + vy / 2)
    return sighted((x, y), (vx, vy), std, std, std / 10, radius, std, evidence=energy, ends=ends)


def shown(*per_frame, rate=None):
    return [
        FrameSightings(k, None if rate is None else k / rate, tuple(found), "" if found else "no")
        for k, found in enumerate(per_frame)
    ]


def test_neighbors_determine_direction_of_time():
    """Exact: to the left, although each detection is given as going to the right."""
    rows = link_sightings(shown(*[[sighting(100 - 15 * k, 40)] for k in range(4)]))
    assert all(row.directed for row in rows)
    assert [row.sighting.velocity[0] for row in rows] == [-10] * 4
    assert rows[0].sighting.motion.trajectory.xy[0, 0] == 105
    assert abs(rows[0].sighting.motion.angle) == pytest.approx(np.pi)


def test_turning_point_has_no_direction():
    """Exact: forth and back; the direction of the middle frame is undetermined."""
    rows = link_sightings(shown([sighting(50, 40)], [sighting(58, 40)], [sighting(50, 40)]))
    assert [row.directed for row in rows] == [True, False, True]


def test_other_object_is_ignored():
    """Exact: a streak far from the prediction, and weaker."""
    found = [[sighting(20 + 12 * k, 40), sighting(200, 150, energy=0.2)] for k in range(4)]
    found[2] = found[2][1:]
    rows = link_sightings(shown(*found))
    assert [row.sighting.motion.center[0] for row in rows] == [20, 32, 200, 56]
    assert [row.track for row in rows] == [1, 1, 2, 1]
    assert [row.others for row in rows] == [1, 1, 0, 1]
    faint = [[sighting(20 + 12 * k, 40), sighting(200, 150, energy=0.01)] for k in range(4)]
    faint[2] = faint[2][1:]
    row = link_sightings(shown(*faint))[2]
    assert row.sighting is None
    assert row.reason == "the object's track does not go there; 1 streak of its color ignored"


def test_errors_of_fall_match_scatter():
    """Honest: many flights with noise of the positions alone."""
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


class Damaged(list):
    """Frames of which the second cannot be decoded: it is left out where they are read in a row."""

    def __getitem__(self, which):
        found = super().__getitem__(which)
        return found[:1] + found[2:] if isinstance(which, slice) else found


def test_frames_keep_their_plate_where_one_cannot_be_decoded(clip):
    """Exact: frames are not taken out of a plate by the numbers of others."""
    frames, _ = clip
    assert clip_plate(frames).shares is not None
    assert clip_plate(Damaged(frames)).shares is None


@pytest.mark.battery
def test_errors_of_three_frames_match_scatter():
    """Honest: each frame is a third of the plate."""
    z = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        plate = colorful_plate(SIZE, seed, tile=24)
        velocity, radius = rng.uniform((38, -8), (46, 8)), rng.uniform(7, 11)
        ends = [np.array([26.0, 60]) + velocity * (k + np.array([[0], [OPEN]])) for k in range(3)]
        lights = [on_line(plate, *two, Ball(radius, color=COLOR)).image.rgb for two in ends]
        rows = measure_clip([CAMERA.photograph(light, rng) for light in lights])
        for motion in (row.sighting.motion for row in rows):
            z.append((motion.length - OPEN * np.hypot(*velocity)) / motion.length_std)
    assert len(z) == 18
    assert abs(np.mean(z)) < 0.6
    assert 0.5 < np.std(z) < 1.4


@pytest.mark.parametrize("color", [COLOR, (0.02, 0.03, 0.02)], ids=["bright", "dark"])
def test_balls_of_gray_frames_are_measured(color):
    """oracle: one channel; before a textured plate a black ball is no shadow."""
    rng, plate = np.random.default_rng(3), colorful_plate(SIZE, 2, tile=24)

    def gray(light):
        """The picture of a sensor of one channel."""
        codes = 255 * SRGB.encode(light @ LUMA_WEIGHTS) + rng.normal(0, 1, light.shape[:2])
        return decode(np.rint(codes).astype(np.uint8)[..., None] * np.ones(3, np.uint8), SRGB)

    frames = [gray(light_of(plate, k, alone=True, color=color)) for k in range(3)]
    rows = measure_clip(frames, gray(plate), rate=RATE)
    assert [row.sighting is not None for row in rows] == [True] * 3
    for k, row in enumerate(rows):
        motion, middle = row.sighting.motion, START + VELOCITY * k + GRAVITY * k**2 / 2
        assert_allclose(motion.center, middle + GRAVITY * OPEN**2 / 24, atol=0.25)
        assert motion.radius == pytest.approx(RADIUS, abs=0.15)
        assert motion.length == pytest.approx(
            np.linalg.norm((VELOCITY + GRAVITY * k) * OPEN), abs=0.4
        )


def test_colors_are_refused_for_gray_frames():
    """Also those of three equal channels."""
    light = [light_of(plain_plate(SIZE, (0.5, 0.5, 0.48), 4), k)[..., [1, 1, 1]] for k in range(3)]
    plate, *frames = map(LinearImage, light)
    for call in (lambda: measure_clip(frames, plate, MODEL), lambda: clip_color(frames, plate)):
        with pytest.raises(ColorModelError, match="is gray"):
            call()


def test_rejects_arc_and_too_few_frames():
    """Exact: an arc does not fit; three frames and frames without times are rejected."""
    t = np.linspace(0, 3, 8)
    rows = [
        FrameMotion(k, float(s), sighting(float(50 * np.cos(s)), float(50 * np.sin(s))), 1)
        for k, s in enumerate(t)
    ]
    assert not fit_fall(rows).fits
    assert "does not agree with a free fall" in explain(fit_fall(rows))[-1]
    with pytest.raises(MotionError, match="a fall needs 4 frames of one track, got 3"):
        fit_fall(rows[:3])
    with pytest.raises(MotionError, match="give the rate"):
        fit_fall([replace(row, time=None) for row in rows])


def test_invalid_input_is_rejected(clip):
    """Door."""
    frames, plate = clip
    with pytest.raises(ValueError, match="a frame is 160x120 pixels and plate 20x20"):
        next(sightings(frames, LinearImage(np.full((20, 20, 3), 0.5)), MODEL))
    with pytest.raises(ValueError, match="rate must be frames per second, above 0, got 0"):
        next(sightings(frames, plate, MODEL, rate=0))
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        next(sightings(frames, plate, MODEL, workers=0))


def test_result_is_independent_of_workers(clip, rows):
    """Invariant: the number of processes changes nothing."""
    frames, plate = clip
    again = link_sightings(sightings(frames, plate, MODEL, workers=2))
    assert [row.numbers() for row in again] == [row.numbers() for row in rows]


def test_any_colors_finds_both_balls(clip):
    """Oracle: both balls are found without a color."""
    frames, plate = clip
    (seen,) = sightings(frames[:1], plate, ColorModel.any())
    places = np.array([s.motion.center for s in seen.found])
    assert np.min(np.linalg.norm(places - true_place(0), axis=1)) < 0.5
    assert np.min(np.linalg.norm(places - (136, 17), axis=1)) < 0.5


def test_a_sighting_has_the_mean_color_of_the_ball(clip, rows):
    """Oracle: of one paint that of the model, of several the light that the ball has in the frame.

    A track has the median of its frames.
    """
    assert {row.sighting.color for row in rows if row.sighting} == {MODEL.color}
    frames, plate = clip
    plane = ColorModel.from_samples(np.array([COLOR, (1.0, 1.0, 1.0)]), 2, std=1e-3)  # and gloss
    found = measure_clip(frames[:3], plate, plane)
    light = light_of_hex(*[row.sighting.color for row in found])
    assert_allclose(light / light[:, 1:2], np.tile(np.array(COLOR) / COLOR[1], (3, 1)), atol=0.1)
    color = seen_color(plane, found)
    assert_allclose(color.mean, np.median(light, axis=0))
    assert color.in_words.startswith(f"{color.color}, rank 2, between #")
    assert seen_color(MODEL, rows) is MODEL


def color_of_ball_with(other, paths, length, seed):
    """The color of a clip with the ball, and another object with one path for each frame."""
    rng, plate = np.random.default_rng(seed), colorful_plate(SIZE, 2, tile=24)
    frames = []
    for k, path in enumerate(paths):
        behind = rendered(Scene(plate, Trajectory.line(*path), other)).image.rgb
        light = on_line(
            behind, (30 + 15 * k, 40), (30 + 15 * k + length, 44), Ball(RADIUS, color=COLOR)
        ).image.rgb
        frames.append(CAMERA.photograph(light, rng))
    return clip_color(frames, CAMERA.photograph(plate, rng))


def test_streak_at_border_does_not_decide_color():
    """Oracle: an arm, larger and stronger than the ball, which the border cuts."""
    arm = Ball(20, color=(0.9, 0.3, 0.2))
    paths = [((158, 80 - 10 * k), (150, 84 - 10 * k)) for k in range(2)]
    color = color_of_ball_with(arm, paths, length=12, seed=8)
    assert abs(color.pole @ MODEL.pole) > np.cos(0.05)


def test_slow_object_does_not_decide_color():
    """Oracle: a fist, larger and stronger than the ball, which hardly moves."""
    fist = Ball(14, color=(0.9, 0.5, 0.3))
    paths = [((120 + k, 80), (123 + k, 84)) for k in range(2)]
    color = color_of_ball_with(fist, paths, length=22, seed=9)
    assert abs(color.pole @ MODEL.pole) > np.cos(0.05)


def test_one_frame_does_not_decide_color():
    """Oracle: what flies by in one of three frames, in it much stronger and faster than the ball."""
    bird = Ball(12, color=(0.95, 0.3, 0.9))
    paths = [((20, 90), (120, 96)), *[((-400, -400), (-390, -400))] * 2]
    color = color_of_ball_with(bird, paths, length=22, seed=8)
    assert abs(color.pole @ MODEL.pole) > np.cos(0.05)


def test_bar_is_measured_from_moments(clip):
    """Oracle: the mean of alpha of a long bar, in coordinates of the whole picture."""
    plate = clip[1]
    alpha = np.zeros((SIZE[1], SIZE[0]))
    alpha[50:60, 90:140] = 0.5
    light = alpha[..., None] * COLOR + (1 - alpha[..., None]) * plate.rgb
    bar = CAMERA.photograph(light, np.random.default_rng(1))
    (seen,) = sightings([bar], plate, MODEL)
    (s,) = seen.found
    assert s.motion.source == "moments"
    assert abs(s.motion.center[0] - 114.5) < max(4 * s.motion.center_std[0], 0.1)
    assert abs(s.motion.center[1] - 54.5) < max(4 * s.motion.center_std[1], 0.1)
    assert seen.time is None
    assert next(sightings([bar], plate, MODEL, numbers=[12], rate=24)).time == 0.5


def ball_with_shadow(strength):
    """A ball before a gray wall, with its shadow, and the plate."""
    wall = plain_plate(SIZE, (0.5, 0.5, 0.48), 4)
    path = Trajectory.line((60, 40), (90, 55))
    shadow = Shadow((-6, 14), strength=(strength,) * 3) if strength else None
    light = rendered(Scene(wall, path, Ball(10, color=COLOR), shadow=shadow)).image.rgb
    rng = np.random.default_rng(6)
    return CAMERA.photograph(light, rng), CAMERA.photograph(wall, rng)


@pytest.mark.parametrize("strength", [0, 0.5])
def test_shadow_does_not_shift_the_ball(strength):
    """Oracle: a disc is fitted with and without the shadow, to a fraction of a pixel."""
    frame, plate = ball_with_shadow(strength)
    (seen,) = sightings([frame], plate, MODEL)
    (s,) = seen.found
    assert s.motion.source == "sweep"
    assert np.linalg.norm(s.motion.center - (75, 47.5)) < 0.3
    assert abs(s.motion.radius - 10) < 0.3


def test_half_of_a_streak_is_enough():
    """Honest: with the plate unknown on half of its path; rejected if only the rim is known."""
    frame, plate = ball_with_shadow(0)
    valid = np.ones(SIZE[::-1], bool)
    valid[:, 76:] = False
    (seen,) = sightings([frame], replace(plate, valid=valid), MODEL)
    (s,) = seen.found
    off = s.motion.center - (75, 47.5)
    assert off @ np.linalg.solve(s.motion.center_covariance, off) < 13.8
    valid[:, 54:] = False
    (seen,) = sightings([frame], replace(plate, valid=valid), MODEL)
    assert seen.found == ()
    assert seen.reason == "most of the streak lies where the plate is not known"


def test_unknown_plate_gives_no_streak():
    """Exact: nothing moved, and in one half only single pixels of the plate are known."""
    _, plate = ball_with_shadow(0)
    valid = np.ones(SIZE[::-1], bool)
    valid[:, 80:] = False
    valid[::12, 80::12] = True
    frame = CAMERA.photograph(np.asarray(plate.rgb, float), np.random.default_rng(2))
    (seen,) = sightings([frame], replace(plate, valid=valid), MODEL)
    assert seen.found == ()
    assert seen.reason == "nothing moved"


def test_a_reason_of_several_streaks_is_stated_once(monkeypatch):
    """Exact: two balls, neither of which can be measured."""
    plate = colorful_plate(SIZE, 2, tile=24)
    light = plate
    for start, end in (((25, 30), (45, 34)), ((105, 85), (125, 90))):
        light = on_line(light, start, end, Ball(RADIUS, color=COLOR))
        light = light.image.rgb
    measured = []

    def refused(*arguments):
        measured.append(arguments)
        raise MotionError("no disc explains it")

    monkeypatch.setattr("blurmatte.motion.clip.measure._measured", refused)
    rng = np.random.default_rng(4)
    pictures = CAMERA.photograph(light, rng), CAMERA.photograph(plate, rng)
    (seen,) = sightings([pictures[0]], pictures[1], MODEL)
    assert len(measured) == 2
    assert seen.reason == "no disc explains it"
