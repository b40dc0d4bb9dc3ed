import dataclasses
import json

import numpy as np
import pytest

from blurmatte.color import ColorModel
from blurmatte.errors import FileError
from blurmatte.files import read_color_model, write


@pytest.mark.parametrize("colors", [("#d8ff3c",), ("#d8ff3c", "#3c10ff")])
def test_noise_model_round_trips_exactly(tmp_path, colors):
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
    path = tmp_path / "m.json"
    path.write_bytes(content)
    with pytest.raises(FileError) as caught:
        read_color_model(path)
    assert str(caught.value).startswith(f"{path}: give a file that blurmatte wrote")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


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
