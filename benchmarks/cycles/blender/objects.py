# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that move: meshes and materials, made from a kind and a random generator.

All lengths are in units of the object's radius; `render.py` scales them. The generator is seeded by the
scene, so the same scene gives the same object.
"""

import colorsys
from math import pi

import bpy
import numpy as np

Color = tuple[float, float, float]


def paint(rng: np.random.Generator, saturation: tuple[float, float] = (0.55, 0.95)) -> Color:
    """A saturated albedo of any hue."""
    return colorsys.hsv_to_rgb(rng.uniform(), rng.uniform(*saturation), rng.uniform(0.35, 0.8))


def material(name: str) -> tuple[bpy.types.Material, bpy.types.Node, bpy.types.NodeTree]:
    """An empty node material, and its Principled shader."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    return made, made.node_tree.nodes["Principled BSDF"], made.node_tree


def matte(color: Color, roughness: float = 1.0, specular: float = 0.0) -> bpy.types.Material:
    """One paint; `roughness` 1 and `specular` 0 scatter like paper."""
    made, shader, _ = material("matte")
    shader.inputs["Base Color"].default_value = (*color, 1)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Specular IOR Level"].default_value = specular
    return made


def glossy(color: Color, rng: np.random.Generator) -> bpy.types.Material:
    """Paint under a clear coat, with a highlight."""
    return matte(color, roughness=rng.uniform(0.08, 0.35), specular=rng.uniform(0.4, 0.7))


def patterned(rng: np.random.Generator, pattern: str) -> bpy.types.Material:
    """Two or more paints: "stripes" around the x axis, or "patches" of noise."""
    made, shader, tree = material(pattern)
    where = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
    if pattern == "stripes":
        texture = tree.nodes.new("ShaderNodeTexWave")
        texture.wave_profile = "SIN"
        texture.inputs["Scale"].default_value = rng.uniform(0.25, 0.6)
    else:
        texture = tree.nodes.new("ShaderNodeTexNoise")
        texture.inputs["Scale"].default_value = rng.uniform(1.0, 2.5)
        texture.inputs["Detail"].default_value = 3
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.interpolation = "CONSTANT"
    count = 2 if pattern == "stripes" else int(rng.integers(3, 6))
    for index in range(count):
        place = index / count if pattern == "stripes" else 0.3 + 0.4 * index / count
        elements = ramp.color_ramp.elements
        element = elements[0] if index == 0 else elements.new(place)
        element.position = 0.0 if index == 0 else place
        element.color = (*paint(rng), 1)
    ramp.color_ramp.elements.remove(ramp.color_ramp.elements[-1])  # the one Blender starts with
    tree.links.new(where, texture.inputs["Vector"])
    tree.links.new(texture.outputs["Fac"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    shader.inputs["Roughness"].default_value = rng.uniform(0.5, 1.0)
    shader.inputs["Specular IOR Level"].default_value = rng.uniform(0.0, 0.3)
    return made


def see_through(color: Color, opacity: float) -> bpy.types.Material:
    """Thin paint: a fraction of all rays goes straight through."""
    made, shader, _ = material("see-through")
    shader.inputs["Base Color"].default_value = (*color, 1)
    shader.inputs["Roughness"].default_value = 1
    shader.inputs["Alpha"].default_value = opacity
    return made


def emitting(color: Color) -> bpy.types.Material:
    """Light of its own, the same in all directions."""
    made, shader, _ = material("emitting")
    shader.inputs["Base Color"].default_value = (0, 0, 0, 1)
    shader.inputs["Emission Color"].default_value = (*color, 1)
    shader.inputs["Emission Strength"].default_value = 1.0
    return made


def _active(smooth: bool = True) -> bpy.types.Object:
    made = bpy.context.active_object
    if smooth:
        for polygon in made.data.polygons:
            polygon.use_smooth = True
    return made


def sphere() -> bpy.types.Object:
    """Radius 1; the silhouette is off by 0.03 % of the radius at most."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=128, ring_count=64, radius=1)
    return _active()


def box(x: float, y: float, z: float) -> bpy.types.Object:
    """Half sides."""
    bpy.ops.mesh.primitive_cube_add(size=2)
    made = _active(smooth=False)
    made.data.transform(_scaling(x, y, z))
    return made


def _scaling(x: float, y: float, z: float):
    from mathutils import Matrix

    return Matrix.Diagonal((x, y, z, 1))


def cylinder(radius: float, half: float) -> bpy.types.Object:
    """Along x."""
    bpy.ops.mesh.primitive_cylinder_add(vertices=64, radius=radius, depth=2 * half)
    made = _active()
    from mathutils import Matrix

    made.data.transform(Matrix.Rotation(pi / 2, 4, "Y"))
    return made


def revolved(profile: list[tuple[float, float]], segments: int = 96) -> bpy.types.Object:
    """Around y, from (radius, y) points from bottom to top."""
    angles = np.linspace(0, 2 * pi, segments, endpoint=False)
    points = [(r * np.cos(a), y, r * np.sin(a)) for r, y in profile for a in angles]
    faces = [
        (i * segments + j, i * segments + (j + 1) % segments,
         (i + 1) * segments + (j + 1) % segments, (i + 1) * segments + j)
        for i in range(len(profile) - 1)
        for j in range(segments)
    ]  # fmt: skip
    return _mesh(points, faces)


def _mesh(points: list[tuple[float, float, float]], faces: list[tuple[int, ...]]):
    mesh = bpy.data.meshes.new("mesh")
    mesh.from_pydata(points, [], faces)
    mesh.update()
    made = bpy.data.objects.new("object", mesh)
    bpy.context.collection.objects.link(made)
    for polygon in mesh.polygons:
        polygon.use_smooth = True
    return made


def wavy_sheet(rng: np.random.Generator) -> bpy.types.Object:
    """Cloth: a grid whose waves move during the exposure."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=48, y_subdivisions=48, size=2)
    made = _active()
    _deformed(made, *[_waves(rng) for _ in range(2)])
    return made


def _waves(rng: np.random.Generator):
    kx, ky = rng.uniform(1.5, 3.5, 2)
    phase, height = rng.uniform(0, 2 * pi), rng.uniform(0.12, 0.3)

    def at(x: float, y: float, z: float) -> tuple[float, float, float]:
        wave = height * np.sin(kx * x + ky * y + phase)
        return x + 0.5 * wave, y + 0.3 * wave, z + wave

    return at


def drop(rng: np.random.Generator) -> bpy.types.Object:
    """A sphere that stretches along x and gets a tail, with its volume kept."""
    made = sphere()
    first, last = rng.uniform(0.9, 1.05), rng.uniform(1.2, 1.7)
    tail = rng.uniform(0.1, 0.4)

    def stretched(by: float, pull: float):
        def at(x: float, y: float, z: float) -> tuple[float, float, float]:
            thin = (1 - pull * max(-x, 0) ** 1.5) / np.sqrt(by)
            return by * x, thin * y, thin * z

        return at

    _deformed(made, stretched(first, 0), stretched(last, tail))
    return made


def _deformed(made: bpy.types.Object, first, last) -> None:
    """Shape keys from `first` to `last` over the exposure; both map a point to a point."""
    made.shape_key_add(name="Basis")
    for vertex in made.data.shape_keys.key_blocks["Basis"].data:
        vertex.co = first(*vertex.co)
    key = made.shape_key_add(name="last", from_mix=False)
    basis = made.data.vertices
    for vertex, old in zip(key.data, basis, strict=True):
        vertex.co = last(*old.co)
    for frame, value in ((0, 0.0), (1, 1.0)):
        key.value = value
        key.keyframe_insert("value", frame=frame)
    made.cycles.use_deform_motion = True


def joined(parts: list[bpy.types.Object]) -> bpy.types.Object:
    """Several meshes as one object."""
    bpy.ops.object.select_all(action="DESELECT")
    for part in parts:
        part.select_set(True)
    bpy.context.view_layer.objects.active = parts[0]
    bpy.ops.object.join()
    return bpy.context.active_object


def bottle() -> bpy.types.Object:
    """A lathe profile, 2 high."""
    profile = [(0.0, -1.0), (0.33, -1.0), (0.36, -0.95), (0.36, 0.15), (0.3, 0.38), (0.14, 0.55)]
    return revolved([*profile, (0.12, 0.6), (0.12, 0.92), (0.15, 0.94), (0.15, 1.0), (0.0, 1.0)])


def shuttle() -> bpy.types.Object:
    """A cone with a round head, as in badminton."""
    cork = [(0.28 * np.sin(a), -0.75 - 0.28 * np.cos(a)) for a in np.linspace(0, pi / 2, 12)]
    return revolved([*cork, (0.7, 0.95), (0.66, 0.95), (0.24, -0.7)])


def hammer(rng: np.random.Generator) -> bpy.types.Object:
    """A handle along x with a head across."""
    handle = cylinder(0.07, 0.9)
    handle.data.materials.append(matte(paint(rng)))
    head = box(0.16, 0.42, 0.16)
    head.location = (0.9, 0, 0)
    head.data.materials.append(matte((0.35, 0.36, 0.4), 0.4, 0.5))
    bpy.context.view_layer.update()
    for part in (handle, head):
        part.data.transform(part.matrix_world)
        part.matrix_world.identity()
    return joined([handle, head])


def star() -> bpy.types.Object:
    """Five points, thin, in the xy plane."""
    turn = np.arange(10) * pi / 5
    radius = np.where(np.arange(10) % 2, 0.45, 1.0)
    rim = [(r * np.cos(a), r * np.sin(a)) for r, a in zip(radius, turn, strict=True)]
    points = [(x, y, z) for z in (-0.08, 0.08) for x, y in rim]
    sides = [(i, (i + 1) % 10, 10 + (i + 1) % 10, 10 + i) for i in range(10)]
    made = _mesh(points, [tuple(range(9, -1, -1)), tuple(range(10, 20)), *sides])
    for polygon in made.data.polygons:
        polygon.use_smooth = False
    return made


def head(rng: np.random.Generator) -> bpy.types.Object:
    """A modeled head: Blender's monkey, subdivided."""
    bpy.ops.mesh.primitive_monkey_add(size=1.7)
    made = _active()
    subdivision = made.modifiers.new("smooth", "SUBSURF")
    subdivision.levels = subdivision.render_levels = 2
    return made


def painted(made: bpy.types.Object, with_material: bpy.types.Material) -> list[bpy.types.Object]:
    made.data.materials.clear()
    made.data.materials.append(with_material)
    return [made]


def smoke(rng: np.random.Generator) -> list[bpy.types.Object]:
    """An opaque core in a see-through shell."""
    shell = painted(sphere(), see_through(paint(rng), rng.uniform(0.3, 0.6)))
    core = sphere()
    core.data.transform(_scaling(*(3 * (rng.uniform(0.4, 0.65),))))
    core.parent = shell[0]
    return shell + painted(core, matte(paint(rng)))


def _dark(rng: np.random.Generator) -> Color:
    return tuple(rng.uniform(0.015, 0.05) * rng.uniform(0.8, 1.2, 3))


def _ellipsoid(rng: np.random.Generator) -> bpy.types.Object:
    made = sphere()
    made.data.transform(_scaling(1, rng.uniform(0.4, 0.75), rng.uniform(0.4, 1)))
    return made


MAKERS = {
    "matte": lambda rng: painted(sphere(), matte(paint(rng))),
    "white": lambda rng: painted(sphere(), matte((0.8, 0.8, 0.78))),
    "glossy": lambda rng: painted(sphere(), glossy(paint(rng), rng)),
    "stripes": lambda rng: painted(sphere(), patterned(rng, "stripes")),
    "patches": lambda rng: painted(sphere(), patterned(rng, "patches")),
    "dark": lambda rng: painted(sphere(), matte(_dark(rng), 0.5, 0.4)),
    "glowing": lambda rng: painted(sphere(), emitting(paint(rng))),
    "translucent": lambda rng: painted(sphere(), see_through(paint(rng), rng.uniform(0.45, 0.8))),
    "smoke": smoke,
    "ellipsoid": lambda rng: painted(_ellipsoid(rng), matte(paint(rng))),
    "cube": lambda rng: painted(box(0.62, 0.62, 0.62), matte(paint(rng), 0.6, 0.3)),
    "sheet": lambda rng: painted(box(1, rng.uniform(0.5, 1), 0.004), matte(paint(rng))),
    "stick": lambda rng: painted(cylinder(rng.uniform(0.06, 0.15), 1), matte(paint(rng), 0.5, 0.4)),
    "ring": lambda rng: painted(_ring(rng), matte(paint(rng), 0.4, 0.4)),
    "bottle": lambda rng: painted(bottle(), glossy(paint(rng), rng)),
    "shuttle": lambda rng: painted(shuttle(), matte((0.75, 0.74, 0.68))),
    "hammer": lambda rng: [hammer(rng)],
    "star": lambda rng: painted(star(), matte(paint(rng))),
    "head": lambda rng: painted(head(rng), matte(paint(rng, (0.3, 0.6)), 0.6, 0.3)),
    "cloth": lambda rng: painted(wavy_sheet(rng), patterned(rng, "stripes")),
    "plain_cloth": lambda rng: painted(wavy_sheet(rng), matte(paint(rng))),
    "drop": lambda rng: painted(drop(rng), matte(paint(rng), 0.15, 0.5)),
}


def _ring(rng: np.random.Generator) -> bpy.types.Object:
    minor = rng.uniform(0.12, 0.25)
    bpy.ops.mesh.primitive_torus_add(
        major_radius=1 - minor, minor_radius=minor, major_segments=96, minor_segments=32
    )
    return _active()


def make(name: str, seed: int) -> list[bpy.types.Object]:
    """The meshes of an object, radius 1 about the origin; the first is the parent of the others."""
    return MAKERS[name](np.random.default_rng([seed, 11]))
