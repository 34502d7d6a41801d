# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles and EEVEE themselves: a map for the basis of each shows the normals of the object-space map of the same pair."""

import bmesh
import bpy
import numpy as np
import pytest

from addon.core.declarations import bases
from tests.support import angles, lanes, seen_normals, zoo
from tests.support.maps import bake
from tests.support.seen_frames import frames

pytestmark = pytest.mark.usefixtures("gpu_context")

EXACT = 0.2
"""Degrees at the 99th percentile. The tangent space of a pixel is not quite that of the texel's center, and EEVEE has half
floats."""
WRONG = 0.5
"""Degrees at the 99th percentile, by which every other basis is off at least, on coarse meshes."""
ASLANT, BEHIND = (0.9, -1.6, 2.2), (-0.8, 1.5, 0.9)


def off(low, high, engine, path, size, **settings):
    """Degrees at the 99th percentile between what the engine shows of maps and of the object-space map, by basis."""
    settings = {"size": (size, size), "margin": 16, **settings}
    names = [basis.name for basis in bases.BASES]
    for name in names:
        bake(low, high, basis=name, image=name, **settings)
    bake(low, high, space="OBJECT", image="object", **settings)
    inside = inside_of(low, size)
    angles_of = {name: [] for name in names}
    for direction in (ASLANT, BEHIND):
        seen_normals.camera_on(low, direction)
        kept = seen_normals.near_centers(low, inside, engine, path)
        assert np.count_nonzero(kept) > 800
        expected, _ = seen_normals.normals(low, bpy.data.images["object"], engine, path, space="OBJECT")
        for name in names:
            seen, _ = seen_normals.normals(low, bpy.data.images[name], engine, path)
            angles_of[name].append(angles.degrees(seen, expected)[kept])
    return {name: np.percentile(np.concatenate(found), 99) for name, found in angles_of.items()}


def inside_of(low, size):
    """An image that is 1 on texels of one triangle that is not folded, away from the borders of such texels."""
    found = frames(low, (size, size))
    mask = found.covered.copy()
    mask[mask] = ~found.is_folded
    texels = np.zeros((size, size, 4), np.float32)
    texels[...] = angles.eroded(mask, 2)[..., None]
    image = bpy.data.images.new("inside", size, size, float_buffer=True, is_data=True)
    image.pixels.foreach_set(texels.ravel())
    return image


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


@pytest.mark.parametrize("engine", lanes.slow_but(["CYCLES"], seen_normals.ENGINES))
def test_an_engine_shows_the_map_of_its_basis_and_no_other(engine, tmp_path):
    low, high = triangulated(zoo.terrain("low", n=9, height=0.3)), zoo.terrain("high", n=64, height=0.3)
    assert_own_basis(off(low, high, engine, tmp_path, 2048), engine)
