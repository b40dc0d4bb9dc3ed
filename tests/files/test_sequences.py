from pathlib import Path

import pytest

from blurmatte.errors import FileError
from blurmatte.files.sequences import missing_numbers, numbering, picture_numbers, source_paths


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("ball.####.exr", ["ball.0000.exr", "ball.0017.exr", "ball.12345.exr"]),
        ("ball.%04d.exr", ["ball.0000.exr", "ball.0017.exr", "ball.12345.exr"]),
        ("#_ball.png", ["0_ball.png", "17_ball.png", "12345_ball.png"]),
        ("%d.tif", ["0.tif", "17.tif", "12345.tif"]),
    ],
)
def test_names(pattern, names):
    # exact
    found = numbering(Path("out") / pattern)
    assert [found.name(number) for number in (0, 17, 12345)] == names
    assert found.folder == Path("out")


def test_files_in_the_order_of_their_numbers(tmp_path):
    # exact: only those that the pattern itself would write
    names = ["a.9998.exr", "a.10000.exr", "a.0003.exr"]
    for name in (*names, "a.3.exr", "a.00003.exr", "b.0001.exr", "a.0001.png", "a.x.exr"):
        (tmp_path / name).touch()
    (tmp_path / "a.0007.exr").mkdir()
    found = numbering(tmp_path / "a.####.exr").files()
    assert [path.name for path in found] == ["a.0003.exr", "a.9998.exr", "a.10000.exr"]
    assert numbering(tmp_path / "nowhere" / "a.#.exr").files() == []


def test_special_letters_are_letters(tmp_path):
    for name in ("a+b (1)[x].01.exr", "aab (1)x.01.exr"):
        (tmp_path / name).touch()
    found = numbering(tmp_path / "a+b (1)[x].##.exr").files()
    assert [path.name for path in found] == ["a+b (1)[x].01.exr"]


def test_names_without_a_number():
    # door: a folder's name does not count; two numbers are one too many
    assert numbering(Path("out.####") / "ball.exr") is None
    assert numbering(Path("100%.exr")) is None
    with pytest.raises(FileError, match=r"keep one number in the name, .* it has 2"):
        numbering(Path("shot##_####.exr"))


@pytest.mark.parametrize(
    ("names", "numbers", "missing"),
    [
        (["f0000.jpg", "f0001.jpg", "f0004.jpg", "f0005.jpg"], (0, 1, 4, 5), [2, 3]),
        (["f7.jpg", "f9.jpg", "f13.jpg"], (7, 9, 13), [11]),  # every second one was kept
        (["take2_98.exr", "take2_99.exr", "take2_101.exr"], (98, 99, 101), [100]),
        (["f0000.jpg", "f0002.jpg", "f0004.jpg"], (0, 2, 4), []),
        (["f1.jpg", "f2.jpg"], (1, 2), []),
        (["take2.0012.exr"], (12,), []),  # of one the last number
        (["f3.jpg", "f1.jpg", "f2.jpg"], None, []),  # another order than that of their numbers
        (["a1_1.jpg", "a1_2.jpg", "a2_4.jpg"], None, []),  # two numbers
        (["a.jpg", "b.jpg", "d.jpg"], None, []),
    ],
)
def test_pictures_have_the_numbers_in_their_names(names, numbers, missing):
    # exact
    assert picture_numbers([Path("in") / name for name in names]) == numbers
    assert list(missing_numbers(numbers or (0,))) == missing


def test_hidden_files_are_no_pictures(tmp_path):
    # exact: macOS leaves ._ files on other disks
    for name in ("f0.jpg", "f1.jpg", "._f0.jpg", ".f2.jpg"):
        (tmp_path / name).write_bytes(b"x")
    for source in (tmp_path, str(tmp_path / "*.jpg"), tmp_path / "f#.jpg"):
        assert [path.name for path in source_paths(source)] == ["f0.jpg", "f1.jpg"]


def test_numbers_with_more_digits_than_the_pattern_are_found(tmp_path):
    """exact: #### also means layer.000123.exr, as solve names it; the exact width goes first."""
    for name in ("layer.000123.exr", "layer.000124.exr", "layer.0124.exr", "layer.12.exr"):
        (tmp_path / name).write_bytes(b"x")
    names = [path.name for path in source_paths(tmp_path / "layer.####.exr")]
    assert names == ["layer.000123.exr", "layer.0124.exr"]
