#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes assets with levels of rigged high meshes, poses them, and compares each level with the posed high mesh.

    .venv/bin/python scripts/dev/rigged_assets.py [--npm DIR] [--levels N] [--own-textures] [spot character]

spot of ../shared/assets, subdivided, gets five bones in a row; the character, with fingers that nearly touch, is made here.
Both get Blender's automatic weights and two shape keys. For each level at rest and in three poses, a table has what Blender
shows: the mean distance from the posed high mesh, in percent of its diagonal, and the angle between their normals, without a
map. With --npm, three.js draws the .glb of each level as well (as characters.py, it needs Chromium and npm): the mean angle
between its normals, with the map, and those of the high mesh, posed as engines pose it: they turn normals by the mixed matrices
of the bones, where Blender makes them anew from the posed faces.

Ends with 1 if a level in a pose is more than a degree worse than the finest one in that pose, beyond what it is worse at rest.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402  it has gpu
import gpu  # noqa: E402
from mathutils import Quaternion, Vector  # noqa: E402

import addon  # noqa: E402
from addon.core.asset_limits import Wanted  # noqa: E402
from addon.core.declarations import targets  # noqa: E402
from addon.core.naming import Suffixes  # noqa: E402
from addon.core.progress import Pace, finish  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.export import engine_files  # noqa: E402
from addon.jobs import asset  # noqa: E402
from addon.jobs.job import Job  # noqa: E402
from addon.mesh.closest import Surface  # noqa: E402
from addon.mesh.fitting import surface_samples  # noqa: E402
from addon.mesh.triangles import barycentric  # noqa: E402
from scripts.dev import assets_in_three, characters  # noqa: E402
from scripts.dev.in_engines import chromium, samples  # noqa: E402
from scripts.dev.in_engines.glb_file import Glb, unit  # noqa: E402
from tests.support import angles, scenes  # noqa: E402

SPOT = ROOT / ".." / "shared" / "assets" / "pairs" / "spot_1696_536.blend"
MORE = 1.0
"""Degrees by which a pose may add to the error of a level more than to that of the finest one."""
SAMPLES = 20_000
LIMBS = {
    "spine": ((0.0, 0.0, 1.0), (0.0, 0.0, 1.45)),
    "head": ((0.0, 0.0, 1.5), (0.0, 0.0, 1.8)),
    **{f"arm.{side}": ((0.15 * x, 0.0, 1.4), (0.6 * x, 0.0, 1.4)) for side, x in (("L", 1), ("R", -1))},
    **{f"leg.{side}": ((0.13 * x, 0.0, 0.95), (0.16 * x, 0.0, 0.1)) for side, x in (("L", 1), ("R", -1))},
    **{
        f"finger{number}.{side}": ((0.6 * x, 0.05 * number, 1.4), (0.8 * x, 0.06 * number, 1.4))
        for number in (-1, 0, 1)
        for side, x in (("L", 1), ("R", -1))
    },
}
"""The bones of the character: head and tail."""
THICK = {"spine": 0.2, "head": 0.16, "arm": 0.07, "leg": 0.1, "finger": 0.024}
"""The radii of the limbs around them."""


KEYS = "wide", "twist"


@dataclass(frozen=True)
class Pose:
    """How far bones are turned, in degrees, every second one the other way, and the value of the shape keys."""

    degrees: float
    keys: float


POSES = {"rest": Pose(0.0, 0.0), "bent": Pose(25.0, 0.0), "extreme": Pose(60.0, 0.0), "keys": Pose(25.0, 1.0)}


def spot() -> tuple[bpy.types.Object, bpy.types.Object]:
    bpy.ops.wm.open_mainfile(filepath=str(SPOT))
    bpy.data.objects.remove(bpy.data.objects["lo"])
    bpy.context.view_layer.update()
    high = bpy.data.objects["hi"]
    subdivide(high, 2)
    points = characters.world_points(high)
    along = np.linspace(points[:, 1].min(), points[:, 1].max(), 6)
    middles = [points[np.abs(points[:, 1] - y) < 0.2].mean(axis=0) for y in along]
    return high, rigged(high, {f"part{n}": (middles[n], middles[n + 1]) for n in range(5)}, is_chain=True)


def character() -> tuple[bpy.types.Object, bpy.types.Object]:
    """Capsules along LIMBS, joined by voxels, with folds."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    parts = []
    for name, (head, tail) in LIMBS.items():
        bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=16)
        ball = bpy.context.active_object
        ball.data.materials.clear()
        radius = THICK[name.split(".")[0].rstrip("-01")]
        way = Vector(tail) - Vector(head)
        points = characters.points_of(ball.data) * radius
        points[:, 2] += np.where(points[:, 2] > 0.0, 0.5, -0.5) * way.length
        turn = np.array(Vector((0.0, 0.0, 1.0)).rotation_difference(way).to_matrix())
        moved = points @ turn.T + np.array((Vector(head) + Vector(tail)) / 2.0)
        ball.data.vertices.foreach_set("co", moved.astype(np.float32).reshape(-1))
        parts.append(ball)
    scenes.select(parts[0], *parts[1:])
    bpy.ops.object.join()
    high = bpy.context.active_object
    high.name = "hero_high"
    remesh = high.modifiers.new("Remesh", "REMESH")
    remesh.mode, remesh.voxel_size, remesh.use_smooth_shade = "VOXEL", 0.012, True
    smooth = high.modifiers.new("Smooth", "SMOOTH")
    smooth.iterations = 4
    for modifier in list(high.modifiers):
        bpy.ops.object.modifier_apply(modifier=modifier.name)
    points = characters.points_of(high.data)
    normals = np.array([normal.vector for normal in high.data.vertex_normals])
    folds = 0.004 * np.sin(60.0 * points[:, 2:] + 8.0 * points[:, :1])
    high.data.vertices.foreach_set("co", (points + folds * normals).astype(np.float32).reshape(-1))
    return high, rigged(high, LIMBS, is_chain=False)


def subdivide(high: bpy.types.Object, levels: int) -> None:
    high.modifiers.new("Subdivision", "SUBSURF").levels = levels
    scenes.select(high)
    bpy.ops.object.modifier_apply(modifier="Subdivision")


def rigged(high: bpy.types.Object, bones: dict, *, is_chain: bool) -> bpy.types.Object:
    """An armature with automatic weights for the high mesh, which gets two shape keys.

    is_chain: each bone follows the last one; else all follow the first.
    """
    rig = scenes.link(bpy.data.objects.new("rig", bpy.data.armatures.new("rig")))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    made = []
    for name, (head, tail) in bones.items():
        bone = rig.data.edit_bones.new(name)
        bone.head, bone.tail = head, tail
        arm = rig.data.edit_bones.get(f"arm.{name[-1]}") if name.startswith("finger") else None
        bone.parent = arm or (made[-1 if is_chain else 0] if made else None)
        made.append(bone)
    bpy.ops.object.mode_set(mode="OBJECT")
    scenes.select(rig, high)
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    places = characters.points_of(high.data)
    size = float(np.ptp(places, axis=0).max())
    share = (places - places.min(axis=0)) / size
    high.shape_key_add(name="Basis")
    wide = 0.3 * (share - share.mean(axis=0)) * np.sin(np.pi * share[:, 2:])
    twist = 0.08 * np.roll(np.sin(5.0 * share), 1, axis=1)
    for name, offset in zip(KEYS, (wide, twist), strict=True):
        key = high.shape_key_add(name=name)
        key.points.foreach_set("co", (places + offset * size).astype(np.float32).reshape(-1))
        key.value = 0.0
    return rig


def put(rig: bpy.types.Object, objects: Sequence[bpy.types.Object], pose: Pose) -> None:
    for number, bone in enumerate(rig.pose.bones):
        bone.rotation_mode = "QUATERNION"
        axis = ((1.0, 0.0, 0.3), (-1.0, 0.3, 0.0), (0.0, 0.2, 1.0))[number % 3]
        share = 0.6 if bone.parent is None else 1.0
        bone.rotation_quaternion = Quaternion(Vector(axis).normalized(), np.radians(share * pose.degrees))
    for obj in objects:
        for key in obj.data.shape_keys.key_blocks[1:]:
            key.value = pose.keys
    bpy.context.view_layer.update()


def shown(obj: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """The triangles of an object by corner as Blender shows it, in the axes of glTF: points and normals (T, 3, 3)."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    data, matrix = evaluated.to_mesh(), np.array(evaluated.matrix_world)
    data.calc_loop_triangles()
    corners = np.array([triangle.loops for triangle in data.loop_triangles])
    vertices = np.array([loop.vertex_index for loop in data.loops])
    points = characters.points_of(data) @ matrix[:3, :3].T + matrix[:3, 3]
    normals = np.array([corner.vector for corner in data.corner_normals]) @ np.linalg.inv(matrix[:3, :3])
    return (points @ samples.TO_GLTF.T)[vertices[corners]], (unit(normals) @ samples.TO_GLTF.T)[corners]


def engine_normals(high: bpy.types.Object, rig: bpy.types.Object, pose: Pose) -> np.ndarray:
    """The normals (T, 3, 3) of the triangles of the high mesh, as `shown` has them in a pose, but as engines turn them."""
    put(rig, [high], POSES["rest"])
    found = rest = shown(high)[1]
    for key in high.data.shape_keys.key_blocks[1:] if pose.keys else ():
        key.value = 1.0
        found = found + pose.keys * (shown(high)[1] - rest)
        key.value = 0.0
    put(rig, [high], pose)
    deltas = characters.joint_deltas(characters.Rig(rig, None, None))
    weights = np.zeros((len(high.data.vertices), len(high.vertex_groups)))
    for vertex in high.data.vertices:
        for one in vertex.groups:
            weights[vertex.index, one.group] = one.weight
    weights /= weights.sum(axis=1, keepdims=True)
    turns = np.stack([deltas[group.name][:3, :3] for group in high.vertex_groups])
    mixed = np.einsum("vg,gab->vab", weights, turns)
    high.data.calc_loop_triangles()
    vertices = np.array([triangle.vertices for triangle in high.data.loop_triangles])
    return unit(np.einsum("tcab,tcb->tca", mixed[vertices], unit(found)))


def compared(low: tuple[np.ndarray, np.ndarray], high: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    """The mean distance of samples of the high mesh from the low one, in percent of its diagonal, and the mean degrees between
    their normals there."""
    points, numbers = high[0].reshape(-1, 3), np.arange(high[0].size // 3).reshape(-1, 3)
    found = surface_samples(points, numbers, SAMPLES)
    weights = barycentric(found.points, high[0][found.triangles])
    expected = unit(np.einsum("ncx,nc->nx", high[1][found.triangles], weights))
    flat, of_low = low[0].reshape(-1, 3).astype(np.float32), np.arange(low[0].size // 3).reshape(-1, 3)
    nearest, where, squares = Surface(flat, of_low).closest(found.points.astype(np.float32))
    weights = barycentric(where.astype(np.float64), low[0][nearest])
    normals = unit(np.einsum("ncx,nc->nx", low[1][nearest], weights))
    diagonal = np.linalg.norm(np.ptp(points, axis=0))
    return 100.0 * float(np.sqrt(squares).mean()) / diagonal, float(angles.degrees(normals, expected).mean())


def exported(report) -> Glb:
    """The .glb of one level."""
    with tempfile.TemporaryDirectory() as folder:
        engine_files.export_files(bpy.context, [[report]], Path(folder) / "level.glb")
        return Glb.read(Path(folder) / "level.glb")


def measure(name: str, given: argparse.Namespace, modules: Path | None) -> bool:
    """Print the table of one high mesh. Returns whether a pose makes a level worse by more than MORE."""
    high, rig = {"spot": spot, "character": character}[name]()
    put(rig, [high], POSES["extreme"])  # as a mesh lies in files of animators
    settings = Settings(width=given.size, height=given.size, storage="PACK", basis=targets.BY_NAME["three"].basis.name)
    wanted = Wanted(triangles=given.triangles, levels=given.levels, owns_textures=given.own_textures)
    work = asset.work(bpy.context, Job(high, [high]), wanted, settings, Pace(), suffixes=Suffixes())
    reports = finish(work)
    lows = [bpy.data.objects[report.low] for report in reports]
    print(f"{name}, {reports[0].triangles['high']:,} triangles; percent, degrees in Blender, degrees in three.js")
    bones = [len([one for one in vertex.groups if one.weight > 0.0]) for low in lows for vertex in low.data.vertices]
    sums = [sum(one.weight for one in vertex.groups) for low in lows for vertex in low.data.vertices]
    print(f"  bones a vertex: {min(bones)} to {max(bones)}, sums {min(sums):.6f} to {max(sums):.6f}")
    if given.save is not None:
        bpy.ops.wm.save_as_mainfile(filepath=str(given.save / f"{name}.blend"), copy=True)
    is_far, glbs = False, [exported(report) for report in reports] if modules is not None else []
    errors = {}
    for pose_name, pose in POSES.items():
        put(rig, [high, *lows], pose)
        turned = engine_normals(high, rig, pose) if modules is not None else None
        truth, deltas = shown(high), characters.joint_deltas(characters.Rig(rig, None, None))
        for level, low in enumerate(lows):
            far, bare = compared(shown(low), truth)
            line = f"  {pose_name:8} LOD{level} {len(low.data.polygons):6,} {far:8.4f} {bare:7.2f}"
            error = bare
            if modules is not None:
                posed = characters.posed(glbs[level], deltas, dict.fromkeys(KEYS, pose.keys))
                degrees, single = assets_in_three.compared(
                    posed, (truth[0], turned), modules, given.view, shape=characters.deformed(posed)
                )
                error = float(degrees.mean())
                line += f" {error:7.2f} {single:7.2%} outline"
            errors[pose_name, level] = error
            print(line, flush=True)
    for pose_name in POSES:
        for level in range(1, len(lows)):
            more = [errors[pose_name, one] - errors["rest", one] for one in (0, level)]
            is_far |= more[1] - more[0] > MORE
    return is_far


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=[], metavar="NAME")
    parser.add_argument("--triangles", type=int, default=4000, metavar="N")
    parser.add_argument("--levels", type=int, default=3, metavar="N")
    parser.add_argument("--own-textures", action="store_true")
    parser.add_argument("--size", type=int, default=1024, metavar="TEXELS")
    parser.add_argument("--view", type=int, default=512, metavar="PIXELS")
    parser.add_argument("--save", type=Path, metavar="DIR", help="where to save .blend files with the levels")
    parser.add_argument("--npm", type=Path, metavar="DIR")
    given = parser.parse_args()
    gpu.init()
    try:
        modules = chromium.install(given.npm) if given.npm else None
        return int(sum(measure(name, given, modules) for name in given.names or ("spot", "character")) > 0)
    except chromium.NoEngine as error:
        sys.exit(f"rigged_assets.py: {error}")
    finally:
        addon.free()


if __name__ == "__main__":
    sys.exit(main())
