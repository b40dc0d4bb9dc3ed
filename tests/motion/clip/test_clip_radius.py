"""ClipRadius: the radius of an object as one curve, each frame predicted from the others."""

import numpy as np
import pytest
from tests.motion.clip.sightings import sighted

from blurmatte.motion import FrameMotion
from blurmatte.motion.clip.clip_path import ClipRadius

STD = 0.1


def row(frame, radius, std=STD, source="sweep", doubts="", track=1):
    seen = sighted(
        *((1.0, 1.0), (1.0, 1.0)),
        **{"radius": radius, "radius_std": std, "source": source},
        doubts=(doubts,) if doubts else (),
    )
    return FrameMotion(frame, None, seen, track)


def noisy(rng, radii, factor=1.0):
    """Rows of radii with `factor` times the stated errors."""
    return [row(k, r + factor * STD * rng.normal()) for k, r in enumerate(radii)]


def test_predicted_radius_is_that_of_the_other_frames():
    """Exact: a radius that grows by a constant, whatever the frame itself says."""
    rows = [row(k, 6 + 0.1 * k if k != 5 else 9.0) for k in range(11)]
    found = ClipRadius.of(rows)
    assert found.predicted(5)[0] == pytest.approx(6.5)
    assert np.flatnonzero(found.contradicts).tolist() == [5]
    assert found.doubt(5).startswith("Its radius is 2.5 px off")


def scatter_of_predictions(count, draws):
    """Errors over those stated, in the first frame and in the middle, constant and growing."""
    z2, rng = [], np.random.default_rng(count)
    for growth in (0.0, 0.3):
        for _ in range(draws):
            radii = 8 + growth * np.arange(count)
            found = ClipRadius.of(noisy(rng, radii))
            for k in (0, count // 2):
                error = found.states.mean[k, 0] - radii[k]
                z2.append(error**2 / found.states.covariance[k, 0, 0])
    return np.sqrt(np.mean(z2))


@pytest.mark.parametrize(("count", "draws"), [(6, 40), (9, 16)])
def test_error_of_prediction_is_as_stated(count, draws):
    """Honest."""
    assert 0.8 < scatter_of_predictions(count, draws) < 1.25


@pytest.mark.parametrize("count", [3, 4])
def test_error_of_prediction_from_few_frames_is_conservative(count):
    """Honest: so few do not determine whether the radius changes, which the error includes."""
    assert 0.65 < scatter_of_predictions(count, 20) < 0.9


def test_scatter_beyond_stated_errors_is_added():
    """Honest: three times the stated errors, and the stated ones."""
    for factor in (1.0, 3.0):
        rng = np.random.default_rng(1)
        found = [ClipRadius.of(noisy(rng, np.full(24, 9.0), factor)) for _ in range(8)]
        added = np.mean([one.added_to_discs for one in found])
        assert added == pytest.approx(STD * np.sqrt(factor**2 - 1), abs=0.07)
        factors = [one.factor(row(0, 9.0).sighting) for one in found]
        assert np.mean(factors) == pytest.approx(factor, rel=0.3)
        assert np.mean([one.common_std for one in found]) == pytest.approx(factor * STD, rel=0.3)


def test_doubtful_frames_and_moments_predict_nothing():
    rows = [row(k, 6.0) for k in range(5)]
    rows += [row(5, 20.0, doubts="merged"), row(6, 1.0, 1.0, "moments")]
    found = ClipRadius.of(rows)
    assert found.predicted(0)[0] == pytest.approx(6.0)
    assert not found.contradicts[5]


def test_tracks_have_curves_of_their_own():
    rows = [row(k, 6.0) for k in range(3)] + [row(20 + k, 9.0, track=2) for k in range(3)]
    assert ClipRadius.of(rows).states.mean[:, 0] == pytest.approx([6.0] * 3 + [9.0] * 3)


def test_one_frame_predicts_nothing():
    found = ClipRadius.of([row(0, 6.0), row(1, 6.0)])
    assert [found.predicted(k) for k in range(2)] == [None, None]
    assert ClipRadius.of([]).states.mean.shape == (0, 2)
