"""Documents: JSON, TOML and EXR headers, checked against a schema; JSON and CSV texts of reports.

Documents are checked before any of their values is used. A schema is a dataclass whose fields are
annotated with `numbers` and `covariance_matrix`, or are of types that pydantic checks. A document
that people write is a `@document`: other keys are refused, since a misspelled one would be ignored
otherwise. Of texts that only this package writes, such as EXR headers, other keys are ignored.
"""

import csv
import io
import json
import math
import reprlib
import sys
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, make_dataclass
from difflib import get_close_matches
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar, dataclass_transform, get_args

import numpy as np
from pydantic import AliasChoices, ConfigDict, PlainValidator, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from blurmatte.checks import Array
from blurmatte.errors import FileError
from blurmatte.files.errors import beginning

T = TypeVar("T")

MAX_FLOAT = sys.float_info.max  # of numbers without a bound of their own
MAX_NUMBER = 1e5  # in a TOML document, absolute; seeds are larger
MAX_BYTES = 1 << 26  # of a document; those of this package have less than 1 << 20
_KEYS = {  # that only this kind of JSON file has
    "transfer curve": "light",
    "color model": "basis",
    "noise model": "read_std",
    "calibrated camera": "fx",
    "path": "xy",
    "report": "in_words",
}


class DocumentError(FileError):
    """A document does not agree with its schema."""


@dataclass_transform()
def document(*notes: str) -> Callable[[type[T]], type[T]]:
    """Make a class a dataclass that refuses keys other than its fields when a document is read.

    notes: other keys that it has for people; their values are not read.
    """

    def made(schema: type[T]) -> type[T]:
        """The dataclass, with a field for each note."""
        schema.__pydantic_config__ = ConfigDict(extra="forbid")  # type: ignore[attr-defined]
        unread = [(name, Any, None) for name in notes]
        return make_dataclass(schema.__name__, unread, bases=(dataclass(schema),))

    return made


def read_document(path: str | Path, hint: str) -> str:
    """The text of a file; a FileError with this hint if it cannot be read, is no text, or too long."""
    text = beginning(Path(path), MAX_BYTES + 1, hint)
    if len(text) > MAX_BYTES:
        raise FileError(f"{path}: {hint}; the file has more than the limit of {MAX_BYTES} bytes")
    try:
        return text.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: {hint}; the file is no text in UTF-8") from error


def read_json(path: str | Path, schema: Any, hint: str, what: str) -> Any:
    """The value of a JSON file, by its schema.

    Raises FileError if the file does not hold `what`; the message begins with `hint`, and names the
    key and the allowed range.
    """
    return checked_json(path, read_document(path, hint), schema, hint, what)


def checked_json(path: str | Path, text: str, schema: Any, hint: str, what: str) -> Any:
    """As `read_json`, of the text of a file."""
    try:
        return parse_json(text, schema)
    except ValueError as error:
        found = json_kind(text)
        reason = str(error) if found in what else f"it holds a {found}"
        if _KEY_REFUSED in reason:  # it lists what is allowed, as the hint does
            raise DocumentError(f"{path}: {reason}") from error
        raise DocumentError(f"{path}: {hint}; the file holds no {what} ({reason})") from error


def parse_json(text: str, schema: Any) -> Any:
    """The value of a JSON text; a ValueError with key and allowed range if it violates the schema."""
    try:
        return _adapter(schema).validate_json(text, strict=True)
    except ValidationError as error:
        raise ValueError(_reason(error, schema)) from error


def to_mapping(thing: Any) -> dict[str, Any]:
    """The fields of a dataclass, in the types of JSON; `parse_json` reads them by the same class.

    Raises TypeError if a value is no number, text, or list of them.
    """
    return dict(_in_json_types(thing))


def to_json(value: Any) -> str:
    """One line of JSON with every digit, of which `parse_json` reads infinite numbers, too."""
    return json.dumps(_in_json_types(value))


def _in_json_types(value: Any) -> Any:
    serializer = _WRITER.serializer  # its `dump_python` of pydantic 2.10 has no `fallback`
    return serializer.to_python(value, mode="json", fallback=_listed)


def _listed(value: Any) -> Any:
    """A NumPy number or array as numbers of Python."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"a document must hold numbers, text, and lists of them, got {value!r}")


def json_kind(text: str) -> str:
    """Which document of this package a JSON text holds, by its keys; empty if none."""
    try:
        fields = parse_json(text, dict[str, Any])
    except ValueError:
        return ""
    return next((kind for kind, key in _KEYS.items() if key in fields), "")


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text; its numbers are finite, and at most MAX_NUMBER but for seeds.

    Raises ValueError, with the key, if it is no TOML or a number is not within these limits.
    """
    try:
        tables = tomllib.loads(text)
        _check_numbers("", tables, MAX_NUMBER)
    except RecursionError as error:
        raise ValueError("tables and lists must not nest as deeply as here") from error
    return tables


def numbers(low: float, high: float, *shape: int | None, whole: bool = False) -> PlainValidator:
    """A field that holds numbers from `low` to `high` in nested lists of this shape.

    Both limits are allowed. `shape` are the lengths of the lists, None for any, or nothing for a
    single number; if `whole`, integers only. The value is an array, or a float or int.
    """
    kind = "whole number" if whole else "number"
    count = " x ".join("n" if n is None else str(n) for n in shape)
    must = f"must be {count} {kind}s" if shape else f"must be a {kind}"
    kinds = (int,) if whole else (int, float)
    low, high = max(low, -MAX_FLOAT), min(high, MAX_FLOAT)

    def check(value: Any) -> Any:
        """The numbers; ValueError if they are others."""
        found = np.array(value, dtype=object)
        fits = found.ndim == len(shape)
        fits = fits and all(n in (None, m) for n, m in zip(shape, found.shape, strict=True))
        wrong = [x for x in found.flat if type(x) not in kinds or not low <= x <= high]
        if wrong or not fits:
            got = reprlib.repr(wrong[0] if wrong else value)
            raise ValueError(f"{must} from {low:g} to {high:g}, got {got}")
        right = found.astype(int if whole else float)
        return right if shape else right.item()

    return PlainValidator(check)


def covariance_matrix(high: float, *shape: int | None) -> PlainValidator:
    """A field that holds a covariance: symmetric, without a negative variance, at most `high`."""
    check = numbers(-high, high, *shape).func

    def positive(value: Any) -> Array:
        """The matrix; ValueError if it is no covariance."""
        C = np.asarray(check(value))  # type: ignore[call-arg]
        slack = 1e-6 * np.abs(C).max(initial=0)
        if C.ndim != 2 or C.shape[0] != C.shape[1] or np.abs(C - C.T).max(initial=0) > slack:
            raise ValueError(f"must be a symmetric matrix, got the shape {C.shape}")
        least = float(np.linalg.eigvalsh(C).min(initial=0))
        if least < -slack:
            raise ValueError(f"must have no negative variance, got {least:.3g}")
        return C

    return PlainValidator(positive)


# Of all types; infinite numbers stay.
_WRITER = TypeAdapter[Any](Any, config=ConfigDict(ser_json_inf_nan="constants"))


@cache
def _adapter(schema: Any) -> TypeAdapter[Any]:
    return TypeAdapter(schema)


_KEY_REFUSED = "rename or remove the unknown key"


def _keys(schema: Any) -> list[list[str]]:
    """The names of each key that a schema reads, in order; none if it is no dataclass."""
    schema = (get_args(schema) or (schema,))[0]
    found = []
    for field in fields(schema) if is_dataclass(schema) else ():
        notes = getattr(field.type, "__metadata__", ())
        several = [
            note.validation_alias.choices
            for note in notes
            if isinstance(note, FieldInfo) and isinstance(note.validation_alias, AliasChoices)
        ]
        found.append([*map(str, several[0])] if several else [field.name])
    return found


def _reason(error: ValidationError, schema: Any) -> str:
    """One clause about the first disagreement: the key, what its value must be, and what it is."""
    first = error.errors(include_url=False)[0]
    key = ".".join(map(str, first["loc"]))
    match first["type"]:
        case "unexpected_keyword_argument":
            known = _keys(schema) if len(first["loc"]) == 1 else []
            near = get_close_matches(key, chain.from_iterable(known), 1)
            also = f" (did you mean {near[0]}?)" if near else ""
            only = f"; allowed are {', '.join(names[0] for names in known)}" if known else ""
            return f"{_KEY_REFUSED} {reprlib.repr(key)}{also}{only}"
        case "json_invalid":
            return f"{key or 'the text'} is no JSON: {first['ctx']['error']}"
        case "missing":
            return f"{key} is missing"
        case "value_error":
            said = str(first["ctx"]["error"])
        case "bool_type":
            said = f"must be true or false, got {reprlib.repr(first['input'])}"
        case _:
            said = first["msg"].replace("Input should", "must")
            said = said.replace("a valid integer", "a whole number").replace("a valid ", "a ")
            said += f", got {reprlib.repr(first['input'])}"
    return f"{key}{'' if said.startswith('must') else ':'} {said}" if key else said


def _check_numbers(name: str, value: Any, most: float) -> None:
    """Raise ValueError if a number in nested tables and lists exceeds `most`, or is not finite."""
    if isinstance(value, dict | list):
        parts = value.items() if isinstance(value, dict) else enumerate(value)
        for key, part in parts:
            _check_numbers(f"{name}.{key}".lstrip("."), part, most)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        limit = 2**63 if name == "seed" else most
        if not -limit <= value <= limit or not math.isfinite(value):
            raise ValueError(
                f"{name} must be a number from {-limit:g} to {limit:g}, got {reprlib.repr(value)}"
            )


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
        case Path():
            return plain(str(value))
        case _ if is_dataclass(value):
            return plain(to_mapping(value))
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
