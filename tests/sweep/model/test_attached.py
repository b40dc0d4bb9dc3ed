"""What goes with a disc: where it is and how soft."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.sweep.model.attached import place_of, placed

DISTANCES, FARTHEST, SOFTNESS = (0.0, 1.0), 3.0, (0.1, 0.3, 1.0)


@dataclass(frozen=True)
class Spot:
    offset: np.ndarray
    softness: float


@pytest.mark.parametrize("start", [None, np.array([1.0, -0.5, np.log(0.2)])])
def test_what_leaves_nothing_is_found(start):
    """Exact: from a start like it, and from the best of some."""
    true = np.array([0.8, -1.1, np.log(0.4)])
    x = placed(lambda x: 50 * (x - true), start, DISTANCES, FARTHEST, SOFTNESS)
    assert_allclose(x, true, atol=1e-6)


def test_it_stays_within_its_bounds():
    """Invariant: not further away, nor softer, than it may be."""
    x = placed(lambda x: 50 * (x - 9.0), None, DISTANCES, FARTHEST, SOFTNESS)
    assert_allclose(x, [FARTHEST, FARTHEST, np.log(SOFTNESS[2])], atol=1e-3)


def test_its_place_is_in_radii():
    assert_allclose(place_of(Spot(np.array([4.0, -2.0]), 8.0), 8.0), [0.5, -0.25, 0.0])
    assert place_of(None, 8.0) is None
