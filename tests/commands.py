"""Commands of the program, run in this process."""

from typer.testing import CliRunner

from blurmatte.cli import app


def run(*words):
    """How a command ended."""
    return CliRunner().invoke(app, [str(word) for word in words])


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
