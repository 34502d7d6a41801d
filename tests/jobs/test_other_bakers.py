# SPDX-License-Identifier: GPL-3.0-or-later
"""Converts maps that other bakers made: Cycles, Blender's bake from Multires, and the baker of a published map."""

import bpy
import numpy as np
import pytest

from addon.core.declarations import bases
from tests.support import angles, cycles, lanes, scenes, zoo
from tests.support.conversions import converted, percentile, picture
from tests.support.maps import bake

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = (512, 512)
PAIRS = ["spot_1696_536", "king_40480_4000", "helmet_23358_6117"]
FAST = ["spot_1696_536"]
OWN = 0.1
"""Degrees at the 99th percentile between two maps of the same baker: its rounding of places on the mesh."""
OTHERS = 0.2
"""The same between two bakers: they cast rays from places that differ by a fraction of a texel."""
WRONG = 2.0
"""Degrees that another basis costs at least, at the 99th percentile."""
LEVELS = 4
"""Of Multires."""
NOT_THEIRS = [basis.name for basis in bases.BASES if basis is not bases.MIKKTSPACE]
"""Blender bakes for MikkTSpace, also where Cycles renders."""


def of_cycles(low, high):
    """Cycles' maps in tangent and in object space, and how far the rays go. Images `tangent` and `object` hold the maps."""
    extrusion = 0.02 * max(low.dimensions)
    reach = {"extrusion": extrusion, "max_distance": 2.0 * extrusion}
    maps = [cycles.bake_normals(low, SIZE, space=space, highs=[high], **reach)[0] for space in ("TANGENT", "OBJECT")]
    for name, texels in zip(("tangent", "object"), maps, strict=True):
        picture(name, texels)
    return *maps, reach


def inside(*maps):
    """The texels (H, W) that all maps have, away from borders."""
    return angles.eroded(np.logical_and.reduce([texels[..., 3] == 1.0 for texels in maps]), 1)


@pytest.mark.shared
@pytest.mark.parametrize("name", lanes.slow_but(FAST, PAIRS))
def test_maps_of_cycles_become_those_of_another_space_and_basis(shared_assets, name):
    """The objects have no scale, so that Cycles' object space is that of Imprint."""
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "pairs" / f"{name}.blend"))
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    tangent, expected, reach = of_cycles(low, high)
    common = {"method": "CAST", "hit": "OUTERMOST", "size": SIZE, **reach}
    ours = {now: bake(low, high, basis=now, image=now, **common) for now in ("NORMALIZED", "CYCLES")}
    kept = inside(tangent, expected, *ours.values())
    off = {}
    for was in [basis.name for basis in bases.BASES]:
        found, _ = converted(low, "tangent", {"from_basis": was}, space="OBJECT")
        off[was] = percentile(found, expected, kept)
    for now, texels in ours.items():
        off[f"to {now}"] = percentile(converted(low, "tangent", basis=now)[0], texels, kept)
        back = converted(low, "object", {"from_space": "OBJECT"}, basis=now)[0]
        off[f"object to {now}"] = percentile(back, texels, kept)
    print(f"{name}: {kept.mean():.2f} compared, {', '.join(f'{key} {value:.3f}' for key, value in off.items())}")
    assert kept.mean() > 0.35
    assert off["MIKKTSPACE"] < OWN
    assert all(off[was] > WRONG for was in NOT_THEIRS)
    assert all(value < OTHERS for key, value in off.items() if "to" in key)


@pytest.mark.shared
def test_what_8_bits_cost_a_map_of_cycles(shared_assets):
    """The report has the degrees by which a conversion of 8 bits, into 8 bits, differs from one of floats."""
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "pairs" / "spot_1696_536.blend"))
    low = bpy.data.objects["lo"]
    tangent, _, _ = of_cycles(low, bpy.data.objects["hi"])
    picture("bytes", np.rint(tangent * 255) / 255, is_float=False)
    exact, _ = converted(low, "tangent", space="OBJECT")
    for depth, measured in ((32, "source_loss"), (8, "loss")):
        found, report = converted(low, "bytes", space="OBJECT", depth=depth)
        before = exact if depth == 32 else converted(low, "bytes", space="OBJECT")[0]
        kept = inside(found, before)
        off = angles.degrees(angles.decode(found), angles.decode(before))[kept]
        said = getattr(report, measured)
        print(f"{measured}: median {np.median(off):.3f}, at most {off.max():.3f}; reported {said}")
        assert report.source_depth == 8
        assert said["median"] < COST_OF_8_BITS[0] and said["maximum"] < COST_OF_8_BITS[1]
        assert said["median"] == pytest.approx(np.median(off), rel=0.1)
        assert said["maximum"] == pytest.approx(off.max(), rel=0.3)


COST_OF_8_BITS = 0.185, 0.4
"""Degrees in the median and at most, as the manual has them."""
PUBLISHED = {50: 0.3, 95: 0.4}
"""Degrees at these percentiles. The 8 bits of the map cost 0.18 and, at most, 0.36."""


@pytest.mark.slow
@pytest.mark.shared
def test_a_published_map_of_8_bits_shows_the_high_mesh(shared_assets):
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "pairs" / "normaltangenttest_published.blend"))
    path = shared_assets / "pairs" / "normaltangenttest_published_normal.png"
    image = bpy.data.images.load(str(path))
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    common = {"method": "CAST", "size": tuple(image.size), "extrusion": 0.12, "max_distance": 0.3}
    expected = bake(low, high, space="OBJECT", image="expected", **common)
    found, report = converted(low, image.name, space="OBJECT")
    kept = inside(found, expected)
    off = angles.degrees(angles.decode(found), angles.decode(expected))[kept]
    print(f"{kept.mean():.2f} compared: median {np.median(off):.3f}, 95 % {np.percentile(off, 95):.3f}")
    assert report.source_depth == 8
    assert kept.mean() > 0.15
    assert np.median(off) < PUBLISHED[50]
    assert np.percentile(off, 95) < PUBLISHED[95]


def test_an_uneven_scale_is_applied_before_blender_bakes_object_space():
    """With it, the object space of Blender's bake is not the one of the low mesh's normals."""
    low, high = zoo.terrain("low", n=9, height=0.3), zoo.terrain("high", n=64, height=0.3)
    off = {}
    for is_applied in (False, True):
        for obj in (low, high):
            obj.scale = (1.0, 2.0, 0.7)
            if is_applied:
                select(obj)
                bpy.ops.object.transform_apply()
        name = f"applied {is_applied}"
        picture(name, cycles.bake_normals(low, (64, 64), space="OBJECT", highs=[high], extrusion=0.1)[0])
        expected = bake(low, high, space="TANGENT", basis="MIKKTSPACE", image="expected", method="CAST", extrusion=0.1)
        found, _ = converted(low, name, {"from_space": "OBJECT"}, basis="MIKKTSPACE")
        off[is_applied] = percentile(found, expected, inside(found, expected))
    print(off)
    assert off[True] < OTHERS
    assert off[False] > WRONG


@pytest.mark.parametrize("level", [0, 1])
def test_a_map_baked_from_multires_shows_the_sculpted_mesh(level):
    """level: of the mesh that the map is for. Blender divides faces of level 0 from their centers, as it draws them nowhere."""
    low = zoo.terrain("low", n=9, height=0.3)
    modifier = low.modifiers.new("Multires", "MULTIRES")
    modifier.uv_smooth = "NONE"  # the UVs of both levels are the same
    select(low)
    for _ in range(LEVELS):
        bpy.ops.object.multires_subdivide(modifier="Multires", mode="CATMULL_CLARK")
    sculpt(low)
    modifier.levels = level
    source = baked_from_multires(low)
    low, high = at_level(low, level), at_level(low, LEVELS)
    expected = bake(low, high, space="OBJECT", image="expected", size=source.size[:])
    off = {}
    for was in [basis.name for basis in bases.BASES]:
        found, _ = converted(low, source.name, {"from_basis": was}, space="OBJECT")
        off[was] = percentile(found, expected, inside(found, expected))
    print(f"level {level}: {off}")
    if level == 0:
        assert off["MIKKTSPACE"] > WRONG
    else:
        assert off["MIKKTSPACE"] < OTHERS < min(off[was] for was in NOT_THEIRS)


def select(obj):
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj


def at_level(obj, level):
    """A copy of an object with the modifier Multires applied at a level."""
    copy = obj.copy()
    copy.data = obj.data.copy()
    bpy.context.scene.collection.objects.link(copy)
    copy.modifiers["Multires"].levels = level
    select(copy)
    bpy.ops.object.modifier_apply(modifier="Multires")
    return copy


def sculpt(obj):
    """Add waves to the highest level of Multires."""
    dense = at_level(obj, LEVELS)
    points = np.empty((len(dense.data.vertices), 3), np.float32)
    dense.data.vertices.foreach_get("co", points.ravel())
    points[:, 2] += 0.03 * np.sin(12 * points[:, 0]) * np.cos(9 * points[:, 1])
    dense.data.vertices.foreach_set("co", points.ravel())
    dense.data.update()
    select(dense)
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.multires_reshape(modifier="Multires")


def baked_from_multires(obj):
    """The image of Blender's own bake from Multires."""
    image = picture("multires", np.zeros((128, 128, 4)))
    material = scenes.material("target", obj)
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image, node.select = image, True
    material.node_tree.nodes.active = node
    select(obj)
    options = bpy.context.scene.render.bake
    options.use_multires, options.type, options.margin = True, "NORMALS", 0
    bpy.ops.object.bake_image()
    return image
