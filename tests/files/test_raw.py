"""Camera RAW: DNG files that are written here, compared with LibRaw."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import rawpy
from numpy.testing import assert_allclose
from tests.commands import run
from tests.files.conftest import refusal
from tests.scenes import on_line

from blurmatte.calibration import fit_noise
from blurmatte.color.model import ColorModel
from blurmatte.errors import FileError, PlateError
from blurmatte.files.raw import _to_srgb
from blurmatte.files.reading import read, read_layer
from blurmatte.files.solutions import read_solution
from blurmatte.files.writing import write
from blurmatte.matting import Pixelwise, solve
from blurmatte.radiometry import LINEAR, SRGB, LinearImage, NoiseModel, check_same_colors
from blurmatte.radiometry.sensor import demosaic, exif_orientation
from blurmatte.rendering import Ball, colorful_plate
from blurmatte.streaks import find_streaks

BAYER = {
    "RGGB": ((0, 1), (1, 2)),
    "BGGR": ((2, 1), (1, 0)),
    "GRBG": ((1, 0), (2, 1)),
    "GBRG": ((1, 2), (0, 1)),
}
XTRANS = (
    (1, 2, 1, 1, 0, 1),
    (0, 1, 0, 2, 1, 2),
    (1, 2, 1, 1, 0, 1),
    (1, 0, 1, 1, 2, 1),
    (2, 1, 2, 0, 1, 0),
    (1, 0, 1, 1, 2, 1),
)
# What conftest.py writes into its DNGs.
CAMERA_FROM_XYZ = ((0.70, -0.21, -0.05), (-0.45, 1.24, 0.23), (-0.09, 0.21, 0.62))
INSIDE = np.s_[2:-2, 2:-2]
PROFILE = NoiseModel(gain=(2e-4, 1e-4, 3e-4), read_std=(2e-3, 1e-3, 3e-3))


def codes_of(mosaic):
    return np.clip(np.rint(mosaic), 0, 16383).astype(np.uint16)


def by_libraw(path):
    """LibRaw's own linear development, without curves and clipping."""
    with rawpy.imread(str(path)) as raw:
        codes = raw.postprocess(
            demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
            output_color=rawpy.ColorSpace.raw,
            user_wb=[1, 1, 1, 1],
            gamma=(1, 1),
            no_auto_bright=True,
            adjust_maximum_thr=0,
            output_bps=16,
        )
    return codes / 65535


def slopes(shape=(48, 64)):
    """(H, W, 3) light from 0.01 to 0.9, which linear interpolation reproduces exactly."""
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]] / max(shape)
    return np.stack([0.01 + 0.6 * x, 0.05 + 0.4 * x + 0.5 * y, 0.9 - 0.7 * y], axis=-1)


# Exact


@pytest.mark.parametrize("name", BAYER)
def test_light_round_trips(tmp_path, make_dng, make_mosaic, name):
    light = slopes()
    codes = codes_of(make_mosaic(light, BAYER[name]))
    image = read(make_dng(tmp_path / "a.dng", codes, BAYER[name]))
    assert_allclose(image.rgb[INSIDE], light[INSIDE], atol=1e-4)
    assert image.rgb.dtype == np.float32
    assert image.valid.all()


def test_flat_light_is_flat_to_the_border_behind_x_trans(tmp_path, make_dng, make_mosaic):
    light = np.broadcast_to([0.3, 0.5, 0.2], (30, 42, 3))
    image = read(make_dng(tmp_path / "a.dng", codes_of(make_mosaic(light, XTRANS)), XTRANS))
    assert_allclose(image.rgb, light, atol=1e-4)


def test_light_is_proportional_to_the_codes(tmp_path, make_dng):
    """Half the light is half the number, from black to white."""
    levels = np.linspace(0, 1, 97)
    codes = codes_of(512 + (16383 - 512) * levels).repeat(8).reshape(1, -1).repeat(24, axis=0)
    rgb = read(make_dng(tmp_path / "a.dng", codes)).rgb[4, 3::8]
    assert_allclose(rgb, levels[:, None].repeat(3, axis=1), atol=1e-4)


def test_exposures_keep_their_ratio(tmp_path, make_dng, make_mosaic):
    light = slopes()
    short, long = (
        read(make_dng(tmp_path / f"{gain}.dng", codes_of(make_mosaic(gain * light)))).rgb
        for gain in (0.25, 1.0)
    )
    assert_allclose(4 * short[INSIDE], long[INSIDE], atol=2e-4)


def test_negative_noise_below_black_is_kept(tmp_path, make_dng):
    """Clipped noise would have a mean above black."""
    rng = np.random.default_rng(0)
    codes = codes_of(512 + rng.normal(0, 20, (200, 200)))
    rgb = read(make_dng(tmp_path / "a.dng", codes)).rgb
    assert rgb.min() < 0
    assert_allclose(rgb.mean(axis=(0, 1)) * (16383 - 512), 0, atol=20 / 50)


def test_each_color_has_its_black_level(tmp_path, make_dng):
    """All have one scale, that of the highest black level [DNG 1.4 ch. 5]."""
    black = np.array([[500, 600], [700, 400]])
    codes = black + 3000
    codes = np.tile(codes, (12, 12)).astype(np.uint16)
    path = make_dng(tmp_path / "a.dng", codes, black=tuple(black.ravel()), white=10_700)
    assert_allclose(read(path).rgb, 0.3, atol=1e-6)


@pytest.mark.parametrize("black", [(500.25, 600.5, 700.75, 400.0), (528.75,) * 4])
def test_black_level_may_be_fractional(tmp_path, make_dng, black):
    codes = np.tile(np.array([[1000, 2000], [3000, 4000]], np.uint16), (12, 12))
    rgb = read(make_dng(tmp_path / "a.dng", codes, black=black, white=10_700)).rgb
    exact = (codes[:2, :2] - np.reshape(black, (2, 2))) / (10_700 - max(black))
    assert_allclose(rgb[8, 8, 0], exact[0, 0], atol=1e-6)
    assert_allclose([rgb[8, 9, 1], rgb[9, 8, 1]], [exact[0, 1], exact[1, 0]], atol=1e-6)
    assert_allclose(rgb[9, 9, 2], exact[1, 1], atol=1e-6)


def test_linear_dng_is_not_interpolated(tmp_path, make_dng):
    light = slopes()
    codes = codes_of(512 + (16383 - 512) * light)
    codes[5, 6, 1] = 16383
    image = read(make_dng(tmp_path / "a.dng", codes, black=(512,) * 4))
    light[5, 6, 1] = 1
    assert_allclose(image.rgb, light, atol=1e-4)
    assert not image.valid[5, 6]
    assert image.valid.sum() == image.valid.size - 1


def test_dng_of_a_sensor_without_colors_is_gray(tmp_path, make_monochrome_dng):
    light = slopes()[..., 0]
    codes = codes_of(512 + (16383 - 512) * light)
    codes[5, 6] = 16383
    image = read(make_monochrome_dng(tmp_path / "a.dng", codes))
    light[5, 6] = 1
    assert image.meta.gray
    assert_allclose(image.rgb, np.repeat(light[..., None], 3, axis=2), atol=1e-4)
    assert not image.valid[5, 6]
    assert image.valid.sum() == image.valid.size - 1


# Oracle


@pytest.mark.parametrize(("name", "error"), [*((name, 0.0) for name in BAYER), ("X-Trans", 0.005)])
def test_interpolation_agrees_with_libraw(tmp_path, make_dng, name, error):
    """LibRaw rounds to 16 bits, and the weights of X-Trans too; nothing clips here."""
    codes = np.random.default_rng(1).integers(600, 16000, (36, 54)).astype(np.uint16)
    path = make_dng(tmp_path / "a.dng", codes, (BAYER | {"X-Trans": XTRANS})[name])
    assert_allclose(read(path).rgb[INSIDE], by_libraw(path)[INSIDE], rtol=error, atol=4e-5)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_agrees_with_libraw(tmp_path, make_dng, orientation):
    codes = np.random.default_rng(2).integers(600, 16000, (24, 30)).astype(np.uint16)
    path = make_dng(tmp_path / "a.dng", codes, orientation=orientation)
    image = read(path)
    assert image.size == ((24, 30) if orientation > 4 else (30, 24))
    assert image.meta.readout == exif_orientation(orientation).readout
    assert_allclose(image.rgb[INSIDE], by_libraw(path)[INSIDE], atol=4e-5)


def test_matrix_to_srgb_agrees_with_libraw(tmp_path, make_dng):
    """LibRaw states it for a DNG; for other files its factors, which are substituted here."""
    path = make_dng(tmp_path / "a.dng", np.full((24, 24), 5000, np.uint16), neutral=(1, 1, 1))
    raw = SimpleNamespace(num_colors=3, color_matrix=np.zeros((3, 4)))
    raw.rgb_xyz_matrix = np.concatenate([CAMERA_FROM_XYZ, np.zeros((1, 3))])
    assert_allclose(_to_srgb(raw, (1, 1, 1)), read(path).meta.to_srgb, atol=2e-3)


# Saturation


def test_pixels_interpolated_from_clipped_ones_are_invalid(tmp_path, make_dng):
    codes = np.full((32, 34), 5000, np.uint16)
    codes[6, 8] = 16383  # red
    image = read(make_dng(tmp_path / "a.dng", codes))
    spoiled = np.zeros((32, 34), bool)
    spoiled[5:8, 7:10] = True
    assert np.array_equal(image.valid, ~spoiled)
    assert np.array_equal(image.rgb[..., 0] >= 1, spoiled)  # at least white, not a mean
    assert (image.rgb[..., 1:] < 1).all()


def test_codes_just_below_white_are_valid(tmp_path, make_dng):
    image = read(make_dng(tmp_path / "a.dng", np.full((24, 24), 16382, np.uint16)))
    assert image.valid.all()
    assert_allclose(image.rgb, 1 - 1 / (16383 - 512), atol=1e-6)


# Facts


def test_metadata_is_kept(tmp_path, make_dng):
    codes = np.full((24, 24), 5000, np.uint16)
    path = make_dng(tmp_path / "a.dng", codes, camera="Example C7", neutral=(0.5, 1, 0.8))
    meta = read(path).meta
    assert meta.source == "a.dng"
    assert meta.transfer is None
    assert meta.levels == 16383 - 512 + 1
    assert meta.exposure_time == pytest.approx(0.025)
    assert meta.color_space == "camera"
    assert meta.camera == "Example C7"
    assert meta.white_balance == pytest.approx((2, 1, 1.25))
    assert not meta.gray


def test_white_balance_changes_no_light(tmp_path, make_dng):
    codes = np.random.default_rng(4).integers(600, 16000, (24, 26)).astype(np.uint16)
    one, other = (
        read(make_dng(tmp_path / f"{n}.dng", codes, neutral=neutral))
        for n, neutral in enumerate([(0.5, 1, 0.8), (0.9, 1, 0.3)])
    )
    assert np.array_equal(one.rgb, other.rgb)
    assert one.meta.white_balance != other.meta.white_balance


def test_camera_white_is_displayed_white(tmp_path, make_dng, make_mosaic):
    light = np.broadcast_to([0.5 * 0.4, 0.4, 0.8 * 0.4], (30, 32, 3))
    image = read(make_dng(tmp_path / "a.dng", codes_of(make_mosaic(light)), neutral=(0.5, 1, 0.8)))
    seen = image.in_srgb()
    assert_allclose(seen.rgb, 0.4, atol=2e-3)
    assert seen.meta.color_space == "sRGB"
    write(tmp_path / "a.png", image)
    assert_allclose(read(tmp_path / "a.png").rgb, 0.4, atol=2e-3)


def test_files_of_other_kinds_are_srgb(tmp_path, ramp, make_png):
    (tmp_path / "a.png").write_bytes(make_png(ramp))
    meta = read(tmp_path / "a.png", SRGB).meta
    assert meta.color_space == "sRGB"
    assert meta.to_srgb is None


# Honest


def test_noise_profile_gives_the_noise_of_the_light(tmp_path, make_dng, make_mosaic):
    rng = np.random.default_rng(6)
    light = slopes((300, 400))
    profile = np.stack([PROFILE.gain, np.square(PROFILE.read_std)], axis=1).ravel()
    pictures = []
    for n in range(2):
        noisy = light + np.sqrt(PROFILE.variance(light)) * rng.standard_normal(light.shape)
        codes = codes_of(make_mosaic(noisy))
        pictures.append(read(make_dng(tmp_path / f"{n}.dng", codes, noise=profile)))
    for picture in pictures:
        z = ((picture.rgb - light) / np.sqrt(picture.noise.variance(light)))[INSIDE]
        assert_allclose(z.std(axis=(0, 1)), 1, atol=0.02)
    measured, _ = fit_noise(*(replace(picture, noise=None) for picture in pictures))
    for level in np.full((2, 3), [[0.2], [0.5]]):
        assert_allclose(measured.variance(level), pictures[0].noise.variance(level), rtol=0.15)


@pytest.mark.parametrize("profile", [(1e-4, 1e-6), (1e-4, 1e-6) * 3])
def test_one_noise_profile_applies_to_all_colors(tmp_path, make_dng, profile):
    image = read(make_dng(tmp_path / "a.dng", np.full((24, 24), 5000, np.uint16), noise=profile))
    assert_allclose(image.noise.gain, [0.5625e-4, 0.625e-4, 0.5625e-4])
    assert_allclose(np.square(image.noise.read_std), [0.5625e-6, 0.625e-6, 0.5625e-6])


@pytest.mark.parametrize("profile", [(), (-1e-4, 1e-6), (np.nan, 1e-6), (1e-4, 1e-6) * 2])
def test_noise_without_a_profile_is_unknown(tmp_path, make_dng, profile):
    path = make_dng(tmp_path / "a.dng", np.full((24, 24), 5000, np.uint16), noise=profile)
    assert read(path).noise is None


# From one end to the other


@pytest.fixture(scope="module")
def throw(tmp_path_factory, make_dng, make_mosaic):
    """A ball thrown before tiles: the truth, and the folder of image.dng and plate.dng."""
    folder = tmp_path_factory.mktemp("throw")
    ball = Ball(12, (0.7, 0.35, 0.1))
    truth = on_line(0.8 * colorful_plate((128, 80), rng=2, tile=24), (36, 30), (92, 50), ball)
    rng = np.random.default_rng(7)
    for name, picture in (("image", truth.image), ("plate", truth.plate)):
        noisy = picture.rgb + 2e-3 * rng.standard_normal(picture.rgb.shape)
        codes = codes_of(make_mosaic(noisy))
        make_dng(folder / f"{name}.dng", codes, noise=(0, 4e-6), camera="Example C1")
    return truth, folder


@pytest.fixture(scope="module")
def solved(throw):
    truth, folder = throw
    image, plate = read(folder / "image.dng"), read(folder / "plate.dng")
    return truth, image, plate, solve(image, plate)


def test_a_throw_in_raw_is_solved(solved):
    truth, image, plate, solution = solved
    streak = find_streaks(image, plate)[0]
    assert np.mean(streak.mask[truth.layer.alpha > 0.05]) > 0.97
    inside = solution.streak & solution.known
    rmse = np.sqrt(np.mean((solution.alpha - truth.layer.alpha)[inside] ** 2))
    assert rmse < 0.01
    assert solution.stats.sum_alpha == pytest.approx(truth.layer.alpha.sum(), rel=0.03)
    assert np.degrees(np.arccos(solution.model.pole @ truth.model.pole)) < 1


def test_errors_of_interpolated_pixels_are_calibrated(throw):
    """Single pixels where plate and alpha are smooth, so that only noise is an error."""
    truth, folder = throw
    image, plate = read(folder / "image.dng"), read(folder / "plate.dng")
    solution = solve(image, plate, truth.model, Pixelwise())
    exact = [LinearImage(exact_light(picture.rgb)) for picture in (truth.image, truth.plate)]
    best = solve(*(p.with_noise(image.noise) for p in exact), truth.model, Pixelwise())
    inside = solution.streak & solution.known & best.known & (solution.alpha_std < 0.1)
    z = (solution.alpha - best.alpha)[inside] / solution.alpha_std[inside]
    assert abs(z.mean()) < 0.1
    assert_allclose(z.std(), 1, atol=0.12)


def exact_light(light):
    """Light without noise, interpolated like the rest."""
    pattern = np.array(BAYER["RGGB"])
    y, x = np.indices(light.shape[:2]) % 2
    return demosaic(np.take_along_axis(light, pattern[y, x][..., None], axis=2)[..., 0], pattern)


def test_results_are_displayed_in_srgb_and_stored_in_camera_colors(solved, tmp_path):
    _, image, _, solution = solved
    write(tmp_path / "s.exr", solution)
    back = read_solution(tmp_path / "s.exr")
    assert_allclose(back.premultiplied, solution.premultiplied, atol=1e-6)
    assert back.model.hex == solution.model.hex
    layer = read_layer(tmp_path / "s.exr")
    sure = layer.alpha > 0.1
    seen = replace(image, rgb=solution.premultiplied.astype(np.float32)).in_srgb().rgb
    assert_allclose(layer.premultiplied[sure], np.maximum(seen[sure], 0), atol=1e-5)


def test_hex_color_is_converted_to_camera_colors(solved):
    _, image, _, solution = solved
    (color,) = solution.model.hex
    model = ColorModel.from_hex(color, to_srgb=image.meta.to_srgb)
    assert model.hex == (color,)
    assert np.degrees(np.arccos(model.pole @ solution.model.pole)) < 1
    assert np.degrees(np.arccos(ColorModel.from_hex(color).pole @ solution.model.pole)) > 5


def called(*arguments):
    """Exit code and output of a command."""
    done = run(*arguments)
    return done.exit_code, done.output


def test_info_describes_a_raw_file(throw):
    _, folder = throw
    code, said = called("info", folder / "image.dng")
    assert code == 0
    for line in (
        "image.dng: camera RAW, 128x80 pixels, 14 bit RGB",
        "colors: the camera's own; white balance as shot (not applied): red x2, blue x1.25",
        "camera: Example C1",
        "exposure time: 0.025 s",
    ):
        assert line in said


def test_commands_name_colors_in_srgb(throw, tmp_path):
    _, folder = throw
    given = folder / "image.dng", "--plate", folder / "plate.dng"
    code, said = called("color", *given, "--color", "#ffbc68", "--out", tmp_path / "m.json")
    assert code == 0
    assert said.startswith("#ffbc68, rank 1, given")
    assert "camera's own linear RGB" in said
    assert called("info", tmp_path / "m.json")[1].startswith("#ffbc68, rank 1, given")
    code, said = called("color", *given, "--color", tmp_path / "m.json")
    assert (code, said[:7]) == (0, "#ffbc68")


def test_rejects_color_models_of_other_cameras(throw, tmp_path, ramp, make_png):
    _, folder = throw
    given = folder / "image.dng", "--plate", folder / "plate.dng"
    write(tmp_path / "m.json", ColorModel.from_hex("#ffbc68"))
    code, said = called("color", *given, "--color", tmp_path / "m.json")
    assert code == 2
    assert "was found in a picture of another kind" in said
    (tmp_path / "sharp.png").write_bytes(make_png(ramp))
    sharp = "--color-from", tmp_path / "sharp.png", "--transfer", "linear"
    code, said = called("color", *given, "--color", "5,5", *sharp)
    assert code == 2
    assert "the image is a camera RAW and the picture of --color-from is not" in said


# Doors


@pytest.fixture
def good(tmp_path, make_dng):
    codes = np.random.default_rng(8).integers(600, 16000, (60, 80)).astype(np.uint16)
    return make_dng(tmp_path / "a.dng", codes)


@pytest.mark.parametrize("cut", [0.98, 0.5, 0.05, 0.002])
def test_truncated_raw_is_rejected_without_output(good, capfd, cut):
    whole = good.read_bytes()
    good.write_bytes(whole[: int(cut * len(whole))])
    assert "convert it to DNG" in refusal(good)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["a.dng", "a.NEF", "a.cr3", "a.raf"])
def test_other_content_is_rejected(tmp_path, capfd, name):
    path = tmp_path / name
    path.write_bytes(b"")
    assert "is empty" in refusal(path)
    path.write_text("I am not a picture.\n" * 100)
    assert "TIFF; LibRaw does not know its camera, or it is no camera RAW" in refusal(path)
    assert capfd.readouterr() == ("", "")


def test_missing_extra_is_named(good, monkeypatch):
    monkeypatch.setitem(sys.modules, "rawpy", None)
    assert refusal(good) == 'pip install "blurmatte[raw]"; camera RAW needs rawpy'


def test_png_with_a_raw_extension_is_read_as_png(tmp_path, ramp, make_png):
    (tmp_path / "a.dng").write_bytes(make_png(ramp))
    assert read(tmp_path / "a.dng", SRGB).meta.color_space == "sRGB"


def test_transfer_is_rejected_for_raw(good):
    assert np.array_equal(read(good, LINEAR).rgb, read(good).rgb)
    assert "is linear, not srgb" in refusal(good, SRGB)


def test_rejects_raw_files_as_layers(good):
    with pytest.raises(FileError, match="holds no layer"):
        read_layer(good)


def test_pixel_limit_applies_to_raw_files(good):
    assert "80 x 60 pixels" in refusal(good, max_pixels=4799)
    assert read(good, max_pixels=4800).size == (80, 60)


def test_rejects_sensors_of_other_colors(tmp_path, make_dng):
    codes = np.full((24, 24), 5000, np.uint16)
    four_of_a_kind = np.repeat(np.repeat(BAYER["RGGB"], 2, axis=0), 2, axis=1)
    for pattern in (((3, 4), (5, 1)), four_of_a_kind):  # the first: cyan, magenta, yellow, green
        path = make_dng(tmp_path / "a.dng", codes, pattern)
        assert "no plain pattern of red, green and blue" in refusal(path)


def test_white_must_be_above_black(tmp_path, make_dng):
    path = make_dng(tmp_path / "a.dng", np.full((24, 24), 5000, np.uint16), white=500)
    assert "not above its black level" in refusal(path)


def test_rejects_floating_point_raw(tmp_path, make_dng):
    path = make_dng(tmp_path / "a.dng", np.full((24, 24), 0.5, np.float32))
    assert "holds floats" in refusal(path)


def flat(camera="Example C1", levels=15872, space="camera"):
    picture = LinearImage(np.full((20, 20, 3), 0.5))
    meta = replace(picture.meta, camera=camera, levels=levels, color_space=space)
    return replace(picture, meta=meta)


@pytest.mark.parametrize(
    ("plate", "says"),
    [
        (flat(space="sRGB"), "the image is a camera RAW and the plate is not"),
        (flat(camera="Example C2"), "taken by a Example C1, the plate by a Example C2"),
        (flat(levels=4000), "15872 levels from black to white, the plate of 4000"),
    ],
)
@pytest.mark.parametrize("verb", [solve, find_streaks])
def test_rejects_image_and_plate_of_different_colors(plate, says, verb):
    with pytest.raises(PlateError, match=says):
        verb(flat(), plate)


def test_pictures_of_unknown_colors_are_accepted():
    check_same_colors("the image", flat(), "the plate", flat(camera="", levels=15870))
    check_same_colors("the image", flat(), "the plate", flat(space=None))
