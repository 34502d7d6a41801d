# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures of maps: each map of a plate with studs, a sheet of heads that show theirs, and what two settings do."""

from collections.abc import Iterator

import bpy
import numpy as np

from scripts import demo
from scripts.dev.manual import faults, models

Picture = tuple[str, np.ndarray]
PLATE_MAPS = ("POSITION", "HEIGHT", "DISPLACEMENT", "DISTANCE", "COVERAGE", "OBJECT_ID", "MATERIAL_ID")
HEAD_MAPS = ("AO", "BENT_NORMAL", "THICKNESS", "CURVATURE", "BASE_COLOR", "ROUGHNESS")
SHEET_SIZE, GALLERY_SIZE, PAIR_SIZE, ASSET_SIZE = (1500, 780), (1920, 1080), (760, 420), (1920, 560)
ASSET_TRIANGLES = 2000
SPACING = 2.9
"""Between the middles of two heads."""
EDGE = 0.4
STONE, MOSS = (0.30, 0.26, 0.22), (0.10, 0.17, 0.035)
DULL, MOIST = 0.85, 0.35
"""Roughness of the moss and of the stone."""


def plate() -> Iterator[Picture]:
    """docs/maps.md: the normal map of a plate with studs, and the maps of its geometry."""
    models.clear()
    models.grid("plate", 200, lambda u, v: (0.9 * (u - 0.5), 0.9 * (v - 0.5), 0.0 * u))
    studs = models.grid("studs", 400, lambda u, v: (0.9 * (u - 0.5), 0.9 * (v - 0.5), models.rivets(u, v) - 0.005))
    studs.data.materials.append(models.material("brass"))
    rows, columns = np.divmod(np.arange(400 * 400), 400)
    is_upper = (rows > 200).astype(np.int32)
    studs.data.polygons.foreach_set("material_index", is_upper)
    models.grid("low", 1, lambda u, v: (u - 0.5, v - 0.5, 0 * u))
    bpy.ops.imprint.bake(
        low="low",
        high=[{"name": "plate"}, {"name": "studs"}],
        method="CAST",
        extrusion=0.2,
        max_distance=0.4,
        width=512,
        height=512,
        samples="4",
        depth="8",
        image="low_normal",
        maps=set(PLATE_MAPS),
    )
    for image in list(bpy.data.images):
        if image.name.startswith("low_"):
            yield f"map-{image.name.removeprefix('low_').lower()}", faults.pixels_of(image)[::2, ::2]
    models.clear()


def heads() -> Iterator[Picture]:
    """README.md, docs/maps.md, docs/extension/: a mossy head of stone, its maps on the low mesh, and all of them on one."""
    models.clear()
    high, low = models.monkeys(levels=4)
    _grow_moss(high)
    _bake(low, high, "head_normal", HEAD_MAPS, connect_maps=True)
    shown = [
        ("High", high),
        *((words, _wearing(low, f"head_{suffix}")) for words, suffix in _NAMES.items()),
        ("Low with the maps", _dressed(low)),
    ]
    low.hide_render = True
    for number, (words, head) in enumerate(shown):
        row, column = divmod(number, 4)
        _place(head, words, ((column - 1.5) * SPACING, 0, 1.55 - 3.0 * row))
    yield "maps", _picture(SHEET_SIZE, 4 * SPACING)
    yield "../extension/gallery-maps.jpg", _picture(GALLERY_SIZE, 4 * SPACING)
    models.clear()


_NAMES = {
    "Normal": "normal",
    "Ambient occlusion": "ao",
    "Bent normal": "bent_normal",
    "Thickness": "thickness",
    "Curvature": "curvature",
    "Base color": "base_color",
}
"""The heads between the first and the last: their words, and the suffixes of their maps."""


def settings() -> Iterator[Picture]:
    """docs/maps.md: ambient occlusion by its distance, and curvature by its radius."""
    for picture, map_name, setting, values in (
        ("ao-distance", "AO", "ao_distance", {"No limit": None, "5 % of the diagonal": 0.05}),
        ("curvature-radius", "CURVATURE", "curvature_radius", {"0.5 %": 0.005, "4 %": 0.04}),
    ):
        models.clear()
        high, low = models.monkeys(levels=4)
        for number, (words, value) in enumerate(values.items()):
            given = {} if value is None else {setting: value}
            _bake(low, high, f"head{number}_normal", (map_name,), **given)
            head = _wearing(low, f"head{number}_{map_name.lower()}")
            _place(head, words, ((number - 0.5) * SPACING, 0, 0.1))
        low.hide_render = high.hide_render = True
        yield picture, _picture(PAIR_SIZE, 2 * SPACING)
    models.clear()


def asset() -> Iterator[Picture]:
    """docs/extension/: the mossy head alone, the low mesh of Make Game Asset, its normal map, and all its maps."""
    models.clear()
    high, given = models.monkeys(levels=4)
    bpy.data.objects.remove(given)
    _grow_moss(high)
    wanted = bpy.context.scene.imprint
    wanted.asset_triangles, wanted.asset_degrees, wanted.width, wanted.height = str(ASSET_TRIANGLES), "", 2048, 2048
    wanted.maps, wanted.connect_maps = {"AO", "BASE_COLOR", "ROUGHNESS"}, True
    high.select_set(True)
    bpy.context.view_layer.objects.active = high
    bpy.ops.imprint.make_asset()
    low = bpy.data.objects["monkey_low"]
    image = next(each.name for each in bpy.data.images if each.name.endswith("_normal"))
    bare = _copy(low, models.material("bare"))
    edges = _copy(low, models.material("edges", models.NIGHT))
    wires = edges.modifiers.new("Wireframe", "WIREFRAME")
    wires.thickness, wires.offset = 0.006, 1.0
    shown = {
        f"Sculpt: {demo.count_triangles(high):,} triangles": [high],
        f"Make Game Asset: {demo.count_triangles(low):,}": [bare, edges],
        "Normal map": [_wearing(low, image)],
        "With all maps": [_dressed(low)],
    }
    low.hide_render = True
    for column, (words, heads) in enumerate(shown.items()):
        for number, head in enumerate(heads):
            _place(head, words if not number else "", ((column - 1.5) * SPACING, 0, 0.2))
    yield "../extension/gallery-asset.jpg", _picture(ASSET_SIZE, 4 * SPACING)
    models.clear()


def _bake(low: bpy.types.Object, high: bpy.types.Object, image: str, maps: tuple[str, ...], **given) -> None:
    """Fill images with 8 bits, of which `image` has the normals."""
    models.bake(low, high, image=image, depth="8", maps=set(maps), **given)


def _grow_moss(high: bpy.types.Object) -> None:
    """A material whose color and roughness come from an attribute: moss where the surface faces up, stone elsewhere."""
    mesh = high.data
    places, normals = (np.empty((len(mesh.vertices), 3), np.float32) for _ in range(2))
    mesh.vertices.foreach_get("co", places.reshape(-1))
    mesh.vertex_normals.foreach_get("vector", normals.reshape(-1))
    waves = np.sin(places @ np.array([[7.0, -3.0, 5.0], [2.0, 9.0, -4.0], [-11.0, 5.0, 13.0]], np.float32).T)
    share = np.clip((normals[:, 2] + 0.25 * waves.mean(axis=1) - 0.15) / 0.3, 0, 1)[:, None]
    colors = np.ones((len(places), 4), np.float32)
    colors[:, :3] = np.array(STONE) * (0.85 + 0.15 * waves[:, :1]) * (1 - share) + np.array(MOSS) * share
    colors[:, 3:] = MOIST + (DULL - MOIST) * share
    mesh.color_attributes.new("Moss", "FLOAT_COLOR", "POINT").data.foreach_set("color", colors.ravel())
    mossy = models.material("mossy")
    tree = mossy.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    attribute = tree.nodes.new("ShaderNodeVertexColor")
    attribute.layer_name = "Moss"
    tree.links.new(attribute.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(attribute.outputs["Alpha"], shader.inputs["Roughness"])
    mesh.materials.clear()
    mesh.materials.append(mossy)


def _copy(low: bpy.types.Object, material: bpy.types.Material) -> bpy.types.Object:
    head = low.copy()
    head.data = low.data.copy()
    head.data.materials.clear()
    head.data.materials.append(material)
    bpy.context.scene.collection.objects.link(head)
    return head


def _wearing(low: bpy.types.Object, name: str) -> bpy.types.Object:
    """A copy of the low mesh that shows the values of the image with this name as they are stored."""
    image = bpy.data.images[name].copy()
    image.colorspace_settings.name = "sRGB"
    worn = models.material(name)
    tree = worn.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = (0, 0, 0, 1)
    shader.inputs["Emission Strength"].default_value = 1.0
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    tree.links.new(texture.outputs["Color"], shader.inputs["Emission Color"])
    return _copy(low, worn)


def _dressed(low: bpy.types.Object) -> bpy.types.Object:
    """A copy of the low mesh with the material into which the bake and Connect Maps have put the maps."""
    return _copy(low, low.data.materials[0])


def _place(head: bpy.types.Object, words: str, place: tuple[float, float, float]) -> None:
    head.location, head.rotation_euler.z = place, -0.35
    models.letter(words, (place[0], -1.5, place[2] - 1.35), 0.24)


def _picture(size: tuple[int, int], width: float) -> np.ndarray:
    models.light_and_camera((0, -14, 0.0))
    camera = bpy.context.scene.camera.data
    camera.type, camera.ortho_scale = "ORTHO", width + EDGE
    models.set_sky("night")
    return models.render(size, 32)
