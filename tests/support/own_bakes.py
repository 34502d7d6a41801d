"""Bakes an object with one material onto itself, and compares its maps with what Cycles bakes of it."""

from dataclasses import dataclass

import bmesh
import bpy
import numpy as np

from tests.support import cycles, maps
from tests.support.shader_nodes import add, principled

MAPS = {
    "Base Color": "BASE_COLOR",
    "Roughness": "ROUGHNESS",
    "Metallic": "METALLIC",
    "Emission Color": "EMISSION",
    "Alpha": "ALPHA",
}
IN_COLOR = {"Base Color", "Emission Color"}
NEAR = 0.01
"""Texels that look otherwise when the UVs move so far, in texels, are on the edge of a pattern or of a triangle: they do not
count, since the place at which a texel is looked at decides."""
JUMP = 2 / 255
MOVES = ((0.0, 0.0), (NEAR, 0.0), (-NEAR, 0.0), (0.0, NEAR), (0.0, -NEAR))


@dataclass(frozen=True)
class Difference:
    """Of a map from what Cycles bakes, in steps of what a file with 8 bits stores.

    Attributes:
        mean, worst: Of the largest channel of each texel.
        jumps: The share of the texels that are on edges, which do not count.
    """

    mean: float
    worst: float
    jumps: float


def head(name, make):
    """A monkey's head with a material that `make` has changed, and what that returned."""
    bpy.ops.mesh.primitive_monkey_add()
    obj = bpy.context.object
    data = obj.data
    triangles = bmesh.new()  # Cycles has the tangents of triangles, also where a mesh has quads
    triangles.from_mesh(data)
    bmesh.ops.triangulate(triangles, faces=triangles.faces[:])
    triangles.to_mesh(data)
    triangles.free()
    obj.location, obj.rotation_euler, obj.scale = (3.0, -1.0, 2.0), (0.3, 0.5, 0.1), (0.8, 0.8, 0.8)
    obj.color = (0.2, 0.5, 0.9, 1.0)
    data.shade_smooth()
    source = np.random.default_rng(3)
    uv = np.empty(2 * len(data.loops), np.float32)
    data.uv_layers[0].uv.foreach_get("vector", uv)
    data.uv_layers.new(name="second").uv.foreach_set("vector", (uv.reshape(-1, 2)[:, ::-1] * 2.0).ravel())
    data.uv_layers.active_index = 0
    paint = data.color_attributes.new("paint", "FLOAT_COLOR", "POINT")
    paint.data.foreach_set("color", source.uniform(0.2, 1.0, 4 * len(data.vertices)).astype(np.float32))
    number = data.attributes.new("number", "FLOAT", "FACE")
    number.data.foreach_set("value", source.uniform(0.0, 1.0, len(data.polygons)).astype(np.float32))
    material = bpy.data.materials.new(name)
    data.materials.append(material)
    principled(material).inputs["Specular IOR Level"].default_value = 0.0  # see material_setups._shader
    truth = make(material)
    bpy.context.view_layer.update()
    return obj, truth


def compare(name, make, size):
    """The differences by input, and the report of the bake. make: as in material_setups.SETUPS."""
    obj, truth = head(name, make)
    asked = [MAPS[socket] for socket in truth if socket in MAPS]
    shows_normals = "Normal" in truth
    report, found = maps.bake_all_maps(obj, obj, maps=asked, size=size, normal=shows_normals, space="OBJECT")
    if shows_normals:
        found["normal"] = maps.pixels(bpy.data.images["map"])
    bakes = _Bakes(obj, size)
    # Where smooth normals point behind their face, Cycles bakes the back of the surface, which no render sees.
    is_back = add(obj.data.materials[0], "NewGeometry").outputs["Backfacing"]
    behind = np.any([bakes.of("Backfacing", is_back, move)[0][..., 0] > 0.5 for move in MOVES], axis=0)
    known = ~cycles.shared(obj, size) & ~behind
    differences = {}
    for socket, output in truth.items():
        mine = found[MAPS.get(socket, socket).lower()]
        theirs = [bakes.of(socket, output, move) for move in MOVES]
        written = known & (mine[..., 3] > 0.5) & np.all([mask for _, mask in theirs], axis=0)
        looks = np.stack([_stored(texels, socket) for texels, _ in theirs])
        jumps = (np.ptp(looks, axis=0) > JUMP).any(axis=-1)
        apart = np.abs(_stored(mine, socket) - looks[0]).max(axis=-1)[written & ~jumps] * 255.0
        differences[socket] = Difference(float(apart.mean()), float(apart.max()), float(jumps[written].mean()))
    return differences, report


def _stored(values, socket):
    """Values as files store them: numbers from 0 to 1, colors as sRGB."""
    values = np.clip(values[..., :3], 0.0, 1.0)
    if socket in IN_COLOR:
        return np.where(values <= 0.0031308, values * 12.92, 1.055 * values ** (1 / 2.4) - 0.055)
    return values


class _Bakes:
    """What Cycles bakes of an object with one material."""

    def __init__(self, obj, size):
        self.obj, self.size = obj, size

    def of(self, socket, output, move=(0.0, 0.0)):
        """An input, as cycles.bake has it. move: of the UVs, in texels."""
        layers, material = self.obj.data.uv_layers, self.obj.data.materials[0]
        uv = np.empty((len(layers[0].uv), 2), np.float32)
        layers[0].uv.foreach_get("vector", uv.ravel())
        layers.new(name="moved").uv.foreach_set("vector", (uv + np.array(move) / self.size).astype(np.float32).ravel())
        layers.active, layers[0].active_render = layers["moved"], True
        if socket == "Normal":
            if output is not None:
                diffuse = add(material, "BsdfDiffuse", {"Normal": output}).outputs[0]
                surface = material.node_tree.get_output_node("CYCLES").inputs["Surface"]
                material.node_tree.links.new(diffuse, surface)
            found = cycles.bake_normals(self.obj, self.size, space="OBJECT")
        else:
            if not isinstance(output, bpy.types.NodeSocket):
                color = (output,) * 3 + (1.0,) if isinstance(output, float) else output
                node = add(material, "RGB")
                node.outputs[0].default_value, output = color, node.outputs[0]
            found = cycles.bake_colors(self.obj, self.size, {material: output}, highs=())
        layers.remove(layers["moved"])
        layers.active = layers[0]
        return found
