"""
Two colors, over another background
===================================
Figure 3 of [GC07]. A cube of two paints moves and turns. It covers the middle of its streak during the
whole exposure; these pixels determine the plane of its colors. The layer is put over another picture,
and alpha is split into the exposure fractions of both paints.
"""

from dataclasses import replace

import numpy as np
from figure import color_of, gray, save, shown

import blurmatte as bm
from blurmatte.rendering import colorful_plate
from blurmatte.rendering.flat_bodies import Cube
from blurmatte.rendering.pose import Change

SIZE = (320, 220)
RED, BLUE = np.array([0.75, 0.10, 0.06]), np.array([0.08, 0.22, 0.80])

# %%
# **A cube with three red and three blue faces,** a picture without noise, as in the paper.
cube = Cube(92, np.array([RED, BLUE, BLUE, RED, RED, BLUE]), ambient=0.5)
scene = bm.rendering.Scene(
    colorful_plate(SIZE, 4, tile=42),
    bm.Trajectory.line((128, 116), (192, 100)),
    cube,
    change=Change(turned=(0.5, 0.6, 0.1), spin=(0.15, 0.35, 0.2)),
)
still = bm.rendering.render(
    replace(
        scene, trajectory=bm.Trajectory.line((160, 108), (160, 108)), change=Change((0.5, 0.6, 0.1))
    )
)
moving = bm.rendering.render(scene)

# %%
# **The plane of colors from the core,** where the plate's texture is invisible; then each pixel alone.
little = bm.NoiseModel(read_std=1e-6)
image, plate = moving.image.with_noise(little), moving.plate.with_noise(little)
streak = bm.streaks.Streak(moving.layer.alpha > 0)
model = bm.ColorModel.from_samples(bm.color.core_colors(image, plate, streak), rank=2, robust=True)
solution = bm.solve(image, plate, model, bm.Pixelwise(), streak=streak)
known = solution.known & solution.streak
error = np.abs(solution.alpha - moving.layer.alpha)[known]
print(f"{' + '.join(model.hex)}, alpha off by {np.median(error):.1e}, at most {error.max():.1e}")

# %%
# **Over another background, and paint by paint.**
other = bm.LinearImage(colorful_plate(SIZE, 21, tile=16))
exposures = bm.compositing.split_exposure(solution, RED, BLUE)
save(
    "two_colors",
    [
        ("the cube, still", shown(still.image.rgb)),
        ("blurred", shown(image.rgb)),
        ("alpha", gray(solution.layer.alpha, 1)),
        ("color", color_of(solution)),
        ("over another picture", shown(solution.layer.over(other).rgb)),
        ("how long the red was there", gray(exposures.fraction[..., 0], 1)),
    ],
    columns=3,
)
