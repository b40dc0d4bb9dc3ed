"""What the examples of the reference begin with: an orange ball, thrown before a colorful wall."""

from pathlib import Path

import numpy as np

import blurmatte as bm
from blurmatte.rendering import colorful_plate

wall = colorful_plate((128, 72), 3, tile=20)
orange = np.array([0.8, 0.42, 0.05])
camera = bm.rendering.Camera(code_std=0.5 / 255)

# One picture of the ball and one without it
path = bm.Trajectory.line((30, 44), (88, 30))
scene = bm.rendering.Scene(wall, path, bm.rendering.Ball(10, orange, ambient=0.5))
truth = bm.rendering.render(scene, 100)
image, plate = bm.rendering.Shot(scene, camera, plate_frames=5).photograph(truth)
streak = bm.find_streaks(image, plate)[0]
solution = bm.solve(image, plate)
layer, sweep, motion = solution.layer, solution.sweep, bm.measure_motion(solution)
sharp = bm.deblur(image, plate, sweep)

# A clip of six frames at 50 frames per second: a smaller ball falls
fall = bm.Trajectory.parabola((12, 48), (104, -84), (0, 90))
throw = bm.rendering.Scene(wall, fall, bm.rendering.Ball(6, orange, ambient=0.5))
frames = [
    bm.rendering.Shot(part, camera, seed=k).photograph(bm.rendering.render(part, 40))[0]
    for k, part in enumerate(throw.exposures(6, duty=0.5))
]
found = list(bm.motion.sightings(frames, plate, solution.model, rate=50))
rows = bm.motion.link_sightings(found)

bm.write("throw.png", image)
bm.write("empty_room.png", plate)
bm.write("layer.exr", solution)
bm.write("color.json", solution.model)
bm.write_frames("clip/####.png", frames)
bm.scenes.save_shot("scenes/throw", bm.rendering.Shot(scene, camera))
run = bm.clips.ClipRun(
    (Path("throw.png"),), bm.read_frames("clip", bm.SRGB)[:2], plate, solution.model
)
