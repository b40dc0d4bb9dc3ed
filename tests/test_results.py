"""Folders of results: files, reports and errors."""

import json
import os
import stat
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from tests.disk import room_for
from tests.scenes import noisy, on_line

import blurmatte as bm
from blurmatte.cli.console import in_degrees
from blurmatte.clips.table import PictureRecord
from blurmatte.figures.sheet import Canvas
from blurmatte.matting.summary import Alternative, known_alpha, mean_light
from blurmatte.radiometry import hex_of_light
from blurmatte.rendering import colorful_plate
from blurmatte.results import RESULT_FILES

NOISE = bm.NoiseModel(gain=1e-5, read_std=5e-4)
NAMES = [
    *("alpha.png", "color.png", "layer.exr", "layer.png"),
    *("model.json", "overview.png", "report.json"),
]


def truth_of(color):
    """A ball before tiles."""
    plate = colorful_plate((96, 64), rng=2, tile=20)
    return on_line(plate, (30, 30), (60, 36), bm.rendering.Ball(9, color))


@pytest.fixture(scope="module")
def solved():
    """An image with one clipped pixel in the streak, its plate, and its solution."""
    truth = truth_of((0.9, 0.45, 0.05))
    image, plate = noisy(truth, NOISE, 1)
    image.valid[33, 45] = False
    streak = bm.streaks.Streak(truth.layer.alpha > 0)
    return image, plate, bm.solve(image, plate, truth.model, streak=streak)


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_all_files_are_written_and_round_trip(tmp_path, solved):
    folder = tmp_path / "a" / "b"
    written = bm.save_results(folder, *solved, command="blurmatte solve …", warnings=["swapped?"])
    assert [path.name for path in written] == NAMES
    assert list(RESULT_FILES) == NAMES
    assert sorted(content(folder)) == NAMES
    solution = solved[2]
    assert np.array_equal(bm.read_solution(folder / "layer.exr").alpha, solution.alpha)
    assert np.array_equal(bm.read_color_model(folder / "model.json").basis, solution.model.basis)
    alpha = bm.read(folder / "alpha.png", bm.LINEAR).rgb[..., 0]
    assert np.abs(alpha - solution.layer.alpha).max() <= 0.51 / 65535
    assert np.abs(bm.read_layer(folder / "layer.png").alpha - solution.layer.alpha).max() < 1e-5
    with Image.open(folder / "overview.png") as overview:
        assert overview.width == 1800


def test_color_is_displayed_where_alpha_is_certain(tmp_path, solved):
    bm.save_results(tmp_path, *solved)
    solution = solved[2]
    color = bm.read(tmp_path / "color.png").rgb
    sure = solution.streak & solution.known & (solution.alpha > 3 * solution.alpha_std)
    assert sure.sum() > 300
    assert not color[~sure].any()
    straight = np.clip(solution.layer.straight(), 0, 1)[sure]
    assert np.abs(bm.SRGB.encode(color[sure]) - bm.SRGB.encode(straight)).max() < 1e-4


def test_the_report_is_plain_json(tmp_path, solved):
    bm.save_results(tmp_path, *solved, command="blurmatte solve …", warnings=["swapped?"])

    def refuse(literal):
        raise AssertionError(literal)

    text = (tmp_path / "report.json").read_text("utf-8")
    report = json.loads(text, parse_constant=refuse)
    image, _, solution = solved
    assert report["command"] == "blurmatte solve …"
    assert report["warnings"] == ["swapped?"]
    assert report["image"]["size"] == list(image.size)
    assert report["model"]["hex"] == list(solution.model.hex)
    assert np.allclose(report["model"]["basis"], solution.model.basis, atol=0)
    assert report["solver"] == solution.solver
    assert report["grade"] == solution.stats.grade
    assert report["stats"]["sum_alpha"] == solution.stats.sum_alpha
    assert report["flagged"]["SATURATED"] == 1
    assert "OUTSIDE" not in report["flagged"]
    assert report["versions"]["numpy"] == np.__version__
    assert {"blurmatte", "numba", "OpenImageIO", "python"} <= set(report["versions"])


@pytest.mark.parametrize("axes", [("#ffbc43",), ("#00a1ff", "#ffd400")])
def test_an_object_has_one_color_in_text_sheet_report_and_tables(tmp_path, monkeypatch, axes):
    """Exact: of several paints that of the mean light of the layer, here white; of one its own."""
    drawn = []
    monkeypatch.setattr(Canvas, "text", lambda self, x, y, w, text, *_: drawn.append(text) or 20)
    model = bm.ColorModel.from_hex(*axes)
    light = np.array([0.8, 0.8, 0.7]) if model.rank == 2 else 0.3 * model.rgb[0]
    truth = truth_of(light)
    images = [replace(p, noise=NOISE) for p in (truth.image, truth.plate)]
    solution = bm.solve(
        *images, model, bm.Smooth(), streak=bm.streaks.Streak(truth.layer.alpha > 0)
    )
    bm.save_results(tmp_path, *images, solution)
    mean = solution.layer.color
    np.testing.assert_allclose(solution.model.mean, mean, rtol=1e-5)
    color = hex_of_light(mean) if model.rank == 2 else axes[0]
    assert in_degrees(solution.model).startswith(f"{color}, rank {model.rank}")
    assert any(text.startswith(f"{color}, rank {model.rank}") for text in drawn)
    assert json.loads((tmp_path / "report.json").read_text("utf-8"))["model"]["color"] == color
    assert json.loads((tmp_path / "model.json").read_text("utf-8"))["color"] == color
    assert PictureRecord.of(solution).color == color
    if model.rank == 2:
        np.testing.assert_allclose(mean / mean[0], light / light[0], rtol=0.05)  # it is shaded
        assert f"On average {color}." in bm.explain(solution.model)


def test_a_layer_of_no_alpha_has_no_mean_color():
    """Exact"""
    maps = bm.matting.PixelMaps.zeros(4, 5)
    assert mean_light(maps, *known_alpha(maps)) is None
    maps.alpha[1, 2], maps.premultiplied[1, 2] = 0.5, (0.5, 0.25, 0.1)
    np.testing.assert_allclose(mean_light(maps, *known_alpha(maps)), (1, 0.5, 0.2), rtol=1e-6)


def test_the_report_has_the_grade_and_the_calibrated_errors(tmp_path, solved):
    image, plate, solution = solved
    stats = replace(
        solution.stats,
        grade=bm.Grade.PLAUSIBLE,
        alpha_error=0.03,
        alpha_scale_std=0.04,
        grade_reasons=("noise",),
    )
    bm.save_results(tmp_path, image, plate, replace(solution, stats=stats))
    report = json.loads((tmp_path / "report.json").read_text("utf-8"))
    assert report["grade"] == "plausible"
    assert report["stats"]["alpha_error"] == 0.03
    assert report["stats"]["alpha_scale_std"] == 0.04
    assert report["stats"]["grade_reasons"] == ["noise"]
    assert report["in_words"][0].startswith("plausible: alpha within 0.03, its sum within 4 %; ")


def test_the_report_has_the_alternatives(tmp_path, solved):
    image, plate, solution = solved
    own = {"name": "no shape, one paint", "rgb": (0.4, 0.1, 0.02), "hex": "#aa5a27"}
    own |= {"weight": 0.9, "alpha_factor": 1.0, "alpha_difference": 0.0, "radius": None}
    other = {**own, "hex": "#a04020", "weight": 0.1, "alpha_factor": 1.3, "radius": 8.0}
    others = Alternative(**own), Alternative(**other)
    graded = {"grade": bm.Grade.ASSUMED, "alpha_scale_std": 0.2, "alternatives": others}
    saved = replace(solution, stats=replace(solution.stats, **graded))
    bm.save_results(tmp_path, image, plate, saved)
    report = json.loads((tmp_path / "report.json").read_text("utf-8"))
    found = report["stats"]["alternatives"]
    assert [one["hex"] for one in found] == ["#aa5a27", "#a04020"]
    assert [one["alpha_factor"] for one in found] == [1.0, 1.3]
    assert [one["radius"] for one in found] == [None, 8.0]
    assert any(said.startswith("Also fits: #a04020 with alpha x 1.30 (")
               for said in report["in_words"])  # fmt: skip
    assert any(said.startswith("All of alpha may be 0.80 to 1.30 times as large")
               for said in report["in_words"])  # fmt: skip
    assert bm.read_solution(tmp_path / "layer.exr").stats.alternatives == others


def test_old_results_are_replaced_and_others_left_alone(tmp_path, solved):
    bm.save_results(tmp_path, *solved)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "alpha.png").write_text("old")
    bm.save_results(tmp_path, *solved)
    assert sorted(content(tmp_path)) == sorted([*NAMES, "notes.txt"])
    assert (tmp_path / "alpha.png").read_bytes().startswith(b"\x89PNG")


def test_the_same_solution_gives_the_same_bytes(tmp_path, solved):
    for name in "ab":
        bm.save_results(tmp_path / name, *solved)
    assert content(tmp_path / "a") == content(tmp_path / "b")


@pytest.mark.parametrize("size", [500, 60_000])
def test_a_full_disk_changes_nothing(tmp_path, solved, size):
    folder = tmp_path / "there"
    folder.mkdir()
    for name in NAMES[::2]:
        (folder / name).write_text("old")
    before = content(folder)
    with room_for(size), pytest.raises(bm.errors.FileError) as caught:
        bm.save_results(folder, *solved)
    assert str(caught.value).startswith(f"{folder}/")
    assert ".blurmatte-" not in str(caught.value)
    assert content(folder) == before
    with room_for(size), pytest.raises(bm.errors.FileError):
        bm.save_results(tmp_path / "new" / "one", *solved)
    assert not (tmp_path / "new").exists()


def test_file_as_parent_folder_gives_one_line(tmp_path, solved):
    (tmp_path / "file").write_text("mine")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(bm.errors.FileError) as caught:
            bm.save_results(folder, *solved)
        assert str(caught.value).startswith(f"{folder}: check the folder")
        assert "\n" not in str(caught.value)
    assert (tmp_path / "file").read_text() == "mine"


def test_folder_of_the_name_of_a_file_is_named(tmp_path, solved):
    (tmp_path / "layer.exr").mkdir()
    with pytest.raises(bm.errors.FileError, match=r"layer\.exr: move or rename this folder"):
        bm.save_results(tmp_path, *solved)
    assert sorted(os.listdir(tmp_path)) == ["layer.exr"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder_gives_one_line(tmp_path, solved):
    (tmp_path / "closed").mkdir(mode=0o500)
    with pytest.raises(bm.errors.FileError, match="Permission denied"):
        bm.save_results(tmp_path / "closed", *solved)


def test_folders_have_the_usual_permissions(tmp_path, solved):
    (tmp_path / "usual").mkdir()
    bm.save_results(tmp_path / "ours", *solved)
    usual, ours = ((tmp_path / name).stat().st_mode for name in ("usual", "ours"))
    assert stat.S_IMODE(ours) == stat.S_IMODE(usual)


def test_rejects_different_sizes(tmp_path, solved):
    image, plate, solution = solved
    with pytest.raises(ValueError, match="plate is 96x30"):
        bm.save_results(tmp_path / "o", image, bm.LinearImage(plate.rgb[:30]), solution)
    assert not (tmp_path / "o").exists()
