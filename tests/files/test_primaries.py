import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.files.primaries import (
    ADOBE_RGB,
    CICP_PRIMARIES,
    INTEROP_PRIMARIES,
    matrix_to_srgb,
)


def test_srgb_up_to_rounding_needs_no_matrix():
    assert matrix_to_srgb((0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.31270, 0.32900)) is None
    assert matrix_to_srgb((0.6401, 0.3299, 0.2999, 0.6001, 0.1500, 0.0600, 0.3127, 0.3290)) is None


def test_matrix_of_rec2020_is_that_of_bt2087():
    """The inverse of BT.2087-0, equation (5)."""
    to_2020 = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]
    assert_allclose(matrix_to_srgb(CICP_PRIMARIES[9]) @ to_2020, np.eye(3), atol=5e-4)


def test_white_of_d65_stays_white():
    for chromaticities in (ADOBE_RGB, CICP_PRIMARIES[12], INTEROP_PRIMARIES["ciexyzd65"]):
        assert_allclose(matrix_to_srgb(chromaticities).sum(axis=1), 1, atol=1e-12)


@pytest.mark.parametrize("bad", [np.zeros(8), np.full(8, 0.3), [np.nan] * 8])
def test_colors_that_are_no_primaries_are_rejected(bad):
    with pytest.raises(ValueError, match="no three colors"):
        matrix_to_srgb(bad)
