"""ClipPath: the path of an object as one curve, each frame predicted from the others."""

from dataclasses import replace

import numpy as np
import pytest
from tests.motion.clip.sightings import sighted

from blurmatte.motion import FrameMotion
from blurmatte.motion.clip.clip_path import ClipPath

EXPOSURE = 0.4  # intervals between frames
STD = 0.2


def fall(t):
    """A throw, pixels at times in intervals."""
    return np.stack([20 + 9 * t, 200 - 14 * t + 0.6 * t**2], axis=-1)


def circle(t):
    """Once around in 21 intervals."""
    return 150 + 80 * np.stack([np.cos(0.3 * t), np.sin(0.3 * t)], axis=-1)


def bounce(t):
    """A throw to the floor at t = 9.7, between two exposures."""
    s = np.asarray(t - 9.7)[..., None]
    down, up = np.array([8.0, 12.0]), np.array([6.5, -9.0])
    return np.array([100.0, 200.0]) + np.where(s < 0, down, up) * s + np.array([0, 0.5]) * s**2


def row(number, path, rng=None, std=STD, factor=1.0, source="sweep", off=0.0):
    """The row of a frame; its errors are `factor` times the stated ones."""
    t = number + EXPOSURE * (np.arange(200) + 0.5) / 200
    place, ends = path(t).mean(axis=0), path(number + EXPOSURE * np.array([0.0, 1.0]))
    move = ends[1] - ends[0]
    if rng is not None:
        place, move = (v + factor * std * rng.normal(size=2) for v in (place, move))
    seen = sighted(
        np.add(place, (off, 0)),
        move,
        std,
        std,
        std / float(np.hypot(*move)),
        8.0,
        source=source,
        ends=ends,
    )
    return FrameMotion(number, number / 30, seen)


def breaks(path):
    """Rows at which a part of the path begins, with a track or after a bounce."""
    return (np.flatnonzero(np.diff(path.part)) + 1).tolist()


def rows_of(path, count=24, rng=None, **more):
    """Rows of successive frames."""
    return [row(k, path, rng, **more) for k in range(count)]


def ends_of(number, path):
    """True beginning, middle and end of the exposure."""
    return path(number + EXPOSURE * np.array([0.0, 0.5, 1.0]))


def test_curve_through_noiseless_frames_gives_their_ends_back():
    """Exact."""
    found = ClipPath.of(rows_of(fall))
    assert found.exposure == pytest.approx(EXPOSURE, rel=1e-4)
    for k in range(24):
        assert found.prior(k).points == pytest.approx(ends_of(k, fall), abs=1e-3)


def test_an_error_of_the_time_moves_the_path_of_a_frame_along_itself():
    """Exact: by a hundredth of the interval to the next frame."""
    found = ClipPath.of(rows_of(fall))
    sure, late = (found.prior(7, std).covariance for std in (0.0, 0.01))
    by_time = np.linalg.norm(ends_of(8, fall)[1] - ends_of(6, fall)[1]) / 2 * 0.01
    assert np.sqrt(np.trace((late - sure)[2:4, 2:4])) == pytest.approx(by_time, rel=1e-2)


def rms_of_predictions(path, count, seeds):
    """Root mean square of the errors of predictions from the other frames, standard deviations."""
    z2 = []
    for seed in seeds:
        found = ClipPath.of(rows_of(path, count, np.random.default_rng(seed)))
        for k in range(count):
            prior = found.prior(k)
            error = (prior.points - ends_of(k, path)).ravel()
            z2.append(error @ np.linalg.solve(prior.covariance, error) / 6)
    return np.sqrt(np.mean(z2))


@pytest.mark.parametrize("path", [fall, circle, bounce])
def test_errors_of_predictions_are_conservative(path):
    """Honest: of ends and middle, each frame from the others. The path may be less smooth than these,
    and errors have a Student distribution: they are about 0.7 of those stated.
    """
    assert 0.55 < rms_of_predictions(path, 24, range(4)) < 0.9


def test_frames_determine_the_exposure():
    """Honest."""
    found = [ClipPath.of(rows_of(fall, rng=np.random.default_rng(seed))) for seed in range(24)]
    z = [(one.exposure - EXPOSURE) / one.exposure_std for one in found]
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.25


def test_path_is_broken_at_a_bounce_only():
    for seed in range(3):
        found = ClipPath.of(rows_of(bounce, rng=np.random.default_rng(seed)))
        assert breaks(found) == [10]
        assert not found.contradicts.any()
        for smooth in (fall, circle):
            assert not breaks(ClipPath.of(rows_of(smooth, rng=np.random.default_rng(seed))))


def test_scatter_beyond_stated_errors_is_found():
    """Honest: three times the stated errors, and the stated ones."""
    for factor in (1.0, 3.0):
        found = [
            ClipPath.of(rows_of(fall, rng=np.random.default_rng(seed), factor=factor))
            for seed in range(4)
        ]
        ratio = np.mean([one.birge_ratio for one in found])
        assert ratio == pytest.approx(factor, rel=0.2)
        added = np.mean([one.added_to_discs for one in found])
        assert added == pytest.approx(STD * np.sqrt(factor**2 - 1), abs=0.1)
        place, move = found[0].factors(rows_of(fall)[3].sighting)
        assert place == pytest.approx(factor, rel=0.4)
        assert move == pytest.approx(factor, rel=0.4)


def test_moments_share_the_errors_of_positions_and_can_contradict():
    """Honest: errors of a clip are in all its frames; a moment far off the path is a mistake."""
    rows = rows_of(fall, rng=np.random.default_rng(0), factor=3.0)
    for k in (5, 9, 14, 18):
        rows[k] = row(k, fall, source="moments", std=0.01)
    found = ClipPath.of(rows)
    assert found.added_to_moments[0] >= found.added_to_discs[0] > STD
    assert not found.contradicts.any()
    rows[14] = row(14, fall, source="moments", std=0.01, off=40.0)
    rows += [row(k, fall, source="moments") for k in range(24, 40)]
    assert np.flatnonzero(ClipPath.of(rows).contradicts).tolist() == [14]


def test_direction_of_a_streak_does_not_matter():
    """Invariant: single frames do not know the direction of time."""
    rows = rows_of(fall, rng=np.random.default_rng(0))
    turned = [
        FrameMotion(one.frame, one.time, one.sighting.reversed if k % 3 else one.sighting)
        for k, one in enumerate(rows)
    ]
    a, b = (ClipPath.of(some).prior(7) for some in (rows, turned))
    assert a.points == pytest.approx(b.points, abs=1e-6)


def test_a_mistake_predicts_nothing_and_is_predicted():
    rows = rows_of(fall, rng=np.random.default_rng(0))
    noise = rows[12].sighting.motion.center[0] - ends_of(12, fall)[1][0]
    found = ClipPath.of([*rows[:12], row(12, fall, off=noise + 8 * STD), *rows[13:]])
    assert np.flatnonzero(~found.used).tolist() == [12]
    assert np.flatnonzero(found.contradicts).tolist() == [12]
    assert found.doubt(12).startswith("Its position is 2 px off")
    assert found.chi2[12].sum() > 30
    assert found.prior(12).points == pytest.approx(ends_of(12, fall), abs=1)


@pytest.mark.parametrize("count", [3, 4, 6])
def test_errors_are_conservative_if_few_frames_show_the_object(count):
    """Honest: each from two others or more."""
    assert 0.58 < rms_of_predictions(fall, count, range(24)) < 0.9


def test_tracks_have_curves_of_their_own():
    """Honest: an object that comes again elsewhere; d is that of all tracks."""
    rng, rows = np.random.default_rng(0), []
    for track in range(4):
        shifted = lambda t, track=track: fall(t - 20 * track)  # noqa: E731
        of = [row(20 * track + k, shifted, rng) for k in range(3 if track else 5)]
        rows += [replace(one, track=track + 1) for one in of]
    found = ClipPath.of(rows)
    assert breaks(found) == [5, 8, 11]
    assert abs(found.exposure - EXPOSURE) < 4 * found.exposure_std < 0.2
    assert found.added_to_discs[0] < 2 * STD
    for k, one in enumerate(rows):
        error = found.prior(k).points - ends_of(one.frame % 20, fall)
        z = error.ravel() / np.sqrt(np.diag(found.prior(k).covariance))
        assert np.abs(z).max() < 4


def test_many_mistakes_do_not_change_the_path():
    """Honest: one frame of five is wrong by many times its error."""
    rng, z = np.random.default_rng(4), []
    for _ in range(2):
        rows = rows_of(circle, 40, rng)
        wrong = rng.choice(40, 8, replace=False)
        for k in wrong:
            off = rng.normal(0, 20, 2)
            rows[k] = row(k, lambda t, off=off: circle(t) + off, rng)
        found = ClipPath.of(rows)
        for k in range(2, 38):
            prior = found.prior(k)
            e = (prior.points - ends_of(k, circle)).ravel()
            z.append(e @ np.linalg.solve(prior.covariance, e) / 6)
        off = [
            np.linalg.norm(rows[k].sighting.motion.center - ends_of(k, circle)[1]) for k in wrong
        ]
        clear = {int(k) for k, far in zip(wrong, off, strict=True) if far > 8}
        assert clear <= set(np.flatnonzero(~found.used).tolist())
    assert 0.2 < np.median(z) < 0.5  # as conservative as without mistakes
    assert np.mean(np.array(z) < 3) > 0.95


def test_too_few_frames_predict_nothing():
    found = ClipPath.of(rows_of(fall, 2))
    assert [found.prior(k) for k in range(2)] == [None] * 2
    assert breaks(ClipPath.of([])) == []
