"""fuse_colors: colors of several frames as one."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color.model import ColorModel, fuse_colors

POLE = np.array([0.25, 0.7, 0.12]) / np.linalg.norm([0.25, 0.7, 0.12])
T = np.linalg.svd(POLE[:, None])[0][:, 1:]


def model(offset, std):
    """A line rotated by an offset (2,), radians, known to a std (2,)."""
    pole = POLE + T @ np.asarray(offset, float)
    pole /= np.linalg.norm(pole)
    return ColorModel(pole[:, None], T @ np.diag(np.square(std)) @ T.T, {})


def test_one_color_is_unchanged():
    one = model((0.01, 0), (0.01, 0.01))
    assert fuse_colors([one]) is one


def test_the_mean_is_weighted_by_information():
    """exact: in two directions of different accuracy."""
    fused = fuse_colors([model((0.01, 0.0), (0.01, 0.02)), model((0.0, 0.012), (0.02, 0.01))])
    offset = T.T @ fused.pole / (POLE @ fused.pole)
    assert_allclose(offset, [0.01 * 4 / 5, 0.012 * 4 / 5], rtol=1e-2)


def test_planes_have_a_mean_plane():
    """Exact: the sign of a normal has no meaning."""
    lines = [model((0.01, 0.0), (0.01, 0.02)), model((0.0, 0.012), (0.02, 0.01))]
    bases = [np.linalg.svd(line.basis)[0][:, 1:] for line in lines]
    planes = [ColorModel(b, m.covariance) for b, m in zip(bases, lines, strict=True)]
    turned = replace(planes[1], basis=planes[1].basis[:, ::-1])
    for pair in (planes, [planes[0], turned]):
        fused = fuse_colors(pair)
        assert fused.rank == 2
        assert_allclose(abs(fused.pole @ fuse_colors(lines).pole), 1, rtol=1e-9)


def test_the_error_shrinks_with_the_number_of_frames():
    """exact: for equal frames by the root of their number."""
    one = model((0, 0), (0.01, 0.01))
    assert_allclose(fuse_colors([one] * 4).angle_std, one.angle_std / 2, rtol=1e-3)


def test_the_fused_error_is_honest():
    """honest: 256 draws of five colors each."""
    rng, z = np.random.default_rng(0), []
    for _ in range(256):
        std = rng.uniform(0.003, 0.02, (5, 2))
        fused = fuse_colors([model(rng.normal(0, s), s) for s in std])
        off = POLE / (fused.pole @ POLE) - fused.pole
        z.append(off @ np.linalg.pinv(fused.covariance) @ off / 2)
    assert 0.85 < np.sqrt(np.mean(z)) < 1.15


def test_colors_that_disagree_have_a_larger_error():
    agree, differ = (
        fuse_colors([model((x, 0), (0.002, 0.002)), model((-x, 0), (0.002, 0.002))])
        for x in (0.001, 0.03)
    )
    assert differ.angle_std > 5 * agree.angle_std
    assert differ.evidence["frames"] == pytest.approx(differ.angle_std, rel=0.5)
