"""What the reader of napari makes of files and folders, without napari."""

import csv
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.scenes import SMALL_BALL, rendered

import blurmatte as bm
from blurmatte.clips.table import FrameRecord
from blurmatte.napari import get_reader
from blurmatte.sweep.discs import fit_disc

SOURCE = Path(bm.__file__).parent


@pytest.fixture(scope="module")
def solved():
    """A solution with a sweep."""
    truth, noise = rendered(SMALL_BALL), bm.NoiseModel(0, 1e-3)
    image, plate = (
        bm.LinearImage(light.rgb.astype(np.float32), noise) for light in (truth.image, truth.plate)
    )
    model = bm.ColorModel.from_hex("#f3be40")
    (streak,) = bm.find_streaks(image, plate)
    solution = bm.solve(image, plate, model, bm.Pixelwise(), streak=streak)
    return replace(solution, sweep=fit_disc(image, plate, streak, model))


def layers_of(path):
    reader = get_reader(str(path))
    assert reader is not None
    return reader(str(path))


def test_the_manifest_names_a_reader_that_exists():
    """Exact: it needs no other package, and the package names the manifest."""
    manifest = yaml.safe_load((SOURCE / "napari" / "napari.yaml").read_text(encoding="utf-8"))
    (command,) = manifest["contributions"]["commands"]
    (reader,) = manifest["contributions"]["readers"]
    assert reader["command"] == command["id"]
    assert reader["accepts_directories"] is True
    assert command["python_name"] == f"{get_reader.__module__}:{get_reader.__name__}"
    assert manifest["name"] == "blurmatte"


def test_the_package_states_where_the_manifest_is():
    text = (SOURCE.parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    if not text.partition("[project]")[1]:
        pytest.skip("not a checkout")
    assert (
        '[project.entry-points."napari.manifest"]\nblurmatte = "blurmatte.napari:napari.yaml"'
        in text
    )
    for found in entry_points(group="napari.manifest", name="blurmatte"):
        assert found.value == "blurmatte.napari:napari.yaml"


def test_a_solution_gives_object_alpha_error_flags_and_path(solved, tmp_path):
    """Exact: the numbers of the solution, points as (y, x)."""
    bm.write(tmp_path / "ball.exr", solved)
    layers = layers_of(tmp_path / "ball.exr")
    names = ["ball", "ball: alpha", "ball: error of alpha", "ball: flags", "ball: path"]
    assert [options["name"] for _, options, _ in layers] == names
    assert [kind for _, _, kind in layers] == ["image", "image", "image", "labels", "shapes"]
    seen, alpha, error, flags, path = (data for data, _, _ in layers)
    assert seen.shape == (48, 64, 4)
    assert 0 <= seen.min() <= seen.max() <= 1
    assert np.array_equal(seen[..., 3], solved.layer.alpha)
    assert np.array_equal(alpha, solved.alpha)
    finite = np.isfinite(solved.alpha_std)
    assert np.array_equal(error[finite], solved.alpha_std[finite])
    assert np.array_equal(flags, solved.quality)
    np.testing.assert_allclose(path[0], bm.measure_motion(solved).trajectory.xy[:, ::-1], atol=1e-9)
    assert len(path) == len(layers[4][1]["shape_type"]) == 3
    for _, options, _ in layers:
        assert options["scale"] == (1.0, 1.0)
        assert options["units"] == ("pixel", "pixel")


def test_the_flags_of_a_pixel_have_names(solved, tmp_path):
    """Exact"""
    bm.write(tmp_path / "ball.exr", solved)
    _, options, _ = layers_of(tmp_path / "ball.exr")[3]
    texts = dict(zip(options["features"]["index"], options["features"]["flags"], strict=True))
    assert texts[int(bm.matting.Quality.OUTSIDE)] == "outside"
    assert set(texts) == set(np.unique(solved.quality).tolist())


def test_layers_and_pictures_are_shown_as_a_screen_does(tmp_path):
    """Exact: code values of the straight color."""
    alpha = np.full((8, 9), 0.5, np.float32)
    bm.write(tmp_path / "a.exr", bm.Layer(alpha, alpha[..., None] * np.float32([0.2, 0.4, 0.8])))
    ((data, options, kind),) = layers_of(tmp_path / "a.exr")
    assert (kind, options["rgb"]) == ("image", True)
    codes = bm.SRGB.encode(np.array([0.2, 0.4, 0.8]))
    np.testing.assert_allclose(data[3, 4], [*codes, 0.5], atol=1e-6)
    bm.write(tmp_path / "b.exr", bm.LinearImage(np.full((8, 9, 3), 0.5)))
    ((data, options, kind),) = layers_of(tmp_path / "b.exr")
    assert data.shape == (8, 9, 3)
    np.testing.assert_allclose(data, bm.SRGB.encode(np.array(0.5)), atol=1e-6)


def test_the_folder_of_a_clip_gives_its_plate_and_tracks(tmp_path):
    """Exact: rows without a place are no points; numbers of a table are features."""
    records = [
        FrameRecord(3, 0.1, 2, 1, x=5.0, y=7.0, radius=2.5, grade="confirmed"),
        FrameRecord(2, None, 1, 1, x=4.0, y=6.0, radius=2.0, grade="plausible"),
        FrameRecord(4, 0.1, 1, 1, reason="nothing"),
    ]
    bm.write(tmp_path / "frames.csv", [one.numbers() for one in records])
    bm.write(tmp_path / "plate.exr", bm.LinearImage(np.full((8, 9, 3), 0.5)))
    plate, tracks = layers_of(tmp_path)
    assert plate[1]["name"] == f"{tmp_path.name}: plate"
    data, options, kind = tracks
    assert kind == "tracks"
    assert data.tolist() == [[1, 2, 6, 4], [2, 3, 7, 5]]
    assert options["features"]["radius"] == [2.0, 2.5]
    assert options["features"]["grade"] == ["plausible", "confirmed"]
    assert np.isnan(options["features"]["time"][0])
    assert options["units"] == ("dimensionless", "pixel", "pixel")


def test_files_of_others_are_left_to_others(tmp_path):
    """door."""
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\xff")
    names = "other.csv", "empty.csv", "picture.png", "binary.csv", "none.csv", "none.exr.zip", ""
    for name in names:
        assert get_reader(str(tmp_path / name)) is None
    assert get_reader([]) is None


def test_tracks_written_for_napari_are_read(tmp_path):
    """Exact"""
    rows = [
        {"frame": k, "time": k / 30, "object": 1, "track": 1, "x": 2.0 * k, "y": 3.0, "radius": 1.5}
        for k in range(3)
    ]
    bm.write(tmp_path / "a.napari.csv", rows)
    with (tmp_path / "a.napari.csv").open() as file:
        assert next(csv.reader(file))[:4] == ["track_id", "t", "y", "x"]
    ((data, options, _),) = layers_of(tmp_path / "a.napari.csv")
    assert data.tolist() == [[1, k, 3, 2 * k] for k in range(3)]
    assert options["features"]["radius"] == [1.5] * 3
