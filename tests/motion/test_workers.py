"""Workers: one after another they do several works; and which frames are asked for a color."""

import operator
from itertools import islice

import numpy as np
import pytest

from blurmatte.color import ColorModel
from blurmatte.motion import Workers
from blurmatte.motion.clip_color import _agreed, _all_over, _clearest

GREEN, SKIN = ColorModel.from_hex("#a0ff50"), ColorModel.from_hex("#ffd0b0")


def test_the_same_workers_do_several_works():
    """Exact: in order, with the work that was given last; what is left over is forgotten."""
    pairs = [(k, 3) for k in range(7)]
    with Workers(2) as workers:
        assert list(workers.in_order(operator.sub, pairs)) == [k - 3 for k in range(7)]
        assert list(workers.in_order(operator.sub, pairs, 1)) == [k - 3 for k in range(7)]
        assert list(islice(workers.in_order(operator.add, pairs), 2)) == [3, 4]
        assert list(workers.in_order(operator.mul, pairs)) == [3 * k for k in range(7)]


@pytest.mark.parametrize("count", [0, -1, 1.5])
def test_no_workers_are_refused(count):
    # door
    with pytest.raises(ValueError, match=f"workers must be at least 1, got {count}"):
        Workers(count)


@pytest.mark.parametrize("count", [1, 2, 5, 6, 7, 24, 121, 500])
def test_no_frame_is_asked_twice(count):
    """Invariant: 24 frames at most, all over the clip from the first six on."""
    asked = list(_all_over(range(count), 4))
    assert len(set(asked)) == len(asked) <= 24
    assert len(asked) >= min(count, 6)
    first = list(_all_over(range(count), 1))
    assert np.diff([-1, *sorted(first), count]).max() <= -(-count // 6) + 1


def test_colors_agree_if_four_frames_say_so():
    """Exact: four frames, not four streaks, with two thirds of the light."""
    told = [(GREEN, 1.0, k) for k in range(3)] + [(SKIN, 1.0, 0), (GREEN, 1.0, 2)]
    assert not _agreed(told)
    assert _agreed([*told, (GREEN, 1.0, 3)])
    assert not _agreed([*told, (GREEN, 1.0, 3), (SKIN, 2.0, 4)])
    assert {model for model, _, _ in _clearest(told)} == {GREEN}
