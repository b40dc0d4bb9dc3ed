"""Benchmarks write the tables that they declare, and the report agrees with the tables."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

ROOT = Path(__file__).parents[2]
from benchmarks.battery import battery_table  # noqa: E402
from benchmarks.report import FIRST, read_result, write_report  # noqa: E402
from benchmarks.table import DirtyTreeError, Table, publish, publish_all  # noqa: E402

from benchmarks import __main__ as program  # noqa: E402
from benchmarks import table as table_module  # noqa: E402
from benchmarks import trials  # noqa: E402
from blurmatte.color.model import ColorModel  # noqa: E402
from blurmatte.rendering import Camera  # noqa: E402

FAST = "accuracy.alpha_shift"
OURS = [f"accuracy.{name}" for name in FIRST[1:] if f"accuracy.{name}" != FAST]
OURS += ["speed.closed_form", "speed.image_size"]
TABLE = Table(
    "made_up",
    "How much is | it?",
    """Two lines
    of notes.""",
    ("plate", "noise", "error"),
    [
        ("plain", 1, 0.123456),
        ("plain", 2, None),
        ("two, hues", 1, float("nan")),
        ("two, hues", 2, 3.0),
    ],
)


@pytest.fixture
def machine(monkeypatch):
    """A fixed machine: tests must not depend on commit and processor."""
    monkeypatch.setattr("benchmarks.table.machine", lambda: "a machine")


# Tables


@pytest.mark.parametrize(
    "name", [FAST, *(pytest.param(n, marks=pytest.mark.battery) for n in OURS)]
)
def test_a_quick_run_fills_its_table(name):
    (table,) = import_module(f"benchmarks.{name}").tables(quick=True)
    assert table.name == name.split(".")[1]
    numbers = [v for row in table.rows for v in row if isinstance(v, float)]
    assert numbers  # of one trial a row, some may be refused
    assert np.isfinite(numbers).all()


def test_every_benchmark_is_found():
    named = {
        f"{path.parent.name}.{path.stem}"
        for part in ("accuracy", "speed")
        for path in (ROOT / "benchmarks" / part).glob("*.py")
        if "__main__" in path.read_text(encoding="utf-8")
    }
    assert set(program.benchmarks()) == named
    assert {f"accuracy.{name}" for name in FIRST} <= named


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"rows": [("plain", 1)]}, "a row must have 3 cells"),
        ({"x": "nois"}, "there is no 'nois'"),
        ({"lines": ("plate", "hue")}, "there is no 'hue'"),
        ({"lines": "plate"}, "lines needs y"),
    ],
)
def test_table_rejects_inconsistent_fields(change, match):
    with pytest.raises(ValueError, match=match):
        replace(TABLE, **change)


# Trials


def test_trials_keep_their_setting(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.setattr(trials, "ProcessPoolExecutor", lambda *_: ThreadPoolExecutor())
    got = trials.over_seeds(lambda a, b, seed: (a, b, seed), [("x", 1), ("x", 2)], False, seeds=3)
    assert got == [[("x", n, seed) for seed in range(3)] for n in (1, 2)]


def test_direction_errors_are_those_of_the_true_color():
    """A line 0.02 off along one axis of its covariance, with a stated error of 0.01."""
    along, first, second = np.eye(3)
    covariance = 0.01**2 * np.outer(first, first) + 0.05**2 * np.outer(second, second)
    model = ColorModel(along[:, None], covariance)
    error, std = trials.direction_errors(model, 3 * (along + 0.02 * first))
    assert_allclose(np.abs(error), [0.02, 0], atol=1e-12)
    assert_allclose(std, [0.01, 0.05])


def test_attempt_distinguishes_rejections_and_answers():
    truth = trials.rendering("plain", 0)
    image, plate = trials.photograph(truth, Camera(code_std=trials.CODE), 0)
    assert trials.attempt(plate, plate, truth.model, truth).errors is None  # nothing moved
    errors = trials.attempt(image, plate, truth.model, truth).errors
    assert errors.known > 0.99
    assert 0 < errors.rmse < 0.005
    assert 0.4 < errors.spread < 0.8  # calibrated on harder scenes than this


# A clean commit


@pytest.fixture
def dirty(monkeypatch, machine, tmp_path):
    """A checkout with an uncommitted change, and the folder of its results."""
    folder = tmp_path / "docs" / "results"
    monkeypatch.setattr(table_module, "RESULTS", folder)
    monkeypatch.setattr(table_module, "QUICK_RESULTS", tmp_path / "out")
    monkeypatch.setattr(table_module, "changed_files", lambda: ("src/blurmatte/layer.py",))
    return folder


def test_dirty_tree_publishes_no_results(dirty):
    with pytest.raises(DirtyTreeError, match=r"changed: src/blurmatte/layer\.py\nCommit first, or"):
        publish(TABLE, dirty)
    assert not dirty.exists()
    publish(TABLE, dirty, allow_dirty=True)
    assert (dirty / "made_up.csv").exists()


@pytest.mark.parametrize("main", [program.main, lambda: publish_all(program.benchmarks()["made"])])
@pytest.mark.parametrize(
    ("options", "written"),
    [
        ([], None),
        (["--allow-dirty"], "docs/results"),
        (["--quick"], "out"),
        (["--folder", "elsewhere"], "elsewhere"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_programs_reject_a_dirty_tree_before_measuring(
    dirty, tmp_path, monkeypatch, main, options, written
):
    calls = []
    monkeypatch.setattr(
        program, "benchmarks", lambda: {"made": lambda quick: calls.append(quick) or [TABLE]}
    )
    monkeypatch.setattr(sys, "argv", ["benchmarks", *options])
    monkeypatch.chdir(tmp_path)
    if written is None:
        with pytest.raises(SystemExit, match=r"error: .* takes tables from a clean commit only"):
            main()
        assert calls == []
        return
    main()
    assert calls == [options == ["--quick"]]
    assert [path.parent for path in tmp_path.rglob("made_up.csv")] == [tmp_path / written]


def test_changed_and_new_files_are_found_but_not_results(tmp_path, monkeypatch):
    def git(*arguments):
        subprocess.run(["git", *arguments], cwd=tmp_path, check=True, capture_output=True)

    monkeypatch.setattr(table_module, "ROOT", tmp_path)
    changed_files = table_module.changed_files.__wrapped__
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert changed_files() == ("this is no git checkout",)
    git("init")
    (tmp_path / "a.py").write_text("1")
    git("add", "a.py")
    git("-c", "user.name=a", "-c", "user.email=a@b", "commit", "-m", "a")
    results = tmp_path / "docs" / "results"
    results.mkdir(parents=True)
    (results / "a.csv").write_text("1")
    assert changed_files() == ()
    (tmp_path / "a.py").write_text("2")
    (tmp_path / "b.py").write_text("2")
    assert changed_files() == ("a.py", "b.py")


# Battery


def test_battery_counts_agree_with_pytest(tmp_path):
    junit = tmp_path / "battery.xml"
    junit.write_text(
        """<testsuites><testsuite name="pytest" errors="1" failures="1" skipped="1" tests="6" time="90">
        <testcase classname="tests.sweep.test_fit" name="test_a[wall]" time="1"/>
        <testcase classname="tests.sweep.test_fit" name="test_b"><failure message="x"/></testcase>
        <testcase classname="tests.test_gallery" name="test_c"><error message="x"/></testcase>
        <testcase classname="tests.test_gallery" name="test_d"><skipped message="x"/></testcase>
        <testcase classname="tests.test_gallery" name="test_e"/>
        <testcase classname="tests.test_gallery" name="test_f"/>
        </testsuite></testsuites>"""
    )
    table = battery_table(junit, datetime(2026, 1, 2, 3, 4, tzinfo=UTC))
    assert table.rows == [("2026-01-02 03:04", 3, 2, 1, 1.5)]
    assert table.notes.endswith(
        "Failed: tests/sweep/test_fit.py::test_b, tests/test_gallery.py::test_c."
    )


# Report


@pytest.mark.usefixtures("machine")
def test_a_published_table_is_read_back(tmp_path, capsys):
    publish(TABLE, tmp_path)
    result = read_result(tmp_path / "made_up.csv")
    assert result.question == TABLE.question
    assert result.notes == "Two lines of notes."
    assert result.machine == "a machine"
    assert tuple(result.columns) == TABLE.columns
    assert result.rows[0] == ["plain", "1", "0.1235"]
    assert [row[2] for row in result.rows] == ["0.1235", "-", "-", "3"]
    assert "0.1235" in capsys.readouterr().out
    assert not (tmp_path / "made_up.png").exists()


@pytest.mark.usefixtures("machine")
def test_report_agrees_with_the_tables(tmp_path):
    folder = tmp_path / "results"
    drawn = replace(TABLE, name=FIRST[1], question="Second?", x="noise", lines="plate", y="error")
    for table in (
        replace(TABLE, name="aaa"),
        drawn,
        replace(TABLE, name=FIRST[0], question="First?"),
    ):
        publish(table, folder)
    report = write_report(folder)
    said = report.read_text(encoding="utf-8")
    assert report == tmp_path / "results.md"
    assert "not edited by hand" in said
    assert said.index("## First?") < said.index("## Second?") < said.index("## How much is | it?")
    assert f"![Second?](results/{FIRST[1]}.png)" in said
    assert said.count("![") == 1
    assert "| plate | noise | error |\n| --- | ---: | ---: |\n| plain | 1 | 0.1235 |" in said
    assert said.count("a machine") == 3


def test_report_rejects_other_files(tmp_path):
    (tmp_path / "notes.csv").write_text("a,b\n1,2\n")
    with pytest.raises(ValueError, match="must start with question"):
        write_report(tmp_path)


# Drawing


def test_a_drawing_shows_every_line_of_every_panel(tmp_path, monkeypatch):
    from benchmarks import drawing

    drawn = []
    monkeypatch.setattr(drawing, "_draw_curves", lambda axes, curves: drawn.append(curves))
    table = replace(
        TABLE,
        columns=(*TABLE.columns, "depth"),
        rows=[(*row, depth) for depth in ("8 bits", "float") for row in TABLE.rows],
        x="noise", y="error", lines=("depth",), panels="plate",
    )  # fmt: skip
    drawing.draw(table, tmp_path / "a.png")
    assert [[names for names, _, _ in curves] for curves in drawn] == [
        [("8 bits",), ("float",)]
    ] * 2
    assert drawn[1][0][1:] == ([1, 2], pytest.approx([float("nan"), 3.0], nan_ok=True))
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"


# All of them


@pytest.mark.usefixtures("machine")
def test_failing_benchmark_is_named_and_others_run(tmp_path, capsys):
    def broken(quick):
        raise RuntimeError("no luck")

    jobs = {"broken": broken, "whole": lambda quick: [TABLE]}
    assert program.run_all(jobs, tmp_path, quick=True) == ["broken"]
    assert (tmp_path / "made_up.csv").exists()
    said = capsys.readouterr()
    assert "broken failed after" in said.out
    assert "whole done in" in said.out
    assert "no luck" in said.err


@pytest.mark.usefixtures("machine")
@pytest.mark.parametrize(("failing", "code"), [(False, 0), (True, 1)])
def test_failure_sets_the_exit_code(tmp_path, monkeypatch, capsys, failing, code):
    def made(quick):
        if failing:
            raise RuntimeError("no luck")
        return [TABLE]

    monkeypatch.setattr(program, "benchmarks", lambda: {"made": made})
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--quick", "--folder", str(tmp_path / "r")])
    assert program.main() == code
    assert (tmp_path / "r.md").exists()
    assert ("failed: made" in capsys.readouterr().err) == failing
