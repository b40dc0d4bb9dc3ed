"""Rendered balls shared by several tests: each scene is rendered and photographed once. The true path
is one of `PATHS`, the true radius is RADIUS, and the color is GREEN.
"""

from dataclasses import replace
from functools import cache, lru_cache

import numpy as np
from tests import scenes
from tests.scenes import rendered as rendered

from blurmatte.calibration import with_noise
from blurmatte.radiometry import NoiseModel
from blurmatte.rendering import Ball, Camera, Scene, colorful_plate
from blurmatte.rendering.plates import plain_plate
from blurmatte.streaks import Streak
from blurmatte.sweep.fit.multistart import start_along
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.observation import observation_around
from blurmatte.sweep.model.path import ARC, BOUNCE, CUBIC, FROM_REST, LINE, PARABOLA
from blurmatte.trajectory import Trajectory

SIZE = (160, 112)
RADIUS = 11.0
BOUNDS = 3.0, 40.0  # of the radius, pixels
GREEN, RED, ORANGE = (np.array(c) for c in ([0.25, 0.7, 0.12], [0.7, 0.15, 0.1], [0.9, 0.5, 0.1]))
WALL = plain_plate(SIZE, (0.34, 0.33, 0.3), 4)
TILES = colorful_plate(SIZE, 2, tile=20)
TIMES = np.linspace(0, 1, 65)
NEUTRAL = ColorPrior(np.eye(3))
ONE_PAINT = NEUTRAL.of_one_paint
CAMERA = Camera(code_std=1.5 / 255)
JPEG = Camera(code_std=1.5 / 255, jpeg_quality=90, chroma="4:2:0")

# Parameters of each family, pixels.
PATHS = {
    LINE: np.array([44.0, 42, 112, 68]),
    ARC: np.array([36.0, 68, 122, 70, -26]),
    PARABOLA: np.array([34.0, 70, 66, 34, 124, 66]),
    CUBIC: np.array([30.0, 66, 60, 26, 96, 88, 130, 44]),
    FROM_REST: np.array([42.0, 42, 114, 68, 0.4]),
    BOUNCE: np.array([34.0, 36, 80, 84, 126, 42, 0.45]),
}


def along(family):
    """The true trajectory of a family."""
    return Trajectory(family.at(PATHS[family], np.linspace(0, 1, 513))[0], np.linspace(0, 1, 513))


# Shaded balls, and flat ones, of one color all over; before a wall, and before tiles of many hues.
BALLS = {family: Scene(WALL, along(family), Ball(RADIUS, GREEN)) for family in PATHS}
BEFORE_TILES = {family: replace(scene, plate=TILES) for family, scene in BALLS.items()}
FLAT = {family: replace(s, body=Ball(RADIUS, GREEN, ambient=1.0)) for family, s in BALLS.items()}
FLAT_BEFORE_TILES = {family: replace(scene, plate=TILES) for family, scene in FLAT.items()}
BALL = BALLS[LINE]


@lru_cache(maxsize=64)
def photographed(scene, seed=0, camera=CAMERA):
    """Image and plate of known noise; the plate is the median of three pictures."""
    return with_noise(*scenes.photographed(scene, camera, seed))


def observed(scene, seed=0, camera=CAMERA, color=NEUTRAL):
    """The observation around the pixels that the object covers."""
    streak = Streak(rendered(scene).layer.alpha > 0)
    return observation_around(streak, 12, *photographed(scene, seed, camera), color)


@cache
def exact(scene, color=NEUTRAL):
    """The observation of a scene without noise, with a declared noise."""
    truth, noise = rendered(scene), NoiseModel(read_std=1e-3)
    pictures = (picture.with_noise(noise) for picture in (truth.image, truth.plate))
    return observation_around(Streak(truth.layer.alpha > 0), 12, *pictures, color)


def disc_at(observation, family=LINE, offset=0.0, radius=RADIUS):
    """A disc of a radius on the true path of a family, but for an offset of its points, pixels.

    Axes of color are along the colors that it finds, unless they are known.
    """
    path = PATHS[family].copy()
    points = len(path) - family.size % 2
    path[:points] += np.resize(offset, points)
    return start_along(observation, family, path, radius)


def residuals_of(state, observation, alpha):
    """(3, h, w) residuals of an observation with the colors of a state and another alpha."""
    C, B, V_C, V_B = observation.light
    through = (1 - alpha)[..., None]
    e = (C - through * B - state.field.light(alpha)) / np.sqrt(V_C + through**2 * V_B)
    return np.moveaxis(e, 2, 0)


def within(observation, values):
    """The part of a picture's map (H, W) in an observation at full resolution."""
    (x0, y0), (h, w) = map(int, observation.origin), observation.weight.shape
    return values[y0 : y0 + h, x0 : x0 + w]


def alpha_error(alpha, truth):
    """Root mean square error of alpha where the object was."""
    return float(np.sqrt(np.mean((alpha - truth)[truth > 0] ** 2)))


def error(state, scene):
    """The same of a fitted shape."""
    return alpha_error(state.swept.alpha, within(state.observation, rendered(scene).layer.alpha))


def wrong_derivatives(silhouette, path, shape, pixels, step=1e-4):
    """Errors of the derivatives of alpha on an arc, each relative to that of small steps."""
    n, everything = len(path), np.concatenate([path, shape])
    J = silhouette.sweep(ARC, path, shape, pixels).by_parameters
    assert J.shape == (*pixels.shape, n + silhouette.size) == (*pixels.shape, len(everything))
    for i, along in enumerate(step * np.eye(len(everything))):
        there, back = (
            silhouette.sweep(ARC, p[:n], p[n:], pixels).alpha
            for p in (everything + along, everything - along)
        )
        slope = (there - back) / (2 * step)
        yield np.linalg.norm(J[..., i] - slope) / np.linalg.norm(slope)


def path_error(curve, family):
    """The largest distance of points (65, 2) from the true path, in the better direction of time."""
    true = family.at(PATHS[family], TIMES)[0]
    return min(np.linalg.norm(curve - path, axis=1).max() for path in (true, true[::-1]))


def degrees_between(color, other):
    """The angle between two colors."""
    cosine = abs(color @ other) / (np.linalg.norm(color) * np.linalg.norm(other))
    return float(np.degrees(np.arccos(min(cosine, 1.0))))
