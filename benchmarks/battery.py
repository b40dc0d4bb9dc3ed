"""Do the slow tests pass?

Runs the tests marked `battery` and records how many passed, when, and of which commit.

Run: scripts/battery [--allow-dirty]
"""

import argparse
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree

from benchmarks.report import write_report
from benchmarks.table import QUICK_RESULTS, ROOT, Table, publish, result_folder

JUNIT = QUICK_RESULTS / "battery.xml"
COMPILE = ("-m", "blurmatte", "info", "--compile")
PYTEST = ("-m", "pytest", "-m", "battery", "-n", "auto", "--dist", "worksteal")
RAN = (0, 1)  # exit codes of pytest: all passed, some failed; others mean that it did not run


def main() -> int:
    parser = argparse.ArgumentParser(prog="scripts/battery", description=__doc__)
    parser.add_argument(
        "--allow-dirty", action="store_true", help="record with changes that are not committed"
    )
    allow_dirty = parser.parse_args().allow_dirty
    folder = result_folder(None, quick=False, allow_dirty=allow_dirty)
    # Damaged files have a limit of time, within which kernels cannot be compiled.
    subprocess.run([sys.executable, *COMPILE], cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
    done = subprocess.run([sys.executable, *PYTEST, f"--junitxml={JUNIT}"], cwd=ROOT)
    if done.returncode in RAN:
        publish(battery_table(JUNIT, datetime.now(UTC)), folder, allow_dirty)
        write_report(folder)
    return done.returncode


def battery_table(junit: Path, ended: datetime) -> Table:
    """One row: the run that a file in JUnit's form describes.

    Parameters
    ----------
    junit : Path
        As `pytest --junitxml` writes it.
    ended : datetime
    """
    suite = next(ElementTree.parse(junit).getroot().iter("testsuite"))
    total, skipped = int(suite.attrib["tests"]), int(suite.attrib["skipped"])
    failed = [
        f"{case.attrib['classname'].replace('.', '/')}.py::{case.attrib['name']}"
        for case in suite.iter("testcase")
        if case.find("failure") is not None or case.find("error") is not None
    ]
    return Table(
        name="battery",
        question="Do the slow tests pass?",
        notes="The last run of scripts/battery: statistics over many scenes, tables, gallery, and "
        "wrong shapes that must be rejected. Wall-clock time, UTC. Failed: "
        f"{', '.join(failed) or 'none'}.",
        columns=("ended", "passed", "failed", "skipped", "minutes"),
        rows=[
            (
                f"{ended:%Y-%m-%d %H:%M}",
                total - skipped - len(failed),
                len(failed),
                skipped,
                float(suite.attrib["time"]) / 60,
            )
        ],
    )


if __name__ == "__main__":
    sys.exit(main())
