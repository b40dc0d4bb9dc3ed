"""Pictures in the colors of a camera as EXR."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.errors import FileError
from blurmatte.files.reading import read
from blurmatte.files.writing import write
from blurmatte.radiometry import LinearImage, Meta, check_same_colors

META = Meta(
    "a.exr",
    exposure_time=0.25,
    color_space="camera",
    camera="Example C1",
    white_balance=(2.0, 1.0, 1.25),
    to_srgb=((3.2, -0.6, -0.1), (-0.4, 1.6, -0.6), (0.1, -0.5, 1.75)),
)


@pytest.fixture
def picture():
    rgb = np.random.default_rng(5).uniform(-0.01, 1, (24, 30, 3)).astype(np.float32)
    return LinearImage(rgb, meta=META)


def test_camera_colors_round_trip_in_an_exr(tmp_path, picture):
    """Exact, to the rounding of float32."""
    write(tmp_path / "a.exr", picture)
    back = read(tmp_path / "a.exr")
    assert_allclose(back.rgb, picture.rgb, atol=1e-6)
    assert back.meta == META
    check_same_colors("the image", picture, "the plate", back)


def test_other_programs_see_srgb(tmp_path, picture):
    """A program that drops the header leaves the picture as it looks."""
    write(tmp_path / "a.exr", picture)
    renamed = (tmp_path / "a.exr").read_bytes().replace(b"blurmatte:camera", b"otherwise:camera")
    (tmp_path / "b.exr").write_bytes(renamed)
    seen = read(tmp_path / "b.exr")
    assert seen.meta.color_space == "sRGB"
    assert_allclose(seen.rgb, picture.in_srgb().rgb, atol=1e-6)


def test_exr_without_camera_stays_srgb(tmp_path, picture):
    plain = replace(picture, meta=Meta())
    write(tmp_path / "a.exr", plain)
    back = read(tmp_path / "a.exr")
    assert back.meta.color_space == "sRGB"
    assert np.array_equal(back.rgb, plain.rgb)


def test_changed_header_is_rejected(tmp_path, picture):
    """Door."""
    path = tmp_path / "a.exr"
    write(path, picture)
    path.write_bytes(path.read_bytes().replace(b"to_srgb", b"to_mars"))
    with pytest.raises(FileError) as caught:
        read(path)
    assert str(caught.value).startswith(
        f"{path}: give the EXR as blurmatte.write made it; another program or version wrote its header"
    )
