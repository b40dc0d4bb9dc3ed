"""Rows of a clip as tables of other programs, each as its documentation states it.

=================  =========================================================================
.napari.csv        napari: a row for each point, `track_id`, `t`, `y`, `x`, then all other numbers
.trackmate.xml     TrackMate: spots with their radius in frames, and the edges of each track
.kinovea.txt       Kinovea: its export of trajectories as text, time and place
.tracker.txt       Tracker (Open Source Physics): a data track of one object, y upwards
=================  =========================================================================

Of rows without the object nothing is written. Errors have a place only in napari's table.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import groupby, pairwise
from operator import itemgetter
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from blurmatte.files.documents import rows_to_csv
from blurmatte.formats import KINOVEA, NAPARI, TRACKER, TRACKMATE

Rows = Sequence[Mapping[str, Any]]
_NEEDED = "frame", "time", "object", "track", "x", "y", "radius"


def tracker_formats(rows: Rows) -> Mapping[str, Callable[[], str]]:
    """What writes the text of each format, by the end of the name; none if these are no tracks."""
    if not all(name in rows[0] for name in _NEEDED):
        return {}
    return {
        NAPARI: lambda: _napari(rows),
        TRACKMATE: lambda: _trackmate(rows),
        KINOVEA: lambda: _kinovea(rows),
        TRACKER: lambda: _tracker(rows),
    }


def _seen(rows: Rows) -> dict[int, list[Mapping[str, Any]]]:
    """The rows with a place, by the number of the track."""
    tracks: dict[int, list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["x"] is not None:
            tracks.setdefault(row["track"] or 0, []).append(row)
    return {number: tracks[number] for number in sorted(tracks)}


def _napari(rows: Rows) -> str:
    """The data of a Tracks layer, sorted by track and frame, and its features."""
    lines = []
    for number, track in _seen(rows).items():
        for row in track:
            place = {"track_id": number, "t": row["frame"], "y": row["y"], "x": row["x"]}
            used = ("track", "frame", "y", "x", "reason")
            lines.append(place | {name: row[name] for name in row if name not in used})
    return rows_to_csv(lines) if lines else "track_id,t,y,x\n"


def _trackmate(rows: Rows) -> str:
    """A model of TrackMate: spots by frame, and edges between the spots of a track."""
    tracks = _seen(rows)
    spots = [row for track in tracks.values() for row in track]
    numbers = {id(row): k for k, row in enumerate(spots)}
    timed = all(row["time"] is not None for row in spots)
    root = Element("TrackMate", {"version": "7.11.1"})
    units = {"spatialunits": "pixel", "timeunits": "sec" if timed else "frame"}
    model = SubElement(root, "Model", units)
    declared = SubElement(model, "FeatureDeclarations")
    for kind, features in _FEATURES.items():
        of_kind = SubElement(declared, kind)
        for feature in features:
            _add(of_kind, "Feature", dict(zip(_FEATURE, feature, strict=True)))
    shown = _add(model, "AllSpots", {"nspots": len(spots)})
    by_frame = itemgetter("frame")
    for frame, seen in groupby(sorted(spots, key=by_frame), by_frame):
        in_frame = _add(shown, "SpotsInFrame", {"frame": frame})
        for row in seen:
            k = numbers[id(row)]
            values: dict[str, object] = {"ID": k, "name": f"ID{k}", "QUALITY": 1.0}
            values |= {"POSITION_X": row["x"], "POSITION_Y": row["y"], "POSITION_Z": 0.0}
            values |= {"POSITION_T": _time(row), "FRAME": frame}
            _add(in_frame, "Spot", values | {"RADIUS": row["radius"], "VISIBILITY": 1})
    linked, filtered = SubElement(model, "AllTracks"), SubElement(model, "FilteredTracks")
    for number, track in tracks.items():
        if len(track) > 1:
            name = {"name": f"Track_{number}", "TRACK_ID": number, "TRACK_INDEX": number}
            of_track = _add(linked, "Track", name)
            for a, b in pairwise(track):
                ends = {"SPOT_SOURCE_ID": numbers[id(a)], "SPOT_TARGET_ID": numbers[id(b)]}
                _add(of_track, "Edge", ends)
            _add(filtered, "TrackID", {"TRACK_ID": number})
    indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{tostring(root, "unicode")}\n'


def _kinovea(rows: Rows) -> str:
    """The text that Kinovea exports for Gnuplot: an empty line between trajectories."""
    parts = [
        "".join(f"{_time(row)} {row['x']} {row['y']}\n" for row in track)
        for track in _seen(rows).values()
    ]
    return "#Kinovea Trajectory data export\n#T X Y\n" + "\n".join(parts)


def _tracker(rows: Rows) -> str:
    """A data track: names of columns, then numbers, separated by tabs.

    Its pictures have the origin in the corner of the first pixel, and y upwards.
    """
    objects = {row["object"] for row in rows if row["x"] is not None}
    if len(objects) > 1:
        raise ValueError(
            f"a data track of Tracker holds one object, got {len(objects)}; write .trackmate.xml, or "
            "choose the rows of one object"
        )
    lines = [
        f"{_time(row)}\t{row['x'] + 0.5}\t{-(row['y'] + 0.5)}\n"
        for row in rows
        if row["x"] is not None
    ]
    return "t\tx\ty\n" + "".join(lines)


def _time(row: Mapping[str, Any]) -> Any:
    """The time of a row in seconds; its frame if that is not known."""
    return row["frame"] if row["time"] is None else row["time"]


def _add(parent: Element, tag: str, values: Mapping[str, object]) -> Element:
    """A new element of XML with these attributes."""
    return SubElement(parent, tag, {name: str(value) for name, value in values.items()})


_FEATURE = "feature", "name", "shortname", "dimension", "isint"
_FEATURES = {
    "SpotFeatures": (
        ("QUALITY", "Quality", "Quality", "QUALITY", "false"),
        ("POSITION_X", "X", "X", "POSITION", "false"),
        ("POSITION_Y", "Y", "Y", "POSITION", "false"),
        ("POSITION_Z", "Z", "Z", "POSITION", "false"),
        ("POSITION_T", "T", "T", "TIME", "false"),
        ("FRAME", "Frame", "Frame", "NONE", "true"),
        ("RADIUS", "Radius", "R", "LENGTH", "false"),
        ("VISIBILITY", "Visibility", "Visibility", "NONE", "true"),
    ),
    "EdgeFeatures": (
        ("SPOT_SOURCE_ID", "Source spot ID", "Source ID", "NONE", "true"),
        ("SPOT_TARGET_ID", "Target spot ID", "Target ID", "NONE", "true"),
    ),
    "TrackFeatures": (
        ("TRACK_ID", "Track ID", "ID", "NONE", "true"),
        ("TRACK_INDEX", "Track index", "Index", "NONE", "true"),
    ),
}
