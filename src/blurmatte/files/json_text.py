"""JSON and CSV text of reports and tables."""

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np


def mapping_to_json(mapping: Mapping[str, Any]) -> str:
    """A report; NumPy arrays become lists, and numbers that are not finite become null."""
    return _indented(plain(mapping), "")


def rows_to_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """A line of names and a line of values for each row; missing values are empty."""
    lines = io.StringIO(newline="")
    writer = csv.writer(lines, lineterminator="\n")
    flat = flat_rows(rows)
    writer.writerows([flat[0].keys(), *(row.values() for row in flat)])
    return lines.getvalue()


def rows_to_json(rows: Sequence[Mapping[str, Any]]) -> str:
    """A list with one line per row."""
    return "[\n" + ",\n".join("  " + _dumped(row) for row in flat_rows(rows)) + "\n]"


def flat_rows(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of one table; raises if a value is no number, text or None, or if rows differ in names."""
    flat: list[dict[str, Any]] = [plain(row) for row in rows]
    for row in flat:
        if row.keys() != flat[0].keys():
            raise ValueError(f"rows of a table must have the same names, got {list(row)}")
        for name, value in row.items():
            if isinstance(value, list | dict):
                raise TypeError(f"a table must hold numbers and text, {name} is {value!r}")
    return flat


def plain(value: Any) -> Any:
    """The value in the types of JSON; raises TypeError if there is none."""
    match value:
        case np.generic() | np.ndarray():
            return plain(value.tolist())
        case Mapping():
            return {str(name): plain(part) for name, part in value.items()}
        case list() | tuple():
            return [plain(part) for part in value]
        case float() if not math.isfinite(value):
            return None
        case str():  # file names may hold bytes that are not text
            return value.encode("utf-8", "backslashreplace").decode()
        case int() | float() | None:
            return value
    raise TypeError(f"a report must hold numbers, text, and lists of them, got {value!r}")


def _indented(value: Any, margin: str) -> str:
    """One line per name and per text of a list; numbers share a line."""
    inner = margin + "  "
    if isinstance(value, dict) and value:
        lines = [f"{inner}{_dumped(k)}: {_indented(v, inner)}" for k, v in value.items()]
        return "{\n" + ",\n".join(lines) + f"\n{margin}}}"
    if isinstance(value, list) and value and all(isinstance(part, str) for part in value):
        return "[\n" + ",\n".join(inner + _dumped(part) for part in value) + f"\n{margin}]"
    return _dumped(value)


def _dumped(value: Any) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False)
