"""The drawing of a table: lines over its column x, in adjacent panels.

If two columns distinguish lines, the first sets the colors and the last the dashes.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.table import Cell, Table
from matplotlib.figure import Figure
from matplotlib.ticker import (
    FixedLocator,
    LogLocator,
    NullFormatter,
    NullLocator,
    StrMethodFormatter,
)

Row = tuple[Cell, ...]
Curve = tuple[tuple[str, ...], list[Cell], list[Cell]]  # its labels, x and y

_DASHES = ("-", "--", ":", "-.")
_PLAIN = "{x:g}"
_FEW = 4  # lines that are labeled at their ends


def draw(table: Table, path: Path) -> None:
    """Write the drawing as PNG."""
    panels = _panels(table)
    figure = Figure(figsize=(6.4 if len(panels) == 1 else 1.8 + 3 * len(panels), 4))
    figure.set_layout_engine("constrained")
    every = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (title, rows) in zip(every, panels, strict=True):
        _draw_curves(axes, _curves(table, rows))
        _label(axes, table, title, [row[table.columns.index(table.x)] for row in rows])
    every[0].set_ylabel(table.y)
    _name_curves(figure, every, ", ".join(table.line_columns))
    figure.savefig(path, dpi=100, metadata={"Software": None})


def _panels(table: Table) -> list[tuple[str, list[Row]]]:
    """The rows of each panel, under its title."""
    at_x = table.columns.index(table.x)
    rows = [row for row in table.rows if isinstance(row[at_x], int | float)]
    if not table.panels:
        return [("", rows)]
    at = table.columns.index(table.panels)
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(str(row[at]), []).append(row)
    return list(groups.items())


def _curves(table: Table, rows: list[Row]) -> list[Curve]:
    """Every line; y is NaN where there is no answer."""

    def column(name: str, rows: list[Row]) -> list[Cell]:
        cells = (row[table.columns.index(name)] for row in rows)
        return [float("nan") if value is None else value for value in cells]

    if not table.line_columns:
        others = [name for name in table.columns if name != table.x]
        numbers = [n for n in others if not any(isinstance(v, str) for v in column(n, rows))]
        return [((name,), column(table.x, rows), column(name, rows)) for name in numbers]
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        names = tuple(str(row[table.columns.index(name)]) for name in table.line_columns)
        groups.setdefault(names, []).append(row)
    return [(names, column(table.x, some), column(table.y, some)) for names, some in groups.items()]


def _draw_curves(axes: Any, curves: list[Curve]) -> None:
    colors = list(dict.fromkeys(names[0] for names, _, _ in curves))
    dashes = list(dict.fromkeys(names[1:] for names, _, _ in curves))
    for names, x, y in curves:
        axes.plot(
            x, y,
            label=", ".join(names),
            color=f"C{colors.index(names[0])}",
            linestyle=_DASHES[dashes.index(names[1:]) % len(_DASHES)],
            marker="o",
            markersize=4,
        )  # fmt: skip


def _label(axes: Any, table: Table, title: str, x: Iterable[Cell]) -> None:
    axes.set(title=title, xlabel=", ".join(filter(None, (table.x, table.x_unit))))
    axes.grid(alpha=0.3)
    if table.log:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.yaxis.set_major_formatter(StrMethodFormatter(_PLAIN))
    if table.log_x:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(FixedLocator(sorted(set(x))))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(StrMethodFormatter(_PLAIN))


def _name_curves(figure: Figure, every: Sequence[Any], title: str) -> None:
    """One legend for all panels: within the only one, below several, or of many right of the last."""
    lines = {line.get_label(): line for axes in every for line in axes.get_lines()}
    if len(lines) <= _FEW and len(every) == 1:
        every[0].legend(lines.values(), lines.keys(), fontsize="small", title=title)
    elif len(lines) <= _FEW:
        below = {"loc": "outside lower center", "ncols": _FEW, "title": title}
        figure.legend(lines.values(), lines.keys(), fontsize="small", **below)
    else:
        figure.legend(lines.values(), lines.keys(), loc="outside right upper", title=title)
