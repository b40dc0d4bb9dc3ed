"""Each check names the argument, the rule and the value; boxes of pixels."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from PIL import Image
from tests.scenes import SMALL_BALL, rendered

import blurmatte as bm
from blurmatte.checks import (
    as_array,
    box_of,
    check_box,
    check_finite,
    check_kind,
    check_light,
    check_map,
    check_points,
    check_same_size,
    enclosing,
    grown,
    rows_columns,
)
from blurmatte.metrics import alpha_rmse
from blurmatte.rendering import Ball, Scene
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
    with pytest.raises(TypeError, match="alpha must hold floats, got bool"):
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


class Exchanged:
    """An array that only exports its memory by DLPack, of a kind of device: 1 is main memory."""

    def __init__(self, values, device=1):
        self.values, self.device = values, device

    def __dlpack_device__(self):
        return self.device, 0

    def __dlpack__(self, **asked):
        return self.values.__dlpack__(**asked)


class Described:
    """A picture that describes its memory, as Pillow does."""

    def __init__(self, values):
        self.__array_interface__ = values.__array_interface__
        self.values = values


class Tensor(Labeled):
    """A tensor on a GPU, or one that is followed by a gradient."""

    def __init__(self, values, device=2, requires_grad=False):
        super().__init__(values)
        self.device, self.requires_grad = device, requires_grad

    def __dlpack_device__(self):
        return self.device, 0

    def cpu(self):
        return Labeled(self.values)


class Quantity(Labeled):
    """Numbers with a unit, as of pint."""

    def __init__(self, values, units):
        super().__init__(values)
        self.units, self.magnitude = units, values


class Axes(Labeled):
    """An array with names of its axes, as of xarray."""

    def __init__(self, values, *dims, data=None):
        super().__init__(values)
        self.dims, self.data = dims, values if data is None else data


class Unseen:
    """An array that NumPy cannot view."""

    def __array__(self, dtype=None, copy=None):
        raise TypeError("Got unsupported ScalarType BFloat16\nand more")


def spread_out(values):
    """The same numbers, every second of a larger array."""
    wide = np.zeros([2 * side for side in values.shape], values.dtype)
    wide[::2, ::2, ::2] = values
    return wide[::2, ::2, ::2]


def read_only(values):
    values = values.copy()
    values.flags.writeable = False
    return values


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
        (spread_out(LIGHT), np.float64, 0),
        (read_only(LIGHT), np.float64, 0),
        (Exchanged(LIGHT), np.float64, 0),
        (Exchanged(LIGHT.astype(np.float16)), np.float32, 1e-3),
        (Described(LIGHT), np.float64, 0),
        (Quantity(LIGHT, "dimensionless"), np.float64, 0),
        (Axes(LIGHT, "y", "x", "band"), np.float64, 0),
    ],
    ids=["big-endian", "FITS", "half", "long", "tensor", "big tensor", "Fortran", "view", "no mask",
         "strided", "read-only", "DLPack", "half DLPack", "interface", "no unit", "named axes"],
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
        (
            lambda: bm.LinearImage(LIGHT, valid=np.ma.masked_array(LIGHT[..., 0] > 0)),
            r"valid must be an array without .* valid.filled\(False\)",
        ),
        (lambda: bm.streaks.Streak([[True]]), "mask must be a NumPy array, got list"),
        (lambda: bm.LinearImage(Tensor(LIGHT)), r"rgb is on a GPU .* give rgb.cpu\(\)"),
        (lambda: bm.LinearImage(Exchanged(LIGHT, 2)), r"give jax.device_get\(rgb\)"),
        (lambda: bm.LinearImage(Tensor(LIGHT, 1, True)), r"give rgb.detach\(\)"),
        (lambda: bm.LinearImage(Unseen()), r"BFloat16; give rgb.float\(\)$"),
        (lambda: bm.LinearImage(Quantity(LIGHT, "lux")), "has the unit lux.*rgb.magnitude if it is"),
        (
            lambda: bm.LinearImage(Axes(LIGHT, "y", "x", "band", data=Quantity(LIGHT, "lux"))),
            "has the unit lux",
        ),
        (
            lambda: bm.LinearImage(Axes(LIGHT, "band", "x", "y")),
            r"give rgb.transpose\('y', 'x', 'band'\)",
        ),
    ],
)  # fmt: skip
def test_arrays_that_cannot_be_taken_are_refused_by_name(make, says):
    """door."""
    with pytest.raises(TypeError, match=says):
        make()


@pytest.mark.parametrize(
    ("light", "says"),
    [
        (np.moveaxis(LIGHT, -1, 0), r"channels come last, give np.moveaxis\(rgb, 0, -1\)"),
        (LIGHT[None], r"of a single picture, give rgb\[0\]"),
        (LIGHT[..., 0], r"of gray, give np.stack\(3 \* \[rgb\], axis=-1\)"),
        (np.dstack([LIGHT, LIGHT[..., 0]]), r"without alpha, give rgb\[..., :3\]"),
    ],
)
def test_arrays_of_another_shape_are_refused_with_what_gives_the_right_one(light, says):
    """door: what the message says makes a picture of it."""
    with pytest.raises(ValueError, match=says) as refused:
        bm.LinearImage(light)
    call = str(refused.value).partition("give ")[2]
    assert bm.LinearImage(eval(call, {"np": np, "rgb": light})).size == (7, 6)


def test_code_values_of_pictures_and_masked_arrays_are_decoded():
    """exact: as of arrays; masked pixels are not valid."""
    codes = (200 * LIGHT).astype(np.uint8)
    plain = bm.decode(codes, bm.SRGB)
    assert np.array_equal(bm.decode(Image.fromarray(codes), bm.SRGB).rgb, plain.rgb)
    assert np.array_equal(bm.decode(Exchanged(codes), bm.SRGB).rgb, plain.rgb)
    masked = np.ma.masked_array(codes, np.zeros(codes.shape, bool))
    masked[2, 3, 1] = np.ma.masked
    missing = ~bm.decode(masked, bm.SRGB).valid
    assert np.argwhere(missing).tolist() == [[2, 3]]


@pytest.mark.parametrize(
    "door",
    [
        lambda a: bm.Layer(a(LIGHT[..., 0]), a(LIGHT)).premultiplied,
        lambda a: bm.LinearImage(LIGHT, a(LIGHT)).noise,
        lambda a: bm.LinearImage(LIGHT, valid=a(LIGHT[..., 0] > 0.5)).valid,
        lambda a: bm.streaks.Streak(a(LIGHT[..., 0] > 0.5)).mask,
        lambda a: (
            bm.deblurring.fit_psf(
                a(LIGHT[..., 0]), a(LIGHT[..., 1] / 1e3), a(np.ones((3, 3)))
            ).weight
        ),
        lambda a: bm.remove(*2 * [bm.LinearImage(LIGHT)], a(LIGHT[..., 0] > 0.5))[1],
        lambda a: bm.Intrinsics(9, 9, 3, 3).project(a(LIGHT)),
        lambda a: Trajectory(a(LIGHT[0, :, :2]), a(np.linspace(0, 1, 7))).xy,
        lambda a: alpha_rmse(a(LIGHT[..., 0]), a(LIGHT[..., 1])),
        lambda a: Scene(a(LIGHT), Trajectory.line((2, 2), (3, 3)), Ball(1, np.ones(3))).plate,
    ],
)
def test_all_doors_take_arrays_of_other_packages(door):
    """exact: the same as of NumPy's, in NumPy's."""
    given = door(lambda values: values)
    for kind in (Labeled, lambda values: Labeled(values.astype(values.dtype.newbyteorder(">")))):
        taken = door(kind)
        assert np.array_equal(taken, given)
        assert type(taken) is type(given)


def test_an_array_is_written_as_what_it_shows(tmp_path):
    """exact"""
    codes = (200 * LIGHT).astype(np.uint8)
    for name, thing in (("a.png", codes), ("b.png", Image.fromarray(codes))):
        bm.write(tmp_path / name, thing)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_solve_takes_big_endian_and_read_only_arrays():
    """exact: the same answer as of native arrays."""
    truth = rendered(SMALL_BALL)
    noisy = [
        x + np.random.default_rng(k).normal(0, 1e-3, x.shape)
        for k, x in enumerate((truth.image.rgb, truth.plate.rgb))
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


def test_the_box_of_a_mask_grows_to_the_border_of_the_picture():
    mask = np.zeros((6, 8), bool)
    mask[1, 4] = mask[3, 2] = True
    assert box_of(mask) == (2, 1, 5, 4)
    assert grown(box_of(mask), 1, (8, 6)) == (1, 0, 6, 5)
    assert grown(box_of(mask), 4, (8, 6)) == (0, 0, 8, 6)


def test_numbers_of_eight_bits_are_refused():
    """door: 16 bits of another package, as NumPy sees its bfloat16."""
    rounded = np.zeros((2, 2, 3), np.dtype("V2"))
    with pytest.raises(TypeError, match=r"bfloat16 has 8 bits.* as float32"):
        as_array("rgb", rounded)
