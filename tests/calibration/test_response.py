"""A camera's curve from a bracket: known curves are recovered, errors calibrated, bad brackets
rejected.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import blurmatte as bm
from blurmatte.calibration.response_inputs import CELLS, response_prior
from blurmatte.radiometry import Meta

FIVE = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4)
V = np.arange(256) / 255


def inverse(decode):
    """The curve from light to code values, inverted by table."""
    codes = np.linspace(0, 1, 20001)
    light = decode(codes)
    return lambda x: np.interp(x, light, codes)


def smooth_s(v):
    """sRGB after a mild S of a polynomial, which the model of cameras does not know."""
    codes = np.linspace(0, 1, 20001)
    s = 0.5 * codes + 0.5 * (3 * codes**2 - 2 * codes**3)
    return bm.SRGB.decode(np.interp(v, s, codes))


def filmic(v):
    """The film-like curve of J. Hable (Uncharted 2, GDC 2010), which the model does not know either."""

    def tone(x):
        return (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3

    light = np.linspace(0, 1, 100001)
    codes = bm.SRGB.encode(np.maximum(tone(8 * light), 0) / tone(8.0))
    return np.interp(v, codes, light)


CURVES = {
    "gamma1": bm.radiometry.gamma(1).decode,
    "gamma2.2": bm.radiometry.gamma(2.2).decode,
    "rec709": bm.radiometry.REC709.decode,
    "srgb": bm.SRGB.decode,
    "smooth_s": smooth_s,
    "filmic": filmic,
}


def scene(rng, size=(120, 90)):
    """(H, W, 3) light of patches from 1/300 to 3, gently shaded."""
    width, height = size
    patches = np.exp(rng.uniform(np.log(1 / 300), np.log(3), (height // 9, width // 9 + 1, 3)))
    light = np.kron(patches, np.ones((9, 9, 1)))[:height, :width]
    y, x = np.mgrid[: light.shape[0], :width]
    return light * np.exp(0.3 * np.sin(x / 17) + 0.2 * np.cos(y / 13))[..., None]


def shoot(light, decode, times, rng, sigma=1.5, declared=None, gray=False):
    """8-bit pictures of `light`; `declared` are the exposure times of their files."""
    pictures = []
    middle = np.exp(np.mean(np.log(times)))
    for time, name in zip(times, declared or times, strict=True):
        codes = inverse(decode)(np.minimum(light * time / middle, 1))
        codes = np.rint(255 * codes + rng.normal(0, sigma, codes.shape)).clip(0, 255)
        pictures.append(as_read(codes / 255, name, gray))
    return pictures


def as_read(codes, time=None, gray=False):
    meta = Meta(source=f"{time}", transfer=bm.LINEAR, levels=256, exposure_time=time, gray=gray)
    return bm.LinearImage(codes.astype(np.float32), meta=meta)


@pytest.mark.parametrize("name", CURVES)
def test_five_exposures_give_the_curve_to_a_hundredth(name):
    """Oracle: the curve of the pictures; the shoulder of film is less certain, with larger errors."""
    rng = np.random.default_rng(3)
    fit = bm.calibration.fit_response(shoot(scene(rng), CURVES[name], FIVE, rng, gray=True))
    error = np.abs(fit.transfer.decode(V) - CURVES[name](V))
    assert error.max() < (0.02 if name == "filmic" else 0.01)
    assert_allclose(255 * fit.noise, 1.53, atol=0.06)  # with rounding
    assert fit.agreement > 0.99
    assert np.nanmax(np.abs(fit.residuals)) < 2 / 255


def errors(times, seed, time_std):
    """(error, std) of one curve's fit with as wrong times as `time_std` says."""
    rng = np.random.default_rng(seed)
    decode = CURVES[("gamma2.2", "srgb", "smooth_s", "filmic")[seed % 4]]
    true = tuple(np.array(times) * np.exp(rng.normal(0, time_std, len(times))))
    pictures = shoot(scene(rng), decode, true, rng, declared=times, gray=True)
    fit = bm.calibration.fit_response(pictures, time_std=time_std)
    return fit.transfer.decode(V[:-1]) - decode(V[:-1]), fit.std[:-1]


@pytest.mark.parametrize(
    ("times", "seeds"),
    [
        ((1 / 64, 1 / 16, 1 / 4), 8),
        pytest.param((1 / 32, 1 / 16), 24, marks=pytest.mark.battery),
    ],
)
def test_std_of_the_curve_is_calibrated(times, seeds):
    """Honest: for several curves and wrong times, errors have the stated spread."""
    z = np.concatenate([np.divide(*errors(times, seed, 0.02)) for seed in range(seeds)])
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.25
    assert np.mean(np.abs(z) < 2) > 0.85


def test_fewer_pictures_and_uncertain_times_increase_errors():
    """Invariant: less information gives larger errors."""
    rng = np.random.default_rng(0)
    five = shoot(scene(rng), bm.SRGB.decode, FIVE, rng, gray=True)
    stds = [
        bm.calibration.fit_response(some, time_std=time_std).std.max()
        for some, time_std in [(five, 0.02), (five[2:4], 0.02), (five[2:4], 0.05)]
    ]
    assert np.all(np.diff(stds) > 0)


def test_nominal_times_are_corrected():
    """Oracle: times of 1/16 declared as 1/15 and so on; only a common factor remains."""
    rng = np.random.default_rng(1)
    nominal = (1 / 250, 1 / 125, 1 / 60, 1 / 30, 1 / 15)
    true = (1 / 256, 1 / 128, 1 / 64, 1 / 32, 1 / 16)
    fit = bm.calibration.fit_response(
        shoot(scene(rng), bm.SRGB.decode, true, rng, declared=nominal, gray=True)
    )
    assert np.abs(fit.transfer.decode(V) - bm.SRGB.decode(V)).max() < 0.012
    steps = np.diff(np.log(fit.exposure_times)) - np.log(2)
    assert np.ptp(steps) < np.ptp(np.diff(np.log(nominal))) / 3


def test_motion_and_clipping_do_not_bias_the_curve():
    """Invariant: 4 % of one picture has moved, and a third of another is clipped."""
    rng = np.random.default_rng(2)
    light = scene(rng)
    pictures = shoot(light, bm.SRGB.decode, FIVE, rng)
    moved = pictures[2].rgb.copy()
    moved[30:50, 60:82] = 0.7
    shifted = np.roll(pictures[1].rgb, 1, axis=1)  # and one is not aligned
    pictures[2] = replace(pictures[2], rgb=moved)
    pictures[1] = replace(pictures[1], rgb=shifted)
    assert np.mean(pictures[4].rgb >= 1) > 0.2
    fit = bm.calibration.fit_response(pictures)
    assert np.abs(fit.transfer.decode(V) - bm.SRGB.decode(V)).max() < 0.012
    assert 0.85 < fit.agreement < 0.999


def test_white_balance_and_order_change_nothing():
    """Invariant: channels may be brighter than others, pictures may come in any order."""
    rng = np.random.default_rng(4)
    light = scene(rng)
    pictures = shoot(light * (0.5, 1.0, 0.8), bm.radiometry.REC709.decode, FIVE[1:4], rng)
    fit = bm.calibration.fit_response(pictures)
    assert fit.channels_agree
    again = bm.calibration.fit_response(pictures[::-1])
    assert_allclose(again.transfer.decode(V), fit.transfer.decode(V), atol=1e-12)


def test_detects_channels_with_different_curves():
    """Oracle: blue was coded with another curve."""
    rng = np.random.default_rng(5)
    light = scene(rng)
    pictures = shoot(light, bm.radiometry.gamma(2.2).decode, FIVE[1:4], rng)
    other = shoot(light, bm.radiometry.gamma(1.8).decode, FIVE[1:4], rng)
    for picture, strange in zip(pictures, other, strict=True):
        picture.rgb[..., 2] = strange.rgb[..., 2]
    fit = bm.calibration.fit_response(pictures)
    assert not fit.channels_agree
    assert max(fit.channel_difference) > 0.02
    assert any("do not have one curve" in line for line in bm.explain(fit))


def test_curve_increases_from_black_to_one():
    """Invariant: for any noise, and where there are no data."""
    rng = np.random.default_rng(6)
    light = np.clip(scene(rng), 0.05, 0.3)
    fit = bm.calibration.fit_response(
        shoot(light, bm.SRGB.decode, (1 / 20, 1 / 10), rng, sigma=3, gray=True)
    )
    table = fit.transfer.table(4096)
    assert np.all(np.diff(table) > 0)
    assert_allclose(table[-1], 1)
    assert abs(table[0]) < 0.01
    assert fit.std[-1] < 1e-12
    low, high = fit.seen
    assert fit.std[int(255 * high) + 3] > 0 < low


def test_prior_has_few_dimensions():
    """Oracle: each curve of the family is its mean and components again, to 1 % of full scale."""
    prior = response_prior()
    assert prior.basis.shape[0] == CELLS
    assert prior.basis.shape[1] < 30
    srgb = np.diff(bm.SRGB.decode(np.arange(CELLS + 1) / CELLS))
    again = np.exp(prior.mean + prior.basis @ prior.members[0])
    light = np.cumsum(again) / np.sum(again)
    assert_allclose(light, np.cumsum(srgb), atol=0.01)
    assert 0.3 < np.mean(prior.members**2) < 1  # the rest is what no formula knows


def flat(value, time):
    """An even picture with a little noise."""
    codes = value + np.random.default_rng(0).normal(0, 0.004, (40, 50, 3))
    return as_read(np.rint(255 * codes.clip(0, 1)) / 255, time)


@pytest.mark.parametrize(
    ("pictures", "times", "says"),
    [
        ([flat(0.5, 1)], None, "pictures must be two or more, got 1"),
        ([flat(0.5, 1), flat(0.6, None)], None, "None has no exposure time"),
        ([flat(0.5, 1), flat(0.6, 1)], None, "the exposure times are all about 1 s"),
        ([flat(0.5, 1), flat(0.6, 2)], [1, 2, 3], "exposure_times must be 2 numbers, got 3"),
        ([flat(0.5, 1), flat(0.6, 2)], [1, 0], "exposure_times must be positive seconds"),
        ([flat(0.5, 1), flat(0.6, 2)], [1, np.nan], "exposure_times must be positive seconds"),
    ],
)
def test_rejects_wrong_arguments(pictures, times, says):
    """Door: each wrong argument is named."""
    with pytest.raises(ValueError, match=says):
        bm.calibration.fit_response(pictures, times)


@pytest.mark.parametrize(
    ("pictures", "says"),
    [
        ([flat(0.0, 1), flat(0.5, 64)], "1 and 64 have no code values in common"),
        ([flat(1.1, 1), flat(1.2, 2)], "1 and 2 have no code values in common"),
        ([flat(0.6, 1), flat(0.5, 2)], "1 and 2 are equally bright, or the second darker"),
    ],
)
def test_rejects_brackets_that_do_not_determine_a_curve(pictures, says):
    """Door: one line with the cause."""
    with pytest.raises(bm.errors.ResponseError, match=says):
        bm.calibration.fit_response(pictures)


def test_rejects_arrays():
    """Door: arrays have neither exposure time nor levels."""
    with pytest.raises(TypeError, match="pictures must be LinearImages, got ndarray"):
        bm.calibration.fit_response([flat(0.5, 1), flat(0.6, 2).rgb])


def test_rejects_decoded_pictures_and_profiles():
    """Door: sizes, decoded pictures, times out of range, scenes that changed."""
    first = flat(0.4, 1)
    with pytest.raises(ValueError, match=r"1 is 50x40 pixels and 2 20x40"):
        bm.calibration.fit_response([first, flat(0.5, 2).crop((0, 0, 20, 40))])
    srgb = replace(first, meta=replace(first.meta, transfer=bm.SRGB))
    with pytest.raises(ValueError, match="code values are needed without decoding"):
        bm.calibration.fit_response([srgb, flat(0.5, 2)])
    mixed = replace(first, meta=replace(first.meta, converted=True))
    with pytest.raises(
        bm.errors.ResponseError, match="its color profile or tags state other primaries"
    ):
        bm.calibration.fit_response([mixed, flat(0.5, 2)])
    with pytest.raises(ValueError, match="time_std must lie between 0 and 1"):
        bm.calibration.fit_response([first, flat(0.5, 2)], time_std=-1)
    rng = np.random.default_rng(7)
    many = [shoot(scene(rng), bm.SRGB.decode, (t,), rng, gray=True)[0] for t in (1, 2, 4)]
    for n, picture in enumerate(many):  # three scenes, each brighter than the last
        rgb = (0.2 + 0.15 * n + 0.3 * picture.rgb).astype(np.float32)
        many[n] = replace(picture, rgb=rgb)
    with pytest.raises(bm.errors.ResponseError, match=r"no curve explains|too noisy"):
        bm.calibration.fit_response(many)


def test_uniform_scene_gives_a_large_std():
    """Honest: two brightnesses of one gray have little information."""
    fit = bm.calibration.fit_response([flat(0.4, 1), flat(0.55, 2)])
    assert fit.std.max() > 0.01
