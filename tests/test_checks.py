"""Each check names the argument, the rule and the value."""

import numpy as np
import pytest

from blurmatte.checks import (
    check_box,
    check_finite,
    check_kind,
    check_light,
    check_map,
    check_points,
    check_same_size,
)


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
