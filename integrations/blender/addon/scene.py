# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers in the compositor and before the camera, and the path as a curve with keyframes."""

import bpy

from . import results

LINEAR = "Linear Rec.709"
LAYER, PLATE, OVER = "blurmatte layer", "blurmatte plate", "blurmatte over"  # names of our nodes
CURVE, MARKER, PLANE = "blurmatte path", "blurmatte object", "blurmatte plane"
_DISTANCE = 10.0  # units from the camera to plane and path
_KEY_STEP = 0.02  # frames between two keyframes: Blender joins those that are nearer than 0.01
_SHUTTER = 0.5  # of a frame, if the scene does not blur motion


def load_layer(folder, first=1):
    """The image of a layer or of the layers of a clip, and the numbers of its sequence.

    Parameters
    ----------
    folder : str
    first : int
        Frame of the scene that shows frame 0 of the clip.

    Returns
    -------
    image : bpy.types.Image
        Premultiplied, linear Rec. 709.
    frames : (duration, start, offset) or None
        For nodes and textures of a sequence.
    """
    layers = results.layers_of(folder)
    if not layers:
        raise FileNotFoundError(f"there is no layer in {folder}")
    number, path = next(iter(layers.items()))
    image = bpy.data.images.load(str(path), check_existing=True)
    image.colorspace_settings.name = LINEAR
    image.alpha_mode = "PREMUL"
    if number is None:
        image.reload()
        return image, None
    image.source = "SEQUENCE"
    last = max(layers)
    # A sequence shows file (frame - start + 1 + offset).
    return image, (last - number + 1, first + number, number - 1)


def load_plate(path, first=1):
    """The image of a plate or of a clip, and the numbers of its frames if it is one."""
    image = bpy.data.images.load(str(path), check_existing=True)
    if image.source != "MOVIE":
        return image, None
    return image, (image.frame_duration, first, 0)


def composite(scene, layer, background, size=None):
    """Put a layer over a background in the compositor, and show the result.

    Parameters
    ----------
    scene : bpy.types.Scene
    layer, background : (image, frames)
        From `load_layer` and `load_plate`. Without a background the layer goes over what the
        compositor shows now.
    size : (width, height), optional
        Of the picture: becomes that of the render.

    Returns
    -------
    bpy.types.Node
        The node of the result.
    """
    tree, shown = _tree(scene)
    fore = _image_node(tree, LAYER, layer)
    before = shown.links[0].from_socket if shown.is_linked else None
    if before is not None and before.node.name == OVER:
        links = _inputs(before.node)[0].links
        before = links[0].from_socket if links else None
    if background is not None:
        before = _image_node(tree, PLATE, background).outputs[0]
    over = tree.nodes.get(OVER) or tree.nodes.new("CompositorNodeAlphaOver")
    over.name = over.label = OVER
    under, above = _inputs(over)
    if before is not None:
        tree.links.new(before, under)
    tree.links.new(fore.outputs[0], above)
    tree.links.new(over.outputs[0], shown)
    for k, node in enumerate((tree.nodes.get(PLATE), fore, over, shown.node)):
        if node is not None:
            node.location = (260 * k - 600, -220 * (k % 2))
    if size is not None:
        scene.render.resolution_x, scene.render.resolution_y = size
        scene.render.resolution_percentage = 100
    return over


def _tree(scene):
    """The tree of the compositor and the socket that it shows; made where there is none."""
    if hasattr(scene, "compositing_node_group"):  # since Blender 5.0
        tree = scene.compositing_node_group
        if tree is None:
            tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
            scene.compositing_node_group = tree
        kind = "NodeGroupOutput"
        if not any(item.item_type == "SOCKET" for item in tree.interface.items_tree):
            tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    else:
        scene.use_nodes = True
        tree, kind = scene.node_tree, "CompositorNodeComposite"
    output = next((node for node in tree.nodes if node.bl_idname == kind), None)
    output = output or tree.nodes.new(kind)
    scene.render.use_compositing = True
    return tree, output.inputs[0]


def _image_node(tree, name, loaded):
    """The node of that name with an image."""
    image, frames = loaded
    node = tree.nodes.get(name) or tree.nodes.new("CompositorNodeImage")
    node.name = node.label = name
    node.image = image
    if frames is not None:
        node.frame_duration, node.frame_start, node.frame_offset = frames
        node.use_auto_refresh = True
    return node


def _inputs(over):
    """Background and foreground of a node Alpha Over."""
    if "Foreground" in over.inputs:  # since Blender 5.0
        return over.inputs["Background"], over.inputs["Foreground"]
    return over.inputs[1], over.inputs[2]


def camera_of(scene):
    """The camera of a scene; made where there is none."""
    if scene.camera is None:
        camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(camera)
        scene.camera = camera
    return scene.camera


def _frame(scene, size):
    """The corner of the first pixel and the steps to the next ones, in coordinates of the camera."""
    render, camera = scene.render, camera_of(scene)
    if size is not None:
        render.resolution_x, render.resolution_y = size
    corners = camera.data.view_frame(scene=scene)  # right top, right bottom, left bottom, left top
    perspective = camera.data.type != "ORTHO"
    scale = _DISTANCE / -corners[0].z if perspective else 1.0
    left, right = scale * corners[3].x, scale * corners[0].x
    top, bottom = scale * corners[0].y, scale * corners[1].y
    width, height = render.resolution_x, render.resolution_y
    return (left, top), ((right - left) / width, (bottom - top) / height)


def add_plane(scene, layer, size):
    """A plane with the layer that fills the view of the camera."""
    (left, top), (dx, dy) = _frame(scene, size)
    right, bottom = left + size[0] * dx, top + size[1] * dy
    mesh = bpy.data.meshes.new(PLANE)
    places = ((left, bottom), (right, bottom), (right, top), (left, top))
    mesh.from_pydata([(x, y, -_DISTANCE) for x, y in places], [], [(0, 1, 2, 3)])
    uv = mesh.uv_layers.new(name="UVMap")
    for loop, place in zip(uv.data, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
        loop.uv = place
    mesh.materials.append(_material(layer))
    plane = bpy.data.objects.new(PLANE, mesh)
    plane.parent = camera_of(scene)
    scene.collection.objects.link(plane)
    return plane


def _material(layer):
    """The light of the layer, and behind it the scene: Blender divides colors by alpha."""
    image, frames = layer
    material = bpy.data.materials.new(PLANE)
    material.use_nodes = True
    if hasattr(material, "surface_render_method"):
        material.surface_render_method = "BLENDED"
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    texture = nodes.new("ShaderNodeTexImage")
    texture.image, texture.interpolation, texture.extension = image, "Closest", "CLIP"
    if frames is not None:
        user = texture.image_user
        user.frame_duration, user.frame_start, user.frame_offset = frames
        user.use_auto_refresh = True
    light, behind = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeBsdfTransparent")
    mix, output = nodes.new("ShaderNodeMixShader"), nodes.new("ShaderNodeOutputMaterial")
    links.new(texture.outputs["Color"], light.inputs["Color"])
    links.new(texture.outputs["Alpha"], mix.inputs[0])
    links.new(behind.outputs[0], mix.inputs[1])
    links.new(light.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], output.inputs["Surface"])
    return material


def add_path(scene, times, places, size):
    """The path before the camera: a curve, and an empty that moves along it while the shutter is open.

    Parameters
    ----------
    scene : bpy.types.Scene
    times : sequence of float
        Fractions of the exposure.
    places : sequence of (x, y)
        Pixels of the picture; pixel centers at whole numbers.
    size : (width, height)
        Of the picture.

    Returns
    -------
    curve, marker : bpy.types.Object
    """
    (left, top), (dx, dy) = _frame(scene, size)
    points = [(left + (x + 0.5) * dx, top + (y + 0.5) * dy, -_DISTANCE) for x, y in places]
    data = bpy.data.curves.new(CURVE, "CURVE")
    data.dimensions = "3D"
    spline = data.splines.new("POLY")
    spline.points.add(len(points) - 1)
    for point, place in zip(spline.points, points, strict=True):
        point.co = (*place, 1.0)
    curve, marker = bpy.data.objects.new(CURVE, data), bpy.data.objects.new(MARKER, None)
    marker.empty_display_size = 0.05 * _DISTANCE
    for thing in (curve, marker):
        thing.parent = camera_of(scene)
        scene.collection.objects.link(thing)
    open_for = scene.render.motion_blur_shutter if scene.render.use_motion_blur else _SHUTTER
    last = -_KEY_STEP
    for t, place in zip(times, points, strict=True):
        if open_for * t < last + _KEY_STEP and t < 1:
            continue
        marker.location, last = place, open_for * t
        marker.keyframe_insert("location", frame=scene.frame_current + last)
    return curve, marker
