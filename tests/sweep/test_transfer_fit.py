"""fit_transfer: the curve of code values, from the light of one streak."""

import numpy as np
import pytest

from blurmatte.errors import PlateError
from blurmatte.radiometry import LINEAR, SRGB, LinearImage, decode, gamma
from blurmatte.rendering import Ball, Scene, colorful_plate, plain_plate, render
from blurmatte.sweep import TransferFit, fit_transfer
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
TILES = Scene(
    colorful_plate(SIZE, 2, tile=20),
    Trajectory.line((44, 42), (112, 68)),
    Ball(11, np.array([0.85, 0.6, 0.1])),
)


def files(scene, curve, read_as, seed=0):
    """Image and plate whose files were encoded with one curve and are decoded with another."""
    rng, truth = np.random.default_rng(seed), render(scene, 200)

    def read(light):
        codes = 255 * curve.encode(light) + rng.normal(0, 1, light.shape)
        return decode(np.clip(np.rint(codes), 0, 255).astype(np.uint8), read_as)

    return read(truth.image.rgb), read(truth.plate.rgb)


@pytest.mark.parametrize(
    ("curve", "read_as"),
    [
        (SRGB, SRGB),
        (gamma(1.8), SRGB),
        *(
            pytest.param(*pair, marks=pytest.mark.battery)
            for pair in ((LINEAR, SRGB), (SRGB, LINEAR), (LINEAR, LINEAR), (gamma(1.8), LINEAR))
        ),
    ],
    ids=lambda c: c.name,
)
def test_the_right_curve_is_found(curve, read_as):
    fit = fit_transfer(*files(TILES, curve, read_as))
    assert fit.curves[0].name == read_as.name
    assert curve.name in [possible.name for possible in fit.possible]
    if curve.name == read_as.name:
        assert fit.best is fit.curves[0]
    else:
        assert read_as.name not in [possible.name for possible in fit.possible]


def test_an_ambiguous_curve_stays_as_declared():
    assert TransferFit((SRGB, LINEAR), (1.2, 1.0)).best is SRGB
    assert TransferFit((SRGB, LINEAR), (1.4, 1.0)).best is LINEAR
    assert TransferFit((SRGB, LINEAR), (0.8, 0.6)).best is SRGB
    assert TransferFit((SRGB, LINEAR), (9.0, 4.0)).best is SRGB
    assert TransferFit((SRGB, LINEAR), (9.0, 4.0)).possible == (LINEAR, SRGB)


def test_rejects_linear_light():
    image, plate = files(TILES, SRGB, SRGB)
    with pytest.raises(PlateError, match="decoded with one curve, got None"):
        fit_transfer(LinearImage(image.rgb), plate)
    with pytest.raises(PlateError, match=r"got Transfer\(srgb\) and Transfer\(linear\)"):
        fit_transfer(image, files(TILES, SRGB, LINEAR)[1])


def test_a_plain_plate_keeps_the_declared_curve():
    plain = Scene(plain_plate(SIZE, (0.3, 0.3, 0.3), 4), TILES.trajectory, TILES.body)
    fit = fit_transfer(*files(plain, SRGB, SRGB), curves=[LINEAR, gamma(1.8)])
    assert fit.best.name == "srgb"
