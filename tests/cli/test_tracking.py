"""blurmatte track: table, sheet, resumption, and errors of one line."""

import csv
import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from PIL import Image
from tests import commands
from tests.motion.clip.sightings import sighted
from tests.scenes import on_line

import blurmatte as bm
from blurmatte.explain.clip import clip_in_words
from blurmatte.motion import Workers
from blurmatte.motion.clip.measure import Detector
from blurmatte.motion.clip.summary import KnownQuantities, clip_table
from blurmatte.rendering import colorful_plate

FRAMES, COLOR, HEX = 5, (0.7, 0.95, 0.05), "#dafa40"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Five pictures of a ball that goes to the left, faster and faster, and their plate."""
    folder = tmp_path_factory.mktemp("clip")
    scene, rng = colorful_plate((128, 96), 2, tile=24), np.random.default_rng(1)
    camera = bm.rendering.Camera(code_std=1 / 255)
    for k in range(FRAMES):
        x = 100 - 12 * k - 2 * k * k
        light = on_line(
            scene, (x + 5 + k, 50), (x - 5 - k, 50), bm.rendering.Ball(8, color=COLOR)
        ).image.rgb
        bm.write(folder / f"f{k}.png", camera.photograph(light, rng))
    bm.write(folder / "plate.exr", camera.photograph(scene, rng))
    bm.write(folder / "color.json", bm.ColorModel.from_hex(HEX))
    return folder


def run(folder, *options):
    """Run `blurmatte track` on the pictures."""
    given = ["--plate", folder / "plate.exr", "--color", HEX, "--transfer", "srgb", *options]
    return commands.run("track", folder / "f*.png", *given)


@pytest.fixture
def track(folder):
    return partial(run, folder)


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_table_matches_rendered_motion(track, tmp_path):
    """Oracle: rendered positions in all frames, the direction of time, meters per second."""
    result = track(
        "--out", tmp_path / "t.csv", "--rate", 25, "--diameter", "16mm", "--exposure", "1/100"
    )
    assert (result.exit_code, result.stderr) == (0, "")
    assert "Found in 5 of 5 frames, in 1 track" in result.stdout
    rows = rows_of(tmp_path / "t.csv")
    assert [row["frame"] for row in rows] == list("01234")
    for k, row in enumerate(rows):
        assert float(row["time"]) == pytest.approx(k / 25)
        assert abs(float(row["x"]) - (100 - 12 * k - 2 * k * k)) < 5 * float(row["x_std"])
        assert abs(float(row["vx"]) + 10 + 2 * k) < 5 * float(row["vx_std"])
        assert float(row["speed"]) == pytest.approx((10 + 2 * k) / 10, rel=0.05)
        assert (row["speed_unit"], row["directed"], row["reason"]) == ("m/s", "True", "")
    assert not (tmp_path / "t.csv.unfinished").exists()


def turned_left(seen):
    """Of a sensor whose next row lies to the left."""
    return replace(seen, measured=replace(seen.measured, readout="left"))


def test_speed_allows_for_rolling_shutter():
    """Exact: length / (T + τ Δy); half of the correction if the direction is unknown."""
    ends = (30, 0), (90, 80)
    down = sighted((60, 40), (6, 8), length=100.0, length_std=0.0, ends=ends)
    seen = [(down, True), (down.reversed, True), (down, False), (None, None)]
    rows = [bm.motion.FrameMotion(k, None, s, 1, directed) for k, (s, directed) in enumerate(seen)]
    known = KnownQuantities(exposure=(0.01, 0.0), line_time=2e-5)
    lines = clip_table(rows, None, [], known)
    fast = 100 / 0.0084
    slow = 100 / 0.0116
    assert [line["speed"] for line in lines] == pytest.approx([slow, fast, (slow + fast) / 2, None])
    stds = [line["speed_std"] for line in lines[:3]]
    assert stds == pytest.approx([0, 0, (fast - slow) / 2], abs=1e-9)
    per_exposure = clip_table(rows, None, [], replace(known, exposure=None))
    assert [line["speed"] for line in per_exposure[:3]] == [100.0] * 3
    turned = [replace(row, sighting=s and turned_left(s))
              for row, (s, _) in zip(rows, seen, strict=True)]  # fmt: skip
    speeds = [line["speed"] for line in clip_table(turned, None, [], known)[:2]]
    assert speeds == pytest.approx([100 / 0.0088, 100 / 0.0112])  # 60 columns from right to left
    impossible = clip_table(rows, None, [], replace(known, line_time=2e-4))
    assert impossible[1]["speed"] is None
    assert impossible[2]["speed"] == pytest.approx(100 / 0.026)


def test_text_says_why_frames_are_empty():
    reasons = ["", "nothing moved", "the plate is not known", "nothing moved"]
    seen = sighted((60, 40), (6, 8), length=100.0)
    rows = [bm.motion.FrameMotion(0, 0.0, seen, 1)]
    rows += [bm.motion.FrameMotion(k, k / 25, None, reason=reasons[k]) for k in (1, 2, 3)]
    for some in rows, rows[1:]:
        said = clip_in_words(some, "#ffffff", several=False)
        assert said[-1] == "Frames without it: nothing moved (2), the plate is not known (1)."
    assert "without it" not in " ".join(clip_in_words(rows[:1], "#ffffff", several=False))


def test_frame_at_border_states_a_doubt_and_no_speed():
    """Exact: no speed of what the border cuts, in the picture as in space; other frames keep theirs."""
    seen = sighted((60, 40), (6, 8), length=100.0)
    cut = replace(seen, measured=replace(seen.measured, at_border=True))
    rows = [bm.motion.FrameMotion(k, k / 25, one, 1) for k, one in enumerate((seen, cut))]
    known = KnownQuantities(exposure=(0.01, 0.0))
    lines = clip_table(rows, None, [], known)
    assert [line["speed"] for line in lines] == [pytest.approx(1e4), None]
    assert [line["speed_std"] is None for line in lines] == [False, True]
    assert lines[0]["doubts"] == ""
    assert lines[1]["doubts"].startswith("It reaches the border of the picture")
    assert "1 is doubtful" in clip_in_words(rows, "#ffffff", several=False)[1]
    assert [not row.sighting.is_sound for row in rows] == [bool(line["doubts"]) for line in lines]
    lens = bm.Intrinsics.from_focal_length(28, (1000, 1000), sensor_width=36)
    places = bm.motion.places_in_space(rows, lens, radius=0.02)
    assert [place.doubted for place in places] == [False, True]
    in_space = clip_table(rows, places, [], replace(known, lens=lens))
    assert [line["speed"] is None for line in in_space] == [False, True]


def test_all_file_formats_agree(track, tmp_path):
    """Exact: CSV, JSON, Parquet and the output."""
    from pyarrow.parquet import read_table

    printed = json.loads(track("--json", "--out", tmp_path / "t.json").stdout)["rows"]
    track("--out", tmp_path / "t.csv")
    track("--out", tmp_path / "t.parquet")
    assert json.loads((tmp_path / "t.json").read_text()) == printed
    assert read_table(tmp_path / "t.parquet").to_pylist() == printed
    as_text = [{k: "" if v is None else str(v) for k, v in row.items()} for row in printed]
    assert rows_of(tmp_path / "t.csv") == as_text


def test_resumes_interrupted_run(track, tmp_path, monkeypatch):
    """Exact: interrupted after two frames, truncated within a line and resumed: the same table."""
    out, begun = tmp_path / "t.csv", tmp_path / "t.csv.unfinished"
    track("--out", out)
    whole = out.read_bytes()
    out.unlink()
    real = Detector.over

    def interrupted(*args):
        for k, seen in enumerate(real(*args)):
            if k == 2:
                raise KeyboardInterrupt
            yield seen

    monkeypatch.setattr(Detector, "over", interrupted)
    stopped = track("--out", out)
    assert (stopped.exit_code, stopped.stderr.count("\n")) == (130, 1)
    assert f"{begun}: keeps the finished frames; run the same again" in stopped.stderr
    assert not out.exists()
    begun.write_text(begun.read_text() + '{"frame": 2, "ti')
    skipped = []
    monkeypatch.setattr(Detector, "over", lambda *a: skipped.append(a[-1]) or real(*a))
    assert track("--out", out).exit_code == 0
    assert skipped == [2]
    assert out.read_bytes() == whole
    assert not begun.exists()


@pytest.fixture(scope="module")
def finished(folder, tmp_path_factory):
    """Bytes of a journal that holds all frames, and of their table."""
    out = tmp_path_factory.mktemp("finished") / "t.csv"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("blurmatte.cli.clips.remove_unfinished", lambda path: None)
        run(folder, "--out", out)
    return out.with_name("t.csv.unfinished").read_bytes(), out.read_bytes()


def journal(finished, folder):
    """Path of a table that is not there yet, the journal of its run, and what it will hold."""
    (folder / "t.csv.unfinished").write_bytes(finished[0])
    return folder / "t.csv", folder / "t.csv.unfinished", finished[1]


@pytest.mark.parametrize(
    ("kept", "first_new"), [(0, 0), (1, 0), (-1, 0), (2, 1), (-2, 1), (3, 2), (-3, 2), (4, 3)]
)
def test_damaged_journal_costs_the_frames_after_the_damage(
    track, finished, tmp_path, monkeypatch, kept, first_new
):
    """Exact: cut after so many lines, or damaged in the line after; an empty one blocks nothing."""
    out, begun, whole = journal(finished, tmp_path)
    lines = begun.read_bytes().splitlines(keepends=True)
    start = b"".join(lines[: abs(kept)])
    begun.write_bytes(start if kept >= 0 else start + b'\0{"frame": \xff\n' + lines[-1])
    real, skipped = Detector.over, []
    monkeypatch.setattr(Detector, "over", lambda *a: skipped.append(a[-1]) or real(*a))
    assert track("--out", out).exit_code == 0
    assert skipped == [first_new]
    assert out.read_bytes() == whole
    assert not begun.exists()


def test_other_options_begin_anew(track, finished, tmp_path, monkeypatch):
    out, begun, whole = journal(finished, tmp_path)
    real, skipped = Detector.over, []
    monkeypatch.setattr(Detector, "over", lambda *a: skipped.append(a[-1]) or real(*a))
    assert track("--out", out, "--frames", "::2").exit_code == 0
    assert skipped == [0]
    assert out.read_bytes() != whole
    assert not begun.exists()


def test_failed_run_without_finished_frames_leaves_no_journal(track, tmp_path, monkeypatch):
    def fails(*args, **options):
        raise ValueError("Singular matrix")
        yield

    monkeypatch.setattr(Detector, "over", fails)
    assert track("--out", tmp_path / "t.csv").exit_code == 2
    assert list(tmp_path.iterdir()) == []


def test_draws_sheet_of_clip(track, tmp_path, folder):
    """Exact: written, with a color from a file."""
    path = tmp_path / "path.png"
    result = track("--overlay", path, "--color", folder / "color.json", "--frames", ":2")
    assert "Found in 2 of 2 frames" in result.stdout
    assert "No fall to check" in result.stdout
    with Image.open(path) as sheet:
        assert sheet.width == 1800


def test_follows_several_objects(track, tmp_path):
    """Exact: for one object the same table; each object has sentences and a fall."""
    track("--out", tmp_path / "one.csv", "--rate", 25)
    answer = json.loads(track("--several", "--json", "--rate", 25, "--gravity", 9.81).stdout)
    track("--out", tmp_path / "all.csv", "--rate", 25, "--several")
    assert (tmp_path / "all.csv").read_bytes() == (tmp_path / "one.csv").read_bytes()
    assert [row["object"] for row in answer["rows"]] == [1] * FRAMES
    assert answer["falls"][0]["fits"]
    assert "meters_per_pixel" not in answer["falls"][0]
    assert answer["falls"][0]["object"] == 1
    assert answer["falls"][0]["off"] == []
    assert "points 90° off" in answer["falls"][0]["rejection"]
    words = " ".join(answer["in_words"])
    assert "Found in 5 of 5 frames, 1 object:" in words
    assert "Object 1: in 5 frames, 0 to 4. Radius" in words
    assert "Gravity was not used: no free fall that gravity" in words
    none = json.loads(
        track("--several", "--least", 6, "--json", "--overlay", tmp_path / "a.png").stdout
    )
    assert none["falls"] == []
    assert {row["object"] for row in none["rows"]} == {None}


def test_gravity_gives_scale(track, tmp_path):
    """Oracle: a camera on its side; a given scale is checked; downwards the fall is rejected."""
    asked = "--rate", 25, "--gravity", "-9.81,0±0.01", "--json"
    answer = json.loads(track(*asked, "--exposure", "1/100").stdout)
    scale, std = (answer["fall"][name] for name in ("meters_per_pixel", "meters_per_pixel_std"))
    assert abs(scale - 9.81 / (4 * 25**2)) < 4 * std
    fall = answer["fall"]
    for row in answer["rows"]:
        t = row["time"] - fall["time"]
        x = fall["place_x"] + fall["velocity_x"] * t + fall["acceleration_x"] * t**2 / 2
        assert abs(row["x"] - x) < 5 * row["x_std"]
    assert answer["rows"][0]["speed"] == pytest.approx(10 * scale * 100, rel=0.05)
    fall = json.loads(track(*asked, "--scale", "1mm").stdout)["fall"]
    assert fall["lengths_by_gravity"] == pytest.approx(1000 * scale)
    unused = track("--rate", 25, "--gravity", "9.81m/s²", "--out", tmp_path / "t.csv")
    assert unused.exit_code == 0
    (line,) = (line for line in unused.stdout.splitlines() if "Gravity was not used" in line)
    assert "points 90° off gravity" in line
    track("--rate", 25, "--out", tmp_path / "same.csv")
    assert (tmp_path / "t.csv").read_bytes() == (tmp_path / "same.csv").read_bytes()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--gravity", "1,2,3,4"), "--gravity must be 9.81, x,y or x,y,z in m/s²"),
        (("--gravity", "9.81km"), "--gravity must be 9.81, x,y or x,y,z in m/s²"),
        (("--frames", "0:9:0"), "--frames must have a step of at least 1"),
        (("--frames", "9:"), "--frames selects no frame"),
        (("--frames", "x:"), "--frames must have frames as a number"),
        (("--out", "t.txt"), "a table is written as .csv or .json or .parquet"),
        (("--least", 2), "--least needs --several"),
        (("--several", "--least", 0), "--least must be at least 1, got 0"),
        (("--going", "up"), "No such option: --going"),
        (("--line-time", "fast"), "--line-time must be a time with its unit"),
        (("--line-time", "15ms", "--rate", 25), "give --line-time with its unit, like 15us"),
        (("--color", "greenish"), "greenish"),
        (("--rate", -1), "--rate must be frames per second"),
        (("--workers", 0), "workers must be at least 1"),
        (("--radius", "0"), "--radius must be above 0, got '0'"),
        (("--diameter", "-4cm"), "--diameter must be above 0, got '-4cm'"),
        (("--exposure", "4s", "--rate", 25), "4 s is longer than a frame, 0.04 s"),
        (("--exposure", "0"), "--exposure must be above 0, got '0'"),
        (("--exposure", "-1/60"), "--exposure must be above 0, got '-1/60'"),
        (("--plate", "nowhere.exr"), "nowhere.exr"),
        (("--overlay", "sheet.txt", "--frames", ":1"), "change the ending"),
    ],
)
def test_track_refuses_in_one_line(track, options, said, tmp_path, monkeypatch):
    """Door."""
    monkeypatch.chdir(tmp_path)
    assert said in commands.complaint(track(*options))


def test_starts_no_more_processes_than_frames(track, monkeypatch):
    """Exact."""
    asked = []
    monkeypatch.setattr(bm.motion, "Workers", lambda count: asked.append(count) or Workers(1))
    track("--workers", 1000, "--frames", ":2")
    assert asked == [2]
