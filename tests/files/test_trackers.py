"""Tables of tracks for other programs, read as their documentation says."""

import csv
import io
from xml.etree import ElementTree

import pytest

from blurmatte.errors import FileError
from blurmatte.files.writing import write


def rows(objects=2):
    """Two objects, the second in two frames; a frame without either."""
    found = [
        {"frame": 10 + k, "time": k / 25, "object": n, "track": n, "x": 4.0 * k + n, "y": 3.0 * n}
        | {"radius": 2.5, "x_std": 0.125, "doubts": 'a "b" & <c>'}
        for n in range(1, objects + 1)
        for k in range(4 - n)
    ]
    return [*found, dict.fromkeys(found[0]) | {"frame": 14, "time": 0.16, "doubts": ""}]


def written(tmp_path, ending, table):
    write(tmp_path / f"rally{ending}", table)
    return (tmp_path / f"rally{ending}").read_text(encoding="utf-8")


def test_napari_gets_sorted_tracks_with_their_errors(tmp_path):
    """Exact"""
    table = list(csv.DictReader(io.StringIO(written(tmp_path, ".napari.csv", rows()[::-1]))))
    places = [[float(row[c]) for c in ("track_id", "t", "y", "x")] for row in table]
    assert sorted(places) == [
        *([1, 10, 3, 1], [1, 11, 3, 5], [1, 12, 3, 9]),
        *([2, 10, 6, 2], [2, 11, 6, 6]),
    ]
    assert [place[0] for place in places] == [1, 1, 1, 2, 2]
    assert {row["x_std"] for row in table} == {"0.125"}


def test_trackmate_gets_spots_and_edges(tmp_path):
    """Exact: every edge joins spots of following frames of one track."""
    root = ElementTree.fromstring(written(tmp_path, ".trackmate.xml", rows()).encode())
    model = root.find("Model")
    assert model.attrib == {"spatialunits": "pixel", "timeunits": "sec"}
    spots = {spot.get("ID"): spot for spot in model.iter("Spot")}
    assert model.find("AllSpots").get("nspots") == str(len(spots)) == "5"
    frames = [group.get("frame") for group in model.iter("SpotsInFrame")]
    assert frames == ["10", "11", "12"]
    for group in model.iter("SpotsInFrame"):
        assert {spot.get("FRAME") for spot in group} == {group.get("frame")}
    assert [float(spots["1"].get(f"POSITION_{axis}")) for axis in "XYZT"] == [5, 3, 0, 0.04]
    assert float(spots["1"].get("RADIUS")) == 2.5
    edges = {
        track.get("TRACK_ID"): [
            [int(spots[edge.get(end)].get("FRAME")) for end in ("SPOT_SOURCE_ID", "SPOT_TARGET_ID")]
            for edge in track
        ]
        for track in model.iter("Track")
    }
    assert edges == {"1": [[10, 11], [11, 12]], "2": [[10, 11]]}
    assert [one.get("TRACK_ID") for one in model.iter("TrackID")] == ["1", "2"]
    declared = {one.get("feature") for one in model.find("FeatureDeclarations/SpotFeatures")}
    assert declared | {"ID", "name"} == set(spots["0"].attrib)


def test_kinovea_gets_times_and_places_with_a_line_between_trajectories(tmp_path):
    """Exact"""
    text = written(tmp_path, ".kinovea.txt", rows())
    head, _, body = text.partition("#T X Y\n")
    assert head == "#Kinovea Trajectory data export\n"
    first, second = body.split("\n\n")
    assert [list(map(float, line.split())) for line in first.splitlines()] == [
        *([0, 1, 3], [0.04, 5, 3], [0.08, 9, 3]),
    ]
    assert len(second.splitlines()) == 2


def test_tracker_gets_one_object_with_y_upwards(tmp_path):
    """Exact: from the corner of the first pixel."""
    lines = written(tmp_path, ".tracker.txt", rows(1)).splitlines()
    assert lines[0].split("\t") == ["t", "x", "y"]
    assert [float(value) for value in lines[2].split("\t")] == [0.04, 5.5, -3.5]
    with pytest.raises(ValueError, match=r"holds one object, got 2; write .trackmate.xml"):
        write(tmp_path / "two.tracker.txt", rows())
    assert not (tmp_path / "two.tracker.txt").exists()


@pytest.mark.parametrize(
    "ending", [".napari.csv", ".trackmate.xml", ".kinovea.txt", ".tracker.txt"]
)
def test_frames_without_an_object_give_an_empty_table(ending, tmp_path):
    assert "14" not in written(tmp_path, ending, rows()[-1:])


def test_frames_stand_for_times_that_are_not_known(tmp_path):
    """Exact"""
    table = [row | {"time": None} for row in rows(1)]
    assert 'timeunits="frame"' in written(tmp_path, ".trackmate.xml", table)
    assert written(tmp_path, ".kinovea.txt", table).splitlines()[2].split()[0] == "10"


def test_other_tables_are_no_tracks(tmp_path):
    """door."""
    with pytest.raises(FileError, match=r"is written as \.csv or \.json or \.parquet$"):
        write(tmp_path / "a.trackmate.xml", [{"x": 1.0}])
    write(tmp_path / "a.napari.csv", [{"x": 1.0}])  # the name of any table may have a dot
    assert (tmp_path / "a.napari.csv").read_text() == "x\n1.0\n"
