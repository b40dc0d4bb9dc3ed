"""
The path of a ball
==================
"Visualizing long trajectories of balls in long-exposure photos" ([GC07 §4]). A ball bounces through a
clip. Each frame is solved alone with one plate. All layers over each other show the whole path with the
contrast of a single frame. One exposure as long as the clip shows nearly nothing until its layer is
amplified.
"""

import numpy as np
from figure import save, shown

import blurmatte as bm
from blurmatte.rendering import colorful_plate

# %%
# **A clip of eight frames;** the shutter is open for 0.7 of the time.
size = (340, 215)
t = np.linspace(0, 1, 401)
fall = np.abs(np.cos(2.1 * np.pi * t)) * (1 - 0.45 * t)  # bounces that become lower
path = bm.Trajectory(np.stack([26 + 290 * t, 185 - 150 * fall], axis=-1), t)
scene = bm.rendering.Scene(
    colorful_plate(size, 8, tile=54),
    path,
    bm.rendering.Ball(11, np.array([0.85, 0.75, 0.05]), ambient=0.3),
)
frames = [bm.rendering.render(part) for part in scene.exposures(8, 0.7)]
photographed = [
    bm.rendering.Shot(
        scene, bm.rendering.Camera(code_std=1 / 255), plate_frames=5, seed=n
    ).photograph(frame)
    for n, frame in enumerate(frames)
]
plate = photographed[0][1]

# %%
# **One color for the whole clip,** from several frames at once; then each frame alone.
model = bm.fit_color([image for image, _ in photographed[2:5]], plate)
layers = [bm.solve(image, plate, model).layer for image, _ in photographed]
print(f"{model.hex[0]}, {len(layers)} frames")

# %%
# **All layers over the plate,** and as one exposure as long as the clip.
together = bm.compositing.stack(layers)
long = bm.compositing.long_exposure(layers)
save(
    "long_exposure",
    [
        ("one frame", shown(photographed[4][0].rgb)),
        ("all frames: stack(layers)", shown(together.over(plate).rgb)),
        ("long_exposure(layers): 1/8 as opaque", shown(long.over(plate).rgb)),
        ("its layer made plain: amplify(8)", shown(long.amplify(8).over(plate).rgb)),
    ],
    columns=2,
)
