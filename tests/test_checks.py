"""Each check names the argument, the rule and the value; boxes of pixels."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from tests.scenes import rendered

import blurmatte as bm
from blurmatte.checks import (
    check_box,
    check_finite,
    check_kind,
    check_light,
    check_map,
    check_points,
    check_same_size,
    enclosing,
    rows_columns,
)
from blurmatte.rendering import Ball, Scene, colorful_plate
from blurmatte.trajectory import Trajectory


def test_valid_values_pass():
    check_light("image", np.zeros((2, 3, 3), np.float32))
    check_map("alpha", np.zeros((2, 3)), (2, 3))
    check_map("valid", np.zeros((2, 3), bool), (2, 3), kinds="b")
    check_map("quality", np.zeros((2, 3), np.uint8), (2, 3), kinds="u")
    check_finite("rgb", np.array([-1e6, 1e6]))
    check_finite("noise", np.array([0, 1e12]), limit=1e12)
    check_same_size("image", (3, 2), "plate", (3, 2))
    check_kind("number", 3, int | None, "such as 3")
    check_kind("number", None, int | None, "such as 3")
    check_box((0, 1, 9, 2), (3, 2))


def test_check_kind_names_argument_and_type():
    words = "number must be a int or float, got str; such as 3"
    with pytest.raises(TypeError, match=words):
        check_kind("number", "3", int | float | None, "such as 3")


@pytest.mark.parametrize("box", [(-1, 0, 2, 2), (1, 0, 1, 2), (3, 0, 5, 2), (0, 2, 2, 1)])
def test_rejects_empty_boxes(box):
    with pytest.raises(ValueError, match=r"begin in the picture of 3x2 pixels, got \("):
        check_box(box, (3, 2))


@pytest.mark.parametrize(
    ("value", "error", "words"),
    [
        ("picture.png", TypeError, "image must be a NumPy array of linear light, got str"),
        (np.zeros((2, 3, 3), int), TypeError, "image must hold linear light as floats, got int64"),
        (np.zeros((2, 3, 3), complex), TypeError, "as floats, got complex128"),
        (np.zeros((3, 3)), ValueError, r"image must have the shape .*, got \(3, 3\)"),
        (np.zeros((2, 3, 1)), ValueError, r"got \(2, 3, 1\)"),
        (np.zeros((2, 0, 3)), ValueError, r"got \(2, 0, 3\)"),
    ],
)
def test_rejects_arrays_that_are_no_light(value, error, words):
    with pytest.raises(error, match=words):
        check_light("image", value)


def test_rejects_arrays_that_are_no_map():
    with pytest.raises(TypeError, match="alpha must be a NumPy array, got float"):
        check_map("alpha", 0.5, (2, 3))
    with pytest.raises(TypeError, match="alpha must have a dtype of kind 'f', got bool"):
        check_map("alpha", np.zeros((2, 3), bool), (2, 3))
    with pytest.raises(ValueError, match=r"alpha must have the shape \(2, 3\), got \(3, 2\)"):
        check_map("alpha", np.zeros((3, 2)), (2, 3))


def test_rejects_arrays_that_are_no_points():
    with pytest.raises(ValueError, match=r"pixels must have the shape \(..., 2\), got \(4, 3\)"):
        check_points("pixels", np.zeros((4, 3)), 2)
    assert check_points("pixels", [1, 2], 2).dtype == float


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_rejects_values_that_are_not_finite(bad):
    with pytest.raises(ValueError, match="rgb must be finite"):
        check_finite("rgb", np.array([0, bad, 1]))


@pytest.mark.parametrize("value", [1.01e6, -1e38])
def test_light_beyond_what_32_bits_can_square_is_rejected(value):
    with pytest.raises(ValueError, match=r"rgb must not exceed 1e\+06 \(1 is white\)"):
        check_finite("rgb", np.array([0, value, 1]))


def test_rejects_different_sizes():
    with pytest.raises(ValueError, match="image is 3x2 pixels and plate 2x3; they must show"):
        check_same_size("image", (3, 2), "plate", (2, 3))


LIGHT = np.random.default_rng(0).uniform(0.1, 0.9, (6, 7, 3))


class Labeled:
    """An array of another library, such as a tensor or a labeled array."""

    def __init__(self, values):
        self.values = values

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.values, dtype)


@pytest.mark.parametrize(
    ("given", "dtype", "tolerance"),
    [
        (LIGHT.astype(">f4"), np.float32, 1e-7),
        (LIGHT.astype(">f8"), np.float64, 0),
        (LIGHT.astype(np.float16), np.float32, 1e-3),
        (LIGHT.astype(np.longdouble), np.float64, 0),
        (Labeled(LIGHT), np.float64, 0),
        (Labeled(LIGHT.astype(">f4")), np.float32, 1e-7),
        (np.asfortranarray(LIGHT), np.float64, 0),
        (LIGHT[::-1, ::-1][::-1, ::-1], np.float64, 0),
        (np.ma.masked_array(LIGHT), np.float64, 0),
    ],
    ids=["big-endian", "FITS", "half", "long", "tensor", "big tensor", "Fortran", "view", "no mask"],
)  # fmt: skip
def test_light_of_every_kind_of_array_is_taken(given, dtype, tolerance):
    """exact: 32 or 64-bit floats of this processor's byte order; solve accepts them."""
    picture = bm.LinearImage(given)
    assert picture.rgb.dtype == dtype
    assert picture.rgb.dtype.isnative
    assert type(picture.rgb) is np.ndarray
    np.testing.assert_allclose(picture.rgb, LIGHT, atol=tolerance, rtol=0)
    assert picture.valid.all()


def test_masked_pixels_are_not_valid():
    """exact: where any channel is masked, or `valid` is False; NaN below a mask is no error."""
    masked, valid = np.zeros(LIGHT.shape, bool), np.ones(LIGHT.shape[:2], bool)
    masked[1, 2, 0], valid[3, 4] = True, False
    light = np.where(masked, np.nan, LIGHT)
    picture = bm.LinearImage(np.ma.masked_array(light, masked), valid=valid)
    valid[1, 2] = False
    assert np.array_equal(picture.valid, valid)
    assert np.isfinite(picture.rgb).all()


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: bm.LinearImage(LIGHT.astype(object)), "rgb must be an array of numbers"),
        (lambda: bm.LinearImage(LIGHT.tolist()), "rgb must be a NumPy array .* got list"),
        (lambda: bm.LinearImage((255 * LIGHT).astype(int)), "rgb must hold linear light as floats"),
        (lambda: bm.LinearImage(LIGHT, np.ma.masked_array(LIGHT)), "noise must be an array without"),
        (lambda: bm.Layer(np.ma.masked_array(LIGHT[..., 0]), LIGHT), "alpha must be an array without"),
        (
            lambda: bm.streaks.Streak(np.ma.masked_array(LIGHT[..., 0] > 0)),
            "mask must be an array without",
        ),
        (lambda: bm.streaks.Streak([[True]]), "mask must be a NumPy array, got list"),
    ],
)  # fmt: skip
def test_arrays_that_cannot_be_taken_are_refused_by_name(make, says):
    """door."""
    with pytest.raises(TypeError, match=says):
        make()


def test_solve_takes_big_endian_and_read_only_arrays():
    """exact: the same answer as of native arrays."""
    plate = colorful_plate((64, 48), rng=1, tile=9)
    scene = Scene(plate, Trajectory.line((18, 20), (44, 26)), Ball(6, np.array([0.9, 0.5, 0.05])))
    noisy = [
        x + np.random.default_rng(k).normal(0, 1e-3, x.shape)
        for k, x in enumerate((rendered(scene).image.rgb, plate))
    ]
    model = bm.ColorModel.from_hex("#f3be40")
    native, big = (
        bm.solve(*(bm.LinearImage(x.astype(form)) for x in noisy), model, bm.Pixelwise())
        for form in ("<f8", ">f8")
    )
    assert np.array_equal(native.alpha, big.alpha, equal_nan=True)
    for x in noisy:
        x.flags.writeable = False
    again = bm.solve(*map(bm.LinearImage, noisy), model, bm.Pixelwise())
    assert np.array_equal(native.alpha, again.alpha, equal_nan=True)


def test_a_box_is_a_part_of_arrays_and_boxes_have_an_enclosing_one():
    picture = np.arange(48).reshape(6, 8)
    box, whole = (2, 1, 5, 4), (1, 1, 7, 6)
    assert_array_equal(picture[rows_columns(box)], picture[1:4, 2:5])
    part = picture[rows_columns(whole)]
    assert_array_equal(part[rows_columns(box, whole)], picture[rows_columns(box)])
    assert enclosing([box, (0, 3, 3, 6), (4, 2, 8, 3)]) == (0, 1, 8, 6)
    assert enclosing([box]) == box
