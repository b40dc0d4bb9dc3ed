"""Run every benchmark and write docs/results.md: python -m benchmarks [--quick].

A benchmark is a module in accuracy/ or speed/ with `tables(quick)`. One that fails does not stop the
others; it is named at the end.
"""

import argparse
import sys
import time
import traceback
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from benchmarks.report import write_report
from benchmarks.table import Table, add_options, publish, result_folder

HERE = Path(__file__).parent

Tables = Callable[..., list[Table]]


def benchmarks() -> dict[str, Tables]:
    """What makes the tables, by the name of its module in this folder."""
    paths = (path for part in ("accuracy", "speed") for path in sorted((HERE / part).glob("*.py")))
    modules = {f"{path.parent.name}.{path.stem}": path for path in paths}
    return {
        name: import_module(f"benchmarks.{name}").tables
        for name, path in modules.items()
        if "\ndef tables(" in path.read_text(encoding="utf-8")
    }


def run_all(
    jobs: dict[str, Tables], folder: Path, quick: bool, allow_dirty: bool = False
) -> list[str]:
    """Run and publish one after another; the names of those that failed."""
    failed = []
    for name, tables in jobs.items():
        print(f"{name} …", flush=True)
        start = time.perf_counter()
        try:
            for table in tables(quick=quick):
                publish(table, folder, allow_dirty)
        except Exception:
            traceback.print_exc()
            failed.append(name)
        said = "failed after" if name in failed else "done in"
        print(f"{name} {said} {time.perf_counter() - start:.0f} s", flush=True)
    return failed


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    add_options(parser)
    arguments = parser.parse_args()
    folder = result_folder(arguments.folder, arguments.quick, arguments.allow_dirty)
    failed = run_all(benchmarks(), folder, arguments.quick, arguments.allow_dirty)
    print(f"report: {write_report(folder)}")
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
