"""fit_transfer: the curve of code values, from the light of one streak."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image
from tests.sweep.scenes import BALL, observed

import blurmatte as bm
from blurmatte.calibration import with_noise
from blurmatte.errors import PlateError, TransferWarning
from blurmatte.radiometry import LINEAR, REC709, SRGB, LinearImage, decode, gamma
from blurmatte.rendering import Ball, Scene, colorful_plate, render
from blurmatte.rendering.plates import plain_plate
from blurmatte.sweep import TransferFit, fit_sweep, fit_transfer
from blurmatte.sweep.transfer_fit import with_unstated_curves
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
TILES = Scene(
    colorful_plate(SIZE, 2, tile=20),
    Trajectory.line((44, 42), (112, 68)),
    Ball(11, (0.85, 0.6, 0.1)),
)
BEFORE_DARK = Scene(
    plain_plate(SIZE, (0.12, 0.13, 0.16), 4),
    TILES.trajectory,
    Ball(13, (0.8, 0.6, 0.2), ambient=1.0),
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


@pytest.mark.parametrize("curve", [SRGB, REC709, gamma(2.2)], ids=lambda c: c.name)
def test_numbers_of_a_file_without_a_curve_contain_the_curves_that_it_may_have(curve, tmp_path):
    """Honest: size, length and sum of alpha, written with each curve and taken as sRGB."""
    rng, truth = np.random.default_rng(3), render(BEFORE_DARK, 200)
    for name, light in (("image", truth.image.rgb), ("plate", truth.plate.rgb)):
        codes = 255 * curve.encode(light) + rng.normal(0, 1, light.shape)
        picture = Image.fromarray(np.clip(np.rint(codes), 0, 255).astype(np.uint8))
        picture.save(tmp_path / f"{name}.png")
    with pytest.warns(TransferWarning, match="taken as sRGB"):
        image, plate = (bm.read(tmp_path / f"{name}.png") for name in ("image", "plate"))
    assert image.meta.transfer_assumed
    streak = bm.find_streaks(*with_noise(image, plate))[0]
    sweep = fit_sweep(image, plate, streak)
    area = truth.layer.alpha.sum(dtype=float)
    assert abs(sweep.radius - BEFORE_DARK.body.radius) < 3 * sweep.radius_std
    assert abs(sweep.length - BEFORE_DARK.trajectory.length) < 3 * measured_length_std(sweep)
    assert abs(sweep.alpha.sum() - area) < 3 * sweep.area_std()


def measured_length_std(sweep):
    """Of its length, by differences."""
    n, J = len(sweep.path), np.zeros(len(sweep.path))
    for k in range(n):
        moved = replace(sweep, path=sweep.path + 1e-3 * np.eye(n)[k])
        J[k] = (moved.length - sweep.length) / 1e-3
    return float(np.sqrt(J @ sweep.covariance[:n, :n] @ J))


def test_a_stated_curve_is_no_error():
    """Exact: only the error of an assumed curve is added, and only where it moves the rim."""
    image, plate = files(BEFORE_DARK, SRGB, SRGB)
    stated = fit_sweep(image, plate)
    guess = fit_sweep(replace(image, meta=replace(image.meta, transfer_assumed=True)), plate)
    np.testing.assert_array_equal(guess.shape, stated.shape)
    added = guess.covariance - stated.covariance
    assert np.linalg.eigvalsh(added).min() > -1e-9
    assert 2 < guess.radius_std / stated.radius_std < 100


def test_pixels_are_decoded_with_other_curves_as_the_pictures_would_be():
    known = observed(BALL, seed=2)
    other = with_unstated_curves(known, SRGB)[0]
    codes = SRGB.encode(known.C)
    assert_allclose(other.C, REC709.decode(codes), atol=1e-9)
    by_noise = REC709.decode(codes + 0.005) - REC709.decode(codes - 0.005)
    without = SRGB.decode(codes + 0.005) - SRGB.decode(codes - 0.005)
    ratio = np.sqrt(other.C_variance / known.C_variance)
    assert_allclose(ratio.mean(), (by_noise / without).mean(), rtol=0.02)
