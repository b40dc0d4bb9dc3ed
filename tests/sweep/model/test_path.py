"""Path families: points, derivatives, and starts along a curve."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA
from blurmatte.trajectory import Trajectory

A, B = np.array([12.0, 40.0]), np.array([72.0, 15.0])
MIDDLE = np.array([35.0, 50.0])
T = np.linspace(0, 1, 24)

FAMILIES = [LINE, ARC, PARABOLA, CUBIC, BOUNCE, FROM_REST]
BENT = {
    LINE: np.array([*A, *B]),
    ARC: np.array([*A, *B, -9]),
    PARABOLA: np.array([*A, *MIDDLE, *B]),
    CUBIC: np.array([*A, 30, 45, 60, 10, *B]),
    BOUNCE: np.array([*A, *MIDDLE, *B, 0.41]),
    FROM_REST: np.array([*A, *B, 0.33]),
}
STRAIGHT = {
    LINE: np.array([*A, *B]),
    ARC: np.array([*A, *B, 0]),
    PARABOLA: np.array([*A, *(A + B) / 2, *B]),
    CUBIC: np.array([*A, *(2 * A + B) / 3, *(A + 2 * B) / 3, *B]),
    BOUNCE: np.array([*A, *(0.7 * A + 0.3 * B), *B, 0.3]),
    FROM_REST: np.array([*A, *B, 0]),
}
every_family = pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)


def line(t):
    return A + t[:, None] * (B - A)


def distance(points, curve):
    """From each point (n, 2) to the nearest one of a curve."""
    return np.linalg.norm(points[:, None] - curve, axis=2).min(axis=1)


@pytest.mark.parametrize(
    ("family", "p"),
    [*BENT.items(), (ARC, STRAIGHT[ARC]), (BOUNCE, STRAIGHT[BOUNCE])],
    ids=lambda value: getattr(value, "name", ""),
)
def test_derivatives_are_those_of_small_steps(family, p):
    step = 1e-5
    xy, D = family.at(p, T)
    assert xy.shape == (len(T), 2)
    assert D.shape == (len(T), 2, family.size) == (len(T), 2, len(p))
    for i, along in enumerate(step * np.eye(len(p))):
        slope = (family.at(p + along, T)[0] - family.at(p - along, T)[0]) / (2 * step)
        assert_allclose(D[:, :, i], slope, rtol=1e-6, atol=1e-7)


@every_family
def test_every_family_holds_the_line_at_constant_speed(family):
    assert_allclose(family.at(STRAIGHT[family], T)[0], line(T), rtol=0, atol=1e-12)


@pytest.mark.parametrize("parameters", [BENT, STRAIGHT], ids=["bent", "straight"])
@every_family
def test_paths_run_from_their_start_to_their_end(family, parameters):
    xy, _ = family.at(parameters[family], np.array([0.0, 1]))
    assert_allclose(xy, [A, B], rtol=0, atol=1e-12)


@every_family
def test_shifted_parameters_shift_the_path(family):
    p, shift = BENT[family], np.array([3.0, -7.0])
    points = {ARC: 2, BOUNCE: 3, FROM_REST: 2}.get(family, len(p) // 2)
    shifted = p.copy()
    shifted[: 2 * points] += np.tile(shift, points)
    assert_allclose(family.at(shifted, T)[0], family.at(p, T)[0] + shift, rtol=0, atol=1e-12)


@pytest.mark.parametrize("off", [0.3, 9, -9, 32.5, -50, 120])
def test_an_arc_is_a_circle_passed_at_constant_speed(off):
    p = np.array([*A, *B, off])
    along = (B - A) / np.linalg.norm(B - A)
    middle = (A + B) / 2 + off * np.array([-along[1], along[0]])
    assert_allclose(ARC.at(p, np.array([0.5]))[0], [middle], rtol=0, atol=1e-12)
    true = Trajectory.arc(A, middle, B, points=len(T))
    assert_allclose(ARC.at(p, T)[0], true.xy, rtol=0, atol=1e-9)
    steps = np.linalg.norm(np.diff(ARC.at(p, T)[0], axis=0), axis=1)
    assert_allclose(steps, steps.mean(), rtol=1e-9)


def test_an_arc_flattens_smoothly():
    """The series for small angles takes over at φ = 10⁻⁴, which is here an offset of 0.0016."""
    for off in np.linspace(0.0015, 0.0018, 7):
        p = np.array([*A, *B, off])
        parabola = np.array([*A, *ARC.at(p, np.array([0.5]))[0][0], *B])
        assert_allclose(ARC.at(p, T)[0], PARABOLA.at(parabola, T)[0], rtol=0, atol=1e-6)
        _, D = ARC.at(p, T)
        assert_allclose(np.linalg.norm(D[:, :, 4], axis=1), 4 * T * (1 - T), rtol=0, atol=1e-6)


def test_polynomials_pass_their_points_at_even_times_and_are_no_more_curved():
    for family, degree in ((LINE, 1), (PARABOLA, 2), (CUBIC, 3)):
        xy, _ = family.at(BENT[family], np.linspace(0, 1, degree + 1))
        assert_allclose(xy.ravel(), BENT[family], rtol=0, atol=1e-12)
        differences = np.diff(family.at(BENT[family], T)[0], degree, axis=0)
        assert_allclose(differences, differences[:1].repeat(len(differences), axis=0), atol=1e-11)


def test_a_bounce_turns_at_its_contact_and_is_even_on_both_sides():
    true = Trajectory.bounce(A, MIDDLE, B, at=0.41)
    assert_allclose(BOUNCE.at(BENT[BOUNCE], np.array([0.41]))[0], [MIDDLE], atol=1e-12)
    assert_allclose(BOUNCE.at(BENT[BOUNCE], T)[0], true.at(T), rtol=0, atol=1e-12)


def test_path_from_rest_is_constant_until_its_departure():
    true = Trajectory.from_rest(A, B, until=0.33)
    xy, D = FROM_REST.at(BENT[FROM_REST], T)
    assert_allclose(xy, true.at(T), rtol=0, atol=1e-12)
    assert_allclose(xy[T < 0.33], np.broadcast_to(A, (np.sum(T < 0.33), 2)), rtol=0, atol=1e-12)
    assert not D[T < 0.33][:, :, 2:].any()  # neither end nor departure are seen yet


@pytest.mark.parametrize("family", FAMILIES[:-1], ids=lambda family: family.name)
@pytest.mark.parametrize(("before", "after"), [(0.1, 0.0), (0.0, 0.15), (0.1, 0.15)])
def test_a_continued_path_is_the_same_motion_over_more_time(family, before, after):
    p = BENT[family]
    longer = family.continued(p, before, after)
    expected, _ = family.at(p, -before + T * (1 + before + after))
    assert_allclose(family.at(longer, T)[0], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("before", [0.2, 0.5])
def test_a_path_from_rest_is_continued_with_less_time_at_rest_at_the_same_speed(before):
    p, duration = BENT[FROM_REST], max(1.0, 0.67 + before)
    longer = FROM_REST.continued(p, before, 0.0)
    t = np.linspace(1 - 0.67 / duration, 1, 9)
    expected, _ = FROM_REST.at(p, 1 - (1 - t) * duration)
    assert_allclose(FROM_REST.at(longer, t)[0], expected, rtol=0, atol=1e-9)
    assert longer[4] == pytest.approx(max(0.33 - before, 0.0))


def test_corner_times_beyond_the_exposure_give_a_valid_path():
    for family, times in ((BOUNCE, (-0.5, 0.0, 1.0, 1.5)), (FROM_REST, (-0.5, 1.0, 1.5))):
        for time in times:
            p = np.array([*BENT[family][:-1], time])
            xy, D = family.at(p, T)
            assert np.all(np.isfinite(xy))
            assert np.all(np.isfinite(D))
            assert distance(xy, np.stack([A, B, MIDDLE])).max() < np.linalg.norm(B - A)


@pytest.mark.parametrize("family", [LINE, ARC, PARABOLA, CUBIC], ids=lambda family: family.name)
def test_a_start_along_a_smooth_path_of_the_family_is_that_path(family):
    curve, _ = family.at(BENT[family], np.linspace(0, 1, 33))
    (start,) = family.starts(curve)
    assert_allclose(start, BENT[family], rtol=0, atol=1e-9)


def test_a_start_along_evenly_spaced_points_of_a_throw_is_near_it():
    thrown = np.array([*A, 44, 34, *B])
    fine, _ = PARABOLA.at(thrown, np.linspace(0, 1, 2000))
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    even = np.linspace(0, length[-1], 33)
    curve = np.stack([np.interp(even, length, v) for v in fine.T], axis=1)
    for family in (PARABOLA, CUBIC):
        (start,) = family.starts(curve)
        assert distance(family.at(start, T)[0], fine).max() < 1


def test_one_start_of_a_bounce_has_its_corner():
    p = np.array([10, 10, 40, 50, 70, 10, 0.5])
    curve, _ = BOUNCE.at(p, np.linspace(0, 1, 33))
    starts = BOUNCE.starts(curve)
    assert 1 <= len(starts) <= 3
    assert min(np.abs(start - p).max() for start in starts) < 1e-9
    for start in starts:
        assert distance(start[None, 2:4], curve) < 1e-9


def test_starts_from_rest_include_both_directions():
    curve = line(np.linspace(0, 1, 33))
    forth, back = (FROM_REST.at(start, np.array([0.0, 1]))[0] for start in FROM_REST.starts(curve))
    assert_allclose(forth, [A, B], atol=1e-12)
    assert_allclose(back, [B, A], atol=1e-12)


@every_family
def test_starts_along_a_line_are_on_the_line(family):
    for start in family.starts(line(np.linspace(0, 1, 33))):
        xy, _ = family.at(start, T)
        assert start.shape == (family.size,)
        across = (xy - A) @ np.array([A[1] - B[1], B[0] - A[0]])
        assert_allclose(across, 0, atol=1e-8)


def test_motion_of_a_line_is_its_length_squared_along_it():
    """exact; a unit twice as large makes it a fourth."""
    path = np.array([3.0, 4, 33, 44])
    expected = np.outer([30.0, 40], [30.0, 40])
    assert_allclose(LINE.motion(path), expected, rtol=1e-12)
    assert_allclose(LINE.motion(path, 2.0), expected / 4, rtol=1e-12)
