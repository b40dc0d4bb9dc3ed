"""Coefficients of JPEG files: against a file written by Pillow, adjoint, variances."""

import io

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image

from blurmatte.deblurring.jpeg_coefficients import Coefficients
from blurmatte.jpeg.coding import compression_of, read_jpeg
from blurmatte.jpeg.structure import ZIGZAG
from blurmatte.radiometry import YCBCR

SAMPLINGS = "4:4:4", "4:2:2", "4:2:0"


def smooth(shape, seed=0):
    """(h, w, 3) code values 0…255 without clipping."""
    from scipy.ndimage import gaussian_filter

    noise = np.random.default_rng(seed).normal(size=(*shape, 3))
    return 128 + 150 * gaussian_filter(noise, (2, 2, 0))


def stored(codes, sampling, quality=95):
    """Bytes of a JPEG, and its decoded code values."""
    file = io.BytesIO()
    picture = Image.fromarray(np.rint(codes).clip(0, 255).astype(np.uint8))
    picture.save(file, "JPEG", quality=quality, subsampling=sampling)
    return file.getvalue(), np.array(Image.open(file), float)


def test_multiples_of_luma_and_chroma_have_the_same_noise():
    """Rounding of 2 x 2 pixels that share a chroma sample, and of one that has its own luma."""
    data, _ = stored(smooth((48, 64)), "4:2:0")
    z = Coefficients(compression_of(data), (48, 64))
    T = z.equally_noisy
    assert np.linalg.norm(T) == pytest.approx(np.sqrt(3))
    variances = [np.mean(q) for q in z.step_variances] * np.array([1, 4, 4])
    noise = T @ np.linalg.inv(YCBCR) @ np.diag(variances) @ np.linalg.inv(YCBCR).T @ T.T
    assert_allclose(noise, noise[0, 0] * np.eye(3), atol=1e-9)


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_coefficients_of_a_decoded_file_are_those_that_it_stores(sampling):
    data, decoded = stored(smooth((48, 64)), sampling)
    z = Coefficients(compression_of(data), (48, 64))
    file, step_variances = read_jpeg(data), z.step_variances
    for c, found in enumerate(z.stored(decoded - 128)):
        rows, columns, _ = file.blocks(c).shape
        levels = np.zeros((rows, columns, 64))
        levels[..., ZIGZAG] = file.blocks(c)
        blocks = levels.reshape(rows, columns, 8, 8).swapaxes(1, 2).reshape(8 * rows, 8 * columns)
        true = blocks * np.sqrt(12 * step_variances[c])
        assert np.sqrt(np.mean((found - true) ** 2)) < 1.2  # rounding of decoded codes


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_a_part_of_a_picture_has_the_coefficients_of_its_light_in_the_whole(sampling):
    compression = compression_of(stored(smooth((64, 64)), sampling)[0])
    part, whole = np.zeros((20, 24, 3)), np.zeros((64, 64, 3))
    part += smooth((20, 24)) - 128
    whole[19:39, 13:37] = part
    found = Coefficients(compression.cropped(13, 19), (20, 24)).of(part)
    for one, every in zip(found, Coefficients(compression, (64, 64)).of(whole), strict=True):
        assert_allclose(np.sum(one**2), np.sum(every**2))


def test_adjoint_and_variances_are_those_of_the_matrix():
    compression = compression_of(stored(smooth((32, 32)), "4:2:0")[0]).cropped(3, 5)
    z = Coefficients(compression, (12, 9))
    rng = np.random.default_rng(1)
    x, variance = rng.normal(size=(12, 9, 3)), rng.uniform(0.5, 2, (12, 9, 3))
    y = [rng.normal(size=q.shape) for q in z.step_variances]
    dot = sum(np.sum(a * b) for a, b in zip(z.of(x), y, strict=True))
    assert_allclose(dot, np.sum(x * z.adjoint(y)))
    columns = [z.of(one.reshape(12, 9, 3)) for one in np.eye(x.size)]
    for c, found in enumerate(z.variances(variance)):
        matrix = np.stack([column[c].ravel() for column in columns])
        assert_allclose(found.ravel(), np.square(matrix).T @ variance.ravel())


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_chroma_after_a_file_is_that_of_a_file_with_small_steps(sampling):
    codes = smooth((32, 48), seed=2)
    data, decoded = stored(codes, sampling, quality=100)
    seen = Coefficients(compression_of(data), (32, 48)).seen(codes)
    assert np.sqrt(np.mean((seen - decoded) ** 2)) < 1.0
