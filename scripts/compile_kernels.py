"""Compile every kernel once, so that processes which start later load it from the cache.

Two processes that test would else compile all of them each. Rendered pictures go through every
solver; run from the repository: python scripts/compile_kernels.py
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import blurmatte as bm
from blurmatte.rendering import (
    Ball,
    Body,
    Camera,
    Change,
    Scene,
    Sheet,
    Shot,
    colorful_plate,
    plain_plate,
    render,
    star_sprite,
)

SIZE = (96, 72)
TILES = colorful_plate(SIZE, 1, tile=16)
WALL = plain_plate(SIZE, (0.3, 0.33, 0.36), 1)
PATH = bm.Trajectory.arc((30, 40), (48, 30), (66, 40))
GREEN, ORANGE = (0.25, 0.7, 0.12), (0.9, 0.5, 0.1)
BALL = Ball(9, GREEN)
LINE, PLANE = bm.ColorModel.from_hex("#89d861"), bm.ColorModel.from_hex("#89d861", "#f3bc59")
CAMERA = Camera(code_std=1.5 / 255)
COMPRESSING = Camera(code_std=1.5 / 255, jpeg_quality=90, chroma="4:2:0")
NO_CHANGE = Change()

Pictures = tuple[bm.LinearImage, bm.LinearImage]


def photographed(
    body: Body, plate: np.ndarray, camera: Camera = CAMERA, change: Change = NO_CHANGE
) -> Pictures:
    """Image and plate."""
    shot = Shot(Scene(plate, PATH, body, change), camera, plate_frames=3, seed=1)
    return shot.photograph(render(shot.scene, 60))


def solve_all() -> None:
    """Every solver, on files of both kinds, in both precisions, and colors of both ranks."""
    pictures = photographed(BALL, TILES)
    double = [bm.LinearImage(p.rgb.astype(float), bm.NoiseModel(read_std=2e-3)) for p in pictures]
    for solver in (bm.Pixelwise(), bm.Smooth()):
        for model in (LINE, PLANE):
            bm.solve(*pictures, model, solver)
            bm.solve(*double, model, solver)
    bm.solve(*pictures)
    bm.solve(*double)
    bm.solve(*photographed(BALL, TILES, COMPRESSING))
    bm.solve(*photographed(BALL, WALL))
    bm.solve(*photographed(Sheet(20, 12, ORANGE), TILES))
    photographed(star_sprite(20, ORANGE), TILES, CAMERA, Change(spin=(0, 0, 1)))


def edit_file(folder: Path) -> None:
    """A JPEG written anew in part, and a plate of many frames."""
    image, plate = photographed(BALL, TILES)
    bm.write(folder / "image.jpg", image)
    changed = np.zeros(SIZE[::-1], bool)
    changed[20:30, 20:30] = True
    original = bm.read(folder / "image.jpg", bm.SRGB)
    bm.write_changed(folder / "changed.jpg", folder / "image.jpg", original, changed)
    rng = np.random.default_rng(0)
    bm.make_plate([CAMERA.photograph(plate.rgb, rng) for _ in range(8)])


if __name__ == "__main__":
    solve_all()
    with TemporaryDirectory() as folder:
        edit_file(Path(folder))
