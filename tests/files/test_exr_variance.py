import numpy as np
import OpenEXR
import pytest
from numpy.testing import assert_allclose

from blurmatte.errors import FileError
from blurmatte.files.raster_writing import save_pixels
from blurmatte.files.reading import read, read_layer
from blurmatte.files.writing import write
from blurmatte.radiometry import SRGB, LinearImage, NoiseModel


@pytest.fixture
def plate(ramp):
    """Light with a variance of its own in each pixel, a corner of it not valid."""
    light = SRGB.decode((ramp + 0.3) / 256).astype(np.float32)
    variance = (1e-6 * (1 + np.arange(light.size).reshape(light.shape))).astype(np.float32)
    valid = np.ones(light.shape[:2], bool)
    valid[:5, :7] = False
    return LinearImage(light, variance, valid)


def test_variance_and_valid_round_trip(tmp_path, plate):
    # exact
    write(tmp_path / "a.exr", plate)
    back = read(tmp_path / "a.exr")
    assert np.array_equal(back.rgb, plate.rgb)
    assert np.array_equal(back.variance, plate.variance)
    assert np.array_equal(back.valid, plate.valid)


def test_noise_model_is_stored_as_variance(tmp_path, plate):
    # exact
    noise = NoiseModel(gain=1e-4, read_std=1e-3)
    write(tmp_path / "a.exr", LinearImage(plate.rgb, noise))
    back = read(tmp_path / "a.exr")
    assert_allclose(back.variance, noise.variance(plate.rgb), rtol=1e-6)
    assert back.valid.all()


def test_unknown_noise_stays_unknown(tmp_path, plate):
    write(tmp_path / "a.exr", LinearImage(plate.rgb, valid=plate.valid))
    back = read(tmp_path / "a.exr")
    assert back.noise is None
    assert np.array_equal(back.valid, plate.valid)


def test_other_programs_see_plain_rgb(tmp_path, plate):
    # oracle
    write(tmp_path / "a.exr", plate)
    channels = OpenEXR.File(str(tmp_path / "a.exr")).channels()
    assert np.array_equal(channels["RGB"].pixels, plate.rgb)
    assert set(channels) == {"RGB", "variance", "valid"} or "variance.R" in channels


def test_picture_without_noise_has_no_extra_channels(tmp_path, plate):
    write(tmp_path / "a.png", plate)
    back = read(tmp_path / "a.png")
    assert back.noise is None
    assert back.valid.all()


def test_variance_channels_of_other_programs_are_ignored(tmp_path, plate):
    # door: a renderer's variance is of another kind
    names = [*"RGB", "variance.R", "variance.G", "variance.B", "valid"]
    save_pixels(tmp_path / "a.exr", [plate.rgb, plate.variance, plate.valid * 0.0], names, {})
    back = read(tmp_path / "a.exr")
    assert back.noise is None
    assert back.valid.all()
    with pytest.raises(FileError, match="has no alpha"):
        read_layer(tmp_path / "a.exr")


def test_invalid_variance_is_rejected(tmp_path, plate):
    # door
    names = [*"RGB", "variance.R", "variance.G", "variance.B"]
    marked = {"blurmatte:light": "variance.R variance.G variance.B"}
    save_pixels(tmp_path / "a.exr", [plate.rgb, -plate.variance], names, marked)
    with pytest.raises(FileError, match="its variance has negative or infinite values"):
        read(tmp_path / "a.exr")
