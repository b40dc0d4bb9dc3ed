"""
A sharp ball from one blurred picture
=====================================
A ball of six by twelve patches moves 3.6 radii while the shutter is open. Path and shape are found
without a color; the ball at any moment of the exposure follows from the light alone, with its error.
The direction of time is unknown: the ball may have moved from right to left.
"""

import numpy as np
from figure import gray, save, shown

import blurmatte as bm
from blurmatte.rendering import colorful_plate

# %%
# **The picture:** 8 bits with noise of one code value, and a plate of five frames.
paint = np.random.default_rng(4).uniform(0.08, 0.95, (6, 12, 3))
texture = np.repeat(np.repeat(paint, 24, axis=0), 24, axis=1)
shot = bm.rendering.Shot(
    bm.rendering.Scene(
        0.55 * colorful_plate((250, 160), 3, tile=55),
        bm.Trajectory.arc((65, 104), (122, 62), (184, 66)),
        bm.rendering.Ball(32, texture=texture, ambient=0.6),
    ),
    bm.rendering.Camera(code_std=1 / 255),
    plate_frames=5,
    seed=4,
)
truth = bm.rendering.render(shot.scene)
image, plate = shot.photograph(truth)

# %%
# **Its sweep and the sharp ball.**
sweep = bm.sweep.fit_sweep(image, plate, model=bm.ColorModel.any())
sharp = bm.deblur(image, plate, sweep)
frames = sharp.subframes(8)

# %%
# **Against the truth,** in the middle of the exposure; the error is that of the color, over channels.
middle = truth.scene.body.sharp(
    *(np.arange(n) - at for n, at in zip(image.size, truth.trajectory.at(0.5), strict=True)),
    truth.scene.pose(0.5),
)
inside = (middle[0] > 0.999) & (sharp.layer.alpha > 0.999)
error = np.where(inside[..., None], sharp.layer.straight() - middle[1], 0)
std = np.sqrt(np.mean(sharp.color_std**2, axis=-1))
print(f"{sharp}; error {np.sqrt(np.mean(error[inside] ** 2)):.3f}")
true = bm.Layer(middle[0], middle[1]).over(truth.plate)

peak = 0.2
save(
    "sharp",
    [
        ("the picture", shown(image.rgb)),
        ("the shutter opens", shown(sharp.at(0).over(plate).rgb)),
        ("in the middle", shown(sharp.layer.over(plate).rgb)),
        ("it closes", shown(sharp.at(1).over(plate).rgb)),
        ("the truth, in the middle", shown(true.rgb)),
        (f"stated error (white: {peak})", gray(std, peak)),
        ("true error", gray(np.sqrt(np.mean(error**2, axis=-1)), peak)),
        ("half the shutter", shown(sharp.shutter(0.25, 0.75).over(plate).rgb)),
        *((f"{n} of 8", shown(one.over(plate).rgb)) for n, one in enumerate(frames, 1)),
    ],
    columns=4,
)
