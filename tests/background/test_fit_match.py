from dataclasses import replace

import numpy as np
import pytest
from tests.scenes import on_line

import blurmatte as bm
from blurmatte.background.fit_match import agreement
from blurmatte.calibration import with_noise
from blurmatte.rendering import colorful_plate
from blurmatte.rendering.plates import plain_plate
from blurmatte.rendering.shot import Drift

SIZE = (240, 180)
NOISE = bm.NoiseModel(read_std=0.005)


def scene(seed=0, plate=colorful_plate):
    """Exact image and plate; a ball moves over 6 % of the picture."""
    rng = np.random.default_rng(seed)
    light = plate(SIZE, rng) if plate is colorful_plate else plate(SIZE, np.full(3, 0.4), rng)
    ball = bm.rendering.Ball(16, (0.9, 0.5, 0.1))
    return on_line(light, (60, 60), (130, 110), ball)


def photographed(rendering, drift, seed, std=0.005):
    rng = np.random.default_rng(seed)
    C, B = rendering.image.rgb, drift.apply(rendering.plate.rgb)
    return [bm.LinearImage(x + rng.normal(0, std, x.shape), NOISE) for x in (C, B)]


RENDERING = scene()


def test_recovers_shift_and_gain():
    """honest: within 0.02 px and 0.2 %, with a streak over 6 % of the picture."""
    image, plate = photographed(RENDERING, Drift(shift=(1.37, -2.28), gain=(1.15,) * 3), 1)
    match = bm.background.fit_match(image, plate)
    assert np.allclose(match.shift, (1.37, -2.28), atol=0.02)
    assert np.allclose(match.gain, 1 / 1.15, rtol=0.002)
    center = np.array([(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2, 1])
    assert np.allclose((match.homography @ center - center)[:2], match.shift)
    assert "shifted by +1.3" in match.in_words
    assert "light times 0.87" in match.in_words


def test_shift_agrees_with_enhanced_correlation():
    """oracle: OpenCV's ECC [Evangelidis, Psarakis 2008] on the pixels where nothing moved.

    It does not model noise, and is up to 0.04 px off the truth.
    """
    cv2 = pytest.importorskip("cv2")
    image, plate = photographed(RENDERING, Drift(shift=(0.6, 0.3)), 2)
    still = np.uint8(RENDERING.layer.alpha == 0)
    gray = [picture.rgb.mean(axis=-1).astype(np.float32) for picture in (image, plate)]
    start = np.eye(2, 3, dtype=np.float32)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-6)
    _, found = cv2.findTransformECC(*gray, start, cv2.MOTION_TRANSLATION, stop, still, 5)
    assert np.allclose(bm.background.fit_match(image, plate).shift, found[:, 2], atol=0.05)


def test_returns_identity_for_matching_plate():
    """invariant: noise alone changes no plate of two kinds."""
    for rendering in (RENDERING, scene(3, plain_plate)):
        for seed in range(4):
            image, plate = photographed(rendering, Drift(), seed)
            assert bm.match_plate(plate, image) is plate


def test_large_object_does_not_change_light():
    """invariant: an object that covers a third of a plain picture."""
    rng = np.random.default_rng(5)
    ball = bm.rendering.Ball(48, (0.2, 0.2, 0.2))
    rendering = on_line(plain_plate(SIZE, np.full(3, 0.5), rng), (90, 80), (150, 100), ball)
    assert np.mean(rendering.layer.alpha > 0) > 0.25
    image, plate = photographed(rendering, Drift(), 1)
    assert bm.match_plate(plate, image) is plate


def test_keeps_light_of_plain_wall():
    """invariant: a small gain and an offset would remove the noise of an even wall."""
    ball = bm.rendering.Ball(16, (0.9, 0.5, 0.1))
    wall = np.broadcast_to(np.array([0.3, 0.38, 0.35]), (SIZE[1], SIZE[0], 3)).copy()
    truth = on_line(wall, (60, 60), (130, 110), ball)
    for seed in range(3):
        image, plate = photographed(truth, Drift(), seed, 0.01)
        assert np.allclose(bm.background.fit_match(image, plate).gain, 1, atol=0.01)


@pytest.mark.parametrize("moved", [0.0, 0.4])
def test_soft_shadows_on_a_shaded_wall_are_no_motion(moved):
    """exact: only the edge of the floor shows a displacement, and none but a vertical one."""
    rng, (width, height) = np.random.default_rng(0), (480, 320)
    y, x = np.mgrid[:height, :width]

    def wall(down):
        lit = 0.25 + 0.4 * np.exp(-((x - 330) ** 2 + (y - down - 60) ** 2) / 2 / 220**2)
        lit -= 0.15 / (1 + np.exp(288 + down - y))
        return lit[..., None] * np.array([0.9, 0.85, 0.8])

    def shadow(at, width):
        return 0.04 * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / 2 / width**2)[..., None]

    light = wall(moved) * (1 - shadow((190, 240), 60) - shadow((150, 120), 90))
    image, plate = (
        bm.LinearImage(each + rng.normal(0, 0.003, each.shape), bm.NoiseModel(read_std=0.003))
        for each in (light, wall(0.0))
    )
    match = bm.background.fit_match(image, plate)
    across, down = match.shift
    assert match.moves == (moved > 0)
    assert abs(down + moved) < 0.02
    assert abs(across) < 0.1


def test_recovers_rotation():
    drift = Drift(shift=(1.0, 2.0), rotation=0.008)
    image, plate = photographed(RENDERING, drift, 4)
    match = bm.background.fit_match(image, plate)
    assert match.angle == pytest.approx(0.008, abs=2e-4)
    assert np.allclose(match.shift, (1, 2), atol=0.02)
    known = match.apply(bm.LinearImage(drift.apply(RENDERING.plate.rgb)))
    inner = (slice(10, -10), slice(10, -10))
    assert known.valid[inner].all()
    off = (known.rgb - RENDERING.plate.rgb)[inner]
    assert np.sqrt(np.mean(off**2)) < 0.1 * np.sqrt(
        np.mean((drift.apply(RENDERING.plate.rgb) - RENDERING.plate.rgb)[inner] ** 2)
    )


def test_recovers_light_field():
    image, plate = photographed(RENDERING, Drift(), 5)
    x = np.linspace(-1, 1, SIZE[0])[None, :, None]
    plate = replace(plate, rgb=plate.rgb * (1 + 0.1 * x))
    match = bm.background.fit_match(image, plate)
    assert match.light[2:].any()
    flat = match.apply(plate).rgb / RENDERING.plate.rgb
    assert np.abs(np.median(flat, axis=(0, 2)) - 1).max() < 0.01


def test_matching_restricts_the_model():
    """invariant"""
    image, plate = photographed(RENDERING, Drift(shift=(1.4, 0.5), gain=(1.05, 1.0, 0.95)), 6)
    fits = {m: bm.background.fit_match(image, plate, m) for m in bm.background.Matching}
    assert fits[bm.background.Matching.NONE].apply(plate) is plate
    assert not fits[bm.background.Matching.EXPOSURE].moves
    assert fits[bm.background.Matching.EXPOSURE].changes_light
    assert fits[bm.background.Matching.SHIFT].moves
    assert not fits[bm.background.Matching.SHIFT].h[[0, 1, 3, 4, 6, 7]].any()
    assert fits[bm.background.Matching.FULL].h.all()


def test_errors_of_shifts_are_honest_and_those_of_gains_45_percent_too_small():
    """honest: over seeds; gains are biased by their standard deviation."""
    truth = np.array([0.7, -1.2]), 1 / np.array([1.04, 1.0, 0.97])
    of_shift, of_gain = [], []
    for seed in range(40):
        drift = Drift(shift=tuple(truth[0]), gain=tuple(1 / truth[1]))
        match = bm.background.fit_match(
            *photographed(RENDERING, drift, 10 + seed), bm.background.Matching.SHIFT
        )
        of_shift.append((match.shift - truth[0]) / match.shift_std)
        of_gain.append((match.gain - truth[1]) / match.light_std[0])
    assert 0.8 < np.sqrt(np.mean(np.square(of_shift))) < 1.25
    assert 1.25 < np.sqrt(np.mean(np.square(of_gain))) < 1.65


def test_matched_plate_has_variance_of_its_noise():
    """honest: interpolation smooths noise."""
    drift = Drift(shift=(0.5, 0.5))
    truth = bm.LinearImage(drift.apply(RENDERING.plate.rgb))
    image, plate = photographed(RENDERING, drift, 7)
    match = bm.background.fit_match(image, plate, bm.background.Matching.SHIFT)
    off = (match.apply(plate).rgb - match.apply(truth).rgb)[8:-8, 8:-8]
    variance = match.apply(plate).variance[8:-8, 8:-8]
    assert np.mean(off**2 / variance) == pytest.approx(1, rel=0.05)


def test_agreement_is_one_for_matching_plate():
    """honest: and much more at the edges of a shifted one."""
    assert np.allclose(agreement(*photographed(RENDERING, Drift(), 8)), 1, atol=0.08)
    image, plate = photographed(RENDERING, Drift(shift=(1.0, 0.0)), 8)
    assert agreement(image, plate)[1] > 2
    assert agreement(image, bm.match_plate(plate, image))[1] < 1.5


def test_solve_matches_by_default():
    image, plate = (
        picture.with_noise(None)
        for picture in photographed(RENDERING, Drift(shift=(1.2, -0.6), gain=(1.06,) * 3), 9, 0.002)
    )
    model = bm.ColorModel.from_samples(np.array([[0.9, 0.5, 0.1]]), std=1e-4)
    with pytest.warns(bm.errors.PlateWarning, match="brightness differs"):
        plain = bm.solve(image, plate, model, bm.Pixelwise(), matching=bm.background.Matching.NONE)
    matched = bm.solve(image, plate, model, bm.Pixelwise())
    assert np.allclose(matched.stats.match.shift, (1.2, -0.6), atol=0.02)
    inside = RENDERING.layer.alpha > 0
    off = [
        np.sqrt(np.mean((solution.alpha - RENDERING.layer.alpha)[inside & solution.known] ** 2))
        for solution in (plain, matched)
    ]
    assert off[1] < off[0] / 2


def test_rejects_changed_light_and_other_sizes():
    """door"""
    image, plate = photographed(RENDERING, Drift(), 1)
    with pytest.raises(bm.errors.PlateError, match="light changed too much: the image is 5"):
        bm.background.fit_match(image, replace(plate, rgb=plate.rgb / 5))
    with pytest.raises(ValueError, match="plate is 240x180 pixels and the match 100x50"):
        bm.background.Match.nothing((100, 50)).apply(plate)
    with pytest.raises(ValueError, match="image is 100x50"):
        bm.background.fit_match(image.crop((0, 0, 100, 50)), plate)
    with pytest.raises(ValueError, match="h must have the shape"):
        bm.background.Match((2, 2), *(np.zeros(3),) * 4)


def test_rejects_another_scene():
    """door: no homography maps one to the other."""
    image, _ = photographed(RENDERING, Drift(), 1)
    _, plate = photographed(scene(7), Drift(), 1)
    with pytest.raises(bm.errors.PlateError, match="do not show the same scene"):
        bm.background.fit_match(image, plate)


def test_returns_identity_for_small_pictures():
    """invariant: too few pixels for a match."""
    image, plate = photographed(RENDERING, Drift(), 1)
    box = (0, 0, 20, 20)
    small = plate.crop(box)
    assert bm.match_plate(small, image.crop(box)) is small


def test_matches_without_known_noise():
    """invariant: unknown noise stays unknown."""
    image, plate = photographed(RENDERING, Drift(shift=(0.8, 0.0)), 3)
    unknown = [picture.with_noise(None) for picture in (image, plate)]
    match = bm.background.fit_match(*unknown)
    assert match.shift[0] == pytest.approx(0.8, abs=0.02)
    assert match.apply(unknown[1]).noise is None
    with_noise(unknown[0], match.apply(unknown[1]))


def banded(rendering, waves, seed, std=0.004, axis=0):
    """Image and plate under lamps: gains of (period, amplitude, phase) each, in rows or columns."""
    rng, pictures = np.random.default_rng(seed), []
    for light, (period, amplitude, phase) in zip(
        (rendering.image.rgb, rendering.plate.rgb), waves, strict=True
    ):
        position = np.arange(light.shape[axis])
        gain = 1 + np.sin(2 * np.pi * position / period + phase)[:, None] * np.array(amplitude)
        gain = gain[:, None] if axis == 0 else gain[None]
        noisy = light * gain + rng.normal(0, std, light.shape)
        pictures.append(bm.LinearImage(noisy, bm.NoiseModel(read_std=std)))
    return pictures


@pytest.mark.parametrize(
    ("period", "amplitude", "axis"),
    [(70, (0.1, 0.1, 0.1), 0), (40, (0.03, 0.03, 0.03), 0), (55, (0.02, 0.06, 0.09), 1)],
)
def test_describes_bands_of_lamps(period, amplitude, axis):
    """exact: the ratio of two sines, whose amplitude per channel and period are known."""
    waves = [(period, amplitude, 0.3), (period, amplitude, 2.2)]
    image, plate = banded(RENDERING, waves, 5, axis=axis)
    match = bm.background.fit_match(image, plate, bm.background.Matching.EXPOSURE)
    assert f"in bands of {period} {('rows', 'columns')[axis]}" in match.in_words
    position = np.arange(image.rgb.shape[axis])[:, None]
    ratio = [1 + np.sin(2 * np.pi * position / period + w[2]) * np.array(w[1]) for w in waves]
    fitted = match.light[0] + match.bands.gain(image.size)
    assert np.abs(fitted - ratio[0] / ratio[1]).max() < 0.1 * max(amplitude)
    assert np.all(match.bands.gain_std(image.size) < 0.05 * max(amplitude))


@pytest.mark.battery
def test_bands_before_a_plain_wall_are_no_motion():
    image, plate = banded(scene(3, plain_plate), [(50, 0.1, 0.0), (50, 0.1, 2.0)], 1)
    match = bm.background.fit_match(image, plate)
    assert match.bands is not None
    assert not match.moves


@pytest.mark.battery
def test_streak_across_the_picture_is_no_band():
    """invariant: it changes some rows only, but most of their pixels."""
    light = colorful_plate(SIZE, np.random.default_rng(7))
    ball = bm.rendering.Ball(18, (0.9, 0.5, 0.1))
    rendering = on_line(light, (20, 90), (220, 90), ball)
    image, plate = photographed(rendering, Drift(), 1)
    assert bm.match_plate(plate, image) is plate
