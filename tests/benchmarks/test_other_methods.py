from importlib import import_module

import numba
import numpy as np
import pytest
from benchmarks.accuracy import other_methods as other
from benchmarks.accuracy.against_other_methods import SCENES, Case, methods

from blurmatte.color import published_color_line
from blurmatte.rendering import Ball, Camera, Scene, Shot, colorful_plate, render
from blurmatte.scenes import scene_names
from blurmatte.streaks import require_streaks
from blurmatte.trajectory import Trajectory

OTHERS = [
    method
    for method in methods()
    if not method.name.startswith("blurmatte")
    and (
        not method.name.endswith("best") or method.name == "pm rw, best"
    )  # one of those with equal code
]


@pytest.fixture(scope="module", autouse=True)
def pymatting():
    """Not compiled: that takes minutes, and pictures are tiny here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba.config, "DISABLE_JIT", True)
        return import_module("pymatting")


@pytest.fixture(scope="module")
def case():
    plate = colorful_plate((72, 56), rng=3, tile=12)
    path = Trajectory.line((22, 22), (48, 34))
    shot = Shot(Scene(plate, path, Ball(8, (0.9, 0.5, 0.1))), Camera(code_std=0.5 / 255), seed=5)
    rendering = render(shot.scene, substeps=60)
    return Case(*shot.photograph(rendering), rendering.layer, rendering.model)


@pytest.mark.parametrize("method", OTHERS, ids=lambda method: method.name)
def test_every_method_gives_a_layer_of_the_whole_picture(case, method):
    layer = method.layer(case)
    assert layer.size == case.truth.size
    assert np.isfinite(layer.alpha).all()
    assert np.isfinite(layer.premultiplied).all()
    assert 0 <= layer.alpha.min() <= layer.alpha.max() <= 1
    assert layer.alpha.any() == (method.name != "empty")


def test_a_difference_key_tuned_on_the_truth_is_no_worse_than_the_plain_one(case):
    plain = other.difference_key(case.image, case.plate)
    tuned = other.tuned_difference_key(case.image, case.plate, case.truth)
    errors = [np.sum((layer.alpha - case.truth.alpha) ** 2) for layer in (tuned, plain)]
    assert errors[0] <= errors[1]


def test_published_alpha_is_the_least_squares_solution_of_equation_5(case):
    mask = require_streaks(case.image, case.plate)[0].mask
    used = mask & case.image.valid & case.plate.valid
    C, B = case.image.rgb[used].astype(float), case.plate.rgb[used].astype(float)
    l = published_color_line(C, B).pole
    unknowns = [
        np.linalg.lstsq(np.stack([l, b], axis=1), c, rcond=None)[0]
        for c, b in zip(C, B, strict=True)
    ]
    light, through = np.transpose(unknowns)
    alpha = np.clip(1 - through, 0, 1)
    layer = other.published(case.image, case.plate)
    np.testing.assert_allclose(layer.alpha[used], alpha, atol=1e-3)
    inside = alpha > 0.01
    expected = np.maximum(light[:, None] * l, 0)
    np.testing.assert_allclose(layer.premultiplied[used][inside], expected[inside], atol=1e-3)


def test_trimap_contains_only_certain_pixels(case):
    trimap = other.trimap_of(case.truth)
    assert (case.truth.alpha[trimap == 0] == 0).all()
    assert (case.truth.alpha[trimap == 1] > 0.9 * case.truth.alpha.max()).all()
    assert (trimap == 1).any()


def test_an_opaque_core_is_the_foreground_of_a_trimap(case):
    alpha = np.clip(1.5 * case.truth.alpha / case.truth.alpha.max(), 0, 1)
    opaque = other.trimap_of(other.Layer(alpha, case.truth.premultiplied)) == 1
    np.testing.assert_array_equal(opaque, alpha > 0.99)


def test_all_scenes_but_clips_are_in_the_table():
    assert set(SCENES) == set(scene_names()) - {"clip"}
