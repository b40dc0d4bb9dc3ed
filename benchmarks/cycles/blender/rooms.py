# SPDX-License-Identifier: GPL-3.0-or-later
"""Places and lights. The camera is at the origin, looks along -z, y is up; lengths are meters."""

from math import pi, radians
from pathlib import Path

import bpy
import numpy as np
from objects import box, cylinder, material, matte, sphere

WALL_DEPTH = 4.0  # m from the camera
FLOOR = -0.85  # m, below the camera
CEILING = 1.7  # m, above it
SIDE = 2.4  # m from the axis to the side walls


def _plane(corners, with_material) -> bpy.types.Object:
    mesh = bpy.data.meshes.new("plane")
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.uv_layers.new(name="uv")
    for loop, place in zip(mesh.uv_layers[0].data, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
        loop.uv = place
    made = bpy.data.objects.new("plane", mesh)
    bpy.context.collection.objects.link(made)
    mesh.materials.append(with_material)
    return made


def wall(with_material, depth: float = WALL_DEPTH, left: float = -SIDE, right: float = SIDE):
    """Faces the camera."""
    return _plane(
        [
            (left, FLOOR, -depth),
            (right, FLOOR, -depth),
            (right, CEILING, -depth),
            (left, CEILING, -depth),
        ],
        with_material,
    )


def floor(with_material, reach: float = SIDE, depth: float = WALL_DEPTH):
    return _plane(
        [
            (-reach, FLOOR, 1.5),
            (reach, FLOOR, 1.5),
            (reach, FLOOR, -depth),
            (-reach, FLOOR, -depth),
        ],
        with_material,
    )


def closed(side_material, ceiling_material) -> None:
    """Side walls, ceiling, and a wall behind the camera, so that light bounces."""
    for x in (-SIDE, SIDE):
        corners = [
            (x, FLOOR, 1.5),
            (x, FLOOR, -WALL_DEPTH),
            (x, CEILING, -WALL_DEPTH),
            (x, CEILING, 1.5),
        ]
        _plane(corners, side_material)
    top = [
        (-SIDE, CEILING, 1.5),
        (SIDE, CEILING, 1.5),
        (SIDE, CEILING, -WALL_DEPTH),
        (-SIDE, CEILING, -WALL_DEPTH),
    ]
    _plane(top, ceiling_material)
    back = [(-SIDE, FLOOR, 1.5), (SIDE, FLOOR, 1.5), (SIDE, CEILING, 1.5), (-SIDE, CEILING, 1.5)]
    _plane(back, side_material)


def textured(kind: str, scale: float, *colors) -> bpy.types.Material:
    """A procedural texture in the object's coordinates: noise, brick, checker, wave or voronoi."""
    made, shader, tree = material(kind)
    where = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    names = {
        "noise": "Noise",
        "brick": "Brick",
        "checker": "Checker",
        "wave": "Wave",
        "voronoi": "Voronoi",
    }
    texture = tree.nodes.new(f"ShaderNodeTex{names[kind]}")
    tree.links.new(where, texture.inputs["Vector"])
    texture.inputs["Scale"].default_value = scale
    if kind in ("brick", "checker"):
        for index, color in enumerate(colors[: 3 if kind == "brick" else 2]):
            texture.inputs["Mortar" if index == 2 else f"Color{index + 1}"].default_value = (
                *color,
                1,
            )
        output = texture.outputs["Color"]
    else:
        if kind in ("noise", "wave"):
            texture.inputs["Detail"].default_value = 6
        ramp = tree.nodes.new("ShaderNodeValToRGB")
        first, last = ramp.color_ramp.elements
        first.position, last.position = (0.35, 0.65) if kind == "noise" else (0.1, 0.9)
        first.color, last.color = (*colors[0], 1), (*colors[-1], 1)
        for index, color in enumerate(colors[1:-1], 1):
            ramp.color_ramp.elements.new(0.35 + 0.3 * index / (len(colors) - 1)).color = (*color, 1)
        tree.links.new(
            texture.outputs["Distance" if kind == "voronoi" else "Fac"], ramp.inputs["Fac"]
        )
        output = ramp.outputs["Color"]
    tree.links.new(output, shader.inputs["Base Color"])
    shader.inputs["Roughness"].default_value = 0.9
    shader.inputs["Specular IOR Level"].default_value = 0.1
    return made


def picture(file: Path) -> bpy.types.Material:
    """A photograph, as a matte print."""
    made, shader, tree = material(file.stem)
    image = tree.nodes.new("ShaderNodeTexImage")
    image.image = bpy.data.images.load(str(file))
    tree.links.new(image.outputs["Color"], shader.inputs["Base Color"])
    shader.inputs["Roughness"].default_value = 1
    shader.inputs["Specular IOR Level"].default_value = 0
    return made


GRAY, WHITE = (0.42, 0.42, 0.42), (0.75, 0.74, 0.72)


def gray_room(_: Path) -> None:
    wall(matte(GRAY))
    floor(matte((0.3, 0.3, 0.3)))
    closed(matte(GRAY), matte(WHITE))


def photo_room(name: str):
    def made(textures: Path) -> None:
        wall(picture(textures / f"{name}.png"), left=-1.95, right=1.95)
        wall(matte(WHITE), depth=WALL_DEPTH + 0.02)
        floor(matte((0.35, 0.27, 0.2)))
        closed(matte(WHITE), matte(WHITE))

    return made


def lawn(_: Path) -> None:
    grass = textured("noise", 9, (0.03, 0.09, 0.02), (0.10, 0.2, 0.05), (0.16, 0.2, 0.07))
    floor(grass, reach=40, depth=60)
    hedge = box(40, 0.8, 0.5)
    hedge.location = (0, -0.1, -9)
    hedge.data.materials.append(textured("voronoi", 7, (0.01, 0.05, 0.012), (0.08, 0.17, 0.04)))


def painted_room(_: Path) -> None:
    wall(matte((0.22, 0.34, 0.42)), right=-0.1)
    wall(matte((0.55, 0.4, 0.2)), left=-0.1)
    floor(textured("wave", 3, (0.2, 0.12, 0.06), (0.32, 0.2, 0.11)))
    closed(matte((0.5, 0.48, 0.45)), matte(WHITE))


def brick_yard(_: Path) -> None:
    wall(
        textured("brick", 3.2, (0.3, 0.09, 0.05), (0.42, 0.16, 0.09), (0.5, 0.48, 0.44)),
        left=-8,
        right=8,
    )
    floor(textured("noise", 14, (0.2, 0.2, 0.19), (0.34, 0.33, 0.31)), reach=12)


def tiled_room(_: Path) -> None:
    wall(textured("checker", 3.3, (0.62, 0.66, 0.68), (0.16, 0.36, 0.44)))
    floor(textured("checker", 2.5, (0.55, 0.53, 0.5), (0.12, 0.11, 0.11)))
    closed(matte(WHITE), matte(WHITE))


def shelf(_: Path) -> None:
    """Boxes of many colors on boards."""
    rng = np.random.default_rng(17)
    wall(matte((0.25, 0.2, 0.16)))
    floor(matte((0.3, 0.24, 0.18)))
    closed(matte((0.55, 0.52, 0.47)), matte(WHITE))
    for board in (-0.8, -0.3, 0.2, 0.7, 1.2):
        plank = box(2.4, 0.02, 0.2)
        plank.location = (0, board, -WALL_DEPTH + 0.2)
        plank.data.materials.append(matte((0.36, 0.24, 0.14)))
        x = -2.2
        while x < 2.2:
            wide, high = rng.uniform(0.02, 0.07), rng.uniform(0.14, 0.22)
            book = box(wide, high, 0.15)
            book.location = (x + wide, board + 0.02 + high, -WALL_DEPTH + 0.2)
            book.data.materials.append(matte(tuple(rng.uniform(0.04, 0.6, 3))))
            x += 2 * wide + rng.choice([0.002, 0.002, 0.12])


def court(_: Path) -> None:
    """A hall: wooden floor with lines, a padded wall of one hue, a pillar."""
    wall(matte((0.1, 0.26, 0.5)), depth=7, left=-9, right=9)
    floor(textured("wave", 2.2, (0.42, 0.25, 0.12), (0.5, 0.32, 0.17)), reach=9, depth=7)
    stripe = box(6, 0.001, 0.04)
    stripe.location = (0, FLOOR + 0.002, -4.6)
    stripe.data.materials.append(matte((0.75, 0.75, 0.72)))
    pillar = cylinder(0.25, 2)
    pillar.rotation_euler = (0, 0, pi / 2)
    pillar.location = (1.4, 0, -6.4)
    pillar.data.materials.append(matte((0.6, 0.58, 0.5)))


def dunes(_: Path) -> None:
    """Sand up to a low horizon, stones."""
    floor(textured("noise", 20, (0.45, 0.36, 0.24), (0.58, 0.48, 0.34)), reach=60, depth=90)
    rng = np.random.default_rng(23)
    for _ in range(14):
        stone = sphere()
        size = rng.uniform(0.05, 0.22)
        stone.scale = (size * rng.uniform(1, 1.7), size, size)
        stone.location = (rng.uniform(-2, 2), FLOOR + 0.4 * size, rng.uniform(-6, -3.2))
        stone.data.materials.append(textured("noise", 4, (0.2, 0.19, 0.18), (0.4, 0.37, 0.33)))


ROOMS = {
    "gray_room": gray_room,
    "photo_astronaut": photo_room("astronaut"),
    "photo_coffee": photo_room("coffee"),
    "photo_chelsea": photo_room("chelsea"),
    "photo_rocket": photo_room("rocket"),
    "lawn": lawn,
    "painted_room": painted_room,
    "brick_yard": brick_yard,
    "tiled_room": tiled_room,
    "shelf": shelf,
    "court": court,
    "dunes": dunes,
}


def _lamp(kind: str, energy: float, color, place, **settings) -> None:
    light = bpy.data.lights.new("lamp", kind)
    light.energy, light.color = energy, color
    for name, value in settings.items():
        setattr(light, name, value)
    made = bpy.data.objects.new("lamp", light)
    bpy.context.collection.objects.link(made)
    made.location = place
    made.visible_camera = False
    from mathutils import Vector

    target = Vector((0, -0.3, -3.4))
    made.rotation_euler = (target - Vector(place)).to_track_quat("-Z", "Y").to_euler()


def _sky(color, strength: float) -> None:
    world = bpy.context.scene.world or bpy.data.worlds.new("world")
    bpy.context.scene.world = world
    world.use_nodes = True
    back = world.node_tree.nodes["Background"]
    back.inputs["Color"].default_value = (*color, 1)
    back.inputs["Strength"].default_value = strength


def lamp() -> None:
    _sky((1, 1, 1), 0.02)
    _lamp("AREA", 60, (1, 0.93, 0.82), (0.9, 1.5, -1.9), shape="SQUARE", size=0.5)


def two_lamps() -> None:
    _sky((1, 1, 1), 0.02)
    _lamp("AREA", 45, (1, 0.78, 0.5), (-1.6, 1.2, -1.5), shape="SQUARE", size=0.4)
    _lamp("AREA", 40, (0.55, 0.75, 1), (1.7, 1.0, -1.8), shape="SQUARE", size=0.6)


def window() -> None:
    _sky((1, 1, 1), 0.05)
    _lamp("AREA", 110, (0.9, 0.96, 1), (-2.2, 0.5, -2.4), shape="RECTANGLE", size=1.0, size_y=1.3)


def sun() -> None:
    _sky((0.5, 0.68, 1), 0.8)
    _lamp("SUN", 3.2, (1, 0.94, 0.84), (2.5, 3.5, 1.5), angle=radians(0.53))


def overcast() -> None:
    _sky((0.9, 0.95, 1), 1.2)


LIGHTS = {"lamp": lamp, "two_lamps": two_lamps, "window": window, "sun": sun, "overcast": overcast}


def post() -> bpy.types.Object:
    """Something still in front: a post of 2.4 cm, 1.2 m from the camera."""
    made = cylinder(0.012, 1.2)
    made.rotation_euler = (0, 0, radians(86))
    made.location = (0.02, 0, -1.2)
    made.data.materials.append(matte((0.2, 0.16, 0.13)))
    return made


def build(room: str, light: str, textures: Path) -> None:
    """Everything that stands still."""
    ROOMS[room](textures)
    LIGHTS[light]()
