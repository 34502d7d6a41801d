# SPDX-License-Identifier: GPL-3.0-or-later
"""A map made for a basis, decoded by the rules of that basis in float64, gives the object-space map of the same pair."""

import bmesh
import bpy
import numpy as np
import pytest

from addon.core.declarations import bases
from tests.support import angles, decoders, lanes, zoo
from tests.support.maps import bake
from tests.support.seen_frames import frames

pytestmark = pytest.mark.usefixtures("gpu_context")

EXACT = 0.002
"""Degrees at the 99th percentile. Rasterizers round corners to 1/256 texel, which moves the low mesh's normals a little."""
WRONG = 1.0
"""Degrees. Readers of other bases are off by more, on coarse meshes, at the 99th percentile."""
NAMES = [basis.name for basis in bases.BASES]


def off(low, high, basis, targets=NAMES, size=(256, 256), **settings):
    """Degrees by target engine at the 99th percentile, outside folded triangles and away from borders."""
    settings = {"size": size, **settings}
    normals = angles.decode(bake(low, high, space="OBJECT", image="object", **settings))
    texels = bake(low, high, basis=basis, image=basis, **settings)
    seen = frames(low, size)
    kept = (angles.eroded(texels[..., 3] > 0, 2) & seen.covered)[seen.covered] & ~seen.is_folded
    assert kept.mean() > 0.5
    shown = {target: seen.decoded(angles.decode(texels), target) for target in targets}
    expected = normals[seen.covered][kept]
    return {target: np.percentile(angles.degrees(found[kept], expected), 99) for target, found in shown.items()}


def triangulate(obj):
    """Tangents of n-gons are made from triangles."""
    mesh = bmesh.new()
    mesh.from_mesh(obj.data)
    bmesh.ops.triangulate(mesh, faces=[face for face in mesh.faces if len(face.verts) > 4])
    mesh.to_mesh(obj.data)
    mesh.free()


def test_each_basis_has_a_decoder():
    assert list(decoders.DECODERS) == NAMES


@pytest.mark.parametrize(("basis", "method"), [*((name, "FLATTEN") for name in NAMES), (NAMES[0], "CAST")])
def test_a_map_is_exact_for_its_targets_and_for_no_others(basis, method):
    low, high = zoo.terrain("low", n=9, height=0.3), zoo.terrain("high", n=96, height=0.3)
    found = off(low, high, basis, method=method)
    assert found.pop(basis) < EXACT
    assert min(found.values()) > WRONG


@pytest.mark.parametrize(
    "name",
    lanes.slow_but(
        ["spot_1696_536"], ["king_40480_4000", "helmet_23358_6117", "spot_1696_536", "spot_control_vs_subd5"]
    ),
)
@pytest.mark.shared
@pytest.mark.parametrize("basis", lanes.slow_but(NAMES[:2], NAMES))
def test_a_map_of_a_real_pair_is_exact_for_its_targets(shared_assets, basis, name):
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "pairs" / f"{name}.blend"))
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    triangulate(low)
    found = off(low, high, basis, [basis], (512, 512), method="AUTO")
    print(f"{name} {basis}: {found[basis]:.5f}")
    assert found[basis] < EXACT
