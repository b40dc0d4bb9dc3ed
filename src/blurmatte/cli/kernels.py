"""Compile every kernel once, so that processes which start later load it from the cache.

Small pictures go through every solver, in two processes that need different kernels.
"""

import warnings
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import blurmatte as bm
from blurmatte.checks import Floats
from blurmatte.matting import Solver
from blurmatte.rendering import Ball, Camera, Scene, Shot, colorful_plate, render
from blurmatte.rendering.flat_bodies import Sheet, star_sprite
from blurmatte.rendering.plates import plain_plate
from blurmatte.rendering.pose import Change
from blurmatte.rendering.scene import Body

SIZE = (96, 72)
TILES = colorful_plate(SIZE, 1, tile=16)
WALL = plain_plate(SIZE, (0.3, 0.33, 0.36), 1)
PATH = bm.Trajectory.arc((30, 40), (48, 30), (66, 40))
GREEN, ORANGE = np.array([0.25, 0.7, 0.12]), np.array([0.9, 0.5, 0.1])
BALL = Ball(9, GREEN)
LINE, PLANE = bm.ColorModel.from_hex("#89d861"), bm.ColorModel.from_hex("#89d861", "#f3bc59")
CAMERA = Camera(code_std=1.5 / 255)
COMPRESSING = Camera(code_std=1.5 / 255, jpeg_quality=90, chroma="4:2:0")
NO_CHANGE = Change()
AS_THEY_ARE = bm.background.Matching.NONE  # the other process matches plates

_CLEAN = 2e-3  # noise of pictures of double precision, 1 is white

Pictures = tuple[bm.LinearImage, bm.LinearImage]


def compile_kernels() -> None:
    """Compile all kernels; those that are in the cache are loaded."""
    with get_context("spawn").Pool(2) as pool:
        for running in [pool.apply_async(_quietly, (work,)) for work in (fit_shapes, solve_pixels)]:
            running.get()


def _quietly(work: Callable[[], None]) -> None:
    """Do it; what is wrong with its small pictures is not said."""
    with warnings.catch_warnings(action="ignore", category=bm.errors.BlurmatteWarning):
        work()


def photographed(
    body: Body,
    plate: Floats,
    camera: Camera = CAMERA,
    change: Change = NO_CHANGE,
    path: bm.Trajectory = PATH,
) -> Pictures:
    """Image and plate."""
    shot = Shot(Scene(plate, path, body, change), camera, plate_frames=3, seed=1)
    return shot.photograph(render(shot.scene, 60))


def in_double(picture: bm.LinearImage) -> bm.LinearImage:
    """The picture in double precision."""
    return bm.LinearImage(picture.rgb.astype(float), bm.NoiseModel(read_std=_CLEAN))


def fit_shapes() -> None:
    """Render, fit sweeps in files of both kinds and both precisions, and use them."""
    image, plate = photographed(BALL, TILES)
    double = in_double(image), in_double(plate)
    solution = bm.solve(image, plate, matching=AS_THEY_ARE)
    bm.solve(*double, matching=AS_THEY_ARE)
    for pictures in (
        photographed(BALL, TILES, COMPRESSING),
        photographed(BALL, WALL),
        photographed(Sheet(20, 12, ORANGE), TILES),
    ):
        bm.solve(*pictures, matching=AS_THEY_ARE)
    photographed(star_sprite(20, ORANGE), TILES, CAMERA, Change(spin=(0, 0, 1)))
    if solution.sweep is not None:
        bm.deblur(image, plate, solution.sweep)
    starts = (24, 40), (40, 36), (56, 32)
    paths = [bm.Trajectory.line((x, y), (x + 10, y - 3)) for x, y in starts]
    clip = [photographed(BALL, TILES, path=path)[0] for path in paths]
    list(bm.measure_clip(clip, plate, LINE))


def solve_pixels() -> None:
    """Solve pixels in both precisions with colors of both ranks; match, make and edit plates."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    alpha = 0.5 * (np.hypot((x - 48) / 2, y - 36) < 9)[..., None]
    rng, light = np.random.default_rng(0), alpha * GREEN + (1 - alpha) * TILES
    image, plate = CAMERA.photograph(light, rng), CAMERA.photograph(TILES, rng)
    double = in_double(image), in_double(plate)
    solvers: tuple[Solver, ...] = bm.Pixelwise(), bm.Smooth()
    for solver in solvers:
        for model in (LINE, PLANE):
            bm.solve(image, plate, model, solver)
            bm.solve(*double, model=model, solver=solver)
    plate_of_many = bm.make_plate([CAMERA.photograph(TILES, rng) for _ in range(8)]).plate
    bm.solve(image, plate_of_many, LINE, bm.Pixelwise())
    shifted = bm.LinearImage(np.roll(plate.rgb, 2, axis=1))
    bm.match_plate(shifted, image)
    with TemporaryDirectory() as folder:
        edit_file(Path(folder), image)


def edit_file(folder: Path, image: bm.LinearImage) -> None:
    """A JPEG written anew in part."""
    bm.write(folder / "image.jpg", image)
    changed = np.zeros(SIZE[::-1], bool)
    changed[20:30, 20:30] = True
    original = bm.read(folder / "image.jpg", bm.SRGB)
    bm.write_changed(folder / "changed.jpg", folder / "image.jpg", original, changed)
