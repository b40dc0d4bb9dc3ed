"""A disc and what goes with it, told in turns."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_array_equal

from blurmatte.radiometry import with_noise
from blurmatte.rendering import Ball, Camera, Scene, Shot, plain_plate, render
from blurmatte.streaks import require_streaks
from blurmatte.sweep.fit.multistart import Search
from blurmatte.sweep.fit.alternating import TURNS, beside, in_turns
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
SCENE = Scene(
    plain_plate(SIZE, (0.4, 0.4, 0.4), 4),
    Trajectory.line((56, 46), (104, 62)),
    Ball(13, (0.25, 0.7, 0.12)),
)


def searched():
    pictures = with_noise(*Shot(SCENE, Camera(code_std=1.5 / 255)).photograph(render(SCENE, 160)))
    search = Search.of(require_streaks(*pictures)[0], *pictures, None)
    return search, search.best(1)


def test_turns_end_where_both_agree():
    """invariant: what needs no turn takes one, and what was found is handed on."""
    search, disc = searched()
    asked = []

    def fit(data, state, before):
        asked.append(before)
        return len(asked)

    end, last = in_turns(
        search.data, disc, None, fit, lambda data, state, other: data, search.bounds, TURNS
    )
    assert asked == [None]
    assert last == 1
    assert np.abs(end.path - disc.path).max() < 0.05
    steps = iter([0.02, 0.02, 0.0, 0.0])

    def brighter(data, state, other):
        return replace(data, C=data.C * (1 + next(steps)))

    _, last = in_turns(search.data, disc, 7, fit, brighter, search.bounds, 3)
    assert asked[1] == 7
    assert last == len(asked) <= 4


def test_a_search_beside_something_is_one_in_other_data():
    """invariant: large pixels too."""
    search, disc = searched()
    darker = beside(search, disc, 0.5, lambda data, state, by: replace(data, B=by * data.B))
    assert_array_equal(darker.data.B, 0.5 * search.data.B)
    assert darker.coarse.scale == search.coarse.scale
    assert np.allclose(darker.coarse.B, 0.5 * search.coarse.B)
    assert darker.curves is search.curves
