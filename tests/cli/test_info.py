"""What `info` says without a file."""

import json
import os
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, metadata, version
from pathlib import Path

import pytest
from tests.commands import complaint, good, run

import blurmatte as bm
from blurmatte.cli import kernels, pictures

ROOT = Path(__file__).parents[2]


def test_versions_platform_and_extras_are_those_of_this_environment():
    found = json.loads(good("info", "--json").stdout)
    assert found["blurmatte"] == bm.__version__
    assert found["python"].endswith(sys.version.split()[0])
    assert found["cores"] == os.cpu_count()
    assert found["libraries"]["numpy"] == version("numpy")
    assert found["libraries"]["numba"] == version("numba")
    assert found["extras"].keys() == set(metadata("blurmatte").get_all("Provides-Extra")) - {
        "all",
        "dev",
    }
    assert found["extras"]["plot"] == {"matplotlib": version("matplotlib")}


def test_missing_packages_are_named(monkeypatch):
    """Exact: an extra whose package is missing is listed as missing, and a library is named so."""

    def without(name):
        if name in ("av", "rich"):
            raise PackageNotFoundError(name)
        return version(name)

    monkeypatch.setattr(pictures, "version", without)
    lines = good("info").stdout.splitlines()
    assert lines[0] == f"blurmatte {bm.__version__}"
    (missing,) = (line for line in lines if line.startswith("extras that are not installed:"))
    assert "video" in missing.partition(": ")[2].split(", ")
    assert not [line for line in lines if line.startswith("extra video")]
    assert "rich missing" in lines[2]
    assert json.loads(good("info", "--json").stdout)["extras"]["video"] == {"av": None}


def test_source_that_is_not_installed_has_no_libraries(monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(pictures, "requires", missing)
    found = json.loads(good("info", "--json").stdout)
    assert (found["libraries"], found["extras"]) == ({}, {})
    assert good("info").exit_code == 0


def test_folder_of_kernels_is_where_numba_keeps_them(tmp_path):
    """Exact: the folder that the variable names; otherwise the package, if it can be written to."""
    code = "from blurmatte.compiling import kernel_folder; print(kernel_folder())"
    inherited = {name: x for name, x in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    for variables, folder in (
        ({"NUMBA_CACHE_DIR": str(tmp_path)}, tmp_path),
        ({}, Path(bm.__file__).parent),
    ):
        command = [sys.executable, "-c", code]
        done = subprocess.run(
            command, env=inherited | variables, capture_output=True, text=True, check=True
        )
        assert Path(done.stdout.strip()) == folder


def test_kernels_are_compiled_if_asked_for(monkeypatch):
    calls = []
    monkeypatch.setattr(kernels, "compile_kernels", lambda: calls.append(1))
    good("info")
    assert not calls
    assert "compiled kernels: " in good("info", "--compile").stdout
    assert calls == [1]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("a.png", "--compile"), "--compile concerns no FILE; leave one of the two out"),
        (("--transfer", "srgb"), "--shots, --transfer and --max-pixels describe a FILE; give one"),
        (("--shots",), "--shots, --transfer and --max-pixels describe a FILE; give one"),
    ],
)
def test_options_of_the_other_kind_are_refused(words, said):
    assert complaint(run("info", *words)) == said


@pytest.mark.battery
def test_compiled_kernels_are_all_that_the_examples_need(tmp_path):
    """Exact: after `info --compile` a solution compiles nothing."""

    def files(*words):
        command = [sys.executable, "-m", "blurmatte", *words]
        variables = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
        subprocess.run(command, env=variables, cwd=ROOT, check=True, capture_output=True)
        return set((tmp_path / "kernels").rglob("*.nbc"))

    compiled = files("info", "--compile")
    assert len(compiled) > 50
    for name in ("colorful", "plain"):
        image, plate = (f"examples/{name}/{which}.png" for which in ("image", "plate"))
        words = "solve", image, "--plate", plate, "--out", str(tmp_path / name)
        assert files(*words) == compiled
