"""The columns of the tables of clips and of rows of pictures: names, units, documentation."""

import re
from pathlib import Path

import pytest

from blurmatte.clips.table import FRAME_COLUMNS, PICTURE_COLUMNS, FrameRecord, PictureRecord
from blurmatte.motion import FrameMotion
from blurmatte.motion.clip.detections import CLIP_COLUMNS

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("columns", [CLIP_COLUMNS, FRAME_COLUMNS, PICTURE_COLUMNS])
def test_errors_have_the_unit_of_their_quantity_and_names_occur_once(columns):
    units = {column.name: column.unit for column in columns}
    assert len(units) == len(columns)
    for name, unit in units.items():
        assert unit == units[name.removesuffix("_std")], name


def test_a_record_without_a_result_has_every_column():
    """Exact: empty values, in the order of the columns; the edges of a box are four columns."""
    record = FrameRecord(3, 0.1, 1, 1, box=(5, 6, 7, 8))
    assert list(record.numbers()) == [column.name for column in FRAME_COLUMNS]
    assert [record.numbers()[name] for name in ("x0", "y0", "x1", "y1")] == [5, 6, 7, 8]
    assert FrameRecord(3, 0.1, 1, 1).numbers()["x1"] is None
    assert list(PictureRecord().numbers()) == [column.name for column in PICTURE_COLUMNS]
    empty = FrameMotion(3, 0.1, None, reason="nothing moved").numbers()
    assert list(empty) == [column.name for column in CLIP_COLUMNS]
    known = {name for name, value in empty.items() if value is not None}
    assert known == {"frame", "time", "others", "reason"}


def test_documentation_names_the_columns_of_pictures():
    text = (DOCS / "cli.md").read_text(encoding="utf-8")
    table = text.split("| column of `pictures.csv` | meaning |\n|---|---|\n")[1].split("\n\n")[0]
    named = []
    for line in table.splitlines():
        first, meaning = line.strip("|").split("|", 1)
        for name in re.findall(r"`([a-z]\w*)`", first):
            named += [name, f"{name}_std"] if "each with `_std`" in first else [name]
        units = {one.unit for one in PICTURE_COLUMNS if f"`{one.name}`" in first} - {""}
        assert all({"px": "pixels", "°": "degrees"}[unit] in meaning for unit in units)
    assert named == [column.name for column in PICTURE_COLUMNS]
