import weakref

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose
from tests.encoders import encoder

from blurmatte.background.plate import make_plate
from blurmatte.errors import PlateError
from blurmatte.files.frames import read_frames
from blurmatte.radiometry import REC709, SRGB, LinearImage, decode
from blurmatte.rendering import colorful_plate

SIZE = (96, 72)
BALL = np.float32([0.8, 0.7, 0.05])


@pytest.fixture(scope="module")
def scene():
    """(H, W, 3) static light."""
    return (0.15 + 0.6 * colorful_plate(SIZE, 3, tile=12)).astype(np.float32)


def with_ball(light, number):
    """A square that moves over the middle of the picture, three pixels a frame."""
    light = light.copy()
    x = 5 + 3 * number % 70
    light[25:40, x : x + 15] = BALL
    return light


def noisy(light, std, seed):
    return light + np.random.default_rng(seed).normal(0, std, light.shape).astype(np.float32)


def images(lights):
    return [LinearImage(np.asarray(light, np.float32)) for light in lights]


class Streamed:
    """Frames made on iteration, that count how many of them are alive."""

    def __init__(self, make, count):
        self.make, self.count, self.most, self.runs = make, count, 0, 0
        self.alive = weakref.WeakSet()

    def __iter__(self):
        self.runs += 1
        for number in range(self.count):
            frame = LinearImage(self.make(number))
            self.alive.add(frame)
            self.most = max(self.most, len(self.alive))
            yield frame


def test_plate_equals_scene_without_noise(scene):
    # exact
    fit = make_plate(images(with_ball(scene, i) for i in range(40)))
    assert fit.plate.valid.all()
    assert_allclose(fit.plate.rgb, scene, rtol=1e-5)
    assert np.sqrt(fit.plate.variance).max() < 1e-5
    covered = np.mean([(with_ball(scene, i) != scene).any(axis=-1) for i in range(40)], axis=0)
    assert_allclose(fit.coverage[:20], 1)
    middle = np.s_[27:38, 20:70]  # without the unused rim
    assert (fit.coverage[middle] <= 1 - covered[middle] + 1e-6).all()
    assert (fit.coverage[middle] >= 1 - covered[middle] - 4 / 40 - 1e-6).all()


@pytest.mark.parametrize("std", [0.0015, 0.008])
def test_variance_is_that_of_the_mean(scene, std):
    # honest
    z = []
    for seed in range(4):
        frames = (noisy(with_ball(scene, i), std, 100 * seed + i) for i in range(32))
        fit = make_plate(images(frames))
        assert fit.plate.valid.mean() > 0.99
        seen = fit.plate.valid
        z.append(((fit.plate.rgb - scene) / np.sqrt(fit.plate.variance))[seen].ravel())
        usual = std / np.sqrt(32 * fit.coverage[seen][:, None])
        assert np.median(np.sqrt(fit.plate.variance[seen]) / usual) == pytest.approx(1, abs=0.1)
    z = np.concatenate(z)
    assert np.std(z) == pytest.approx(1, abs=0.08)
    assert abs(np.mean(z)) < 0.1
    assert np.mean(np.abs(z) > 3) < 0.006


def test_variance_includes_correlation_in_time(scene):
    # honest: noise of four frames is equal, as in video that repeats unchanged blocks
    z = []
    for seed in range(4):
        frames = [noisy(with_ball(scene, i), 0.005, 100 * seed + i // 4) for i in range(64)]
        fit = make_plate(images(frames))
        z.append((fit.plate.rgb - scene) / np.sqrt(fit.plate.variance))
    assert np.std(z) == pytest.approx(1, abs=0.12)


@pytest.mark.parametrize("std", [0.0, 0.2, 0.6])
def test_variance_includes_rounding_to_8_bits(scene, std):
    # honest: std is in code values; with little noise a mean of rounded values is off
    z = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        truth = SRGB.encode(scene) * 255 + rng.uniform(-0.5, 0.5, scene.shape)
        codes = [np.rint(truth + rng.normal(0, std, truth.shape)) for _ in range(24)]
        fit = make_plate([decode(c.astype(np.uint8), SRGB) for c in codes])
        z.append((fit.plate.rgb - SRGB.decode(truth / 255)) / np.sqrt(fit.plate.variance))
    assert np.std(z) == pytest.approx(1, abs=0.08)


def test_object_at_rest_for_40_percent_leaves_no_trace(scene):
    # honest
    frames = [noisy(scene, 0.004, i) for i in range(50)]
    for frame in frames[15:35]:
        frame[20:50, 30:60] = BALL + 0.004 * np.random.default_rng(1).normal(size=(30, 30, 3))
    fit = make_plate(images(frames))
    assert fit.plate.valid[20:50, 30:60].mean() > 0.99
    z = (fit.plate.rgb - scene)[20:50, 30:60] / np.sqrt(fit.plate.variance[20:50, 30:60])
    assert np.std(z) == pytest.approx(1, abs=0.1)
    assert np.median(fit.coverage[25:45, 35:55]) == pytest.approx(0.6)


def test_quarter_of_free_frames_suffices_against_changing_light(scene):
    # honest
    rng = np.random.default_rng(5)
    frames = [noisy(scene, 0.004, i) for i in range(60)]
    for frame in frames[15:]:
        frame[20:50, 30:60] = rng.uniform(0, 1, (30, 30, 3))
    fit = make_plate(images(frames))
    inside = np.s_[22:48, 32:58]
    assert fit.plate.valid[inside].mean() > 0.95
    z = ((fit.plate.rgb - scene) / np.sqrt(fit.plate.variance))[inside][fit.plate.valid[inside]]
    assert np.mean(np.abs(z) > 4) < 0.01


def coded(path, lights, crf):
    """A clip of H.264: noise of a code value and rounding, then quantization."""
    rng = np.random.default_rng(0)
    options = {"crf": str(crf), "threads": "1"}
    with encoder(path, "libx264", lights[0].shape[1::-1], options=options) as (_, add):
        for light in lights:
            codes = 255 * SRGB.encode(light) + rng.normal(0, 1, light.shape)
            add(np.clip(np.rint(codes), 0, 255).astype(np.uint8))
    return read_frames(path, SRGB)


@pytest.mark.parametrize(("resting", "crf"), [(10, 20), (14, 23), (12, 28)])
def test_plate_of_h264_with_an_object_that_rests_and_moves_on(tmp_path, resting, crf):
    # honest: frames repeat blocks, so that their errors do not average out
    rng = np.random.default_rng(8)
    rough = 0.6 * colorful_plate((192, 128), 3, tile=24) * rng.uniform(0.6, 1, (128, 192, 1))
    scene, lights, at_rest = (0.1 + rough).astype(np.float32), [], np.s_[30:60, 20:50]
    for number in range(32):
        light, x = scene.copy(), 20 + 12 * max(number - resting, 0)
        light[30:60, x : x + 30] = BALL
        lights.append(light)
    fit = make_plate(coded(tmp_path / "clip.mp4", lights, crf))
    shown = np.mean([frame.rgb for frame in coded(tmp_path / "true.mp4", [scene] * 16, 0)], axis=0)
    error, std = fit.plate.rgb - shown, np.sqrt(fit.plate.variance + fit.coding_variance)
    valid, free = fit.plate.valid, np.ones((128, 192), bool)
    free[30:60, 20:] = False
    assert valid[free].mean() > 0.95
    assert np.mean(valid[at_rest] & (np.abs(error / std) > 5).any(axis=-1)[at_rest]) < 0.002
    assert 0.8 < np.sqrt(np.mean((error / std)[valid & free] ** 2)) < 1.25
    assert 0.8 < np.sqrt(np.mean((error / std)[valid & ~free] ** 2)) < 1.25


def test_ambiguous_pixels_are_not_valid(scene):
    # honest: an object rests in one place half of the time, another place changes all the time
    rng = np.random.default_rng(6)
    frames = [noisy(scene, 0.004, i) for i in range(50)]
    for number, frame in enumerate(frames):
        if number % 10 < 5:
            frame[5:25, 10:30] = BALL
        frame[40:60, 50:80] = rng.uniform(0, 1, (20, 30, 3))
    fit = make_plate(images(frames))
    assert fit.plate.valid[7:23, 12:28].mean() < 0.02
    assert fit.plate.valid[42:58, 52:78].mean() < 0.02
    assert (fit.coverage[7:23, 12:28] == 0).mean() > 0.98
    assert fit.plate.valid[30:38].all()


def test_drift_of_light_is_divided_out(scene):
    # honest
    drift = np.linspace(1, 1.12, 40)[:, None] ** np.array([1, 0.5, -0.7])
    frames = [noisy(with_ball(scene, i) * drift[i], 0.003, i) for i in range(40)]
    fit = make_plate(images(np.float32(frame) for frame in frames))
    relative = fit.gain / fit.gain[0]
    assert_allclose(relative, drift / drift[0], rtol=5e-4)
    middle = np.median(drift, axis=0)
    z = (fit.plate.rgb - scene * middle) / np.sqrt(fit.plate.variance)
    assert fit.plate.valid.all()
    assert np.std(z) == pytest.approx(1, abs=0.15)


def test_clipped_pixels_are_free_but_not_valid(scene):
    codes = np.rint(255 * SRGB.encode(scene)).astype(np.uint8)
    codes[10:20, 10:20] = 255
    fit = make_plate([decode(codes, SRGB)] * 5)
    assert not fit.plate.valid[10:20, 10:20].any()
    assert np.count_nonzero(~fit.plate.valid) == 100
    assert_allclose(fit.coverage, 1)


def test_three_frames_suffice(scene):
    frames = images(noisy(scene, 0.004, i) for i in range(3))
    frames[1].rgb[20:40, 30:50] = BALL
    fit = make_plate(frames)
    assert fit.plate.valid.mean() > 0.98
    assert_allclose(fit.plate.rgb[fit.plate.valid], scene[fit.plate.valid], atol=0.02)
    assert_allclose(fit.coverage[25:35, 35:45], 2 / 3, atol=1e-6)


def test_mirrored_frames_give_mirrored_plate(scene):
    # invariant
    frames = [noisy(with_ball(scene, i), 0.004, i) for i in range(20)]
    one = make_plate(images(frames))
    other = make_plate(images(np.ascontiguousarray(frame[:, ::-1]) for frame in frames))
    assert_allclose(other.plate.rgb[:, ::-1], one.plate.rgb, atol=3e-4)


def test_memory_does_not_depend_on_length(scene):
    # exact
    most = {}
    for count in (100, 300):
        frames = Streamed(lambda i: noisy(with_ball(scene, i), 0.004, i), count)
        make_plate(frames)
        most[count] = frames.most
        assert frames.runs <= 5
    assert most[300] <= most[100] <= 5


def test_camera_that_drifts_gives_a_plate_of_all_that_it_shows():
    # exact
    wide = (0.1 + 0.7 * colorful_plate((140, 100), 4, tile=9)).astype(np.float32)
    frames = [noisy(wide[4 : 4 + 80, i // 5 : i // 5 + 120], 0.003, i) for i in range(30)]
    fit = make_plate(images(frames))
    x, y = (
        fit.camera.canvas.origin
    )  # of the canvas in the frame in the middle, which begins at x = 3
    known = fit.plate.valid[-y : 80 - y, -x - 3 : 122 - x]
    shown = fit.plate.rgb[-y : 80 - y, -x - 3 : 122 - x]
    assert known[4:-4, 4:-4].mean() > 0.98
    assert np.std((shown - wide[4:84, :125])[known]) < 0.005


def test_cut_is_named_and_pan_is_not_one():
    # door
    wide = (0.1 + 0.7 * colorful_plate((400, 100), 4, tile=15)).astype(np.float32)
    frames = [noisy(wide[:100, 20 * i : 20 * i + 240], 0.003, i) for i in range(8)]
    assert make_plate(images(frames)).camera.reach == pytest.approx(80, abs=0.1)
    other = (0.1 + 0.7 * colorful_plate((240, 100), 5, tile=11)).astype(np.float32)
    cut = [*frames[:4], *(noisy(other, 0.003, i) for i in range(4))]
    with pytest.raises(PlateError, match="the scene is cut between frame 3 and frame 4"):
        make_plate(images(cut))


@pytest.mark.parametrize("faint", [0.01, 0.03])
def test_lamp_that_moves_before_a_dark_sky_is_neither_a_cut_nor_a_motion_of_the_camera(faint):
    # invariant: its light is no measure of what is bright in the scene, and its way not of a shift
    rng = np.random.default_rng(0)
    stars = np.where(rng.random((270, 480, 1)) < 0.01, faint, 0)
    sky = (0.005 + scipy.ndimage.gaussian_filter(stars, (0.8, 0.8, 0))).astype(np.float32)
    frames = [noisy(sky.repeat(3, axis=2), 0.002, i) for i in range(8)]
    for i, frame in enumerate(frames):
        frame[118:126, 40 * i + 20 : 40 * i + 60] += 0.9
    assert make_plate(images(frames)).camera is None


def test_frames_of_a_moving_camera_that_come_but_once_are_refused():
    # door
    wide = (0.1 + 0.7 * colorful_plate((140, 100), 4, tile=9)).astype(np.float32)

    def frame(i):
        return noisy(wide[4 : 4 + 80, i // 5 : i // 5 + 120], 0.003, i)

    with pytest.raises(PlateError, match=r"the camera moved: by 3\.\d pixels between frame 0 and"):
        make_plate(Streamed(frame, 30))


def test_accepts_jitter_of_a_fifth_of_a_pixel():
    from scipy.ndimage import shift

    rng = np.random.default_rng(2)
    scene = 0.1 + 0.7 * colorful_plate((90, 80), 4, tile=9)
    moved = [
        shift(scene, (*rng.uniform(-0.2, 0.2, 2), 0), order=1, mode="nearest") for _ in range(20)
    ]
    fit = make_plate(images(noisy(np.float32(m), 0.003, i) for i, m in enumerate(moved)))
    assert fit.plate.valid.mean() > 0.9


def test_accepts_plain_wall():
    wall = np.full((60, 80, 3), 0.4, np.float32)
    assert make_plate(images(noisy(wall, 0.004, i) for i in range(12))).plate.valid.all()


def test_error_for_a_cut_names_its_frame(scene):
    # door
    frames = [noisy(scene if i < 4 else scene[::-1, ::-1], 0.004, i) for i in range(10)]
    with pytest.raises(PlateError, match="cut between frame 3 and frame 4"):
        make_plate(images(frames))


def test_rejects_large_change_of_light(scene):
    # door
    frames = [noisy(scene * 2.5 ** (i / 19), 0.004, i) for i in range(20)]
    with pytest.raises(PlateError, match=r"frame 19 is 2\.\d times as bright as frame 0"):
        make_plate(images(np.float32(f) for f in frames))


def test_rejects_clipped_frames():
    # door
    white = decode(np.full((40, 40, 3), 255, np.uint8), SRGB)
    with pytest.raises(PlateError, match="no pixel of the background was found"):
        make_plate([white] * 4)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_rejects_too_few_frames(scene, count):
    # door
    with pytest.raises(PlateError, match=f"at least 3 frames, got {count}"):
        make_plate([LinearImage(scene)] * count)


def test_rejects_iterators_and_other_sizes(scene):
    # door
    frames = [LinearImage(scene)] * 4
    with pytest.raises(TypeError, match="only once"):
        make_plate(iter(frames))
    with pytest.raises(ValueError, match="frame 4 is 96x60, others 96x72"):
        make_plate([*frames, LinearImage(scene[:60])])


class Blocks:
    """Parts of a clip, one after another."""

    def __init__(self, parts):
        self.parts = parts

    def __iter__(self):
        for part in self.parts:
            yield from part


def test_plates_of_halves_of_a_real_clip_agree(real_data):
    # honest: a ball swings on a string in front of a board; plates of alternate parts of the clip agree
    # within their errors where both were free often enough
    pytest.importorskip("av")
    frames = read_frames(real_data / "circle_faster.avi", REC709)
    stretches = [frames[i : i + 7] for i in range(0, 112, 7)]
    one, other = (make_plate(Blocks(stretches[i::2])) for i in (0, 1))
    both = one.plate.valid & other.plate.valid
    both &= np.minimum(one.coverage, other.coverage) >= 0.2
    assert both.mean() > 0.88
    variance = one.plate.variance + other.plate.variance
    z = ((one.plate.rgb - other.plate.rgb) / np.sqrt(variance))[both]
    assert 0.8 < np.std(z) < 1.1
    assert np.mean(np.sqrt(np.mean(z**2, axis=-1)) > 3) < 0.003


def test_frame_in_the_middle_of_three_does_not_change_the_plate_below_it(scene):
    # honest: of the pairs of consecutive frames both contain it
    faint = scene.copy()
    faint[20:40, 30:50] = 0.9 * scene[20:40, 30:50] + 0.1 * BALL
    z = []
    for seed in range(6):
        frames = [
            noisy(light, 0.006, 3 * seed + k) for k, light in enumerate((scene, faint, scene))
        ]
        plate = make_plate(images(frames)).plate
        away = np.abs(0.1 * (BALL - scene)).max(axis=-1) > 0.04
        away[:20] = away[40:] = away[:, :30] = away[:, 50:] = False
        z.append(
            ((plate.rgb - scene) * np.sign(BALL - scene) / np.sqrt(plate.variance))[away].mean()
        )
    assert abs(np.mean(z)) < 0.15


def test_plate_without_a_frame_is_that_of_the_others(scene):
    # exact: one that is not part of the mean of a pixel changes nothing there
    lights = [noisy(with_ball(scene, 8 * i), 0.004, i) for i in range(5)]
    frames = images(
        gain * light for gain, light in zip((1, 1.05, 1, 0.97, 1.02), lights, strict=True)
    )
    fit = make_plate(frames)
    box = (3, 10, 80, 60)
    inner = np.s_[10:60, 3:80]
    for k, frame in enumerate(frames):
        bits = fit.shares.free[inner]
        free = np.array([bits >> i & 1 for i in range(5)], bool)
        others = np.array([f.rgb[inner] / g for f, g in zip(frames, fit.gain, strict=True)])
        weights = free[..., None] * (np.arange(5) != k)[:, None, None, None]
        mean = (weights * others).sum(0) / np.maximum(weights.sum(0), 1)
        plate = fit.shares.without(k, frame.crop(box), fit.plate.crop(box), box)
        some = weights.sum(0)[..., 0] > 0
        assert_allclose(plate.rgb[some], mean[some], atol=2e-6)
        inflation = plate.variance / fit.plate.variance[inner]
        assert_allclose(inflation[~free[k]], 1)
        count = free.sum(0)[free[k] & some]
        assert_allclose(inflation[free[k] & some][:, 0], count / (count - 1), rtol=1e-6)
