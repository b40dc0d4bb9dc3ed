"""Information of a pixel's light on its alpha, if neighbors have a similar brightness."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color import ColorModel
from blurmatte.matting import Smooth, solve
from blurmatte.matting.brightness_prior import _along_line, with_brightness
from blurmatte.matting.evidence import FirstEstimate, evidence_of, pixels_of
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Camera, Change, Scene, Sheet, Shot, plain_plate, render
from blurmatte.trajectory import Trajectory

SHAPE = (64, 96)
STD = 0.004
COLOR = np.array([0.8, 0.4, 0.1])
MODEL = ColorModel((COLOR / np.linalg.norm(COLOR))[:, None])
WALL = np.array([0.15, 0.25, 0.45])
DARK = np.s_[:, 40:56]


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
    return FirstEstimate(pixels, near, np.full(SHAPE, 0.01), 1.0), evidence_of(pixels, near)


def test_light_before_black_determines_alpha():
    """Exact up to a little noise."""
    before, own = evidence_at(0.5, std=1e-4)
    information, pull = with_brightness(before, *own)
    assert own[0][DARK].max() < 1e-3 * own[0][:, :32].min()
    assert information[DARK].min() > 1e2
    assert_allclose((pull / information)[DARK], 0.5, atol=2e-3)


@pytest.mark.parametrize("scatter", [0.0, 0.1])
def test_std_covers_a_change_of_brightness_at_the_stripe(scatter):
    """Honest: mean over the stripe, if the brightness there differs from that around it."""
    scores = []
    for seed in range(24):
        phase, angle = np.random.default_rng(seed).uniform(0, 2 * np.pi, 2)
        y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] / 25.0
        brightness = 1 + scatter * np.sin(np.cos(angle) * x + np.sin(angle) * y + phase)
        before, own = evidence_at(0.4, seed, brightness)
        information, pull = (values[DARK] for values in with_brightness(before, *own))
        scores.append((pull.sum() / information.sum() - 0.4) * np.sqrt(information.sum()))
    assert 0.1 < np.sqrt(np.mean(np.square(scores))) < 1.4


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


def test_errors_before_a_black_stripe_are_calibrated():
    """Honest: a turning sheet, where the closed form has almost no information."""
    size = (160, 128)
    plate = np.array(plain_plate(size, WALL, 0))
    plate[:, 70:90] = 0.002
    way = Trajectory.line((60, 60), (104, 70))
    scene = Scene(plate, way, Sheet(50, 10, COLOR), Change(spin=(0, 0, 2)))
    truth, errors, scores = render(scene, 120), [], []
    dark = np.zeros(size[::-1], bool)
    dark[:, 72:88] = True
    dark &= truth.layer.alpha > 0.02
    for seed in range(2):
        shot = Shot(scene, Camera(code_std=2 / 255), plate_frames=5, seed=seed)
        solution = solve(*shot.photograph(truth), truth.model, Smooth())
        errors.append((solution.alpha - truth.layer.alpha)[dark])
        scores.append(errors[-1] / solution.alpha_std[dark])
    assert np.sqrt(np.mean(np.square(errors))) < 0.03
    assert np.mean(np.abs(scores) < 1) > 0.5
    assert np.mean(np.abs(scores) < 2) > 0.8
