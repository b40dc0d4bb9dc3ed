"""frame_scatter: errors of a clip against smooth motion; frames that contradict the others."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.motion import (
    FrameMotion,
    FrameSightings,
    Scatter,
    Sighting,
    frame_scatter,
    link_sightings,
)
from blurmatte.motion import scatter_in_words as in_words

STD, RADIUS_STD = 0.3, 0.1


def clip(rng, count=60, turn=0.3, larger=1.0):
    """Around a circle that grows, seen with errors that are stated."""
    frames = []
    for k in range(count):
        way = turn * k
        x, y = 300 + 100 * np.array([np.cos(way), np.sin(way)]) + rng.normal(0, larger * STD, 2)
        radius = 12 + 0.02 * k + rng.normal(0, larger * RADIUS_STD)
        angle = (way + np.pi) % np.pi - np.pi / 2
        sighting = Sighting(
            x, y, STD, STD, 0.0, 25 * np.cos(angle), 25 * np.sin(angle), 0.5, 0.5, 25.0, 0.5, angle,
            0.02, radius, RADIUS_STD, x, y, x, y, "#ffffff", 1.0, "sweep", "parabola", "disc", 1.0,
            False, True, "",
        )  # fmt: skip
        frames.append(FrameSightings(k, k / 30, (sighting,)))
    return frames


def test_the_scatter_is_that_of_the_errors():
    """Honest: 1 where errors are as stated, and the factor by which they are larger."""
    for larger in (1, 3):
        rng = np.random.default_rng(larger)
        told = [frame_scatter(link_sightings(clip(rng, larger=larger))) for _ in range(20)]
        for name in ("place", "radius"):
            values = [getattr(one, name) for one in told]
            assert np.mean(values) == pytest.approx(larger, rel=0.15)
        assert sum(one.too_large for one in told) == (20 if larger == 3 else 0)
    assert "the errors given are as much larger" in in_words(told[0])[0]


def test_errors_that_are_given_are_the_scatter():
    """Honest: as large as they are, though each frame says less; and as stated where they are."""
    for larger in (1, 3):
        rows = [link_sightings(clip(np.random.default_rng(k), larger=larger)) for k in range(8)]
        for name, std, field in (
            ("place", STD, "x_std"),
            ("radius", RADIUS_STD, "radius_std"),
        ):
            given = [getattr(some[0].sighting, field) for some in rows]
            assert np.mean(given) == pytest.approx(larger * std, rel=0.15 if larger > 1 else 1e-12)
            times = [getattr(some[0], f"{name}_scatter") for some in rows]
            assert_allclose(np.array(given), np.array(times) * std)


def test_bent_ways_are_told_by_more_frames():
    """Honest: around a circle of eleven frames the scatter is that of the errors, not of the bend."""
    rng = np.random.default_rng(4)
    told = [frame_scatter(link_sightings(clip(rng, turn=0.57))) for _ in range(10)]
    assert np.mean([one.place for one in told]) == pytest.approx(1, rel=0.15)


@pytest.mark.parametrize(("name", "wrong"), [("place", {"x": 8.0}), ("radius", {"radius": 1.5})])
def test_what_contradicts_is_doubted(name, wrong):
    """Exact: the one frame that is off, and no other; its numbers stay."""
    frames = clip(np.random.default_rng(5))
    (s,) = frames[20].found
    off = replace(s, **{key: getattr(s, key) + value for key, value in wrong.items()})
    frames[20] = replace(frames[20], found=(off,))
    rows = link_sightings(frames)
    assert [row.frame for row in rows if row.sighting.doubts] == [20]
    assert rows[20].sighting.doubts.startswith(f"Its {name} is ")
    assert getattr(rows[20].sighting, next(iter(wrong))) == getattr(off, next(iter(wrong)))


def test_what_turns_fast_tells_nothing():
    """Exact: around a circle of six frames nothing is known, nor of a few frames."""
    rng = np.random.default_rng(2)
    for frames in (clip(rng, turn=1.05), clip(rng, count=13)):
        rows = link_sightings(frames)
        assert frame_scatter(rows) is None
        assert not any(row.sighting.doubts for row in rows)
    assert frame_scatter([FrameMotion(0, None, None, reason="nothing moved")]) is None


@pytest.mark.parametrize(
    ("place", "count", "said"),
    [
        (1.1, 16, "as they should."),
        (2.0, 16, "more than they should, but of so few frames that may be chance."),
        (2.0, 60, "the errors given are as much larger."),
    ],
)
def test_the_words_fit_the_number(place, count, said):
    """Exact."""
    (told,) = in_words(Scatter(place, 1.0, count))
    assert told.endswith(said)
