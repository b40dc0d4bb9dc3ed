"""Help, exit codes, and the options that every command has."""

import json
import logging
import subprocess
import sys

import numpy as np
import pytest
import tifffile
from tests.commands import commands, runner
from tests.scenes import BALL, ball_in, rendered

import blurmatte as bm
from blurmatte.cli import app
from blurmatte.cli.console import STAGES, ExitCode, in_options
from blurmatte.cli.selection import Reading
from blurmatte.files.png import png_chunks, save_chunks
from blurmatte.radiometry.transfer import log_curve

SCREEN, COLUMNS = 45, 80
FAST = ("--solver", "pixelwise", "--transfer", "srgb")


COMMANDS = {tuple(words.split()): command for words, command in commands()}


def run(*arguments, width=100):
    return runner().invoke(
        app, [str(one) for one in arguments], terminal_width=width, env={"COLUMNS": str(width)}
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Image and plate of a ball, and its layer with its solution."""
    folder = tmp_path_factory.mktemp("app")
    solution = bm.solve(*ball_in(folder), rendered(BALL).model, bm.Pixelwise())
    bm.write(folder / "layer.exr", solution)
    return folder


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_help_fits_one_screen_and_begins_with_an_example(words):
    for option in ("--help", "-h"):
        result = run(*words, option, width=COLUMNS)
        lines = result.stdout.splitlines()
        assert result.exit_code == 0
        assert len(lines) <= SCREEN
        assert max(map(len, lines)) <= COLUMNS
        assert lines[0].startswith(f"$ blurmatte {' '.join(words)} ")


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_option_has_help_and_common_options_their_names(words):
    options = {name: p for p in COMMANDS[words].params for name in p.opts}
    assert {"-q", "--quiet", "-v", "--verbose"} <= set(options)
    assert ("--out" in options) == ("-o" in options)
    for parameter in COMMANDS[words].params:
        assert parameter.help, parameter.name


def test_commands_used_most_come_first():
    listed = run("--help").stdout.split("Commands:\n")[1].split()
    assert run("-h").exit_code == 0
    places = [listed.index(name) for name in ("solve", "measure", "track", "edit", "color")]
    assert places == sorted(places)


def test_every_command_is_listed():
    listed = run("--help").stdout
    for words in COMMANDS:
        assert f"  {words[0]} " in listed


def test_completion_can_be_installed():
    assert "--install-completion" in run("--help").stdout


def test_exit_codes_are_those_of_the_version_before():
    assert [int(code) for code in ExitCode] == [0, 1, 2, 3, 130]


def test_defect_is_one_line_and_has_a_traceback_only_with_v(folder, monkeypatch):
    def broken(*args, **kwargs):
        raise KeyError("width")

    monkeypatch.setattr(bm, "measure_motion", broken)
    result = run("measure", folder / "layer.exr")
    assert result.exit_code == ExitCode.UNEXPECTED
    (line,) = result.stderr.splitlines()
    assert line.startswith("blurmatte: a defect of blurmatte, KeyError: 'width'; please report it")
    assert "Traceback" in run("measure", folder / "layer.exr", "-v").stderr


def test_refusal_has_a_traceback_only_with_v():
    assert len(run("info", "nowhere.png").stderr.splitlines()) == 1
    assert "Traceback" in run("info", "nowhere.png", "-v").stderr


def test_quiet_and_verbose_exclude_each_other(folder):
    result = run("info", folder / "image.png", "-q", "-v")
    assert result.exit_code == ExitCode.REFUSED
    assert result.stderr == "blurmatte: give --quiet or --verbose, not both\n"


def test_verbose_prints_the_stages_and_quiet_no_warnings(folder, tmp_path):
    asked = "solve", folder / "image.png", "--plate", folder / "plate.png", "--out", tmp_path
    color = "--color", "#3040ff", "--solver", "pixelwise", "--transfer", "srgb"
    said = run(*asked, *color, "-v").stderr
    done = [line.partition(" s: ")[2] for line in said.splitlines() if " s: " in line]
    assert done == [stage for stage in STAGES if stage in done]  # each is known, and in this order
    assert {STAGES[0], "matching the plate", "finding the streak", STAGES[-1]} <= set(done)
    assert "warning" in said
    quiet = run(*asked, *color, "-q")
    assert (quiet.exit_code, quiet.stderr) == (0, "")
    assert quiet.stdout
    assert logging.getLogger("blurmatte").handlers == []


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (("info", "image.png"), {"file", "size", "transfer", "valid_share", "light"}),
        (("info", "layer.exr"), {"solver", "stats", "model", "in_words"}),
        (("measure", "layer.exr"), {"length", "length_std", "trajectory", "in_words"}),
        (("color", "image.png", "--plate", "plate.png", "--color", "#ffbc43"), {"hex", "rank"}),
        (("paints", "layer.exr", "--color", "#dca059", "--color", "#2030ff", "-o", "p"), {"files"}),
        (
            ("solve", "image.png", "--plate", "plate.png", "-o", "o", "--color", "#ffbc43", *FAST),
            {"folder", "grade", "model", "stats"},
        ),
        (("calibrate", "noise", "plate.png", "--region", "0,0,96,72"), {"sensor", "in_words"}),
        (("render", "--list"), {"easy"}),
    ],
)
def test_answers_as_json(folder, arguments, names, monkeypatch, tmp_path):
    """Exact: an object with these names, and nothing else on the output."""
    monkeypatch.chdir(tmp_path)
    arguments = [folder / a if (folder / a).is_file() else a for a in arguments]
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
    assert names <= json.loads(result.stdout).keys()


def test_patterns_of_pictures_are_equal_in_every_command(folder, tmp_path):
    """Exact: pattern, numbers and folder give the same pictures."""
    for k in (1, 2, 10):
        (tmp_path / f"f.{k:04d}.png").write_bytes((folder / "image.png").read_bytes())
    options = "--plate", folder / "plate.png", "--solver", "pixelwise", "--color", "#ffbc43"
    options += "--transfer", "srgb", "--workers", "1"  # else each looks for its curve
    answers = []
    for k, name in enumerate(("f.*.png", "f.####.png", "f.%04d.png", ".")):
        out = tmp_path.parent / f"{tmp_path.name}-{k}"
        result = run("solve", tmp_path / name, *options, "--out", out)
        assert result.exit_code == 0, result.stderr
        answers.append(sorted(path.name for path in out.iterdir() if path.is_dir()))
    assert answers == [["f.0001", "f.0002", "f.0010"]] * 4


@pytest.mark.parametrize(
    ("python", "shell"),
    [
        ("give its color (--color, model=)", "give its color (--color)"),
        ("pass transfer=SRGB (--transfer srgb) to", "pass --transfer srgb to"),
        ("the limit with max_pixels= (--max-pixels)", "the limit with --max-pixels"),
        ("allow any (--rank 3, ColorModel.any())", "allow any (--rank 3)"),
        ('may spin: give spin="auto" (--spin auto). Do', "may spin: give --spin auto. Do"),
        ("give exposure_times (--exposures 1/60), one", "give --exposures 1/60, one"),
        ("line_time needs exposure_time, for", "--line-time needs --exposure, for"),
    ],
)
def test_messages_name_options(python, shell):
    assert in_options(python) == shell


@pytest.mark.parametrize("place", ["before", "between", "behind"])
@pytest.mark.parametrize("name", ["-v", "--quiet"])
def test_options_of_all_commands_may_stand_anywhere(tmp_path, place, name):
    """exact: before the command, between a group and its command, behind."""
    words = ["calibrate", "noise", str(tmp_path / "none.png")]
    at = {"before": 0, "between": 1, "behind": 3}[place]
    result = runner().invoke(app, [*words[:at], name, *words[at:]])
    assert result.exit_code == 2
    assert "No such option" not in result.stderr
    assert ("Traceback" in result.stderr) == (name == "-v")


def test_other_options_before_the_command_are_refused_with_their_place():
    """door."""
    result = runner().invoke(app, ["--plate", "a.png", "solve", "b.png"])
    assert result.exit_code == 2
    assert "--plate goes behind the command" in result.stderr
    assert "COMMAND --plate" in result.stderr


def test_encoding_that_is_assumed_is_warned_of_once(tmp_path):
    """exact: fact before remedy, of the first file alone."""
    for name in ("a.png", "b.png"):
        bm.write(tmp_path / name, bm.LinearImage(np.full((9, 9, 3), 0.2)))
        chunks = png_chunks(tmp_path / name)
        save_chunks(tmp_path / name, [c for c in chunks if c[0] in (b"IHDR", b"IDAT", b"IEND")])
    result = runner().invoke(
        app,
        [
            "solve",
            str(tmp_path / "a.png"),
            "--plate",
            str(tmp_path / "b.png"),
            "--out",
            str(tmp_path / "o"),
        ],
    )
    assert result.stderr.count("--transfer srgb") == 1
    line = next(line for line in result.stderr.splitlines() if "--transfer srgb" in line)
    assert line.index("taken as sRGB") < line.index("--transfer srgb")


def test_single_picture_without_plate_is_refused_with_what_to_do(tmp_path):
    """door."""
    result = runner().invoke(app, ["solve", str(tmp_path / "a.png"), "--out", str(tmp_path / "o")])
    assert result.exit_code == 2
    for remedy in ("--plate", "photograph it", "tripod", "clip", "solve 'throws/*.jpg'"):
        assert remedy in result.stderr


@pytest.mark.parametrize(
    ("extra", "arguments"),
    [
        ("photos", ["render", "--all", "--out", "OUT"]),
        ("video", ["solve", "rally.mp4", "--out", "OUT"]),
        ("video", ["track", "rally.mp4", "--color", "#d8ff3c", "--out", "OUT.csv"]),
        ("raw", ["info", "a.dng"]),
        ("ocio", ["info", "a.png", "--transfer", "slog3"]),
    ],
)
def test_missing_extra_is_named_in_one_line(tmp_path, monkeypatch, extra, arguments):
    """door: of the documented commands that need one; no defect, no traceback."""
    packages = {"photos": "skimage", "video": "av", "raw": "rawpy", "ocio": "PyOpenColorIO"}
    for package in packages.values():
        for name in [n for n in sys.modules if n.split(".")[0] == package]:
            monkeypatch.delitem(sys.modules, name)
        monkeypatch.setitem(sys.modules, package, None)
    log_curve.cache_clear()
    monkeypatch.chdir(tmp_path)
    for name, head in (("rally.mp4", b"\0\0\0\x18ftypmp42"), ("a.dng", b"II*\0")):
        (tmp_path / name).write_bytes(head + bytes(99))
    bm.write("a.png", bm.LinearImage(np.full((9, 9, 3), 0.2)))
    result = runner().invoke(app, arguments)
    assert result.exit_code == 2, result.stderr
    assert f"blurmatte[{extra}]" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_help_version_and_completion_import_no_numerical_library():
    code = """
import subprocess
import sys
from typer.testing import CliRunner
from blurmatte.cli import app
def run(*words, **variables):
    result = CliRunner().invoke(app, words, prog_name="blurmatte", env=variables)
    assert result.exit_code == 0, result.output
    return result.stdout
assert "blurmatte" in run("--version")
assert not [name for name in sys.modules if name.startswith("blurmatte.cli.solving")]
assert "--plate" in run("solve", "--help")
assert "noise" in run("calibrate", "--help")
assert "sharpen" in run("--help")
words = {"COMP_WORDS": "blurmatte solve --pla", "COMP_CWORD": "2"}
assert "--plate" in run(_BLURMATTE_COMPLETE="complete_bash", **words)
packages = {name.partition(".")[0] for name in sys.modules}
assert not packages & {"numpy", "scipy", "numba", "PIL", "OpenImageIO", "rich"}, packages
ours = {name.split(".")[1] for name in sys.modules if name.startswith("blurmatte.")}
assert ours == {"cli", "errors", "formats", "interrupts"}, ours
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize(("white", "said"), [(1.0, 0), (255.0, 1)])
def test_floats_of_which_most_are_above_white_are_warned_of(tmp_path, white, said):
    light = white * np.random.default_rng(0).uniform(0, 1, (20, 30, 3)).astype(np.float32)
    path, notes = tmp_path / "a.tif", []
    tifffile.imwrite(path, light, photometric="rgb")
    Reading().read(path, notes)
    assert len(notes) == said
    assert all("above that of white, 1" in note and str(path) in note for note in notes)
