"""Columns of tables: each has its name, its unit, and how it is read from a row, in one place."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

Row = TypeVar("Row")


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


def numbers_of(columns: Iterable[Column[Row]], row: Row) -> dict[str, Any]:
    """The values of a row by the names of their columns, in order."""
    return {column.name: column.of(row) for column in columns}
