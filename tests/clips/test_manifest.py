"""The append-only record of a run."""

from dataclasses import replace

import pytest

from blurmatte.clips.manifest import Finished, key_of, opened_manifest
from blurmatte.clips.table import FrameRecord
from blurmatte.errors import FileError
from blurmatte.motion import FrameSightings

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
