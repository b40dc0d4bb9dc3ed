"""
Paper and paint
===============
The first rows of figure 4 of [GC07]: two tumbling sheets of colored paper and a turning ball of two
paints, each with its alpha and its color. No shape is used: all pixels are solved together with known
colors, as from a sharp picture of the object.
"""

import numpy as np
from figure import color_of, gray, save, shown

import blurmatte as bm
from blurmatte.rendering import colorful_plate
from blurmatte.rendering.flat_bodies import Sheet
from blurmatte.rendering.pose import Change

SIZE = (300, 170)
GREEN, PINK = np.array([0.12, 0.65, 0.2]), np.array([0.85, 0.2, 0.35])
BROWN, CREAM = np.array([0.45, 0.2, 0.07]), np.array([0.75, 0.7, 0.5])

# %%
# **Three objects,** each turning while it moves, in front of a colorful wall.
objects = [
    (
        Sheet(60, 42, GREEN),
        Change((0.4, 0.3, 0.2), (0.8, 0.5, 0.9)),
        ((85, 95), (205, 70)),
        [GREEN],
    ),
    (Sheet(44, 44, PINK), Change((0.2, 0.5, 0.1), (0.6, 0.9, 0.5)), ((90, 60), (210, 105)), [PINK]),
    (
        bm.rendering.Ball(34, BROWN, second_color=CREAM, ambient=0.5),
        Change(spin=(0.6, 0.3, 1.2)),
        ((105, 90), (190, 80)),
        [BROWN, CREAM],
    ),
]
pictures = []
for seed, (body, change, (start, end), paints) in enumerate(objects):
    plate = colorful_plate(SIZE, 30 + seed, tile=45)
    scene = bm.rendering.Scene(plate, bm.Trajectory.line(start, end), body, change=change)
    rendering = bm.rendering.render(scene)
    shot = bm.rendering.Shot(
        scene, bm.rendering.Camera(code_std=1 / 255), plate_frames=5, seed=seed
    )
    image, behind = shot.photograph(rendering)

    # **The line or plane of its colors,** and alpha and color of every pixel.
    model = bm.ColorModel.from_samples(np.array(paints), rank=len(paints), std=0.001)
    solution = bm.solve(image, behind, model, bm.Smooth())
    error = np.sqrt(np.mean((solution.layer.alpha - rendering.layer.alpha)[solution.streak] ** 2))
    print(f"{model}: alpha off by {error:.3f} RMS")
    pictures += [
        ("the picture", shown(image.rgb)),
        ("alpha, white is 1", gray(solution.layer.alpha, 1)),
        ("color, if within 0.1 of white", color_of(solution, 0.1)),
    ]
save("paper_and_paint", pictures, columns=3)
