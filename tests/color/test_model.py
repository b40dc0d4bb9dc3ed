"""ColorModel: a subspace through black from given colors or samples, with a calibrated covariance."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.color.model import ColorModel, fuse_colors
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import SRGB

ORANGE, BLUE = np.array([0.7, 0.35, 0.1]), np.array([0.1, 0.3, 0.7])


def unit(v):
    return v / np.linalg.norm(v)


def shades(rng, rank, count=200):
    """Exact colors of one paint in all shades, or of mixtures of two."""
    paints = np.stack([ORANGE, BLUE][:rank])
    return rng.uniform(0.2, 1, (count, rank)) @ paints


def angle(a, b):
    """Degrees between two poles, regardless of sign."""
    return np.degrees(np.arcsin(np.linalg.norm(np.cross(a, b))))


@pytest.mark.parametrize("rank", [1, 2])
def test_normals_are_perpendicular_to_every_color(rank):
    colors = shades(np.random.default_rng(0), rank)
    model = ColorModel.from_samples(colors, rank)
    assert model.rank == rank
    assert model.normals.shape == (3, 3 - rank)
    assert_allclose(colors @ model.normals, 0, atol=1e-14)
    assert_allclose(model.normals.T @ model.normals, np.eye(3 - rank), atol=1e-14)
    assert_allclose(model.basis.T @ model.normals, 0, atol=1e-14)


def test_pole_of_a_line_is_its_direction_of_a_plane_its_normal():
    assert_allclose(ColorModel.from_samples(ORANGE[None], std=0).pole, unit(ORANGE), atol=1e-14)
    plane = ColorModel.from_samples(np.stack([ORANGE, BLUE]), 2, std=0)
    assert_allclose(angle(plane.pole, unit(np.cross(ORANGE, BLUE))), 0, atol=1e-6)


def test_color_of_rank_1_has_maximum_1():
    model = ColorModel.from_samples(0.1 * ORANGE[None], std=0)
    assert_allclose(model.rgb, [ORANGE / 0.7])


@pytest.mark.parametrize("rank", [1, 2])
def test_displayed_colors_enclose_the_samples(rank):
    colors = shades(np.random.default_rng(0), rank)
    model = ColorModel.from_samples(colors, rank)
    mixture = np.linalg.lstsq(model.rgb.T, colors.T)[0]
    assert_allclose(model.rgb.T @ mixture, colors.T, atol=1e-12)
    assert mixture.min() >= 0
    assert model.rgb.min() >= -1e-9
    assert_allclose(model.rgb.max(axis=1), 1)


def test_hex_round_trip():
    assert ColorModel.from_hex("#ff8000").hex == ("#ff8000",)
    assert ColorModel.from_hex("FF8000").hex == ("#ff8000",)
    assert_allclose(
        ColorModel.from_hex("#ff8000").rgb[0], SRGB.decode(np.array([255, 128, 0]) / 255)
    )
    assert ColorModel.from_hex("#804000").rank == 1  # a shade
    assert set(ColorModel.from_hex("#ff0000", "#0000ff").hex) == {"#ff0000", "#0000ff"}


def test_given_colors_have_no_covariance():
    assert_array_equal(ColorModel.from_hex("#d8ff3c").covariance, 0)
    assert ColorModel.from_hex("#d8ff3c").angle_std == 0


@pytest.mark.parametrize("rank", [1, 2])
def test_least_squares_minimizes_the_distances(rank):
    """Oracle: no direction of a fine grid around the answer has a smaller distance."""
    rng = np.random.default_rng(0)
    samples = shades(rng, rank) + rng.normal(0, 0.03, (200, 3))
    model = ColorModel.from_samples(samples, rank)

    def distance2(pole):
        along = (samples @ unit(pole)) ** 2
        return np.sum(samples**2) - along.sum() if rank == 1 else along.sum()

    tangent = np.linalg.svd(model.pole[:, None])[0][:, 1:]
    least = distance2(model.pole)
    for step in 1e-3 * np.stack([np.cos(np.arange(12)), np.sin(np.arange(12))], axis=1):
        assert distance2(model.pole + tangent @ step) > least


@pytest.mark.diagonal
@pytest.mark.parametrize("std", [None, 0.02], ids=["measured", "given"])
@pytest.mark.parametrize("rank", [1, 2])
def test_covariance_of_samples_is_calibrated(rank, std):
    rng, errors = np.random.default_rng(0), []
    true = ColorModel.from_samples(shades(rng, rank), rank).pole
    tangent = np.linalg.svd(true[:, None])[0][:, 1:]
    for _ in range(500):
        samples = shades(rng, rank, 60)
        noisy = samples + rng.normal(0, 0.02, samples.shape)
        model = ColorModel.from_samples(noisy, rank, std)
        assert_allclose(model.covariance @ model.pole, 0, atol=1e-12)
        assert model.evidence["samples"] == model.angle_std
        step = tangent.T @ model.pole * np.sign(true @ model.pole)
        root = np.linalg.cholesky(tangent.T @ model.covariance @ tangent)
        errors.append(np.linalg.solve(root, step))
    z = np.array(errors)
    assert np.all(np.abs(z.mean(axis=0)) < 0.15)
    assert_allclose(z.std(axis=0), 1, atol=0.1)


def test_angle_std_is_in_degrees_along_the_worst_direction():
    covariance = np.diag([0, np.radians(0.5) ** 2, np.radians(2) ** 2])
    model = ColorModel(np.array([[1.0], [0], [0]]), covariance)
    assert_allclose(model.angle_std, 2)
    assert repr(model) == "ColorModel(#ff0000, rank 1, ±2°)"


def test_no_direction_is_less_certain_than_a_right_angle():
    wide = ColorModel(np.eye(3)[:, :1], np.diag([0.0, 0.25, 4656.0]))
    assert_allclose(wide.covariance, np.diag([0, 0.25, np.pi**2 / 4]), atol=1e-12)
    assert_allclose(wide.angle_std, 90)


@pytest.mark.parametrize("rank", [1, 2])
def test_robust_fit_ignores_outliers(rank):
    rng = np.random.default_rng(3)
    samples = shades(rng, rank) + rng.normal(0, 0.01, (200, 3))
    true = ColorModel.from_samples(shades(rng, rank), rank).pole
    samples[:50] = unit(np.array([0.1, 0.9, 0.2])) * rng.uniform(0.5, 1, (50, 1))  # grass
    assert angle(ColorModel.from_samples(samples, rank).pole, true) > 5
    assert angle(ColorModel.from_samples(samples, rank, robust=True).pole, true) < 1


def test_swapped_channels_swap_the_model():
    samples = shades(np.random.default_rng(0), 2)
    model, swapped = (ColorModel.from_samples(s, 2) for s in (samples, samples[:, [2, 0, 1]]))
    assert_allclose(angle(swapped.pole, model.pole[[2, 0, 1]]), 0, atol=1e-6)


def test_scaled_samples_give_the_same_model():
    samples = shades(np.random.default_rng(0), 1)
    model, dim = (ColorModel.from_samples(s) for s in (samples, samples / 50))
    assert_allclose(dim.pole, model.pole, atol=1e-12)


@pytest.mark.parametrize(
    ("basis", "covariance", "words"),
    [
        (np.ones(3), None, r"shape \(3, 1\), \(3, 2\) or \(3, 3\), got \(3,\)"),
        (np.ones((3, 4)), None, r"got \(3, 4\)"),
        (np.ones((3, 1)), None, "orthonormal columns; use ColorModel.from_samples"),
        (np.array([[1.0, 1], [0, 0], [0, 0]]), None, "orthonormal columns"),
        (np.eye(3)[:, :1], np.zeros((2, 2)), r"covariance must be finite, \(3, 3\), got \(2, 2\)"),
        (np.eye(3)[:, :1], np.full((3, 3), np.nan), "covariance must be finite"),
    ],
)
def test_rejects_invalid_bases_and_covariances(basis, covariance, words):
    fields = {} if covariance is None else {"covariance": covariance}
    with pytest.raises(ValueError, match=words):
        ColorModel(basis, **fields)


@pytest.mark.parametrize("colors", [["orange"], ["#ff80"], ["#ff80001"], ["#gg0000"]])
def test_rejects_invalid_hex(colors):
    with pytest.raises(ValueError, match="must look like #d8ff3c, got"):
        ColorModel.from_hex(*colors)


@pytest.mark.parametrize("colors", [[], ["#000000"], ["#ff0000", "#000000"], ["#ff0000"] * 3])
def test_rejects_black_and_other_numbers_of_colors(colors):
    with pytest.raises(ValueError, match="one or two colors, neither of them black"):
        ColorModel.from_hex(*colors)


def test_rejects_two_shades_of_one_color():
    with pytest.raises(ValueError, match="shades of one color; rank 2 needs two"):
        ColorModel.from_hex("#ff0000", "#800000")


def test_rejects_samples_that_do_not_determine_a_model():
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 0.01, (50, 3))
    with pytest.raises(ValueError, match="rank must be 1 or 2, got 3"):
        ColorModel.from_samples(noise, rank=3)
    with pytest.raises(ColorModelError, match="needs 3 or more color samples, got 2"):
        ColorModel.from_samples(noise[:2], rank=2)
    with pytest.raises(ColorModelError, match="needs 2 or more color samples, got 1"):
        ColorModel.from_samples(noise[:1])
    for std in (None, 0.01):
        with pytest.raises(ColorModelError, match="all 5 samples are black"):
            ColorModel.from_samples(np.zeros((5, 3)), std=std)


@pytest.mark.parametrize("count", [50, 1000])
def test_rejects_rank_2_for_noisy_samples_of_one_hue(count):
    rng = np.random.default_rng(count)
    for _ in range(20):
        one_paint = shades(rng, 1, count) + rng.normal(0, 0.01, (count, 3))
        with pytest.raises(ColorModelError, match=r"plane of colors only to .*clearly different"):
            ColorModel.from_samples(one_paint, rank=2)


@pytest.mark.parametrize("std", [None, 0.0, 0.001])
@pytest.mark.parametrize("color", [(0.4, 0.4, 0.4), (0.1, 0.7, 0.3), (1 / 3, 0.9, 0.01)])
def test_rejects_rank_2_for_equal_samples(color, std):
    for count in (2, 3, 5, 50):
        with pytest.raises(ColorModelError, match=r"clearly different|needs 3"):
            ColorModel.from_samples(np.tile(color, (count, 1)), rank=2, std=std)


def test_a_line_is_named_by_its_own_color_and_other_ranks_by_their_mean():
    """Exact: the mean of a white ball is white, whatever spans its plane."""
    white = np.array([1.0, 1.0, 1.0])
    line = ColorModel.from_hex("#804020")
    assert (line.color,) == line.hex
    assert replace(line, mean=white).color == line.color
    plane = ColorModel.from_hex("#00a1ff", "#ffd400")
    assert plane.color == ""
    assert plane.in_words == f"rank 2, between {' and '.join(plane.hex)}"
    plane = replace(plane, mean=0.5 * white)
    assert plane.color == "#bcbcbc"
    assert plane.in_words == f"#bcbcbc, rank 2, between {' and '.join(plane.hex)}"
    assert replace(ColorModel.any(), mean=2 * white).in_words == "#ffffff, rank 3, any colors"
    with pytest.raises(ValueError, match="mean must be three finite numbers"):
        replace(plane, mean=np.array([0.5, np.nan, 0.5]))


def test_the_mean_color_of_a_camera_is_converted():
    """Exact"""
    swap = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    model = replace(ColorModel.any(), to_srgb=swap, mean=np.array([0.0, 1.0, 0.0]))
    assert model.color == "#ff0000"


def test_samples_have_a_mean_color():
    """Exact"""
    model = ColorModel.from_samples(np.stack([ORANGE, BLUE]), 2, std=0)
    assert_allclose(model.mean, (ORANGE + BLUE) / 2)
    assert_allclose(
        fuse_colors([model, replace(model, mean=ORANGE)]).mean, 0.75 * ORANGE + 0.25 * BLUE
    )


def test_any_colors_have_rank_3():
    model = ColorModel.any()
    assert (model.rank, model.normals.shape) == (3, (3, 0))
    assert repr(model) == "ColorModel(rank 3, any colors)"
    assert_allclose(model.rgb, np.eye(3))
    with pytest.raises(ValueError, match="has no pole"):
        _ = model.pole


@pytest.mark.parametrize("rank", [1, 2])
def test_possible_models_lie_on_one_confidence_contour(rank):
    given = ColorModel.from_hex(*["#d8a03c", "#2060c0"][:rank])
    across = np.linalg.svd(given.pole[:, None])[0][:, 1:]
    covariance = across @ np.diag([0.02**2, 0.005**2]) @ across.T
    first, *rim = ColorModel(given.basis, covariance).possible
    assert_allclose(first.basis, given.basis)
    steps = np.array([m.pole / (m.pole @ given.pole) - given.pole for m in rim])
    assert_allclose(np.einsum("ki,ij,kj->k", steps, np.linalg.pinv(covariance), steps), 2.45**2)
    assert_allclose(np.linalg.norm(steps[[0, 4]], axis=1), 2.45 * 0.02)


def test_given_color_is_the_only_possible_one():
    given = ColorModel.from_hex("#d8a03c")
    assert given.possible == (given,)


def test_no_possible_color_has_negative_light():
    red = ColorModel(np.eye(3)[:, :1], np.diag([0, 0.01, 0.01]))
    assert min(other.basis.min() for other in red.possible) >= 0


TO_SRGB = ((3.2, -0.6, -0.1), (-0.4, 1.6, -0.6), (0.1, -0.5, 1.75))


def test_hex_round_trip_in_camera_colors():
    """Exact: into the colors of the camera, and shown as before."""
    model = ColorModel.from_hex("#d8903c", to_srgb=TO_SRGB)
    assert_allclose(
        model.srgb[0], SRGB.decode(np.array([0xD8, 0x90, 0x3C]) / 255) / SRGB.decode(0xD8 / 255)
    )
    light = np.linalg.solve(TO_SRGB, SRGB.decode(np.array([0xD8, 0x90, 0x3C]) / 255))
    assert_allclose(model.pole, unit(light), atol=1e-12)


def test_possible_models_keep_the_matrix():
    basis = unit(np.array([0.8, 1.0, 0.4]))[:, None]
    model = ColorModel(basis, 1e-4 * np.eye(3), {}, TO_SRGB)
    assert all(other.to_srgb == TO_SRGB for other in model.possible)


def test_rejects_matrices_of_other_sizes():
    """Door."""
    with pytest.raises(ValueError, match="to_srgb must be 3 x 3"):
        ColorModel(np.eye(3), to_srgb=((1, 0), (0, 1)))
