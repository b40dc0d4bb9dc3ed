"""The interface of shapes: parameters by name, and what follows from an outline."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.sweep.model.shape import FlatShape, shape_kind
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE, Silhouette

RICH = Silhouette(4, turns=True, changes=True, soft=True)
SHAPE = np.array([9.0, 0.3, -0.2, 0.05, 0.06, 0.07, 0.08, 0.9, 0.1, 0.2, 0.3, 1.4])


def test_parameters_have_the_names_of_their_meaning():
    """Exact: positions are those of the kernels."""
    found = {name: SHAPE[RICH.at(name)].tolist() for name in dict.fromkeys(RICH.names)}
    assert found == {
        "radius": [9.0],
        "stretch": [0.3, -0.2],
        "outline": [0.05, 0.06, 0.07, 0.08],
        "turn": [0.9],
        "rates": [0.1, 0.2, 0.3],
        "blur": [1.4],
    }
    assert RICH.turn(SHAPE) == 0.9
    assert RICH.softness(SHAPE) == 1.4
    assert_array_equal(RICH.turn_slope(), np.eye(12)[7])


def test_a_name_that_a_shape_lacks_has_no_parameters():
    assert not DISC.has("turn")
    assert SHAPE[:1][DISC.at("turn")].size == 0
    assert DISC.turn(SHAPE[:1]) == 0
    assert not DISC.rates(SHAPE[:1]).any()


def test_only_lengths_scale_with_the_pixel():
    """Exact."""
    assert_array_equal(np.flatnonzero(RICH.units(4.0) == 4), [0, 11])
    assert set(RICH.units(4.0)) == {1.0, 4.0}


def test_another_kind_takes_what_it_has_by_name():
    """Exact: turn and blur, which stand elsewhere."""
    soft = Silhouette(2, turns=True, soft=True)
    assert_array_equal(soft.like(RICH, SHAPE), [9.0, 0.3, -0.2, 0.9, 1.4])
    assert_array_equal(RICH.sharp.like(RICH, SHAPE), SHAPE[:-1])


@pytest.mark.parametrize("silhouette", [DISC, ELLIPSE, Silhouette(4)])
def test_area_of_a_shape_without_a_formula_is_that_of_its_outline(silhouette):
    shape = SHAPE[: silhouette.size]
    assert_allclose(FlatShape.area(silhouette, shape), silhouette.area(shape), rtol=1e-4)


def test_center_of_an_outline_is_its_centroid():
    """Oracle: the mean of points inside."""
    kind, shape = Silhouette(3), np.array([40.0, 0.1, 0.0, 0.12, 0.2])
    rim = kind.outline(shape, 720)
    angle, far = np.arctan2(*rim.T[::-1]), np.hypot(*rim.T)
    order = np.argsort(angle)
    y, x = np.mgrid[-80:81, -80:81] * 1.0
    limit = np.interp(np.arctan2(y, x), angle[order], far[order], period=2 * np.pi)
    inside = np.hypot(x, y) < limit
    assert_allclose(kind.center(shape), (x[inside].mean(), y[inside].mean()), atol=0.1)
    assert not DISC.center(np.array([9.0])).any()


def test_kinds_in_files_are_the_classes_that_are_defined():
    assert shape_kind("silhouette") is Silhouette
    with pytest.raises(ValueError, match="the shape 'torus' is unknown; import the module"):
        shape_kind("torus")
