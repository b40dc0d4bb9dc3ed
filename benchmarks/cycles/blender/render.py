# SPDX-License-Identifier: GPL-3.0-or-later
"""Render plates and scenes with Blender Cycles: linear light, true alpha and true light.

Run by `python -m benchmarks.cycles render` in an environment that has `bpy`:
    python render.py JOBS.json FOLDER
JOBS.json holds what `catalog.CyclesScene.mapping` gives, in a list. A scene whose file exists is
skipped; files appear whole. For each place, plates/NAME.npz:
    light (H, W, 3)     linear light of the plate, without sampling noise (denoised)
    small (h, w, 3)     the same at a third of the size, as the light field below is rendered
For each scene, linear/NAME.npz:
    alpha (H, W)        fraction of the exposure in which an object covers the pixel
    light (H, W, 3)     premultiplied light of the objects
    field (h, w, 3)     light of the scene behind the objects over that of the plate, at a third of
                        the size: shadow and bounce; 1 where nothing changed
    alpha_first, light_first   of the first object alone, where there are two
"""

import json
import os
import sys
import time
from pathlib import Path

import bpy
import numpy as np
import objects
import rooms

PLATE_SAMPLES, FIELD_SAMPLES, LIGHT_SAMPLES = 160, 64, 224  # in a pixel of 480 x 320
ALPHA_SAMPLES = 100  # in a part of a pixel, in each of two halves whose difference gives the noise
ALPHA_PARTS = 2  # of a pixel, in each direction
BOUNCES = 4
EXPOSED = 0.62  # light of the brightest percents of a plate; 1 is white
BRIGHT = 97  # percentile that is put there
FIELD_PART = 3  # of the picture's size, in which the light field is rendered
SHARP_BLUR, SMOOTH_BLUR = (
    0.7,
    5.0,
)  # std in pixels of the field: for shadows with rims, and for the rest
SHADOWED = 0.04  # change of light at which a shadow keeps its rims
DARK = 1e-3  # light below which no ratio is formed
SEEN = 0.02  # alpha below which the light of the neighborhood is taken, which has less noise
BLACKMAN_HARRIS = (0.35875, -0.48829, 0.14128, -0.01168)


def start(size: tuple[int, int], place: dict, scene: dict | None) -> bpy.types.Scene:
    """An empty file with a camera and the settings of all renders."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
    made = bpy.context.scene
    made.render.engine = "CYCLES"
    made.cycles.device = "CPU"
    made.cycles.use_adaptive_sampling = False
    made.cycles.max_bounces = BOUNCES
    made.cycles.caustics_reflective = made.cycles.caustics_refractive = False
    made.cycles.use_auto_tile = False
    resized(made, size, 1, "BLACKMAN_HARRIS", place["filter_width"])
    made.render.resolution_percentage = 100
    made.render.use_persistent_data = True
    made.render.image_settings.file_format = "OPEN_EXR"
    made.render.image_settings.color_mode = "RGBA"
    made.render.image_settings.color_depth = "32"
    made.view_settings.view_transform = "Standard"
    made.render.use_motion_blur = scene is not None
    made.render.motion_blur_position = "START"
    made.render.motion_blur_shutter = 1.0
    if scene is not None and scene["rolling_shutter"]:
        made.cycles.rolling_shutter_type = "TOP"
        made.cycles.rolling_shutter_duration = scene["rolling_shutter"]
    made.frame_set(0)
    _camera(made, place)
    return made


def _camera(made: bpy.types.Scene, place: dict) -> None:
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
    data.lens = 36.0 * place["focal_ratio"]
    data.clip_start = 0.01
    if place["f_stop"]:
        data.dof.use_dof, data.dof.aperture_fstop, data.dof.focus_distance = (
            True,
            place["f_stop"],
            2.2,
        )
    camera = bpy.data.objects.new("camera", data)
    bpy.context.collection.objects.link(camera)
    made.camera = camera


def rendered(
    made: bpy.types.Scene, samples: int, seed: int, denoise: bool, scratch: Path
) -> np.ndarray:
    """(H, W, 4) float32, premultiplied, first row on top."""
    made.cycles.samples, made.cycles.seed = samples, seed % 2**31
    made.cycles.use_denoising = denoise
    made.cycles.denoiser = "OPENIMAGEDENOISE"
    made.cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
    made.render.filepath = str(scratch)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(scratch))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    values = np.empty(4 * width * height, np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    return values.reshape(height, width, 4)[::-1].copy()


def resized(
    made: bpy.types.Scene, size: tuple[int, int], factor: float, kind: str, width: float
) -> None:
    """Resolution, and the pixel filter: its kind and width."""
    made.render.resolution_x, made.render.resolution_y = (round(n * factor) for n in size)
    made.cycles.pixel_filter_type, made.cycles.filter_width = kind, width


def plate(job: dict, folder: Path, scratch: Path) -> None:
    """Render a place: exposure is chosen so that its bright parts have the light EXPOSED."""
    place, size = job["place"], tuple(job["size"])
    made = start(size, place, None)
    rooms.build(place["room"], place["light"], folder / "textures")
    if place["post"]:
        rooms.post()
    light = rendered(made, PLATE_SAMPLES // place["scale"] ** 2, 1, True, scratch)[..., :3]
    resized(made, size, 1 / FIELD_PART, "BLACKMAN_HARRIS", 1.5)
    small = rendered(made, FIELD_SAMPLES, 1, True, scratch)[..., :3]
    exposure = EXPOSED / np.percentile(light.max(axis=-1), BRIGHT)
    save(
        folder / "plates" / f"{job['plate']}.npz",
        light=exposure * light,
        small=exposure * small,
        exposure=exposure,
    )


def placed(job: dict) -> list[bpy.types.Object]:
    """The moving objects with their keys; a list for each, its parent first."""
    groups = []
    for mover in job["movers"]:
        group = objects.make(mover["shape"], mover["seed"])
        top = group[0]
        top.scale = 3 * (mover["radius"],)
        for index, pose in enumerate(mover["poses"]):
            frame = index / (len(mover["poses"]) - 1)
            top.location, top.rotation_euler = pose[:3], pose[3:]
            top.keyframe_insert("location", frame=frame)
            top.keyframe_insert("rotation_euler", frame=frame)
        for one in group:
            one.cycles.use_motion_blur, one.cycles.motion_steps = True, 5
        groups.append(group)
    return groups


def seen(things, visible: bool) -> None:
    for thing in things:
        thing.visible_camera = visible


def scene(job: dict, folder: Path, scratch: Path) -> dict:
    """Render a scene's field, alpha and light; its truth in numbers."""
    place, size = job["place"], tuple(job["size"])
    stored = np.load(folder / "plates" / f"{job['plate']}.npz")
    made = start(size, place, job)
    rooms.build(place["room"], place["light"], folder / "textures")
    post = rooms.post() if place["post"] else None
    still = [one for one in bpy.data.objects if one.type in ("MESH", "LIGHT") and one != post]
    groups = placed(job)
    movers = [one for group in groups for one in group]

    seen(movers, False)  # the scene behind, in the light that the objects leave
    resized(made, size, 1 / FIELD_PART, "BLACKMAN_HARRIS", 1.5)
    behind = stored["exposure"] * rendered(made, FIELD_SAMPLES, 1, True, scratch)[..., :3]
    field = light_field(behind, stored["small"])

    made.render.film_transparent = True
    seen(still, False)
    if post is not None:
        post.is_holdout = True
    border(made, job)
    seen(movers, True)
    color = straight_light(made, job, scratch) * stored["exposure"]
    lamps = [one for one in still if one.type == "LIGHT"]
    alpha, noise = object_alpha(made, job, lamps, scratch)
    things = {"alpha": alpha, "light": alpha[..., None] * color, "field": field}
    if len(groups) > 1:
        for one in groups[1]:
            one.is_holdout = True
        first, _ = object_alpha(made, job, lamps, scratch)
        things |= {"alpha_first": first, "light_first": first[..., None] * color}
    save(folder / "linear" / f"{job['name']}.npz", **things)
    return {"alpha_std": noise, "alpha_sum": float(alpha.sum(dtype=float))}


def light_field(behind: np.ndarray, plate_light: np.ndarray) -> np.ndarray:
    """Their ratio: a change of many percent, a shadow, keeps its rims; small changes are smoothed."""
    change = np.where(plate_light > DARK, behind / np.maximum(plate_light, DARK), 1) - 1
    size = blurred(np.abs(blurred(change, 2)).max(axis=-1, keepdims=True), 2)
    shadow = np.clip(size / SHADOWED, 0, 1) ** 2
    return 1 + shadow * blurred(change, SHARP_BLUR) + blurred((1 - shadow) * change, SMOOTH_BLUR)


def straight_light(made: bpy.types.Scene, job: dict, scratch: Path) -> np.ndarray:
    """(H, W, 3) mean light of the objects over the time in which they cover a pixel."""
    resized(made, tuple(job["size"]), 1, "BLACKMAN_HARRIS", job["place"]["filter_width"])
    maps = rendered(made, LIGHT_SAMPLES, job["seed"], False, scratch)
    near = blurred(maps, 1.5)
    use = np.where(maps[..., 3:] > SEEN, maps, near)
    return use[..., :3] / np.maximum(use[..., 3:], 1e-6)


def object_alpha(
    made: bpy.types.Scene, job: dict, lamps, scratch: Path
) -> tuple[np.ndarray, float]:
    """(H, W) alpha, and the standard deviation of its sampling noise where it is not 0.

    Rendered without lamps, in parts of pixels that the pixel filter then averages.
    """
    resized(made, tuple(job["size"]), ALPHA_PARTS, "BOX", 1.0)
    for one in lamps:
        one.hide_render = True
    strength = made.world.node_tree.nodes["Background"].inputs["Strength"]
    daylight, strength.default_value = strength.default_value, 0.0
    halves = []
    for number in range(2):
        parts = rendered(made, ALPHA_SAMPLES, job["seed"] + 1 + number, False, scratch)[..., 3]
        halves.append(filtered(parts, job["place"]["filter_width"]))
    for one in lamps:
        one.hide_render = False
    strength.default_value = daylight
    mean, difference = sum(halves) / 2, halves[0] - halves[1]
    inside = mean > 1e-4
    noise = float(np.sqrt(np.mean(difference[inside] ** 2)) / 2) if inside.any() else 0.0
    return np.clip(mean, 0, 1), noise


def filtered(parts: np.ndarray, width: float) -> np.ndarray:
    """Pixels from their parts: a separable Blackman-Harris window of `width` pixels on each side."""
    reach = int(np.ceil(ALPHA_PARTS * (width + 0.5)))
    places = (np.arange(-reach, reach + ALPHA_PARTS) + 0.5) / ALPHA_PARTS - 0.5
    turn = 2 * np.pi * (places / (2 * width) + 0.5)
    weights = sum(a * np.cos(k * turn) for k, a in enumerate(BLACKMAN_HARRIS))
    weights = np.where(np.abs(places) < width, weights, 0)
    weights /= weights.sum()
    for axis in (0, 1):
        pad = [(reach, reach) if a == axis else (0, 0) for a in (0, 1)]
        wide, count = np.pad(parts, pad, mode="edge"), parts.shape[axis] // ALPHA_PARTS
        rows = ALPHA_PARTS * np.arange(count)
        parts = sum(w * np.take(wide, rows + k, axis) for k, w in enumerate(weights))
    return parts


def border(made: bpy.types.Scene, job: dict) -> None:
    """Only the box that the first objects' paths touch is rendered; elsewhere nothing is."""
    width, height = job["size"]
    boxes = []
    for mover in job["movers"]:
        poses = np.array(mover["poses"])
        scale = job["focal"] / -poses[:, 2]
        reach = 1.9 * mover["radius"] * scale + 6
        x, y = width / 2 + scale * poses[:, 0], height / 2 - scale * poses[:, 1]
        boxes.append([(x - reach).min(), (y - reach).min(), (x + reach).max(), (y + reach).max()])
    low, high = np.min(boxes, axis=0)[:2], np.max(boxes, axis=0)[2:]
    made.render.use_border, made.render.use_crop_to_border = True, False
    made.render.border_min_x, made.render.border_max_x = (
        np.clip([low[0], high[0]], 0, width) / width
    )
    made.render.border_min_y, made.render.border_max_y = (
        1 - np.clip([high[1], low[1]], 0, height) / height
    )


def blurred(maps: np.ndarray, std: float) -> np.ndarray:
    """(H, W, k) averaged by a separable Gaussian; borders are mirrored."""
    reach = int(np.ceil(3 * std))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / std) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        pad = [(reach, reach) if a == axis else (0, 0) for a in range(3)]
        wide, count = np.pad(maps, pad, mode="symmetric"), maps.shape[axis]
        maps = sum(w * np.take(wide, np.arange(count) + k, axis) for k, w in enumerate(weights))
    return maps


def save(path: Path, **arrays) -> None:
    """A whole file or none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial.npz")
    np.savez_compressed(partial, **{k: np.asarray(v, np.float32) for k, v in arrays.items()})
    os.replace(partial, path)


def main() -> None:
    jobs, folder = json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2])
    scratch = folder / f"scratch-{os.getpid()}.exr"
    for number, job in enumerate(jobs, 1):
        begun = time.time()
        if not (folder / "plates" / f"{job['plate']}.npz").exists():
            plate(job, folder, scratch)
        record = folder / "linear" / f"{job['name']}.json"
        if record.exists():
            continue
        truth = scene(job, folder, scratch)
        record.write_text(json.dumps(job | truth, indent=1))
        print(
            f"cycles: {number} of {len(jobs)}: {job['name']}, {time.time() - begun:.1f} s",
            flush=True,
        )
    scratch.unlink(missing_ok=True)


if __name__ == "__main__":
    main()
