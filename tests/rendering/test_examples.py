"""The pictures that ship: what their truth says is in them."""

import json
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from numpy.testing import assert_allclose

from blurmatte.radiometry import SRGB
from blurmatte.rendering import Ball, Scene, render
from blurmatte.rendering.lighting import Lamp
from blurmatte.trajectory import Trajectory

EXAMPLES = Path(__file__).parents[2] / "examples"


def codes(path):
    return oiio.ImageInput.open(str(path)).read_image("uint16")


@pytest.mark.parametrize("name", ["colorful", "plain"])
def test_truth_matches_the_pictures(name):
    folder = EXAMPLES / name
    truth = json.loads((folder / "truth.json").read_text())
    image, plate = (SRGB.table(65536)[codes(folder / f"{n}.png")] for n in ("image", "plate"))
    alpha = codes(folder / "alpha.png")[..., :1] / 65535
    path = Trajectory(truth["trajectory"]["xy"], truth["trajectory"]["t"])
    ball = Ball(truth["radius"], truth["color"], truth["ambient"], (Lamp(truth["lamp"]),))
    layer = render(Scene(plate, path, ball)).layer
    assert_allclose(alpha.sum(), truth["alpha_sum"], rtol=1e-3)
    assert_allclose(alpha[..., 0], layer.alpha, atol=2e-5)
    rest = image - layer.premultiplied - (1 - alpha) * plate
    variance = truth["noise"]["read_std"] ** 2 + truth["noise"]["gain"] * plate
    assert_allclose(np.std(rest / np.sqrt(variance * (1 + (1 - alpha) ** 2))), 1, atol=0.02)


@pytest.mark.parametrize("name", ["image", "plate"])
def test_pictures_declare_their_transfer(name):
    assert b"sRGB" in (EXAMPLES / "plain" / f"{name}.png").read_bytes()[:64]
