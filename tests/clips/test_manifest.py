"""The append-only record of a run."""

import pytest

from blurmatte.clips.manifest import NAME, key_of, opened_manifest


def test_lines_are_read_again_and_a_cut_off_one_is_not(tmp_path):
    with opened_manifest(tmp_path, "a") as manifest:
        manifest.append("seen", {"frame": 1, "x": 0.1})
        manifest.append("layer", {"frame": 1})
    with (tmp_path / NAME).open("a") as file:
        file.write('{"layer": {"fra')
    with opened_manifest(tmp_path, "a") as manifest:
        assert list(manifest.of_kind("seen")) == [{"frame": 1, "x": 0.1}]
        assert list(manifest.of_kind("layer")) == [{"frame": 1}]
        manifest.append("layer", {"frame": 2})
    with opened_manifest(tmp_path, "a") as manifest:
        assert [one["frame"] for one in manifest.of_kind("layer")] == [1, 2]


def test_other_inputs_begin_anew(tmp_path):
    with opened_manifest(tmp_path, "a") as manifest:
        manifest.append("layer", {"frame": 1})
    with opened_manifest(tmp_path, "b") as manifest:
        assert manifest.lines == []


@pytest.mark.parametrize("text", ["", "no JSON\n", '{"key": "a"'])
def test_damaged_manifest_begins_anew(tmp_path, text):
    (tmp_path / NAME).write_text(text)
    with opened_manifest(tmp_path, "a") as manifest:
        assert manifest.lines == []


def test_key_depends_on_contents_and_settings(tmp_path):
    path = tmp_path / "clip"
    path.write_bytes(b"one")
    key = key_of([path], {"several": False})
    assert key == key_of([path], {"several": False})
    assert key != key_of([path], {"several": True})
    path.write_bytes(b"two")
    assert key != key_of([path], {"several": False})
