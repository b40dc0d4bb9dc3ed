"""The examples in the docstrings of public names: found, run and compared.

An example begins with the names of docs/begin.py, in a folder with the files that it writes, and has
the form of doctest. Tests and the site run it by the same function.
"""

import doctest
import inspect
import re
import runpy
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

import blurmatte as bm

ROOT = Path(__file__).parents[2]
NAMES = (ROOT / "tests" / "public_names.txt").read_text(encoding="utf-8").split()
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_MOST_CHANGE = 0.05  # relative difference of numbers that other versions of libraries may cause


class _Checker(doctest.OutputChecker):
    """Texts agree exactly, numbers to 5 % or two units of the last digit that is stated."""

    def check_output(self, want: str, got: str, optionflags: int) -> bool:
        want, got = " ".join(want.split()), " ".join(got.split())
        if _NUMBER.sub("#", want) != _NUMBER.sub("#", got):
            return False
        numbers = zip(_NUMBER.findall(want), _NUMBER.findall(got), strict=True)
        return all(_agree(stated, found) for stated, found in numbers)


def _agree(stated: str, found: str) -> bool:
    digits, _, exponent = stated.partition("e")
    unit = 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))
    difference = abs(float(stated) - float(found))
    return difference <= max(_MOST_CHANGE * abs(float(stated)), 2 * unit)


def begin() -> dict[str, Any]:
    """Names that every example may use; files are written into the working folder."""
    return runpy.run_path(str(ROOT / "docs" / "begin.py"))


def example(name: str) -> list[doctest.Example]:
    """Statements of the example of a public name, such as "motion.fit_fall"; empty without one."""
    text = inspect.getdoc(attrgetter(name)(bm)) or ""
    return doctest.DocTestParser().get_examples(text, name)


def run(name: str, names: dict[str, Any]) -> str:
    """What is wrong with the example of a name; empty if it prints what it says."""
    test = doctest.DocTest(example(name), dict(names), name, None, 0, None)
    said: list[str] = []
    doctest.DocTestRunner(_Checker(), verbose=False).run(test, out=said.append)
    return "".join(said)


_DRAWN = "picture", "sheet"  # what an example calls a picture that the site shall show


def draws(name: str) -> bool:
    """Whether the example of a name makes a picture that the site shows."""
    return any(one.source.startswith(_DRAWN) for one in example(name))


def drawn(name: str, names: dict[str, Any]) -> np.ndarray:
    """The picture that an example makes: (H, W, 3) uint8."""
    own = dict(names)
    for statement in example(name):
        exec(statement.source, own)
    made = next(own[key] for key in _DRAWN if own.get(key) is not names.get(key))
    return made if isinstance(made, np.ndarray) else bm.figures.draw_look(made)
