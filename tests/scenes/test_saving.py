"""The archive of scenes: its contents, checksums and scores; an adapter that reads it."""

import hashlib
import re
import warnings
import zipfile

import numpy as np
import pytest
from tests.commands import complaint, run
from tests.scenes.texts import BALL

import blurmatte as bm
from blurmatte.errors import FileError


def saved(path):
    texts = {"ball": BALL, "ball_2": BALL.replace("seed = 1", "seed = 2")}
    assert list(bm.scenes.save_archive(path, texts)) == list(texts)
    return path


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    return saved(tmp_path_factory.mktemp("archive") / "scenes.zip")


@pytest.fixture(scope="module")
def unpacked(archive, tmp_path_factory):
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(archive) as file:
        file.extractall(folder)
    return folder


def test_every_file_has_its_checksum(unpacked):
    """Exact: as `sha256sum -c` reads them; nothing else is in the archive."""
    lines = (unpacked / "SHA256SUMS").read_text().splitlines()
    sums = dict(re.fullmatch(r"([0-9a-f]{64})  (.+)", line).groups()[::-1] for line in lines)
    files = [path for path in unpacked.rglob("*") if path.is_file() and path.name != "SHA256SUMS"]
    assert {path.relative_to(unpacked).as_posix() for path in files} == set(sums)
    for name, expected in sums.items():
        assert hashlib.sha256((unpacked / name).read_bytes()).hexdigest() == expected
    assert "ball_2/truth/layer.exr" in sums
    assert "ball/overview.png" not in sums


def test_the_same_scenes_give_the_same_bytes(archive, tmp_path):
    assert saved(tmp_path / "again.zip").read_bytes() == archive.read_bytes()


def test_the_truth_of_an_archive_scores_as_perfect(unpacked):
    """Exact, over the plate that the camera saw."""
    truth = bm.scenes.read_truth(unpacked / "ball")
    found = bm.scenes.score(bm.scenes.ProgramAnswer(truth.layer), truth)
    assert found.alpha_rmse == 0
    assert truth.plate.size == (48, 36)


def test_forty_scenes_without_photographs_and_clips():
    """Exact: every one can be read; the second ones have another seed and nothing else."""
    texts = bm.scenes.archive_scenes()
    assert len(texts) == 40
    assert "photo" not in "".join(texts.values())
    second = [name for name in texts if name.endswith("_2")]
    assert second
    for name in second:
        before, after = texts[name.removesuffix("_2")].splitlines(), texts[name].splitlines()
        changed = [pair for pair in zip(before, after, strict=True) if pair[0] != pair[1]]
        assert [line.partition(" = ")[0] for line, _ in changed] == ["seed"]


def test_a_wrong_scene_leaves_no_archive(tmp_path):
    """door."""
    with pytest.raises(FileError, match=r"bad.toml: size"):
        list(bm.scenes.save_archive(tmp_path / "a.zip", {"bad": "size = 3"}))
    assert not list(tmp_path.iterdir())


def test_the_scenes_of_an_archive_are_fixed(tmp_path):
    """door."""
    said = complaint(run("render", "easy", "--archive", "--out", tmp_path / "a.zip"))
    assert said.startswith("give --archive with --out FILE.zip alone")
    said = complaint(run("render", "--archive", "--out", tmp_path / "a.tar"))
    assert "an archive is written as .zip" in said


@pytest.mark.battery
def test_the_adapter_of_pymatting_gives_layers_that_are_scored(unpacked, tmp_path):
    """It finds the streak; alpha is that of closed-form matting, which takes its core for opaque."""
    from benchmarks.adapters.pymatting_trimap import main

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of PyMatting's compiled kernels
        main(unpacked, tmp_path)
    for name in ("ball", "ball_2"):
        answer = bm.scenes.read_answer(tmp_path / name)
        truth = bm.scenes.read_truth(unpacked / name)
        found = bm.scenes.score(answer, truth)
        assert found.alpha_rmse < 1
        assert found.false_alpha < 0.1
        seen = answer.layer.alpha > 0.2
        assert np.mean(truth.layer.alpha[seen] > 0) > 0.8
