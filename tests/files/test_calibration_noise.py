"""The noise of a camera as JSON."""

import json

import numpy as np
import pytest

from blurmatte.calibration import NoiseFit
from blurmatte.color import ColorModel
from blurmatte.errors import FileError
from blurmatte.files import read_noise, write
from blurmatte.radiometry import NoiseModel

NOISE = NoiseModel(gain=(2e-4, 1e-4, 4e-4), read_std=(0.002, 0.0015, 0.003), relative_std=1 / 3)


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
