"""The public face: its names are a decision, each is documented, and importing it is cheap."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import blurmatte as bm

LIST = Path(__file__).parent / "public_names.txt"
PUBLIC = {
    name: thing
    for name, thing in vars(bm).items()
    if not name.startswith("_") and not inspect.ismodule(thing)
}


def test_public_names_are_those_decided():
    assert sorted(PUBLIC) == LIST.read_text().split()


def documented():
    """Public functions and classes, and the public methods and properties of the latter."""
    for name, thing in PUBLIC.items():
        if inspect.isroutine(thing):
            yield pytest.param(thing, id=name)
        elif inspect.isclass(thing):
            yield pytest.param(thing, id=name)
            for member, value in vars(thing).items():
                if member.startswith("_") or not _is_code(value):
                    continue
                yield pytest.param(getattr(thing, member), id=f"{name}.{member}")


def _is_code(value):
    return inspect.isroutine(value) or isinstance(value, property | classmethod | staticmethod)


@pytest.mark.parametrize("thing", list(documented()))
def test_everything_public_has_a_docstring(thing):
    text = thing.__doc__
    assert text
    assert text.strip()
    if inspect.isclass(thing):
        assert not text.startswith(f"{thing.__name__}(")  # what dataclass puts where there is none


@pytest.mark.parametrize(
    "thing", [pytest.param(t, id=n) for n, t in PUBLIC.items() if inspect.isfunction(t)]
)
def test_documented_arguments_are_the_real_ones(thing):
    names = list(inspect.signature(thing).parameters)
    text = inspect.getdoc(thing)
    if "Parameters\n----------\n" not in text:
        return
    section = text.split("Parameters\n----------\n")[1].split("\n\n")[0]
    heads = [line.split(" :")[0] for line in section.splitlines() if not line.startswith(" ")]
    assert [name.lstrip("*") for head in heads for name in head.split(", ")] == names


def test_import_is_cheap():
    code = (
        "import sys, blurmatte; "
        "print(*({'numba', 'scipy', 'PIL', 'matplotlib', 'rich', 'av'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
