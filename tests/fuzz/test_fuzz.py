"""Commands on damaged files end with an answer or a refusal: no traceback, hang, or changed input."""

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from tests.fuzz.cases import cases
from tests.fuzz.commands import COMMANDS
from tests.fuzz.fuzzing import fuzz
from tests.fuzz.mutations import with_sums
from tests.fuzz.sandbox import Case, Sandbox, fault_of_results
from tests.fuzz.seeds import make_seeds

from blurmatte.files.raster_writing import save_pixels

QUICK = 120  # damaged files of every run of the tests
LONG = 10_000


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seeds")
    make_seeds(folder)
    return folder


@pytest.fixture(scope="module")
def sandbox(seeds, tmp_path_factory):
    with Sandbox(seeds, tmp_path_factory.mktemp("sandbox")) as box:
        yield box


def test_seeds_themselves_have_no_fault(seeds, sandbox):
    """door: the first command of every seed, which is not damaged."""
    for seed, commands in COMMANDS.items():
        content = (seeds / seed).read_bytes()
        assert not sandbox.fault(Case(seed, commands[0], content)), (seed, commands[0])


def test_damaged_files_are_read_or_refused(seeds, sandbox):
    """invariant: the same QUICK files in every run; a fault is reduced to a small file."""

    @settings(
        max_examples=QUICK,
        derandomize=True,
        database=None,
        deadline=None,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )
    @given(cases(seeds))
    def check(case):
        assert not sandbox.fault(case)

    check()


@pytest.mark.battery
def test_many_damaged_files_are_read_or_refused():
    """invariant: LONG files; python -m tests.fuzz runs others, and keeps those with a fault."""
    assert not fuzz(LONG, seed=0)


@pytest.mark.parametrize(
    ("seed", "command", "content", "says"),
    [
        ("noise.json", "--version", b"", ""),
        ("noise.json", "info FILE", b"[", ""),
        ("noise.json", "no-such-command", b"", ""),
    ],
)
def test_answers_and_refusals_are_no_fault(sandbox, seed, command, content, says):
    """exact."""
    assert sandbox.fault(Case(seed, command, content)) == says


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.csv", b"x,y\n1,nan\n", "a.csv holds nan"),
        ("a.json", b'{"x": [1, -Infinity]}', "a.json holds -Infinity"),
        ("a.json", b'{"nan": "inf", "information": 1}', ""),
        (".blurmatte-1", b"", ".blurmatte-1 was left"),
    ],
)
def test_results_that_are_a_fault(tmp_path, name, content, says):
    """exact: NaN in tables, reports and pictures, and files that were left."""
    (tmp_path / name).write_bytes(content)
    assert fault_of_results(tmp_path) == says


def test_nan_in_a_picture_is_a_fault(tmp_path):
    """exact: one of its numbers."""
    pixels = np.ones((4, 5, 3), np.float32)
    save_pixels(tmp_path / "a.exr", [pixels], "RGB", {})
    assert not fault_of_results(tmp_path)
    pixels[2, 3, 1] = np.nan
    save_pixels(tmp_path / "a.exr", [pixels], "RGB", {})
    assert fault_of_results(tmp_path) == "a.exr holds NaN"


def test_checksums_of_a_damaged_png_are_corrected(seeds):
    """exact: sums of a valid PNG stay; those of a changed one agree with its chunks."""
    png = (seeds / "image.png").read_bytes()
    assert with_sums(png) == png
    changed = png[:20] + b"\x07" + png[21:]
    assert with_sums(changed) != changed
    assert with_sums(changed)[:29] == changed[:29]
    assert with_sums(with_sums(changed)[:-4]) == with_sums(changed)[:-4]
