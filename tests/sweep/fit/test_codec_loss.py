from dataclasses import replace

import numpy as np
import pytest

from blurmatte.radiometry import REC709, CodingError, LinearImage
from blurmatte.radiometry.color_space import LUMA_WEIGHTS_709, ycbcr_matrix
from blurmatte.radiometry.compression import CodingErrors, FrameCoding, lost_change
from blurmatte.radiometry.image import Meta
from blurmatte.rendering import Ball, Scene, render, textured_plate
from blurmatte.streaks import Streak
from blurmatte.sweep import fit_disc
from blurmatte.trajectory import Trajectory

STEP, NOISE = 8 / 255, 1 / 255  # code values
COLOR = np.array([0.6, 0.3, 0.1])


def coded(seed, fraction):
    """Image, plate and streak of a fast ball, a fraction of whose loss by the quantizer is real."""
    rng = np.random.default_rng(seed)
    size, radius = (176, 96), rng.uniform(9, 14)
    plate = 0.6 * textured_plate(size, rng)
    path = Trajectory.line((40.3, 44), (40.3 + rng.uniform(70, 90), 50))
    scene = render(Scene(plate, path, Ball(radius, COLOR, ambient=1.0)))
    codes, before = REC709.encode(scene.image.rgb), REC709.encode(plate)
    matrix = ycbcr_matrix(LUMA_WEIGHTS_709)
    planes = (codes - before) @ matrix.T
    lost = np.stack([lost_change(planes[..., c], STEP) for c in range(3)], axis=-1)
    codes = codes - fraction * lost @ np.linalg.inv(matrix).T
    codes = np.clip(codes + NOISE * rng.standard_normal(codes.shape), 0, 1)
    variance = ((NOISE * REC709.slope(scene.image.rgb)) ** 2).astype(np.float32)
    none = CodingError(np.zeros((1, 1, 3), np.float32), size, REC709)
    meta = Meta(transfer=REC709, coding=FrameCoding(lambda: CodingErrors(none, none, STEP)))
    image = LinearImage(REC709.decode(codes).astype(np.float32), variance, meta=meta)
    known = LinearImage(plate.astype(np.float32), np.full_like(variance, 1e-9))
    return image, known, Streak(scene.layer.alpha > 0.01), radius


def radius_of(seed, fraction, with_coding=True):
    """Error of the radius over its standard deviation, and in pixels."""
    image, plate, streak, radius = coded(seed, fraction)
    if not with_coding:
        image = replace(image, meta=replace(image.meta, coding=None))
    sweep = fit_disc(image, plate, streak, Ball(1.0, COLOR, ambient=1.0).model)
    return (sweep.radius - radius) / sweep.radius_std, sweep.radius - radius


@pytest.mark.parametrize("fraction", [0.0, 0.5])
def test_radius_is_honest_whether_the_codec_lost_rims_or_not(fraction):
    # honest
    z = [radius_of(seed, fraction)[0] for seed in (0, 2)]
    assert np.sqrt(np.mean(np.square(z))) < 2


def test_correction_for_lost_rims_makes_a_disc_larger_and_less_certain():
    # invariant
    (z, off), (z_of_loss, off_of_loss) = (radius_of(2, 1.0, coding) for coding in (True, False))
    assert z_of_loss < 3 * z < 0
    assert off_of_loss < off < 0
