"""stack: many layers as one."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.compositing import long_exposure, stack
from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Scene, colorful_plate, render
from blurmatte.trajectory import Trajectory

SIZE = (120, 70)
STOPS = [(20.0, 20.0), (45.0, 30.0), (70.0, 40.0), (95.0, 50.0)]


def flights():
    """A ball's path through three contiguous exposures."""
    plate = colorful_plate(SIZE, 3, tile=25)
    ball = Ball(9, np.array([0.7, 0.35, 0.1]))
    for start, end in pairwise(STOPS):
        yield render(Scene(plate, Trajectory.line(start, end), ball))


def test_stack_equals_layers_over_one_another():
    # oracle
    shots = list(flights())
    picture = shots[0].plate
    for shot in shots:
        picture = shot.layer.over(picture)
    together = stack(shot.layer for shot in shots)
    assert_allclose(together.over(shots[0].plate).rgb, picture.rgb, atol=1e-12)


def test_long_exposure_equals_a_rendering_of_that_exposure():
    """Exact up to time sampling: three contiguous exposures equal one of three times the length."""
    shots = list(flights())
    whole = long_exposure(shot.layer for shot in shots)
    truth = render(Scene(shots[0].plate.rgb, Trajectory.line(STOPS[0], STOPS[-1]),
                         Ball(9, np.array([0.7, 0.35, 0.1]))))  # fmt: skip
    assert_allclose(whole.alpha, truth.layer.alpha, atol=2e-3)
    assert_allclose(whole.over(truth.plate).rgb, truth.image.rgb, atol=2e-3)


def test_stack_of_one_layer_is_the_layer(paint):
    for verb in (stack, long_exposure):
        assert_allclose(verb([paint.layer]).premultiplied, paint.layer.premultiplied, atol=1e-15)


def test_one_layer_is_in_memory_at_a_time(paint):
    """Invariant: a layer may be released before the next is made."""
    made = []

    def layers():
        for _ in range(4):
            buffer = paint.layer.fade(1)
            yield buffer
            made.append(buffer.alpha.copy())
            buffer.alpha[...] = np.nan  # whoever still looks at it will notice
            buffer.premultiplied[...] = np.nan

    whole = long_exposure(layers())
    assert len(made) == 4
    assert_allclose(whole.alpha, paint.layer.alpha, atol=1e-15)


def test_rejects_wrong_arguments(paint):
    for verb in (stack, long_exposure):
        with pytest.raises(ValueError, match="there are no layers"):
            verb([])
        with pytest.raises(ValueError, match="layer 1 is 5x5 pixels and the first 192x128"):
            verb([paint.layer, paint.layer.crop((0, 0, 5, 5))])


def test_light_without_alpha_is_added():
    """Alpha of a stack is at most 1."""
    full = Layer(np.ones((1, 1)), np.full((1, 1, 3), 0.5))
    glow = Layer(np.zeros((1, 1)), np.full((1, 1, 3), 0.25))
    assert_allclose(stack([full, full, glow]).over(LinearImage(np.ones((1, 1, 3)))).rgb, 0.75)
    assert stack([full, full]).alpha == 1
