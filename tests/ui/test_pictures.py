"""The viewer: tiles, frames by number, colors under the cursor."""

import io
import multiprocessing
import pickle

import numpy as np
import pytest
from PIL import Image
from tests.scenes import BALL, rendered

import blurmatte as bm
from blurmatte.background.guess import guess_behind
from blurmatte.ui.pictures import TILE, ShownPictures, _halved
from blurmatte.ui.processes import Question, _alone, look

RNG = np.random.default_rng(5)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A picture with odd sides, a solution, a clip and a text."""
    folder = tmp_path_factory.mktemp("viewer")
    light = RNG.random((TILE + 91, TILE + 38, 3), np.float32)
    bm.write(folder / "picture.exr", bm.LinearImage(light))
    truth = rendered(BALL)
    solution = bm.solve(truth.image, truth.plate, truth.model, bm.Pixelwise())
    bm.write(folder / "layer.exr", solution)
    frames = (bm.LinearImage(np.full((48, 64, 3), k / 40, np.float32)) for k in range(40))
    bm.write_frames(folder / "clip.mp4", frames, 25)
    (folder / "text.txt").write_text("no picture")
    return folder


@pytest.fixture
def viewer():
    return ShownPictures()


def tile(viewer, path, part="picture", frame=0, level=0, x=0, y=0):
    return np.frombuffer(viewer.tile(path, part, frame, level, x, y), "<f2").reshape(-1, 4)


def test_the_scene_behind_is_that_which_edit_takes(viewer, tmp_path):
    truth = rendered(BALL)
    other = bm.LinearImage(np.roll(truth.plate.rgb, 2, axis=1) * np.float32(0.8))
    for name, picture in (("image", truth.image), ("plate", other)):
        bm.write(tmp_path / f"{name}.exr", picture)
    bm.write(tmp_path / "layer.exr", truth.layer)
    asked = tmp_path / "image.exr", "matched", 0, 0, 0, 0, tmp_path / "plate.exr"
    got = np.frombuffer(viewer.tile(*asked), "<f2").reshape(72, 96, 4)
    matched = bm.match_plate(other, truth.image)
    assert np.abs(got[..., :3] - matched.rgb)[matched.valid].max() < 1e-3
    assert np.abs(got[..., :3] - other.rgb).max() > 0.1
    assert np.array_equal(got[..., 3] == 1, matched.valid)
    asked = tmp_path / "image.exr", "guessed", 0, 0, 0, 0, tmp_path / "layer.exr"
    got = np.frombuffer(viewer.tile(*asked), "<f2").reshape(72, 96, 4)
    guess = guess_behind(truth.image, truth.layer.alpha > 0)
    assert np.abs(got[..., :3] - guess.plates[0].rgb).max() < 1e-3
    assert np.array_equal(got[0, 0, :3], truth.image.rgb[0, 0].astype("<f2"))
    assert not np.array_equal(got[35, 48, :3], truth.image.rgb[35, 48].astype("<f2"))


def means(pixels, level):
    """Pixels at a level, by the definition."""
    for _ in range(level):
        height, width = (n + n % 2 for n in pixels.shape[:2])
        whole = np.pad(
            pixels, ((0, height - len(pixels)), (0, width - pixels.shape[1]), (0, 0)), mode="edge"
        )
        pixels = whole.reshape(height // 2, 2, width // 2, 2, -1).mean((1, 3))
    return pixels


@pytest.mark.parametrize(
    ("level", "x", "y"), [(0, 0, 0), (0, 1, 1), (0, 1, 0), (1, 0, 0), (3, 0, 0), (10, 0, 0)]
)
def test_a_tile_holds_linear_light_of_its_place_and_level(folder, viewer, level, x, y):
    path = folder / "picture.exr"
    light = means(bm.read(path).rgb, level)
    light = light[TILE * y : TILE * (y + 1), TILE * x : TILE * (x + 1)].reshape(-1, 3)
    found = tile(viewer, path, level=level, x=x, y=y)
    assert found.shape == (len(light), 4)
    np.testing.assert_allclose(found[:, :3], light, atol=6e-4)
    assert np.all(found[:, 3] == 1)


def test_a_layer_is_premultiplied_and_the_error_is_that_of_alpha(folder, viewer):
    path = folder / "layer.exr"
    layer, solution = bm.read_layer(path), bm.read_solution(path)
    found = tile(viewer, path, "layer")
    np.testing.assert_allclose(found[:, :3], layer.premultiplied.reshape(-1, 3), atol=6e-4)
    np.testing.assert_allclose(found[:, 3], layer.alpha.ravel(), atol=6e-4)
    std, flags, *_ = tile(viewer, path, "error").T
    finite = np.isfinite(solution.alpha_std.ravel())
    np.testing.assert_allclose(std[finite], solution.alpha_std.ravel()[finite], atol=6e-4)
    assert np.all(std[~finite] > 60000)
    assert np.array_equal(flags, solution.quality.ravel())


def test_flags_are_joined_where_pixels_are():
    pixels = np.zeros((3, 2, 4), np.float32)
    pixels[:2, :, 1], pixels[2, :, 1] = [[1, 4], [5, 0]], [8, 1]
    assert _halved(pixels, "error")[..., 1].tolist() == [[5], [9]]


def test_png_has_the_codes_of_the_light(folder, viewer):
    path = folder / "picture.exr"
    light = means(bm.read(path).rgb, 1)
    side = max(light.shape[:2])  # of the picture at half its size
    drawn = np.asarray(Image.open(io.BytesIO(viewer.preview(path, "picture", 0, side, 1.0))))
    expected = 255 * bm.SRGB.encode(np.clip(2 * light, 0, 1))
    assert np.abs(drawn - expected).max() <= 0.51
    preview = Image.open(io.BytesIO(viewer.preview(folder / "layer.exr", "layer", 0, 50, 0.0)))
    assert (preview.size, preview.mode) == ((48, 36), "RGBA")


def test_describes_a_picture_a_solution_and_a_clip_by_their_content(folder, viewer):
    shown = viewer.describe(folder / "picture.exr")
    assert (shown["kind"], shown["width"], shown["height"]) == ("picture", TILE + 38, TILE + 91)
    assert viewer.describe(folder / "layer.exr")["kind"] == "solution"
    clip = viewer.describe(folder / "clip.mp4")
    assert clip == {"kind": "clip", "width": 64, "height": 48, "frames": 40, "rate": 25.0}


def test_frames_come_by_number_in_any_order(folder, viewer):
    path = folder / "clip.mp4"
    for number in (0, 1, 2, 30, 31, 5, 39, 38, 7, 12):
        light = viewer.pixels(path, number, 30, 20, 4)["light"]
        np.testing.assert_allclose(light, number / 40, atol=0.02)
    for number in (40, 99):
        asked = {"path": path, "frame": number, "x": 0, "y": 0, "radius": 0}
        assert "no frame" in viewer.answer("pixels", asked)[2]


def test_played_frames_are_decoded_once(folder, viewer, monkeypatch):
    path, loads = folder / "clip.mp4", []
    frames = viewer._frames(path)
    load = frames.load
    object.__setattr__(frames, "load", lambda numbers: loads.append(numbers) or load(numbers))
    for number in [*range(10, 20), 22, 15]:
        viewer._picture(path, number)
    assert loads == [range(10, 40)]


def test_colors_under_the_cursor_have_alpha_with_its_error_and_flags(folder, viewer):
    path = folder / "layer.exr"
    solution = bm.read_solution(path)
    y, x = np.argwhere(solution.alpha > 0.2)[0]
    found = viewer.pixels(path, 0, int(x), int(y), 0)
    assert found["alpha"] == pytest.approx(float(solution.alpha[y, x]))
    assert found["alpha_std"] == pytest.approx(float(solution.alpha_std[y, x]))
    light = bm.read(folder / "picture.exr").rgb
    found = viewer.pixels(folder / "picture.exr", 0, 1, 10, 3)
    assert found["count"] == 5 * 7
    np.testing.assert_allclose(found["light"], light[7:14, :5].mean((0, 1)), rtol=1e-5)


def test_answers_need_no_numpy_and_are_finite(folder, viewer):
    quality = np.argwhere(~np.isfinite(bm.read_solution(folder / "layer.exr").alpha_std))
    y, x = quality[0] if len(quality) else (0, 0)
    asked = {"path": folder / "layer.exr", "frame": 0, "x": int(x), "y": int(y), "radius": 2}
    answer = viewer.answer("pixels", asked)
    assert b"numpy" not in pickle.dumps(answer)
    assert "nan" not in str(answer[1])
    assert "inf" not in str(answer[1])


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("tile", dict(level=17)),
        ("tile", dict(x=9)),
        ("tile", dict(part="secret")),
        ("tile", dict(part="error")),
        ("tile", dict(frame=3, file="gone.png")),
        ("describe", dict(file="text.txt")),
        ("describe", dict(file="gone.png")),
        ("preview", dict(side=0)),
        ("preview", dict(stops=1e9)),
        ("preview", dict(stops=float("nan"))),
        ("pixels", dict(x=10**9)),
        ("pixels", dict(radius=10**9)),
        ("pixels", dict(radius="x")),
    ],
)
def test_what_cannot_be_shown_is_refused_in_one_line(folder, viewer, name, values):
    usual = {
        "tile": dict(part="picture", frame=0, level=0, x=0, y=0),
        "preview": dict(part="picture", frame=0, side=50, stops=0.0),
        "pixels": dict(frame=0, x=0, y=0, radius=0),
        "describe": {},
    }[name]
    path = folder / values.pop("file", "picture.exr")
    _, _, refusal = viewer.answer(name, usual | values | {"path": path})
    assert refusal
    assert "\n" not in refusal
    assert str(folder) not in refusal


def test_memory_is_bounded(folder):
    viewer = ShownPictures(max_bytes=3 * 48 * 64 * 12)
    for number in range(10):
        viewer._picture(folder / "clip.mp4", number)
    assert sum(size for _, size in viewer._cache.values()) <= 3 * 48 * 64 * 12


def test_at_the_end_of_the_server_the_private_folder_is_deleted(tmp_path):
    private = tmp_path / "private"
    private.mkdir()
    (private / "picture.png").write_bytes(b"x")

    context = multiprocessing.get_context("spawn")
    pipe, far = context.Pipe()
    viewer = context.Process(target=_alone, args=(look, far, private))
    viewer.start()
    far.close()
    pipe.send(Question(1, "describe", {"path": private / "gone.png"}))
    assert "gone.png" in pipe.recv().refusal
    pipe.close()  # as at the death of the server
    viewer.join(10)
    assert viewer.exitcode is not None
    assert not private.exists()
