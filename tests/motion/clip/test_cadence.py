"""Repeated and missing frames: decided from the errors of the places."""

from dataclasses import replace

import numpy as np
import pytest
from tests.motion.clip.test_linking import sighting

import blurmatte as bm
from blurmatte.motion.clip.cadence import Cadence


def linked(places, std=0.1, seed=1, repeats=()):
    """Rows of a disc at these places; repeated frames have the same errors but for coding."""
    rng, frames, before = np.random.default_rng(seed), [], None
    for k, place in enumerate(np.asarray(places, float)):
        error = rng.normal(0, std, 2)
        if k in repeats and before is not None:
            error = before + rng.normal(0, std / 5, 2)
        before = error
        one = replace(sighting(place + error, np.array([3.0, 0]), 1.0), x_std=std, y_std=std)
        frames.append(bm.FrameSightings(k, k / 30, (one,)))
    return bm.link_sightings(frames)


def captured(frames, speed=8.0):
    """(n, 2) places in frames of a clip that shows these frames of a capture."""
    t = np.asarray(frames, float)
    return np.stack([20 + speed * t, 60 - 2 * t + 0.05 * t**2], axis=1)


def test_repeated_frames_of_a_conversion_are_found_and_not_used():
    """Exact: 24 frames a second stored as 30."""
    numbers = np.arange(30) - (np.arange(30) + 1) // 5
    expected = (4, 9, 14, 19, 24, 29)
    rows = linked(captured(numbers), repeats=expected)
    found = Cadence.stated(rows)
    assert found.repeated == expected
    assert found.jumps == ()
    assert found.words[0].startswith("Frames 4, 9, 14 … repeat the one before (6 in all)")
    doubted = [row.frame for row in rows if row.sighting and "repeats" in row.sighting.doubts]
    assert tuple(doubted) == expected


@pytest.mark.parametrize(("lost", "words"), [(1, "twice"), (2, "three times")])
def test_missing_frames_are_named(lost, words):
    """Exact: after frame 8."""
    rows = linked(captured([k + lost * (k > 8) for k in range(20)]))
    assert Cadence.stated(rows).jumps == ((8, 9, lost + 1),)
    assert Cadence.stated(rows).words == [
        f"From 8 to 9 it moved {words} as far: frames may be missing."
    ]


@pytest.mark.parametrize("seed", range(5))
def test_steady_motion_rest_and_a_bounce_have_no_repeats(seed):
    """Exact: nothing is said of a fall, of a turning point, of an object at rest, or of a wall."""
    k = np.arange(30)
    paths = {
        "fall": captured(k),
        "pendulum": np.stack([100 + 60 * np.sin(k / 4), 50 + 0 * k], axis=1),
        "rest": np.stack([100 + 0 * k, 50 + 0 * k], axis=1),
        "wall": np.stack([100 + 8 * np.abs(k - 14.5), 50 + 0.2 * k], axis=1),
    }
    for name, places in paths.items():
        assert Cadence.stated(linked(places, seed=seed)).words == [], name


def test_slow_motion_within_the_errors_is_not_decided():
    """Honest: a step of a third of its error says nothing."""
    numbers = np.arange(30) - (np.arange(30) + 1) // 5
    assert Cadence.stated(linked(captured(numbers, 0.03), std=1.0)).repeated == ()
