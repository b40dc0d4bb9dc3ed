"""Clips of a camera that shakes, pans and zooms, against those of a camera at rest."""

import csv
from functools import cache

import numpy as np
import pytest
from tests.commands import run
from tests.handheld import fine_scene, noisy, shown, similarity, with_ball

import blurmatte as bm
from blurmatte.background import ClipShot
from blurmatte.background.registration import CameraPath
from blurmatte.background.shots import joined_shots
from blurmatte.background.warp import PixelGrid, Warp, inverse
from blurmatte.motion.picture.motion import QUANTITIES
from blurmatte.trajectory import Trajectory

SIZE, COUNT = (160, 100), 6
rng = np.random.default_rng(4)
VIEWS = {
    "still": [similarity(SIZE)] * COUNT,
    "shaken": [similarity(SIZE, *rng.uniform(-14, 14, 2)) for _ in range(COUNT)],
    "panned": [
        similarity(SIZE, x, zoom=z)
        for x, z in zip(np.linspace(-27, 27, COUNT), np.linspace(0.985, 1.015, COUNT), strict=True)
    ],
}


def path_of(k):
    """Start and end of the path in frame k, in the pixels of the camera at rest."""
    start = np.array([46.0 + 12 * k, 42 + 3 * k])
    return start, start + np.array([6, 2])


@cache
def renderings(name):
    points = fine_scene((250, 160))
    return [with_ball(shown(points, SIZE, h), h, *path_of(k)) for k, h in enumerate(VIEWS[name])]


def frames_of(name):
    return [noisy(one.image.rgb, k) for k, one in enumerate(renderings(name))]


@pytest.mark.parametrize("name", ["shaken", "panned"])
def test_places_in_frames_of_a_moving_camera_are_within_their_errors(name):
    # honest
    model = bm.ColorModel(np.array([[0.85], [0.16], [0.05]]) / np.linalg.norm((0.85, 0.16, 0.05)))
    rows = bm.measure_clip(frames_of(name), model=model)
    z = []
    for k, row in enumerate(rows):
        middle = np.mean(Warp(VIEWS[name][k], SIZE).inverse.points(np.array(path_of(k))), axis=0)
        motion = row.sighting.motion
        z.append((motion.center - middle) / motion.center_std)
        assert np.abs(motion.center - middle).max() < 0.1
    assert np.mean(np.abs(z) < 3) >= 0.95


@pytest.mark.battery
@pytest.mark.parametrize("name", ["shaken", "panned"])
def test_alpha_is_nearly_as_exact_as_that_of_a_camera_at_rest(name):
    # oracle
    def error(name):
        found = bm.solve_clip(frames_of(name))
        rms = [
            np.sqrt(
                np.mean((solution.alpha - renderings(name)[k].layer.alpha)[solution.streak] ** 2)
            )
            for k, solution in found
        ]
        assert len(rms) == COUNT
        return np.median(rms)

    assert error(name) < 1.5 * error("still")


def test_motion_in_the_pixels_of_another_picture_and_back_is_the_same():
    # invariant
    values = np.array([20, 30, 0.3, 12, 16, 8, 200, 13.0])
    root = np.random.default_rng(0).normal(0, 0.1, (8, 8))
    motion = bm.motion.Motion(
        Trajectory.line((14.3, 28.2), (25.7, 31.8)),
        *(values, root @ root.T, np.array([12.0]), np.array([0.1])),
        *("sweep", "line", "disc", SIZE),
    )
    there = Warp(similarity(SIZE, 9, -4, 1.1, 0.2), SIZE)
    moved = motion.mapped(there.points)
    assert moved.radius == pytest.approx(1.1 * 8)
    assert moved.angle == pytest.approx(0.5)
    assert moved.length_std == pytest.approx(1.1 * motion.length_std)
    back = moved.mapped(there.inverse.points)
    np.testing.assert_allclose(back.values, values, rtol=1e-9)
    np.testing.assert_allclose(back.covariance, motion.covariance, atol=1e-9)
    assert len(QUANTITIES) == len(values)


def test_motions_of_the_camera_are_no_cuts():
    still, pan = ClipShot(0, 40), ClipShot(40, 60, "cut", moving=True)
    short = [ClipShot(60, 66, "cut"), ClipShot(66, 70, "cut"), ClipShot(70, 80, "light")]
    asked = []

    def same(a, b):
        asked.append((a, b))
        return b != 66

    found = joined_shots([still, pan, *short], same)
    assert [(one.start, one.stop, one.moving) for one in found] == [
        *((0, 40, False), (40, 66, True), (66, 70, False), (70, 80, False))
    ]
    assert asked == [(59, 60), (65, 66), (64, 66), (63, 66)]


def test_camera_path_names_its_farthest_frame():
    # exact
    views = (Warp(similarity(SIZE), SIZE), "dark", Warp(similarity(SIZE, 3, 4), SIZE))
    path = CameraPath(SIZE, views, PixelGrid(SIZE), 0)
    assert path.reach == pytest.approx(5)
    assert path.registered == [0, 2]
    np.testing.assert_allclose(inverse(inverse(views[2].h)), views[2].h, atol=1e-12)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """Files of the panned clip, with a dark frame in it."""
    folder = tmp_path_factory.mktemp("panned")
    frames = frames_of("panned")
    frames[4] = bm.LinearImage(np.full_like(frames[4].rgb, 0.01))
    bm.write_frames(folder / "f.####.exr", frames, start=0)
    return folder


def test_track_lists_frames_that_are_not_registered_and_leaves_their_rows_empty(clip, tmp_path):
    # door
    out = tmp_path / "t.csv"
    words = ("--color", "#ff7845", "--workers", "1", "--rate", "25", "--out", out)
    result = run("track", clip / "f.####.exr", *words)
    assert result.exit_code == 0, result.stderr
    assert "The camera moves: 5 of 6 frames are registered to frame 3" in result.stdout
    assert "Frame 4 is not registered: it " in result.stdout
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert rows[4]["x"] == ""
    assert "the frame is not registered" in rows[4]["reason"]
    for k in range(4):  # in pixels of the frames
        ends = Warp(VIEWS["panned"][k], SIZE).inverse.points(np.array(path_of(k)))
        assert float(rows[k]["x"]) == pytest.approx(ends[:, 0].mean(), abs=0.4)


def test_position_in_space_needs_a_camera_at_rest(clip, tmp_path):
    # door
    lens = tmp_path / "lens.json"
    lens.write_text('{"fx": 200, "fy": 200, "cx": 79.5, "cy": 49.5}')
    words = ("--color", "#ff7845", "--workers", "1", "--camera", lens, "--radius", "2cm")
    result = run("track", clip / "f.####.exr", *words, "--rate", "25")
    assert result.exit_code != 0
    assert "--camera needs a camera at rest, and this one moves" in result.stderr
    assert "Traceback" not in result.stderr
