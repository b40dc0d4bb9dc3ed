"""solve_clip: the frames of a clip with what they share."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from tests.clips.conftest import COLOR, FIRST, LAST, NOISE, RADIUS, SIZE, path_of
from tests.scenes import noisy, rendered

import blurmatte as bm
from blurmatte.motion.clip.clip_path import with_priors
from blurmatte.motion.clip.scene import StaticScene
from blurmatte.motion.clip.solving import FrameSolver, rows_with_priors
from blurmatte.motion.clip.workers import shared
from blurmatte.rendering import Ball, Scene, colorful_plate
from blurmatte.statistics import pooled_log_odds
from blurmatte.trajectory import Trajectory

COLOR_MODEL = bm.ColorModel(COLOR[:, None] / np.linalg.norm(COLOR))


@pytest.fixture(scope="module")
def solved(pictures):
    frames, plate = pictures
    noise = bm.NoiseModel(read_std=NOISE)
    frames = [frame.with_noise(noise) for frame in frames]
    return dict(bm.solve_clip(frames, plate.with_noise(bm.NoiseModel(read_std=1e-4))))


def test_frames_with_the_object_are_solved_and_no_others(solved):
    assert sorted(solved) == list(range(FIRST, LAST + 1))


def test_alpha_of_every_frame_agrees_with_the_truth(solved, truth):
    for k, solution in solved.items():
        error = np.where(solution.known, solution.alpha, 0) - truth[k].alpha
        assert solution.size == truth[k].size
        assert np.sqrt(np.mean(error[truth[k].alpha > 0] ** 2)) < 0.02


def test_colors_and_sums_do_not_flicker(solved):
    poles = [solution.model.pole for solution in solved.values()]
    steps = [np.degrees(np.arccos(min(a @ b, 1))) for a, b in pairwise(poles)]
    assert max(steps) < 1
    assert all(np.degrees(np.arccos(min(p @ COLOR / np.linalg.norm(COLOR), 1))) < 2 for p in poles)
    whole = [k for k in solved if k < LAST]
    sums = np.array([solved[k].alpha[solved[k].streak].sum() for k in whole])
    assert sums == pytest.approx(np.pi * RADIUS**2, rel=0.05)


def test_sweep_lies_in_the_whole_picture(solved, truth):
    for k, solution in solved.items():
        x0, y0, x1, y1 = truth[k].box
        middle = solution.sweep.trajectory.xy[64]
        assert x0 < middle[0] < x1
        assert y0 < middle[1] < y1
        assert solution.sweep.size == solution.size


def test_curved_path_that_no_other_frame_predicts_is_a_parabola():
    """Oracle: the fit starts from the path that was measured in the frame."""
    t = np.linspace(0, 1, 65)
    curve = np.stack([16 + 45 * t, 18 + 40 * (t - 0.5) ** 2], axis=1)
    scene = Scene(colorful_plate(SIZE, 1, tile=12), Trajectory(curve, t), Ball(RADIUS, COLOR))
    frame, plate = noisy(rendered(scene), bm.NoiseModel(read_std=1e-3), 1)
    ((_, solution),) = bm.solve_clip([frame], plate, COLOR_MODEL)
    assert solution.sweep.in_words == "disc on a parabola"
    assert np.abs(solution.sweep.trajectory.at(0.5) - curve[32]).max() < 0.2
    assert abs(solution.sweep.radius - RADIUS) < 0.1


def test_frames_that_mislead_are_outvoted():
    """Log odds of a frame say at most how rarely frames mislead."""
    total = pooled_log_odds([(8.0, 300.0)] * 7 + [(-5000.0, 300.0)], 0.1)
    assert total[0] == pytest.approx(6 * np.log(9), abs=0.1)
    assert pooled_log_odds([(-20.0, 1.0)] * 8, 0.1)[0] == pytest.approx(-8 * np.log(9), abs=0.01)
    assert pooled_log_odds([], 0.1).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("solver", [bm.Smooth(), bm.Pixelwise(), bm.Swept()], ids=repr)
def test_frames_are_solved_by_the_given_solver(pictures, truth, solver):
    frames, plate = pictures
    few = [frame.with_noise(bm.NoiseModel(read_std=NOISE)) for frame in frames[4:7]]
    plate = plate.with_noise(bm.NoiseModel(read_std=1e-4))
    solved = dict(bm.solve_clip(few, plate, COLOR_MODEL, solver=solver))
    assert sorted(solved) == [0, 1, 2]
    for k, solution in solved.items():
        assert solution.solver == repr(solver)
        inside = solution.streak & solution.known
        off = (solution.alpha - truth[k + 4].alpha)[inside]
        assert np.sqrt(np.mean(off**2)) < 2 * solution.stats.alpha_error


def test_a_plate_in_shadow_is_refused_in_a_clip(pictures):
    frames, plate = pictures
    with pytest.raises(ValueError, match="the shadow moves with the object"):
        next(bm.solve_clip(frames, plate, solver=bm.matting.Shaded(plate=plate)))


def test_multiplied_errors_have_their_grade(solved):
    solution = solved[5]
    larger = solution.with_errors_times(30.0)
    assert larger.stats.alpha_error == pytest.approx(30 * solution.stats.alpha_error)
    assert np.array_equal(larger.alpha, solution.alpha)
    assert larger.alpha_std == pytest.approx(30 * solution.alpha_std)
    assert larger.grade == bm.Grade.ASSUMED != solution.grade
    assert solution.with_errors_times(1.0).grade == solution.grade
    with pytest.raises(ValueError, match="1 or more"):
        solution.with_errors_times(0.5)


@pytest.fixture(scope="module")
def prepared(pictures):
    """Frames with noise, their solver, and what is to be solved."""
    frames, plate = pictures
    noise, dark = bm.NoiseModel(read_std=NOISE), bm.NoiseModel(read_std=1e-4)
    frames, plate = [frame.with_noise(noise) for frame in frames], plate.with_noise(dark)
    rows = bm.measure_clip(frames, plate, COLOR_MODEL)
    scene = StaticScene.of(frames, plate).of_color(frames, COLOR_MODEL)
    solver = FrameSolver(scene, {k: k for k in range(len(frames))})
    with shared(1) as workers:
        return frames, *rows_with_priors(frames, rows, solver, workers, False)


def test_silhouette_of_a_ball_is_a_disc_in_all_frames(prepared):
    _, solver, wanted = prepared
    assert solver.shaped == {1}
    assert all(one.prior.is_disc for one in wanted)


def test_known_disc_is_solved_by_its_shape_alone(prepared, truth):
    """The frames of a disc need no alpha without a shape, and keep their accuracy."""
    frames, solver, wanted = prepared
    one = wanted[3]
    solution = solver(frames[one.frame : one.frame + 1], one)
    assert solution.solver == "Swept()"
    assert len(solution.stats.weights) == 1
    assert solution.sweep.diagnostics.prior_probability > 1e-3
    error = np.where(solution.known, solution.alpha, 0) - truth[one.frame].alpha
    assert np.sqrt(np.mean(error[truth[one.frame].alpha > 0] ** 2)) < 0.02


def test_prior_of_a_frame_is_the_path_that_the_others_predict(prepared):
    """Honest: in units of the predicted errors."""
    _, _, wanted = prepared
    for one in wanted:
        (start, end), path = path_of(one.frame), one.prior.path
        points = np.array([start, np.add(start, end) / 2, end])
        error = (path.points - points).ravel()
        assert np.all(np.abs(error) < 4 * np.sqrt(np.diag(path.covariance)))


def test_three_frames_predict_one_another(prepared):
    """Honest: in units of the predicted errors, which are larger than from all frames."""
    some = prepared[2][1:4]
    predicted, _ = with_priors(some)
    for one, alone in zip(some, predicted, strict=True):
        prior = alone.prior
        (start, end), path = path_of(one.frame), prior.path
        error = (path.points - np.array([start, np.add(start, end) / 2, end])).ravel()
        assert np.all(np.abs(error) < 4 * np.sqrt(np.diag(path.covariance)))
        assert np.trace(path.covariance) > np.trace(one.prior.path.covariance)
        assert abs(prior.radius - RADIUS) < 4 * prior.radius_std < 2


def test_frame_that_contradicts_the_others_is_solved_alone(prepared, truth):
    frames, solver, wanted = prepared
    one = wanted[3]
    path = replace(one.prior.path, points=one.prior.path.points + np.array([0.0, 3.0]))
    wrong = replace(one, prior=replace(one.prior, path=path))
    solution = solver(frames[one.frame : one.frame + 1], wrong)
    assert "clip" in solution.stats.grade_reasons
    assert solution.stats.grade <= bm.Grade.PLAUSIBLE
    assert solution.sweep.diagnostics.prior_probability > 0.1  # of a disc's silhouette alone
    error = np.where(solution.known, solution.alpha, 0) - truth[one.frame].alpha
    assert np.sqrt(np.mean(error[truth[one.frame].alpha > 0] ** 2)) < 0.02


def test_solution_of_a_part_has_its_place_in_the_picture(pictures, truth):
    """Exact: the maps of a crop, at its place, and nothing elsewhere."""
    frames, plate = pictures
    box = (10, 0, 66, 44)
    part = bm.solve(frames[5].crop(box), plate.crop(box), matching=bm.background.Matching.NONE)
    whole = part.in_picture(box, plate.size)
    assert np.array_equal(whole.alpha[0:44, 10:66], part.alpha)
    assert whole.streak.sum() == part.streak.sum()
    (x0, y0), (x1, y1) = part.stats.streak_box[:2], whole.stats.streak_box[:2]
    assert (x1 - x0, y1 - y0) == (10, 0)
    moved = whole.sweep.trajectory.xy - part.sweep.trajectory.xy
    assert moved == pytest.approx(np.tile((10.0, 0.0), (129, 1)))
    assert whole.sweep.alpha[0:44, 10:66] == pytest.approx(part.sweep.alpha, abs=1e-9)


def test_silhouettes_are_compared_as_in_a_whole_solution(prepared):
    """Exact: the log odds of the solution of the same frame without a known shape."""
    frames, solver, wanted = prepared
    solver = replace(solver, shaped=frozenset())
    one = replace(wanted[3], prior=replace(wanted[3].prior, is_disc=False))
    frame = frames[one.frame : one.frame + 1]
    assert solver.silhouette_odds(frame, one) == solver(frame, one).stats.shape_log_odds
    far = replace(one.prior.path, points=one.prior.path.points + np.array([0.0, 3.0]))
    contradicting = replace(one, prior=replace(one.prior, path=far))
    assert solver.silhouette_odds(frame, contradicting) is None
