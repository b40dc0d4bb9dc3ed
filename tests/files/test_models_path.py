"""Paths as JSON."""

import pytest
from numpy.testing import assert_allclose

from blurmatte.errors import FileError
from blurmatte.files import path_to_mapping, read_path, write
from blurmatte.trajectory import Trajectory


@pytest.mark.parametrize("radius", [None, 7.5])
def test_path_round_trips(tmp_path, radius):
    path = Trajectory.bounce((1, 2), (30.25, 4), (50, 1), at=0.3)
    write(tmp_path / "path.json", path_to_mapping(path, radius))
    again, size = read_path(tmp_path / "path.json")
    assert_allclose(again.xy, path.xy)
    assert_allclose(again.t, path.t)
    assert size == radius


@pytest.mark.parametrize("text", ["[]", "{}", "nothing", '{"xy": [[1, 2]], "t": [0]}'])
def test_other_json_is_rejected(tmp_path, text):
    (tmp_path / "path.json").write_text(text)
    with pytest.raises(FileError, match=r"path.json: give .*; the file holds no path"):
        read_path(tmp_path / "path.json")


def test_missing_file_is_named(tmp_path):
    with pytest.raises(FileError, match=r"nowhere.json: check the name; there is no such file"):
        read_path(tmp_path / "nowhere.json")
