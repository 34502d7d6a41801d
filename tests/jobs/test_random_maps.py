# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes of all kinds of maps from high meshes with random materials, images and attributes: a map or one sentence.

The seed is in the test's name. For other seeds: IMPRINT_RANDOM=1000:5000 pytest tests/jobs/test_random_maps.py
"""

import random

import bpy
import numpy as np
import pytest

from addon.core import map_types
from addon.core.declarations.all_settings import DECLARED
from addon.core.settings import Settings
from tests.support import outcome, random_cases, scenes, zoo
from tests.support.feeds import write_png
from tests.support.random_nodes import FOLLOWED, OTHERS, SHADERS, grow

pytestmark = pytest.mark.usefixtures("gpu_context")

NAMES = ("rust", "rust.001", 'say "so"', "tab\there", "岩", "{low}", "<UDIM>", "a/b", "é" * 31)
SIZES = ((1, 1), (4, 3), (16, 16), (1, 300), (257, 2))
SPACES = ("sRGB", "Non-Color", "Linear Rec.709", "ACEScg", "AgX Base sRGB", "Filmic sRGB")


outcomes = random_cases.counted(100, map=0.6)


# Images


def generated(source, folder):
    width, height = source.choice(SIZES)
    image = bpy.data.images.new(
        source.choice(NAMES), width, height, alpha=source.random() < 0.5, float_buffer=source.random() < 0.3
    )
    pixels = np.random.default_rng(source.randrange(1000)).uniform(0, 1, width * height * 4).astype(np.float32)
    if image.is_float and source.random() < 0.3:
        pixels[source.randrange(len(pixels))] = source.choice([np.nan, np.inf, -np.inf, 1e30, -4.0])
    image.pixels.foreach_set(pixels)
    if source.random() < 0.5:
        image.pack()
    return image


def from_file(source, folder):
    path = folder / f"page {source.randrange(100)}.png"
    rng = np.random.default_rng(source.randrange(1000))
    width, height = source.choice(SIZES)
    values = rng.integers(0, 256, (height, width, source.choice([3, 4]))).astype(source.choice([np.uint8, np.uint16]))
    write_png(path, values)
    image = bpy.data.images.load(str(path))
    match source.choice(["", "", "packed", "deleted", "broken", "empty", "tiled"]):
        case "packed":
            image.pack()
        case "deleted":
            path.unlink()
        case "broken":
            path.write_bytes(path.read_bytes()[: source.choice([1, 20, 50, -20])])
        case "empty":
            path.write_bytes(b"")
        case "tiled":
            for tile in (1001, 1003):
                write_png(folder / f"{path.stem}.{tile}.png", values)
            image.filepath = str(folder / f"{path.stem}.<UDIM>.png")
            image.source = "TILED"
            image.tiles.new(source.choice([1002, 1003, 1011]))
    return image


def without_pixels(source, folder):
    image = bpy.data.images.new(source.choice(NAMES), 1, 1)
    image.source = source.choice(["FILE", "SEQUENCE", "MOVIE", "TILED"])
    image.filepath = source.choice(["", "//gone.png", "/", "//", str(folder), "//gone.<UDIM>.png"])
    return image


def image(source, folder):
    found = source.choice([generated, generated, from_file, from_file, from_file, without_pixels])(source, folder)
    if source.random() < 0.5:
        found.colorspace_settings.name = source.choice(SPACES)
    found.alpha_mode = source.choice(["STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE"])
    return found


# Materials


def material(source, images):
    if source.random() < 0.1:
        return None
    found = bpy.data.materials.new(source.choice(NAMES))
    tree = found.node_tree
    if source.random() < 0.05:
        tree.nodes.clear()
        return found
    grow(tree, source, FOLLOWED * 3 + ["TexImage"] * 20 + OTHERS + SHADERS, source.randrange(0, 12), images)
    shader = tree.nodes.get("Principled BSDF")
    if source.random() < 0.7:
        pictures = [node.outputs[source.randrange(2)] for node in tree.nodes if node.bl_idname == "ShaderNodeTexImage"]
        for socket in shader.inputs:
            if pictures and socket.type in {"RGBA", "VALUE"} and source.random() < 0.3:
                tree.links.new(source.choice(pictures), socket)
        if pictures and source.random() < 0.5:
            detail = tree.nodes.new(source.choice(["ShaderNodeNormalMap", "ShaderNodeBump"]))
            tree.links.new(
                source.choice(pictures), detail.inputs["Color" if "Normal" in detail.bl_idname else "Height"]
            )
            tree.links.new(detail.outputs[0], shader.inputs["Normal"])
            if hasattr(detail, "uv_map"):
                detail.uv_map = source.choice(["", zoo.LAYER, "gone"])
    else:
        outputs = [output for node in tree.nodes for output in node.outputs]
        for socket in shader.inputs:
            if outputs and source.random() < 0.5:
                tree.links.new(source.choice(outputs), socket)
    return found


# Meshes


def attribute(source, data):
    name = source.choice(["paint", "mass", *NAMES])
    domain = source.choice(["POINT", "EDGE", "FACE", "CORNER"])
    kind = source.choice(
        ["FLOAT", "INT", "BOOLEAN", "FLOAT_VECTOR", "FLOAT_COLOR", "BYTE_COLOR", "INT8", "FLOAT2", "QUATERNION"]
    )
    found = data.attributes.new(name, kind, domain)
    if kind == "FLOAT" and len(found.data):
        values = np.random.default_rng(source.randrange(1000)).normal(size=len(found.data)).astype(np.float32)
        if source.random() < 0.3:
            values[source.randrange(len(values))] = source.choice([np.nan, np.inf, 1e38])
        found.data.foreach_set("value", values)


def high_mesh(source, folder, images, number):
    make = source.choice([zoo.terrain, zoo.plane, zoo.cube, zoo.sphere, zoo.disc])
    found = make(f"high {number}", **({"n": source.choice([1, 4, 12])} if make not in (zoo.cube, zoo.disc) else {}))
    data = found.data
    for place in range(source.randrange(0, 4)):
        shown = material(source, images)
        if shown is not None and source.random() < 0.1:
            shown = scenes.to_library(folder / f"library {10 * number + place}.blend", shown)
        data.materials.append(shown)
    data.polygons.foreach_set("material_index", [source.randrange(0, 5) for _ in data.polygons])
    if data.materials and source.random() < 0.2:
        found.material_slots[0].link = "OBJECT"
    for _ in range(source.randrange(0, 3)):
        attribute(source, data)
    match source.random():
        case x if x < 0.1:
            data.uv_layers.remove(data.uv_layers[0])
        case x if x < 0.2:
            uv = data.uv_layers[0].uv
            spoiled = np.random.default_rng(number).normal(size=2 * len(uv)) * 10.0 ** source.choice([0, 3, 30])
            spoiled[source.randrange(len(spoiled))] = source.choice([0.0, np.nan, np.inf])
            uv.foreach_set("vector", spoiled.astype(np.float32))
    found.location.z = source.choice([0.0, 0.01, 0.5])
    found.scale = [source.choice([1.0, 1.0, 1.0, -1.0, 0.3, 1e-3]) for _ in range(3)]
    return found


def settings_of(source, folder):
    def any_of(name):
        return source.choice(DECLARED[name].values)

    names = tuple(name for name in map_types.NAMES if source.random() < 0.25) or ("BASE_COLOR",)
    storage = source.choice(["PACK", "MEMORY", "FILE"])
    ending, depth = source.choice([(".png", 8), (".png", 16), (".exr", 32), (".tif", 16)])
    return Settings(
        method=any_of("method"),
        space=any_of("space"),
        width=source.choice([16, 33]),
        height=source.choice([16, 40]),
        samples=source.choice([1, 1, 4, 16]),
        rays=source.choice([16, 17, 64]),
        normal=source.random() < 0.8,
        maps=names,
        distance_unit=any_of("distance_unit"),
        ao_distance=source.choice([None, 0.1, 1e-9, 1e9]),
        ao_fade=any_of("ao_fade"),
        floor=source.random() < 0.3,
        two_sided=source.random() < 0.3,
        bias_angle=source.choice([0, 10, 80]),
        thickness_distance=source.choice([None, 0.2, 1e-9, 1e9]),
        curvature_radius=source.choice([None, 0.1, 1e-9, 1e9]),
        attribute=source.choice(["", "paint", "mass", "position", "gone", *NAMES]),
        detail_maps=source.random() < 0.8,
        connect_maps=source.random() < 0.3,
        material=source.random() < 0.5,
        margin=source.choice([0, 3, None]),
        depth=depth if storage == "FILE" else source.choice([8, 16, 32]),
        image=source.choice(["", "map"]),
        storage=storage,
        output=str(folder / "out" / "map") + ending if storage == "FILE" else "",
    )


@random_cases.seeds(200, fast=8)
def test_random_materials_end_in_maps_or_an_error_message(seed, tmp_path, outcomes):
    source = random.Random(seed)
    (tmp_path / "out").mkdir()
    if source.random() < 0.1:
        bpy.ops.wm.set_working_color_space(
            working_space=source.choice(["ACEScg", "Linear Rec.2020"]), convert_colors=False
        )
    if source.random() < 0.2:
        bpy.context.scene.view_settings.view_transform = source.choice(["Standard", "Raw", "AgX"])
    images = [image(source, tmp_path) for _ in range(source.randrange(1, 4))]
    highs = [high_mesh(source, tmp_path, images, number) for number in range(source.choice([1, 1, 2, 3]))]
    low = source.choice([zoo.plane, zoo.cube, zoo.sphere])("low")
    if source.random() < 0.3 and highs[0].data.materials:
        low.data.materials.append(highs[0].data.materials[0])
    bpy.context.view_layer.update()
    result = outcome.of_bake(low, highs, settings_of(source, tmp_path), tmp_path)
    outcomes["message" if isinstance(result, str) else "map"] += 1
    print(result if isinstance(result, str) else result.warnings)
