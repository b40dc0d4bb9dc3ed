"""Compression error of a color: recompression as the file was written, and its standard error."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from blurmatte.calibration import with_noise
from blurmatte.color import fit_color_from_hues
from blurmatte.color.compression_error import recompressed
from blurmatte.rendering import Camera, Scene, Sheet, Shot, colorful_plate, render
from blurmatte.streaks import Streak
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
GREEN = np.array([0.25, 0.7, 0.12])
LINE = GREEN / np.linalg.norm(GREEN)
PATH = Trajectory.line((50, 46), (110, 66))


@cache
def taken(width, seed=0):
    """Image and plate of an object of a given width, and its mask."""
    scene = Scene(colorful_plate(SIZE, seed, tile=18), PATH, Sheet(20, width, GREEN))
    truth = render(scene, 120)
    camera = Camera(code_std=1 / 255, jpeg_quality=90, chroma="4:2:0")
    shot = Shot(scene, camera, plate_frames=5, seed=seed)
    image, plate = with_noise(*shot.photograph(truth))
    return image, plate, Streak(truth.layer.alpha > 0)


def off(model):
    return np.degrees(np.arccos(np.clip(model.pole @ LINE, -1, 1)))


def test_recompressed_images_of_the_true_color_equal_the_photograph():
    """honest: residuals within the streak are hardly larger than outside, where noise differs."""
    image, plate, streak = taken(14)
    (light,), behind = recompressed(LINE, image, plate, streak, 1)
    within, outside = (
        np.sqrt(np.mean((light.rgb - image.rgb)[where] ** 2))
        for where in (streak.mask, ~streak.mask)
    )
    assert 0.5 * outside < within < 2 * outside
    assert np.sqrt(np.mean((behind.rgb - plate.rgb) ** 2)) < outside


def test_recompressed_images_have_independent_noise():
    image, plate, streak = taken(14)
    (same, other), (again,) = (
        [light.rgb for light in recompressed(LINE, image, plate, streak, count)[0]]
        for count in (2, 1)
    )
    assert np.array_equal(same, again)
    assert not np.array_equal(same, other)


def test_color_of_uncompressed_rendering_is_found():
    image, plate, streak = taken(14)
    (light,), behind = recompressed(LINE, image, plate, streak, 1)
    model = fit_color_from_hues(light, behind, streak)
    assert off(model) < 3 * model.angle_std


@pytest.mark.battery
def test_std_with_compression_is_calibrated():
    """A thin object in a file: neither overconfident nor much too cautious."""
    models = [fit_color_from_hues(*taken(10, seed)) for seed in range(6)]
    z2 = [(off(model) / model.angle_std) ** 2 for model in models]
    assert 0.2 < np.mean(z2) < 2


@pytest.mark.battery
def test_only_known_subsampling_adds_to_the_error():
    image, plate, streak = taken(10)
    bare = replace(image, meta=replace(image.meta, compression=None))
    assert image.meta.compression is not None
    each = replace(image.meta.compression, shared=(1, 1))
    own = replace(image, meta=replace(image.meta, compression=each))
    by_file, known, unknown = (
        fit_color_from_hues(picture, plate, streak) for picture in (image, own, bare)
    )
    assert np.array_equal(known.covariance, unknown.covariance)
    more = np.linalg.eigvalsh(by_file.covariance - unknown.covariance)
    assert more.min() > -1e-12
    assert by_file.angle_std > 1.1 * unknown.angle_std
    assert set(by_file.evidence) - set(unknown.evidence) == {"compression"}
    parts = by_file.evidence["compression"], unknown.angle_std
    assert max(parts) <= by_file.angle_std <= np.hypot(*parts) * (1 + 1e-12)
    assert off(by_file) < 3 * by_file.angle_std
