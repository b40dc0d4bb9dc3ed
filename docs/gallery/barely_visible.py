"""
A barely visible object
=======================
Figure 1 of [GC07]. A ball crosses the picture in a fraction of the exposure. Its streak is barely
visible, and the difference to the plate does not show its shape: it is large where ball and plate have
different colors, and zero where they agree.
"""

import numpy as np
from figure import color_of, gray, save, shown

import blurmatte as bm
from blurmatte.rendering import colorful_plate

# %%
# **A scene with a known answer.** Alpha reaches 0.1. The camera has 8 bits and noise of half a code
# value, the plate is the median of nine pictures.
shot = bm.rendering.Shot(
    bm.rendering.Scene(
        colorful_plate((340, 200), 10, tile=60),
        bm.Trajectory.arc((40, 150), (160, 70), (295, 45)),
        bm.rendering.Ball(15, np.array([0.85, 0.32, 0.04]), ambient=0.3),
    ),
    bm.rendering.Camera(code_std=0.5 / 255),
    plate_frames=9,
    seed=1,
)
rendering = bm.rendering.render(shot.scene)
image, plate = shot.photograph(rendering)

# %%
# **Ordinary background subtraction,** with the largest contrast.
difference = np.abs(image.rgb - plate.rgb).max(axis=-1)

# %%
# **Alpha and color.** Nothing else is given; the color is estimated from the streak.
solution = bm.solve(image, plate)
error = np.sqrt(np.mean((solution.layer.alpha - rendering.layer.alpha) ** 2))
print(f"{solution.model.hex[0]}, alpha off by {error:.4f} RMS")

peak = float(rendering.layer.alpha.max())
save(
    "barely_visible",
    [
        ("the picture", shown(image.rgb)),
        (
            "difference to the plate, stretched",
            gray(difference, float(np.quantile(difference, 0.999))),
        ),
        (f"alpha (white is {peak:.2f})", gray(solution.layer.alpha, peak)),
        ("color", color_of(solution)),
    ],
    columns=2,
)
