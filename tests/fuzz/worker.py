"""Runs commands in this process, one for each line of stdin; see `tests.fuzz.sandbox`.

A line is JSON: the arguments and the folder to work in. The answer is a line of JSON: the exit code,
stderr, and the last lines of a traceback if the command did not end by itself.
"""

import json
import os
import resource
import signal
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

MEMORY = 2 << 30  # bytes above those of the program itself
SECONDS = 10  # of the processor: the machine may have other work


class TookTooLong(BaseException):
    """The alarm, which no handler of errors catches."""


_rang: list[str] = []


def main() -> None:
    """Answer until stdin ends."""
    answers = os.fdopen(os.dup(1), "w")
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")
    import blurmatte.cli  # noqa: F401

    signal.signal(signal.SIGPROF, _ring)
    limited = False
    for line in sys.stdin:
        task = json.loads(line)
        os.chdir(task["folder"])
        answer = _answer(task["args"])
        print(json.dumps(answer), file=answers, flush=True)
        if not limited:  # the first command compiles and imports
            used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))
            limited = True


def _ring(number, frame):
    _rang.append("".join(traceback.format_stack(frame)[-3:]))
    raise TookTooLong


def _answer(args: list[str]) -> dict:
    from blurmatte.__main__ import run

    sys.argv = ["blurmatte", *args]
    warnings.resetwarnings()
    warnings.simplefilter("always")
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        sys.stdout.flush()
        os.dup2(out.fileno(), 1)
        os.dup2(errors.fileno(), 2)
        code, failure = 0, ""
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        try:
            run()
        except SystemExit as end:
            code = 1 if isinstance(end.code, str) else int(end.code or 0)
        except BaseException:
            failure = f"traceback: {_last_lines()}"
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        if _rang:  # an error in its wake is no other fault
            failure = f"hang: {_rang.pop()}"
        sys.stdout.flush()
        sys.stderr.flush()
        texts = []
        for file in (out, errors):
            file.seek(0)
            texts.append(file.read(1 << 20).decode("utf-8", "replace"))
    return {"code": code, "stdout": texts[0], "stderr": texts[1], "failure": failure}


def _last_lines() -> str:
    return "".join(traceback.format_exc().splitlines(keepends=True)[-9:])


if __name__ == "__main__":
    main()
