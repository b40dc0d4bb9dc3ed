"""Plates, photographs and files of them, and two balls on parallel paths."""

import io

import numpy as np
import pytest
from PIL import Image
from tests.scenes import on_line, rendered

from blurmatte.calibration import with_noise
from blurmatte.radiometry import SRGB, decode
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate
from blurmatte.rendering.plates import plain_plate, two_hue_plate
from blurmatte.trajectory import Trajectory

SIZE = (256, 192)


@pytest.fixture(scope="session")
def plates():
    return {
        "tiles": colorful_plate(SIZE, 1),
        "dark": 0.05 * colorful_plate(SIZE, 2),
        "plain": plain_plate(SIZE, (0.5, 0.4, 0.3), 1),
        "two hues": two_hue_plate(SIZE, (0.5, 0.1, 0.1), (0.1, 0.2, 0.5), 1),
    }


def through_jpeg(pixels, quality):
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "jpeg", quality=quality, subsampling="4:2:0")
    return np.asarray(Image.open(file).convert("RGB"))


@pytest.fixture(scope="session")
def taken():
    """A function: photographs of image and plate in 8 bits with noise, optionally as JPEG."""

    def of(light, plate, code_std, seed, jpeg=None):
        camera, rng = Camera(code_std=code_std / 255), np.random.default_rng(seed)
        files = [camera.expose(picture, rng) for picture in (light, plate)]
        if jpeg is not None:
            files = [through_jpeg(pixels, jpeg) for pixels in files]
        return [decode(pixels, SRGB) for pixels in files]

    return of


@pytest.fixture(scope="session")
def balls_side_by_side(taken):
    """A function: balls of radius 9 and 7 on parallel paths of 40 px, their truths and pictures."""

    def of(wall, gap, code_std=1):
        first = Scene(wall, Trajectory.line((90, 80), (130, 80)), Ball(9, (0.9, 0.5, 0.1)))
        one = rendered(first)
        two = on_line(one.image.rgb, (92, 96 + gap), (132, 96 + gap), Ball(7, (0.1, 0.3, 0.9)))
        return one, two, with_noise(*taken(two.image.rgb, wall, code_std, 1))

    return of
