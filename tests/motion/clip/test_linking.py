"""link_sightings, link_objects: identity of similar objects, merged streaks, coding artifacts."""

from dataclasses import replace

import numpy as np
import pytest
from tests.motion.clip.sightings import sighted
from tests.scenes import on_line

import blurmatte as bm
from blurmatte.rendering import colorful_plate

OPEN = 0.5  # of the time from frame to frame


def sighting(place, velocity, radius=8.0, source="sweep", std=0.05):
    velocity = OPEN * np.asarray(velocity, float) * (1 if velocity[0] >= 0 else -1)
    return sighted(
        *(place, velocity, std, 0.1, 0.01, radius, 0.05),
        **{"evidence": radius**3, "source": source},
    )


def thrown(start, velocity, gravity=2.0):
    """Position in frame k, and velocity."""
    g = np.array([0, gravity])
    return lambda k: (np.array(start) + np.array(velocity) * k + g * k**2 / 2, velocity + g * k)


ONE, TWO = thrown((20, 100), (22, -12)), thrown((284, 92), (-22, -12))


def frames_of(*flights, count=13, radii=(8.0, 8.0, 5.0)):
    """Detections of flights; two that are closer than their radii are one streak."""
    frames = []
    for k in range(count):
        found = []
        for (place, velocity), radius in zip((f(k) for f in flights), radii, strict=False):
            before = found[-1].motion if found else None
            if before and np.hypot(*(before.center - place)) < radius + before.radius:
                both = (before.center + place) / 2
                found[-1] = sighting(both, velocity, 2**0.5 * radius, "moments")
            else:
                found.append(sighting(place, velocity, radius))
        order = np.random.default_rng(k).permutation(len(found))
        frames.append(bm.motion.FrameSightings(k, k / 30, tuple(found[i] for i in order)))
    return frames


def test_objects_keep_their_numbers_when_paths_cross():
    """Oracle: two similar balls on crossing paths; the frame with both in one streak has neither."""
    frames = frames_of(ONE, TWO)
    merged = [frame.frame for frame in frames if len(frame.found) == 1]
    assert merged == [6]
    rows = bm.motion.link_objects(frames)
    for row in rows:
        if row.frame in merged:
            assert row.sighting is None
            assert "1 streak of the color ignored: of several objects at once" in row.reason
            continue
        places = [flight(row.frame)[0] for flight in (ONE, TWO)]
        near = int(np.argmin([np.hypot(*(row.sighting.motion.center - p)) for p in places]))
        first = rows[0].sighting.motion.center[0] < 100
        assert row.object == (near + 1 if first else 2 - near)
        assert row.directed
        assert np.sign(row.sighting.velocity[0]) == (1, -1)[near]
    assert [row.frame for row in rows] == sorted(row.frame for row in rows)


def test_streak_direction_predicts_next_frame():
    """Oracle: in the second frame each is nearer to the other's first position."""
    flights = [thrown((120, 50), (40, 0), 0), thrown((160, 20), (-40, 0), 0)]
    rows = bm.motion.link_objects(frames_of(*flights, count=4))
    assert [{row.sighting.motion.center[1] for row in rows if row.object == n} for n in (1, 2)] in (
        [{50}, {20}],
        [{20}, {50}],
    )


def test_object_in_too_few_frames_is_dropped():
    """Exact: in two frames, unless `least` is 2; it is counted in `others`."""
    frames = frames_of(ONE)
    stray = sighting((150, 200), (3, 1), 4.0)
    frames[3:5] = [replace(f, found=(*f.found, stray)) for f in frames[3:5]]
    rows = bm.motion.link_objects(frames)
    assert {row.object for row in rows} == {1}
    assert [row.others for row in rows[2:6]] == [0, 1, 1, 0]
    asked = bm.motion.link_objects(frames, least=2)
    assert [row.object for row in asked if row.frame in (3, 4)] == [1, 2, 1, 2]
    only = bm.motion.link_objects(frames[3:5])
    assert [row.sighting for row in only] == [None, None]
    assert "2 streaks of the color ignored" in only[0].reason
    with pytest.raises(ValueError, match="least must be at least 1, got 0"):
        bm.motion.link_objects(frames, least=0)


def test_link_objects_equals_link_sightings_for_one_object():
    """Invariant: for a clip of one object."""
    frames = frames_of(ONE)
    several, single = bm.motion.link_objects(frames), bm.motion.link_sightings(frames)
    assert [row.numbers() for row in several] == [row.numbers() for row in single]


def test_each_object_has_its_acceleration():
    """Oracle: the acceleration of each from its own rows."""
    small = thrown((150, 10), (3, 1), 1.0)
    rows = bm.motion.link_objects(frames_of(ONE, TWO, small))
    found = []
    for number in (1, 2, 3):
        fall = bm.motion.fit_fall([row for row in rows if row.object == number])
        assert fall.fits
        found.append(fall.acceleration[1] / 900)
    assert sorted(found) == pytest.approx([1, 2, 2], abs=0.01)


def test_two_balls_in_rendered_clip():
    """Honest: rendered and photographed; places, sizes and velocities within their errors."""
    size, camera, rng = (150, 90), bm.rendering.Camera(code_std=1 / 255), np.random.default_rng(0)
    plate, color = colorful_plate(size, 2, tile=24), (0.7, 0.95, 0.05)
    frames = []
    for k in range(3):
        light = plate
        for y, vx, radius in ((25, 18, 7), (65, -20, 6)):
            x = 75 + (k - 1) * vx
            light = on_line(
                light, (x - vx / 4, y), (x + vx / 4, y), bm.rendering.Ball(radius, color=color)
            ).image.rgb
        frames.append(camera.photograph(light, rng))
    model = bm.ColorModel(np.array(color)[:, None] / np.linalg.norm(color))
    rows = bm.measure_clip(frames, camera.photograph(plate, rng), model, several=True, rate=30)
    assert [row.object for row in rows] == [1, 2] * 3
    for row in rows:
        s, upper = row.sighting.motion, row.sighting.motion.center[1] < 45
        vx, radius, y = (18, 7, 25) if upper else (-20, 6, 65)
        assert abs(s.center[0] - 75 - (row.frame - 1) * vx) < 5 * s.center_std[0]
        assert abs(s.center[1] - y) < 5 * s.center_std[1]
        assert abs(s.radius - radius) < 5 * s.radius_std
        assert abs(row.sighting.velocity[0] - vx / 2) < 5 * row.sighting.velocity_std[0]


@pytest.mark.parametrize("link", [bm.motion.link_sightings, bm.motion.link_objects])
def test_coding_artifacts_are_ignored(link):
    """door: artifacts of a codec before the ball appears are not on its track."""
    rng = np.random.default_rng(0)
    specks = [
        bm.motion.FrameSightings(
            k, k / 30, (sighting(rng.uniform(20, 280, 2), np.array([3, 0]), 1.0),)
        )
        for k in range(6)
    ]
    flown = frames_of(ONE)
    later = [replace(frame, frame=k + 6, time=(k + 6) / 30) for k, frame in enumerate(flown)]
    rows = link([*specks, *later])
    assert all(row.sighting is None and "ignored" in row.reason for row in rows[:6])
    assert all(row.sighting is not None and not row.sighting.motion.doubts for row in rows[6:])
