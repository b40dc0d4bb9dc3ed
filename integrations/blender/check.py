# SPDX-License-Identifier: GPL-3.0-or-later
"""Install the archive into an empty Blender, use the add-on, and print what came of it as JSON.

Run by tests/integrations/test_blender.py in an environment with bpy:
    python check.py ARCHIVE COMMAND FOLDER
FOLDER has image.exr and plate.exr; layer.exr, motion.json and a clip in clip/ for the single steps.
"""

import json
import sys
from pathlib import Path

import bpy
from bpy_extras.object_utils import world_to_camera_view

ADDON = "bl_ext.user_default.blurmatte"


def main(archive, command, folder):
    """Every step of a user, and the numbers of each."""
    found = {"installed": installed(archive)}
    bpy.context.preferences.addons[ADDON].preferences.command = command
    scene, settings = bpy.context.scene, bpy.context.scene.blurmatte
    for thing in list(scene.objects):
        bpy.data.objects.remove(thing)
    found["panels"] = [hasattr(bpy.types, f"BLURMATTE_PT_{name}") for name in ("panel", "nodes")]
    quick(scene)
    settings.folder = str(folder / "out")
    files = [{"name": "image.exr"}, {"name": "plate.exr"}]
    found["solved"] = list(bpy.ops.blurmatte.solve(directory=str(folder), files=files))
    found["again"] = list(bpy.ops.blurmatte.solve(choose=False))
    found["plate"] = Path(settings.plate).name
    found["said"] = settings.said.splitlines()
    found["render"] = [scene.render.resolution_x, scene.render.resolution_y]
    render(scene, folder / "composite.exr")
    found["path"] = path_of(scene)
    found["plane"] = plane_of(scene, folder)
    found["clip"] = clip_of(scene, settings, folder)
    found["refused"] = refused(settings, folder)
    bpy.ops.preferences.addon_disable(module=ADDON)
    found["left"] = hasattr(bpy.types, "BLURMATTE_PT_panel") or hasattr(scene, "blurmatte")
    print("FOUND " + json.dumps(found))


def installed(archive):
    """Install the archive as the file browser does."""
    bpy.ops.extensions.package_install_files(
        filepath=archive, repo="user_default", enable_on_install=True
    )
    return ADDON in bpy.context.preferences.addons


def quick(scene):
    """Settings of a render that takes a moment."""
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", 1, False
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    settings.exr_codec = "ZIP"


def render(scene, path):
    """Render the scene with its compositor."""
    if scene.camera is None:
        camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(camera)
        scene.camera = camera
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def pixel(scene, place):
    """A point of space in pixels of the render; pixel centers at whole numbers."""
    x, y, _ = world_to_camera_view(scene, scene.camera, place)
    return [x * scene.render.resolution_x - 0.5, (1 - y) * scene.render.resolution_y - 0.5]


def path_of(scene):
    """The curve and the moving empty in pixels, with the camera elsewhere than at the origin."""
    scene.camera.location, scene.camera.rotation_euler = (3, -4, 2), (1.1, 0.2, 0.7)
    scene.camera.data.shift_x = 0.1
    bpy.ops.blurmatte.path()
    bpy.context.view_layer.update()
    curve, marker = bpy.data.objects["blurmatte path"], bpy.data.objects["blurmatte object"]
    points = [pixel(scene, curve.matrix_world @ p.co.to_3d()) for p in curve.data.splines[0].points]
    moved = []
    for t in (0.0, 0.25, 0.5):
        scene.frame_set(scene.frame_current, subframe=t)
        moved.append(pixel(scene, marker.matrix_world.translation))
    scene.frame_set(scene.frame_current)
    return {"curve": points, "marker": moved}


def plane_of(scene, folder):
    """The corners of the plane in pixels, and a render of it without compositor over black."""
    bpy.ops.blurmatte.plane()
    bpy.context.view_layer.update()
    plane = bpy.data.objects["blurmatte plane"]
    corners = [pixel(scene, plane.matrix_world @ vertex.co) for vertex in plane.data.vertices]
    scene.render.use_compositing = False
    world = bpy.data.worlds.new("black")
    world.color = (0, 0, 0)
    for node in world.node_tree.nodes if world.node_tree else ():
        if node.bl_idname == "ShaderNodeBackground":
            node.inputs["Strength"].default_value = 0
    scene.world = world
    scene.cycles.samples = 64
    render(scene, folder / "plane.exr")
    scene.render.use_compositing, scene.cycles.samples = True, 1
    return corners


def clip_of(scene, settings, folder):
    """A clip that was solved: frames of the scene show its layers with the right numbers."""
    settings.folder, settings.first_frame = str(folder / "clip"), 11
    settings.plate = str(folder / "plate.exr")
    found = {"placed": list(bpy.ops.blurmatte.composite())}
    tree = getattr(scene, "compositing_node_group", None) or scene.node_tree
    node = tree.nodes["blurmatte layer"]
    found["frames"] = [node.frame_duration, node.frame_start, node.frame_offset]
    found["nodes"] = sorted(one.name for one in tree.nodes)
    for frame in (15, 16):
        scene.frame_set(frame)
        render(scene, folder / f"clip_{frame}.exr")
    return found


def refused(settings, folder):
    """What a user reads who has no command, or gives what cannot be solved."""
    preferences = bpy.context.preferences.addons[ADDON].preferences
    said, command = [], preferences.command
    tries = (
        (command, ["image.exr", "other.exr"]),
        (command, ["plate.exr"] * 2),
        ("/nowhere/blurmatte", ["image.exr", "plate.exr"]),
        (command, ["missing.exr", "plate.exr"]),
    )
    for tried, names in tries:
        preferences.command = tried
        try:
            bpy.ops.blurmatte.solve(directory=str(folder), files=[{"name": name} for name in names])
            said.append("")
        except RuntimeError as error:
            said.append(str(error).strip())
    preferences.command = command
    return said


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
