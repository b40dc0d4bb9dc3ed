"""The opacity of an object, from the plate's texture that is seen through it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.color.model import ColorModel
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.streaks import Streak
from blurmatte.sweep.assess.opacity import RARE_ODDS, fit_opacity, has_left, is_at_rest
from blurmatte.sweep.fit.multistart import start_along
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.model.path import FROM_REST, LINE
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.priors import OpacityPrior
from blurmatte.sweep.model.silhouette import DISC

SIZE, CENTER, RADIUS = (96, 80), (47.0, 39.0), 15.0
COLOR, WALL = np.array([0.7, 0.3, 0.06]), np.array([0.25, 0.3, 0.28])
PATH = np.array([*CENTER, *CENTER])


def along(length):
    """The parameters of a line with a length in radii."""
    return PATH + np.array([-1, 0, 1, 0]) * length * RADIUS / 2


def state(opacity, contrast, std, seed=0, model=None, path=PATH, color=COLOR, post=None):
    """A disc with the true shape and path, before a wall of one hue with texture, and noise.

    post: columns of a dark post before it.
    """
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    (w, h), noise = SIZE, NoiseModel(gain=0, read_std=std)
    texture = gaussian_filter(rng.normal(size=(h, w)), 1)
    B = WALL * (1 + contrast * texture / texture.std())[..., None]
    disc = DISC.sweep(LINE, path, np.array([RADIUS]), Pixels((h, w), (0, 0))).alpha
    alpha = (opacity * disc)[..., None]
    C = disc[..., None] * opacity * color + (1 - alpha) * B
    if post is not None:
        C[:, slice(*post)] = B[:, slice(*post)] = 0.2 * WALL
    image, plate = (LinearImage(x + std * rng.normal(size=x.shape), noise=noise) for x in (C, B))
    prior = ColorPrior.of(model)
    around = observation_around(Streak(disc > 0), 30, image, plate, prior)
    return start_along(replace(around, grain=RADIUS / 4), LINE, path, RADIUS)


@pytest.mark.parametrize("opacity", [0.1, 0.5, 1.0])
def test_without_noise_texture_gives_the_opacity(opacity):
    found = fit_opacity(state(opacity, 0.1, 1e-6))
    assert_allclose(found.value, opacity, atol=1e-4)
    assert found.std < 1e-3


@pytest.mark.parametrize(("opacity", "contrast"), [(0.2, 0.1), (0.7, 0.06)])
def test_errors_are_honest(opacity, contrast):
    found = [fit_opacity(state(opacity, contrast, 0.006, seed)) for seed in range(40)]
    z = np.array([(one.value - opacity) / one.std for one in found])
    assert abs(z.mean()) < 0.5
    assert 0.8 < z.std() < 1.25
    assert np.median([one.std for one in found]) < 0.1


@pytest.mark.parametrize("opacity", [0.3, 1.0])
def test_a_plate_without_texture_leaves_the_opacity_open(opacity):
    found = fit_opacity(state(opacity, 0.0, 0.006))
    assert found.std > 0.1
    assert abs(found.value - opacity) < 3 * found.std


def test_what_is_in_front_of_an_object_is_not_seen_through_it():
    opaque = fit_opacity(state(1.0, 0.02, 0.006, path=along(3), post=(44, 52)))
    assert opaque.value == 1
    thin = fit_opacity(state(0.5, 0.1, 0.006, post=(44, 52)))
    assert abs(thin.value - 0.5) < 3 * thin.std < 0.2


def test_an_opaque_disc_before_texture_is_opaque():
    found = fit_opacity(state(1.0, 0.1, 0.006))
    assert found.value > 0.995
    assert found.std < 0.01


def test_a_given_color_gives_the_opacity_without_texture():
    model = ColorModel.from_samples(np.array([COLOR]), std=1e-3)
    found = fit_opacity(state(0.4, 0.0, 0.006, model=model))
    assert found.std < 0.02
    assert abs(found.value - 0.4) < 3 * found.std


def test_light_above_white_is_no_explanation():
    bright = fit_opacity(state(1.0, 0.0, 0.006))
    assert bright.value - 2 * bright.std > 0.4  # the color would be above white below 0.5


def test_a_path_shorter_than_half_the_radius_is_at_rest():
    still = state(0.5, 0.1, 0.006)
    assert is_at_rest(still)
    assert is_at_rest(still.moved(PATH + np.array([0, 0, 0.45 * RADIUS, 0]), still.shape))
    assert not is_at_rest(still.moved(PATH + np.array([0, 0, 0.55 * RADIUS, 0]), still.shape))


@pytest.mark.parametrize("end", [SIZE[0] + 1.1 * RADIUS, SIZE[0] + 0.9 * RADIUS])
def test_before_a_plain_wall_a_path_that_ends_at_the_border_may_go_on(end):
    """Invariant: light of an object that left does not change with the rest of its path."""
    left = state(1.0, 0.0, 0.006, path=np.array([60.0, 39.0, SIZE[0] + 2 * RADIUS, 39.0]))
    assert has_left(left.moved(np.array([60.0, 39.0, end, 39.0]), left.shape))


def test_an_object_that_rests_just_outside_may_as_well_go_on():
    path = np.array([SIZE[0] + 0.9 * RADIUS, 39.0, 40.0, 39.0])
    left = state(1.0, 0.0, 0.006, path=path)
    rests = FROM_REST.starts(left.curve)[0]
    assert has_left(start_along(left.observation, FROM_REST, rests, RADIUS))


def test_an_end_in_the_picture_or_partly_outside_has_not_left():
    for end in (SIZE[0] - 2 * RADIUS, SIZE[0] - 0.5 * RADIUS, SIZE[0] + 0.2 * RADIUS):
        seen = state(1.0, 0.0, 0.006, path=np.array([40.0, 39.0, end, 39.0]))
        assert not has_left(seen)


@pytest.mark.parametrize("opacity", [0.3, 0.8])
@pytest.mark.parametrize("length", [0.6, 1.2])
def test_texture_shows_that_an_object_that_moved_was_there_for_a_part(opacity, length):
    found = fit_opacity(state(opacity, 0.1, 0.006, path=along(length)))
    assert found.std < 0.05
    assert abs(found.value - opacity) < 3 * found.std


@pytest.mark.parametrize("length", [0.6, 1.2])
def test_texture_shows_that_an_object_that_moved_was_there_all_the_time(length):
    found = fit_opacity(state(1.0, 0.1, 0.006, path=along(length)))
    assert found.value == 1
    assert found.std < 3e-3


@pytest.mark.parametrize("length", [0.9, 3.0])
@pytest.mark.parametrize("opacity", [0.4, 1.0])
def test_an_object_that_moved_before_a_plain_wall_is_solid_with_an_open_error(opacity, length):
    found = fit_opacity(state(opacity, 0.0, 0.006, path=along(length)))
    assert found.value == 1
    assert found.thin_std > 0.1  # if it lets light through, nothing shows how much
    assert 0.01 < found.std < RARE_ODDS**0.5  # few do


@pytest.mark.parametrize("opacity", [0.4, 0.7, 1.0])
def test_an_opacity_that_may_be_any_is_open_before_a_plain_wall(opacity):
    known = state(opacity, 0.0, 0.006, path=along(3))
    found = fit_opacity(known.on(replace(known.observation, opacity=OpacityPrior.ANY)))
    assert found.value < 1
    assert abs(found.value - opacity) < 2 * found.std


def test_a_given_color_gives_the_part_of_an_object_that_moved():
    model = ColorModel.from_samples(np.array([COLOR]), std=1e-3)
    found = fit_opacity(state(0.4, 0.0, 0.006, model=model, path=along(0.9)))
    assert found.std < 0.02
    assert abs(found.value - 0.4) < 3 * found.std
    opaque = fit_opacity(state(1.0, 0.0, 0.006, model=model, path=along(0.9)))
    assert (opaque.value, opaque.std < 1e-3) == (1, True)


@pytest.mark.parametrize("opacity", [0.2, 0.6])
def test_errors_are_honest_on_a_path_longer_than_the_disc(opacity):
    states = (state(opacity, 0.1, 0.006, seed, path=along(4)) for seed in range(24))
    found = [fit_opacity(one) for one in states]
    z = np.array([(one.value - opacity) / one.std for one in found])
    assert abs(z.mean()) < 0.6
    assert 0.8 < z.std() < 1.25
    assert np.median([one.std for one in found]) < 0.08


def test_texture_shows_that_a_solid_object_on_a_long_path_is_solid():
    found = fit_opacity(state(1.0, 0.1, 0.006, path=along(4)))
    assert found.value == 1
    assert found.std < 0.02


def test_more_light_than_white_is_that_of_a_source_of_open_opacity():
    bright = state(1.0, 0.0, 0.006, path=along(4), color=np.array([3.0, 2.4, 1.2]))
    found = fit_opacity(bright)
    assert found.value == 0
    assert 0.6 < found.std < 1  # even odds of hiding all or nothing
    # Nearly all of the posterior is at 0 and at 1.
    assert_allclose(found.std**2 + found.solid_std**2, 1, atol=0.05)


def test_the_error_as_a_solid_object_is_that_of_a_fraction():
    """Also where the value is that of a lamp, 0, and not the mean of the posterior."""
    bright = state(1.0, 0.0, 0.006, path=along(4), color=np.array([3.0, 2.4, 1.2]))
    thin = state(0.5, 0.1, 0.006, path=along(4))
    for found in map(fit_opacity, (bright, thin)):
        assert found.solid_std <= 1
    assert_allclose(found.solid_std, np.hypot(found.std, 1 - found.value))


def test_texture_shows_that_a_source_is_solid():
    bright = state(1.0, 0.1, 0.006, path=along(4), color=np.array([3.0, 2.4, 1.2]))
    found = fit_opacity(bright)
    assert abs(found.value - 1) < 3 * found.std
    assert found.std < 0.05


def test_texture_shows_that_a_lamp_hides_nothing():
    length = along(4)
    solid = state(1.0, 0.1, 0.006, path=length)
    chi = solid.swept.alpha[..., None]
    added = solid.observation.B + chi * np.array([0.9, 0.7, 0.3])
    lamp = solid.on(solid.observation.with_light(added))
    found = fit_opacity(lamp)
    assert found.value == 0
    assert found.std < 0.05


def test_a_guessed_plate_without_its_texture_does_not_show_the_opacity():
    known = state(1.0, 0.1, 0.006, path=along(3)).observation
    smooth = np.broadcast_to(WALL, known.B.shape)
    error = np.full_like(known.B_variance, np.mean((known.B - WALL) ** 2))
    guessed = replace(known, B=smooth, B_variance=error)
    found = fit_opacity(state(1.0, 0.1, 0.006, path=along(3)).on(guessed))
    assert found.value == 1
    assert found.std > 0.01


def test_negative_light_excludes_what_would_let_much_light_through():
    dark = state(1.0, 0.0, 0.006, path=along(4), color=np.array([0.02, 0.02, 0.02]))
    found = fit_opacity(dark)
    assert found.value == 1
    assert found.std < 0.05
