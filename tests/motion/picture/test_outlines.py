"""end_silhouettes: first and last silhouette from the derivative of alpha along the motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from tests.scenes import solution_of

from blurmatte.errors import MotionError
from blurmatte.motion import end_silhouettes, measure_motion

SHAPE = (60, 110)
START, SHIFT = np.array([28.0, 24.0]), np.array([50.0, 12.0])


def silhouette(at, x, y):
    """A rounded cross, as long as it is wide."""
    dx, dy = x - at[0], y - at[1]
    return np.clip(10.5 - np.hypot(dx, dy) - 2 * np.cos(4 * np.arctan2(dy, dx)), 0, 1)


def streak(shift=SHIFT, moments=400):
    """Alpha of the cross along a straight path, and its first and last silhouette."""
    y, x = np.indices(SHAPE).astype(float)
    places = [START + shift * t for t in (np.arange(moments) + 0.5) / moments]
    alpha = np.mean([silhouette(place, x, y) for place in places], axis=0)
    return alpha, silhouette(START, x, y), silhouette(START + shift, x, y)


def around(alpha, std, **stats):
    """A solution that is known where alpha is, and a few pixels around."""
    return solution_of(alpha, std, gaussian_filter(alpha, 2) >= 0.002, **stats)


def test_change_is_first_minus_last_silhouette():
    """Oracle: both silhouettes drawn and smoothed by the same Gaussian."""
    alpha, first, last = streak()
    solution = around(alpha, 1e-4)
    motion = measure_motion(solution)
    ends = end_silhouettes(solution, motion)
    assert ends.scale == 1
    soft_first, soft_last = (gaussian_filter(s, ends.scale) for s in (first, last))
    assert motion.length == pytest.approx(np.hypot(*SHIFT), rel=0.002)
    for found, true in ((ends.first, soft_first), (ends.last, soft_last)):
        assert np.abs(found - true).max() < 0.12  # at edges, because of the pixel grid
        assert np.sqrt(np.mean((found - true)[true > 0.01] ** 2)) < 0.03


def test_change_is_zero_in_overlap():
    """Exact: a shift by less than its size leaves 0 in the middle."""
    alpha, first, last = streak(np.array([8.0, 2.0]))
    ends = end_silhouettes(*_measured(alpha))
    both = (gaussian_filter(first, 1) > 0.99) & (gaussian_filter(last, 1) > 0.99)
    assert both.sum() > 20
    assert np.abs(ends.change[both]).max() < 0.03
    assert ends.change.max() > 0.5


def _measured(alpha):
    solution = around(alpha, 1e-4)
    return solution, measure_motion(solution)


@pytest.mark.parametrize("softness", [0, 2.0])
def test_error_matches_scatter(softness):
    """Honest: independent and correlated noise of pixels."""
    rng, std = np.random.default_rng(0), 0.01
    alpha, _, _ = streak()
    motion = measure_motion(around(alpha, 1e-4))
    exact = end_silhouettes(around(alpha, 1e-4), motion)
    z = []
    for _ in range(20):
        noise = rng.normal(size=SHAPE)
        if softness:
            noise = gaussian_filter(noise, softness) * np.sqrt(4 * np.pi) * softness
        inside = around(alpha, std).streak
        together = max(4 * np.pi * softness**2, 1) * inside.sum() * std**2
        own = {"sum_alpha_std": float(np.sqrt(together))}
        noisy = around(alpha + np.where(inside, std * noise, 0), std, **own)
        ends = end_silhouettes(noisy, motion)
        smooth = gaussian_filter(exact.change, np.sqrt(ends.scale**2 - 1))
        middle = gaussian_filter(inside.astype(float), 4) > 0.99
        z.append((ends.change - smooth)[middle] / ends.change_std[middle])
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.2)


def test_error_is_infinite_where_alpha_is_unknown():
    """Exact: infinite errors where alpha is not known."""
    alpha, _, _ = streak()
    solution = around(alpha, 0.001)
    motion = measure_motion(solution)
    unknown = solution.alpha_std.copy()
    unknown[30, 50] = np.inf
    solution = replace(solution, alpha_std=unknown)
    ends = end_silhouettes(solution, motion)
    assert np.isinf(ends.change_std[30, 50])
    assert np.isfinite(ends.change_std).sum() == alpha.size - 1
    assert "EndSilhouettes(110x60, ± " in repr(ends)


def test_object_at_rest_is_rejected():
    """Door."""
    y, x = np.indices(SHAPE).astype(float)
    solution = around(np.clip(10.5 - np.hypot(x - 50.3, y - 30.1), 0, 1), 0.02)
    with pytest.raises(MotionError, match="first and the last silhouette cannot be distinguished"):
        end_silhouettes(solution, measure_motion(solution))
