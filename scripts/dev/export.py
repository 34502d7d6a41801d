# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes pairs as .npz, with the tree over the high mesh, for scripts/dev/hardware.py on a machine without Blender."""

import argparse
import sys
from pathlib import Path

import bpy
import gpu
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import addon  # noqa: E402
from addon.core import progress, udim  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.core.timings import Timings  # noqa: E402
from addon.engine.method_choice import choose_method  # noqa: E402
from addon.engine.sources import normal_source  # noqa: E402
from addon.mesh import triangle_mesh  # noqa: E402
from addon.mesh.spatial import bvh  # noqa: E402
from addon.scene import reading  # noqa: E402


def export(source: Path, target: Path) -> None:
    """Write the objects 'hi' and 'lo' of a .blend as the arrays that the Flatten and Cast passes take."""
    bpy.ops.wm.open_mainfile(filepath=str(source))
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    settings = Settings(method="CAST", space="WORLD", width=512, height=512)
    meshes = reading.read(bpy.context, low, [high], None, settings)
    plan = choose_method(meshes, [udim.FIRST], settings)
    meshes, ray_cast = plan.meshes, progress.finish(normal_source(plan, settings, Timings(), progress.Pace())).ray_cast
    ray_scene = ray_cast.ray_scene
    (mesh,) = meshes.highs
    laid_flat = reading.read(bpy.context, low, [high], None, Settings(method="FLATTEN", space="WORLD")).highs[0]
    points = ray_scene.local_space.points(mesh)
    tree = bvh.build(points, mesh.vertices[mesh.triangles])
    triangles = mesh.triangles[tree.order]
    np.savez_compressed(
        target,
        high_triangles=laid_flat.triangles,
        high_uv=laid_flat.uv,
        high_normal=laid_flat.normals @ triangle_mesh.normal_matrix(laid_flat.to_world).T,
        low_triangles=meshes.low.triangles,
        low_uv=meshes.low.uv,
        low_position=ray_scene.local_space.points(meshes.low)[meshes.low.vertices],
        low_direction=meshes.low.to_world_normals(meshes.directions),
        nodes=tree.nodes.reshape(-1, 4),
        corners=points[mesh.vertices[triangles]].reshape(-1, 3),
        normals=mesh.to_world_normals(mesh.normals)[triangles].reshape(-1, 3),
        first_leaf=tree.first_leaf,
        origin=tree.origin,
        scale=tree.scale,
        extrusion=ray_cast.start_offset,
        reach=ray_cast.max_t,
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="export.py", description=__doc__)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.blend")
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "export", metavar="DIR")
    options = parser.parse_args()
    gpu.init()
    options.output.mkdir(parents=True, exist_ok=True)
    for path in options.files:
        export(path, options.output / f"{path.stem}.npz")
    addon.free()


if __name__ == "__main__":
    main()
