"""Progress on a terminal."""

import io
import logging

import pytest

from blurmatte.cli.console import STAGES, Verbosity, listening, printing, waiting, with_progress
from blurmatte.motion.clip.workers import logged


class Screen(io.StringIO):
    """What somebody looks at."""

    def isatty(self):
        return True


@pytest.mark.parametrize("count", [1, 3])
def test_progress_shows_time_and_of_several_things_percent(monkeypatch, capsys, count):
    screen = Screen()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    for thing in with_progress(range(count), "solving"):
        print("answer", thing)
    shown = screen.getvalue()
    assert "solving" in shown
    assert "0:00:0" in shown
    assert ("100%" in shown) == (count > 1)
    assert "answer" not in shown
    assert capsys.readouterr().out.split() == [w for i in range(count) for w in ("answer", str(i))]


def test_waiting_shows_task_and_time(monkeypatch):
    screen = Screen()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with pytest.raises(ValueError, match="no color"), waiting("finding its color"):
        raise ValueError("no color")
    assert "finding its color" in screen.getvalue()
    assert "0:00:0" in screen.getvalue()


def test_stage_of_solve_is_shown_with_its_number(monkeypatch):
    screen = Screen()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with printing(Verbosity()), waiting("solving"):
        logging.getLogger("blurmatte").info(STAGES[3])
    assert f"4/{len(STAGES)} fitting the sweep" in screen.getvalue()


def test_no_progress_without_terminal(capsys):
    with waiting("finding its color"):
        pass
    assert list(with_progress([1, 2], "solving")) == [1, 2]
    assert capsys.readouterr().err == ""
    assert list(with_progress(iter("ab"), "solving", count=2)) == ["a", "b"]


def test_frames_that_the_log_counts_are_progress_for_a_listener():
    got = []
    with printing(Verbosity()), listening(got.append), waiting("reading the clip"):
        for _ in logged("abc", "measuring", 3):
            pass
    assert [(now.done, now.of) for now in got] == [(0, None), (0, None), (1, 3), (2, 3), (3, 3)]
    assert got[1].stage == "measuring"
    assert got[-1].seconds_left == 0
