"""Shot: image and plate as a camera gives them."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from blurmatte.radiometry import NoiseModel
from blurmatte.rendering import Ball, Camera, Scene, Shot, colorful_plate, render
from blurmatte.rendering.shot import Drift, photograph_pair
from blurmatte.trajectory import Trajectory

SCENE = Scene(
    colorful_plate((48, 36), 1, tile=12),
    Trajectory.line((14, 18), (34, 20)),
    Ball(5, (0.9, 0.5, 0.1)),
)
CAMERA = Camera(NoiseModel(read_std=0.01), bits=None)


def test_same_seed_same_pictures_and_the_image_does_not_depend_on_the_plate():
    truth = render(SCENE, 20)
    image, plate = Shot(SCENE, CAMERA, seed=3).photograph(truth)
    again, several = Shot(SCENE, CAMERA, plate_frames=4, seed=3).photograph(truth)
    assert_array_equal(image.rgb, again.rgb)
    assert np.any(plate.rgb != several.rgb)
    assert np.any(Shot(SCENE, CAMERA, seed=4).photograph(truth)[0].rgb != image.rgb)


def test_a_median_of_frames_has_less_noise():
    truth = render(SCENE, 20)
    stds = [
        np.std(Shot(SCENE, CAMERA, plate_frames=n).photograph(truth)[1].rgb - truth.plate.rgb)
        for n in (1, 9)
    ]
    # The median of n normal values has a variance of about π / 2n.
    assert stds[1] / stds[0] == pytest.approx(np.sqrt(np.pi / 18), rel=0.06)


def test_drift_changes_only_the_plate():
    truth = render(SCENE, 20)
    camera = Camera(bits=None)
    image, plate = Shot(SCENE, camera, Drift(gain=(1.1, 1, 0.9))).photograph(truth)
    assert_array_equal(image.rgb, truth.image.rgb)
    assert_array_equal(plate.rgb, truth.plate.rgb * (1.1, 1, 0.9))


def test_rejects_wrong_arguments():
    with pytest.raises(ValueError, match="plate_frames must be 1 or more, got 0"):
        Shot(SCENE, plate_frames=0)
    with pytest.raises(ValueError, match="crf must lie between 0 and 51, got -1"):
        Shot(SCENE, crf=-1)


def test_a_clip_holds_image_and_plate_of_the_shot():
    pytest.importorskip("av")
    truth, camera = render(SCENE, 20), Camera(NoiseModel(read_std=0.003))
    drift = Drift(gain=(0.9, 0.9, 0.9))
    shot = Shot(SCENE, camera, drift, plate_frames=3, seed=3, crf=17)
    behind = drift.apply(truth.plate.rgb)
    by_hand = photograph_pair(camera, truth.image.rgb, behind, 3, 3, 17)
    for picture, expected in zip(shot.photograph(truth), by_hand, strict=True):
        assert_array_equal(picture.rgb, expected.rgb)
