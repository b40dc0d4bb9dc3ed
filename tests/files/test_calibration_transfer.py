"""Transfer curves as files: exact round trips, and one-line errors for other content."""

import dataclasses
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import blurmatte as bm

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
def test_other_content_is_rejected(tmp_path, content, says):
    """Door: one line that begins with the file."""
    path = tmp_path / "c.json"
    path.write_bytes(content)
    with pytest.raises(bm.errors.FileError) as caught:
        bm.read_transfer(path)
    assert str(caught.value).startswith(
        f"{path}: give a file that blurmatte calibrate response wrote"
    )
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


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
