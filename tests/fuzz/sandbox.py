"""Commands on damaged files, in a child process that may crash, hang or run out of memory."""

import hashlib
import json
import os
import re
import select
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from tests.fuzz.commands import JOURNAL

ROOT = Path(__file__).parents[2]
ALLOWED = (0, 2)  # exit codes: done, refused
PATIENCE = 180  # seconds of the clock, for commands that wait and those beyond the alarm
# Lines of libraries; those of the program begin with its name, or continue such a line.
_FOREIGN = re.compile(
    r"libpng|libjpeg|TIFF(Read|Fetch|Open)|Traceback|\w*Warning: |\s+warnings\.warn|^\[\w+ @ 0x"
    r"|Error in |^Exception "
)
_NUMPY = re.compile(r"RuntimeWarning|encountered in|divide by zero")
_NOT_A_NUMBER = re.compile(r"(?<![\w.])[-+]?(nan|inf|infinity)(?![\w.])", re.IGNORECASE)


@dataclass(frozen=True)
class Case:
    """A damaged file and the command that reads it."""

    seed: str  # name of the seed
    command: str
    content: bytes = field(repr=False)
    name: str = ""  # of the file; that of the seed if empty


class Sandbox:
    """A folder with the seeds, and a process that runs commands on damaged ones.

    Parameters
    ----------
    seeds : Path
        The folder of `make_seeds`.
    folder : Path
        Exists; what commands write goes there.
    """

    def __init__(self, seeds: Path, folder: Path) -> None:
        self.seeds, self.folder = seeds, folder
        self._names = {path.name for path in seeds.iterdir()}
        self._before = _fingerprint(seeds)
        self._child: subprocess.Popen | None = None

    def __enter__(self) -> "Sandbox":
        return self

    def __exit__(self, *error: object) -> None:
        if self._child is not None:
            self._child.kill()
            self._child.wait()
            self._child.stdin.close()
            self._child.stdout.close()
            self._child = None

    def fault(self, case: Case) -> str:
        """What is wrong with how the command took the file; empty if nothing is."""
        file, out = self.folder / "in" / (case.name or case.seed), self.folder / "out"
        for place in (file.parent, out):
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
        if case.seed == "journal.csv":
            file = out / JOURNAL
        file.write_bytes(case.content)
        answer = self._run(self._arguments(case.command, file, out))
        faults = (
            answer["failure"],
            _fault_of_code(answer),
            _fault_of_text(answer),
            "" if _fingerprint(self.seeds) == self._before else "an input was changed",
            self._changed(case, file),
            fault_of_results(out) if answer["code"] == 0 else "",
        )
        return next(filter(None, faults), "")

    def _changed(self, case: Case, file: Path) -> str:
        if case.seed == "journal.csv" or file.read_bytes() == case.content:
            return ""
        return "the damaged file was changed"

    def _arguments(self, command: str, file: Path, out: Path) -> list[str]:
        places = {"FILE": str(file), "OUT": str(out)}
        words = (re.sub("FILE|OUT", lambda m: places[m[0]], word) for word in command.split())
        return [str(self.seeds / word) if word in self._names else word for word in words]

    def _run(self, args: list[str]) -> dict:
        child = self._started()
        task = json.dumps({"args": args, "folder": str(self.folder)})
        try:
            child.stdin.write(f"{task}\n".encode())
            child.stdin.flush()
            ready = select.select([child.stdout], [], [], PATIENCE)[0]
            while not ready and _is_running(child.pid):  # the machine is busy with other work
                ready = select.select([child.stdout], [], [], PATIENCE)[0]
            line = child.stdout.readline() if ready else b""
        except BrokenPipeError:
            line, ready = b"", True
        if line:
            return json.loads(line)
        self.__exit__()
        failure = (
            f"crash: exit code {child.returncode}"
            if ready
            else "hang: it waits, or does not end at the alarm"
        )
        return {"code": None, "stdout": "", "stderr": "", "failure": failure}

    def _started(self) -> subprocess.Popen:
        if self._child is None:
            paths = [str(ROOT), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")]
            self._child = subprocess.Popen(
                [sys.executable, "-m", "tests.fuzz.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={
                    **os.environ,
                    "PYTHONPATH": os.pathsep.join(filter(None, paths)),
                    **dict.fromkeys(("OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
                },
            )
            plate, color = self.seeds / "plate.png", ("--color", "#ffc032")
            out = self.folder / "warm"
            solve = "solve", str(self.seeds / "image.png"), "--plate", str(plate), *color
            self._run([*solve, "--solver", "pixelwise", "--transfer", "srgb", "--out", str(out)])
        return self._child


def _is_running(pid: int) -> bool:
    """True if a thread of the process wants the processor, whose time the alarm counts."""
    tasks = Path(f"/proc/{pid}/task").glob("*/stat")
    return any(stat.read_text().rpartition(")")[2].split()[0] == "R" for stat in tasks)


def _fingerprint(folder: Path) -> list[tuple[str, str]]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return [(str(path), hashlib.sha1(path.read_bytes()).hexdigest()) for path in files]


def _fault_of_code(answer: dict) -> str:
    if answer["code"] in ALLOWED:
        return ""
    return f"exit code {answer['code']}: {answer['stderr'][-600:]}"


def _fault_of_text(answer: dict) -> str:
    lines = answer["stderr"].strip().splitlines()
    own = "blurmatte: "  # a message of a library may be quoted in one of the program
    for line in lines:
        if _NUMPY.search(line) or (_FOREIGN.search(line) and not line.startswith(own)):
            return f"on stderr: {line[:300]}"
    if answer["code"] == 2 and not 1 <= len([ln for ln in lines if "warning:" not in ln]) <= 3:
        return f"a refusal of {len(lines)} lines: {answer['stderr'][:300]}"
    return ""


def fault_of_results(out: Path) -> str:
    """NaN in what was written, and files that were left behind."""
    for path in sorted(path for path in out.rglob("*") if path.is_file()):
        if path.name.startswith(".blurmatte") or path.name == JOURNAL:
            return f"{path.name} was left"
        if path.suffix in (".json", ".csv"):
            text = re.sub(r'"[^"\\]*(?:\\.[^"\\]*)*"', "", path.read_text(encoding="utf-8"))
            if found := _NOT_A_NUMBER.search(text):
                return f"{path.name} holds {found[0]}"
        if path.suffix == ".exr":
            file = oiio.ImageInput.open(str(path))
            if file is None:
                return f"{path.name} cannot be read: {oiio.geterror()}"
            if np.isnan(file.read_image("float")).any():
                return f"{path.name} holds NaN"
            file.close()
    return ""
