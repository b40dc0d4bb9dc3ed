"""Output that cannot be written is rejected before anything is read."""

import pytest
from typer.testing import CliRunner

from blurmatte.cli import app

# Of files that are not there: only what is looked at first can be complained of.
SOLVE = "a.png", "--plate", "b.png"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("solve", *SOLVE, "--out", "mine"), "mine: mine is a file; give the name of a folder"),
        (("solve", *SOLVE, "--out", "mine/x/y"), "mine/x/y: mine is a file"),
        (("solve", "color.png", "--plate", "b.png", "--out", "."), "color.png: would be replaced"),
        (("solve", "a.png", "--plate", "./r/layer.png", "--out", "r"), "would be replaced"),
        (("render", "easy", "--out", "mine"), "mine is a file"),
        (("color", *SOLVE, "--out", "c.txt"), "c.txt: a color model is written as .json"),
        (("color", *SOLVE, "--out", "folder.json"), "folder.json: is a folder"),
        (("color", *SOLVE, "--out", "no/c.json"), "there is no folder no; make it"),
        (("show", "a.png", "--out", "s.gif"), "a sheet is written as .png or .jpg"),
        (("score", "r", "--truth", "t", "--out", "s.txt"), "scores is written as .json or .csv"),
        (("measure", "a.exr", "--out", "m.txt"), "a motion is written as .json or .csv"),
        (("measure", "a.exr", "--image", "i.png", "--overlay", "m.gif"), "a sheet is written as"),
        (("track", "a.mp4", "--overlay", "m.gif"), "a sheet is written as"),
        (("track", "a.mp4", "--out", "no/t.csv"), "there is no folder no; make it"),
        (("plate", "a.mp4", "--out", "p.gif"), "a plate is written as .exr or"),
        (("plate", "a.mp4", "--out", "mine/p.exr"), "mine is a file"),
        (("edit", "a.exr", "--fade", "2", "--out", "e.png", "--sheet", "e.gif"), "a sheet is"),
        (("edit", "a.exr", "--fade", "2", "--out", "e.png", "--preview", "e.png"), "a preview is"),
        (("edit", "a.####.exr", "--fade", "2", "--out", "e.mov", "--rate", "0"), "--rate must be"),
        (("solve", "a.png", "--plate", "b.png", "--out", ""), "an argument is empty"),
        (("calibrate", "noise", ""), "an argument is empty"),
        (("calibrate", "noise", "a.png", "--plot", "n.gif"), "a plot is written as"),
        (("calibrate", "response", "a.png", "--out", "r.png"), "a curve is written as .json"),
    ],
)
def test_refuses_output_before_reading(words, said, tmp_path, monkeypatch):
    """Door."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "folder.json").mkdir()
    result = CliRunner().invoke(app, words)
    (line,) = result.stderr.splitlines()
    assert (result.exit_code, result.stdout) == (2, "")
    assert said in line
    assert (tmp_path / "mine").read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.json", "mine"]
