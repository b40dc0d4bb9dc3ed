"""The append-only record of a run."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from tests.motion.clip.sightings import sighted

from blurmatte.clips.manifest import Finished, key_of, opened_manifest
from blurmatte.clips.table import FrameRecord
from blurmatte.errors import FileError
from blurmatte.motion import FrameMotion, FrameSightings

SEEN = Finished(1, seen=FrameSightings(1, 0.04, (), "nothing moved"))
LAYER = Finished(1, layer=FrameRecord(1, 0.04, 1, 1, x=3.5, box=(1, 2, 3, 4), layer="layer.exr"))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "folder" / "manifest.jsonl"


def test_lines_are_read_again_and_a_cut_off_one_is_not(path):
    with opened_manifest(path, "a", Finished) as manifest:
        manifest.append(SEEN)
        manifest.append(LAYER)
    with path.open("a") as file:
        file.write('00000000 {"shot": 1, "la')
    second = replace(SEEN, shot=2)
    with opened_manifest(path, "a", Finished) as manifest:
        assert manifest.finished == [SEEN, LAYER]
        manifest.append(second)
    with opened_manifest(path, "a", Finished) as manifest:
        assert manifest.finished == [SEEN, LAYER, second]


def test_detections_are_read_again_with_all_numbers(path):
    """Exact: each number of the row, and what the next frames are linked by; None where none is."""
    one = replace(sighted((3.1, 4.2), (-5.0, 0.3), doubts=("Hidden.",)), path_scatter=1.5)
    accelerated = replace(one.measured, acceleration=np.array([0.1, 1 / 3]), exposure_time=0.01)
    frame = FrameSightings(2, None, (one, replace(one, measured=accelerated)), "a", 3)
    with opened_manifest(path, "a", Finished) as manifest:
        manifest.append(Finished(1, seen=frame))
    with opened_manifest(path, "a", Finished) as manifest:
        (line,) = manifest.finished
    assert replace(line.seen, found=()) == replace(frame, found=())
    for a, b in zip(line.seen.found, frame.found, strict=True):
        assert FrameMotion(2, None, a).numbers() == FrameMotion(2, None, b).numbers()
        assert a.measured.numbers() == b.measured.numbers()
        assert_array_equal(a.measured.covariance, b.measured.covariance)
        assert (a.measured.size, a.backward) == (b.measured.size, b.backward)


def test_other_inputs_begin_anew(path):
    with opened_manifest(path, "a", Finished) as manifest:
        manifest.append(SEEN)
    with opened_manifest(path, "b", Finished) as manifest:
        assert manifest.finished == []


@pytest.mark.parametrize("text", ["", "no JSON\n", '{"key": "a"', '{"key": "a"}\n{"shot": 1.5}\n'])
def test_damaged_manifest_begins_anew(path, text):
    path.parent.mkdir()
    path.write_text(text)
    with opened_manifest(path, "a", Finished) as manifest:
        assert manifest.finished == []


def test_changed_values_are_damage(path):
    with opened_manifest(path, "a", Finished) as manifest:
        manifest.append(SEEN)
        manifest.append(LAYER)
    path.write_text(path.read_text().replace("3.5", "9.5"))
    with opened_manifest(path, "a", Finished) as manifest:
        assert manifest.finished == [SEEN]


def test_manifest_without_finished_frames_is_removed(path):
    with pytest.raises(KeyError), opened_manifest(path, "a", Finished):
        raise KeyError
    assert not path.exists()


def test_manifest_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(FileError, match="check the folder"),
        opened_manifest(tmp_path / "file/manifest.jsonl", "a", Finished),
    ):
        pass


def test_key_depends_on_contents_and_settings(tmp_path):
    path = tmp_path / "clip"
    path.write_bytes(b"one")
    key = key_of([path], {"several": False})
    assert key == key_of([path], {"several": False})
    assert key != key_of([path], {"several": True})
    path.write_bytes(b"two")
    assert key != key_of([path], {"several": False})
