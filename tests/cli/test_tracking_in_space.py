"""blurmatte track with a camera: positions in space, their fall, and errors of one line."""

import csv
import json

import numpy as np
import pytest
from benchmarks.rendered import render_flight
from PIL import Image
from tests import commands

import blurmatte as bm
from blurmatte.rendering import colorful_plate

SIZE, RATE, EXPOSURE, RADIUS, FRAMES = (240, 180), 60, 1 / 120, 0.02, 6
LENS = bm.Intrinsics(600, 602, 118, 91, np.array([-0.1, 0.03, 1e-3, -5e-4]), size=SIZE)
START, VELOCITY = np.array([-0.07, 0.0, 0.6]), np.array([1.2, -0.6, 0.6])
GRAVITY = 9.80665 * np.array([0, np.cos(0.3), np.sin(0.3)])  # of a camera that looks down
HEX = "#e8a03f"


def flight(t):
    t = np.asarray(t)[..., None]
    return START + t * VELOCITY + t**2 / 2 * GRAVITY


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Pictures of a thrown ball of 20 pixels, as a camera of 8 bits takes them, and their plate."""
    folder, rng = tmp_path_factory.mktemp("flight"), np.random.default_rng(2)
    plate, camera = 0.6 * colorful_plate(SIZE, 5, tile=40), bm.rendering.Camera(code_std=1.5 / 255)
    color = bm.ColorModel.from_hex(HEX).basis[:, 0]
    for k in range(FRAMES):
        t = k / RATE + EXPOSURE * ((np.arange(20) + 0.5) / 20 - 0.5)
        light = render_flight(plate, LENS, flight(t), RADIUS, color / color.max() * 0.8)[0].rgb
        bm.write(folder / f"f{k}.png", camera.photograph(light, rng))
    bm.write(folder / "plate.exr", camera.photograph(plate, rng))
    bm.write(folder / "cam.json", LENS)
    return folder


@pytest.fixture(scope="module")
def track(folder):
    """Run `blurmatte track` on the pictures."""

    def run(*options, camera="cam.json"):
        given = ["--plate", folder / "plate.exr", "--color", HEX, "--transfer", "srgb"]
        given += ["--camera", folder / camera, *options]
        return commands.run("track", folder / "f*.png", *given)

    return run


@pytest.fixture(scope="module")
def answer(track, folder):
    """All that is said of the flight, its table and its sheet."""
    options = "--rate", RATE, "--radius", "20mm±0.1mm", "--exposure", "1/120", "--gravity", 9.80665
    table = "--out", folder / "t.csv", "--overlay", folder / "sheet.png"
    result = track(*options, *table, "--json")
    assert (result.exit_code, result.stderr) == (0, "")
    return json.loads(result.stdout)


def test_places_and_speeds_match_rendered_flight(answer):
    """Oracle: depth to 2 %, speed to 3 % between the ends, all within 4.5 standard errors."""
    for k, row in enumerate(answer["rows"]):
        X, v = flight(k / RATE), VELOCITY + k / RATE * GRAVITY
        assert row["ball_source"] == "ball"
        assert abs(row["ball_z"] / X[2] - 1) < 0.02
        if 0 < k < FRAMES - 1:
            assert abs(row["ball_speed"] / np.linalg.norm(v) - 1) < 0.03
        assert abs(row["ball_speed"] - np.linalg.norm(v)) < 4.5 * row["ball_speed_std"]
        for axis, place, speed in zip("xyz", X, v, strict=True):
            off = row[f"ball_{axis}"] - place, row[f"ball_velocity_{axis}"] - speed
            assert abs(off[0]) < 4.5 * row[f"ball_{axis}_std"] + EXPOSURE**2 * 9.81 / 24
            assert abs(off[1]) < 4.5 * row[f"ball_velocity_{axis}_std"]
        assert row["speed_unit"] == "m/s"
        assert abs(row["speed"] - np.linalg.norm(v)) < 4.5 * row["speed_std"]


def test_fall_gives_gravity_and_tilt(answer):
    """Oracle: its magnitude, its direction for a tilted camera, and correct lengths."""
    fall = answer["fall"]
    g, std = fall["acceleration_in_m_per_s2"], fall["acceleration_in_m_per_s2_std"]
    assert abs(g - 9.80665) < 3 * std < 0.5
    assert abs(fall["off_gravity"] - 0.3) < 4 * fall["off_gravity_std"] < 0.3
    assert abs(fall["lengths_by_gravity"] - 1) < 4 * fall["lengths_by_gravity_std"] < 0.1
    words = " ".join(answer["in_words"])
    assert "In space in 6 of 6 frames: 6 by a ball that was fitted to the picture." in words
    assert "radius and camera all of them to 0.5%" in words
    assert "off straight down in the picture; if it is gravity, the camera is tilted" in words


def test_writes_table_and_sheet_in_space(answer, folder):
    """Exact: additional columns, as printed; the sheet has its usual width."""
    with (folder / "t.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert set(bm.motion.BallPlace.names) < rows[0].keys() == answer["rows"][0].keys()
    assert [float(row["ball_z"]) for row in rows] == [row["ball_z"] for row in answer["rows"]]
    with Image.open(folder / "sheet.png") as sheet:
        assert sheet.width == 1800


def test_fall_reveals_wrong_radius(track):
    """Exact: the diameter as radius; the sentences name the cause."""
    said = " ".join(
        track("--rate", RATE, "--radius", "40mm", "--several", "--frames", ":4").stdout.splitlines()
    )
    assert "Object 1: in 4 frames, 0 to 3." in said
    assert "In space in 4 of 4 frames" in said
    times = float(said.split("It would be gravity if lengths were ")[1].split(" ")[0])
    assert times == pytest.approx(0.5, rel=0.1)
    assert "is it the radius that was given, not the diameter?" in said


def test_refuses_camera_of_other_size(track, folder):
    """Door: a known size is rejected, an unknown one gives a warning; times are missing."""
    fields = json.loads((folder / "cam.json").read_text())
    (folder / "other.json").write_text(json.dumps({**fields, "size": [480, 360]}))
    refused = track("--radius", "2cm", camera="other.json")
    assert refused.exit_code == 2
    assert "calibrated with pictures of 480x360 pixels, and this has 240x180" in refused.stderr
    (folder / "far.json").write_text(json.dumps({**fields, "size": None, "cx": 236, "cy": 182}))
    warned = track("--radius", "2cm", "--frames", ":1", camera="far.json")
    assert warned.exit_code == 0
    assert "axis meets the picture at (236, 182), far from its middle" in warned.stderr
    assert warned.stderr.count("\n") == 1
    assert "How fast in space is not known: that needs three frames" in warned.stdout
    assert "No fall to check" in warned.stdout


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            (),
            "--camera needs --radius or --diameter, the ball's true size; if it is unknown",
        ),
        (("--radius", "0"), "--radius must be above 0, got '0'"),
        (("--diameter", "-4cm"), "--diameter must be above 0, got '-4cm'"),
        (("--radius", "2cm", "--diameter", "4cm"), "give one of --radius, --diameter"),
        (
            ("--radius", "2cm", "--scale", "1mm"),
            "give --radius or --diameter with --camera",
        ),
        (("--radius", "2cm", "--gravity", "0,9.81"), "like 0,9.81,0; got two numbers, '0,9.81'"),
        (("--radius", "2cm", "--gravity", "-9.81"), "--gravity must be above 0, or a vector"),
        (("--radius", "2cm", "--gravity", "0,0,0"), "--gravity must be above 0, or a vector"),
        (("--radius", "2cm", "--speed", "3"), "No such option: --speed"),
        (("--radius", "2cm", "--line-time", "fast"), "--line-time must be a time with its unit"),
    ],
)
def test_track_refuses_in_one_line(track, options, said):
    """Door: before anything is measured."""
    result = track(*options)
    assert said in commands.complaint(result)
    assert result.stdout == ""
