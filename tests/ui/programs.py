"""Programs that a session's worker runs in tests, in place of the command line."""

import os
import subprocess
import sys
import time
import warnings
from contextlib import suppress
from pathlib import Path


def program(words, report):
    """Do what the second word says; everything else, as the warm-up, is done at once."""
    match words:
        case ["solve", "write", path, *_]:
            Path(path).write_bytes(b"layer")
            report("writing", 1, 2, 3.0)
            print('{"grade": "confirmed"}')
        case ["solve", "refuse", path, *_]:
            print(f"blurmatte: {path}: is no picture", file=sys.stderr)
            return 2
        case ["solve", "warn", *_]:
            warnings.warn("the same in every job", UserWarning, stacklevel=1)
        case ["solve", "sleep", *_]:
            child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
            report(f"{os.getpid()} {child.pid}", 0, None, None)
            time.sleep(60)
        case ["solve", "die", *_]:
            os._exit(9)
        case ["solve", "name", path, *_]:
            print(path, sys.argv[-1])
    return 0


def dying(words, report):
    """Die while it warms up."""
    os._exit(9)


def is_alive(pid):
    """Whether a process lives; a zombie does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def helpers(server):
    """The processes that a server started and that live."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it ended
            words = path.read_text().rpartition(")")[2].split()
            if int(words[1]) == server.pid and words[0] != "Z":
                found.add(int(path.parent.name))
    return found


def wait_for(condition, seconds=10.0):
    """Wait until a condition holds; AssertionError if it does not."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.02)
