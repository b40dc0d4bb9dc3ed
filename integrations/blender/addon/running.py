# SPDX-License-Identifier: GPL-3.0-or-later
"""The command blurmatte as a process of another Python: its arguments, its progress, its end."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

ANSWERED = 0, 3  # exit codes of an answer; 3: its grade is lower than the one that was asked for
_GRACE_S = 5.0  # from the request to stop until the process is killed


def found_command(given: str) -> str:
    """The path of the command that the preferences name, or of the one of the system.

    Raises
    ------
    FileNotFoundError
        If there is none.
    """
    command = shutil.which(given or "blurmatte")
    if command is None:
        raise FileNotFoundError(
            f"there is no command {given or 'blurmatte'}: install blurmatte into an environment, and "
            "give the path of its command in the preferences of the add-on"
        )
    return command


class Run:
    """A run of the command with some arguments.

    Parameters
    ----------
    command : str
        Path of the executable.
    arguments : sequence of str
    """

    def __init__(self, command, arguments):
        self.begun, self._lines = time.monotonic(), []
        # The Python of Blender and its packages are others than those of the command.
        clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        self._process = subprocess.Popen(
            [command, *arguments, "--verbose"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            encoding="utf-8",
            errors="replace",
            env=clean,
            start_new_session=sys.platform != "win32",
        )
        self._listening = threading.Thread(target=self._listen, daemon=True)
        self._listening.start()

    def _listen(self):
        """Keep what the command says, so that it never waits for a reader."""
        with self._process.stderr as said:
            for line in said:
                if line.strip():
                    self._lines.append(line.strip().removeprefix("blurmatte: "))

    @property
    def code(self):
        """The exit code; None while it runs."""
        return self._process.poll()

    @property
    def stage(self):
        """What is done now, and for how long."""
        doing = self._lines[-1].partition(" s: ")[2] if self._lines else ""
        return f"{doing or 'starting'} ({time.monotonic() - self.begun:.0f} s)"

    @property
    def complaint(self):
        """The last line of a command that failed: its error."""
        self._listening.join(_GRACE_S)
        return self._lines[-1] if self._lines else f"blurmatte ended with code {self.code}"

    def wait(self):
        """The exit code, when it has ended."""
        return self._process.wait()

    def cancel(self):
        """Stop it and all processes that it started."""
        if self.code is None:
            self._signal(signal.SIGTERM)
            try:
                self._process.wait(_GRACE_S)
            except subprocess.TimeoutExpired:
                self._signal(getattr(signal, "SIGKILL", signal.SIGTERM))
                self._process.wait()
        self._listening.join(_GRACE_S)

    def _signal(self, number):
        if sys.platform == "win32":
            self._process.terminate()
        else:
            os.killpg(self._process.pid, number)


def solve_arguments(source, plate, folder):
    """Arguments that solve a picture over its plate, or a clip without one."""
    given = ["--plate", str(plate)] if plate else []
    return ["solve", str(source), *given, "--out", str(folder)]


def measure_arguments(folder):
    """Arguments that measure the motion of a solved picture."""
    return ["measure", str(Path(folder) / "layer.exr"), "--out", str(Path(folder) / "motion.json")]
