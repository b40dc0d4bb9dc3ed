"""Models as JSON: exact round trips, and one-line errors for other content."""

import dataclasses
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.files.conftest import refusal

import blurmatte as bm
from blurmatte.calibration import NoiseFit
from blurmatte.color.model import ColorModel
from blurmatte.errors import FileError
from blurmatte.files.models import (
    path_to_mapping,
    read_color_model,
    read_noise,
    read_path,
    sweep_from_json,
    sweep_to_json,
)
from blurmatte.files.writing import write
from blurmatte.radiometry import NoiseModel
from blurmatte.sweep import Sweep
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.path import path_family
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE, Silhouette
from blurmatte.sweep.sweep import Diagnostics
from blurmatte.trajectory import Trajectory

FAMILIES = "line", "parabola", "cubic", "arc", "bounce", "from rest"
NOISE = NoiseModel(gain=(2e-4, 1e-4, 4e-4), read_std=(0.002, 0.0015, 0.003), relative_std=1 / 3)
FIT = bm.calibration.ResponseFit(
    transfer=bm.radiometry.Transfer.from_table("mine", bm.SRGB.table(4081)),
    std=np.full(256, 0.01),
    exposure_times=(0.1, 0.2),
    noise=0.004,
    agreement=0.97,
    seen=(0.02, 0.98),
    channel_difference=(0.01, 0.0, 0.02),
    channels_agree=True,
    residuals=np.full((2, 16), np.nan),
)


@pytest.mark.parametrize("colors", [("#d8ff3c",), ("#d8ff3c", "#3c10ff")])
def test_color_model_round_trips_exactly(tmp_path, colors):
    basis = ColorModel.from_hex(*colors).basis
    covariance = np.cov(np.random.default_rng(0).random((3, 9))) / 7
    to_srgb = ((1.7, -0.5, 0.1), (-0.2, 1.1, 0.1), (0.0, -0.3, 1 / 3))
    mean = np.array([0.1, 1 / 3, 0.0])
    model = ColorModel(basis, covariance, {"hue": 1 / 3, "feasible": np.inf}, to_srgb, mean)
    write(tmp_path / "m.json", model)
    back = read_color_model(tmp_path / "m.json")
    assert np.array_equal(back.basis, basis)
    assert np.array_equal(back.covariance, covariance)
    assert back.evidence == model.evidence
    assert back.to_srgb == to_srgb
    assert np.array_equal(back.mean, mean)


def test_every_field_is_written():
    """A new field of ColorModel must be written and read too."""
    names = {field.name for field in dataclasses.fields(ColorModel)}
    assert names == {"basis", "covariance", "evidence", "to_srgb", "mean"}


def test_file_is_readable_json(tmp_path):
    write(tmp_path / "m.json", ColorModel.from_hex("#d8ff3c"))
    fields = json.loads((tmp_path / "m.json").read_text(), parse_constant=pytest.fail)
    assert fields["rank"] == 1
    assert fields["hex"] == ["#d8ff3c"]
    assert fields["color"] == "#d8ff3c"


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"{", "the text is no JSON"),
        (b"\x89PNG\xff\xfe", "no text in UTF-8"),
        (b"[1, 2]", "the file holds no color model"),
        (b"3", "the file holds no color model"),
        (b'{"basis": [[1], [0], [0]]}', "the file holds no color model"),
        (
            b'{"basis": [[2], [0], [0]], "covariance": [[0,0,0],[0,0,0],[0,0,0]], "evidence": {}}',
            "the file holds no color model",
        ),
    ],
)
def test_other_content_is_rejected(tmp_path, content, says):
    (tmp_path / "a.json").write_bytes(content)
    said = refusal(tmp_path / "a.json", reader=read_color_model)
    assert said.startswith("give a file that blurmatte wrote")
    assert says in said


def test_missing_model_and_folder(tmp_path):
    with pytest.raises(FileError, match="there is no such file"):
        read_color_model(tmp_path / "m.json")
    with pytest.raises(FileError, match="this is a folder"):
        read_color_model(tmp_path)


def test_report_is_standard_json(tmp_path):
    report = {
        "größe": (np.int64(3), np.float32(0.5)),
        "open": [1.0, np.inf, -np.inf, np.nan],
        "array": np.eye(2),
        "deep": {"empty": {}, "none": None, "words": ["a", "b"], "yes": np.bool_(True)},
        "name": "bytes \udcff",
    }
    write(tmp_path / "r.json", report)
    assert json.loads((tmp_path / "r.json").read_text("utf-8")) == {
        "größe": [3, 0.5],
        "open": [1.0, None, None, None],
        "array": [[1.0, 0.0], [0.0, 1.0]],
        "deep": {"empty": {}, "none": None, "words": ["a", "b"], "yes": True},
        "name": r"bytes \udcff",
    }


def test_report_rejects_other_types(tmp_path):
    with pytest.raises(TypeError, match="must hold numbers, text"):
        write(tmp_path / "r.json", {"a": object()})
    assert not (tmp_path / "r.json").exists()


@pytest.mark.parametrize("radius", [None, 7.5])
def test_path_round_trips(tmp_path, radius):
    path = Trajectory.bounce((1, 2), (30.25, 4), (50, 1), at=0.3)
    write(tmp_path / "path.json", path_to_mapping(path, radius))
    again, size = read_path(tmp_path / "path.json")
    assert_allclose(again.xy, path.xy)
    assert_allclose(again.t, path.t)
    assert size == radius


@pytest.mark.parametrize("text", ["[]", "{}", "nothing", '{"xy": [[1, 2]], "t": [0]}'])
def test_json_that_is_no_path_is_rejected(tmp_path, text):
    (tmp_path / "path.json").write_text(text)
    with pytest.raises(FileError, match=r"path.json: give .*; the file holds no path"):
        read_path(tmp_path / "path.json")


def test_missing_file_is_named(tmp_path):
    with pytest.raises(FileError, match=r"nowhere.json: check the name; there is no such file"):
        read_path(tmp_path / "nowhere.json")


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize(
    "silhouette",
    [
        DISC,
        ELLIPSE,
        Silhouette(4, turns=True),
        Silhouette(4, changes=True),
        Silhouette(camera_stretch=(0.1, -0.2)),
        Silhouette(opacity=0.3),
    ],
)
def test_sweep_round_trips_exactly(name, silhouette):
    """Exact."""
    rng, family = np.random.default_rng(0), path_family(name)
    n = family.size + silhouette.size
    model = ColorModel(ColorModel.from_hex("#d8ff3c").basis, 1e-4 * np.eye(3), {"shape": np.inf})
    sweep = Sweep(
        family,
        100 * rng.uniform(size=family.size),
        silhouette,
        rng.uniform(size=silhouette.size),
        model,
        np.cov(rng.normal(size=(n, 2 * n))),
        (640, 480),
        Diagnostics("leaves the streak", False, 1.1, radius_error=np.inf, chroma_blur=0.3),
        CastShadow((*rng.normal(size=2),), 3.3, (*rng.uniform(size=3),))
        if silhouette is DISC
        else None,
        0.02,
    )
    back = sweep_from_json(sweep_to_json(sweep))
    assert (back.family, back.silhouette, back.size) == (family, silhouette, (640, 480))
    for field in ("path", "shape", "covariance"):
        assert np.array_equal(getattr(back, field), getattr(sweep, field))
    assert np.array_equal(back.model.basis, model.basis)
    assert back.diagnostics == sweep.diagnostics
    assert back.opacity_std == sweep.opacity_std
    assert back.rejection == sweep.rejection
    assert back.cast == sweep.cast


def test_unknown_path_family_is_rejected():
    """Door."""
    with pytest.raises(ValueError, match="a path is one of line, arc"):
        path_family("spiral")
    with pytest.raises(ValueError, match="family is missing"):
        sweep_from_json(json.dumps({"size": [1, 2]}))


@pytest.mark.parametrize("old", [{"bulges": 0}, {"stats": {"misfit": 1.1}}])
def test_sweep_of_an_older_version_is_rejected(old):
    """Door."""
    with pytest.raises(FileError, match="solve its picture again; the sweep of an older blurmatte"):
        sweep_from_json(json.dumps({"size": [1, 2], **old}))


def fit():
    covariance = np.tile(np.diag([1e-12, 1e-10, 1e-8]), (3, 1, 1))
    coherence = np.array([[1, 2, 3, 4.0]] * 3)
    rounding = NoiseModel(read_std=1e-4)
    return NoiseFit(NOISE, rounding, covariance, (), (), (), coherence, 0.25)


def test_noise_model_round_trips_exactly(tmp_path):
    """Exact."""
    write(tmp_path / "noise.json", NOISE)
    assert read_noise(tmp_path / "noise.json") == NOISE


def test_noise_fit_round_trips_with_its_rounding(tmp_path):
    """Exact; its errors are for information."""
    write(tmp_path / "noise.json", fit())
    assert read_noise(str(tmp_path / "noise.json")) == fit().noise
    fields = json.loads((tmp_path / "noise.json").read_text())
    assert fields["sensor"]["gain_std"] == [1e-5] * 3
    assert fields["coherence"]["16x16"] == [4.0] * 3
    assert fields["scale"] == [2.0] * 3
    assert fields["changed"] == 0.25


@pytest.mark.parametrize(
    "text",
    ["[]", "{}", "3", '{"gain": [1, 2], "read_std": [0, 0, 0], "relative_std": [0, 0, 0]}',
     '{"gain": [-1, 2, 3], "read_std": [0, 0, 0], "relative_std": [0, 0, 0]}',
     '{"gain": "abc", "read_std": [0, 0, 0], "relative_std": [0, 0, 0]}'],
)  # fmt: skip
def test_other_json_is_rejected(tmp_path, text):
    """Door."""
    (tmp_path / "noise.json").write_text(text)
    with pytest.raises(FileError, match=r"noise.json: give a file that .* holds no noise model"):
        read_noise(tmp_path / "noise.json")


def test_other_files_are_rejected(tmp_path):
    """Door."""
    write(tmp_path / "model.json", ColorModel.from_hex("#ff8000"))
    with pytest.raises(FileError, match=r"model.json: .* holds no noise model"):
        read_noise(tmp_path / "model.json")
    (tmp_path / "half.json").write_text('{"gain": [')
    with pytest.raises(FileError, match=r"half.json: .* is no JSON: .* at line 1"):
        read_noise(tmp_path / "half.json")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\xff")
    with pytest.raises(FileError, match=r"picture.png: .* is no text in UTF-8"):
        read_noise(tmp_path / "picture.png")
    with pytest.raises(FileError, match=r"nowhere.json: check the name; there is no such file"):
        read_noise(tmp_path / "nowhere.json")
    with pytest.raises(FileError, match=r"a NoiseModel is written as .json"):
        write(tmp_path / "noise.png", NOISE)


@pytest.mark.parametrize("thing", [FIT, FIT.transfer])
def test_transfer_table_round_trips(tmp_path, thing):
    """Exact: a table of the usual length has every digit."""
    bm.write(tmp_path / "c.json", thing)
    back = bm.read_transfer(tmp_path / "c.json")
    assert back.name == "mine"
    v = np.linspace(-0.5, 1.5, 999)
    assert_array_equal(back.decode(v), FIT.transfer.decode(v))
    assert_array_equal(back.encode(v), FIT.transfer.encode(v))


def test_any_curve_can_be_written(tmp_path):
    """Oracle: a formula becomes a table."""
    bm.write(tmp_path / "c.json", bm.radiometry.gamma(2.2))
    back = bm.read_transfer(tmp_path / "c.json")
    v = np.linspace(0, 1, 999)
    assert_allclose(back.decode(v), v**2.2, atol=1e-6)


def test_every_field_of_a_response_fit_is_written(tmp_path):
    """Exact."""
    bm.write(tmp_path / "c.json", FIT)
    fields = json.loads((tmp_path / "c.json").read_text(), parse_constant=pytest.fail)
    names = {field.name for field in dataclasses.fields(bm.calibration.ResponseFit)}
    assert names - set(fields) == {"transfer"}
    assert fields["std"] == [0.01] * 256
    assert fields["residuals"][0][0] is None


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"\x89PNG\xff\xfe", "no text in UTF-8"),
        (b"[1, 2]", "holds no transfer curve"),
        (b'{"name": "x"}', "holds no transfer curve"),
        (
            b'{"name": "x", "light": [0]}',
            "holds no transfer curve (light must be two or more",
        ),
        (b'{"name": "x", "light": [0, 2, 1]}', "holds no transfer curve (light must rise"),
        (b'{"name": "x", "light": [0, "a"]}', "holds no transfer curve"),
        (b'{"name": "x", "light": [0, [1]]}', "holds no transfer curve"),
        (b'{"name": "x", "light": [0, NaN]}', "holds no transfer curve"),
    ],
)
def test_another_curve_is_rejected(tmp_path, content, says):
    """Door: one line that begins with the file."""
    (tmp_path / "a.json").write_bytes(content)
    said = refusal(tmp_path / "a.json", reader=bm.read_transfer)
    assert said.startswith("give a file that blurmatte calibrate response wrote")
    assert says in said


def test_curves_and_color_models_are_distinguished(tmp_path):
    """Door: each reader names the kind of the other file."""
    curve, model = tmp_path / "curve.json", tmp_path / "model.json"
    bm.write(curve, bm.SRGB)
    bm.write(model, bm.ColorModel.from_hex("#d8ff3c"))
    with pytest.raises(
        bm.errors.FileError, match=r"give a file that blurmatte calibrate .*it holds a color model"
    ):
        bm.read_transfer(model)
    with pytest.raises(bm.errors.FileError, match=r"give a file .* holds a transfer curve"):
        bm.read_color_model(curve)


def test_other_extensions_are_rejected(tmp_path):
    """Door: a curve is no picture."""
    with pytest.raises(bm.errors.FileError, match=r"a Transfer is written as \.json"):
        bm.write(tmp_path / "c.png", bm.SRGB)
    with pytest.raises(bm.errors.FileError, match="there is no such file"):
        bm.read_transfer(tmp_path / "none.json")
