# SPDX-License-Identifier: GPL-3.0-or-later
"""A table of bakes: right ones give no warning, and wrong ones give one, which names the cause."""

import re
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from addon.core.errors import BakeError, Fix, in_window
from addon.core.settings import Settings
from addon.jobs import Job, Wants, bake_all
from tests.audit.test_unsure_hits import plates
from tests.support import scenes, zoo
from tests.support.real_meshes import PAIRS

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 256
"""Texels a side: islands with usual margins are far enough apart for the mip levels of the settings."""


@dataclass
class Case:
    """What is baked. settings: those that differ from the test's. share_image: whether all jobs are baked into one image."""

    jobs: list[Job]
    settings: dict[str, Any] = field(default_factory=dict)
    share_image: bool = False

    def bake(self):
        """The warnings of all bakes, each of them once."""
        usual = {"width": SIDE, "height": SIDE, "storage": "MEMORY", "material": False}
        settings = Settings(**usual | self.settings)
        reports = bake_all(bpy.context, self.jobs, settings, share_image=self.share_image)
        return list(dict.fromkeys(warning for report in reports for warning in report.warnings))


def case(low, *highs, cage=None, **settings):
    return Case([Job(low, highs, cage)], settings)


# Objects


def torus(name, around, across, *, waves=0.0, radius=0.4):
    """A torus; with waves, of this height."""

    def surface(u, v):
        r = radius + waves * np.sin(2 * np.pi * 12 * u) * np.sin(2 * np.pi * 6 * v)
        a, b = 2 * np.pi * u, 2 * np.pi * v
        return np.stack([(1 + r * np.cos(b)) * np.cos(a), (1 + r * np.cos(b)) * np.sin(a), r * np.sin(b)], axis=1)

    return zoo.sheet(name, surface, around, across)


def pipe(name, sides, rings=1, *, waves=0.0):
    """The side of a cylinder, with one seam."""

    def surface(u, v):
        r = 1 + waves * np.sin(2 * np.pi * 8 * u) * np.sin(2 * np.pi * 3 * v)
        return np.stack([r * np.cos(2 * np.pi * u), r * np.sin(2 * np.pi * u), 2 * v - 1], axis=1)

    return placed(zoo.sheet(name, surface, sides, rings), 0.9, (0.02, 0.05))


def crate(name, depth=0.08):
    """A cube of the layout of zoo.cube. Each side has a panel that is `depth` deep, with sloped walls."""
    cube = zoo.cube("template")
    steps = np.array([0.0, 0.06, 0.11, 0.89, 0.94, 1.0])
    a, b = np.meshgrid(steps, steps)
    weights = np.stack([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b], axis=-1)
    is_deep = (np.abs(a - 0.5) < 0.4) & (np.abs(b - 0.5) < 0.4)
    points, uv, faces = [], [], []
    for polygon in cube.data.polygons:
        corners = np.array([cube.data.vertices[number].co for number in polygon.vertices])
        layout = np.array([cube.data.uv_layers[0].uv[number].vector for number in polygon.loop_indices])
        points.append((weights @ corners - depth * is_deep[..., None] * np.array(polygon.normal)).reshape(-1, 3))
        uv.append((weights @ layout).reshape(-1, 2)[zoo.grid_faces(5, 5)])
        faces.append(zoo.grid_faces(5, 5, offset=36 * len(faces)))
    bpy.data.objects.remove(cube)
    return zoo.build(name, np.concatenate(points), np.concatenate(faces), np.concatenate(uv), smooth=False)


def placed(obj, scale, move):
    """`obj` with its UVs scaled and moved."""
    layer = obj.data.uv_layers[0].uv
    uv = np.empty((len(layer), 2), np.float32)
    layer.foreach_get("vector", uv.reshape(-1))
    layer.foreach_set("vector", (uv * scale + np.array(move)).astype(np.float32).reshape(-1))
    return obj


def turned(obj):
    """`obj` with a UV layout of its own, which fits no other."""
    layer = obj.data.uv_layers[0].uv
    uv = np.empty((len(layer), 2), np.float32)
    layer.foreach_get("vector", uv.reshape(-1))
    layer.foreach_set("vector", np.ascontiguousarray(uv[:, ::-1] * np.float32(0.37)).reshape(-1))
    return obj


def flipped(obj):
    obj.data.flip_normals()
    return obj


def moved(obj, *location, scale=1.0):
    obj.location, obj.scale = location, np.broadcast_to(scale, 3)
    return obj


def displaced(obj):
    """`obj` with modifiers that add detail."""
    simple = obj.modifiers.new("Simple", "SUBSURF")
    simple.subdivision_type, simple.levels, simple.render_levels = "SIMPLE", 5, 5
    displace = obj.modifiers.new("Clouds", "DISPLACE")
    displace.texture, displace.strength = bpy.data.textures.new("Clouds", "CLOUDS"), 0.2
    return obj


def mirror(obj):
    """A Mirror modifier on what lies beside the middle."""
    obj.data.transform(Matrix.Translation((1.0, 0.0, 0.0)))
    obj.modifiers.new("Mirror", "MIRROR")
    return obj


def material(obj, node_type):
    """`obj` with a material whose base color comes from a node. Returns the node."""
    made = bpy.data.materials.new("Paint")
    if made.node_tree is None:
        made.use_nodes = True
    node = made.node_tree.nodes.new(node_type)
    shader = next(each for each in made.node_tree.nodes if each.type == "BSDF_PRINCIPLED")
    made.node_tree.links.new(node.outputs[0], shader.inputs["Base Color"])
    obj.data.materials.append(made)
    return node


def terrain(**options):
    return zoo.terrain("hi", 24, **options)


# Right bakes


def several(*parts):
    """Two columns in UV space: a low and a high object in each."""
    jobs = []
    for number, (low, high) in enumerate(parts):
        for obj in (low, high):
            placed(moved(obj, 3.0 * number, 0, 0), (0.44, 0.9), (0.03 + 0.5 * number, 0.05))
        jobs.append(Job(low, [high]))
    return jobs


def bolts(method):
    low, plate = zoo.plane("lo"), zoo.plane("hi", 8)
    places = [(x, y, 0) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    parts = [moved(zoo.sphere(f"bolt {n}", 8), *place, scale=0.1) for n, place in enumerate(places)]
    return case(low, plate, *parts, method=method)


def instances():
    source = moved(zoo.terrain("source", 12, height=0.05), 0, 0, 0, scale=0.5)
    group = bpy.data.collections.new("Tiles")
    group.objects.link(source)
    bpy.context.scene.collection.objects.unlink(source)
    shown = []
    for x in (-0.5, 0.5):
        for y in (-0.5, 0.5):
            empty = bpy.data.objects.new("tile", None)
            empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", group, (x, y, 0)
            bpy.context.scene.collection.objects.link(empty)
            shown.append(empty)
    return case(zoo.plane("lo"), *shown)


def udim():
    low, high = zoo.plane("lo", 2), terrain()
    for obj in (low, high):
        for corner in placed(obj, 0.9, (0.05, 0.05)).data.uv_layers[0].uv:
            corner.vector.x += 1.0
    return case(low, high, udim=True, storage="PACK")


def multires():
    low = zoo.terrain("lo", 4)
    levels = low.modifiers.new("Multires", "MULTIRES")
    bpy.context.view_layer.objects.active = low
    for _ in range(2):
        bpy.ops.object.multires_subdivide(modifier=levels.name)
    low.modifiers.new("Clouds", "DISPLACE").texture = bpy.data.textures.new("Clouds", "CLOUDS")
    return case(low, low)


def rounded():
    high = zoo.cube("hi")
    bevel = high.modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments = 0.05, 3
    return case(zoo.cube("lo"), high)


def moved_copies():
    low, high = zoo.mirrored("lo", slope=0.3), zoo.mirrored("hi", 24, slope=0.4)
    corners = low.data.uv_layers[0].uv
    for corner in list(corners)[len(corners) // 2 :]:
        corner.vector.x += 1.0
    return case(low, high)


def asymmetric(*, offset=0.0):
    """Mirrored halves over a high mesh whose halves differ."""
    low = mirror(zoo.plane("lo", 2))
    low.modifiers[0].offset_u = offset
    return case(low, moved(turned(zoo.terrain("hi", 48)), 0, 0, 0, scale=(2, 1, 1)))


def materials(**settings):
    """Two plates beside each other, each with a material and UVs of its own that fill the tile."""
    low, other = zoo.plane("lo", 2), placed(moved_mesh(zoo.plane("lo 2", 3), 3.0), 0.9, (0.05, 0.0))
    for obj in (low, other):
        material(obj, "ShaderNodeTexNoise")
    with bpy.context.temp_override(active_object=low, selected_editable_objects=[low, other]):
        bpy.ops.object.join()
    return case(low, turned(terrain()), moved(turned(zoo.terrain("hi 2", 36)), 3.0, 0, 0), **settings)


def moved_mesh(obj, x):
    obj.data.transform(Matrix.Translation((x, 0.0, 0.0)))
    return obj


def decal():
    picture = moved(zoo.terrain("decal", 12, height=0.02), 0, 0, 0.02, scale=(0.3, 0.3, 1.0))
    return case(zoo.plane("lo"), zoo.plane("hi", 8), picture)


RIGHT = {
    "plane": lambda: case(zoo.plane("lo"), terrain()),
    "plane, by rays": lambda: case(zoo.plane("lo"), turned(terrain())),
    "plane, a part without UVs": lambda: case(zoo.plane("lo"), no_area(terrain())),
    "quads that are not planar": lambda: case(zoo.terrain("lo", 12), zoo.terrain("hi", 48, height=0.11)),
    "deep panels": lambda: case(zoo.cube("lo"), crate("hi", 0.25)),
    "deep panels, by rays": lambda: case(zoo.cube("lo"), turned(crate("hi", 0.25))),
    "rounded edges": rounded,
    "torus": lambda: case(torus("lo", 16, 8), torus("hi", 96, 48, waves=0.02)),
    "torus, by rays": lambda: case(torus("lo", 16, 8), turned(torus("hi", 96, 48, waves=0.02))),
    "pipe": lambda: case(pipe("lo", 12), pipe("hi", 96, 24, waves=0.02)),
    "two pipes": lambda: Case(
        [Job(pipe(f"lo {n}", 12), [pipe(f"hi {n}", 96, 24, waves=0.02)]) for n in range(2)], {"image": "{low}"}
    ),
    "atlas": lambda: Case(
        several((zoo.plane("lo"), terrain()), (zoo.plane("lo 2"), zoo.terrain("hi 2", 24))), share_image=True
    ),
    "mirrored halves in one place": lambda: case(mirror(zoo.plane("lo", 2)), mirror(terrain())),
    "mirrored halves side by side": moved_copies,
    "texture sets": lambda: materials(texture_sets=True),
    "UDIM": udim,
    "its own modifiers": lambda: case(*[displaced(zoo.plane("lo", 2))] * 2),
    "multires": multires,
    "bolts": lambda: bolts("AUTO"),
    "decal": decal,
    "instances": instances,
    "cage": lambda: case(zoo.plane("lo"), terrain(), cage=moved(zoo.plane("cage"), 0, 0, 0.2), method="CAST"),
    "side by side": lambda: case(zoo.plane("lo"), moved(terrain(), 5, 0, 0)),
    "a part of a larger mesh": lambda: case(zoo.plane("lo"), moved(turned(terrain(waves=3)), 0, 0, 0, scale=(3, 3, 1))),
    "other maps": lambda: case(
        torus("lo", 16, 8),
        torus("hi", 48, 24, waves=0.02),
        maps=("AO", "POSITION", "CURVATURE"),
        rays=16,
        width=64,
        height=64,
    ),
}


@pytest.mark.parametrize("name", RIGHT)
def test_right_bakes_give_no_warning(name):
    assert RIGHT[name]().bake() == []


# Wrong bakes


def no_area(obj):
    for corner in list(obj.data.uv_layers[0].uv)[:4]:
        corner.vector = (0.5, 0.5)
    return obj


def not_finite(obj):
    obj.data.vertices[30].co.z = float("nan")
    return obj


def missing_image():
    high = terrain()
    image = bpy.data.images.new("rock", 4, 4)
    image.source, image.filepath = "FILE", "/nowhere/rock.png"
    material(high, "ShaderNodeTexImage").image = image
    return case(zoo.plane("lo"), high, maps=("BASE_COLOR",))


def of_the_view():
    high = terrain()
    material(high, "ShaderNodeLayerWeight")
    return case(zoo.plane("lo"), high, maps=("BASE_COLOR",))


def attribute_with_nan():
    high = terrain()
    high.data.attributes.new("Dirt", "FLOAT_COLOR", "CORNER").data[3].color = (float("nan"), 0, 0, 1)
    return case(zoo.plane("lo"), high, maps=("ATTRIBUTE",), attribute="Dirt")


def without_uv():
    low = zoo.plane("lo")
    low.data.uv_layers.remove(low.data.uv_layers[0])
    return case(low, terrain())


def without_target():
    high = terrain()
    high.modifiers.new("Wrap", "SHRINKWRAP")
    return case(zoo.plane("lo"), high)


def normals_behind():
    """A plane whose middle leans over, without hard edges."""
    low = zoo.plane("lo", 6)
    points = np.array([vertex.co for vertex in low.data.vertices])
    leaning = np.where(np.abs(points[:, :1]) < 0.4, (0.995, 0.0, -0.1), (0.0, 0.0, 1.0))
    corners = np.array([[low.data.vertices[n].index for n in polygon.vertices] for polygon in low.data.polygons])
    bpy.data.objects.remove(low)
    return case(zoo.plane("lo", 6, normals=leaning[corners]), terrain())


def replaced():
    low = zoo.plane("lo")
    case(low, zoo.terrain("old", 12)).bake()
    return case(low, terrain())


def overlapping():
    low = zoo.two_islands("lo", gap=0.25)
    for corner in list(low.data.uv_layers[0].uv)[4:]:
        corner.vector.x -= 0.4
    return case(
        placed(low, 0.9, (0.05, 0.05)), moved(turned(zoo.terrain("hi", 48)), 0, 0, 0, scale=(2, 1, 1)), method="CAST"
    )


def other_halves():
    """Mirrored halves that share their UVs, below a surface that is not symmetric."""
    return case(mirror(zoo.plane("lo", 2)), moved(turned(zoo.terrain("hi", 48, waves=3)), 0, 0, 0, scale=(2, 1, 1)))


def two_materials():
    """Two faces side by side that share their UVs and have a material each."""
    low, high = zoo.two_islands("lo", gap=0.0), moved(turned(zoo.terrain("hi", 48)), 0, 0, 0, scale=(2, 1, 1))
    layer = low.data.uv_layers[0].uv
    for number in range(4):
        layer[number + 4].vector = layer[number].vector
    for number in range(2):
        scenes.material(f"Part {number}", low)
        low.data.polygons[number].material_index = number
    return case(placed(low, 0.9, (0.05, 0.05)), high)


def wavy_torus(*, place=(0, 0, 0), scale=1.0):
    return moved(turned(torus("hi", 96, 48, waves=0.02)), *place, scale=scale)


FAR_RAYS = {"method": "CAST", "hit": "OUTERMOST", "extrusion": 0.5, "max_distance": 1.0, "mips": 0}


def ring(low=None, high=None, **settings):
    """A torus and its high mesh; low, high: others in their place."""
    return case(low or torus("lo", 16, 8), high or wavy_torus(), **settings)


WRONG = {
    # What is baked, how its only warning or error begins, and the kind of its cure if an option or a button is one.
    "flipped low, by UVs": (
        lambda: case(flipped(zoo.plane("lo")), terrain()),
        "The faces of 'lo' point to the other side",
    ),
    "flipped low, by rays": (lambda: ring(flipped(torus("lo", 16, 8))), "The faces of 'lo' point to the other side"),
    "flipped low crate": (
        lambda: case(flipped(zoo.cube("lo")), turned(crate("hi"))),
        "The faces of 'lo' point to the other side",
    ),
    "flipped high, kept": (
        lambda: ring(high=flipped(wavy_torus()), keep_faces=True),
        "The faces of 'hi' point to the other side",
    ),
    "high beside low": (lambda: ring(high=wavy_torus(place=(0.7, 0, 0))), "'hi' and 'lo' differ in place or size"),
    "high beside low crate": (
        lambda: case(zoo.cube("lo"), moved(turned(crate("hi")), 0.7, 0, 0)),
        "'hi' and 'lo' differ in place or size",
    ),
    "high of another scale": (lambda: ring(high=wavy_torus(scale=2.0)), "'hi' and 'lo' differ in place or size"),
    "high of half the scale": (
        lambda: case(zoo.cube("lo"), moved(turned(crate("hi")), 0, 0, 0, scale=0.5)),
        "'hi' and 'lo' differ in place or size: on 100.00% of the texels, they are more than 8.66 cm apart",
    ),
    "high of a hundredth of the scale": (
        lambda: case(zoo.cube("lo"), moved(turned(crate("hi")), 0, 0, 0, scale=0.01)),
        "No ray from 'lo' hit 'hi': they differ in place or size",
    ),
    "high that is the low": (lambda: case(zoo.plane("lo"), zoo.plane("hi", 4)), "The map is flat"),
    "high and low swapped": (lambda: case(zoo.terrain("lo", 24), zoo.plane("hi", 4)), "'lo' has more faces than 'hi'"),
    "UVs that overlap": (overlapping, ".+ of the texels of 'lo' belong to two or more"),
    "mirrored halves that differ": (
        asymmetric,
        r"8 triangles of 'lo' show the detail of other parts with the same UVs, and on \d+.+ Unwrap without Stack Mirrored",
    ),
    "halves that differ side by side": (lambda: asymmetric(offset=1.0), "8 triangles of 'lo' show the detail of other"),
    "materials that share UVs": (
        materials,
        "Materials of 'lo' share UVs, and its map has the detail of one of them",
        Fix.TEXTURE_SETS.name,
    ),
    "halves of other detail": (other_halves, "8 triangles of 'lo' show the detail of other parts"),
    "two materials on one place": (two_materials, "Materials of 'lo' share UVs", Fix.TEXTURE_SETS.name),
    "halves in object space": (
        lambda: case(zoo.mirrored("lo", slope=0.3), zoo.mirrored("hi", 24, slope=0.5), space="OBJECT"),
        "100.00% of the texels of 'lo' belong to two or more",
    ),
    "UVs outside the tile": (
        lambda: case(placed(zoo.plane("lo", 2), 1.0, (0.3, 0.0)), terrain()),
        "'lo': 4 of its triangles reach outside the UV tile",
    ),
    "UVs smaller than texels": (
        lambda: case(placed(zoo.plane("lo", 2), 1e-3, (0.3, 0.3)), turned(terrain()), method="CAST"),
        "No texel of the map has its center in a triangle of 'lo': set a larger map",
    ),
    "UVs without area": (
        lambda: case(no_area(zoo.plane("lo", 8)), turned(terrain())),
        "'lo': 2 of its triangles have no area in UV space",
    ),
    "high UVs without area": (
        lambda: case(zoo.plane("lo"), no_area(terrain()), method="FLATTEN"),
        "'hi': 2 of its triangles have no area",
    ),
    "NaN in the high mesh": (
        lambda: case(zoo.plane("lo"), not_finite(terrain())),
        "'hi': 6 of its triangles are left out",
    ),
    "islands too close": (
        lambda: case(zoo.two_islands("lo", gap=0.02), displaced(zoo.two_islands("hi", gap=0.02))),
        ".+ are within 8 texels of another UV island",
    ),
    "map too coarse": (
        lambda: case(zoo.cube("lo"), crate("hi"), width=32, height=32),
        ".+ are within 8 texels of another UV island",
    ),
    "hard edges without seams": (
        lambda: case(zoo.terrain("lo", 4, waves=1, smooth=False), terrain(waves=1)),
        "'lo' has 24 hard edges without a UV seam",
    ),
    "normals behind faces": (normals_behind, "'lo': .+ shading normals that point behind them"),
    "cage on the low mesh": (
        lambda: case(torus("lo", 16, 8), wavy_torus(), cage=torus("cage", 16, 8), method="CAST"),
        ".+ of the rays from the cage 'cage' hit nothing, or only backs",
    ),
    "cage too low": (
        lambda: case(zoo.plane("lo"), terrain(), cage=moved(zoo.plane("cage"), 0, 0, 0.02), method="CAST"),
        ".+ of the rays from the cage 'cage' hit nothing, or only backs",
    ),
    "distances too short": (
        lambda: ring(method="CAST", extrusion=0.001, max_distance=0.001),
        ".+ hit nothing within the extrusion and the maximum distance that were set",
        Fix.MEASURE.name,
    ),
    "beyond a limit": (
        lambda: case(zoo.cube("lo"), crate("hi"), limit=0.01),
        ".+ farther away than 1 cm, at most 8 cm",
    ),
    "Flatten with other UVs": (lambda: ring(method="FLATTEN"), "The UV layout of 'hi' differs", Fix.AUTO.name),
    "a layer of another part": (
        lambda: case(plates("lo", 0.0, 0.3), displaced(plates("hi", 0.01, 0.31)), **FAR_RAYS),
        ".+ show a layer of the high mesh that belongs to another part",
        Fix.OWN_HIT.name,
    ),
    "image missing": (missing_image, 'Material "Paint": Base Color is left out, because the image "rock"'),
    "material that looks at the view": (
        of_the_view,
        'Material "Paint": Base Color is left out, because Imprint cannot follow',
    ),
    "NaN in an attribute": (attribute_with_nan, "The attribute 'Dirt' of 'hi' is not finite"),
    "attribute missing": (
        lambda: case(zoo.plane("lo"), terrain(), maps=("ATTRIBUTE",), attribute="Dirt"),
        "The attribute map is black where the high mesh has no attribute 'Dirt'",
    ),
    "modifier without target": (without_target, "Blender leaves out the modifier 'Wrap' of 'hi'"),
    "one sample of slopes": (
        lambda: case(zoo.plane("lo"), terrain(), maps=("WIDENED_ROUGHNESS",)),
        "With 1 sample in a texel, widened roughness",
        Fix.SAMPLES.name,
    ),
    "a part out of reach": (
        lambda: case(zoo.plane("lo"), turned(terrain()), moved(zoo.terrain("far", 8), 0, 0, 50)),
        "'far' lies out of reach of the rays",
    ),
    "another object's map replaced": (replaced, "The map of 'hi' replaced a map of 'old'"),
    "UVs of an atlas overlap": (
        lambda: Case(
            [Job(zoo.plane("lo"), [terrain()]), Job(zoo.plane("lo 2"), [zoo.terrain("hi 2", 24)])], share_image=True
        ),
        ".+ texels of 'lo 2' overlap texels of other objects",
    ),
    "no UVs": (without_uv, "'lo' has no UV layer"),
    "high far away": (
        lambda: case(zoo.plane("lo"), moved(turned(terrain()), 0, 0, 10)),
        "'lo' and 'hi' do not overlap",
    ),
}


def said_of(made):
    """The warnings of a bake, or its error."""
    try:
        return made.bake()
    except BakeError as error:
        return [str(error)]


@pytest.mark.parametrize("name", WRONG)
def test_wrong_bakes_give_one_warning_that_names_the_cause(name):
    make, beginning, *kinds = WRONG[name]
    (said,) = said_of(make())
    assert re.match(beginning, said)
    shown, kind = in_window(said)
    assert [kind] == (kinds or [""])
    assert "--" not in shown
    assert ("--" in said) == bool(kind)


# Real meshes


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.parametrize("method", ["AUTO", "CAST"])
@pytest.mark.parametrize("file", [name for name in PAIRS if name != "spot_control_vs_subd5"])
def test_right_bakes_of_real_meshes_give_no_warning(file, method, shared_assets):
    with bpy.data.libraries.load(str(shared_assets / "pairs" / f"{file}.blend")) as (held, loaded):
        loaded.objects = list(held.objects)
    for obj in loaded.objects:
        bpy.context.scene.collection.objects.link(obj)
    low, *_, high = sorted(
        (obj for obj in loaded.objects if obj.type == "MESH"), key=lambda obj: len(obj.data.polygons)
    )
    assert case(low, high, width=1024, height=1024, method=method).bake() == []


@pytest.mark.parametrize(("method", "count"), [("CAST", 1), ("FLATTEN", 0)])
def test_why_files_may_not_fit_is_said_of_rays_alone(method, count):
    """And in place of what follows from it: most rays miss."""
    high, hint = zoo.plane("hi"), "The high mesh is a fifth as large."
    high.scale = 0.2, 0.2, 1.0
    job = Job(zoo.plane("lo"), [high])
    settings = Settings(width=32, height=32, method=method, storage="MEMORY", material=False)
    (report,) = bake_all(bpy.context, [job], settings, wants=Wants(hints=(hint,)))
    assert report.warnings.count(hint) == count
    assert not any("missed" in text or "hit nothing" in text for text in report.warnings)
