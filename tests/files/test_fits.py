"""FITS: linear light of the stored numbers, whatever their type; what has no white is refused."""

import numpy as np
import pytest

from blurmatte.errors import FileError
from blurmatte.files.reading import read
from blurmatte.radiometry import LINEAR

BITPIX = {"uint8": 8, "int16": 16, "int32": 32, "float32": -32, "float64": -64}
LIGHT = np.linspace(0, 0.9, 12 * 20).reshape(12, 20)
UNSIGNED = (("BZERO", 32768), ("BSCALE", 1))


def write_fits(path, values, cards=()):
    """Write (h, w) or (3, h, w) values, the last row first, as the standard has it."""
    axes = [(f"NAXIS{i}", n) for i, n in enumerate(values.shape[::-1], 1)]
    head = ("SIMPLE", "T"), ("BITPIX", BITPIX[values.dtype.name]), ("NAXIS", values.ndim), *axes
    text = "".join(f"{name:<8}= {value!s:>20}".ljust(80) for name, value in (*head, *cards))
    text += "END"
    data = values[..., ::-1, :].astype(values.dtype.newbyteorder(">")).tobytes()
    blocks = (text.encode().ljust(-(-len(text) // 2880) * 2880), data + bytes(-len(data) % 2880))
    path.write_bytes(b"".join(blocks))
    return path


def codes_of_16_bits(light):
    return (np.rint(65535 * light) - 32768).astype(np.int16)


@pytest.mark.parametrize(
    ("values", "cards", "step"),
    [
        (codes_of_16_bits(LIGHT), UNSIGNED, 1 / 65535),
        (np.rint(255 * LIGHT).astype(np.uint8), (), 1 / 255),
        (LIGHT.astype(np.float32), (), 1e-6),
        (LIGHT.astype(np.float64), (), 1e-6),
        ((LIGHT / 2 - 0.1).astype(np.float32), (("BZERO", 0.2), ("BSCALE", 2.0)), 1e-6),
    ],
)
def test_gray_is_read_as_linear_light_upright(tmp_path, values, cards, step):
    image = read(write_fits(tmp_path / "a.fits", values, cards))
    np.testing.assert_allclose(image.rgb, np.repeat(LIGHT[..., None], 3, 2), atol=step)
    assert image.meta.gray
    assert image.meta.transfer in (None, LINEAR)
    assert not image.meta.transfer_assumed


def test_color_and_exposure_time_are_read(tmp_path):
    planes = np.stack([LIGHT, LIGHT / 2, LIGHT / 4]).astype(np.float32)
    image = read(write_fits(tmp_path / "a.fit", planes, [("EXPTIME", 0.02)]))
    np.testing.assert_allclose(image.rgb, np.moveaxis(planes, 0, -1), atol=1e-6)
    assert image.meta.exposure_time == pytest.approx(0.02)


def test_saturated_codes_are_not_valid(tmp_path):
    light = LIGHT.copy()
    light[0, :3] = 1
    image = read(write_fits(tmp_path / "a.fits", codes_of_16_bits(light), UNSIGNED))
    assert np.count_nonzero(~image.valid) == 3
    assert not image.valid[0, :3].any()


@pytest.mark.parametrize(
    ("values", "cards", "says"),
    [
        (np.zeros((12, 20), np.int16), (), "unsigned integers of 16 bits"),
        (np.zeros((12, 20), np.int32), (), "unsigned integers of 16 bits"),
        (np.full((12, 20), 4e3, np.float32), (), "so that 1 is white"),
        (LIGHT.astype(np.float32), [("BAYERPAT", "'RGGB    '")], "debayer"),
        (LIGHT.astype(np.float32), [("BZERO", "'dark    '")], "is no number"),
        (np.full((12, 20), np.nan, np.float32), (), "NaN"),
    ],
)
def test_what_is_no_light_up_to_white_is_refused(tmp_path, values, cards, says):
    with pytest.raises(FileError, match=says) as caught:
        read(write_fits(tmp_path / "a.fits", values, cards))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("kept", [100, 2880, 3000])
def test_cut_file_is_refused(tmp_path, kept):
    path = write_fits(tmp_path / "a.fits", LIGHT.astype(np.float32))
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(FileError):
        read(path)
