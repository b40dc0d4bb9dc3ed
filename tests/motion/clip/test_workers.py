"""Workers: several works in one pool. clip_color: frames that vote, and when the vote ends."""

import operator
from dataclasses import dataclass
from itertools import islice

import numpy as np
import pytest

from blurmatte.color.model import ColorModel
from blurmatte.motion import Workers
from blurmatte.motion.clip.color import _ROUND_STARTS, _decided, _largest_group, _log_odds
from blurmatte.motion.clip.workers import spread_out
from blurmatte.sweep.discs import DiscColors


def colors(mean, second="#2040ff", odds=(0.0, 0.0)):
    """What a frame says of the colors of an object, without the fit."""
    plane = np.linalg.qr(np.column_stack([ColorModel.from_hex(c).pole for c in (mean, second)]))[0]
    axes = np.column_stack([plane, np.cross(*plane.T)])
    return DiscColors(None, ColorModel.from_hex(mean), axes, odds)


GREEN, SKIN = colors("#a0ff50"), colors("#ffd0b0")


def test_pool_runs_several_works_in_order():
    """Exact: results in order, from the latest work; pending tasks are dropped."""
    pairs = [(k, 3) for k in range(7)]
    with Workers(2) as workers:
        assert list(workers.in_order(operator.sub, pairs)) == [k - 3 for k in range(7)]
        assert list(workers.in_order(operator.sub, pairs, 1)) == [k - 3 for k in range(7)]
        assert list(islice(workers.in_order(operator.add, pairs), 2)) == [3, 4]
        assert list(workers.in_order(operator.mul, pairs)) == [3 * k for k in range(7)]


@dataclass(frozen=True, eq=False)
class Table:
    """Adds to arrays of its own; two layouts, one of which does not lie in memory in order."""

    large: np.ndarray
    strided: np.ndarray
    empty: np.ndarray

    def __call__(self, k):
        self.large[0] += k  # of this process alone
        return float(self.large.sum() + self.strided.sum() + self.empty.sum())


def test_arrays_of_a_work_arrive_and_may_be_written():
    """Exact: each process has its own copy of arrays that are mapped from one file."""
    table = Table(np.arange(1000.0), np.arange(12.0).reshape(3, 4)[:, ::2], np.empty(0))
    with Workers(2) as workers:
        once = list(workers.in_order(table, [(0,)] * 4))
    assert once == [table.large.sum() + table.strided.sum()] * 4
    assert table.large[0] == 0


@pytest.mark.parametrize("count", [0, -1, 1.5])
def test_invalid_count_is_rejected(count):
    # door
    with pytest.raises(ValueError, match=f"workers must be at least 1, got {count}"):
        Workers(count)


@pytest.mark.parametrize("count", [1, 2, 5, 6, 7, 24, 121, 500])
def test_each_frame_votes_at_most_once(count):
    """Invariant: 24 frames at most, spread over the clip in the first round."""
    frames = [k for some in spread_out(range(count), 6, _ROUND_STARTS) for k in some]
    assert len(set(frames)) == len(frames) <= 24
    assert len(frames) >= min(count, 6)
    first = next(spread_out(range(count), 6, _ROUND_STARTS))
    assert np.diff([-1, *first, count]).max() <= -(-count // 6) + 1


def test_four_frames_decide_the_color():
    """Exact: four frames, not four streaks, with two thirds of the weight."""
    votes = [(GREEN, 1.0, k) for k in range(3)] + [(SKIN, 1.0, 0), (GREEN, 1.0, 2)]
    assert not _decided(votes)
    assert _decided([*votes, (GREEN, 1.0, 3)])
    assert not _decided([*votes, (GREEN, 1.0, 3), (SKIN, 2.0, 4)])
    assert {model for model, _, _ in _largest_group(votes)} == {GREEN}


def test_frames_decide_the_number_of_paints_together():
    """Exact: evidence of frames adds, and none of four or more decides alone."""
    some = [(colors("#a0ff50", odds=(2.0, 0.0)), 1.0, k) for k in range(6)]
    assert not any(_log_odds(some[:n], some[:n])[0] > 5 for n in (1, 4))
    assert _log_odds(some, some)[0] > 5
    one = [
        (colors("#a0ff50", odds=(9000.0, 9000.0)), 1.0, 0),
        *((GREEN, 1.0, k) for k in (1, 2, 3)),
    ]
    assert max(_log_odds(one, one)) < 5
    assert not _decided(one)
    assert min(_log_odds(one[:1], one[:1])) > 5


def test_mean_colors_of_two_paints_may_differ():
    """Exact: votes agree if their mean colors lie in the planes of each other."""
    more, less = (
        colors(*pair, odds=(50.0, 0.0)) for pair in (("#c04010", "#10c040"), ("#10c040", "#c04010"))
    )
    assert len(_largest_group([(more, 1.0, 0), (less, 1.0, 1)])) == 2
    assert len(_largest_group([(more, 1.0, 0), (SKIN, 1.0, 1)])) == 1
