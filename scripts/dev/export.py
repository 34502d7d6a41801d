# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes pairs as .npz, with the trees that rays need, for scripts/dev/hardware.py on a machine without Blender."""

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
from addon.core.settings import Run, Settings  # noqa: E402
from addon.engine.method_choice import choose_method  # noqa: E402
from addon.engine.rays import ray_casting  # noqa: E402
from addon.engine.sources import normal_source  # noqa: E402
from addon.mesh import triangle_mesh  # noqa: E402
from addon.passes import target  # noqa: E402
from addon.passes.bake import rays  # noqa: E402
from addon.scene import reading  # noqa: E402


def export(source: Path, into: Path) -> None:
    """Write the objects 'hi' and 'lo' of a .blend as the arrays that the Flatten and Cast passes take."""
    bpy.ops.wm.open_mainfile(filepath=str(source))
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    settings = Settings(method="CAST", space="WORLD", width=512, height=512)
    meshes = reading.read(bpy.context, low, [high], None, settings)
    plan = choose_method(meshes, [udim.FIRST], settings.tracing)
    meshes, ray_cast = plan.meshes, progress.finish(normal_source(plan, Run(settings))).ray_cast
    ray_scene = ray_cast.ray_scene
    low_surface, edges = ray_cast.low, ray_cast.directions.edges
    trees = {"": ray_scene.tables, "low_": low_surface.owners, "edge_": edges}
    laid_flat = reading.read(bpy.context, low, [high], None, Settings(method="FLATTEN", space="WORLD")).highs[0]
    low_vertices = rays.vertices(
        meshes.low.triangles,
        low_surface.starts,
        uv=meshes.low.uv,
        **ray_casting.ray_arrays(meshes, ray_scene.local_space),
    )
    unit = ray_scene.local_space.size
    np.savez_compressed(
        into,
        high_triangles=laid_flat.triangles,
        high_uv=laid_flat.uv,
        high_normal=laid_flat.normals @ triangle_mesh.normal_matrix(laid_flat.to_world).T,
        **{f"low_{name}": values for name, values in low_vertices.items()},
        **{name: table(getattr(ray_scene.tables, name)) for name in ("triangles", "points", "normals")},
        low_corners=table(low_surface.owners.corners),
        edge_ends=table(edges.ends),
        **{
            f"{prefix}{name}": value
            for prefix, tree in trees.items()
            for name, value in (
                ("nodes", table(tree.nodes)),
                ("first_leaf", tree.first_leaf),
                ("origin", tree.origin),
                ("scale", tree.scale),
            )
        },
        straight_share=ray_cast.directions.straight_share,
        blend_width=ray_cast.directions.blend_width,
        start_offset=ray_cast.extrusion / unit,
        near=low_surface.owners.room,
        inside=(ray_cast.max_distance - ray_cast.extrusion) / unit,
    )


def table(texture: gpu.types.GPUTexture) -> np.ndarray:
    """The texels (N, 4) float32 of a data texture, with the zeros at its end."""
    texels = np.empty((texture.height, texture.width, 4), np.float32)
    target.read(texture, texels)
    return texels.reshape(-1, 4)


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
