"""Damaged files of every format, each given to a command that reads it.

Counts commands that end in a traceback, a crash or a hang, need more memory than the limit, change an
input, write NaN, or let a library write to stderr. The first files of each fault are kept.

Run: python -m tests.fuzz --count 10000 --seed 0 [--workers 2] [--keep FOLDER] [--only PATTERN]
"""

import argparse
import sys
import time
from pathlib import Path

from tests.fuzz.fuzzing import fuzz


def main() -> int:
    """Print the summary; 1 if there is any fault."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--count", type=int, default=10000, help="damaged files; 10,000")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the files of faults")
    parser.add_argument("--only", default="*", help="seeds whose names match, such as '*.json'")
    asked = parser.parse_args()
    started = time.monotonic()
    faults = fuzz(asked.count, asked.seed, asked.workers, asked.keep, asked.only)
    for fault, count in faults.most_common():
        print(f"\n{count} times: {fault}")
    minutes = (time.monotonic() - started) / 60
    print(f"\n{asked.count} damaged files: {faults.total()} faults, {minutes:.1f} min")
    return min(len(faults), 1)


if __name__ == "__main__":
    sys.exit(main())
