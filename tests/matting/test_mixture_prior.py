"""Information of a pixel's light on its alpha, if neighbors have a similar mixture of colors."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color import ColorModel
from blurmatte.matting import Smooth, solve
from blurmatte.matting.evidence import FirstEstimate, evidence_of, pixels_of
from blurmatte.matting.mixture_prior import with_mixture
from blurmatte.metrics import calibration
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Ball, Camera, Change, Scene, Shot, render, two_hue_plate
from blurmatte.trajectory import Trajectory

SHAPE = (64, 96)
ORANGE, BLUE = np.array([0.80, 0.35, 0.06]), np.array([0.10, 0.30, 0.60])
MODEL = ColorModel(np.linalg.qr(np.stack([ORANGE, BLUE], axis=1))[0])
BETWEEN = 0.3 * ORANGE + 0.5 * BLUE  # a plate before which no equation determines alpha
BESIDE, OBJECT = np.s_[:, :32], np.s_[8:-8, 60:92]


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
    pixels = pixels_of(image, LinearImage(B, np.full(B.shape, 1e-12)), MODEL, np.ones(SHAPE, bool))
    near = np.where(alpha > 0, alpha, wrong)
    variance = np.where(alpha > 0, 1e-4, wrong**2)
    return alpha, FirstEstimate(pixels, near, variance, 1.0), evidence_of(pixels, near)


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


def test_std_covers_a_change_of_the_mixture():
    """Honest: means of patches, if the mixture there differs from that around them."""
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
    assert 0.2 < np.sqrt(np.mean(np.square(scores))) < 1.4


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
    truth = render(scene)
    image, plate_image = Shot(scene, Camera(code_std=2 / 255), seed=1).photograph(truth)
    solution = solve(image, plate_image, truth.model, Smooth())
    true = truth.layer.alpha
    alpha = np.where(solution.streak, solution.alpha, 0)
    assert np.sqrt(np.mean((alpha - true)[true > 0] ** 2)) < 0.05
    assert np.sqrt(np.mean(alpha[true == 0] ** 2)) < 0.01
    z = calibration(alpha, solution.alpha_std, true, where=true > 0)
    assert 0.55 < z.within_1 < 0.9
    assert z.within_2 > 0.85
