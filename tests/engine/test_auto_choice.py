# SPDX-License-Identifier: GPL-3.0-or-later
"""Auto takes Flatten for pairs that share UVs, and Cast once the high mesh has other UVs, where only Cast is right."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.mesh import uv_islands
from addon.scene import mesh_reader
from tests.support import angles, lanes, maps, scenes
from tests.support.real_meshes import FAST, PAIRS, open_pair

pytestmark = [pytest.mark.usefixtures("gpu_context"), pytest.mark.shared]

QUICK = [(name, "pairs") for name in FAST]
FILES = QUICK + [(name, "pairs") for name in PAIRS[:-1] if name not in {*FAST, "spot_control_vs_subd5"}]
FILES += [(name, "layers") for name in ("collar", "fingers", "folds")]
BETTER = 0.1
"""Factor on the mean error: Cast's must be this much less than Flatten's where Auto takes Cast."""

MISSED = 1e-3
"""Share of the texels whose rays may hit nothing."""


def turned_islands(obj, uv):
    """Each island turned by 180 degrees in its place."""
    with mesh_reader.base(obj) as data:
        mesh = mesh_reader.surface(data, data.uv_layers.active.name, obj.name, mesh_reader.matrix(obj))
    island = np.zeros(len(uv), int)
    island[mesh.triangles] = uv_islands.islands(mesh)[:, None]
    low, high = np.full((2, island.max() + 1, 2), np.inf)
    high[:] = -np.inf
    np.minimum.at(low, island, uv)
    np.maximum.at(high, island, uv)
    return low[island] + high[island] - uv


CHANGES = {
    "turned islands": turned_islands,
    "a quarter turn": lambda obj, uv: np.stack([1.0 - uv[:, 1], uv[:, 0]], axis=1),
    "mirrored": lambda obj, uv: uv * (-1.0, 1.0) + (1.0, 0.0),
    "packed into a corner": lambda obj, uv: uv * 0.4 + 0.05,
    "on another tile": lambda obj, uv: uv + (1.0, 0.0),
}


def bake(low, high, method):
    report = scenes.bake(low, high, method=method, space="WORLD", image="map", size=256)
    return maps.pixels(bpy.data.images["map"]), report


def error(texels, truth):
    """The mean angle in degrees where both have a value."""
    both = (texels[..., 3] > 0.0) & (truth[..., 3] > 0.0)
    return angles.degrees(angles.decode(texels), angles.decode(truth))[both].mean() if both.any() else 180.0


@pytest.mark.parametrize("file", lanes.slow_but(QUICK, FILES), ids=str)
def test_shared_uvs_are_flattened(shared_assets, file):
    _, report = bake(*open_pair(shared_assets, *file), "AUTO")
    assert report.method == "FLATTEN", report.why


CHANGED = lanes.in_turn(QUICK, FILES, CHANGES)


@pytest.mark.parametrize("case", lanes.slow_but(CHANGED[: len(CHANGES)], CHANGED), ids=str)
def test_other_uvs_are_cast(shared_assets, case):
    """The truth is Flatten's map with the UVs that the meshes shared."""
    file, change = case
    low, high = open_pair(shared_assets, *file)
    truth, _ = bake(low, high, "FLATTEN")
    layer = high.data.uv_layers.active.uv
    uv = np.empty((len(layer), 2), np.float32)
    layer.foreach_get("vector", uv.reshape(-1))
    layer.foreach_set("vector", CHANGES[change](high, uv).astype(np.float32).ravel())
    high.data.update()
    texels, report = bake(low, high, "AUTO")
    assert report.method == "CAST", report.why
    cast = error(texels, truth)
    try:
        flat = error(bake(low, high, "FLATTEN")[0], truth)
    except BakeError:
        flat = 180.0  # no texel in common
    print(f"{file}, {change}: Cast {cast:.2f} degrees, Flatten {flat:.2f} degrees")
    assert report.missed < MISSED
    assert cast < BETTER * flat
