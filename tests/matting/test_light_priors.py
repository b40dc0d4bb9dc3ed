"""Information of a pixel's light on its alpha, if neighbors have a similar brightness."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.scenes import photographed, rendered

from blurmatte.color.model import ColorModel
from blurmatte.matting import Smooth, solve
from blurmatte.matting.evidence import FirstEstimate, information_of, pixels_of
from blurmatte.matting.light_priors import _along_line, with_brightness, with_mixture
from blurmatte.metrics import calibration
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Ball, Camera, Scene
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.plates import plain_plate, two_hue_plate
from blurmatte.rendering.pose import Change
from blurmatte.trajectory import Trajectory

SHAPE = (64, 96)
STD = 0.004
COLOR = np.array([0.8, 0.4, 0.1])
MODEL = ColorModel((COLOR / np.linalg.norm(COLOR))[:, None])
WALL = np.array([0.15, 0.25, 0.45])
DARK = np.s_[:, 40:56]
ORANGE, BLUE = np.array([0.80, 0.35, 0.06]), np.array([0.10, 0.30, 0.60])
TWO_PAINTS = ColorModel(np.linalg.qr(np.stack([ORANGE, BLUE], axis=1))[0])
BETWEEN = 0.3 * ORANGE + 0.5 * BLUE  # a plate before which no equation determines alpha
BESIDE, OBJECT = np.s_[:, :32], np.s_[8:-8, 60:92]


def evidence_at(alpha, seed=0, brightness=1.0, plate=None, std=STD):
    """Evidence for an object of this alpha before a wall with a black stripe."""
    rng = np.random.default_rng(seed)
    B = np.broadcast_to(WALL, (*SHAPE, 3)).copy()
    B[DARK] = 0
    B = B if plate is None else np.broadcast_to(np.asarray(plate, float), B.shape)
    a = np.broadcast_to(alpha, SHAPE)[..., None]
    C = a * np.broadcast_to(brightness, SHAPE)[..., None] * COLOR + (1 - a) * B
    image = LinearImage(C + rng.normal(0, std, C.shape), NoiseModel(read_std=std))
    pixels = pixels_of(image, LinearImage(B, np.full(B.shape, 1e-12)), MODEL, np.ones(SHAPE, bool))
    near = np.full(SHAPE, float(np.mean(alpha)))
    return FirstEstimate(pixels, near, np.full(SHAPE, 0.01), 1.0), information_of(pixels, near)


def test_light_before_black_determines_alpha():
    """Exact up to a little noise."""
    before, own = evidence_at(0.5, std=1e-4)
    information, pull = with_brightness(before, *own)
    assert own[0][DARK].max() < 1e-3 * own[0][:, :32].min()
    assert information[DARK].min() > 1e2
    assert_allclose((pull / information)[DARK], 0.5, atol=2e-3)


def scores_of_stripe(scatter):
    """Error of the mean alpha over the stripe, over its std, if brightness varies by this share."""
    scores = []
    for seed in range(48):
        phase, angle = np.random.default_rng(seed).uniform(0, 2 * np.pi, 2)
        y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] / 25.0
        brightness = 1 + scatter * np.sin(np.cos(angle) * x + np.sin(angle) * y + phase)
        before, own = evidence_at(0.4, seed, brightness)
        information, pull = (values[DARK] for values in with_brightness(before, *own))
        scores.append((pull.sum() / information.sum() - 0.4) * np.sqrt(information.sum()))
    return scores


@pytest.mark.parametrize("scatter", [0.05, 0.1])
def test_std_covers_a_change_of_brightness_at_the_stripe(scatter):
    """Honest: if the brightness there differs from that around it."""
    assert 0.8 < np.sqrt(np.mean(np.square(scores_of_stripe(scatter)))) < 1.25


def test_std_is_conservative_if_the_brightness_does_not_change():
    """Honest, and not much too large: noise alone is taken for a small change."""
    assert 0.5 < np.sqrt(np.mean(np.square(scores_of_stripe(0.0)))) < 0.8


@pytest.mark.parametrize("contrast", [0.0, 0.1])
def test_light_adds_information_on_differences_not_on_the_mean(contrast):
    """Invariant: the mean of a neighborhood has the information of the closed form."""
    before, own = evidence_at(0.5, brightness=1 + contrast * np.sin(np.arange(SHAPE[1]) / 25.0))
    around = np.s_[:, 8:24]
    information, pull = (values[around] for values in with_brightness(before, *own))
    alone, of_own = own[1][around] / own[0][around], own[0][around].sum()
    assert np.std(pull / information) < 0.85 * np.std(alone)
    apart = pull.sum() / information.sum() - own[1][around].sum() / of_own
    assert abs(apart) < 0.3 / np.sqrt(of_own)
    assert 1.2 * of_own < information.sum() < 2 * of_own


@pytest.mark.parametrize("blur", [0.0, 3.0])
def test_brightness_does_not_depend_on_the_smoothness_of_alpha(blur):
    """Invariant: a first alpha that is too smooth does not increase the brightness."""
    from scipy.ndimage import gaussian_filter

    ridges = 0.3 + 0.3 * np.cos(np.arange(SHAPE[1]) * (np.pi / 4)) * np.ones(SHAPE)
    before, own = evidence_at(ridges, std=0.001)
    smooth = gaussian_filter(ridges, (0, blur), mode="wrap")
    information, pull = with_brightness(replace(before, alpha=smooth), *own)
    off = np.sum((pull - information * ridges)[DARK]) / np.sum((information * ridges)[DARK])
    assert abs(off) < 0.01


def test_a_black_plate_alone_gives_no_information():
    before, own = evidence_at(0.5, plate=0)
    for with_it, without in zip(with_brightness(before, *own), own, strict=True):
        assert np.array_equal(with_it, without)


def test_noise_along_the_color_is_independent():
    """Exact: uncorrelated with that of the equations across the color."""
    before, _ = evidence_at(0.3)
    V = np.array([1.0, 2.0, 5.0]) * 1e-4
    l = MODEL.basis[:, 0]
    pixels = before.pixels
    image = pixels.image.with_noise(np.broadcast_to(V, pixels.image.rgb.shape))
    uneven = FirstEstimate(
        pixels_of(image, pixels.plate, MODEL, pixels.inside), before.alpha, before.variance, 1.0
    )
    *_, variance = _along_line(uneven)
    assert_allclose(variance[5, 5], 1 / (l @ (l / V)), rtol=1e-4)
    m = l / V * variance[5, 5]
    assert_allclose(m @ np.diag(V) @ MODEL.normals, 0, atol=1e-12)


def test_errors_before_a_black_stripe_are_conservative():
    """Honest: the brightness may change there. A turning sheet, of which the closed form has almost no
    information.
    """
    size = (160, 128)
    plate = np.array(plain_plate(size, WALL, 0))
    plate[:, 70:90] = 0.002
    way = Trajectory.line((60, 60), (104, 70))
    scene = Scene(plate, way, Sheet(50, 10, COLOR), Change(spin=(0, 0, 2)))
    truth, errors, scores = rendered(scene, 120), [], []
    dark = np.zeros(size[::-1], bool)
    dark[:, 72:88] = True
    dark &= truth.layer.alpha > 0.02
    for seed in range(4):
        pictures = photographed(scene, Camera(code_std=2 / 255), seed, 5, substeps=120)
        solution = solve(*pictures, truth.model, Smooth())
        errors.append((solution.alpha - truth.layer.alpha)[dark])
        scores.append(errors[-1] / solution.alpha_std[dark])
    assert np.sqrt(np.mean(np.square(errors))) < 0.03
    assert 0.44 < np.sqrt(np.mean(np.square(scores))) < 0.7


def evidence_of_mixture(orange=1.0, std=1e-4, wrong=0.0, plate=BETWEEN, seed=0):
    """Evidence for an object that fills the right half with alpha 0.4, of this share of orange. Its
    alpha is known; around it a wrong alpha of the same uncertainty was found.
    """
    rng = np.random.default_rng(seed)
    B = np.broadcast_to(plate, (*SHAPE, 3)).copy()
    alpha = np.where(np.arange(SHAPE[1]) < 42, 0, 0.4) * np.ones(SHAPE)
    share = np.broadcast_to(orange, SHAPE)[..., None]
    color = share * ORANGE + (1 - share) * BLUE
    C = alpha[..., None] * color + (1 - alpha[..., None]) * B
    image = LinearImage(C + rng.normal(0, std, C.shape), NoiseModel(read_std=std))
    pixels = pixels_of(
        image, LinearImage(B, np.full(B.shape, 1e-12)), TWO_PAINTS, np.ones(SHAPE, bool)
    )
    near = np.where(alpha > 0, alpha, wrong)
    variance = np.where(alpha > 0, 1e-4, wrong**2)
    return alpha, FirstEstimate(pixels, near, variance, 1.0), information_of(pixels, near)


def test_light_of_one_mixture_determines_alpha_without_an_equation():
    """Exact up to a little noise."""
    alpha, before, own = evidence_of_mixture()
    information, pull, shared = with_mixture(before, *own)
    assert own[0].max() < 1e-3 * np.median(information)
    assert_allclose((pull / information)[OBJECT], 0.4, atol=2e-3)
    assert_allclose((pull / information)[BESIDE], 0, atol=2e-3)
    assert np.sqrt(shared[OBJECT]).max() < 0.02
    assert alpha[OBJECT].min() == 0.4


@pytest.mark.parametrize("wrong", [0.0, 0.2, 0.4])
def test_alpha_is_zero_where_the_light_is_that_of_the_plate(wrong):
    _, before, own = evidence_of_mixture(0.9, 0.004, wrong)
    information, pull, _ = with_mixture(before, *own)
    assert abs(pull[BESIDE].sum() / information[BESIDE].sum()) < 0.005
    assert np.median(information[BESIDE]) > 1 / 0.03**2


def test_std_is_conservative_if_the_mixture_changes():
    """Honest: means of patches, if the mixture there differs from that around them. The error of the
    mean color counts as common to its neighborhood, although it varies in it.
    """
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] / 6.0
    scores = []
    for seed in range(12):
        phase, angle = np.random.default_rng(seed).uniform(0, 2 * np.pi, 2)
        wave = np.sin(np.cos(angle) * x + np.sin(angle) * y + phase)
        _, before, own = evidence_of_mixture(0.8 + 0.2 * wave, 0.004, seed=seed)
        information, pull, _ = (
            values[OBJECT].reshape(6, 8, 4, 8).sum(axis=(1, 3))
            for values in with_mixture(before, *own)
        )
        scores.append((pull / information - 0.4) * np.sqrt(information))
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 0.8


def test_no_information_if_colors_scatter_around_the_plate():
    """Invariant: the closed form is unchanged."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    spots = ((x // 5 + y // 5) % 2).astype(float)
    _, before, own = evidence_of_mixture(
        0.2 + 0.36 * spots, 0.002, plate=0.38 * ORANGE + 0.62 * BLUE
    )
    information, _, shared = with_mixture(before, *own)
    assert_allclose(information[OBJECT], own[0][OBJECT])
    assert np.all(shared[OBJECT] == 0)


def test_no_information_without_an_object():
    _, before, own = evidence_of_mixture()
    before = replace(before, alpha=np.zeros(SHAPE))
    information, pull, shared = with_mixture(before, *own)
    assert_allclose(information, own[0])
    assert_allclose(pull, own[1])
    assert not shared.any()


def test_errors_of_a_ball_before_a_plate_between_its_paints_are_calibrated():
    """Honest: before plates between both paints, where single pixels have no information."""
    plate = two_hue_plate((224, 160), (0.45, 0.40, 0.36), (0.10, 0.22, 0.40), 1)
    path = Trajectory.line((80, 75), (140, 90))
    body = Ball(18, ORANGE, second_color=BLUE)
    scene = Scene(plate, path, body, Change(spin=(1.0, 0.5, 0.0)))
    truth = rendered(scene)
    pictures = photographed(scene, Camera(code_std=2 / 255), 1, plate_frames=1)
    solution = solve(*pictures, truth.model, Smooth())
    true = truth.layer.alpha
    alpha = np.where(solution.streak, solution.alpha, 0)
    assert np.sqrt(np.mean((alpha - true)[true > 0] ** 2)) < 0.05
    assert np.sqrt(np.mean(alpha[true == 0] ** 2)) < 0.01
    z = calibration(alpha, solution.alpha_std, true, where=true > 0)
    assert 0.8 < z.spread < 1.25
