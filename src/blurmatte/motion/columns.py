"""Columns of tables: each has its name, its unit, and how it is read from a row, in one place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Generic, SupportsIndex, TypeVar, overload

Row = TypeVar("Row")
Listed = TypeVar("Listed", bound="TableRow")
_SHOWN_ROWS = 20  # of a table that a notebook shows


@dataclass(frozen=True)
class Column(Generic[Row]):
    """A column of a table.

    Parameters
    ----------
    name : str
    unit : str
        "" for counts, texts, factors and other numbers without a unit.
    of : callable
        The value in a row; None if the row has none.
    """

    name: str
    unit: str
    of: Callable[[Row], Any]


class TableRow:
    """A row that knows its columns."""

    @property
    def columns(self) -> Sequence[Column[Any]]:
        """The columns of its table."""
        raise NotImplementedError

    def numbers(self) -> dict[str, Any]:
        """All by name, flat, for a row of a table."""
        return {column.name: column.of(self) for column in self.columns}


class Rows(list[Listed]):
    """A list of rows, which a notebook shows as a table."""

    @overload
    def __getitem__(self, key: SupportsIndex) -> Listed: ...
    @overload
    def __getitem__(self, key: slice) -> Rows[Listed]: ...
    def __getitem__(self, key: SupportsIndex | slice) -> Listed | Rows[Listed]:
        """A row, or a table of some rows."""
        return (
            Rows(super().__getitem__(key)) if isinstance(key, slice) else super().__getitem__(key)
        )

    def _repr_html_(self) -> str:
        return html_table(self)


def html_table(rows: Sequence[TableRow]) -> str:
    """The first rows as a table of HTML, without the columns that are empty in them."""
    shown = [row.numbers() for row in rows[:_SHOWN_ROWS]]
    columns = rows[0].columns if rows else ()
    used = [one for one in columns if any(row[one.name] not in (None, "") for row in shown)]
    head = "".join(f"<th>{escape(one.name)}{_small(one.unit)}</th>" for one in used)
    body = "".join(
        f"<tr>{''.join(f'<td>{_cell(row[one.name])}</td>' for one in used)}</tr>" for row in shown
    )
    more = f", {len(rows) - len(shown)} more" if len(rows) > len(shown) else ""
    counted = f"{len(rows)} rows of {len(columns)} columns{more}"
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table><p>{counted}</p>"


def _small(unit: str) -> str:
    return f"<br><small>{escape(unit)}</small>" if unit else ""


def _cell(value: Any) -> str:
    """A value in at most four digits; nothing for one that is missing."""
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))
