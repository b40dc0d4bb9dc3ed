"""Tiles with hard edges, and a plate that is shifted."""

from dataclasses import replace

import numpy as np
import pytest

import blurmatte as bm
from blurmatte.matting.evidence import _at_edges, information_of, pixels_of
from blurmatte.matting.special_pixels import MixedPlate, mixed_plate, solve_mixed_plate

SHAPE = (64, 80)
COLORS = np.array([[0.6, 0.2, 0.1], [0.1, 0.4, 0.5], [0.5, 0.5, 0.1]])
TILES = COLORS[(np.add.outer(np.arange(64) // 9, np.arange(80) // 11)) % 3]
ALPHA = np.pad(np.full((30, 40), 0.3), ((17, 17), (20, 20)))
LINE = bm.ColorModel.from_samples(np.array([[0.7, 0.6, 0.3]]), std=1e-6)
PLANE = bm.ColorModel.from_samples(np.array([[0.7, 0.6, 0.3], [0.2, 0.3, 0.6]]), 2, std=1e-6)
NOISE = bm.NoiseModel(read_std=0.004)


def pictures(seed, shift=0.0, std=0.004):
    """Image and plate; the plate is blended with its right neighbor, so is on segments."""
    rng = np.random.default_rng(seed)
    light = 0.8 * LINE.rgb[0] * ALPHA[..., None] + (1 - ALPHA[..., None]) * TILES
    plate = (1 - shift) * TILES + shift * np.roll(TILES, -1, axis=1)
    return [bm.LinearImage(x + rng.normal(0, std, x.shape), NOISE) for x in (light, plate)]


def solved(image, plate, model, mixed=None):
    maps = bm.Pixelwise()(image.rgb, plate.rgb, model, image.noise, plate.noise)
    if mixed is not None:
        solve_mixed_plate(maps, mixed, image, plate, model, 0.3)
    return maps


def test_hardly_any_pixel_is_mixed_if_edges_fit():
    """Invariant."""
    image, plate = pictures(1)
    assert mixed_plate(image, plate, ALPHA == 0).edges.mean() < 0.02


def test_alpha_of_rank_1_is_exact_for_any_error_along_the_segment():
    """Exact: the equation across color and segment determines alpha."""
    image, plate = pictures(1, 0.4, 0.0)
    steps = np.roll(TILES, -1, axis=1) - TILES
    edges = (steps != 0).any(axis=-1) & (np.arange(80) < 79)
    e = steps[edges]
    mixed = MixedPlate(edges, 1e6 * e[:, :, None] * e[:, None, :])
    maps = solved(image, plate, LINE, mixed)
    assert np.abs(maps.alpha - ALPHA)[edges].max() < 1e-4
    assert np.abs(solved(image, plate, LINE).alpha - ALPHA)[edges].max() > 0.1


def test_alpha_and_light_agree_with_slow_algebra():
    """Oracle: one pixel at a time, with the matrices written out."""
    image, plate = pictures(2, 0.3)
    mixed = mixed_plate(image, plate, ALPHA == 0)
    maps = solved(image, plate, LINE, mixed)
    N = LINE.normals
    for (y, x), K in list(zip(np.argwhere(mixed.edges), mixed.covariance, strict=True))[::41]:
        C, B = image.rgb[y, x], plate.rgb[y, x]
        alpha = float(B @ N @ N.T @ (B - C) / (B @ N @ N.T @ B))
        for _ in range(3):
            t = 1 - np.clip(alpha, 0, 1)
            S = 0.004**2 * np.eye(3) + t**2 * (0.004**2 * np.eye(3) + K)
            W = N @ np.linalg.inv(N.T @ S @ N) @ N.T
            alpha = float(B @ W @ (B - C) / (B @ W @ B))
        P = (np.eye(3) - S @ W) @ (C - (1 - alpha) * B)
        assert maps.alpha[y, x] == pytest.approx(alpha, abs=1e-6)
        assert maps.alpha_std[y, x] == pytest.approx((B @ W @ B) ** -0.5, rel=1e-5)
        assert np.allclose(maps.premultiplied[y, x], P, atol=1e-6)


@pytest.mark.parametrize(("model", "least", "most"), [(LINE, 0.75, 1.1), (PLANE, 1.1, 1.5)])
def test_errors_at_edges_are_honest_for_a_line_and_40_percent_too_small_for_a_plane(
    model, least, most
):
    """Honest: a plate that is off by part of a pixel in one direction; half of its edges fit."""
    z = []
    for seed in range(5):
        image, plate = pictures(10 + seed, 0.25)
        mixed = mixed_plate(image, plate, ALPHA == 0)
        maps = solved(image, plate, model, mixed)
        at = mixed.edges & (ALPHA > 0)
        z += list(((maps.alpha - ALPHA) / maps.alpha_std)[at])
    assert least < np.sqrt(np.mean(np.square(z))) < most


def test_mixed_plate_reduces_errors_at_edges():
    image, plate = pictures(3, 0.3)
    mixed = mixed_plate(image, plate, ALPHA == 0)
    off = [
        np.sqrt(np.mean((solved(image, plate, LINE, m).alpha - ALPHA)[mixed.edges] ** 2))
        for m in (None, mixed)
    ]
    assert off[1] < off[0] / 2


def test_without_edges_the_evidence_is_that_of_the_closed_form():
    """Invariant: for κ = 0 both computations agree."""
    image, plate = pictures(4)
    edges = np.zeros(SHAPE, bool)
    edges[10:50, 10:60] = True
    mixed = MixedPlate(edges, np.zeros((np.count_nonzero(edges), 3, 3)))
    flat = replace(image, noise=np.full(image.rgb.shape, 0.004**2))
    everywhere = np.ones(SHAPE, bool)
    pixels = pixels_of(flat, plate, LINE, everywhere)
    plain, matrix = information_of(pixels, ALPHA), _at_edges(mixed, pixels, ALPHA)
    for one, other in zip(plain, matrix, strict=True):
        assert np.allclose(one[edges], other, rtol=1e-5)


def test_unknown_pixels_stay_unknown():
    """Invariant."""
    image, plate = pictures(5, 0.3)
    valid = np.ones(SHAPE, bool)
    valid[20:30, 20:40] = False
    image = replace(image, valid=valid)
    assert not (mixed_plate(image, plate, ALPHA == 0).edges & ~valid).any()
