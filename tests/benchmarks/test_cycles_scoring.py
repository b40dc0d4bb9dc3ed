"""Scores of pictures with a known truth: comparison with an oracle, and a journal that resumes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.cycles import own, scoring, tables, workers
from benchmarks.cycles.errors import Deviations, Errors, errors_of
from benchmarks.cycles.methods import OURS, methods
from benchmarks.cycles.outcome import Key, Outcome, append, read_journal
from benchmarks.cycles.pictures import Facts, Picture, TrueShot, find_pictures, write_picture
from numpy.testing import assert_allclose

from blurmatte.layer import Layer
from blurmatte.matting import solve
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate, render
from blurmatte.trajectory import Trajectory

CAMERA = Camera(code_std=0.5 / 255)
TRUTH_STD = 0.002
FACTS = Facts("ball", "tiles", "png", "blurmatte", True, TRUTH_STD, (0.9, 0.5, 0.1))


def write_scene(root, name, seed):
    """A ball of radius 9 before tiles."""
    plate = colorful_plate((128, 96), rng=seed, tile=20)
    path = Trajectory.line((35, 40), (85, 58))
    truth = render(Scene(plate, path, Ball(9, (0.9, 0.5, 0.1))), substeps=200)
    rng = np.random.default_rng(seed)
    files = {
        f"{name}.png": CAMERA.expose(light.rgb, rng).astype(np.uint8)
        for name, light in (("image", truth.image), ("plate", truth.plate))
    }
    shot = TrueShot(truth.layer, truth.image, truth.plate, path, 9.0, truth.model)
    picture = Picture(root, "learn", name, "png")
    write_picture(picture, files, shot, FACTS)
    return picture


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cycles")
    for seed in (0, 1):
        write_scene(folder, f"ball_{seed}", seed)
    return folder


@pytest.fixture(scope="module")
def outcome(root):
    (picture,) = (p for p in find_pictures(root, ["learn"]) if p.scene == "ball_0")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scoring, "_warm_up", lambda method: None)  # its time does not matter here
        return scoring.attempt(scoring.Job(picture, OURS, limit=600, commit="abc"))


@pytest.fixture
def in_this_process(monkeypatch):
    """Runs jobs in this process and records them."""
    asked = []

    def run_each(function, jobs, processes):
        for job in jobs:
            asked.append((job.picture.scene, job.method))
            yield job, function(job)

    monkeypatch.setattr(scoring, "run_each", run_each)
    return asked


def made_up(scene="a", method=OURS, part="learn", rmse=0.01, **changes):
    """A synthetic answer with a claimed error of 0.01, or a rejection with the reason `why`."""
    z = Deviations.of(np.array([0.5, -1.5]))
    errors = Errors(
        rmse, 0.01, 0.0, 1.0, rmse, 0.02, 1e-4, 0.5, 2.0, -3.0, z, None, (1.0, -1.0), radius_z=0.5
    )
    key = Key(part, scene, "png", method, "abc", "d")
    answer = Outcome(key, "ball", "tiles", "png", "cycles", True, "", "Swept()", 2.0, 60.0, errors)
    return replace(answer, answered="why" not in changes, **changes)


# Errors


def test_errors_equal_those_computed_directly(root, outcome):
    """Oracle: the definitions, written out."""
    picture = Picture(root, "learn", "ball_0", "png")
    solution, truth = solve(*picture.read()), picture.truth()
    true, found = truth.layer.alpha.astype(float), outcome.errors
    known = (true > 0.004) & solution.known
    std = np.sqrt(solution.alpha_std**2 + (solution.stats.alpha_scale_std * solution.alpha) ** 2)
    z = (solution.alpha - true)[known] / np.sqrt(std[known] ** 2 + TRUTH_STD**2)
    summed = solution.streak & solution.known
    sum_error = solution.alpha[summed].sum(dtype=float) - true[summed].sum()
    stats = solution.stats
    sum_variance = stats.sum_alpha_std**2 + TRUTH_STD**2 * summed.sum()
    light = (solution.premultiplied - truth.layer.premultiplied)[known]
    light_z = (light / solution.premultiplied_std[known]).ravel()
    assert outcome.answered
    assert outcome.solver == solution.solver
    expected = {
        "alpha_rmse": np.sqrt(np.mean((solution.alpha - true)[known] ** 2)),
        "claimed": np.sqrt(np.mean(std[known] ** 2)),
        "false_alpha": np.sqrt(np.mean(solution.layer.alpha[true == 0] ** 2)),
        "sum_percent": 100 * sum_error / true[summed].sum(),
        "sum_z": sum_error / np.sqrt(sum_variance),
        "radius_percent": 100 * (solution.sweep.radius / 9 - 1),
        "radius_z": (solution.sweep.radius - 9) / solution.sweep.radius_std,
    }
    for name, value in expected.items():
        assert_allclose(getattr(found, name), value, rtol=1e-5, err_msg=name)
    assert_allclose(found.alpha.rms, np.sqrt(np.mean(z**2)), rtol=1e-5)
    assert_allclose(found.alpha.within_1, np.mean(np.abs(z) < 1), atol=1e-3)
    assert_allclose(found.alpha.robust, np.median(np.abs(z)) / 0.67449, rtol=1e-3)
    assert_allclose(
        found.light.rms, np.sqrt(np.mean(light_z[np.isfinite(light_z)] ** 2)), rtol=1e-5
    )
    ratio = expected["alpha_rmse"] / np.hypot(expected["claimed"], TRUTH_STD)
    assert_allclose(found.ratio, ratio, rtol=1e-5)


def test_errors_of_path_and_color_are_few_sigma(outcome):
    """The mean position of a line is its middle, known along two axes; likewise the color."""
    assert len(outcome.errors.path_z) == len(outcome.errors.color_z) == 2
    assert np.abs([*outcome.errors.path_z, *outcome.errors.color_z]).max() < 5
    assert outcome.errors.iou > 0.95
    assert outcome.errors.color_degrees < 1


def test_path_z_is_the_offset_of_the_middle(root):
    """Exact: a true path shifted by 1 pixel adds 1 / std along the axes of the covariance."""
    picture = Picture(root, "learn", "ball_0", "png")
    solution, truth = solve(*picture.read()), picture.truth()
    right = np.array([1.0, 0.0])
    moved = replace(truth, trajectory=Trajectory(truth.trajectory.xy + right, truth.trajectory.t))
    z, aside = (np.array(errors_of(solution, t, (t.layer,), FACTS).path_z) for t in (truth, moved))
    n = len(solution.sweep.path)
    D = solution.sweep.family.at(solution.sweep.path, np.linspace(0, 1, 129))[1].mean(axis=0)
    covariance = D @ solution.sweep.covariance[:n, :n] @ D.T
    expected = right @ np.linalg.inv(covariance) @ right
    assert_allclose(np.sum((aside - z) ** 2), expected, rtol=1e-6)


def test_empty_layer_loses_all_alpha(root):
    truth = Picture(root, "learn", "ball_0", "png").truth()
    empty = Layer(0 * truth.layer.alpha, 0 * truth.layer.premultiplied)
    errors = errors_of(empty, truth, (truth.layer,), FACTS)
    streak = truth.layer.alpha[truth.layer.alpha > 0]
    assert_allclose(errors.shown_rmse, np.sqrt(np.mean(streak.astype(float) ** 2)), rtol=1e-6)
    assert (errors.shown_bias, errors.covered, errors.claimed, errors.ratio) == (-1, 0, None, None)


def test_error_is_that_of_the_nearer_of_two_crossing_objects(root):
    """Exact: an answer equal to one of them has no error."""
    truth = Picture(root, "learn", "ball_0", "png").truth()
    half = Layer(truth.layer.alpha / 2, truth.layer.premultiplied / 2)
    errors = errors_of(half, truth, (truth.layer, half), FACTS)
    assert (errors.alpha_rmse, errors.shown_bias) == (0, 0)
    assert errors_of(half, truth, (truth.layer,), FACTS).alpha_rmse > 0.05


def test_pooled_deviations_are_those_of_all_values():
    rng = np.random.default_rng(0)
    parts = [rng.normal(0, scale, n) for scale, n in ((0.3, 4000), (1, 9000), (5, 700))]
    together = Deviations.of(np.concatenate(parts))
    pooled = tables.pooled([Deviations.of(part) for part in parts])
    assert pooled.counts == together.counts
    assert_allclose(
        [pooled.count, pooled.rms, pooled.within_1, pooled.within_2],
        [together.count, together.rms, together.within_1, together.within_2],
    )
    assert_allclose(pooled.robust, together.robust, rtol=0.02)


def test_first_disc_is_near_a_ball(root):
    picture = Picture(root, "learn", "ball_0", "png")
    truth = picture.truth()
    case = scoring.Case(*picture.read(), truth.layer, picture.model())
    errors = errors_of(methods()["first disc"].answer(case), truth, (truth.layer,), FACTS)
    assert errors.alpha_rmse < 0.01
    assert errors.light.rms < 3


# Own scenes


def test_own_scenes_have_the_format_of_the_second_truth(tmp_path):
    kinds = ("ball", "two balls that cross")
    assert own.write_own(tmp_path, 1, kinds=kinds) == 4
    assert own.write_own(tmp_path, 1, kinds=kinds) == 0  # all are there
    pictures = find_pictures(tmp_path, ["own"], ["phone"])
    ball, crossing = sorted(pictures, key=lambda picture: picture.facts.kind)
    assert (ball.facts.round, crossing.facts.round) == (True, False)
    assert ball.facts.camera_class == crossing.facts.camera_class == "phone"
    truth = crossing.truth()
    whole, first, second = crossing.answers(truth)
    assert_allclose(first.alpha + second.alpha, whole.alpha, atol=2e-3)
    assert first.alpha.max() > 0.1
    assert second.alpha.max() > 0.1
    assert len(ball.answers(ball.truth())) == 1
    assert_allclose(
        ball.model().basis[:, 0],
        ball.truth().layer.color / np.linalg.norm(ball.truth().layer.color),
        atol=1e-3,
    )


# Journal


def test_outcome_survives_json(outcome):
    rejected = made_up(why="nothing moved", cpu_seconds=None)
    for one in (outcome, rejected):
        assert Outcome.from_json(one.to_json()) == one


def test_cut_off_last_line_is_dropped(tmp_path):
    path = tmp_path / "journal.jsonl"
    append(path, [made_up("a"), made_up("b")])
    path.write_bytes(path.read_bytes()[:-40])
    assert read_journal(path) == [made_up("a")]
    append(path, [made_up("c")])
    assert read_journal(path) == [made_up("a"), made_up("c")]


def test_damaged_lines_before_the_last_are_rejected(tmp_path):
    path = tmp_path / "journal.jsonl"
    path.write_text('{"key": 1}\n' + made_up().to_json() + "\n")
    with pytest.raises(ValueError, match="no outcome"):
        read_journal(path)


def test_second_run_computes_only_missing_outcomes(tmp_path, in_this_process, monkeypatch):
    monkeypatch.setattr(scoring, "attempt", lambda job: replace(made_up(), key=job.key))
    write_scene(tmp_path, "a", 0)
    (tmp_path / "pictures/learn/unfinished/png/truth").mkdir(parents=True)
    scoring.score(tmp_path)
    assert in_this_process == [("a", OURS)]
    write_scene(tmp_path, "b", 1)
    journal = scoring.score(tmp_path)
    assert in_this_process == [("a", OURS), ("b", OURS)]
    write_scene(tmp_path, "a", 2)  # rendered again
    scoring.score(tmp_path)
    assert in_this_process[2:] == [("a", OURS)]
    assert len(read_journal(journal)) == 3


@pytest.mark.parametrize("removed", ["truth/path.json", "image.png"])
def test_picture_rendered_during_a_run_is_scored_by_the_next(
    tmp_path, in_this_process, monkeypatch, removed
):
    attempt = scoring.attempt

    def removing(job):
        (job.picture.folder / removed).unlink()
        return attempt(job)

    monkeypatch.setattr(scoring, "attempt", removing)
    write_scene(tmp_path, "a", 0)
    assert read_journal(scoring.score(tmp_path)) == []
    assert in_this_process == [("a", OURS)]


def test_rejects_unknown_methods(tmp_path):
    with pytest.raises(ValueError, match="method must be one of blurmatte"):
        scoring.score(tmp_path, names=["blurmat"])


# Workers


def test_results_come_from_other_processes():
    assert sorted(workers.run_each(abs, [-1, 2, -3], 2)) == [(-3, 3), (-1, 1), (2, 2)]


def test_ended_worker_is_replaced():
    jobs = [(f"__import__('os')._exit({code})" if code else "7") for code in (3, 0, 4)]
    results = [result for _, result in workers.run_each(eval, jobs, 1)]
    assert results == [workers.Ended(3), 7, workers.Ended(4)]
    assert not results[0].by_limit


def test_exception_of_a_job_is_raised():
    with pytest.raises(RuntimeError, match="job x"):
        list(workers.run_each(float, ["x"], 1))


def endless():
    while True:
        sum(range(1000))


def test_time_limit_stops_python_code_and_keeps_the_process():
    with workers.cpu_limit(0.01), pytest.raises(workers.OutOfTime):
        endless()
    assert sum(range(10)) == 45


def test_time_limit_ends_a_blocked_process():
    within = "__import__('benchmarks.cycles.workers').cycles.workers"
    job = f"[c := {within}.cpu_limit(0.05), c.__enter__(), sum(range(10**9))]"
    ((_, ended),) = workers.run_each(eval, [job], 1)
    assert ended.by_limit


def test_picture_beyond_the_time_limit_has_no_answer(root):
    """The outcome is that of the empty layer."""
    journal = scoring.score(root, cameras=["png"], names=["published"], limit=1e-3, processes=1)
    outcomes = read_journal(journal)
    assert [o.why for o in outcomes] == ["no answer within 0.001 CPU s"] * 2
    assert all(o.out_of_time and not o.answered for o in outcomes)
    assert all(o.errors.shown_bias == -1 for o in outcomes)


# Two machines


def test_check_lists_numbers_that_differ(tmp_path):
    a, b, c = (tmp_path / name for name in "abc")
    first = made_up()
    errors = replace(first.errors, alpha_rmse=0.01 + 1e-7)
    append(a, [first, made_up("b")])
    append(b, [replace(first, cpu_seconds=9.0, errors=errors), made_up("b")])
    assert scoring.check(a, b) == []
    append(c, [replace(first, errors=replace(errors, sum_z=-3.001)), made_up("c")])
    different, *missing = scoring.check(a, c)
    assert different == "learn, a, png, blurmatte: errors sum_z: -3.0 and -3.001"
    assert [line.split(":")[0] for line in missing] == [f"learn, {s}, png, blurmatte" for s in "bc"]


# Tables


def test_tables_agree_with_the_journal(tmp_path):
    wrong = made_up("b", rmse=0.05, cpu_seconds=8.0)
    rejected = made_up("c", rmse=0.3, why="nothing moved")
    late = made_up("d", rmse=0.3, why="no answer within 60 CPU s", cpu_seconds=60.0)
    other = [made_up(scene, "first disc", rmse=0.02) for scene in "abcd"]
    sealed = made_up("e", part="sealed")
    append(tmp_path / "journal.jsonl", [made_up("a"), wrong, rejected, late, *other, sealed])
    quality, compared, honest = tables.tables(tables.selected(tmp_path, commit="abc"))
    assert "Parts: learn; sealed is held back" in quality.notes
    assert "60 CPU s" in quality.notes
    row = dict(zip(quality.columns, quality.rows[0], strict=True))
    assert (row["part"], row["kind"], row["pictures"], row["answered"]) == ("learn", "all", 4, 2)
    assert (row["out of time"], row["CPU s"], row["CPU s worst"]) == (1, 5, 60)
    assert_allclose([row["RMSE"], row["error/claim worst"]], [0.03, 5])
    assert row["error/claim <= 2"] == 0.5
    nearer = dict(
        zip(compared.column("method"), compared.column("nearer than blurmatte"), strict=True)
    )
    assert nearer == {OURS: None, "first disc": 3}
    rows = {row[3]: row[4:] for row in honest.rows}
    assert list(rows) == ["alpha", "sum", "color", "radius"]
    assert rows["sum"][0] == 2
    assert_allclose(rows["sum"][1], 3)
    assert_allclose(rows["alpha"][1:5:2], [np.sqrt((0.5**2 + 1.5**2) / 2), 0.5])


def test_sealed_part_is_in_tables_that_select_it(tmp_path):
    append(tmp_path / "journal.jsonl", [made_up("a"), made_up("e", part="sealed")])
    table, _ = tables.tables(tables.selected(tmp_path, sealed=True, commit="abc"))
    rows = [row for row in table.rows if row[2] == "sealed"]
    assert [row[3] for row in rows] == ["all"]
    assert "held back" not in table.notes


def test_rejects_tables_of_another_commit(tmp_path):
    append(tmp_path / "journal.jsonl", [made_up()])
    with pytest.raises(ValueError, match="of commit xyz, it holds those of abc"):
        tables.selected(tmp_path, commit="xyz")


def test_rejects_truth_without_facts(tmp_path):
    picture = write_scene(tmp_path, "a", 0)
    path, again = picture.folder / "truth" / "truth.json", replace(picture)
    fields = json.loads(path.read_text())
    del fields["kind"]
    path.write_text(json.dumps(fields))
    with pytest.raises(ValueError, match="kind"):
        _ = again.facts
