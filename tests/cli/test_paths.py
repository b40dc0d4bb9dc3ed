"""Output that cannot be written is rejected before anything is read."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.commands import complaint, run
from tests.scenes.texts import BALL

import blurmatte as bm
from blurmatte.cli.paths import check_ending

# Of files that are not there: only what is looked at first can be complained of.
SOLVE = "a.png", "--plate", "b.png"
LONG = "c" * 300 + ".json"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("solve", *SOLVE, "--out", "mine"), "mine: mine is a file; give the name of a folder"),
        (("solve", *SOLVE, "--out", "mine/x/y"), "mine/x/y: mine is a file"),
        (("solve", *SOLVE, "--out", "o.png"), "whose name does not end with .png"),
        (("solve", "a.mp4", "--out", "o.mp4"), "whose name does not end with .mp4"),
        (("sharpen", "a.exr", "--frames", "2", "--out", "no/a.mov"), "no folder no; make it"),
        (("render", "easy", "--out", "mine"), "mine is a file"),
        (("color", *SOLVE, "--out", "c.txt"), "c.txt: a color model is written as .json"),
        (("color", *SOLVE, "--out", "folder.json"), "folder.json: is a folder"),
        (("color", *SOLVE, "--out", "no/c.json"), "there is no folder no; make it"),
        (("color", *SOLVE, "--out", LONG), f"{LONG}: check the path ("),
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
    result = run(*words)
    assert said in complaint(result)
    assert result.stdout == ""
    assert (tmp_path / "mine").read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.json", "mine"]


@pytest.mark.skipif(os.name != "posix", reason="links and pipes")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("color", *SOLVE, "--noise", "n.json", "--out", "n.json"), "n.json: would be replaced"),
        (("color", *SOLVE, "--color", "n.json", "--out", "./n.json"), "and it is read"),
        (("color", *SOLVE, "--noise", "n.json", "--out", "link.json"), "and n.json is read"),
        (("measure", "a.exr", "--out", "f/../n.json", "--transfer", "n.json"), "n.json is read"),
        (("track", "a.mp4", "--out", "n.json", "--color", "n.json"), "n.json: would be replaced"),
        (("plate", "f", "--out", "f/p.png"), "f/p_overview.png: would be replaced, and it is read"),
        (("plate", "f/p*.png", "--out", "f/p.png"), "f/p_overview.png: would be replaced"),
        (("edit", "f/l.####.png", "--fade", "1", "--out", "f/l.%04d.png"), "f/l.0001.png: would"),
        (("edit", "f", "--fade", "1", "--out", "f/l.####.png"), "f/l.0001.png: would be replaced"),
        (("edit", "a.exr", "--fade", "2", "--out", "e.png", "--sheet", "e.png"), "written twice"),
        (("compose", "a.exr", "--over", "b.png", "--out", "b.png"), "b.png: would be replaced"),
        (("solve", "color.png", "--plate", "b.png", "--out", "."), "color.png: would be replaced"),
        (("solve", "a.png", "--plate", "./r/layer.png", "--out", "r"), "would be replaced"),
        (("render", "f/scene.toml", "--out", "f"), "f/scene.toml: would be replaced"),
        (("render", "f/scene.toml", "--out", "g"), "g/plate.png: would be replaced"),
        (("score", "f", "--truth", "t", "--out", "t/truth/path.json"), "and it is read"),
        (("solve", "a.png", "--plate", "pipe", "--out", "r"), "pipe: give a file; this is a pipe"),
        (("info", "zero.png"), "zero.png: give a file; this is a pipe or a device"),
        (("solve", *SOLVE, "--solver", "shaded:pipe", "--out", "r"), "pipe: give a file"),
    ],
)
def test_refuses_output_that_is_read(words, said, tmp_path, monkeypatch):
    """Door: also by links, in folders and rows; and inputs that are endless."""
    monkeypatch.chdir(tmp_path)
    names = "n.json", "f/p_overview.png", "f/l.0001.png", "g/plate.png", "t/truth/path.json"
    for name in (*names, "b.png", "color.png", "r/layer.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("mine")
    bm.write(tmp_path / "g/plate.png", bm.LinearImage(np.full((36, 48, 3), 0.5)))
    scene = BALL.replace('kind = "colorful"\ntile = 9', 'kind = "file"\nfile = "../g/plate.png"')
    (tmp_path / "f/scene.toml").write_text(scene)
    (tmp_path / "link.json").symlink_to("n.json")
    (tmp_path / "zero.png").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe")
    before = {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")}
    result = run(*words)
    assert said in complaint(result)
    assert result.stdout == ""
    assert {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")} == before


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[48, 36]", "[48000, 36000]", "at most 25000000 pixels, got 48000 x 36000; raise the"),
        ("tile = 9", "tile = 1e-9", "plate.tile must be 1 pixel or more"),
        ("radius = 5", "radius = 1e300", "body.radius must be a number from -100000 to 100000"),
        ("[34, 22]", "[34, nan]", "path.end.1 must be a number from"),
        ("[plate]", "plate_frames = 20000\n[plate]", "plate_frames must be at most 10000"),
        ("[path]", "[clip]\ncount = 20000\nduty = 0.5\n[path]", "clip.count must be at most"),
        ("code_std = 0.004", "blur = 1e5", "camera.blur must be at most 200"),
    ],
)
def test_refuses_absurd_scenes_before_rendering(old, new, said, tmp_path):
    """Door."""
    (tmp_path / "s.toml").write_text(BALL.replace(old, new))
    words = "render", str(tmp_path / "s.toml"), "--out", str(tmp_path / "o")
    result = run(*words)
    assert said in complaint(result)
    assert result.stdout == ""
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("again", [False, True])
def test_a_named_scene_may_be_rendered_into_a_folder_of_its_name(again, tmp_path, monkeypatch):
    """Door: what does not exist cannot be replaced; a second run writes the same folder."""
    monkeypatch.chdir(tmp_path)
    image = tmp_path / "stick" / "image.png"
    if again:
        image.parent.mkdir()
        image.touch()
    result = run("render", "stick", "--out", "stick")
    assert (result.exit_code, result.stderr) == (0, "")
    assert image.stat().st_size > 0


def test_missing_video_library_is_reported_before_the_work(monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(bm.errors.FileError, match=r"blurmatte\[video\]"):
        check_ending(Path("ball.mov"), "a clip", ".mov", ".gif")
    check_ending(Path("ball.gif"), "a clip", ".mov", ".gif")
