# SPDX-License-Identifier: GPL-3.0-or-later
"""Random objects and settings, mostly unusual: each bake ends in a map or in a one-sentence error message.

The seed is in the test's name. For other seeds: IMPRINT_RANDOM=1000:5000 pytest tests/jobs/test_random.py
"""

import random
from functools import partial

import bpy
import numpy as np
import pytest

from addon.core import file_formats, map_types
from addon.core.declarations.all_settings import DECLARED
from addon.core.settings import Settings
from tests.support import layered_scenes, outcome, random_cases, scenes, zoo
from tests.support.feeds import write_png
from tests.support.random_cases import pick
from tests.support.random_nodes import FOLLOWED, OTHERS, SHADERS, grow
from tests.support.scenes import link

pytestmark = pytest.mark.usefixtures("gpu_context")


GROUP = "painted"
NAMES = (
    *("rock", "Rock.001", ".hidden", "a b  c", "it's", 'say "so"', "tab\there", "ends."),
    *("{low}", "<UDIM>", "a/b", "C:\\x", "//", "..", "%s %d", "{", "CON", "a" * 63, "é" * 31),
    *("岩", "\U0001f5ff\U0001f30b", "صخرة", "\u202eabc", "a\u0301", "\u00a0", "ﬀ", "\u2028"),
)


outcomes = random_cases.counted(160, map=0.3)


# Meshes


def grid(rng):
    nu, nv = rng.integers(1, 9, 2)
    uv = zoo.grid_uv(nu, nv)
    return np.column_stack([2 * uv - 1, rng.normal(0, 0.05, len(uv))]), zoo.grid_faces(nu, nv).tolist()


def soup(rng):
    points = rng.uniform(-1, 1, (rng.integers(8, 40), 3))
    sides = rng.integers(3, 9, rng.integers(1, 30))
    return points, [rng.choice(len(points), size, replace=False).tolist() for size in sides]


def ball(rng):
    nu, nv = 12, 6
    u, v = zoo.grid_uv(nu, nv).T
    longitude, latitude = 2 * np.pi * u, 1.4 * (2 * v - 1)
    points = np.stack([np.cos(longitude) * np.cos(latitude), np.sin(longitude) * np.cos(latitude), np.sin(latitude)])
    return points.T * rng.uniform(0.9, 1.1), zoo.grid_faces(nu, nv).tolist()


def fan(rng):
    angle = np.linspace(0, 2 * np.pi, rng.integers(3, 60), endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle), 0.1 * np.sin(3 * angle)], axis=1), [list(range(len(angle)))]


def parts(rng):
    """Loose parts, one of them far away, and vertices and edges without faces."""
    points, faces = grid(rng)
    count = len(points)
    moved = [points, points * 0.5 + rng.normal(0, 1, 3), points * 1e-3 + (50, 0, 0), rng.normal(0, 9, (3, 3))]
    return np.concatenate(moved), [[i + k * count for i in face] for k in range(3) for face in faces]


def doubled(rng):
    """Duplicate vertices and duplicate faces."""
    points, faces = grid(rng)
    count = len(points)
    return np.concatenate([points, points]), faces + [[i + count for i in face][::-1] for face in faces] + faces[:1]


SHAPES = {
    grid: 10,
    ball: 4,
    soup: 3,
    fan: 1,
    parts: 2,
    doubled: 1,
    (lambda rng: (np.zeros((0, 3)), [])): 0.3,
    (lambda rng: (rng.normal(size=(5, 3)), [])): 0.3,
}


def to_few_rows(change):
    """A function that applies `change` only to a few rows."""

    def spoil(rng, values):
        rows = rng.random(len(values)) < rng.choice([0.05, 0.5])
        values[rows] = change(rng, values[rows])
        return values

    return spoil


def one_number(value):
    def spoil(rng, values):
        values[..., rng.integers(values.shape[-1])] = value
        return values

    return spoil


COORDINATES = {
    "plain": (lambda rng, p: p, 80),
    "scaled": (lambda rng, p: p * 10.0 ** rng.choice([-30, -12, -6, -4, 3, 6, 8, 12, 20, 30, 38]), 6),
    "far away": (lambda rng, p: p + 10.0 ** rng.choice([3, 7, 12, 30]), 3),
    "some far away": (to_few_rows(lambda rng, p: p * 10.0 ** rng.choice([3, 12, 30, 38])), 2),
    "some not finite": (to_few_rows(one_number(np.nan)), 2),
    "some infinite": (to_few_rows(one_number(-np.inf)), 2),
    "none finite": (one_number(np.nan), 0.5),
    "in a point": (lambda rng, p: p * 0 + 0.25, 0.5),
    "on a line": (lambda rng, p: p * (0, 1, 0), 0.5),
    "flat": (lambda rng, p: p * (1, 1, 0), 2),
    "some in a point": (to_few_rows(lambda rng, p: p * 0), 2),
    "denormal": (lambda rng, p: p * 1e-42, 0.5),
}
UVS = {
    "plain": (lambda rng, uv: uv, 40),
    "scattered": (lambda rng, uv: rng.random(uv.shape), 3),
    "scaled": (lambda rng, uv: uv * 10.0 ** rng.choice([-30, -9, -4, 1, 6, 12, 30, 38]), 4),
    "outside": (lambda rng, uv: uv + rng.integers(-2, 3, 2), 3),
    "across": (lambda rng, uv: uv * 2 - rng.random(2), 3),
    "mirrored": (lambda rng, uv: uv * (-1, 1) + (1, 0), 2),
    "in a point": (lambda rng, uv: uv * 0 + 0.5, 1),
    "on a line": (lambda rng, uv: uv * (0, 1) + (0.5, 0), 1),
    "some not finite": (to_few_rows(one_number(np.nan)), 2),
    "some infinite": (to_few_rows(one_number(np.inf)), 2),
    "none finite": (one_number(np.nan), 0.5),
    "some huge": (to_few_rows(lambda rng, uv: uv * 10.0 ** rng.choice([3, 12, 38])), 2),
    "none": (None, 1.5),
}


def mesh(rng, name):
    points, faces = pick(rng, SHAPES)(rng)
    flat = points[:, :2] * 0.5 + 0.5
    if len(points) == 91:  # the ball, unwrapped as a belt
        flat = zoo.grid_uv(12, 6)
    data = bpy.data.meshes.new(name)
    with np.errstate(over="ignore", invalid="ignore"):
        points = COORDINATES[pick(rng, COORDINATES)][0](rng, points.astype(np.float64)).astype(np.float32)
        data.from_pydata([(0.0, 0.0, 0.0)] * len(points), [(0, 1)] if not faces and len(points) > 3 else [], faces)
        if len(points):
            data.attributes["position"].data.foreach_set("vector", points.ravel())
        data.update()
        data.polygons.foreach_set("use_smooth", rng.random(len(data.polygons)) < rng.choice([0.0, 1.0, 0.5]))
        corners = np.array([i for face in faces for i in face], int)
        for number in range(rng.choice([1, 1, 1, 2, 8])):
            lay = UVS[pick(rng, UVS)][0]
            if lay is not None and len(corners):
                # Blender's BMesh loses memory if two names are too long for the prefix of their pins. This is its bug.
                short = str(rng.choice(NAMES)).encode()[:50].decode(errors="ignore")
                layer = data.uv_layers.new(name=short if number else zoo.LAYER)
                layer.uv.foreach_set("vector", lay(rng, flat[corners].copy()).astype(np.float32).ravel())
    if data.uv_layers and rng.random() < 0.2:
        data.uv_layers[-1].active_render = True
        data.uv_layers.active = data.uv_layers[0]
    return data


# Objects


def chain(rng, obj):
    """Parents with rotations and uneven scales, so that the matrix shears."""
    for number in range(rng.integers(1, 4)):
        parent = link(bpy.data.objects.new(f"parent {number}", None))
        parent.rotation_euler, parent.scale = rng.normal(0, 1, 3), rng.uniform(0.3, 2, 3) * rng.choice([-1, 1], 3)
        obj.parent, obj = parent, parent


MATRICES = {
    "plain": (lambda rng, obj: None, 20),
    "moved": (
        lambda rng, obj: setattr(obj, "location", rng.normal(0, 1, 3) * 10.0 ** rng.choice([-1, 0, 4, 20])),
        2,
    ),
    "turned": (lambda rng, obj: setattr(obj, "rotation_euler", rng.normal(0, 3, 3)), 2),
    "scaled": (lambda rng, obj: setattr(obj, "scale", 10.0 ** rng.uniform(-2, 2, 3)), 2),
    "mirrored": (lambda rng, obj: setattr(obj, "scale", rng.choice([-1, 1], 3)), 2),
    "huge or tiny": (lambda rng, obj: setattr(obj, "scale", [10.0 ** rng.choice([-38, -20, -9, 8, 20, 38])] * 3), 1),
    "flattened": (lambda rng, obj: setattr(obj, "scale", rng.integers(0, 2, 3)), 0.5),
    "not finite": (lambda rng, obj: setattr(obj, "location", (0, rng.choice([np.nan, np.inf]), 0)), 0.3),
    "in a chain": (chain, 3),
}


MODIFIERS_MADE = {
    "SUBSURF": lambda rng, m: (setattr(m, "levels", 0), setattr(m, "render_levels", int(rng.integers(0, 3)))),
    "MIRROR": lambda rng, m: setattr(m, "use_axis", (rng.random(3) < 0.5).tolist()),
    "ARRAY": lambda rng, m: setattr(m, "count", int(rng.integers(1, 4))),
    "DISPLACE": lambda rng, m: setattr(m, "strength", rng.choice([0.1, 0.1, 1e20, np.nan])),
    # "Beauty", the default, never ends on coordinates of 1e20. This is a bug of Blender.
    "TRIANGULATE": lambda rng, m: (setattr(m, "quad_method", "FIXED"), setattr(m, "ngon_method", "CLIP")),
    "SOLIDIFY": lambda rng, m: setattr(m, "thickness", rng.normal()),
    "EDGE_SPLIT": lambda rng, m: None,
    "WELD": lambda rng, m: setattr(m, "merge_threshold", rng.choice([0.0, 0.5, 100.0])),
    "SHRINKWRAP": lambda rng, m: None,
    "MULTIRES": lambda rng, m: None,
    # These often leave no face.
    "NODES": lambda rng, m: setattr(m, "node_group", geometry_nodes(rng)),
    "MASK": lambda rng, m: None,
    "DECIMATE": lambda rng, m: setattr(m, "ratio", rng.choice([0.0, 0.5, 1.0])),
}


def geometry_nodes(rng):
    """A node group with no output geometry, or with a new mesh without UVs."""
    tree = bpy.data.node_groups.new("Other geometry", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    output = tree.nodes.new("NodeGroupOutput")
    kind = rng.choice(["", "GeometryNodeMeshCube", "GeometryNodeMeshLine", "GeometryNodeCurvePrimitiveCircle"])
    if kind:
        tree.links.new(tree.nodes.new(kind).outputs[0], output.inputs[0])
    return tree


def add_modifiers(rng, obj):
    for _ in range(rng.integers(1, 3)):
        kind = str(rng.choice(list(MODIFIERS_MADE)[: None if rng.random() < 0.2 else -3]))
        modifier = obj.modifiers.new(kind, kind)
        MODIFIERS_MADE[kind](rng, modifier)
        modifier.show_viewport, modifier.show_render = (rng.random(2) < 0.8).tolist()


def add_shape_keys(rng, obj):
    if obj.data.shape_keys is None and len(obj.data.vertices):
        obj.shape_key_add(name="Basis")
        key = obj.shape_key_add(name=str(rng.choice(NAMES)))
        values = rng.normal(0, 0.1, (len(obj.data.vertices), 3)) * rng.choice([0.0, 1.0, 1.0, 1e30])
        key.points.foreach_set("co", values.astype(np.float32).ravel())
        key.value = rng.random()


def add_materials(rng, obj):
    for _ in range(rng.integers(1, 4)):
        shared = bpy.data.materials.get("Shared") or bpy.data.materials.new("Shared")
        obj.data.materials.append(rng.choice([None, shared, bpy.data.materials.new(str(rng.choice(NAMES)))]))
    obj.data.polygons.foreach_set("material_index", rng.integers(0, 9, len(obj.data.polygons)).astype(np.int32))
    if rng.random() < 0.3:
        obj.material_slots[0].link = "OBJECT"


def hide(rng, obj):
    match rng.choice(
        ["eye", "viewport", "render", "collection", "excluded", "nowhere"], p=[0.4, 0.4, 0.1, 0.03, 0.04, 0.03]
    ):
        case "eye":
            obj.hide_set(True)
        case "viewport":
            obj.hide_viewport = True
        case "render":
            obj.hide_render = True
        case "nowhere":
            bpy.context.scene.collection.objects.unlink(obj)
        case where:
            collection = bpy.data.collections.new("Shelf")
            bpy.context.scene.collection.children.link(collection)
            bpy.context.scene.collection.objects.unlink(obj)
            collection.objects.link(obj)
            setattr(
                bpy.context.view_layer.layer_collection.children[-1],
                {"collection": "hide_viewport"}.get(where, "exclude"),
                True,
            )


def enter_mode(rng, obj):
    if any(other.mode == "EDIT" and other.data == obj.data for other in bpy.data.objects):
        return  # Blender itself crashes
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.ops.object.mode_set(mode=str(rng.choice(["EDIT", "SCULPT", "WEIGHT_PAINT", "TEXTURE_PAINT"])))


def make_object(rng):
    name = str(rng.choice(NAMES))
    if rng.random() < 0.02:
        data = rng.choice([None, bpy.data.lights.new(name, "SUN"), bpy.data.curves.new(name, "CURVE")])
        return link(bpy.data.objects.new(name, data))
    others = [obj for obj in bpy.data.objects if obj.type == "MESH"]
    data = others[0].data if others and rng.random() < 0.05 else mesh(rng, name)
    obj = link(bpy.data.objects.new(name, data))
    for chance, change in ((0.2, add_modifiers), (0.1, add_shape_keys), (0.3, add_materials), (0.9, paint)):
        if rng.random() < chance and is_local(data):
            change(rng, obj)
    MATRICES[pick(rng, MATRICES)][0](rng, obj)
    return obj


def paint(rng, obj):
    """A vertex group with weights from 0 to 1 on some of the vertices."""
    group = obj.vertex_groups.new(name=GROUP)
    for vertex in np.flatnonzero(rng.random(len(obj.data.vertices)) < 0.3).tolist():
        group.add([vertex], rng.random(), "REPLACE")


def is_local(datablock):
    return not (datablock.library or datablock.override_library)


def place(rng, obj):
    """Set the transform of an object and its mode. The mode comes last."""
    if obj.mode == "OBJECT" and rng.random() < 0.1 and obj.type == "MESH" and is_local(obj.data):
        enter_mode(rng, obj)
    if rng.random() < 0.1:
        hide(rng, obj)


def make_cage(rng, low):
    match rng.choice(["copy", "same", "other"]):
        case "same":
            return low
        case "other":
            return make_object(rng)
        case _:
            cage = low.copy()
            if low.type == "MESH":
                cage.data = low.data.copy()
                cage.scale = np.array(low.scale) * 1.2
            return link(cage)


def from_library(rng, obj, folder):
    """Replace the object by one that is linked from a file, perhaps with an override."""
    linked = link(scenes.to_library(folder / "library.blend", obj))
    if rng.random() < 0.5:
        override = linked.override_create()  # of an object in the scene: Blender 5.3 makes none of others
        bpy.context.scene.collection.objects.unlink(linked)
        linked = link(override)
        if linked.data and rng.random() < 0.5:
            linked.data.override_create()
    return linked


def make_settings(rng, folder, low):
    any_of = partial(random_cases.any_of, rng)
    udim = rng.random() < 0.1
    storage = any_of(("PACK", "FILE") if udim else ("PACK", "MEMORY", "FILE"))
    ending = any_of((*file_formats.BY_ENDING, ".PNG"))
    name = any_of(("{low}", "map", "a.b", "{low} map")) + any_of(("", " <UDIM>")) * udim
    step = 4 if storage == "FILE" and file_formats.BY_ENDING[ending.lower()].is_blocks else 1
    axes, known = rng.permutation(3), DECLARED["red"].values
    return Settings(
        method=any_of(DECLARED["method"].values),
        space=any_of(DECLARED["space"].values),
        basis=any_of(DECLARED["basis"].values),
        uv_layer="" if rng.random() < 0.9 else any_of((zoo.LAYER, zoo.LAYER, any_of(NAMES))),
        width=any_of((16, 32, 33, 48, 64)) // step * step,
        height=any_of((16, 32, 47, 64)) // step * step,
        samples=any_of((1, 1, 1, 2, 4, 8)),
        extrusion=None if rng.random() < 0.8 else any_of((0.0, 0.1, 0.1, 1e30)),
        max_distance=None if rng.random() < 0.8 else any_of((0.5, 0.5, 0.5, 1e30)),
        directions=any_of(DECLARED["directions"].values),
        facing_only=rng.random() < 0.3,
        missed=any_of(((0.5, 0.5, 1.0), (1.0, 0.0, 1.0))),
        mask=rng.random() < 0.2,
        maps=tuple(name for name in map_types.NAMES if rng.random() < 0.3) if rng.random() < 0.1 else (),
        red=known[2 * axes[0] + rng.integers(2)],
        green=known[2 * axes[1] + rng.integers(2)],
        blue=known[2 * axes[2] + rng.integers(2)],
        margin=any_of((0, 16, None, 3)),
        margin_type=any_of(DECLARED["margin_type"].values),
        udim=udim,
        tiles=any_of(((), (1001,), (1001, 1002), (2000,))) if udim else (),
        limit=any_of((None, None, 0.1)),
        depth=any_of(
            file_formats.BY_ENDING[ending.lower()].depths
            if storage == "FILE" and rng.random() < 0.95
            else sorted({depth for found in file_formats.FORMATS for depth in found.depths})
        ),
        dither=rng.random() < 0.2,
        modifiers=any_of(DECLARED["modifiers"].values),
        image=any_of(("", "", "map", "{low}", "of {low}", *NAMES)),
        storage=storage,
        output=str(folder / "out" / name) + ending if storage == "FILE" else "",
        material=rng.random() < 0.7,
        single_user=rng.random() < 0.3,
        hit=any_of(DECLARED["hit"].values),
        offset_group=any_of(("", "", "", "", "", GROUP)),
        straight_group=any_of(("", "", "", "", "", GROUP)),
    )


def existing_image(rng, name):
    """An image that already has the map's name."""
    image = bpy.data.images.new(name, 7, 5, alpha=rng.random() < 0.5, float_buffer=rng.random() < 0.5)
    image.source = str(rng.choice(["GENERATED", "GENERATED", "GENERATED", "FILE", "TILED", "MOVIE"]))


# The test


@random_cases.seeds(160, fast=2)
def test_a_random_bake_ends_in_a_map_or_an_error_message(seed, tmp_path, outcomes):
    rng = np.random.default_rng(seed)
    (tmp_path / "out").mkdir()
    low = make_object(rng)
    highs = [make_object(rng) for _ in range(rng.choice([1, 1, 1, 2, 3]))]
    if rng.random() < 0.03:
        low = from_library(rng, low, tmp_path)
    if rng.random() < 0.03:
        highs[0] = from_library(rng, highs[0], tmp_path)
    if rng.random() < 0.08:
        highs = [low]
        if low.type == "MESH" and low.is_editable and rng.random() < 0.9:
            low.modifiers.new("Detail", "SUBSURF")
    cage = make_cage(rng, low) if rng.random() < 0.08 else None
    bpy.context.view_layer.update()  # Blender does not update hidden objects
    for obj in bpy.context.scene.objects.values():
        place(rng, obj)
    settings = make_settings(rng, tmp_path, low)
    if rng.random() < 0.06:
        existing_image(rng, settings.storing.image.replace("{low}", low.name) or f"{low.name}_normal")
    result = outcome.of_bake(low, highs, settings, tmp_path, cage)
    outcomes["message" if isinstance(result, str) else "map"] += 1


# Random layers


outcomes_of_layers = random_cases.counted(20, map=0.8)


@random_cases.seeds(100, fast=2)
def test_random_layers_end_in_a_map_or_an_error_message(seed, tmp_path, outcomes_of_layers):
    result = outcome.of_bake(*layered_scenes.make(seed), tmp_path)
    outcomes_of_layers["message" if isinstance(result, str) else "map"] += 1
    print(result if isinstance(result, str) else result.warnings)


# Random maps


MAP_NAMES = ("rust", "rust.001", 'say "so"', "tab\there", "岩", "{low}", "<UDIM>", "a/b", "é" * 31)
SIZES = ((1, 1), (4, 3), (16, 16), (1, 300), (257, 2))
SPACES = ("sRGB", "Non-Color", "Linear Rec.709", "ACEScg", "AgX Base sRGB", "Filmic sRGB")


outcomes_of_maps = random_cases.counted(60, map=0.6)


# Images


def generated(source, folder):
    width, height = source.choice(SIZES)
    image = bpy.data.images.new(
        source.choice(MAP_NAMES), width, height, alpha=source.random() < 0.5, float_buffer=source.random() < 0.3
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
    image = bpy.data.images.new(source.choice(MAP_NAMES), 1, 1)
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
    found = bpy.data.materials.new(source.choice(MAP_NAMES))
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
    name = source.choice(["paint", "mass", *MAP_NAMES])
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
        attribute=source.choice(["", "paint", "mass", "position", "gone", *MAP_NAMES]),
        detail_maps=source.random() < 0.8,
        connect_maps=source.random() < 0.3,
        material=source.random() < 0.5,
        margin=source.choice([0, 3, None]),
        depth=depth if storage == "FILE" else source.choice([8, 16, 32]),
        image=source.choice(["", "map"]),
        storage=storage,
        output=str(folder / "out" / "map") + ending if storage == "FILE" else "",
    )


@random_cases.seeds(60, fast=2)
def test_random_materials_end_in_maps_or_an_error_message(seed, tmp_path, outcomes_of_maps):
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
    outcomes_of_maps["message" if isinstance(result, str) else "map"] += 1
    print(result if isinstance(result, str) else result.warnings)
