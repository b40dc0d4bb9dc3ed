"""blurmatte edit, remove, compose, stack, paints and show."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image
from tests.commands import complaint, good, run
from tests.scenes import on_line

import blurmatte as bm
from blurmatte.cli import pictures
from blurmatte.cli.paths import is_row
from blurmatte.rendering import colorful_plate

SIZE = (96, 64)


def codes(path):
    with Image.open(path) as picture:
        return np.array(picture)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Image, plate and a beach as files, the layer with and without a solution around it."""
    folder = tmp_path_factory.mktemp("edit")
    ball = bm.rendering.Ball(9, (0.7, 0.35, 0.1))
    truth = on_line(colorful_plate(SIZE, 1, tile=16), (30, 25), (60, 38), ball)
    shape = SIZE[::-1]
    layer = bm.Layer(
        truth.layer.alpha.astype(np.float32), truth.layer.premultiplied.astype(np.float32)
    )
    inside = layer.alpha > 0
    solution = bm.Solution(
        *(layer.alpha, np.full(shape, 0.01, np.float32), layer.premultiplied),
        *(np.full((*shape, 3), 0.01, np.float32), np.where(inside, 0, 16).astype(np.uint8)),
        *(truth.model, "truth"),
    )
    bm.write(folder / "image.png", truth.image)
    bm.write(folder / "plate.png", truth.plate)
    bm.write(folder / "beach.png", bm.LinearImage(colorful_plate((150, 100), 7, tile=30)))
    bm.write(folder / "layer.exr", layer)
    bm.write(folder / "solved.exr", solution)
    return folder


@pytest.fixture
def own(scene):
    """The options for the object in its own picture."""
    return "--image", scene / "image.png", "--plate", scene / "plate.png", "--match", "none"


def test_edit_applies_changes_in_order(scene, tmp_path):
    layer = bm.read_layer(scene / "layer.exr")
    for options, expected in [
        (("--fade", 8, "--fade=0.5"), layer.fade(8).fade(0.5)),
        (("--fade", 0.5, "--fade", 8), layer.fade(0.5).fade(8)),
        (("--recolor", "#20c040", "--expose", -1), layer.recolor("#20c040").relight(0.5)),
        (("--expose", -1, "--recolor", "#20c040"), layer.relight(0.5).recolor("#20c040")),
        (("--gain", "1,2,.5", "--amplify", "2,0.8"), layer.relight([1, 2, 0.5]).amplify(2, 0.8)),
        (
            ("--recolor", "#d08030=#20c040,#ffffff=#ff0000"),
            layer.recolor("#20c040", "#ff0000", paints=["#d08030", "#ffffff"]),
        ),
    ]:
        out = tmp_path / "out.exr"
        good("edit", scene / "layer.exr", *options, "--out", out)
        edited = bm.read_layer(out)
        assert_allclose(edited.alpha, expected.alpha, rtol=1e-6)
        assert_allclose(edited.premultiplied, expected.premultiplied, rtol=1e-5, atol=1e-7)


def test_folder_of_results_is_its_layer_even_with_other_pictures(scene, tmp_path):
    out = tmp_path / "out.exr"
    good("edit", scene, "--fade", 0.5, "--out", out)
    assert_allclose(bm.read_layer(out).alpha, 0.5 * bm.read_layer(scene / "layer.exr").alpha)
    good("compose", scene, "--over", scene / "plate.png", "--out", tmp_path / "whole.png")
    assert codes(tmp_path / "whole.png").shape == (64, 96, 3)


def test_edit_keeps_all_other_pixels(scene, own, tmp_path):
    out = tmp_path / "out.png"
    good("edit", scene / "layer.exr", *own, "--recolor", "#2040ff", "--fade", 2, "--out", out)
    layer = bm.read_layer(scene / "layer.exr")
    inside = layer.alpha > 0
    assert_array_equal(codes_of(out)[~inside], codes_of(scene / "image.png")[~inside])
    expected = layer.recolor("#2040ff").fade(2).over(bm.read(scene / "plate.png"))
    assert_allclose(bm.read(out).rgb, np.minimum(expected.rgb, 1), atol=3e-5)  # 16 bits, twice


def codes_of(path):
    """16-bit codes, which Pillow would make 8 bits of."""
    return np.rint(65535 * bm.SRGB.encode(bm.read(path).rgb)).astype(int)


def test_remove_puts_plate_inside_streak_only(scene, own, tmp_path):
    streak = bm.read_solution(scene / "solved.exr").streak
    for layer in ("solved.exr", "layer.exr"):
        good("remove", scene / layer, *own, "--out", tmp_path / "out.png")
        out, image, plate = (
            codes_of(p) for p in (tmp_path / "out.png", scene / "image.png", scene / "plate.png")
        )
        assert_array_equal(out[~streak], image[~streak])
        assert_array_equal(out[streak], plate[streak])
    good("remove", scene / "layer.exr", *own, "--grow", 2, "--out", tmp_path / "o.png")
    grown = (codes_of(tmp_path / "o.png") == plate).all(axis=-1)
    assert grown.sum() > streak.sum() + 2 * 30


def test_edited_jpeg_keeps_profile_and_exif(scene, tmp_path):
    """Three pictures from a tripod, and one result."""
    for name in ("image", "plate"):
        exif = Image.Exif()
        exif[0x010F] = "a camera"
        pixels = Image.fromarray((codes_of(scene / f"{name}.png") // 257).astype(np.uint8))
        pixels.save(tmp_path / f"{name}.jpg", quality=95, exif=exif, icc_profile=_srgb_profile())
    own = ("--image", tmp_path / "image.jpg", "--plate", tmp_path / "plate.jpg")
    out = tmp_path / "out.jpg"
    good("edit", scene / "layer.exr", *own, "--fade", 2, "--match", "none", "--out", out)
    with Image.open(out) as after, Image.open(tmp_path / "image.jpg") as before:
        assert after.getexif()[0x010F] == "a camera"
        assert after.info["icc_profile"] == before.info["icc_profile"]
        difference = np.abs(np.asarray(after).astype(int) - np.asarray(before)).max(axis=-1)
    x0, y0, x1, y1 = bm.read_layer(scene / "layer.exr").box
    assert difference[y0:y1, x0:x1].max() > 20
    touched = np.zeros_like(difference, bool)  # blocks of 16, and a pixel of chroma around them
    touched[
        y0 // 16 * 16 - 1 : -(-y1 // 16) * 16 + 1, x0 // 16 * 16 - 1 : -(-x1 // 16) * 16 + 1
    ] = 1
    assert difference[~touched].max() == 0


def _srgb_profile():
    from PIL import ImageCms

    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def test_transfer_applies_to_pictures_not_to_exr(scene, own, tmp_path):
    """Layers and EXR files hold linear light."""
    for name in ("image", "plate"):
        bm.write(
            tmp_path / f"{name}.png", (codes_of(scene / f"{name}.png") // 257).astype(np.uint8)
        )
    bm.write(tmp_path / "plate.exr", bm.read(tmp_path / "plate.png"))
    results = []
    for plate, curve in (("plate.png", "srgb"), ("plate.exr", "srgb"), ("plate.png", None)):
        options = "--image", tmp_path / "image.png", "--plate", tmp_path / plate, "--match", "none"
        out = tmp_path / "o.png"
        named = ("--transfer", curve) if curve else ()
        good("edit", scene / "layer.exr", *options, *named, "--fade", 3, "--out", out)
        results.append(codes(out))
    assert_array_equal(results[1], results[0])
    assert_array_equal(results[2], results[0])


def test_compose_places_scales_and_fits(scene, tmp_path):
    layer, beach = bm.read_layer(scene / "layer.exr"), bm.read(scene / "beach.png")
    over = "--over", scene / "beach.png"
    for options, expected in [
        (("--place", "100,50"), layer.place((150, 100), (100, 50)).over(beach)),
        (("--place", "60,40.0", "--scale", 2), layer.place((150, 100), (60, 40), 2).over(beach)),
        (("--scale", 0.5), layer.place((150, 100), None, 0.5).over(beach)),
        (("--fit", "cover"), layer.over(bm.compositing.cover(beach, SIZE))),
    ]:
        out = tmp_path / "at_sea.exr"
        good("compose", scene / "layer.exr", *over, *options, "--out", out)
        assert_allclose(bm.read(out).rgb, expected.rgb, atol=1e-6)


def test_compose_matches_light(scene, tmp_path):
    out, plate = tmp_path / "o.exr", bm.read(scene / "plate.png")
    bm.write(tmp_path / "dim.exr", bm.LinearImage(plate.rgb * np.float32([0.5, 0.25, 0.125])))
    options = "--over", tmp_path / "dim.exr", "--match-light", scene / "plate.png"
    good("compose", scene / "layer.exr", *options, "--out", out)
    lit = bm.read_layer(scene / "layer.exr").relight([0.5, 0.25, 0.125])
    assert_allclose(bm.read(out).rgb, lit.over(bm.read(tmp_path / "dim.exr")).rgb, atol=1e-5)


def test_writes_sheets_and_previews(scene, own, tmp_path):
    sheet, preview = tmp_path / "sheet.png", tmp_path / "preview.webp"
    look = "--sheet", sheet, "--preview", preview
    good("edit", scene / "layer.exr", *own, "--fade", 2, *look, "--out", tmp_path / "a.png")
    assert codes(sheet).shape[1] == 1800
    with Image.open(preview) as moving:
        assert 12 <= moving.n_frames <= 24  # WebP makes one of two that are the same
        first, middle = (frame(moving, n) for n in (0, moving.n_frames // 2))
    assert np.abs(first - middle).max() > 30  # nothing there, and all of it
    good("edit", scene / "layer.exr", "--fade", 2, "--sheet", sheet, "--out", tmp_path / "a.exr")
    moved = "--over", scene / "beach.png", "--place", "90,40", "--sheet", sheet
    good("compose", scene / "layer.exr", *moved, "--out", tmp_path / "m.png")
    options = "--over", scene / "plate.png", "--preview", tmp_path / "p.gif"
    good("compose", scene / "layer.exr", *options, "--out", tmp_path / "b.png")
    none = run(
        "edit", scene / "layer.exr", "--fade", 2, "--preview", preview, "--out", tmp_path / "c.exr"
    )
    assert "--preview needs a background" in complaint(none)
    good("remove", scene / "layer.exr", *own, "--preview", preview, "--out", tmp_path / "r.png")
    with Image.open(preview) as moving:
        first, middle = (frame(moving, n) for n in (0, moving.n_frames // 2))
    assert np.abs(first - middle).max() > 30  # removed, and as it was
    assert not (tmp_path / "c.exr").exists()


def frame(moving, number):
    moving.seek(number)
    return np.asarray(moving.convert("RGB")).astype(int)


def test_edits_rows_of_layers(scene, tmp_path):
    layer = bm.read_layer(scene / "layer.exr")
    for number in (1, 2, 3):
        bm.write(tmp_path / f"in.{number:04d}.exr", layer.fade(number / 4))
    row = tmp_path / "in.####.exr"
    good("edit", row, "--fade", 0.5, "--first", 7, "--out", tmp_path / "out.%03d.exr")
    written = sorted(path.name for path in tmp_path.glob("out*"))
    assert written == ["out.007.exr", "out.008.exr", "out.009.exr"]
    assert_allclose(
        bm.read_layer(tmp_path / "out.009.exr").alpha, layer.fade(0.375).alpha, atol=1e-6
    )
    over = "--over", scene / "plate.png"
    good("compose", row, *over, "--rate", 10, "--out", tmp_path / "out.mp4")
    assert len(bm.read_frames(tmp_path / "out.mp4", bm.radiometry.REC709)) == 3
    single = run("edit", row, "--fade", 0.5, "--out", tmp_path / "x.exr")
    assert "x.####.exr" in complaint(single)
    (tmp_path / "in.0002.exr").unlink()
    good("edit", row, "--fade", 0.5, "--out", tmp_path / "kept.####.exr")
    assert sorted(p.name for p in tmp_path.glob("kept*")) == ["kept.0001.exr", "kept.0003.exr"]


def test_rows_may_have_empty_layers(scene, tmp_path):
    """Exact: those of frames without the object stay empty, and show the picture behind them."""
    layer = bm.read_layer(scene / "layer.exr")
    bm.write(tmp_path / "in.0001.exr", layer.fade(0))
    bm.write(tmp_path / "in.0002.exr", layer)
    row, change = tmp_path / "in.####.exr", ("--recolor", "#2040ff", "--amplify", 2)
    good("edit", row, *change, "--out", tmp_path / "out.####.exr")
    assert bm.read_layer(tmp_path / "out.0001.exr").empty
    assert not bm.read_layer(tmp_path / "out.0002.exr").empty
    over = "--over", scene / "plate.png", "--place", "40,30"
    good("compose", row, *over, *change, "--out", tmp_path / "over.####.png")
    plate = codes(scene / "plate.png")
    assert np.array_equal(codes(tmp_path / "over.0001.png"), plate)
    assert not np.array_equal(codes(tmp_path / "over.0002.png"), plate)


@pytest.fixture
def shot(scene, tmp_path):
    """Three numbered pictures, the second with the object and its layer, and the options."""
    for number, name in ((1001, "plate.png"), (1002, "image.png"), (1003, "plate.png")):
        (tmp_path / f"shot.{number}.png").write_bytes((scene / name).read_bytes())
    (tmp_path / "layer.001002.exr").write_bytes((scene / "solved.exr").read_bytes())
    (tmp_path / "layer.009000.exr").write_bytes((scene / "layer.exr").read_bytes())
    row = tmp_path / "layer.######.exr"
    return row, ("--image", tmp_path / "shot.####.png", "--plate", scene / "plate.png")


def test_remove_and_edit_rows_by_the_numbers_of_their_frames(scene, shot, tmp_path):
    """Exact: each frame is what the command makes of it alone; others keep their codes."""
    row, own = shot
    one = scene / "solved.exr", "--image", scene / "image.png", *own[2:], "--match", "none"
    for command, *options in (("remove",), ("edit", "--fade", 0.5)):
        out = tmp_path / f"{command}.####.png"
        good(command, row, *own, *options, "--match", "none", "--out", out)
        assert len(list(tmp_path.glob(f"{command}.*.png"))) == 3
        good(command, *one, *options, "--out", tmp_path / "one.png")
        for number, same in ((1001, scene / "plate.png"), (1002, tmp_path / "one.png")):
            assert_array_equal(codes_of(tmp_path / f"{command}.{number}.png"), codes_of(same))


def test_remove_writes_clips_and_refuses_rows_that_do_not_fit(scene, shot, tmp_path):
    row, own = shot
    good("remove", row, *own, "--out", tmp_path / "gone.mov")
    gone, plate = (
        bm.read_frames(tmp_path / "gone.mov", bm.radiometry.REC709),
        bm.read(scene / "plate.png"),
    )
    assert all(np.abs(frame.rgb - plate.rgb).max() < 0.1 for frame in gone)
    again = "--image", tmp_path / "gone.mov", *own[2:], "--out", tmp_path / "x.####.png"
    assert "numbered 1002 to 9000, pictures 0 to 2" in complaint(run("remove", row, *again))
    over = "--image", own[1], *own[2:], "--out", own[1]
    assert "would be replaced" in complaint(run("remove", row, *over))
    sheet = "--sheet", tmp_path / "s.png", "--out", tmp_path / "x.mov"
    assert "need one layer" in complaint(run("remove", row, *own, *sheet))


def test_stacks_layers(scene, tmp_path):
    layer = bm.read_layer(scene / "layer.exr")
    places = [(20.0, 20.0), (40.0, 30.0), (70.0, 40.0)]
    layers = [layer.place(SIZE, place) for place in places]
    names = [tmp_path / f"l.{n}.exr" for n in range(3)]
    for name, one in zip(names, layers, strict=True):
        bm.write(name, one)
    written = good("stack", *names, "--out", tmp_path / "all.exr")
    assert written.stdout.strip() == str(tmp_path / "all.exr")
    together = bm.read_layer(tmp_path / "all.exr")
    assert_allclose(together.alpha, bm.compositing.stack(layers).alpha, atol=1e-6)
    over = "--over", scene / "plate.png"
    good("stack", tmp_path / "l.#.exr", "--long", *over, "--out", tmp_path / "long.exr")
    expected = bm.compositing.long_exposure(layers).over(bm.read(scene / "plate.png"))
    assert_allclose(bm.read(tmp_path / "long.exr").rgb, expected.rgb, atol=1e-6)


def test_paints_writes_maps(scene, tmp_path):
    good(
        "paints",
        scene / "solved.exr",
        "--color",
        "#dca059",
        "--color",
        "#2030ff",
        "--out",
        tmp_path,
    )
    names = ["overview.png", "paint1.png", "paint1_std.png", "paint2.png", "paint2_std.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    one = run("paints", scene / "solved.exr", "--color", "#dca059", "--out", tmp_path)
    assert "give two or three" in complaint(one)
    layer = run("paints", scene / "layer.exr", "--color", "#dca059", "--out", tmp_path)
    assert "layer.exr" in complaint(layer)


@pytest.mark.parametrize("name", ["image.png", "layer.exr", "solved.exr"])
def test_show_writes_or_opens_sheet(scene, tmp_path, monkeypatch, name):
    opened = []
    monkeypatch.setattr(pictures.typer, "launch", lambda path: opened.append(path) or 0)
    good("show", scene / name, "--out", tmp_path / "look.png")
    assert not opened
    assert codes(tmp_path / "look.png").shape[1] == 1800
    good("show", scene / name)
    assert codes(opened[0]).shape[1] == 1800


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "give a change"),
        (("--image", "image.png"), "give a change"),
        (("--fade", "much"), "--fade must be a factor, got 'much'"),
        (("--fade", "-1"), "factor must be 0 or more"),
        (("--expose", "10000"), "--expose must lie between -128 and 128, got '10000'"),
        (("--recolor", "blue"), "--recolor must be a color like #d8ff3c"),
        (("--gain", "1,2"), "--gain must be a factor or red,green,blue"),
        (("--fade", "2", "--image", "image.png"), "give the plate"),
        (("--fade", "2", "--image", "image.png", "--over", "beach.png"), "No such option: --over"),
        (("--fade", "2", "--image", "image.png", "--place", "1,2"), "No such option: --place"),
        (("--fade", "2", "--image", "beach.png"), "96x64 pixels and the image 150x100"),
        (("--fade", "2", "--image", "image.png", "--plate", "nothing.png"), "nothing.png"),
    ],
)
def test_edit_refuses_in_one_line(scene, tmp_path, options, words):
    check_refusal(scene, tmp_path, "edit", options, words)


def check_refusal(scene, folder, command, options, words):
    """A command on the layer has one line, which has these words, and leaves its output."""
    options = [scene / o if o.endswith(".png") else o for o in options]
    out = folder / "out.png"
    out.write_bytes(b"precious")
    assert words in complaint(run(command, scene / "layer.exr", *options, "--out", out))
    assert out.read_bytes() == b"precious"


def test_sheet_of_a_composite_without_changes_shows_the_background_before(scene, tmp_path):
    out = "--out", tmp_path / "a.png", "--sheet", tmp_path / "sheet.png"
    good("compose", scene / "layer.exr", "--over", scene / "plate.png", *out)
    layer, plate = bm.read_layer(scene / "layer.exr"), bm.read(scene / "plate.png")
    pictures_before_and_after = plate, layer.over(plate)
    drawn = bm.figures.draw_edit(layer.fade(0), layer, *pictures_before_and_after, "compose")
    assert_array_equal(codes(tmp_path / "sheet.png"), drawn)


@pytest.mark.parametrize(
    ("command", "options", "words"),
    [
        ("compose", (), "Missing option '--over'"),
        ("compose", ("--over", "beach.png"), "--fit cover"),
        ("compose", ("--over", "beach.png", "--place", "1"), "--place must be x,y"),
        ("compose", ("--over", "beach.png", "--place", "900,2"), "outside the picture"),
        ("compose", ("--over", "beach.png", "--fit", "cover", "--scale", "2"), "give one"),
        ("remove", (), "Missing option '--image'"),
        ("remove", ("--image", "image.png"), "Missing option '--plate'"),
        ("remove", ("--image", "image.png", "--plate", "beach.png"), "150x100"),
        ("remove", ("--image", "beach.png", "--plate", "beach.png"), "the layer is"),
    ],
)
def test_compose_and_remove_refuse_in_one_line(scene, tmp_path, command, options, words):
    """Door."""
    check_refusal(scene, tmp_path, command, options, words)


@pytest.mark.parametrize(
    ("name", "row"),
    [
        *(("a.exr", False), ("a.jpg", False), ("a.####.exr", True), ("a.%04d.png", True)),
        *(("a*.exr", True), ("a.mov", True), ("rally.mp4", True), ("100%d.tif", True)),
        *(("5% off.exr", False), ("folder.exr", True), ("#1.exr", False)),
    ],
)
def test_recognizes_row_by_name(tmp_path, name, row):
    (tmp_path / "folder.exr").mkdir()
    (tmp_path / "#1.exr").touch()
    assert is_row(tmp_path / name) == row


def test_edit_refuses_what_is_no_layer(scene, tmp_path):
    out = "--fade", "2", "--out", tmp_path / "out.png"
    assert "has no alpha" in complaint(run("edit", scene / "image.png", *out))
    assert "no such file" in complaint(run("edit", scene / "nothing.exr", *out))
    own = "--image", scene / "image.png"
    assert "no such file" in complaint(run("edit", scene / "nothing.exr", *own, *out))
    assert "no file matches" in complaint(run("edit", scene / "n.####.exr", *own, *out))


@pytest.mark.parametrize("name", ["edit", "remove"])
def test_a_guessed_curve_is_warned_of_once(scene, tmp_path, name):
    for picture in ("image", "plate"):
        Image.fromarray(codes(scene / f"{picture}.png").astype(np.uint8)).save(
            tmp_path / f"{picture}.png"
        )
    files = ("--image", tmp_path / "image.png", "--plate", tmp_path / "plate.png")
    change = ("--fade", "0.5") if name == "edit" else ("--match", "none")
    done = run(name, scene / "layer.exr", *files, *change, "--out", tmp_path / "o.png")
    assert done.stderr.count("the file has no") == 1, done.output
