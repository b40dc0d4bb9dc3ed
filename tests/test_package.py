"""The files of a release: the page of the package, the manual page, and the bytes of the wheel."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.scripts import loaded

import blurmatte as bm

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
ADDRESS = "https://example.org/someone/blurmatte"
LINKS = re.compile(r"\]\(([^)]+)\)")


def test_page_of_the_package_has_absolute_links_and_picture():
    """Exact: every link to a file leads to it at the tag of the version."""
    pytest.importorskip("hatchling")
    page = loaded(ROOT / "hatch_build.py").package_page(README, f"{ADDRESS}/", "1.2.3")
    links = LINKS.findall(page)
    assert f"{ADDRESS}/raw/v1.2.3/docs/overview.png" in links
    assert f"{ADDRESS}/blob/v1.2.3/docs/python.md" in links
    relative = [link for link in LINKS.findall(README) if not link.startswith(("https:", "#"))]
    assert len(relative) > 20
    assert len(links) == len(LINKS.findall(README))
    assert all(link.startswith(("https:", "#")) for link in links)


def test_page_without_an_address_has_no_broken_links():
    pytest.importorskip("hatchling")
    page = loaded(ROOT / "hatch_build.py").package_page(README, None, "1.2.3")
    assert all(link.startswith(("https:", "#")) for link in LINKS.findall(page))
    assert "![" not in page
    assert "| docs/output.md | " in page


def test_manual_page_is_that_of_the_program():
    page = (ROOT / "docs" / "blurmatte.1").read_text(encoding="utf-8")
    assert page == loaded(ROOT / "scripts" / "make_man.py").page()
    assert f'"blurmatte {bm.__version__}"' in page
    assert "\n.SS blurmatte calibrate noise\n" in page
    assert "\n.B \\-o, \\-\\-out FOLDER\n" in page


def test_wheels_built_twice_have_the_same_bytes(tmp_path):
    """Exact: whenever they are built, if SOURCE_DATE_EPOCH is the same; the manual page is in them."""
    pytest.importorskip("hatchling")
    wheels = []
    for name in ("first", "second"):
        command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path / name]
        variables = os.environ | {"SOURCE_DATE_EPOCH": "1700000000"}
        subprocess.run(command, cwd=ROOT, env=variables, check=True, capture_output=True)
        (wheel,) = (tmp_path / name).iterdir()
        wheels.append(wheel.read_bytes())
    assert wheels[0] == wheels[1]
    assert b"share/man/man1/blurmatte.1" in wheels[0]


def test_there_is_one_version_and_one_date():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    date = re.search(r"^date-released: (\S+)$", citation, re.MULTILINE)[1]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{bm.__version__}] - {date}\n" in changelog


def test_actions_of_workflows_are_pinned_by_commit():
    uses = [
        line.split("uses: ")[1]
        for path in (ROOT / ".github" / "workflows").glob("*.yml")
        for line in path.read_text(encoding="utf-8").splitlines()
        if "uses: " in line
    ]
    assert len(uses) >= 8
    for one in uses:
        assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # v[\d.]+", one), one
