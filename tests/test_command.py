"""The installed command and the module."""

import subprocess
import sys
from importlib.metadata import entry_points

import pytest

import blurmatte
from blurmatte.__main__ import run

RAISES = """
import sys
from blurmatte.__main__ import run

class Imports:
    def find_spec(self, name, *_):
        if name == "numpy":
            raise {}

sys.meta_path.insert(0, Imports())
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
def test_run_ends_without_traceback(error, code, said):
    """Door: also during imports."""
    command = [sys.executable, "-c", RAISES.format(error)]
    ended = subprocess.run(command, capture_output=True, text=True)
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, "", said)


def test_module_runs():
    command = [sys.executable, "-m", "blurmatte", "--version"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert said == f"blurmatte {blurmatte.__version__}\n"
