"""guess_plate: the scene behind an object from its surroundings, with an error that is true."""

import numpy as np
import pytest
import scipy
from numpy.testing import assert_array_equal

from blurmatte.background import PlateGuess, guess_plate, regions_that_stand_out
from blurmatte.background.guess import noise_around
from blurmatte.errors import PlateError
from blurmatte.radiometry import LinearImage, Meta, Noise

NOISE = 0.004
REGION = np.zeros((72, 96), bool)
REGION[26:46, 30:66] = True


def wall(seed, texture=0.0, reach=6.0):
    """A wall in light that falls off, with smooth texture of a standard deviation; and its picture."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:72, :96] / 96
    shade = 0.4 + 0.2 * x - 0.15 * (x - 0.4) ** 2 - 0.2 * (y - 0.3) ** 2
    field = scipy.ndimage.gaussian_filter(rng.standard_normal((72, 96)), reach, mode="wrap")
    scene = (shade + texture * field / field.std())[..., None] * (1, 0.9, 0.75)
    return scene, LinearImage(scene + rng.normal(0, NOISE, scene.shape))


def covered(picture):
    """The picture with something bright in the region."""
    rgb = picture.rgb.copy()
    rgb[REGION] = 3.0
    return LinearImage(rgb)


def test_wall_is_guessed_within_a_conservative_error():
    """Honest: a plane is smoother than most fields of which its cells may be a sample."""
    scene, picture = wall(0)
    guess = guess_plate(covered(picture), REGION)
    error = (guess.rgb - scene)[REGION]
    assert np.abs(error).max() < NOISE
    assert np.sqrt(np.mean(error**2 / guess.variance[REGION])) < 0.5
    assert guess.image_noise.variance(scene)[REGION].mean() == pytest.approx(NOISE**2, rel=0.3)


def test_picture_is_unchanged_where_the_scene_is_seen():
    _, picture = wall(1)
    guess = guess_plate(covered(picture), REGION)
    assert_array_equal(guess.rgb[~REGION], picture.rgb[~REGION])
    first, *others = guess.plates
    assert not any(isinstance(one, PlateGuess) for one in guess.plates)
    assert_array_equal(first.rgb, guess.rgb)
    for other in others:
        assert_array_equal(other.rgb[~REGION], picture.rgb[~REGION])


@pytest.mark.parametrize(
    ("reach", "seeds", "least", "largest"),
    [
        (1.0, 3, 0.8, 1.25),
        pytest.param(1.0, 12, 0.8, 1.25, marks=pytest.mark.battery),
        pytest.param(6.0, 12, 1.1, 1.4, marks=pytest.mark.battery),
    ],
)
def test_errors_of_pixels_and_of_their_sum_are_honest_or_a_quarter_too_small(
    reach, seeds, least, largest
):
    """Honest: true errors over claimed ones, of pixels by the variance, of sums by draws.

    Those of pixels before texture as wide as the region are a quarter too small.
    """
    pixels, sums = [], []
    for seed in range(seeds):
        scene, picture = wall(seed, texture=0.05, reach=reach)
        guess = guess_plate(covered(picture), REGION)
        error = (guess.rgb - scene)[REGION]
        pixels.append(np.mean(error**2 / guess.variance[REGION]))
        drawn = [(one.rgb - guess.rgb)[REGION].sum() ** 2 for one in guess.plates[1:]]
        sums.append(error.sum() ** 2 / np.mean(drawn))
    assert least < np.sqrt(np.mean(pixels)) < largest
    assert 0.8 < np.sqrt(np.mean(sums)) < 1.25


def test_holes_of_a_plate_are_guessed():
    scene, picture = wall(2)
    plate = LinearImage(picture.rgb, valid=~REGION)
    guess = guess_plate(plate, REGION)
    assert_array_equal(guess.hidden, REGION)
    assert guess.valid.all()
    assert np.abs(guess.rgb - scene)[REGION].max() < NOISE


def test_region_without_surroundings_is_refused():
    _, picture = wall(0)
    with pytest.raises(PlateError, match="too little of the scene"):
        guess_plate(picture, np.ones_like(REGION))
    with pytest.raises(ValueError, match="empty"):
        guess_plate(picture, np.zeros_like(REGION))
    with pytest.raises(ValueError, match="shape"):
        guess_plate(picture, REGION[1:])


def straight_edge(rng):
    """A wall over a darker floor; the edge between them has a slope."""
    y, x = np.mgrid[:72, :96]
    slope = rng.uniform(-0.15, 0.15)
    floor = np.clip(y - 36 - slope * (x - 48) + 0.5, 0, 1)[..., None]
    return (1 - floor) * (0.5, 0.45, 0.4) + floor * (0.2, 0.25, 0.15)


def stripes(rng):
    """Stripes about 12 pixels wide."""
    y, x = np.mgrid[:72, :96]
    angle, width = rng.uniform(-0.2, 0.2), rng.uniform(9, 15)
    across = np.sin(2 * np.pi * (y * np.cos(angle) + x * np.sin(angle)) / width)
    return (0.4 + 0.1 * np.tanh(4 * across))[..., None] * (1, 0.9, 0.75)


def edge_on_the_right(rng):
    """The straight edge, which ends behind the region: nothing says where."""
    scene = straight_edge(rng)
    scene[:, :48] = scene[0, 0]
    return scene


def guess_errors(made, seed):
    """Errors of the light of pixels in the region, and these over the claimed ones."""
    rng = np.random.default_rng(seed)
    scene = made(rng)
    guess = guess_plate(covered(LinearImage(scene + rng.normal(0, NOISE, scene.shape))), REGION)
    error = (guess.rgb - scene)[REGION]
    return error, error / np.sqrt(guess.variance[REGION])


@pytest.mark.parametrize("made", [straight_edge, stripes])
def test_lines_that_cross_the_region_are_continued(made):
    """Without lines the root mean square errors are 0.08 and 0.06."""
    error, _ = guess_errors(made, 0)
    assert np.sqrt(np.mean(error**2)) < 0.02


@pytest.mark.battery
@pytest.mark.parametrize(("made", "ratio"), [(straight_edge, 0.23), (stripes, 0.68)])
def test_errors_of_lines_that_are_continued_are_conservative(made, ratio):
    """Honest but for a factor: as of a wall, the lines are smoother than others that may be there."""
    z = [guess_errors(made, seed)[1] for seed in range(12)]
    assert 0.8 < np.sqrt(np.mean(np.square(z))) / ratio < 1.25


@pytest.mark.parametrize("draws", [3, pytest.param(12, marks=pytest.mark.battery)])
def test_error_of_an_edge_that_only_one_side_shows_is_a_quarter_too_small(draws):
    """Honest: true errors over claimed ones, 1.28 over many draws."""
    z = [guess_errors(edge_on_the_right, seed)[1] for seed in range(draws)]
    assert 1.1 < np.sqrt(np.mean(np.square(z))) < 1.4


@pytest.mark.parametrize(("height", "first"), [(71, 41), (72, 0)])
def test_region_at_the_border_is_guessed_wholly(height, first):
    """A side of 71 pixels is no multiple of a cell; what is hidden is not cut off."""
    scene, picture = wall(0)
    rgb, region = picture.rgb[:height].copy(), np.zeros((height, 96), bool)
    region[first:, 40:54] = True
    rgb[region] = 3.0
    guess = guess_plate(LinearImage(rgb), region)
    assert len(guess.plates) > 2
    assert np.abs(guess.rgb - scene[:height])[region].max() < 5 * NOISE


def test_what_stands_out_from_a_wall_is_proposed_and_a_wall_alone_is_not():
    _, picture = wall(0)
    assert regions_that_stand_out(picture) == []
    rgb = picture.rgb.copy()
    rgb[30:42, 36:60] = 0.5 * rgb[30:42, 36:60] + 0.5 * np.array([0.05, 0.1, 0.6])
    ((x0, y0, x1, y1),) = regions_that_stand_out(LinearImage(rgb))
    assert 20 < x0 <= 36 < 60 <= x1 < 76
    assert 14 < y0 <= 30 < 42 <= y1 < 58


@pytest.mark.parametrize(("radius", "half_length"), [(25, 60), (6, 40)])
def test_object_before_a_wall_that_ends_at_a_floor_is_proposed_alone(radius, half_length):
    """A board and a floor reach across the picture, and a lamp is a smooth change of light."""
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:240, :320]
    scene = 0.3 + 0.4 * np.exp(-((x - 260) ** 2 + y**2) / 3e4)[..., None] * (1, 0.95, 0.9)
    scene[185:190] = 0.75
    scene[190:] = (0.05, 0.12, 0.3)
    away = np.hypot(np.maximum(np.abs(x - 140) - half_length, 0), y - 95)
    alpha = 0.4 * (away < radius)[..., None]
    light = scene + alpha * ((0.1, 0.1, 0.1) - scene)
    picture = LinearImage(light + rng.normal(0, NOISE, scene.shape))
    ((x0, y0, x1, y1),) = regions_that_stand_out(picture)
    reach = radius + half_length
    assert 0 < x0 <= 140 - reach < 140 + reach < x1 < 320
    assert 0 < y0 <= 95 - radius < 95 + radius < y1 < 185


def grass(seed, texture=0.05, common=0.0):
    """(H, W, 3) fine texture of one hue and noise of variance 1e-4, a part of which is common."""
    rng, shape = np.random.default_rng(seed), (120, 160)
    light = 0.4 + rng.normal(0, texture, shape)
    noise = np.sqrt(1 - common) * rng.normal(0, 0.01, (*shape, 3))
    noise += np.sqrt(common) * rng.normal(0, 0.01, (*shape, 1))
    return light[..., None] * [0.7, 1.0, 0.4] + noise


def noise_of(light, **meta):
    """Mean variance of each channel."""
    image = LinearImage(light.astype(np.float32), meta=Meta(**meta))
    region = np.zeros(light.shape[:2], bool)
    region[50:70, 60:100] = True
    return noise_around(image, region).variance(image.rgb).mean(axis=(0, 1))


def test_texture_that_channels_share_is_not_taken_for_noise():
    """oracle: in a lossless file it is what the others do not predict, for they have noise as well."""
    shares = np.square([0.7, 1.0, 0.4])
    by_others = shares / (shares.sum() - shares)
    np.testing.assert_allclose(noise_of(grass(1)), 1e-4 * (1 + by_others), rtol=0.15)


def test_stated_noise_of_any_kind_is_kept():
    class Constant(Noise):
        def variance(self, light):
            return np.full_like(light, 1e-6)

        def times(self, factor):
            raise NotImplementedError

    stated = Constant()
    image = LinearImage(grass(1).astype(np.float32), stated)
    assert noise_around(image, np.zeros(image.valid.shape, bool)) is stated


def test_noise_that_demosaicking_makes_common_stays_noise():
    """honest."""
    found = noise_of(grass(2, texture=0, common=0.5))
    assert np.all((found > 0.7e-4) & (found < 1.3e-4))


def test_common_texture_of_a_file_with_coarse_chroma_stays_noise():
    """invariant: there all noise is common."""
    light = grass(4)
    assert np.all(noise_of(light, subsampled=True) > 4 * noise_of(light))


def test_surroundings_of_one_row_of_cells_are_too_little():
    """They do not determine how light changes across the row."""
    light = 0.4 + np.random.default_rng(0).normal(0, NOISE, (240, 320, 3))
    region = np.zeros((240, 320), bool)
    region[212:] = True
    with pytest.raises(PlateError, match="too little of the scene"):
        guess_plate(LinearImage(light), region)


@pytest.mark.parametrize("seed", range(4))
def test_object_before_a_rough_scene_is_hidden_wholly(seed):
    """Its light is as likely as that of the scene nearly everywhere: agreement says nothing."""
    _, picture = wall(seed, texture=0.08, reach=3.0)
    y, x = np.mgrid[:72, :96]
    covered = ((y - 36) / 8) ** 2 + ((x - 48) / 15) ** 2 < 1
    rgb = picture.rgb.copy()
    rgb[covered] = 0.3 * rgb[covered] + 0.7 * np.array([0.42, 0.4, 0.36])
    rgb[34:39, 36:41] = 1.0
    assert guess_plate(LinearImage(rgb), REGION).hidden[covered].all()


def test_what_shows_a_plain_wall_is_not_hidden():
    _, picture = wall(0)
    rgb = picture.rgb.copy()
    rgb[32:40, 40:48] = 0.2
    hidden = guess_plate(LinearImage(rgb), REGION).hidden
    assert hidden[32:40, 40:48].all()
    assert np.count_nonzero(hidden) < 0.8 * np.count_nonzero(REGION)


def gray(picture):
    """Three channels that are one of a picture."""
    return LinearImage(np.repeat(picture.rgb[..., :1], 3, axis=-1))


def test_noise_of_a_gray_picture_is_not_texture_of_the_scene():
    """Honest: its channels have one noise."""
    scene, picture = wall(0)
    guess = guess_plate(covered(gray(picture)), REGION)
    error = (guess.rgb - scene[..., :1])[REGION]
    assert guess.error < 0.5 * NOISE
    assert np.sqrt(np.mean(error**2 / guess.variance[REGION])) < 1


@pytest.mark.battery
@pytest.mark.parametrize(
    ("kind", "ratio"), [(lambda one: one, 0.29), (gray, 0.23)], ids=["color", "gray"]
)
def test_errors_of_a_wall_are_conservative(kind, ratio):
    """Honest but for a factor: a plane is smoother than most fields that its cells may sample."""
    z = []
    for seed in range(36):
        scene, picture = wall(seed)
        guess = guess_plate(covered(kind(picture)), REGION)
        error = guess.rgb - kind(LinearImage(scene)).rgb
        z.append((error / np.sqrt(guess.variance))[REGION])
    assert 0.8 < np.sqrt(np.mean(np.square(z))) / ratio < 1.25


@pytest.mark.parametrize("seed", range(3))
def test_a_faint_object_before_a_wall_stands_out_in_gray(seed):
    """By nine standard deviations of the noise, as in color; nothing does without it."""
    _, picture = wall(seed)
    assert regions_that_stand_out(gray(picture)) == []
    rgb = picture.rgb.copy()
    rgb[30:42, 36:60] -= 9 * NOISE
    ((x0, y0, x1, y1),) = regions_that_stand_out(gray(LinearImage(rgb)))
    assert 12 < x0 <= 36 < 60 <= x1 < 84
    assert 6 < y0 <= 30 < 42 <= y1 < 66
