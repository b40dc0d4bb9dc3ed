"""Commands of the program, run in this process."""

from inspect import signature

import typer
from typer.testing import CliRunner

from blurmatte.cli import app


def commands(group=None, before=""):
    """Every command by its words: `solve`, or two for a group of commands."""
    for name, command in (group or typer.main.get_command(app)).commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{before}{name} ")
        else:
            yield before + name, command


# click before 8.2 mixes stdout and stderr unless it is asked not to.
_SEPARATE = {"mix_stderr": False} if "mix_stderr" in signature(CliRunner).parameters else {}


def runner():
    """Runs commands in this process, and keeps stdout and stderr apart."""
    return CliRunner(**_SEPARATE)


def run(*words):
    """How a command ended."""
    return runner().invoke(app, [str(word) for word in words])


def good(*words):
    """How a command ended that has no reason to fail."""
    result = run(*words)
    assert result.exit_code == 0, result.output
    return result


def complaint(result):
    """The one line in which a command said what is wrong."""
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.stderr
    (line,) = result.stderr.splitlines()
    assert line.startswith("blurmatte: ")
    assert not line.startswith("blurmatte: warning")
    return line.removeprefix("blurmatte: ")
