"""Pages of the reference: a page for each package, with all its public names and their examples."""

import contextlib
import inspect
import io
import re
import tempfile
from operator import attrgetter
from pathlib import Path
from typing import Any

import examples
import numpy as np
from PIL import Image

import blurmatte as bm

_WIDTH = 760  # pixels of a picture on a page


def _directive(name: str) -> str:
    thing = attrgetter(name)(bm)
    if not inspect.isclass(thing):
        return "autofunction" if inspect.isroutine(thing) else "autodata"
    return "autoexception" if issubclass(thing, BaseException) else "autoclass"


def _section(name: str) -> str:
    """The entry of a public name in reStructuredText."""
    directive = _directive(name)
    options = "\n   :no-value:" if directive == "autodata" else ""
    if directive == "autoclass":
        options = "\n   :members:"
        if issubclass(attrgetter(name)(bm), int | str):  # members of enumerations have no text
            options += "\n   :undoc-members:"
    title = name.rpartition(".")[2]
    return f"{title}\n{'-' * len(title)}\n\n.. {directive}:: blurmatte.{name}{options}\n"


def _write_pages(app: Any) -> None:
    folder = Path(app.srcdir) / "generated" / "reference"
    folder.mkdir(parents=True, exist_ok=True)
    packages = sorted({name.rpartition(".")[0] for name in examples.NAMES})
    for package in packages:
        title = f"blurmatte.{package}".rstrip(".")
        names = [name for name in examples.NAMES if name.rpartition(".")[0] == package]
        text = f"{title}\n{'=' * len(title)}\n\n"
        if package and inspect.ismodule(module := getattr(bm, package)):
            text += f"{(inspect.getdoc(module) or '').splitlines()[0]}\n\n"
        text += "\n".join(map(_section, names))
        path = folder / f"{title}.rst"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    _draw_examples(Path(app.srcdir) / "generated" / "examples")


def _draw_examples(folder: Path) -> None:
    """Write the picture that each example makes, unless nothing changed since."""
    folder.mkdir(exist_ok=True)
    names = [name for name in examples.NAMES if examples.draws(name)]
    targets = [folder / f"{name}.jpg" for name in names]
    sources = [*(examples.ROOT / "src").rglob("*.py"), examples.ROOT / "docs" / "begin.py"]
    changed = max(path.stat().st_mtime for path in sources)
    if all(path.exists() and path.stat().st_mtime > changed for path in targets):
        return
    with tempfile.TemporaryDirectory() as here, contextlib.chdir(here):
        given = examples.begin()
        for name, target in zip(names, targets, strict=True):
            with contextlib.redirect_stdout(io.StringIO()):
                sheet = examples.drawn(name, given)
            _reduced(sheet).save(target, quality=88)


def _reduced(sheet: np.ndarray) -> Image.Image:
    """A sheet no wider than a page; light is averaged, not code values."""
    height, width = sheet.shape[:2]
    if width <= _WIDTH:
        return Image.fromarray(sheet)
    smaller = bm.compositing.cover(
        bm.decode(sheet, bm.SRGB), (_WIDTH, round(height * _WIDTH / width))
    )
    codes = np.rint(255 * bm.SRGB.encode(np.clip(smaller.rgb, 0, 1)))
    return Image.fromarray(codes.astype(np.uint8))


_SHORT = {name.rpartition(".")[2]: name for name in examples.NAMES}


def _linked(match: re.Match[str]) -> str:
    """A name between single backticks: a link to a public name, else code."""
    name = _SHORT.get(match[1].removeprefix("bm.").rpartition(".")[2])
    return f"``{match[1]}``" if name is None else f":py:obj:`{match[1]} <blurmatte.{name}>`"


def _escaped(line: str) -> str:
    """A line of plain text, in which marks such as |C| and "*.png" are no markup."""
    return line if "``" in line else re.sub(r"(?<!\w)([*|])(?=\S)", r"\\\1", line)


_CODE = re.compile(r"(?<![`:])`([^`<>]+)`(?!`)")


def _prepare(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings: names in backticks become links, and examples show what they draw."""
    lines[:] = [
        line if line.lstrip().startswith((">>>", "...")) else _CODE.sub(_linked, _escaped(line))
        for line in lines
    ]
    short = name.removeprefix("blurmatte.")
    if short in examples.NAMES and examples.draws(short):
        lines += [
            "",
            f".. image:: /generated/examples/{short}.jpg",
            f"   :alt: What the example of {short} draws",
            "",
        ]


def setup(app: Any) -> dict[str, bool]:
    """For Sphinx."""
    app.connect("builder-inited", _write_pages)
    app.connect("autodoc-process-docstring", _prepare, priority=400)  # before numpydoc
    return {"parallel_read_safe": True, "parallel_write_safe": True}
