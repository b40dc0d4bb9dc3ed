"""Point spread functions: of a path, of an alpha, and the dwell time along a path."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter

import blurmatte as bm
from blurmatte.sweep import Sweep
from blurmatte.sweep.model.path import LINE, PARABOLA
from blurmatte.sweep.model.silhouette import DISC

SIZE = (96, 56)


def sweep_along(path, radius=6.0, family=PARABOLA, std=0.05):
    n = len(path) + 1
    return Sweep(
        *(family, np.array(path, float), DISC, np.array([radius]), bm.ColorModel.any()),
        *(std**2 * np.eye(n), SIZE),
    )


ACCELERATING = (16.3, 20.2, 35.1, 33.4, 76.8, 27.9)


def placed(spread, size=SIZE):
    whole, (h, w), (x, y) = np.zeros(size[::-1]), spread.weight.shape, spread.corner
    whole[y : y + h, x : x + w] = spread.weight
    return whole


def test_time_in_each_pixel_is_exact_on_a_horizontal_line():
    spread = sweep_along((10.25, 20, 14.75, 20), family=LINE).psf()
    row = placed(spread)[20]
    assert_allclose(row[10:16] * 4.5, [0.25, 1, 1, 1, 1, 0.25], atol=1e-9)
    assert_allclose(spread.weight.sum(), 1)


def test_point_spread_agrees_with_a_histogram_of_moments():
    sweep = sweep_along(ACCELERATING)
    xy = sweep.family.at(sweep.path, (np.arange(200_000) + 0.5) / 200_000)[0]
    edges = [np.arange(n + 1) - 0.5 for n in SIZE[::-1]]
    expected, *_ = np.histogram2d(xy[:, 1], xy[:, 0], bins=edges)
    assert_allclose(placed(sweep.psf()), expected / 200_000, atol=1e-4)


def test_std_of_the_point_spread_is_the_scatter_over_paths():
    sweep = sweep_along(ACCELERATING, std=0.1)
    rng = np.random.default_rng(0)
    spread = sweep.psf()
    drawn = [placed(sweep_along(sweep.path + rng.normal(0, 0.1, 6)).psf()) for _ in range(100)]
    h, w = spread.std.shape
    x, y = spread.corner
    scatter = np.std(drawn, axis=0)[y : y + h, x : x + w]
    ratio = np.sqrt(np.sum(scatter**2) / np.sum(spread.std**2))
    assert 0.85 < ratio < 1.15


def noisy_alpha(sweep, std, seed):
    alpha = sweep.alpha
    return alpha + np.random.default_rng(seed).normal(0, std, alpha.shape), np.full_like(alpha, std)


@pytest.mark.parametrize("radius", [4.0, 8.0])
def test_free_point_spread_is_that_of_the_path(radius):
    sweep = sweep_along(ACCELERATING, radius)
    found = bm.deblurring.fit_psf(*noisy_alpha(sweep, 0.01, 1), sweep.coverage)
    true = placed(sweep.psf())
    a, b = (gaussian_filter(x, 1.5).ravel() for x in (found.weight, true))
    assert np.corrcoef(a, b)[0, 1] > 0.99
    assert_allclose(found.weight.sum(), 1, atol=1e-6)
    assert (found.weight >= 0).all()
    assert found.std.max() > 0


def test_dwell_times_are_honest():
    """Over noise the times of a path that accelerates scatter as claimed."""
    sweep, z = sweep_along(ACCELERATING), []
    t = np.linspace(0, 1, 20_001)
    xy = sweep.family.at(sweep.path, t)[0]
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
    true = np.diff(np.interp(np.linspace(0, length[-1], 31), length, t))
    for seed in range(8):
        dwell = bm.deblurring.fit_dwell(*noisy_alpha(sweep, 0.01, seed), sweep, parts=30)
        z.append((dwell.time - true) / dwell.std)
        assert abs(dwell.time.sum() - 1) < 0.02
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.2


def test_outlines_scatter_as_claimed():
    sweep = sweep_along(ACCELERATING, std=0.1)
    rng = np.random.default_rng(0)
    radii = []
    for _ in range(300):
        step = rng.normal(0, 0.1, 7)
        other = sweep_along(sweep.path + step[:6], 6.0 + step[6])
        radii.append(other.outline_at(0.3)[0, 0])  # the rightmost point
    assert_allclose(np.std(radii), sweep.outline_std(0.3)[0], rtol=0.15)


def test_point_spreads_are_written(tmp_path):
    spread = sweep_along(ACCELERATING).psf()
    for name in ("psf.exr", "psf.tif", "psf.csv"):
        bm.write(tmp_path / name, spread)
        assert (tmp_path / name).stat().st_size > 0
    header, *rows = (tmp_path / "psf.csv").read_text().splitlines()
    assert header == "x,y,weight,std"
    assert_allclose(sum(float(row.split(",")[2]) for row in rows), 1, atol=1e-6)


def test_wrong_arguments_are_refused():
    sweep = sweep_along(ACCELERATING)
    alpha, std = noisy_alpha(sweep, 0.01, 0)
    with pytest.raises(ValueError, match="odd sides"):
        bm.deblurring.fit_psf(alpha, std, np.ones((4, 5)))
    with pytest.raises(ValueError, match="nowhere large enough"):
        bm.deblurring.fit_psf(0 * alpha, std, sweep.coverage)
    with pytest.raises(ValueError, match="parts must be 4"):
        bm.deblurring.fit_dwell(alpha, std, sweep, parts=2)
