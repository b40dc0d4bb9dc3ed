"""Repeated and missing frames: decided from the errors of the places."""

import numpy as np
import pytest
from tests.motion.clip.test_linking import sighting

import blurmatte as bm
from blurmatte.motion.clip.cadence import Cadence


def linked(places, std=0.1, seed=1, repeats=(), rate=30, times=None):
    """Rows of a disc at these places; repeated frames have the same errors but for coding."""
    rng, frames, before = np.random.default_rng(seed), [], None
    for k, place in enumerate(np.asarray(places, float)):
        error = rng.normal(0, std, 2)
        if k in repeats and before is not None:
            error = before + rng.normal(0, std / 5, 2)
        before = error
        one = sighting(place + error, np.array([3.0, 0]), 1.0, std=std)
        time = k / rate if times is None else times(k)
        frames.append(bm.motion.FrameSightings(k, time, (one,)))
    return bm.motion.link_sightings(frames)


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
    doubted = [row.frame for row in rows if row.sighting and row.sighting.motion.doubts]
    assert tuple(doubted) == expected


@pytest.mark.parametrize(("shown", "rate"), [((1, 1, 1, 2), 30), ((1, 2), 36)])
def test_captures_of_a_converted_clip_are_equally_spaced(shown, rate):
    """Honest: a fall at 24 frames a second, stored at 30 or 36; times are those of the captures."""
    numbers = np.repeat(np.arange(24), np.resize(shown, 24))
    repeats = np.flatnonzero(np.diff(numbers, prepend=-1) == 0)
    rows = linked(captured(numbers), std=0.05, repeats=repeats, rate=rate)
    kept = [row for row in rows if row.frame not in repeats]
    assert np.diff([row.time for row in kept]) == pytest.approx(1 / 24, rel=0.01)
    assert [row.time for row in rows] == sorted(row.time for row in rows)
    fall = bm.motion.fit_fall(rows)
    ay = 0.1 * 24**2
    std = fall.acceleration_covariance[1, 1] ** 0.5
    assert abs(fall.acceleration[1] - ay) < 3 * std < 0.05 * ay
    assert fall.overscatter < 1.5
    assert max(row.sighting.place_scatter for row in rows) < 1.5
    assert "equally spaced in time" in Cadence.stated(rows).words[0]


def test_times_of_a_recorder_that_stopped_are_kept():
    """Exact: frame 9 repeats frame 8 instead of the next capture."""
    numbers = np.arange(20)
    numbers[9] = 8
    rows = linked(captured(numbers), repeats=(9,))
    assert [row.time for row in rows] == [k / 30 for k in range(20)]
    assert Cadence.stated(rows).jumps == ((9, 10, 2),)


def test_a_frame_of_an_object_at_rest_is_no_repeat():
    """Exact: its path within the exposure is short, so that all times stay as they are."""
    at = 30 * np.array([0, 1, 2, 3, 3.7, 3.7, 3.7, 4, 5, 6, 7])
    resting = (4, 5, 6)
    frames = [
        bm.motion.FrameSightings(
            k, k / 25, (sighting([20 + x, 60], [3.0 if k in resting else 18.0, 0], 0.5, std=0.02),)
        )
        for k, x in enumerate(at)
    ]
    rows = bm.motion.link_sightings(frames)
    assert Cadence.stated(rows).repeated == ()
    assert [row.time for row in rows] == [k / 25 for k in range(len(at))]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 9])
def test_short_tracks_equal_times_and_exact_places_are_linked(count):
    """Door: no number overflows, is divided by zero, or is the root of a negative one."""
    numbers = np.arange(count) // 2
    odd_times = (lambda k: 0.0), (lambda k: float(k // 2)), (lambda k: 1e6 * (k > 3) + k)
    for scale, std, times in zip((1.0, 1e4, 1e-6), (0.0, 1e-9, 10.0), odd_times, strict=True):
        rows = linked(scale * captured(numbers), std=std, repeats=numbers, times=times)
        places = [row.sighting.motion.center for row in rows if row.sighting]
        assert len(places) == count
        assert np.isfinite(places).all()


@pytest.mark.parametrize(("lost", "words"), [(1, "twice"), (2, "three times")])
def test_missing_frames_are_named(lost, words):
    """Exact: after frame 8."""
    rows = linked(captured([k + lost * (k > 8) for k in range(20)]))
    assert Cadence.stated(rows).jumps == ((8, 9, lost + 1),)
    assert Cadence.stated(rows).words == [
        f"From 8 to 9 it moved {words} as far: frames may be missing."
    ]


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.battery) for k in (1, 2, 3))]
)
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
