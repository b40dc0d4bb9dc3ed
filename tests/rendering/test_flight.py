"""A ball that flies before a camera, against rays."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte import Intrinsics
from blurmatte.rendering import render_flight

LENS = Intrinsics(60, 62, 30, 22, np.array([-0.1, 0.02, 2e-3, -1e-3]))
PLATE = np.full((44, 60, 3), 0.25)


def covered_by_rays(centers, radius, cells=10):
    """(H, W) part of the rays within each pixel that meet a ball, in the mean of its places."""
    at = (np.arange(cells) + 0.5) / cells - 0.5
    y, x = (np.arange(n)[:, None] + at for n in PLATE.shape[:2])
    pixels = np.stack(np.broadcast_arrays(x.ravel()[None], y.ravel()[:, None]), axis=-1)
    rays = LENS.rays(pixels)
    hits = np.mean([rays @ c > np.sqrt(c @ c - radius**2) for c in centers], axis=0)
    h, w = PLATE.shape[:2]
    return hits.reshape(h, cells, w, cells).mean(axis=(1, 3))


def test_alpha_is_the_fraction_of_rays_that_hit_the_ball():
    """oracle: at three places, far off the axis, with distortion."""
    X = np.array([[0.3, 0.2, 1.0], [0.0, 0.0, 0.7], [-0.25, -0.1, 0.9]])
    image, layer = render_flight(PLATE, LENS, X, 0.11, (0.8, 0.3, 0.1))
    rays = covered_by_rays(X, 0.11)
    assert_allclose(layer.alpha, rays, atol=0.02)  # 100 rays in a pixel
    assert_allclose(layer.alpha.sum(), rays.sum(), rtol=3e-4)
    assert_allclose(image.rgb, layer.premultiplied + (1 - layer.alpha[..., None]) * PLATE)


def test_rejects_wrong_arguments():
    """door: the camera is not within the ball."""
    with pytest.raises(ValueError, match="in front of the camera"):
        render_flight(PLATE, LENS, [[0, 0, 0.1]], 0.11, (1, 1, 1))
