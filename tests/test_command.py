"""The installed command and the module."""

import json
import os
import subprocess
import sys
from importlib.metadata import entry_points
from io import BytesIO, TextIOWrapper

import pytest

import blurmatte
import blurmatte.__main__
from blurmatte.__main__ import run

RAISES = """
import sys
from blurmatte.__main__ import run

class Imports:
    def find_spec(self, name, *_):
        if name == {!r}:
            raise {}

sys.meta_path.insert(0, Imports())
sys.argv[1:] = ["solve", "--help"]
run()
"""


def test_installed_command_is_run():
    (command,) = entry_points(group="console_scripts", name="blurmatte")
    assert command.load() is run


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        ("KeyboardInterrupt", 130, ""),
        ("OSError(28, 'No space left')", 2, "blurmatte: cannot write the answer: No space left\n"),
    ],
)
@pytest.mark.parametrize("library", ["typer", "blurmatte.cli.solving"])
def test_run_ends_without_traceback(library, error, code, said):
    """Door: also during imports."""
    command = [sys.executable, "-c", RAISES.format(library, error)]
    ended = subprocess.run(command, capture_output=True, text=True)
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, "", said)


def test_module_runs():
    command = [sys.executable, "-m", "blurmatte", "--version"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert said == f"blurmatte {blurmatte.__version__}\n"


@pytest.mark.parametrize("encoding", ["latin-1", "cp437", "cp850"])
@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"], ["solve", "--help"], ["measure", "--help"], ["calibrate", "noise", "--help"],
        ["render", "--list"], ["info", "model.json"], ["info", "model.json", "--json"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_every_encoding_of_a_terminal_gets_the_answer(tmp_path, monkeypatch, encoding, arguments):
    """Door: letters that the encoding lacks are spelled in ASCII."""
    model = blurmatte.ColorModel.from_samples([[0.5, 0.4, 0.1], [0.52, 0.4, 0.1], [0.5, 0.41, 0.1]])
    blurmatte.write(tmp_path / "model.json", model)
    monkeypatch.chdir(tmp_path)
    out, err = (TextIOWrapper(BytesIO(), encoding) for _ in range(2))
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    monkeypatch.setattr(blurmatte.__main__, "catch_interrupts", lambda: None)
    monkeypatch.setattr(sys, "argv", ["blurmatte", *arguments])
    with pytest.raises(SystemExit) as ended:
        run()
    assert ended.value.code == 0
    out.flush()
    said = out.buffer.getvalue().decode(encoding)
    assert len(said) > 100
    assert "?" not in said
    if "--json" in arguments:
        assert "±" not in json.dumps(json.loads(said))


def test_file_with_letters_that_the_encoding_lacks_is_named(tmp_path):
    """Door: of stdout and stderr of a real process."""
    environment = os.environ | {"PYTHONIOENCODING": "cp437"}
    command = [sys.executable, "-m", "blurmatte", "info", "日本….png"]
    done = subprocess.run(command, capture_output=True, cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 2
    assert done.stderr.decode("cp437").startswith("blurmatte: ??....png: check the name")
    assert b"Traceback" not in done.stderr
