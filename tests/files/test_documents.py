"""JSON, TOML and headers of EXR files that no program of this package wrote."""

import json
import os

import numpy as np
import pytest
from tests.files.conftest import refusal

import blurmatte as bm
from blurmatte.files.documents import parse_json, parse_toml
from blurmatte.files.models import read_path
from blurmatte.matting import SolutionStats
from blurmatte.scenes import read_shots

HUGE = "1" + "0" * 400
MODEL = {"basis": [[1], [0], [0]], "covariance": np.zeros((3, 3)).tolist(), "evidence": {}}
NOISE = {"gain": [0.1] * 3, "read_std": [0.1] * 3, "relative_std": [0.1] * 3}
LENS = {"fx": 900, "fy": 900, "cx": 48, "cy": 36}
CURVE = {"name": "mine", "light": [0, 0.5, 1]}
PATH = {"xy": [[0, 0], [9, 9]], "t": [0, 1]}
READERS = [
    (bm.read_color_model, MODEL),
    (bm.read_noise, NOISE),
    (bm.read_intrinsics, LENS),
    (bm.read_transfer, CURVE),
    (read_path, PATH),
]


def refused(reader, path):
    """The message of a reader, one short line."""
    said = f"FILE: {refusal(path, reader=reader).replace(str(path), 'FILE')}"
    assert len(said) < 500
    return said


@pytest.mark.parametrize(("reader", "fields"), READERS)
def test_valid_documents_are_read(tmp_path, reader, fields):
    """exact: each of the documents that the tests below change."""
    (tmp_path / "a.json").write_text(json.dumps(fields))
    reader(tmp_path / "a.json")


@pytest.mark.parametrize(("reader", "fields"), READERS)
def test_unknown_keys_are_refused_by_every_reader(tmp_path, reader, fields):
    """door: the key, the file, and what is allowed, in at most 3 lines of 100 letters."""
    (tmp_path / "a.json").write_text(json.dumps({**fields, "unknown": [1, None]}))
    said = refused(reader, tmp_path / "a.json")
    assert said.startswith("FILE: rename or remove the unknown key 'unknown'; allowed are ")
    assert all(key in said for key in fields)
    assert len(said) < 300


@pytest.mark.parametrize(("reader", "fields"), READERS)
def test_misspelled_keys_are_refused_with_the_right_spelling(tmp_path, reader, fields):
    """door: each key of each document, its last two letters exchanged or one appended."""
    for key in fields:
        wrong = f"{key}s" if len(key) < 4 else f"{key[:-2]}{key[-1]}{key[-2]}"
        fields_now = {wrong if k == key else k: value for k, value in fields.items()}
        (tmp_path / "a.json").write_text(json.dumps({**fields, **fields_now}))
        said = refused(reader, tmp_path / "a.json")
        assert repr(wrong) in said
        assert len(key) < 3 or f"did you mean {key}" in said


def test_what_fits_wrote_stays_readable(tmp_path):
    """exact: files of a noise fit, and of a color model, have keys that only people read."""
    rank_and_hex = {**MODEL, "rank": 1, "hex": ["#ff0000"]}
    (tmp_path / "model.json").write_text(json.dumps(rank_and_hex))
    assert bm.read_color_model(tmp_path / "model.json").rank == 1
    fitted = {
        "sensor": {"gain": [1]},
        "rounding": {},
        "scale": [1.0],
        "coherence": {},
        "changed": 0.1,
    }
    (tmp_path / "noise.json").write_text(json.dumps({**NOISE, **fitted}))
    assert bm.read_noise(tmp_path / "noise.json").gain[0] == 0.1
    keys = "exposure_times noise agreement seen channel_difference channels_agree residuals std"
    (tmp_path / "curve.json").write_text(json.dumps({**CURVE, **dict.fromkeys(keys.split(), 1.0)}))
    assert bm.read_transfer(tmp_path / "curve.json").name == "mine"


@pytest.mark.parametrize("value", [HUGE, f"-{HUGE}", "NaN", "Infinity"])
def test_evidence_of_a_color_model_is_finite(tmp_path, value):
    """door: an integer beyond the range of floats, and what is no number."""
    text = json.dumps({**MODEL, "evidence": {"hue": "@"}}).replace('"@"', value)
    (tmp_path / "a.json").write_text(text)
    said = refused(bm.read_color_model, tmp_path / "a.json")
    assert "evidence.hue must be a number from 0 to 1.79769e+308" in said


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("pixels", HUGE, "pixels must be less than or equal to 1000000000000"),
        ("pixels", "1.5", "pixels must be a whole number"),
        ("sum_alpha", "NaN", "sum_alpha must be less than or equal to 1000000000000"),
        ("sum_alpha_std", "-1", "sum_alpha_std must be greater than or equal to 0"),
        ("streak_box", "[1, 2, 3]", "streak_box.3 is missing"),
        ("other_boxes", "[[1, 2, 3, 1e9]]", r"other_boxes\.0\.3 must be a whole number"),
        ("plate_noise", '{"median_std": -1}', "plate_noise"),
        ("grade", '"good"', "grade must be 'confirmed', 'plausible' or 'assumed'"),
        ("weights", "[0.5, 2]", r"weights\.1 must be less than or equal to 1"),
    ],
)
def test_statistics_of_a_solution_are_within_their_ranges(name, value, says):
    """door: one wrong value of each kind, of an EXR's header."""
    with pytest.raises(ValueError, match=says):
        parse_json(f'{{"{name}": {value}}}', SolutionStats)


@pytest.mark.parametrize(("reader", "fields"), READERS)
@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[" * 20000 + "]" * 20000, "recursion limit exceeded"),
        ('{"x": ' + "[" * 20000, "recursion limit exceeded"),
        ('{"x": 1' + "0" * 5000 + "}", "number out of range"),
        ("", "the file is empty"),
        ('"text"', "must be an object"),
        ("null", "must be an object"),
    ],
    ids=["deep list", "deep value", "5000 digits", "empty", "text", "null"],
)
def test_other_json_is_refused_by_every_reader(tmp_path, reader, fields, text, says):
    """door: what is wrong, in one line."""
    (tmp_path / "a.json").write_text(text)
    assert says in refused(reader, tmp_path / "a.json")


@pytest.mark.parametrize(("reader", "fields"), READERS)
@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity", HUGE, f"-{HUGE}", "1e999"])
def test_numbers_beyond_their_range_are_refused_by_every_reader(tmp_path, reader, fields, value):
    """door: each number of each key, one at a time; the message names the key and the range."""
    for key, old in fields.items():
        numbers = np.array(old, object)
        for place in np.ndindex(numbers.shape):
            if isinstance(numbers[place], str):
                continue
            new = numbers.copy()
            new[place] = "@"
            text = json.dumps({**fields, key: new.tolist()}).replace('"@"', value)
            (tmp_path / "a.json").write_text(text)
            assert f"({key} must be " in refused(reader, tmp_path / "a.json")


@pytest.mark.parametrize(
    ("reader", "fields", "says"),
    [
        (bm.read_intrinsics, {**LENS, "size": [1e5, 72]}, "size must be 2 whole numbers from 1 to"),
        (bm.read_intrinsics, {**LENS, "size": [0, 72]}, "size must be 2 whole numbers from 1 to"),
        (bm.read_intrinsics, {**LENS, "fx": True}, "fx must be a number from 0.001 to 1e+06"),
        (bm.read_intrinsics, {**LENS, "fx": "900"}, "fx must be a number from 0.001 to 1e+06"),
        (bm.read_intrinsics, {**LENS, "std": [[1]]}, "std must be n numbers from 0 to"),
        (bm.read_intrinsics, {"fx": 1}, "fy is missing"),
        (bm.read_intrinsics, MODEL, "it holds a color model"),
        (bm.read_noise, {**NOISE, "gain": [1, -1, 1]}, "gain must be 3 numbers from 0 to 1000"),
        (bm.read_noise, {**NOISE, "gain": [1, [1], 1]}, "gain must be 3 numbers from 0 to 1000"),
        (bm.read_noise, {"gain": [1, 1, 1]}, "read_std is missing"),
        (bm.read_noise, CURVE, "it holds a transfer curve"),
        (
            bm.read_color_model,
            {**MODEL, "covariance": np.diag([0, 0, -9.0]).tolist()},
            "covariance must have no negative variance, got -9",
        ),
        (
            bm.read_color_model,
            {**MODEL, "covariance": np.tri(3).tolist()},
            "covariance must be a symmetric matrix",
        ),
        (bm.read_color_model, {**MODEL, "evidence": {"hue": -1}}, "evidence.hue must be a number"),
        (bm.read_color_model, {**MODEL, "evidence": [1]}, "evidence must be an object"),
        (bm.read_transfer, {**CURVE, "name": 3}, "name must be a string, got 3"),
        (read_path, {**PATH, "radius": -1}, "radius must be a number from 0 to 1e+06, got -1"),
    ],
)
def test_refusal_names_key_and_range(tmp_path, reader, fields, says):
    """door: one wrong value of each kind."""
    (tmp_path / "a.json").write_text(json.dumps(fields))
    assert says in refused(reader, tmp_path / "a.json")


@pytest.mark.parametrize("reader", [*(reader for reader, _ in READERS), read_shots])
def test_files_that_are_no_text_are_refused_by_every_reader(tmp_path, reader):
    """door: a loop of links, a pipe, a folder, bytes, and more bytes than the limit."""
    loop = tmp_path / "loop.json"
    loop.symlink_to(loop)
    assert "cannot be read (Too many levels" in refused(reader, loop)
    os.mkfifo(tmp_path / "pipe.json")
    assert "FILE: " in refused(reader, tmp_path / "pipe.json")
    assert "this is a folder" in refused(reader, tmp_path)
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    assert "no text in UTF-8" in refused(reader, tmp_path / "bytes.json")
    with (tmp_path / "long.json").open("wb") as file:
        file.truncate(1 << 27)
    assert "more than the limit of 67108864 bytes" in refused(reader, tmp_path / "long.json")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x = " + "[" * 2000 + "]" * 2000, "nest"),
        (
            "body = { radius = inf }",
            "body.radius must be a number from -100000 to 100000, got inf",
        ),
        ("path = [1, nan]", "path.1 must be a number"),
        (f"size = [{HUGE}, 2]", "size.0 must be a number"),
        ("seed = 99999999999999999999", "seed must be a number from"),
        ("x = 1" + "0" * 5000, "limit"),
    ],
)
def test_toml_that_holds_no_scene_is_refused(text, says):
    """door: what is wrong, by its key."""
    with pytest.raises(ValueError, match=says):
        parse_toml(text)


def test_seeds_may_have_63_bits():
    """exact."""
    assert parse_toml(f"seed = {2**63 - 1}") == {"seed": 2**63 - 1}
