"""A table of measurements: printed, kept as CSV with commit and machine, and drawn.

Every benchmark answers one question with one table. `python -m benchmarks` makes all of them and
`docs/results.md`. Published tables come from a clean commit, which they name.
"""

import argparse
import csv
import os
import platform
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "docs" / "results"
QUICK_RESULTS = ROOT / "out" / "benchmarks"  # numbers of a quick run mean nothing

Cell = str | int | float | None


@dataclass(frozen=True)
class Table:
    """Rows of measurements that answer one question.

    Parameters
    ----------
    name : str
        Of its files.
    question : str
        What it answers, in a sentence.
    notes : str
        What was done, what the columns mean and in which units.
    columns : tuple of str
    rows : list of tuple
        A cell is text, a number, or None where there is no answer.
    x : str
        Column along which the others are drawn; empty: not drawn. Rows without a number there are
        left out of the drawing.
    lines : str or tuple of str
        Column, or several, whose values distinguish the lines of a drawing; empty: every other column
        of numbers is a line.
    y : str
        With `lines`, the column that is drawn.
    log : bool
        Draw y on a logarithmic axis.
    panels : str
        Column for each of whose values there is a panel of its own; empty: one panel.
    log_x : bool
        Draw x on a logarithmic axis.
    x_unit : str
        Of x, on its axis; empty for ratios.

    Raises
    ------
    ValueError
        If a row has not one cell for each column, or a column that is to be drawn does not exist.
    """

    name: str
    question: str
    notes: str
    columns: tuple[str, ...]
    rows: list[tuple[Cell, ...]]
    x: str = ""
    lines: str | tuple[str, ...] = ""
    y: str = ""
    log: bool = False
    panels: str = ""
    log_x: bool = False
    x_unit: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"a row must have {len(self.columns)} cells, got {row}")
        for name in (self.x, *self.line_columns, self.y, self.panels):
            if name and name not in self.columns:
                raise ValueError(f"columns are {', '.join(self.columns)}; there is no {name!r}")
        if self.lines and not self.y:
            raise ValueError("lines needs y, the column to draw")

    @property
    def line_columns(self) -> tuple[str, ...]:
        """The columns that distinguish lines; none if every column of numbers is a line."""
        return tuple(filter(None, (self.lines,))) if isinstance(self.lines, str) else self.lines

    def column(self, name: str) -> list[Cell]:
        """All cells of a column."""
        return [row[self.columns.index(name)] for row in self.rows]


class DirtyTreeError(RuntimeError):
    """The published results would name a commit that did not make them."""


def publish(table: Table, folder: Path = RESULTS, allow_dirty: bool = False) -> None:
    """Print the table and write `name`.csv, and `name`.png if it is to be drawn.

    Raises
    ------
    DirtyTreeError
        As `require_clean_tree` does, after the table is printed.
    """
    print(f"\n{table.question}\n{text(table)}\n", flush=True)
    require_clean_tree(folder, allow_dirty)
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / f"{table.name}.csv", "w", newline="", encoding="utf-8") as file:
        for line in (table.question, table.notes, machine()):
            file.write(f"# {' '.join(line.split())}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table.columns)
        writer.writerows([cell(value) for value in row] for row in table.rows)
    if table.x:
        from benchmarks.drawing import draw  # nothing else needs matplotlib

        draw(table, folder / f"{table.name}.png")


def publish_all(tables: Callable[..., list[Table]]) -> None:
    """The main program of a benchmark: make its tables and publish them."""
    parser = argparse.ArgumentParser()
    add_options(parser)
    arguments = parser.parse_args()
    folder = result_folder(arguments.folder, arguments.quick, arguments.allow_dirty)
    for table in tables(quick=arguments.quick):
        publish(table, folder, arguments.allow_dirty)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add `--quick`, `--folder` and `--allow-dirty`."""
    parser.add_argument(
        "--quick", action="store_true", help="one seed, fewest points: a smoke test"
    )
    parser.add_argument(
        "--folder", type=Path, help=f"where to write; else {RESULTS}, or {QUICK_RESULTS} if quick"
    )
    parser.add_argument(
        "--allow-dirty", action="store_true", help="publish with changes that are not committed"
    )


def result_folder(folder: Path | None, quick: bool, allow_dirty: bool) -> Path:
    """Where a program writes; exits if it must not, before anything is measured."""
    folder = folder or (QUICK_RESULTS if quick else RESULTS)
    try:
        require_clean_tree(folder, allow_dirty)
    except DirtyTreeError as error:
        raise SystemExit(f"error: {error}") from None
    return folder


def require_clean_tree(folder: Path, allow_dirty: bool = False) -> None:
    """Refuse to write published results unless the commit is all that made them.

    Raises
    ------
    DirtyTreeError
        If `folder` is docs/results and files differ from the commit, or no commit is known.
    """
    if allow_dirty or folder.resolve() != RESULTS.resolve() or not (changed := changed_files()):
        return
    more = f" and {len(changed) - 3} more" if len(changed) > 3 else ""
    raise DirtyTreeError(
        f"{RESULTS} takes tables from a clean commit only; changed: {', '.join(changed[:3])}{more}\n"
        "Commit first, or give --allow-dirty, or another --folder."
    )


def text(table: Table) -> str:
    """The table in columns."""
    lines = [list(table.columns)] + [[cell(value) for value in row] for row in table.rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(table.columns))]
    padded = (zip(line, widths, strict=True) for line in lines)
    return "\n".join("  ".join(value.rjust(width) for value, width in line) for line in padded)


def cell(value: Cell) -> str:
    """Four digits that count; a dash where there is no answer."""
    if value is None or value != value:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def machine() -> str:
    """What measured it: versions, commit, processor."""
    names = ("blurmatte", "numpy", "scipy", "numba")
    parts = [f"{name} {version(name)}" for name in names] + [f"commit {_commit()}"]
    return ", ".join([*parts, f"Python {platform.python_version()}", _processor()])


@cache
def changed_files() -> tuple[str, ...]:
    """Files that differ from the commit or are new, but for published results, which runs write.

    Asked once, for a program is what it was when it began. Outside a checkout: one line that says so.
    """
    paths = (".", ":!docs/results", ":!docs/results.md")
    found = _git("status", "--porcelain", "--", *paths)
    if found is None:
        return ("this is no git checkout",)
    return tuple(line[3:] for line in found.splitlines())


@cache
def _commit() -> str:
    """The commit, and whether something is changed since; unknown outside a checkout."""
    commit = _git("describe", "--always")
    if commit is None:
        return "unknown"
    return f"{commit}-dirty" if changed_files() else commit


def _git(*arguments: str) -> str | None:
    """What git prints, without the last line's end; None if it fails or is not installed."""
    try:
        done = subprocess.run(["git", *arguments], capture_output=True, text=True, cwd=ROOT)
    except FileNotFoundError:
        return None
    return done.stdout.rstrip() if done.returncode == 0 else None


def _processor() -> str:
    cores = os.cpu_count()
    try:
        text = Path("/proc/cpuinfo").read_text()
        name = next(line for line in text.splitlines() if line.startswith("model name"))
        return f"{name.split(':')[1].strip()}, {cores} cores"
    except (OSError, StopIteration):
        return f"{platform.machine()}, {cores} cores"
