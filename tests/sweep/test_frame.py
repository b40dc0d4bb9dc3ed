"""Frames: orthonormal, along what they were made of, and turned as they say."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.sweep.frame import Frame

ORANGE, BLUE = np.array([0.7, 0.35, 0.1]), np.array([0.1, 0.3, 0.7])
ranks = pytest.mark.parametrize("rank", [1, 2])


def frame_of(rank):
    return Frame.of(np.stack([ORANGE, BLUE], axis=1)[:, :rank])


def axes(frame):
    return np.concatenate([frame.within, frame.across], axis=1)


@ranks
def test_a_frame_is_orthonormal_and_spans_its_directions(rank):
    frame = frame_of(rank)
    directions = np.stack([ORANGE, BLUE], axis=1)[:, :rank]
    assert frame.rank == rank
    assert frame.within.shape == (3, rank)
    assert frame.across.shape == (3, 3 - rank)
    assert_allclose(axes(frame).T @ axes(frame), np.eye(3), atol=1e-14)
    assert_allclose(frame.across.T @ directions, 0, atol=1e-14)
    assert_allclose(frame.within @ frame.within.T @ directions, directions, atol=1e-14)


@ranks
def test_length_and_order_of_directions_do_not_matter(rank):
    directions = np.stack([ORANGE, BLUE], axis=1)[:, :rank]
    other = Frame.of(50 * directions[:, ::-1])
    frame = frame_of(rank)
    assert_allclose(
        other.within @ other.within.T, frame.within @ frame.within.T, rtol=0, atol=1e-13
    )


@pytest.mark.parametrize("turns", [(0, 0), (1e-3, 0), (0.3, -0.2), (-2, 5)])
@ranks
def test_a_turned_frame_is_orthonormal(rank, turns):
    turned = frame_of(rank).turned(np.array(turns, float))
    assert_allclose(axes(turned).T @ axes(turned), np.eye(3), atol=1e-14)


@ranks
def test_no_turn_is_no_change(rank):
    assert_allclose(axes(frame_of(rank).turned(np.zeros(2))), axes(frame_of(rank)), atol=1e-14)


@pytest.mark.parametrize("turns", [(1e-3, 0), (0, 1e-3), (-4e-4, 7e-4)])
def test_a_line_turns_towards_the_directions_across(turns):
    frame = frame_of(1)
    turned = frame.turned(np.array(turns))
    moved = (turned.within - frame.within)[:, 0]
    assert_allclose(moved, frame.across @ turns, rtol=0, atol=1e-6)
    assert_allclose(
        np.arccos(turned.within[:, 0] @ frame.within[:, 0]), np.hypot(*turns), rtol=1e-5
    )


@pytest.mark.parametrize("turns", [(1e-3, 0), (0, 1e-3), (-4e-4, 7e-4)])
def test_a_plane_turns_each_of_its_directions_towards_the_one_across(turns):
    frame = frame_of(2)
    turned = frame.turned(np.array(turns))
    assert_allclose(turned.within - frame.within, frame.across * turns, rtol=0, atol=1e-6)
    moved = (turned.across - frame.across)[:, 0]
    assert_allclose(moved, -frame.within @ turns, rtol=0, atol=1e-6)


@ranks
def test_turning_back_comes_back(rank):
    turns = np.array([2e-3, -3e-3])
    frame = frame_of(rank)
    back = frame.turned(turns).turned(-turns)
    assert_allclose(axes(back), axes(frame), rtol=0, atol=1e-7)
