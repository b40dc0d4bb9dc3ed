"""docs/results/*.csv and *.png → docs/results.md, never edited by hand.

Run: python -m benchmarks.report
"""

import csv
from dataclasses import dataclass
from pathlib import Path

from benchmarks.table import RESULTS

SECOND_TRUTH = (
    "second_truth",
    "second_truth_methods",
    "honest_deviations",
    "hypothesis_weights",
)
FIRST = (
    "against_other_methods",
    "together",
    "without_plate",
    "verdict",
    "balls",
    "alpha_noise",
    "alpha_contrast",
    "alpha_faintness",
    "alpha_shift",
    "alpha_jpeg",
    "alpha_gamma",
    "color",
    "color_hue_spread",
    "motion",
    "calibration",
    "space",
)
TOP = """\
# Results

Written by `python -m benchmarks` from the tables in `docs/results`; not edited by hand. The code of
each table is in `benchmarks/`. Each table names the commit that made it. A dash means that there is
no answer.
"""


@dataclass(frozen=True)
class Result:
    """One published table as it was read back; all cells are text."""

    name: str
    question: str
    notes: str
    machine: str
    columns: list[str]
    rows: list[list[str]]


def write_report(folder: Path = RESULTS) -> Path:
    """Write `folder`.md next to a folder of published tables.

    Raises
    ------
    ValueError
        If a CSV file in it is not a published table.
    """
    results = [read_result(path) for path in sorted(folder.glob("*.csv"))]
    parts = [TOP] + [section(result, folder) for result in sorted(results, key=_place)]
    path = folder.with_suffix(".md")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def read_result(path: Path) -> Result:
    """A table as `publish` wrote it: three lines of comment, then the columns and rows."""
    lines = path.read_text(encoding="utf-8").splitlines()
    comments = [line[2:] for line in lines[:3] if line.startswith("# ")]
    table = list(csv.reader(lines[3:]))
    if len(comments) != 3 or not table:
        raise ValueError(
            f"{path} must start with question, notes and machine, each after '# ', and have columns"
        )
    question, notes, machine = comments
    return Result(path.stem, question, notes, machine, table[0], table[1:])


def section(result: Result, folder: Path) -> str:
    """The heading, notes, picture, table and machine of one result, in Markdown."""
    parts = [f"## {result.question}", result.notes]
    if (folder / f"{result.name}.png").exists():
        parts.append(f"![{result.question}]({folder.name}/{result.name}.png)")
    parts += [_markdown(result), f"{folder.name}/{result.name}.csv: {result.machine}."]
    return "\n\n".join(parts) + "\n"


def _place(result: Result) -> tuple[int, str]:
    """Tables of the short list first and in its order, the others by name."""
    order = (*SECOND_TRUTH, *FIRST)
    return order.index(result.name) if result.name in order else len(order), result.name


def _markdown(result: Result) -> str:
    numbers = [all(_is_number(row[i]) for row in result.rows) for i in range(len(result.columns))]
    rule = ["---:" if number else "---" for number in numbers]
    lines = [[_escaped(cell) for cell in line] for line in (result.columns, *result.rows)]
    lines.insert(1, rule)
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell == "-"
    return True


def _escaped(cell: str) -> str:
    return cell.replace("|", "\\|")


if __name__ == "__main__":
    print(write_report())
