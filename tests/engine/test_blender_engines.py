# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles and EEVEE themselves: a map for the basis of each shows the normals of the object-space map of the same pair."""

import bmesh
import bpy
import numpy as np
import pytest

from addon.core.declarations import bases
from tests.support import angles, seen_normals, zoo
from tests.support.maps import bake
from tests.support.seen_frames import frames

pytestmark = pytest.mark.usefixtures("gpu_context")

EXACT = 0.2
"""Degrees at the 99th percentile, with Blender's default settings. The tangent space of a pixel is not quite that of the
texel's center; EEVEE has half floats, and 10 bits of a mesh's normals."""
WRONG = 1.5
"""Degrees at the 99th percentile, by which every other basis is off at least, on coarse meshes."""
ASLANT, BEHIND = (0.9, -1.6, 2.2), (-0.8, 1.5, 0.9)
SIZE, PIXELS = 512, 704
"""The texels along a side of a map of a made mesh, and the pixels along a side of its picture."""
FEWEST = 200
"""Pixels that are compared from each direction."""
REAL = {"helmet_23358_6117": (2048, 1280), "spot_control_vs_subd5": (1024, 960)}
"""The same of real pairs: the smaller the triangles, the larger."""


def off(low, high, engine, path, *, side=SIZE, pixels=PIXELS, **settings):
    """Degrees at the 99th percentile between what the engine shows of maps and of the object-space map, by basis."""
    settings = {"size": (side, side), "margin": 16, **settings}
    names = [basis.name for basis in bases.BASES]
    for name in names:
        bake(low, high, basis=name, image=name, **settings)
    bake(low, high, space="OBJECT", image="object", **settings)
    make_inside(low, side)
    spaces = {**dict.fromkeys(names, "TANGENT"), "object": "OBJECT"}
    angles_of = {name: [] for name in names}
    for direction in (ASLANT, BEHIND):
        seen_normals.camera_on(low, direction)
        seen = seen_normals.normals(low, spaces, "inside", engine, path=path, pixels=pixels)
        assert len(seen["object"]) > FEWEST
        for name in names:
            angles_of[name].append(angles.degrees(seen[name], seen["object"]))
    return {name: np.percentile(np.concatenate(found), 99) for name, found in angles_of.items()}


def make_inside(low, side):
    """An image "inside" that is 1 on texels whose center one triangle covers, away from the borders of such texels."""
    texels = np.zeros((side, side, 4), np.float32)
    texels[...] = angles.eroded(frames(low, (side, side)).covered, 2)[..., None]
    image = bpy.data.images.new("inside", side, side, float_buffer=True, is_data=True)
    image.pixels.foreach_set(texels.ravel())


def triangulated(obj):
    """Other triangles than Blender draws would have other normals; tangents of n-gons are made from triangles."""
    mesh = bmesh.new()
    mesh.from_mesh(obj.data)
    bmesh.ops.triangulate(mesh, faces=mesh.faces)
    mesh.to_mesh(obj.data)
    mesh.free()
    return obj


def assert_own_basis(found, engine):
    print(engine, {name: round(float(degrees), 4) for name, degrees in found.items()})
    assert found.pop(bases.of_engine(engine).name) < EXACT
    assert min(found.values()) > WRONG


@pytest.mark.slow
@pytest.mark.parametrize("engine", seen_normals.ENGINES)
def test_an_engine_shows_the_map_of_its_basis_and_no_other(engine, tmp_path):
    low, high = triangulated(zoo.terrain("low", n=9, height=0.3)), zoo.terrain("high", n=64, height=0.3)
    assert_own_basis(off(low, high, engine, tmp_path), engine)


UNEVEN = {"uneven": (1.5, 0.7, 1.0), "uneven and mirrored": (-1.5, 0.7, 1.0)}


@pytest.mark.slow
@pytest.mark.parametrize("engine", seen_normals.ENGINES)
@pytest.mark.parametrize("scale", UNEVEN.values(), ids=UNEVEN)
def test_an_engine_shows_the_map_of_its_basis_on_an_uneven_scale(scale, engine, tmp_path):
    """EEVEE transforms normal and tangent before it makes the bitangent; Cycles transforms the finished normal."""
    low, high = triangulated(zoo.terrain("low", n=9, height=0.3)), zoo.terrain("high", n=64, height=0.3)
    for obj in (low, high):
        obj.scale, obj.rotation_euler = scale, (0.1, 0.1, 0.2)
    assert_own_basis(off(low, high, engine, tmp_path), engine)


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.parametrize("case", list(zip(REAL, seen_normals.ENGINES, strict=True)), ids=str)
def test_an_engine_shows_the_map_of_its_basis_on_a_real_pair(shared_assets, case, tmp_path):
    name, engine = case
    side, pixels = REAL[name]
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "pairs" / f"{name}.blend"))
    low, high = triangulated(bpy.data.objects["lo"]), bpy.data.objects["hi"]
    assert_own_basis(off(low, high, engine, tmp_path, side=side, pixels=pixels, method="AUTO"), engine)
