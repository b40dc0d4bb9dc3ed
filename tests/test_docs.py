"""Documents, command line and packages agree, and every link leads to a file."""

import ast
import keyword
import re
import shlex
import tomllib
from pathlib import Path

import pytest
import typer
from PIL import Image
from tests.commands import commands

import blurmatte as bm
from blurmatte.cli import app
from blurmatte.cli.console import GENERAL, ExitCode

ROOT = Path(__file__).parents[1]
DOCUMENTS = [
    ROOT / "README.md",
    *ROOT.glob("C*.md"),
    *sorted(p for p in (ROOT / "docs").rglob("*.md") if "generated" not in p.parts),
]
TEXTS = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in DOCUMENTS}
CLI = TEXTS["docs/cli.md"]
GROUP = typer.main.get_command(app)


COMMANDS = dict(commands())
OPTIONS = {name for parameter in GROUP.params for name in parameter.opts}


def calls():
    """Every `blurmatte …` in a console block or between backticks, as it is typed."""
    for text in TEXTS.values():
        for block in re.findall(r"```console\n(.*?)```", text, re.DOTALL):
            yield from re.findall(r"(?:^ *\$ |/)blurmatte (.*)$", block, re.MULTILINE)
        yield from re.findall(r"`blurmatte ([^`]* [^`]*)`", text)


@pytest.mark.parametrize("call", sorted(set(calls())))
def test_documented_calls_are_valid(call):
    name, *arguments = shlex.split(call)
    if name.startswith("--") or arguments == ["--help"]:
        assert name in {"--help", *OPTIONS, *GROUP.commands}
        return
    if name not in COMMANDS:
        name = f"{name} {arguments.pop(0)}"
    COMMANDS[name].make_context(name, arguments)  # raises what a user would see


def test_documents_contain_calls():
    assert len(set(calls())) > 20


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_commands_are_documented(name):
    section = re.split(r"^## ", CLI.split(f"\n## blurmatte {name}\n")[1], flags=re.MULTILINE)[0]
    summary = COMMANDS[name].help.splitlines()[0]
    assert summary.rstrip(".") in section.replace("\n", " ")
    for parameter in COMMANDS[name].params:
        if getattr(parameter, "rich_help_panel", None) == GENERAL:
            assert parameter.opts[0] in CLI.split("\n## General options\n")[1].split("\n## ")[0]
        elif parameter.param_type_name == "option":
            assert parameter.opts[0] in section
        else:
            assert parameter.metavar in section


def test_exit_codes_are_documented():
    table = CLI.split("| exit code |")[1].split("\n\n")[0]
    assert re.findall(r"^\| (\d+) \|", table, re.MULTILINE) == [str(int(c)) for c in ExitCode]


def test_documented_options_exist():
    real = {o for c in COMMANDS.values() for p in c.params for o in p.opts}
    documented = re.findall(r"(?<![\w-])--[a-z][a-z-]*", CLI)
    assert set(documented) <= real | OPTIONS | {"--help"}


@pytest.mark.parametrize("name", TEXTS)
def test_links_lead_to_files(name):
    for link in re.findall(r"\]\(([^)\s#]+)(?:#[^)\s]*)?\)", TEXTS[name]):
        if not link.startswith("https://"):
            assert ((ROOT / name).parent / link).exists(), link


@pytest.mark.parametrize("name", TEXTS)
def test_named_files_exist(name):
    for path in re.findall(
        r"`((?:docs|scripts|tests|examples|benchmarks|\.ci)/[^` ]*)`", TEXTS[name]
    ):
        assert (ROOT / path).exists(), path


def test_the_map_of_packages_is_complete():
    tree = set(re.findall(r"[├└]── (\w+)", TEXTS["docs/design.md"]))
    paths = (ROOT / "src" / "blurmatte").iterdir()
    packages = {path.stem for path in paths if path.name not in ("__pycache__", "py.typed")}
    assert packages == tree


def words(tree):
    """Names that code defines or uses, and words that are whole strings: columns, keys."""
    for node in ast.walk(tree):
        for field in ("id", "attr", "name", "arg", "module"):
            yield from str(getattr(node, field, "") or "").split(".")
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def test_names_in_docstrings_exist():
    files = [p for p in (ROOT / "src").rglob("*.py*") if p.suffix in (".py", ".pyi")]
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in files}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    known = {"pyi", *keyword.kwlist, *project["optional-dependencies"]}
    known |= {name for path in files for name in (path.stem, path.parent.name)}
    known |= {word for tree in trees.values() for word in words(tree)}
    foreign = {"colorInteropID"}
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                text = ast.get_docstring(node) or ""
                for name in set(re.findall(r"`([A-Za-z_][\w.]*)`", text)) - foreign:
                    assert set(name.split(".")) <= known, (path, name)


def test_short_documents_keep_their_limits():
    limits = {"README.md": 300, **{name: 60 for name in TEXTS if "/decisions/0" in name}}
    assert len(limits) > 8
    for name, limit in limits.items():
        assert len(TEXTS[name].splitlines()) <= limit, name
    assert len(TEXTS["docs/design.md"].encode()) <= 15_000


def test_picture_of_the_readme_is_small():
    path = ROOT / "docs" / "overview.png"
    assert path.stat().st_size < 500_000
    with Image.open(path) as picture:
        assert picture.width == 900


def test_versions_agree():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = (ROOT / "CITATION.cff").read_text()
    assert "version" in project["dynamic"]  # `__version__` is the only place in the code
    assert f"\nversion: {bm.__version__}\n" in citation
    assert f"\nlicense: {project['license']}\n" in citation
    assert bm.__version__ in TEXTS["CHANGELOG.md"]


def test_tables_are_of_the_commits_that_the_limitations_name():
    """Each table states its commit, of the version that made it or that last changed the solver."""
    text = TEXTS["docs/limitations.md"].partition("Each table states its commit.")[2]
    named = re.findall(r"(?<!but )((?:\*\w+\*(?:,| and|) )+)(?:are )?of\s([0-9a-f]{7})\b", text)
    assert len(named) > 3
    for names, commit in named:
        for name in re.findall(r"\w+(?=\*)", names):
            table = ROOT / "docs" / "results" / f"{name}.csv"
            assert commit in table.read_text(encoding="utf-8").partition("\n\n")[0], name
