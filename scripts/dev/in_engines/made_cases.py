# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes small low meshes of the kinds that exports get wrong, bakes them, and exports them."""

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from addon.core.settings import Settings
from addon.export import engine_files, map_pictures
from addon.jobs import Job, bake_all
from scripts.dev.in_engines import chromium, wavy_sheet
from scripts.dev.in_engines.glb_file import Glb
from scripts.dev.in_engines.wavy_sheet import Case
from tests.support import zoo

COLUMNS, ROWS, FINE = 6, 5, 256
TEXELS = 512


def make_all(basis: str) -> list[Case]:
    """All cases, with maps for a basis."""
    makers = (_n_gons, _second_layer, _mirrored, _two_materials, _texture_sets, _udim, _negative_scale, _uneven_scale)
    return [_made(maker, basis) for maker in makers]


def _made(maker, basis: str) -> Case:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    low = _sheet("low", wavy_sheet.coarse, COLUMNS, ROWS)
    high = _sheet("high", wavy_sheet.height, FINE, FINE)
    for side in wavy_sheet.SIDES:
        material = bpy.data.materials.new(f"high {side.name}")
        inputs = material.node_tree.nodes["Principled BSDF"].inputs
        inputs["Base Color"].default_value = *side.color, 1.0
        inputs["Roughness"].default_value, inputs["Metallic"].default_value = side.roughness, side.metallic
        high.data.materials.append(material)
    _by_side(high)
    case, changed = maker(low, high)
    size = {"width": TEXELS, "height": TEXELS, "samples": 4}
    stored = {"storage": "PACK", "depth": 16, "material": False, "maps": ("BASE_COLOR",)}
    settings = Settings(method="FLATTEN", space="TANGENT", basis=basis, **{**size, **stored, **changed})
    reports = bake_all(bpy.context, [Job(low, [high])], settings)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "low.glb"
        engine_files.export(bpy.context, [reports], path)
        glb = Glb.read(path)
        surfaces = _surfaces(glb, Path(folder)) if chromium.SURFACE in case.outputs else []
    return replace(case, glb=glb, surfaces=surfaces)


def _sheet(name: str, heights, columns: int, rows: int) -> bpy.types.Object:
    def points(u, v):
        x, y = 2.0 * u - 1.0, 2.0 * v - 1.0
        return np.stack([x, -heights(x, y), y], axis=1)

    return zoo.sheet(name, points, columns, rows)


def _corners(obj: bpy.types.Object) -> np.ndarray:
    """x and y of each corner (C, 2), as `wavy_sheet` has them."""
    data = obj.data
    points = np.array([vertex.co for vertex in data.vertices])
    return points[[loop.vertex_index for loop in data.loops]][:, [0, 2]]


def _by_side(obj: bpy.types.Object) -> None:
    """Give the faces with x above 0 the second material."""
    for face in obj.data.polygons:
        face.material_index = int(face.center.x > 0.0)


def _lay_out(objects: Sequence[bpy.types.Object], uv_of) -> None:
    for obj in objects:
        uv = np.stack(uv_of(*_corners(obj).T), axis=1).astype(np.float32)
        obj.data.uv_layers[zoo.LAYER].uv.foreach_set("vector", uv.ravel())


def _n_gons(low, _high):
    """The quads in the rows 1 and 3 become hexagons, two by two."""
    edit = bmesh.new()
    edit.from_mesh(low.data)
    edit.verts.ensure_lookup_table()
    lines = [edit.verts[row * (COLUMNS + 1) :][: COLUMNS + 1] for row in range(ROWS + 1)]
    for row, line in enumerate(lines[1:-1], 1):
        for vertex in line[1::2]:  # no three corners on a line
            vertex.co.z += (0.2 if row % 2 == 0 else -0.2) * 2.0 / ROWS
            vertex.co.y = -wavy_sheet.coarse(vertex.co.x, vertex.co.z)
    inner = [
        edit.edges.get(pair) for row in (1, 3) for pair in zip(lines[row][1::2], lines[row + 1][1::2], strict=True)
    ]
    bmesh.ops.dissolve_edges(edit, edges=inner, use_verts=False)
    edit.to_mesh(low.data)
    edit.free()
    _lay_out([low], lambda x, y: ((x + 1.0) / 2.0, (y + 1.0) / 2.0))
    return Case("N-gons"), {}


def _second_layer(low, _high):
    """The map is for the second layer. The active one is turned by a quarter."""
    first = low.data.uv_layers[0]
    uv = np.empty(2 * len(first.uv), np.float32)
    first.uv.foreach_get("vector", uv)
    first.name = "other"
    low.data.uv_layers.new(name=zoo.LAYER).uv.foreach_set("vector", uv)
    turned = np.stack([1.0 - uv[1::2], uv[0::2]], axis=1)
    low.data.uv_layers["other"].uv.foreach_set("vector", turned.ravel())
    low.data.uv_layers.active = low.data.uv_layers["other"]
    return Case("Second UV layer"), {"uv_layer": zoo.LAYER}


def _mirrored(low, high):
    """Mirror modifiers lay the left halves onto the right ones."""
    _lay_out([low, high], lambda x, y: (np.abs(x), (y + 1.0) / 2.0))
    for obj in (low, high):
        edit = bmesh.new()
        edit.from_mesh(obj.data)
        bmesh.ops.delete(edit, geom=[vertex for vertex in edit.verts if vertex.co.x < -1e-6], context="VERTS")
        edit.to_mesh(obj.data)
        edit.free()
        obj.modifiers.new("Mirror", "MIRROR")
    return Case("Mirrored halves", has_sides=False), {}


def _two_materials(low, _high):
    for side in wavy_sheet.SIDES:
        low.data.materials.append(bpy.data.materials.new(side.name))
    _by_side(low)
    return Case("Two materials"), {}


def _texture_sets(low, high):
    """Each material has a map of its own, and its occlusion, roughness and metallic are in one image."""
    case, _ = _two_materials(low, high)
    settings = {"texture_sets": True, "pack": "GLTF", "maps": ("BASE_COLOR", "AO", "ROUGHNESS", "METALLIC"), "rays": 64}
    return replace(case, name="Texture sets with ORM", outputs=chromium.OUTPUTS), settings


def _udim(low, high):
    _lay_out([low, high], lambda x, y: (x + 1.0, (y + 1.0) / 2.0))
    return Case("Two UDIM tiles"), {"udim": True}


def _negative_scale(low, high):
    return _scaled("Negative scale", (-1.0, 1.0, 1.0), low, high)


def _uneven_scale(low, high):
    return _scaled("Uneven scale", (1.5, 0.7, 1.0), low, high)


def _scaled(name: str, scale: tuple[float, float, float], *objects: bpy.types.Object):
    """The objects stay where they are in the scene, and have a scale."""
    for obj in objects:
        obj.scale = scale
        obj.data.transform(Matrix.Diagonal((*(1.0 / part for part in scale), 1.0)))
        if np.prod(scale) < 0.0:
            obj.data.flip_normals()
    return Case(name), {}


def _surfaces(glb: Glb, folder: Path) -> list[np.ndarray]:
    """The texels (H, W, 4) of occlusion, roughness and metallic of each part, bottom row first."""
    found = []
    for part in glb.document["meshes"][0]["primitives"]:
        material = glb.document["materials"][part["material"]]
        texture = material["occlusionTexture"]["index"]
        if material["pbrMetallicRoughness"]["metallicRoughnessTexture"]["index"] != texture:
            raise ValueError("occlusion, roughness and metallic are not in one image")
        path = folder / "orm.png"
        path.write_bytes(glb.image(glb.document["textures"][texture]["source"]))
        with map_pictures.loaded(path) as image:
            found.append(map_pictures.pixels(image))
    return found
