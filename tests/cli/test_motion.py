"""blurmatte measure and locate: sentences, numbers, tables, pictures, and errors of one line."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from tests.commands import complaint, run
from tests.scenes import BALL, ball_in

import blurmatte as bm

LENGTH, RADIUS = np.hypot(44, 14), BALL.body.radius


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A solved picture of a ball."""
    folder = tmp_path_factory.mktemp("measured")
    bm.write(folder / "layer.exr", bm.solve(*ball_in(folder)))
    return folder


@pytest.fixture
def measure(folder):
    """Run `blurmatte measure` on the layer."""
    return lambda *options: run("measure", folder / "layer.exr", *options)


@pytest.fixture
def locate(folder):
    """Run `blurmatte locate` on the layer."""
    return lambda *options: run("locate", folder / "layer.exr", *options)


def test_measure_prints_sentences(measure):
    """Exact: including missing inputs."""
    result = measure()
    assert (result.exit_code, result.stderr) == (0, "")
    found = re.search(r"Motion\(around \(([\d.]+), ([\d.]+)\), ", result.stdout)
    assert np.allclose([float(value) for value in found.groups()], (48, 35), atol=0.2)
    assert "a disc on a straight line at constant speed" in result.stdout
    assert "or the opposite one: one picture does not determine which" in result.stdout
    assert "the scale and the exposure time are missing" in result.stdout


def test_grade_and_its_reasons_precede_every_number_of_an_answer(folder, tmp_path):
    """Exact: in every command that prints one; also in the numbers for machines."""
    solution = bm.read_solution(folder / "layer.exr")
    graded = {"grade": bm.Grade.ASSUMED, "grade_reasons": ("shape", "noise")}
    stats = replace(solution.stats, **graded)
    bm.write(tmp_path / "layer.exr", replace(solution, stats=stats))
    reasons = "assumed: alpha with and without a shape on a path differ (by "
    points = [("26,28", "0,0"), ("70,28", "1,0"), ("70,42", "1,1"), ("26,42", "0,1")]
    plane = [part for pixel, place in points for part in ("--on-plane", f"{pixel}={place}")]
    for command in (
        ("measure",),
        ("locate", *plane),
        ("sharpen", "--out", tmp_path / "sharp.png"),
        ("paints", "--color", "#d02020", "--color", "#2040d0", "--out", tmp_path / "paints"),
        ("info",),
    ):
        name, *options = command
        result = run(name, tmp_path / "layer.exr", *options)
        assert result.exit_code == 0, (command, result.stderr)
        lines = result.stdout.splitlines()
        assert any(line.startswith(reasons) for line in lines), command
        if name != "info":
            assert lines[0].startswith(reasons), command
    numbers = json.loads(run("measure", tmp_path / "layer.exr", "--json").stdout)
    assert numbers["grade"] == "assumed"
    assert numbers["in_words"][0].startswith(reasons)


def test_measured_numbers_are_right(measure, tmp_path):
    """Oracle: the rendered scene; JSON on the output and in a file agree."""
    numbers = json.loads(measure("--json", "--out", tmp_path / "m.json").stdout)
    assert json.loads((tmp_path / "m.json").read_text()) == numbers
    true = {"x": 48, "y": 35, "length": LENGTH, "radius": RADIUS, "angle": np.arctan2(14, 44)}
    for name, value in true.items():
        assert abs(numbers[name] - value) < 4 * numbers[f"{name}_std"], name
    assert len(numbers["trajectory"]["xy"]) == len(numbers["speeds"]) + 1


def test_writes_csv_of_one_row(measure, tmp_path):
    """Exact: names and values, and meters per second from the diameter."""
    measure("--diameter", "18mm±0.1mm", "--exposure", "1/50", "--out", tmp_path / "m.csv")
    names, row = (tmp_path / "m.csv").read_text().splitlines()
    answer = dict(zip(names.split(","), row.split(","), strict=True))
    assert answer["speed_unit"] == "m/s"
    assert float(answer["mean_speed"]) == pytest.approx(LENGTH * 0.001 * 50, rel=0.02)
    assert answer["source"] == "sweep"
    assert answer["acceleration_x"] == ""


@pytest.mark.parametrize(
    ("options", "meters"),
    [
        (("--scale", "1mm"), 0.001),
        (("--scale", "0,0,30,40=5cm+-1mm"), 0.001),
        (("--radius", "9e-3m"), 0.001),
    ],
)
def test_all_forms_of_scale_agree(measure, options, meters):
    """Exact: three forms of one scale."""
    result = measure(*options, "--exposure", "20ms", "--line-time", "0", "--json")
    numbers = json.loads(result.stdout)
    assert numbers["mean_speed"] == pytest.approx(LENGTH * meters / 0.02, rel=0.02)
    assert numbers["rolling_shutter_may_change"] == 0


def test_direction_corrects_rolling_shutter(measure):
    """Exact: downwards is slower than it appears, upwards faster, unknown is between."""
    speeds = [
        json.loads(measure("--exposure", "2ms", "--line-time", "15us", "--json", *going).stdout)
        for going in (("--going", "down"), (), ("--going", "up"))
    ]
    down, between, up = (one["mean_speed"] for one in speeds)
    assert down < between < up
    assert speeds[1]["mean_speed_std"] > 3 * speeds[0]["mean_speed_std"]


def test_rows_of_a_turned_camera(measure):
    """Exact: `--readout` replaces the order that the file states; --going is where it moved."""
    given = "--exposure", "2ms", "--line-time", "15us", "--json", "--going"
    across = 44 * 15e-6 / 2e-3  # columns crossed, in exposures; rows: 14
    speeds = {
        (readout, going): json.loads(measure(*given, going, "--readout", readout).stdout)
        for readout, going in (("right", "right"), ("left", "right"), ("down", "right"))
    }
    right, left, down = (one["mean_speed"] for one in speeds.values())
    assert left / right == pytest.approx((1 + across) / (1 - across), rel=0.05)
    assert down / right == pytest.approx((1 + across) / (1 + across * 14 / 44), rel=0.02)


def test_draws_overlay(measure, folder, tmp_path):
    """Exact: of the width of other sheets."""
    result = measure("--overlay", tmp_path / "m.png", "--image", folder / "image.png")
    assert result.exit_code == 0
    with Image.open(tmp_path / "m.png") as picture:
        assert picture.width == 1800


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--radius", "2 feet"), "--radius must be a length with its unit, like 4cm"),
        (("--radius", "1/0"), "--radius must be a length"),
        (("--radius", "1e400"), "--radius must be a length"),
        (("--exposure", "1e99999999"), "--exposure must be a time with its unit"),
        (("--radius", "1cm±1mm±1mm"), "--radius must be a length"),
        (("--radius", "0"), "--radius must be above 0, got '0'"),
        (("--radius", "1cm±-1mm"), "--radius must have an error of 0 or more"),
        (("--scale", "-1mm"), "--scale must be above 0, got '-1mm'"),
        (("--scale", "1,2,3,4=0m"), "--scale must be above 0"),
        (("--exposure", "1//60"), "--exposure must be a time with its unit"),
        (("--exposure", "-4ms"), "--exposure must be above 0, got '-4ms'"),
        (
            ("--line-time", "-1us"),
            "must be 0 or more, got '-1us'; if rows are read from the bottom",
        ),
        (("--readout", "back"), "--readout must be down, up, left or right, got 'back'"),
        (("--scale", "1,2,3=1m"), "--scale must be x0,y0,x1,y1=length"),
        (("--scale", "1,2,1,2=1m"), "the two points must differ"),
        (("--scale", "1mm", "--radius", "1cm"), "give one of --radius, --diameter"),
        (("--overlay", "a.png"), "--overlay needs --image"),
        (("--image", "a.png"), "--image needs --overlay"),
        (("--going", "up"), "--going needs --line-time"),
        (("--rate", "2"), "No such option: --rate"),
        (("--line-time", "1us"), "--line-time needs --exposure"),
        (("--line-time", "15ms", "--exposure", "4ms"), "is 1.08 s for 72 rows"),
        (("--going", "in"), "--going must be down, up, left or right, got 'in'"),
        (("--out", "m.txt"), "is written as .json or .csv"),
    ],
)
def test_measure_refuses_in_one_line(measure, options, said):
    """Door."""
    result = measure(*options)
    assert said in complaint(result)
    assert result.stdout == ""


def test_measures_layer_in_folder_of_results(folder, measure):
    """Exact: the same answer."""
    assert run("measure", folder).stdout == measure().stdout


def test_refuses_file_without_solution(folder):
    """Door."""
    result = run("measure", folder / "image.png")
    assert result.exit_code == 2
    assert "image.png" in result.stderr


def test_camera_gives_depth_of_ball(locate, tmp_path):
    """Oracle: a ball of 18 px and 20 mm, focal length 900 px; an error without a radius."""
    bm.write(tmp_path / "lens.json", bm.Intrinsics(900, 900, 47.5, 35.5))
    answer = locate(
        "--diameter", "20mm", "--exposure", "1/50", "--camera", tmp_path / "lens.json"
    ).stdout
    depth = float(answer.split("It was ")[1].split(" ")[0])
    assert depth == pytest.approx(900 * 0.01 / RADIUS, rel=0.02)
    assert "nothing of speed along the line of sight" in answer
    refused = locate("--camera", tmp_path / "lens.json")
    assert refused.exit_code == 2
    assert "--camera needs --radius or --diameter" in refused.stderr
    bm.write(tmp_path / "other.json", bm.Intrinsics(900, 900, 47.5, 35.5, size=(192, 144)))
    refused = locate("--radius", "10mm", "--camera", tmp_path / "other.json")
    assert "calibrated with pictures of 192x144 pixels, and this has 96x72" in refused.stderr


def test_plate_gives_flight_in_depth(folder, locate, tmp_path):
    """Oracle: with the plate the depth is that of the disc, and the motion along the line of sight is
    measured.
    """
    bm.write(tmp_path / "lens.json", bm.Intrinsics(900, 900, 47.5, 35.5))
    asked = "--radius", "10mm", "--exposure", "1/50", "--camera", tmp_path / "lens.json"
    pictures = "--image", folder / "image.png", "--plate", folder / "plate.png"
    fitted = json.loads(locate(*asked, *pictures, "--json").stdout)
    assert fitted["ball_path"] == "line"
    assert abs(fitted["ball_depth"] - 900 * 0.01 / RADIUS) < 4 * fitted["ball_depth_std"]
    across = LENGTH / RADIUS * 0.01 * 50
    found, std = fitted["ball_velocity_x"], fitted["ball_velocity_x_std"]
    assert abs(abs(found) - across * 44 / LENGTH) < 4 * std
    assert "--plate needs" in locate(*asked, "--plate", folder / "plate.png").stderr


def test_speed_gives_depth(locate, tmp_path):
    """Oracle: speed × time × focal length over the length in pixels."""
    bm.write(tmp_path / "lens.json", bm.Intrinsics(900, 900, 47.5, 35.5))
    lens = "--camera", tmp_path / "lens.json"
    answer = json.loads(locate("--speed", "36km/h", "--exposure", "10ms", *lens, "--json").stdout)
    assert abs(answer["blur_depth"] - 0.1 * 900 / LENGTH) < 4 * answer["blur_depth_std"]
    assert "needs --exposure" in locate("--speed", "10m/s", *lens).stderr


def test_four_points_give_speed_on_plane(locate):
    """Oracle: a square seen vertically from above, 1 cm per pixel."""
    corners = [("0,0", "0,0"), ("90,0", "90cm,0"), ("90,70", "90cm,0.7"), ("0,70", "0,70cm")]
    plane = [word for at, is_at in corners for word in ("--on-plane", f"{at}={is_at}")]
    answer = json.loads(locate(*plane, "--exposure", "10ms", "--json").stdout)
    assert abs(answer["plane_length"] - LENGTH / 100) < 4 * answer["plane_length_std"]
    assert answer["plane_speed"] == pytest.approx(answer["plane_length"] * 100)


def test_refuses_rotation_of_disc(measure):
    """Door: one line, and the exit code of undetermined data."""
    refused = measure("--rotation")
    assert refused.exit_code == 2
    assert "Traceback" not in refused.stderr


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ((), "give --camera with --diameter, --radius or --speed; or --on-plane"),
        (("--speed", "12m/s"), "--speed needs --camera"),
        (("--height", "1m"), "--height needs --on-plane"),
        (("--on-plane", "1,2=3"), "--on-plane must be like 120,300=0,1.5m"),
        (("--on-plane", "1,2=3,4"), "give --on-plane for 4 points or more, got 1"),
    ],
)
def test_locate_refuses_in_one_line(locate, options, said):
    """Door."""
    result = locate(*options)
    assert said in complaint(result)
    assert result.stdout == ""
