"""The site has every document, its tables are those of docs/results, and it can be built."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path, PurePosixPath

import pytest
from tests.scripts import loaded

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


project_pages = loaded(DOCS / "_site" / "project_pages.py")
check_site = loaded(ROOT / "scripts" / "check_site.py")
make_docs = loaded(ROOT / "scripts" / "make_docs.py")


def children(name):
    """Pages below a page, as its toctrees name them."""
    text = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    for block in re.findall(r"```{toctree}\n(.*?)```", text, re.DOTALL):
        lines = (line for line in block.splitlines() if line and not line.startswith(":"))
        yield from (re.sub(r".* <(.*)>", r"\1", line) for line in lines)


def test_every_document_has_its_place_on_the_site():
    listed = [*children("index"), *children("reference")]
    for parent, pattern in project_pages.CHILDREN.items():
        folder = (DOCS / parent).parent
        listed += [
            path.relative_to(DOCS).with_suffix("").as_posix()
            for path in folder.glob(f"{pattern}.md")
        ]
    written = {
        path.relative_to(DOCS).with_suffix("").as_posix()
        for path in DOCS.rglob("*.md")
        if "generated" not in path.parts
    }
    here = {name for name in listed if not name.startswith("generated/")}
    assert here == written - {"index"}
    assert len(listed) == len(set(listed))


def test_pages_from_elsewhere_are_on_the_site():
    listed = [f"{name}.md" for name in children("index")]
    for page in project_pages.PAGES.values():
        assert any(PurePosixPath(page).match(pattern) for pattern in listed), page
    assert {path.name for path in ROOT.glob("*.md")} <= project_pages.PAGES.keys()


@pytest.mark.parametrize(
    ("link", "source", "page", "target"),
    [
        ("../README.md#citing", "docs/output.md", "output.md", "generated/readme.md#citing"),
        ("docs/cli.md", "README.md", "generated/readme.md", "../cli.md"),
        (
            "sharp.py",
            "docs/gallery/README.md",
            "gallery/README.md",
            "../generated/gallery/sharp.rst",
        ),
        ("clips.md#path", "docs/cli.md", "cli.md", "clips.md#path"),
        ("https://x.org/a.md", "README.md", "generated/readme.md", "https://x.org/a.md"),
        ("CITATION.cff", "README.md", "generated/readme.md", "../../CITATION.cff"),
    ],
)
def test_links_lead_to_pages_of_the_site(link, source, page, target):
    assert project_pages.relinked(f"[a]({link})", source, page) == f"[a]({target})"


def test_tables_of_the_benchmark_are_those_of_the_results():
    text = make_docs.BENCHMARK.read_text(encoding="utf-8")
    assert make_docs.with_tables(text) == text
    assert "| pm cf, best |" in text


def test_pages_for_users_of_other_programs_quote_the_results():
    scenes = {row["method"]: row for row in make_docs.rows("against_other_methods")}
    cycles = {
        row["method"]: row
        for row in make_docs.rows("second_truth_methods")
        if (row["renderer"], row["files"]) == ("cycles", "png")
    }
    pymatting, nuke = (
        (DOCS / "others" / f"{name}.md").read_text(encoding="utf-8")
        for name in ("pymatting", "nuke")
    )
    ours = f"blurmatte {float(scenes['blurmatte']['alpha']):.4f}"
    assert ours in pymatting
    assert ours in nuke
    assert f"alpha {float(scenes['pm cf']['alpha']):.2f} as documented" in pymatting
    assert f"{float(scenes['pm cf, best']['alpha']):.3f} if" in pymatting
    assert f"has {float(cycles['pm cf, best']['RMSE']):.3f}" in pymatting
    assert f"blurmatte in {cycles['pm cf, best']['nearer than blurmatte']}" in pymatting
    assert f"{float(scenes['key, tuned']['alpha']):.3f} on 25 scenes" in nuke
    numbers = (float(cycles[name]["RMSE"]) for name in ("key, tuned", "blurmatte"))
    assert "{:.3f} to {:.3f}".format(*numbers) in nuke
    assert f"better in {cycles['key, tuned']['nearer than blurmatte']}" in nuke


def test_broken_links_and_foreign_files_are_found(tmp_path):
    (tmp_path / "a.html").write_text(
        '<h1 id="top">A</h1><a href="b.html#here">b</a><a href="b.html#gone">b</a>'
        '<a href="c.html">c</a><a href="https://x.org/">x</a><img src="https://x.org/i.png">'
    )
    (tmp_path / "b.html").write_text('<p id="here"></p><a href="a.html#top">a</a>')
    broken, outside = check_site.broken_links(tmp_path)
    assert broken == ["a.html: b.html#gone", "a.html: c.html", "a.html: loads https://x.org/i.png"]
    assert outside == {"https://x.org/", "https://x.org/i.png"}


@pytest.mark.battery
def test_site_builds_without_warnings_and_without_broken_links(tmp_path):
    pytest.importorskip("sphinx", reason="needs the extra: pip install -e '.[docs]'")
    pytest.importorskip("furo")
    source = tmp_path / "docs"
    shutil.copytree(ROOT, tmp_path, dirs_exist_ok=True, ignore=_not_needed)
    call = [sys.executable, "-m", "sphinx", "-b", "html", "-W", "-n", "-q", "-D", "plot_gallery=0"]
    path = os.pathsep.join((str(ROOT / "src"), os.environ.get("PYTHONPATH", "")))
    done = subprocess.run(
        [*call, source, tmp_path / "site"],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    broken, _ = check_site.broken_links(tmp_path / "site")
    assert broken == []


def _not_needed(folder, names):
    """What a copy of the repository does not need for the site."""
    return {".git", ".venv", "build", "generated", "__pycache__", ".mypy_cache"} & set(names)
