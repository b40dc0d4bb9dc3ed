"""The color line from a streak: accuracy, standard error, and errors if it is undetermined."""

from colorsys import hsv_to_rgb
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.scenes import photographed, rendered

from blurmatte.calibration import with_noise
from blurmatte.color import evidence, published_color_line, streak
from blurmatte.color.model import ColorModel
from blurmatte.color.streak import (
    check_chroma_resolution,
    fit_color_from_hues,
    projected_energy,
    projection_vectors,
    projection_weights,
    recompressed,
    residual_of_second_hue,
    streak_of_color,
)
from blurmatte.errors import ColorModelError, MotionError
from blurmatte.radiometry import SRGB, Compression, LinearImage, Meta, NoiseModel
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate, render
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.plates import plain_plate
from blurmatte.rendering.pose import Change
from blurmatte.streaks import Streak, find_streaks
from blurmatte.trajectory import Trajectory

SIZE = (112, 80)
SEEDS = range(100, 112)
FEW_OR_MANY = [
    pytest.param(range(3), id="few"),
    pytest.param(range(12), id="many", marks=pytest.mark.battery),
]
SIZE_OF_FILE = (160, 112)
GREEN = np.array([0.25, 0.7, 0.12])
LINE = GREEN / np.linalg.norm(GREEN)
PATH = Trajectory.line((50, 46), (110, 66))
PAINT = np.array([0.7, 0.35, 0.1])
WALL = np.array([0.3, 0.35, 0.45])
NOISE = NoiseModel(gain=1e-12, read_std=0.01)
MODEL = ColorModel.from_hex("#20c040")


def random_scene(seed, one_hue=False, two_paints=False):
    """A small ball of random paint on a random straight path."""
    rng = np.random.default_rng(seed)
    color, second, wall = SRGB.decode(rng.uniform(0.3, 1, (3, 3)))
    plate = (
        plain_plate(SIZE, 0.7 * wall, rng)
        if one_hue
        else colorful_plate(SIZE, rng, tile=rng.uniform(14, 24))
    )
    radius, angle = rng.uniform(7, 11), rng.uniform(0, np.pi)
    half = radius * rng.uniform(1, 3) * np.array([np.cos(angle), 0.8 * np.sin(angle)])
    middle = np.array(SIZE) / 2
    path = Trajectory.line(tuple(middle - half), tuple(middle + half))
    ball = Ball(radius, color, second_color=second if two_paints else None)
    return render(Scene(plate, path, ball), substeps=60), (color, second)


def taken(scene, code_std, seed):
    """Eight-bit sRGB pictures, the plate the median of five; their noise measured."""
    rng = np.random.default_rng(seed)
    image, *frames = (
        Camera(code_std=code_std).photograph(light, rng)
        for light in [scene.image.rgb] + 5 * [scene.plate.rgb]
    )
    rgb = np.median([frame.rgb for frame in frames], axis=0)
    return with_noise(image, replace(frames[0], rgb=rgb, valid=(rgb < 1).all(axis=-1)))


def quick_fit(image, plate):
    """`fit_color_from_hues` without the two fits that only separate kinds of evidence."""
    pixels = streak._streak_pixels(image, plate, find_streaks(image, plate)[0])
    l, covariance = evidence.posterior(evidence.EvidenceKinds(True, True, np.inf), pixels)
    model = ColorModel(l[:, None], covariance)
    streak._check_determined(model, pixels)
    streak._check_fit(model, pixels)
    return model


def test_a_line_of_colors_leaves_the_light_of_a_second_paint():
    """oracle: renderings with and without a second paint, and the line of the first."""
    for two_paints in (False, True):
        scene, (color, _) = random_scene(100, two_paints=two_paints)
        image, plate = taken(scene, 1 / 255, 100)
        model = ColorModel((color / np.linalg.norm(color))[:, None])
        left = residual_of_second_hue(image, plate, find_streaks(image, plate)[0], model)
        assert left > 0.3 if two_paints else left is None


def normalised2(model, color):
    """Squared error relative to the stated covariance: χ² with two degrees of freedom."""
    tangent = np.linalg.svd(model.pole[:, None])[0][:, 1:]
    error = tangent.T @ color / (model.pole @ color)
    return error @ np.linalg.solve(tangent.T @ model.covariance @ tangent, error)


def angle(a, b):
    return np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)


@pytest.fixture(scope="module")
def scene():
    """Rendering, image and plate with noise of 0.002."""
    truth = random_scene(3)[0]
    camera = Camera(NoiseModel(read_std=0.002), bits=None)
    return truth, *(camera.photograph(p.rgb, s) for s, p in enumerate((truth.image, truth.plate)))


# Right


@pytest.mark.parametrize("std", [1e-6, 1e-4])
def test_exact_without_noise(std):
    """To the stated accuracy, and far better, because there is no noise."""
    truth = random_scene(3)[0]
    image, plate = (p.with_noise(NoiseModel(read_std=std)) for p in (truth.image, truth.plate))
    model = fit_color_from_hues(image, plate, Streak(truth.layer.alpha > 0.02))
    assert angle(model.pole, truth.model.pole) < min(1e-6, 0.01 * np.radians(model.angle_std))
    assert np.radians(model.angle_std) < 5 * std


def test_quick_fit_is_the_fit(scene):
    _, image, plate = scene
    whole, quick = fit_color_from_hues(image, plate), quick_fit(image, plate)
    assert_allclose(whole.pole, quick.pole, rtol=0, atol=1e-12)
    assert_allclose(whole.covariance, quick.covariance, rtol=1e-6)


def test_evidence_holds_the_std_of_each_kind(scene):
    _, image, plate = scene
    model = fit_color_from_hues(image, plate)
    assert set(model.evidence) == {"hue variation", "feasibility"}
    assert model.angle_std < 1.05 * min(model.evidence.values())


def columns(rng, count=12, exact=False):
    """Random pixels and a color l; in those of `exact` the image is a mixture of l and the plate."""
    l, B = evidence.unit(rng.uniform(0.1, 1, 3)), rng.uniform(0.1, 1, (count, 3))
    C = rng.uniform(0.1, 1, (count, 3))
    if exact:
        alpha = rng.uniform(0.1, 0.9, (count, 1))
        C = alpha * rng.uniform(0.2, 1, (count, 1)) * l + (1 - alpha) * B
    vC, vB = rng.uniform(1e-5, 1e-4, (2, count, 1)) * np.ones(3)
    return l, evidence.StreakPixels(C, B, vC, vB, *(np.arange(count),) * 2, (np.zeros(0, int),) * 2)


def brute_force(l, C, B):
    """(k, α) and the residual of C = k l + (1 − α) B by least squares."""
    mix = np.stack([l, B], axis=1)
    k, through = np.linalg.lstsq(mix, C, rcond=None)[0]
    return np.array([k, 1 - through]), C - mix @ [k, through]


def test_closed_form_is_least_squares():
    """r, α and k of many directions at once agree with those of single pixels."""
    rng = np.random.default_rng(0)
    _, p = columns(rng)
    directions = rng.uniform(0, 1, (5, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    a = evidence.closed_form(directions, p)
    for g, l in enumerate(directions):
        for i, (C, B) in enumerate(zip(p.C, p.B, strict=True)):
            (k, alpha), rest = brute_force(l, C, B)
            assert_allclose((a.k[g, i], a.alpha[g, i]), (k, alpha), rtol=1e-9)
            assert_allclose(a.r[g, i] * a.n[:, g, i], rest, rtol=0, atol=1e-12)
            assert_allclose([a.n[:, g, i] @ l, a.n[:, g, i] @ B], 0, atol=1e-12)


def test_errors_of_the_closed_form_are_propagated():
    """Against finite differences of least squares, where the model holds."""
    l, p = columns(np.random.default_rng(1), exact=True)
    a, h = evidence.closed_form(l[None], p), 1e-6
    for i, (C, B) in enumerate(zip(p.C, p.B, strict=True)):
        variance, rest_variance = np.zeros(2), 0.0
        n = a.n[:, 0, i]
        for axis in h * np.eye(3):
            for v, plus, minus in (
                (p.vC[i, 0], brute_force(l, C + axis, B), brute_force(l, C - axis, B)),
                (p.vB[i, 0], brute_force(l, C, B + axis), brute_force(l, C, B - axis)),
            ):
                variance += v * ((plus[0] - minus[0]) / (2 * h)) ** 2
                rest_variance += v * (n @ (plus[1] - minus[1]) / (2 * h)) ** 2
        stds = a.k_std[0, i], a.alpha_std[0, i], a.r_std[0, i]
        assert_allclose(stds, np.sqrt([*variance, rest_variance]), rtol=1e-4)


@pytest.mark.parametrize("step", [1.0, 2.0, 5.0])
def test_octant_grid_is_uniform(step):
    grid = evidence._octant(step)
    assert_allclose(np.linalg.norm(grid, axis=1), 1)
    assert grid.min() > 0
    assert_allclose(len(grid), np.pi / 2 / np.radians(step) ** 2, rtol=0.03)
    anywhere = np.abs(np.random.default_rng(0).normal(size=(2000, 3)))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    nearest = np.degrees(np.arccos(np.minimum((anywhere @ grid.T).max(axis=1), 1)))
    assert nearest.max() < 0.85 * step  # half a diagonal of a square is 0.71
    between = np.degrees(np.arccos(np.where(np.eye(len(grid)), -1, grid @ grid.T)))
    assert between.min() > 0.6 * step


def test_bounded_is_a_square_with_linear_tails():
    z = np.array([0, 0.01, 1000.0])
    assert_allclose(evidence._bounded(z)[:2], evidence._EFFICIENCY * z[:2] ** 2, rtol=1e-5, atol=0)
    tail = evidence._EFFICIENCY * 2 * evidence._OUTLIER_STD * z[2]
    assert_allclose(evidence._bounded(z)[2], tail, rtol=0.01)


# Honest


@pytest.mark.battery
@pytest.mark.parametrize("code_std", [1 / 255, 2 / 255])
def test_covariance_is_calibrated(code_std):
    """Root mean square of the normalised error, over scenes, noise and both directions."""
    z2 = []
    for seed in SEEDS:
        truth, (color, _) = random_scene(seed)
        z2.append(normalised2(quick_fit(*taken(truth, code_std, seed)), color))
    assert 0.8 < np.sqrt(np.mean(z2) / 2) < 1.2
    assert max(z2) < 4**2


@pytest.mark.parametrize("seeds", FEW_OR_MANY)
def test_plate_of_one_hue_gives_the_truth_or_an_error(seeds):
    refused = 0
    for seed in seeds:
        truth, (color, _) = random_scene(seed, one_hue=True)
        try:
            model = quick_fit(*taken(truth, 1 / 255, seed))
        except ColorModelError:
            refused += 1
        else:
            assert normalised2(model, color) < 3**2
    assert refused > len(seeds) / 2


@pytest.mark.battery
def test_rims_of_an_opaque_object_do_not_bias():
    """A plate of one hue: uncovered pixels next to opaque ones determine no wrong color."""
    answers = 0
    for seed in range(24, 40):
        rng = np.random.default_rng(seed)
        color = np.array(hsv_to_rgb(rng.uniform(), 0.7, 0.75))
        plate = plain_plate(SIZE, SRGB.decode(rng.uniform(0.3, 0.8, 3)), rng)
        angle = rng.uniform(0, np.pi)
        half, middle = 2 * np.array([np.cos(angle), np.sin(angle)]), np.array(SIZE) / 2
        path = Trajectory.line(tuple(middle - half), tuple(middle + half))
        turned = Change(turned=(0, 0, rng.uniform(0, 3)))
        truth = render(Scene(plate, path, Sheet(16, 8, color), turned), substeps=40)
        try:
            model = quick_fit(*taken(truth, 2 / 255, seed))
        except ColorModelError:
            continue
        answers += 1
        assert normalised2(model, color) < 3**2
    assert answers < 8


def test_rejects_negative_light():
    """Before a plate of the mean of two paints, a single color needs negative light."""
    paints = np.array([[0.13, 0.41, 0.05], [0.2, 0.2, 0.5]])
    path = Trajectory.line((53, 40), (59, 40))
    for seed in range(3):
        plate = plain_plate(SIZE, paints.mean(axis=0), seed)
        ball = Ball(6, paints[0], second_color=paints[1])
        truth = render(Scene(plate, path, ball), substeps=40)
        with pytest.raises(ColorModelError, match="impossible alpha or light; give the colors"):
            quick_fit(*taken(truth, 2 / 255, seed))


@pytest.mark.parametrize("seeds", FEW_OR_MANY)
def test_two_paints_give_a_mixture_or_an_error(seeds):
    """A line between both paints fits best, though not well."""
    wrong = 0
    for seed in seeds:
        truth, paints = random_scene(seed, two_paints=True)
        try:
            model = quick_fit(*taken(truth, 1 / 255, seed))
        except ColorModelError:
            continue
        share = np.linspace(0, 1, 50)[:, None]
        mixtures = share * evidence.unit(paints[0]) + (1 - share) * evidence.unit(paints[1])
        wrong += min(normalised2(model, mixture) for mixture in mixtures) > 3**2
    assert wrong <= len(seeds) / 12


def test_error_for_one_hue_suggests_remedies():
    image, plate = taken(random_scene(0, one_hue=True)[0], 1 / 255, 0)
    with pytest.raises(ColorModelError) as caught:
        fit_color_from_hues(image, plate)
    said = str(caught.value)
    assert "the object's color is uncertain by" in said
    assert "hue variation leaves" in said
    assert "feasibility leaves" in said
    assert "give the color (--color, model=), pick pixels of the object" in said
    assert "or bound its brightness" in said


# Invariance to channel order and exposure


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 1, 0), (1, 2, 0)])
def test_swapped_channels_swap_the_answer(scene, order):
    """Up to the resolution of the grid, a small fraction of the error."""
    _, image, plate = scene
    swapped = (replace(p, rgb=p.rgb[..., order]) for p in (image, plate))
    here, there = quick_fit(image, plate), quick_fit(*swapped)
    error = normalised2(here, there.pole[np.argsort(order)])
    assert error < 0.1**2
    assert_allclose(there.angle_std, here.angle_std, rtol=0.1)


@pytest.mark.parametrize("factor", [0.25, 16])
def test_result_does_not_depend_on_exposure(scene, factor):
    _, image, plate = scene
    scaled = (
        LinearImage(factor * p.rgb, NoiseModel(read_std=factor * 0.002)) for p in (image, plate)
    )
    here, there = quick_fit(image, plate), quick_fit(*scaled)
    assert normalised2(here, there.pole) < 0.01**2
    assert_allclose(there.covariance, here.covariance, rtol=0.02, atol=1e-3 * here.covariance.max())


def test_lower_brightness_bound_excludes_more_directions():
    """And admits no further ones."""
    l, p = columns(np.random.default_rng(2), exact=True)
    grid = np.concatenate([l[None], evidence._octant(5)])
    a = evidence.closed_form(grid, p)
    none, loose, tight = (evidence._infeasibility(a, grid, b) for b in (np.inf, 2.0, 1.0))
    assert np.all(none <= loose)
    assert np.all(loose <= tight)
    assert not tight[0].any()  # the truth is no brighter than 1


@pytest.mark.parametrize(
    ("alpha", "k", "bound", "possible"),
    [
        (0.5, 1.5, np.inf, True),
        (0.5, 1.5, 3.2, True),
        (0.5, 1.5, 2.8, False),  # light of 1.5 in half the exposure is a brightness of 3
        (1.1, 0.5, np.inf, False),
        (-0.1, 0.5, np.inf, False),
        (0.5, -0.1, np.inf, False),
        (1.015, 0.5, np.inf, True),  # within noise
    ],
)
def test_feasibility_of_alpha_and_brightness(alpha, k, bound, possible):
    answers = (np.array([[x]]) for x in (0, 0.01, alpha, 0.01, k, 0.01))
    a = evidence._Solutions(np.zeros((3, 1, 1)), *answers, transmission=np.ones((1, 1)))
    cost = evidence._infeasibility(a, np.array([[0.0, 1.0, 0.0]]), bound)
    assert (cost.item() == 0) == possible


@pytest.mark.battery
def test_brightness_bound_never_increases_the_std(scene):
    truth, image, plate = scene
    brightest = truth.layer.straight().max()
    free, bounded = (
        fit_color_from_hues(image, plate, max_brightness=b) for b in (np.inf, brightest)
    )
    assert bounded.angle_std < 1.02 * free.angle_std


def test_result_is_deterministic(scene):
    _, image, plate = scene
    assert np.array_equal(quick_fit(image, plate).pole, quick_fit(image, plate).pole)


# The door


def test_rejects_gray_pictures(scene):
    _, *pair = scene
    image, plate = (replace(p, meta=Meta("wall.png", gray=True)) for p in pair)
    with pytest.raises(ColorModelError, match=r"wall\.png is gray: colors, and alpha from colors"):
        fit_color_from_hues(image, plate)


def test_rejects_equal_pictures(scene):
    with pytest.raises(MotionError, match="nothing moved"):
        fit_color_from_hues(scene[2], scene[2])


def test_rejects_too_few_pixels(scene):
    _, image, plate = scene
    few = Streak.from_box((50, 40, 54, 44), SIZE)
    with pytest.raises(ColorModelError, match=r"only 16 pixels .* 20 are needed; give the color"):
        fit_color_from_hues(image, plate, few)


def test_rejects_small_streaks_in_coarse_jpeg():
    def image(step, shared):
        file = Compression(((1,) * 8,) * 8, ((step,) * 8,) * 8, shared)
        return LinearImage(np.ones((80, 112, 3)), meta=Meta(compression=file))

    small, large = (Streak.from_box((20, 20, right, 44), SIZE) for right in (51, 52))
    with pytest.raises(
        ColorModelError, match=r"744 pixels, less than 3 blocks of 16 by 16 .* give"
    ):
        check_chroma_resolution(image(20, (2, 2)), small)
    check_chroma_resolution(image(20, (2, 2)), large)
    check_chroma_resolution(image(10, (2, 2)), small)
    check_chroma_resolution(image(20, (2, 1)), small)
    check_chroma_resolution(image(99, (1, 1)), small)
    check_chroma_resolution(LinearImage(np.ones((80, 112, 3))), small)


def test_clipped_and_black_pixels_are_ignored(scene):
    _, image, plate = scene
    place = Streak.from_box((50, 40, 60, 50), SIZE)
    valid = np.ones(SIZE[::-1], bool)
    valid[40:45, 50:60] = False
    dark = plate.rgb.copy()
    dark[45:49, 50:60, 1] = 0
    with pytest.raises(
        ColorModelError, match=r"only 10 pixels .* neither clipped nor before a bla"
    ):
        fit_color_from_hues(replace(image, valid=valid), replace(plate, rgb=dark), place)


@pytest.mark.parametrize("bound", [0, -1, float("nan")])
def test_rejects_brightness_bounds_not_above_zero(scene, bound):
    with pytest.raises(ValueError, match=f"max_brightness must be positive, got {bound}"):
        fit_color_from_hues(*scene[1:], max_brightness=bound)


def test_rejects_different_sizes(scene):
    with pytest.raises(ValueError, match="image is 112x80 pixels and plate 50x80"):
        fit_color_from_hues(scene[1], LinearImage(scene[2].rgb[:, :50]))


def test_bounded_cost_has_the_expected_spread_for_normal_residuals():
    z, step = np.linspace(-9, 9, 20001, retstep=True)
    normal = np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)
    slope = np.gradient(evidence._bounded(z), step) / 2
    bend = np.gradient(slope, step)
    # An estimate's variance is E[ψ²] / E[ψ′]²; a likelihood claims 1 / E[ψ′].
    assert_allclose(np.sum(slope**2 * normal), np.sum(bend * normal), rtol=1e-3)


@cache
def compressed(width, seed=0):
    """Image and plate of an object of a given width, and its mask."""
    scene = Scene(colorful_plate(SIZE_OF_FILE, seed, tile=18), PATH, Sheet(20, width, GREEN))
    camera = Camera(code_std=1 / 255, jpeg_quality=90, chroma="4:2:0")
    image, plate = with_noise(*photographed(scene, camera, seed, 5, substeps=120))
    return image, plate, Streak(rendered(scene, 120).layer.alpha > 0)


def off(model):
    return np.degrees(np.arccos(np.clip(model.pole @ LINE, -1, 1)))


def test_recompressed_images_of_the_true_color_equal_the_photograph():
    """honest: residuals within the streak are hardly larger than outside, where noise differs."""
    image, plate, streak = compressed(14)
    (light,), behind = recompressed(LINE, image, plate, streak, 1)
    within, outside = (
        np.sqrt(np.mean((light.rgb - image.rgb)[where] ** 2))
        for where in (streak.mask, ~streak.mask)
    )
    assert 0.5 * outside < within < 2 * outside
    assert np.sqrt(np.mean((behind.rgb - plate.rgb) ** 2)) < outside


def test_recompressed_images_have_independent_noise():
    image, plate, streak = compressed(14)
    (same, other), (again,) = (
        [light.rgb for light in recompressed(LINE, image, plate, streak, count)[0]]
        for count in (2, 1)
    )
    assert np.array_equal(same, again)
    assert not np.array_equal(same, other)


def test_color_of_uncompressed_rendering_is_found():
    image, plate, streak = compressed(14)
    (light,), behind = recompressed(LINE, image, plate, streak, 1)
    model = fit_color_from_hues(light, behind, streak)
    assert off(model) < 3 * model.angle_std


@pytest.mark.battery
def test_std_with_compression_is_calibrated():
    """A thin object in a file: neither overconfident nor much too cautious."""
    models = [fit_color_from_hues(*compressed(10, seed)) for seed in range(6)]
    z2 = [(off(model) / model.angle_std) ** 2 for model in models]
    assert 0.8 < np.sqrt(np.mean(z2)) < 1.25


@pytest.mark.battery
def test_only_known_subsampling_adds_to_the_error():
    image, plate, streak = compressed(10)
    bare = replace(image, meta=replace(image.meta, compression=None))
    assert image.meta.compression is not None
    each = replace(image.meta.compression, shared=(1, 1))
    own = replace(image, meta=replace(image.meta, compression=each))
    by_file, known, unknown = (
        fit_color_from_hues(picture, plate, streak) for picture in (image, own, bare)
    )
    assert np.array_equal(known.covariance, unknown.covariance)
    more = np.linalg.eigvalsh(by_file.covariance - unknown.covariance)
    assert more.min() > -1e-12
    assert by_file.angle_std > 1.1 * unknown.angle_std
    assert set(by_file.evidence) - set(unknown.evidence) == {"compression"}
    parts = by_file.evidence["compression"], unknown.angle_std
    assert max(parts) <= by_file.angle_std <= np.hypot(*parts) * (1 + 1e-12)
    assert off(by_file) < 3 * by_file.angle_std


def streak_colors(B, rng):
    """Image colors before plate colors B (n, 3), for any shade and alpha."""
    alpha, shade = rng.uniform(0.1, 0.9, (2, len(B), 1))
    return alpha * shade * PAINT + (1 - alpha) * B


def degrees_between(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


@pytest.mark.parametrize("pixels", [2, 3, 1000])
def test_published_line_is_exact_without_noise(pixels):
    rng = np.random.default_rng(pixels)
    B = rng.uniform(0.1, 1, (pixels, 3))
    model = published_color_line(streak_colors(B, rng), B)
    assert model.rank == 1
    assert_allclose(model.pole, PAINT / np.linalg.norm(PAINT), rtol=0, atol=1e-9)
    assert not model.covariance.any()  # the paper has no error


def test_two_pixels_are_the_cross_product_of_the_paper():
    B = np.random.default_rng(0).uniform(0.1, 1, (2, 3))
    C = np.random.default_rng(1).uniform(0.1, 1, (2, 3))  # not even from one paint
    line = np.cross(*np.cross(C, B))
    line /= np.linalg.norm(line) * np.sign(line.sum())
    assert_allclose(published_color_line(C, B).pole, line, rtol=0, atol=1e-9)


def test_accepts_pictures_and_lists_of_pixels():
    rng = np.random.default_rng(2)
    B = rng.uniform(0.1, 1, (60, 3))
    C = streak_colors(B, rng)
    pictures = published_color_line(C.reshape(6, 10, 3), B.reshape(6, 10, 3))
    assert_allclose(pictures.pole, published_color_line(C, B).pole, rtol=0, atol=0)


@pytest.mark.parametrize(("plate_std", "off"), [(0, 1), (0.005, 12)])
def test_noise_biases_the_formula_to_the_plate_color(plate_std, off):
    """The bias that `fit_color` must not have. Noise of the image adds |B|² I − B Bᵀ, which is least
    along the plate; noise of the plate adds the same of C, between plate and paint.
    """
    rng = np.random.default_rng(3)
    wall = plain_plate((60, 50), WALL, 4).reshape(-1, 3)
    image = streak_colors(wall, rng)
    found = published_color_line(
        image + rng.normal(0, 0.005, image.shape), wall + plate_std * rng.normal(size=wall.shape)
    ).pole
    assert degrees_between(PAINT, WALL) > 30
    assert degrees_between(found, WALL) < off


@pytest.mark.parametrize(("image_shape", "plate_shape"), [((1, 3), (1, 3)), ((5, 3), (4, 3))])
def test_rejects_too_few_pixels_and_different_shapes(image_shape, plate_shape):
    said = f"two or more pixels .* got {image_shape[0]} of the image and {plate_shape[0]} of the"
    with pytest.raises(ValueError, match=said):
        published_color_line(np.ones(image_shape), np.ones(plate_shape))


def before(plate, alpha, light):
    """A picture of (h, w) alpha and light along the model's color."""
    rgb = light[..., None] * MODEL.pole + (1 - alpha)[..., None] * plate.rgb
    return LinearImage(rgb, NOISE)


def plate_of(rng, shape=(20, 60)):
    return LinearImage(rng.uniform(0.2, 0.8, (*shape, 3)), NOISE)


def with_a_hand_and_a_ball(rng):
    """Streaks of any colors and of the model's color, in this order, with their image and plate."""
    plate = plate_of(rng)
    alpha, light = np.zeros((2, 20, 60))
    masks = np.zeros((2, 20, 60), bool)
    masks[0, 5:15, 5:15], masks[1, 5:15, 35:45] = True, True
    light[masks[1]], alpha[masks[1]] = 0.2, 0.4
    image = before(plate, alpha, light)
    image.rgb[masks[0]] = rng.uniform(0, 1, (100, 3))
    return *(Streak(mask) for mask in masks), image, plate


def test_projected_light_does_not_depend_on_alpha():
    rng = np.random.default_rng(0)
    plate = plate_of(rng)
    alpha, light = rng.uniform(0, 1, (2, 20, 60))
    image = before(plate, alpha, light)
    m = projection_vectors(plate, MODEL)
    assert_allclose(np.einsum("hwc,hwc->hw", m, image.rgb), light, rtol=0, atol=2e-5)


def test_variance_of_projected_light_is_that_of_noise():
    rng = np.random.default_rng(1)
    plate = plate_of(rng, (100, 100))
    image = before(plate, np.zeros((100, 100)), np.zeros((100, 100)))
    m = projection_vectors(plate, MODEL)
    weight = projection_weights(image, plate, m)
    noise = rng.normal(0, 0.01 * np.sqrt(2), image.rgb.shape)
    z = np.einsum("hwc,hwc->hw", m, noise) * np.sqrt(weight)
    assert_allclose(z.std(), 1, atol=0.03)
    assert abs(projected_energy(z, np.ones_like(weight), np.ones(z.shape, bool))) < 4 * np.sqrt(
        2 * z.size
    )


def test_light_of_another_color_projects_to_zero():
    hand, ball, image, plate = with_a_hand_and_a_ball(np.random.default_rng(3))
    assert streak_of_color([hand, ball], image, plate, MODEL) is ball


def test_streak_of_most_light_of_the_color_is_chosen():
    rng = np.random.default_rng(2)
    plate = plate_of(rng)
    alpha, light = np.zeros((2, 20, 60))
    masks = np.zeros((3, 20, 60), bool)
    for n, mask in enumerate(masks):
        mask[5:15, 5 + 20 * n : 15 + 20 * n] = True
    alpha[masks[0]] = 0.9  # a shadow: the strongest change
    light[masks[1]], alpha[masks[1]] = 0.05, 0.1
    light[masks[2]], alpha[masks[2]] = 0.2, 0.4
    shadow, faint, bright = streaks = [Streak(mask) for mask in masks]
    image = before(plate, alpha, light)
    assert streak_of_color(streaks, image, plate, MODEL) is bright
    assert streak_of_color(streaks[:2], image, plate, MODEL) is faint
    assert streak_of_color(streaks, image, plate, ColorModel.any()) is shadow


def test_a_streak_that_may_be_noise_is_chosen_only_if_all_may():
    """Before a plate of nearly the object's hue its own streak has little energy of the color."""
    object_, other, image, plate = with_a_hand_and_a_ball(np.random.default_rng(2))
    noise = replace(other, expected_false=3.0)
    assert streak_of_color([object_, noise], image, plate, MODEL) is object_
    both = [replace(object_, expected_false=3.0), noise]
    assert streak_of_color(both, image, plate, MODEL) is noise
