"""
Enhanced, recolored, removed
============================
The last row of figure 4 of [GC07]: a part of the path of a table tennis ball. Alpha is multiplied and
the color map is scaled, so that the ball and its shading are visible. Also the same layer in another
color, and the picture without it.
"""

import numpy as np
from figure import color_of, gray, save, shown

import blurmatte as bm
from blurmatte.rendering import colorful_plate

# %%
# **A ball under a lamp,** thrown in front of a dark wall.
size = (330, 210)
plate_light = 0.55 * colorful_plate(size, 3, tile=55)
shot = bm.rendering.Shot(
    bm.rendering.Scene(
        plate_light,
        bm.Trajectory.parabola((45, 60), (230, -40), (20, 190)),
        bm.rendering.Ball(14, np.array([0.9, 0.42, 0.05]), ambient=0.25),
    ),
    bm.rendering.Camera(code_std=1 / 255),
    plate_frames=5,
    seed=2,
)
rendering = bm.rendering.render(shot.scene)
image, plate = shot.photograph(rendering)
solution = bm.solve(image, plate)
layer = solution.layer

# %%
# **Edits of the layer,** put back into the picture: grain and shadows of the picture are kept.
enhanced, _ = bm.retouch(image, layer, layer.amplify(5), plate)
recolored, _ = bm.retouch(image, layer, layer.recolor("#4060ff").fade(3), plate)
removed, changed = bm.remove(image, plate, solution.streak)
left = np.sqrt(np.mean((removed.rgb - rendering.plate.rgb)[changed] ** 2))
print(f"{solution.model.hex[0]}; removed: {left:.4f} RMS from the scene without noise")

peak = float(layer.alpha.max())
save(
    "enhanced",
    [
        ("the picture", shown(image.rgb)),
        (f"alpha (white is {peak:.2f})", gray(layer.alpha, peak)),
        ("color", color_of(solution)),
        ("enhanced: amplify(5)", shown(enhanced.rgb)),
        ('recolor("#4060ff").fade(3)', shown(recolored.rgb)),
        ("removed", shown(removed.rgb)),
    ],
    columns=3,
)
