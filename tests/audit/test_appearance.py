# SPDX-License-Identifier: GPL-3.0-or-later
"""The shading error: what a viewer sees of high meshes, and of a low mesh with its map, against rays in float64 and known
angles; and what raises it."""


import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from addon.audit.appearance import Detail, ShownMap, measure
from addon.core.map_types import NORMAL
from addon.core.progress import finish
from addon.core.settings import Run, Settings
from addon.engine import baking, normal_space
from addon.scene import reading
from tests.support import seen_from_sides, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SMALL = Detail(4, 80)
CLOSE = 0.02
"""The relative error of means and percentiles that rasterizers may make: corners are rounded to 1/256 pixel, and at outlines
either pixel may be covered."""
ASLANT = Matrix.LocRotScale((3.0, -2.0, 5.0), Euler((0.4, -0.3, 0.8)), (1.0, 1.0, 1.0))
UNEVEN = Matrix.LocRotScale((0.0, 0.0, 0.0), Euler((0.2, 0.3, 0.1)), (1.5, 0.6, 1.1))
MIRRORED = Matrix.LocRotScale((1.0, 0.0, 0.0), Euler((0.0, 0.0, 0.5)), (-1.2, 0.8, 1.0))


def settings(**values):
    usual = {"method": "CAST", "basis": "MIKKTSPACE", "margin": 4, "depth": 32, "storage": "MEMORY", "material": False}
    return Settings(**{**usual, "width": 128, "height": 128, **values})


def read_and_baked(low, highs, chosen):
    """The meshes of a bake, and its map as programs read it."""
    bpy.context.view_layer.update()
    meshes = reading.read(bpy.context, low, highs, None, chosen)
    maps = finish(baking.bake(meshes, Run(chosen)))
    tiles = {tile: each[NORMAL.name][0] for tile, each in maps.items()}
    return meshes, ShownMap(tiles, normal_space.reading(chosen.map), chosen.sampling.udim)


def seen(meshes, shown, detail=SMALL):
    return finish(measure(meshes.highs, meshes.basis or meshes.low, shown, detail=detail))


def check_against_rays(meshes, shown, chosen, detail=SMALL):
    """Compare a measurement with the oracle. Returns the measurement."""
    found = seen(meshes, shown, detail)
    texels = next(iter(shown.tiles.values()))
    held = seen_from_sides.NormalMap(texels, chosen.map.space, chosen.map.basis, chosen.map.channels)
    low, *highs = map(seen_from_sides.Surface.of, (meshes.basis or meshes.low, *meshes.highs))
    degrees, alone, distances = seen_from_sides.measured(highs, low, held, views=detail.views, side=detail.side)
    assert found.pixels == pytest.approx(len(degrees), rel=0.002)
    assert found.mean == pytest.approx(degrees.mean(), rel=CLOSE, abs=0.02)
    for name, share in (("median", 50), ("percentile_95", 95), ("percentile_99", 99)):
        assert getattr(found, name) == pytest.approx(np.percentile(degrees, share), rel=CLOSE, abs=0.03), name
    assert found.silhouette == pytest.approx(alone, rel=0.1, abs=0.002)
    assert found.distance == pytest.approx(np.percentile(distances, 99), rel=CLOSE, abs=1e-4)
    return found


# Against rays


@pytest.mark.parametrize("matrix", [Matrix(), ASLANT, UNEVEN, MIRRORED], ids=["plain", "aslant", "uneven", "mirrored"])
@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
def test_objects_anywhere_are_measured_as_rays_see_them(matrix, space):
    low, high = zoo.terrain("low", 6, height=0.3), zoo.terrain("high", 16, height=0.3)
    for obj in (low, high):
        obj.matrix_world = matrix
    chosen = settings(space=space, basis="CYCLES")
    found = check_against_rays(*read_and_baked(low, [high], chosen), chosen)
    assert found.mean > 0.3


@pytest.mark.parametrize("basis", ["CYCLES", "MIKKTSPACE", "MIKKTSPACE_VERTEX", "NORMALIZED"])
def test_each_basis_is_read_by_its_own_rules(basis):
    low, high = zoo.sphere("low", 10), zoo.sphere("high", 24)
    chosen = settings(basis=basis, green="-Y")
    check_against_rays(*read_and_baked(low, [high], chosen), chosen)


PAIRS = [
    "pairs/helmet_23358_6117",
    "pairs/kepler_199712_9079",
    "pairs/king_40480_4000",
    "pairs/normaltangenttest_published",
    "pairs/shaderball_48048_23378",
    "pairs/shaderball_61644_20517",
    "pairs/spot_1696_536",
    "pairs/spot_control_vs_subd5",
    "layers/collar",
    "layers/fingers",
]


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.parametrize("name", PAIRS)
def test_real_meshes_are_measured_as_rays_see_them(shared_assets, name):
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / f"{name}.blend"))
    low, high = (bpy.data.objects[each] for each in ("lo", "hi"))
    for obj, most in ((low, 800), (high, 6000)):
        decimate = obj.modifiers.new("fewer", "DECIMATE")
        decimate.ratio = min(1.0, most / sum(len(polygon.vertices) - 2 for polygon in obj.data.polygons))
    chosen = settings(width=256, height=256)
    found = check_against_rays(*read_and_baked(low, [high], chosen), chosen, Detail(5, 128))
    print(name, found)
