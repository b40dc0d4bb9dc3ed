"""Pieces of streaks, and which of several is asked."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.errors import ColorModelError, MotionError
from blurmatte.radiometry import with_noise
from blurmatte.rendering import Ball, Scene, render
from blurmatte.streaks import (
    Streak,
    find,
    find_streaks,
    joined_behind,
    pieces_apart,
    strongest_told,
)
from blurmatte.trajectory import Trajectory

ORANGE = np.array([0.9, 0.5, 0.1])


@pytest.mark.parametrize("gap", [3, 6])
@pytest.mark.parametrize("plate", ["tiles", "plain"])
def test_two_balls_close_by_are_pieces_of_one_streak(plates, balls_side_by_side, plate, gap):
    """Exact: each pixel of the streak belongs to one piece, each ball to its own."""
    one, two, pictures = balls_side_by_side(plates[plate], gap)
    (streak,) = find_streaks(*pictures)
    pieces = pieces_apart(streak, *pictures)
    truths = one.layer.alpha, two.layer.alpha
    shares = np.array([[a[s.mask].sum() / a.sum() for a in truths] for s in pieces])
    assert_allclose(np.sort(shares, axis=1), [[0, 1], [0, 1]], atol=0.01)
    assert_array_equal(sum(s.mask.astype(int) for s in pieces), streak.mask)
    assert pieces[0].evidence >= pieces[1].evidence > 0


def test_pieces_of_a_large_picture_are_pieces_too(plates, balls_side_by_side, monkeypatch):
    """Invariant: found in cells, they fill the same streak."""
    monkeypatch.setattr(find, "_MAX_CELLS", plates["tiles"][..., 0].size / 4)
    *_, pictures = balls_side_by_side(plates["tiles"], 6)
    (streak,) = find_streaks(*pictures)
    first, second = pieces_apart(streak, *pictures)
    assert streak.cell == first.cell == 2
    assert_array_equal(first.mask ^ second.mask, streak.mask)


@pytest.mark.parametrize("plate", ["tiles", "dark", "plain", "two hues"])
def test_one_ball_is_one_piece(taken, plates, plate):
    """Invariant: neither noise nor the plate's tiles cut it."""
    ball = render(Scene(plates[plate], Trajectory.line((90, 80), (160, 100)), Ball(18, ORANGE)))
    pictures = with_noise(*taken(ball.image.rgb, plates[plate], 1, 1))
    (streak,) = find_streaks(*pictures)
    assert pieces_apart(streak, *pictures) == []


def test_a_streak_goes_on_behind_an_occluder():
    """exact: two parts on both sides of a post are one, a third one elsewhere is not."""
    parts = [Streak.from_box(box, (80, 40)) for box in
             ((10, 10, 30, 20), (40, 12, 60, 22), (10, 34, 14, 38))]  # fmt: skip
    occluder = np.zeros((40, 80), bool)
    occluder[:, 30:40] = True
    joined = joined_behind(parts, occluder)
    assert [s.box[::2] for s in joined] == [(10, 60), (10, 14)]
    assert joined[0].mask[15, 30:40].all()
    assert not joined[0].mask[30:, 30:40].any()
    assert [s.box for s in joined_behind(parts, np.zeros_like(occluder))] == [s.box for s in parts]


# Which of them tells something


def of_evidence(*evidence, whole=True):
    mask = np.zeros((4, 4), bool)
    mask[1:3, int(whole) : 3] = True
    return [Streak(mask, evidence=e) for e in evidence]


def test_streaks_are_asked_until_one_tells_something():
    streaks, asked = of_evidence(9, 8, 7), []

    def tell(streak):
        asked.append(streak)
        if streak is streaks[0]:
            raise ColorModelError("a hand")
        return streak.evidence

    assert strongest_told(streaks, tell) == 8
    assert asked == streaks[:2]


@pytest.mark.parametrize(("evidence", "count"), [((9, 8, 7, 6, 5), 4), ((9, 0.2, 0.1), 2)])
def test_few_streaks_are_asked_and_none_that_is_faint(evidence, count):
    asked = []

    def tell(streak):
        asked.append(streak.evidence)
        raise (MotionError if asked[1:] else ColorModelError)(f"nothing in {streak.evidence}")

    with pytest.raises(ColorModelError, match="nothing in 9"):
        strongest_told(of_evidence(*evidence), tell)
    assert asked == list(evidence[:count])


def test_what_is_whole_in_the_picture_is_asked_first_but_the_strongest_refuses():
    streaks = [*of_evidence(9, 8, whole=False), *of_evidence(7, 6)]
    assert [one.is_whole for one in streaks] == [False, False, True, True]
    asked = []

    def tell(streak):
        asked.append(streak.evidence)
        raise ColorModelError(f"nothing in {streak.evidence}")

    with pytest.raises(ColorModelError, match="nothing in 9"):
        strongest_told(streaks, tell)
    assert asked == [7, 6, 9, 8]


def test_other_errors_are_not_passed_over():
    def tell(streak):
        raise ValueError("a mistake")

    with pytest.raises(ValueError, match="a mistake"):
        strongest_told(of_evidence(2, 1), tell)
