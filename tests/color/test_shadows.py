"""may_be_shadow: shadows, and dark objects that are indistinguishable from one."""

from dataclasses import replace

import numpy as np
import pytest

from blurmatte.calibration import with_noise
from blurmatte.color.model import ColorModel
from blurmatte.color.shadows import darker_pixels, may_be_shadow
from blurmatte.errors import ColorModelError
from blurmatte.explain.solution import doubts
from blurmatte.matting import Pixelwise, Quality, Smooth, solve
from blurmatte.matting.maps import Grade
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate, render
from blurmatte.rendering.flat_bodies import star_sprite
from blurmatte.rendering.plates import plain_plate, textured_plate, two_hue_plate
from blurmatte.streaks import Streak, find_streaks
from blurmatte.sweep import fit_sweep
from blurmatte.sweep.color_fit import fit_color
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
PLATES = {
    "gray": plain_plate(SIZE, (0.45, 0.45, 0.45), 1),
    "green": plain_plate(SIZE, (0.15, 0.4, 0.12), 4),
    "colorful": colorful_plate(SIZE, 2, tile=24),
    "small tiles": colorful_plate(SIZE, 3, tile=8),
    "two hues": two_hue_plate(SIZE, (0.5, 0.3, 0.2), (0.2, 0.35, 0.5), 1),
    "textured": textured_plate(SIZE, 5),
}
WAY = Trajectory.line((50, 44), (104, 68))
BODIES = {"ball": Ball(12, np.ones(3)), "star": star_sprite(34, np.ones(3))}
CAMERAS = {
    "8 bits": Camera(code_std=1.5 / 255),
    "JPEG": Camera(code_std=1 / 255, jpeg_quality=90),
    "JPEG of halved color": Camera(code_std=1 / 255, jpeg_quality=90, chroma="4:2:0"),
}
COVERED = {name: render(Scene(PLATES["gray"], WAY, body), 100).layer.alpha
           for name, body in BODIES.items()}  # fmt: skip


def shadow(plate, body="ball", camera="8 bits", strength=(0.5, 0.5, 0.5), softness=0.0, seed=0):
    """Image and plate of a moving shadow whose object is outside the picture."""
    from scipy.ndimage import gaussian_filter

    alpha = gaussian_filter(COVERED[body], softness) if softness else COVERED[body]
    light, rng = PLATES[plate], np.random.default_rng(seed)
    darkened = light * (1 - alpha[..., None] * np.asarray(strength))
    return with_noise(*(CAMERAS[camera].photograph(x, rng) for x in (darkened, light)))


def dark(plate, color, body="ball", seed=0):
    """Image and plate of an object."""
    light, rng = PLATES[plate], np.random.default_rng(seed)
    alpha = COVERED[body][..., None]
    seen = (1 - alpha) * light + alpha * np.asarray(color)
    return with_noise(*(CAMERAS["8 bits"].photograph(x, rng) for x in (seen, light)))


def strongest(pictures):
    return (*pictures, find_streaks(*pictures)[0])


SHADOWS = [
    ("gray", "ball", "8 bits", 0.3, 0.0),
    ("gray", "star", "JPEG", 0.6, 1.5),
    ("green", "star", "JPEG of halved color", 0.5, 0.0),
    ("green", "ball", "8 bits", 0.9, 4.0),
    ("colorful", "ball", "8 bits", 0.35, 1.5),
    ("colorful", "star", "JPEG of halved color", 0.8, 0.0),
    ("small tiles", "ball", "JPEG", 0.5, 0.0),
    ("two hues", "ball", "8 bits", 0.9, 0.0),
    ("textured", "star", "8 bits", 0.5, 1.5),
    ("textured", "ball", "JPEG of halved color", 0.7, 4.0),
]


@pytest.mark.parametrize("scene", SHADOWS, ids=lambda s: f"{s[0]}, {s[1]}, {s[2]}, {s[3]}")
def test_shadows_are_recognized(scene):
    """honest: for any plate, depth, softness and camera, of the plate's hue or slightly different."""
    plate, body, camera, depth, softness = scene
    for hue in (0.0, 0.06):
        strength = np.minimum(depth * (1 + hue * np.array([-1, 0, 1])), 1)
        assert may_be_shadow(*strongest(shadow(plate, body, camera, strength, softness)))


@pytest.mark.diagonal
@pytest.mark.parametrize("plate", PLATES)
@pytest.mark.parametrize("color", [(0.2, 0.05, 0.05), (0.05, 0.2, 0.25), (0.9, 0.45, 0.05)])
def test_objects_with_light_are_no_shadows(plate, color):
    """honest: dark red, dark blue, and bright."""
    assert not may_be_shadow(*strongest(dark(plate, color)))


def test_motion_next_to_the_streak_does_not_hide_an_object():
    """Invariant: it is not taken for noise that would hide the object's light."""
    wall, rng = plain_plate((240, 128), (0.3, 0.33, 0.36), 1), np.random.default_rng(0)
    purple = Scene(wall, Trajectory.line((40, 50), (200, 70)), Ball(13, (0.36, 0.2, 0.34)))
    yellow = Scene(wall, Trajectory.line((150, 20), (190, 32)), Ball(9, (0.7, 0.75, 0.1)))
    one, two = render(purple), render(yellow)
    lights = one.image.rgb, one.image.rgb + two.image.rgb - wall, wall
    alone, both, plate = (CAMERAS["8 bits"].photograph(x, rng) for x in lights)
    for picture in (alone, both):
        picture, behind = with_noise(picture, plate)
        found = find_streaks(picture, behind)
        streak = max(found, key=lambda s: one.layer.alpha[s.mask].sum())
        assert not may_be_shadow(picture, behind, streak)


def test_black_objects_are_taken_for_possible_shadows():
    """honest: an object without light is indistinguishable."""
    assert may_be_shadow(*strongest(dark("textured", (0, 0, 0))))
    assert may_be_shadow(*strongest(dark("gray", (0.1, 0.1, 0.1))))  # nor of gray before gray


def test_result_does_not_depend_on_channel_order():
    """invariant: channels are equivalent."""
    for pictures in (shadow("colorful"), dark("colorful", (0.2, 0.05, 0.05))):
        image, plate, streak = strongest(pictures)
        turned = [replace(p, rgb=p.rgb[..., [2, 0, 1]]) for p in (image, plate)]
        variances = [p.variance[..., [2, 0, 1]] for p in (image, plate)]
        turned = [p.with_noise(v) for p, v in zip(turned, variances, strict=True)]
        assert may_be_shadow(*turned, streak) == may_be_shadow(image, plate, streak)


def test_darker_pixels_are_those_of_the_shadow():
    """honest: none outside, and none of an object."""
    image, plate = shadow("colorful")
    found = darker_pixels(image, plate)
    assert found[COVERED["ball"] > 0.2].mean() > 0.95
    assert found[COVERED["ball"] == 0].mean() < 0.02
    image, plate = dark("colorful", (0.9, 0.45, 0.05))
    assert darker_pixels(image, plate)[COVERED["ball"] > 0.2].mean() < 0.05


# What solve and the fits make of it


@pytest.mark.parametrize(
    ("plate", "find"),
    [
        *(("gray", find) for find in (solve, fit_color, fit_sweep)),
        ("colorful", solve),
        *(
            pytest.param("colorful", find, marks=pytest.mark.battery)
            for find in (fit_color, fit_sweep)
        ),
    ],
)
def test_soft_shadow_is_rejected_without_a_color(plate, find):
    """door: with cause and remedy."""
    with pytest.raises(
        ColorModelError, match=r"only light was lost: .* give its color \(--color, model=\)"
    ):
        find(*shadow(plate, softness=3.0))


@pytest.mark.battery
def test_sharp_shadow_on_texture_is_solved_as_what_lets_light_through_and_marked():
    """honest: the texture that is seen through it gives its strength, here half."""
    solution = solve(*shadow("textured"))
    assert_marked_as_shadow(solution)
    opacity, std = solution.stats.sweep.opacity, solution.stats.sweep.opacity_std
    assert abs(opacity - 0.5) < 3 * std < 0.2


def assert_marked_as_shadow(solution):
    """All of it may be one."""
    assert solution.stats.may_be_shadow
    assert solution.grade is Grade.ASSUMED
    assert solution.stats.grade_reasons[0] == "shadow"
    marked = (solution.quality & Quality.SHADOW) != 0
    assert marked[COVERED["ball"] > 0.2].mean() > 0.9


def test_sharp_dark_streak_is_solved_and_marked():
    """honest: it may be a dark object or a shadow; all pixels are marked."""
    assert_marked_as_shadow(solve(*shadow("gray")))


@pytest.mark.parametrize(
    "solver",
    [pytest.param(None, marks=pytest.mark.battery), Smooth()],
    ids=["averaged", "smooth"],
)
def test_any_color_keeps_the_shadow_marked(solver):
    """honest: with unknown colors the grade stays assumed."""
    solution = solve(*shadow("textured", softness=3.0), ColorModel.any(), solver)
    assert solution.stats.may_be_shadow
    assert solution.grade is Grade.ASSUMED
    assert doubts(solution)[0].startswith("Only light was lost: all of this may be a shadow")


def test_given_color_is_used_and_all_pixels_are_marked():
    """honest: a warning says that it may be a shadow; flags mark the pixels."""
    image, plate = shadow("colorful")
    solution = solve(image, plate, ColorModel.from_hex("#c03020"), Pixelwise())
    assert solution.stats.may_be_shadow
    said = doubts(solution)
    assert len(said) == 1
    assert said[0].startswith("Only light was lost: all of this may be a shadow")
    marked = (solution.quality & Quality.SHADOW) != 0
    assert marked[COVERED["ball"] > 0.2].mean() > 0.9
    assert not marked[~solution.streak].any()


def test_unchanged_region_is_no_shadow():
    """honest: a region next to the shadow."""
    image, plate = shadow("colorful")
    assert not may_be_shadow(image, plate, Streak.from_box((110, 80, 150, 108), SIZE))
