"""JSON: a ColorModel, in a file of its own and in the header of a Solution; reports; rows of CSV."""

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from blurmatte.color import ColorModel
from blurmatte.errors import FileError


def model_to_json(model: ColorModel) -> str:
    """Every digit of the model, and its colors for people to read.

    JSON has no infinity: evidence that leaves everything open is null.
    """
    fields: dict[str, Any] = {
        "rank": model.rank,
        "hex": list(model.hex),
        "basis": model.basis.tolist(),
        "covariance": model.covariance.tolist(),
        "evidence": {k: v if math.isfinite(v) else None for k, v in model.evidence.items()},
    }
    if model.to_srgb is not None:
        fields["to_srgb"] = [list(row) for row in model.to_srgb]
    lines = (f'  "{name}": {json.dumps(value, allow_nan=False)}' for name, value in fields.items())
    return "{\n" + ",\n".join(lines) + "\n}"


def mapping_to_json(mapping: Mapping[str, Any]) -> str:
    """A report; NumPy's arrays as lists, numbers that are not finite as null.

    Raises
    ------
    TypeError
        If it holds something that JSON has no word for.
    """
    return _indented(_plain(mapping), "")


def mapping_to_csv(mapping: Mapping[str, Any]) -> str:
    """A line of names and a line of values; what is missing is empty.

    Raises
    ------
    TypeError
        If a value is no number and no text.
    """
    return rows_to_csv([mapping])


def rows_to_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """A line of names and a line of values for each row; what is missing is empty.

    Raises
    ------
    TypeError
        If a value is no number and no text.
    """
    lines = io.StringIO(newline="")
    writer = csv.writer(lines, lineterminator="\n")
    flat = flat_rows(rows)
    writer.writerows([flat[0].keys(), *(row.values() for row in flat)])
    return lines.getvalue()


def rows_to_json(rows: Sequence[Mapping[str, Any]]) -> str:
    """A list, a line for each row.

    Raises
    ------
    TypeError
        If a value is no number and no text.
    """
    return "[\n" + ",\n".join("  " + _dumped(row) for row in flat_rows(rows)) + "\n]"


def flat_rows(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of one table, of numbers, text and None.

    Raises
    ------
    TypeError
        If a value is something else.
    ValueError
        If rows have other names than the first.
    """
    flat: list[dict[str, Any]] = [_plain(row) for row in rows]
    for row in flat:
        if row.keys() != flat[0].keys():
            raise ValueError(f"rows of a table have the same names, got {list(row)}")
        for name, value in row.items():
            if isinstance(value, list | dict):
                raise TypeError(f"a row of a table holds numbers and text, {name} is {value!r}")
    return flat


def _indented(value: Any, margin: str) -> str:
    """A line for each name and each text; numbers side by side."""
    inner = margin + "  "
    if isinstance(value, dict) and value:
        lines = [f"{inner}{_dumped(k)}: {_indented(v, inner)}" for k, v in value.items()]
        return "{\n" + ",\n".join(lines) + f"\n{margin}}}"
    if isinstance(value, list) and value and all(isinstance(part, str) for part in value):
        return "[\n" + ",\n".join(inner + _dumped(part) for part in value) + f"\n{margin}]"
    return _dumped(value)


def _dumped(value: Any) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False)


def _plain(value: Any) -> Any:
    match value:
        case np.generic() | np.ndarray():
            return _plain(value.tolist())
        case Mapping():
            return {str(name): _plain(part) for name, part in value.items()}
        case list() | tuple():
            return [_plain(part) for part in value]
        case float() if not math.isfinite(value):
            return None
        case str():  # the name of a file may hold bytes that are no text
            return value.encode("utf-8", "backslashreplace").decode()
        case int() | float() | None:
            return value
    raise TypeError(f"a report must hold numbers, text, and lists of them, got {value!r}")


def model_from_json(text: str) -> ColorModel:
    """The model of `model_to_json`.

    Raises
    ------
    KeyError, TypeError, ValueError
        If the text is something else.
    """
    fields: Any = json.loads(text)
    evidence = {k: math.inf if v is None else float(v) for k, v in fields["evidence"].items()}
    rows = fields.get("to_srgb")
    to_srgb = None if rows is None else tuple(tuple(map(float, row)) for row in rows)
    return ColorModel(fields["basis"], fields["covariance"], evidence, to_srgb)


def read_color_model(path: str | Path) -> ColorModel:
    """Read a color model that `write` wrote.

    Raises
    ------
    FileError
        If the file cannot be read or holds no color model.
    """
    text = read_json_text(path, _HINT)
    try:
        return model_from_json(text)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        found = "holds a transfer curve" if '"light"' in text else "is no color model"
        raise FileError(f"{path}: {found}; {_HINT}") from error


def read_json_text(path: str | Path, hint: str) -> str:
    """What is in a JSON file.

    Raises
    ------
    FileError
        If it cannot be read, or is no JSON; the message ends with `hint`.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        json.loads(text)
    except json.JSONDecodeError as error:
        raise FileError(f"{path}: is no JSON (line {error.lineno}: {error.msg}); {hint}") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: is no JSON text; {hint}") from error
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    return text


_HINT = "give a file that blurmatte wrote, e.g. with blurmatte color"
