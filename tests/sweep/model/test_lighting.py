"""The light field of the plate: exact for a smooth shadow, independent of objects of another hue."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.radiometry import LinearImage
from blurmatte.sweep.model.lighting import Lighting, fit_lighting
from blurmatte.sweep.model.observation import Observation

SIZE = 64, 48
NOISE = 1e-3
DEPTH, WIDTH = 0.3, 9.0  # of the shadow: of the light; standard deviation, pixels
GRAIN = 3.0  # pixels; nodes are two apart
# Of bilinear interpolation: pitch² / 8 times the curvature, along both axes.
INTERPOLATION_ERROR = 2 * (2 * GRAIN) ** 2 / 8 * DEPTH / WIDTH**2


def shadow() -> np.ndarray:
    """(48, 64) a soft shadow that removes 30 % of the light at its darkest."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    return -DEPTH * np.exp(-((x - 40) ** 2 + (y - 20) ** 2) / (2 * WIDTH**2))


def observed(
    change: np.ndarray, object_alpha: np.ndarray | None = None, hue: tuple[float, ...] = (1, 1, 1)
) -> Observation:
    """A gray-brown plate whose light changed, and a green object before it."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    B = np.array([0.5, 0.4, 0.3]) * (1 + 0.1 * np.sin(x / 5) * np.cos(y / 7))[..., None]
    alpha = np.zeros(change.shape) if object_alpha is None else object_alpha
    C = (1 - alpha)[..., None] * B * (1 + change[..., None] * np.array(hue))
    C += alpha[..., None] * np.array([0.1, 0.6, 0.1])
    C += NOISE * rng.standard_normal(C.shape)
    one, everywhere = np.ones(change.shape), np.ones(change.shape, bool)
    variance = np.full(C.shape, NOISE**2)
    return Observation(
        C, B, variance, 0 * variance, everywhere, (0.0, 0.0), 1.0,
        weight=one, streak=everywhere, near=everywhere, size=SIZE, grain=GRAIN,
    )  # fmt: skip


def test_a_smooth_shadow_is_recovered() -> None:
    change = shadow()
    found = fit_lighting(observed(change))
    assert np.abs(found.change - change).max() < INTERPOLATION_ERROR


def test_an_object_of_another_hue_has_no_influence() -> None:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    alpha = np.where((abs(x - 22) < 5) & (abs(y - 20) < 12), 0.5, 0.0)
    found = fit_lighting(observed(shadow(), alpha))
    assert np.abs(found.change - shadow())[alpha == 0].max() < INTERPOLATION_ERROR


def test_light_is_recovered_around_pixels_that_are_not_used() -> None:
    observation = observed(shadow())
    use = np.ones(observation.weight.shape)
    use[-14:, -14:] = 0  # no pixel shows the last nodes
    found = fit_lighting(replace(observation, weight=use))
    assert np.isfinite(found.change).all()
    assert np.abs(found.change - shadow())[use > 0].max() < INTERPOLATION_ERROR


@pytest.mark.parametrize("hue", [(0.7, 1.0, 1.3), (1.2, 1.0, 0.8)])
def test_a_shadow_in_light_of_another_color_is_recovered(hue: tuple[float, ...]) -> None:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    alpha = np.where((abs(x - 22) < 5) & (abs(y - 20) < 12), 0.5, 0.0)
    found = fit_lighting(observed(shadow(), alpha, hue), is_gray=False)
    np.testing.assert_allclose(found.hue, hue, atol=0.01)
    assert np.abs(found.change - shadow())[alpha == 0].max() < INTERPOLATION_ERROR


def test_noise_alone_changes_no_light() -> None:
    found = fit_lighting(observed(np.zeros(SIZE[::-1])))
    assert np.abs(found.change).max() < NOISE


def test_the_plate_in_changed_light_predicts_the_image() -> None:
    observation = observed(shadow())
    lit = fit_lighting(observation).lit(observation)
    before, after = (np.abs(one.C - one.B).mean() for one in (observation, lit))
    assert after < 2 * NOISE < before
    assert (lit.B_variance >= observation.B_variance).all()


def test_plate_changes_only_within_the_observation() -> None:
    lighting = Lighting(np.full((4, 6), -0.5), np.zeros((4, 6)), 0.0, np.ones(3), (10.5, 8.5), 2.0)
    rgb = np.full((40, 50, 3), 0.4, np.float32)
    plate = LinearImage(rgb, np.full(rgb.shape, 1e-6, np.float32))
    lit = lighting.on(plate)
    inside = np.zeros((40, 50), bool)
    inside[8:16, 10:22] = True
    np.testing.assert_allclose(lit.rgb[inside], 0.2, rtol=1e-6)
    np.testing.assert_array_equal(lit.rgb[~inside], rgb[~inside])


def test_a_shadow_is_no_darker_than_its_object_is_opaque() -> None:
    half = Lighting(np.array([[-0.5, 0.1]]), np.zeros((1, 2)), 0.0, np.ones(3), (0.0, 0.0), 1.0)
    assert half.is_possible(np.array([[0.0, 0.6]]))
    assert not half.is_possible(np.array([[0.0, 0.4]]))
