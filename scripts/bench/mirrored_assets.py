# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes assets of high meshes that equal their mirror images, and looks whether the low ones do, and what Stack Mirrored saves.

.venv/bin/python scripts/bench/mirrored_assets.py [prop] [spot] [character] [--triangles 1500] [--levels 1] [--size 512]

prop is a bumpy block with plates. spot of ../shared/assets and the character have an armature, as rigged_assets.py makes
them. For each level: vertices without one that is exactly their mirror image, the largest difference of weights there, with the
bones of the other side, and the mean shading error with that of outlines. For the first level, without and with Stack Mirrored:
the share of the map that islands cover, the texels along a unit of length, the share that would be covered with as many texels
as without, and the mean shading error.
"""

import argparse
import sys
from pathlib import Path

import bpy
import gpu
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.core.asset_limits import Mending, Wanted  # noqa: E402
from addon.core.declarations.choices import Symmetry  # noqa: E402
from addon.core.naming import Suffixes  # noqa: E402
from addon.core.progress import Pace, finish  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import asset  # noqa: E402
from addon.jobs.job import Job  # noqa: E402
from addon.mesh.topology import places  # noqa: E402
from addon.mesh.triangles import face_areas  # noqa: E402
from addon.scene import mesh_reader  # noqa: E402
from scripts.bench import made_highs, unwrap_shapes  # noqa: E402
from scripts.dev import rigged_assets  # noqa: E402
from tests.support import spoiled  # noqa: E402

OTHER_SIDE = {".L": ".R", ".R": ".L"}


def prop() -> bpy.types.Object:
    """A block with rounded corners and bumps, the same on both sides of x = 0, and a plate on each side."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    made = made_highs.ball(120, np.random.default_rng(3), 0)
    away = made.points / np.linalg.norm(made.points, axis=1, keepdims=True)
    block = away / (np.abs(away) ** 6.0).sum(axis=1, keepdims=True) ** (1.0 / 6.0)
    x, y, z = block.T
    bumps = np.sin(14.0 * np.abs(x) + 3.0 * y) * np.sin(11.0 * z + 4.0 * y)
    made = spoiled.Soup(block * (1.0, 0.7, 0.5) + 0.02 * bumps[:, None] * away, made.triangles)
    for side in (-1.0, 1.0):
        low, high = np.sort((1.05 * side, 1.2 * side)), (0.4, 0.3)
        made = spoiled.joined(made, made_highs.box((low[0], -0.4, -0.3), (low[1], *high), 8))
    return spoiled.build("hi", made)


HIGHS = {
    "prop": prop,
    "spot": lambda: mirrored(rigged_assets.spot()[0]),
    "character": lambda: mirrored(rigged_assets.character()[0]),
}


def mirrored(high: bpy.types.Object) -> bpy.types.Object:
    """A high mesh whose half above x = 0 is on both sides, with its weights: no file at hand is the same there."""
    bpy.context.view_layer.objects.active = high
    high.shape_key_clear()
    modifier = high.modifiers.new("Mirror", "MIRROR")
    modifier.use_bisect_axis[0] = True
    bpy.ops.object.modifier_move_to_index(modifier=modifier.name, index=0)
    bpy.ops.object.modifier_apply(modifier=modifier.name)
    return high


def made(high: bpy.types.Object, options: argparse.Namespace, *, stacks: bool) -> list:
    """The reports of an asset and its levels."""
    wanted = Wanted(
        triangles=options.triangles, levels=options.levels, mending=Mending(symmetry=Symmetry.X), stacks_mirrored=stacks
    )
    settings = Settings(width=options.size, height=options.size, samples=1, storage="MEMORY")
    return finish(asset.work(bpy.context, Job(high, [high]), wanted, settings, Pace(), suffixes=Suffixes()))


def unlike(low: bpy.types.Object) -> tuple[int, float]:
    """How many vertices have none that is their mirror image to the bit, and the largest difference of weights between two."""
    points = mesh_reader.points(low.data).astype(np.float64)
    image = points.copy()
    image[:, 0] = points[:, 0].min() + points[:, 0].max() - points[:, 0]
    count = len(points)
    same = places(np.concatenate([points, image]).astype(np.float32))[count:]
    is_there = same < count
    weights = np.zeros((count, len(low.vertex_groups)))
    for vertex in low.data.vertices:
        for one in vertex.groups:
            weights[vertex.index, one.group] = one.weight
    names = [group.name for group in low.vertex_groups]
    other = [names.index(name[:-2] + OTHER_SIDE[name[-2:]] if name[-2:] in OTHER_SIDE else name) for name in names]
    apart = np.abs(weights[is_there] - weights[same[is_there]][:, other])
    return int(count - is_there.sum()), float(apart.max(initial=0.0))


def use(low: bpy.types.Object, size: int) -> tuple[float, float]:
    """The share of the map that islands cover, each place once, and the texels along a unit of length."""
    mesh = unwrap_shapes.read(low)
    uv, points = mesh.uv[mesh.triangles].astype(np.float64), mesh.positions[mesh.vertices[mesh.triangles]]
    of_uv, area = 0.5 * np.abs(np.linalg.det(uv[:, 1:] - uv[:, :1])), face_areas(points)
    _, first = np.unique(np.round(np.sort(uv @ (1.0, 1.0j), axis=1), 5), axis=0, return_index=True)
    return float(of_uv[first].sum()), size * float(np.sqrt(of_uv.sum() / area.sum()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--triangles", type=int, default=1500, metavar="N")
    parser.add_argument("--levels", type=int, default=1, metavar="N")
    parser.add_argument("--size", type=int, default=512, metavar="TEXELS")
    options = parser.parse_args()
    gpu.init()
    for name in options.names or HIGHS:
        known = None
        for stacks in (False, True):
            high = HIGHS[name]()
            reports = made(high, options, stacks=stacks)
            lows = [bpy.data.objects[report.low] for report in reports]
            if not stacks:
                for level, low in enumerate(lows):
                    (alone, apart), seen = unlike(low), reports[level].appearance
                    print(
                        f"{name} LOD{level}: {len(low.data.polygons):,} triangles, {alone} of {len(low.data.vertices):,} "
                        f"vertices without a mirror image, weights differ by at most {apart:.4f}; "
                        f"{seen['mean']:.3f} degrees, {seen['silhouette']:.2%} outline",
                        flush=True,
                    )
            covered, density = use(lows[0], options.size)
            known = known or density
            print(
                f"  {'stacked' if stacks else 'apart':8} {covered:6.1%} covered, {density:6.1f} texels along a unit, "
                f"{covered * (known / density) ** 2:6.1%} at equal density; {reports[0].appearance['mean']:.2f} degrees",
                flush=True,
            )


if __name__ == "__main__":
    main()
