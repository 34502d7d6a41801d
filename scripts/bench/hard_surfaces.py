# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures game assets of machine parts: whether planes stay planes, straight edges straight, and flat sides flat in the map.

.venv/bin/python scripts/bench/hard_surfaces.py [PART ...] [--share 0.1] [--size 512] [--pictures FOLDER] [FILE.stl ...]

Parts are those of tests/support/cad_parts.py, all without an argument. A line each: triangles; how far places of the high
mesh's large planes lie from the low mesh across them, at the 99th percentile in percent of the diagonal, and for how many of
them nothing stands; how far places of the straight edges between them lie from the low mesh's edges; the mean angle by area
between corners' normals and their faces, of all and of flat sides alone (on a round of N sides it is 180 / N degrees by
itself); islands on each planar side in the mean, and in all; the outline, and the mean
shading error. --pictures renders the high mesh and the asset by Cycles and EEVEE beside each other.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import gpu
import numpy as np
from mathutils import Vector

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.core.asset_limits import Wanted  # noqa: E402
from addon.core.naming import Suffixes  # noqa: E402
from addon.core.progress import Pace, finish  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import asset  # noqa: E402
from addon.jobs.job import Job  # noqa: E402
from addon.mesh import topology, uv_islands  # noqa: E402
from addon.mesh.closest import Surface  # noqa: E402
from addon.mesh.edges import partners  # noqa: E402
from addon.mesh.topology import EdgeTable  # noqa: E402
from addon.mesh.welding import weld  # noqa: E402
from addon.scene import mesh_reader  # noqa: E402
from tests.support import cad_parts  # noqa: E402

LARGE = 0.01
"""The share of the area from which the triangles on a plane are one of its sides."""
SAMPLES = 1000
"""On each side."""
GONE = 0.005
"""The share of the diagonal from which a plane is no longer there: it was closed."""
SHARP = np.radians(40.0)
"""The angle from which edges of the high mesh are sharp."""
VIEW = Vector((0.75, -1.0, 0.7))
"""Towards the camera of pictures."""


@dataclass(frozen=True)
class Sides:
    """The large planes of a high mesh.

    Attributes:
        of: (T,) int, that of each triangle, -1 for none.
        is_flat: (T,) bool, which triangles are flat for the high mesh, too: those of a large plane, and those of a small one
            that sharp edges alone part from others. The rest is round: its smooth normals differ from faces.
    """

    points: np.ndarray
    triangles: np.ndarray
    of: np.ndarray
    is_flat: np.ndarray

    @classmethod
    def of_mesh(cls, points: np.ndarray, triangles: np.ndarray) -> "Sides":
        corners = points[triangles].astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1) / 2.0
        units = normals / np.maximum(2.0 * areas, 1e-300)[:, None]
        size = np.linalg.norm(np.ptp(points, axis=0))
        offsets = (units * corners.mean(axis=1)).sum(axis=1) / size
        keys = np.round(np.column_stack([units, offsets]) * 500.0).astype(np.int64)
        _, labels = np.unique(keys, axis=0, return_inverse=True)
        one, other = (side // 3 for side in EdgeTable.of(triangles).pairs)
        same = labels.reshape(-1)[one] == labels.reshape(-1)[other]
        labels = topology.connected(len(triangles), one[same], other[same])
        of_each = np.bincount(labels, areas, len(triangles))
        # Of a cylinder's strips, none is a side: it turns little to another one that is as large.
        apart = labels[one] != labels[other]
        one, other = one[apart], other[apart]
        turns = (units[one] * units[other]).sum(axis=1)
        ratio = of_each[labels[one]] / np.maximum(of_each[labels[other]], 1e-300)
        bends = (turns > np.cos(np.radians(20.0))) & (ratio > 0.5) & (ratio < 2.0)
        is_large = of_each > LARGE * areas.sum()
        is_large[labels[one[bends]]] = is_large[labels[other[bends]]] = False
        is_soft = turns > np.cos(SHARP)
        is_round = np.zeros(len(triangles), bool)
        is_round[labels[one[is_soft]]] = is_round[labels[other[is_soft]]] = True
        is_flat = (is_large | ~is_round)[labels]
        return cls(points, triangles, np.where(is_large[labels], labels, -1), is_flat)

    def off(self, points: np.ndarray, triangles: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """How far places (N,) on the planes lie from the triangles of a low mesh that face the same way, across the planes:
        infinite where there is none above or below."""
        faces = np.cross(*(points[triangles[:, corner]] - points[triangles[:, 0]] for corner in (1, 2)))
        faces /= np.maximum(np.linalg.norm(faces, axis=1), 1e-300)[:, None]
        size, result = np.linalg.norm(np.ptp(self.points, axis=0)), [np.zeros(0)]
        for side in np.unique(self.of[self.of >= 0]):
            corners = self.points[self.triangles[self.of == side]].astype(np.float64)
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            areas = np.linalg.norm(normals, axis=1)
            normal = normals.sum(axis=0) / areas.sum()
            picked = rng.choice(len(corners), SAMPLES, p=areas / areas.sum())
            places = (corners[picked] * rng.dirichlet((1.0, 1.0, 1.0), SAMPLES)[..., None]).sum(axis=1)
            alike = triangles[faces @ normal > np.cos(np.radians(45.0))]
            if not len(alike):
                result.append(np.full(SAMPLES, np.inf))
                continue
            away = Surface(points.astype(np.float32), alike).closest(places.astype(np.float32))[1] - places
            across = away @ normal
            within = np.linalg.norm(away - across[:, None] * normal, axis=1)
            is_there = (within < np.maximum(np.abs(across), 1e-5 * size)) & (np.abs(across) < GONE * size)
            result.append(np.where(is_there, np.abs(across), np.inf))
        return np.concatenate(result)

    def edges(self) -> np.ndarray:
        """The edges (E, 2, 3) between two of them."""
        sides = np.stack([self.triangles.reshape(-1), np.roll(self.triangles, -1, axis=1).reshape(-1)], axis=1)
        other = partners(self.points, sides)
        one = np.flatnonzero((other >= 0) & (np.arange(len(other)) < other))
        beside = self.of[one // 3], self.of[other[one] // 3]
        is_edge = (beside[0] != beside[1]) & (beside[0] >= 0) & (beside[1] >= 0)
        return self.points[sides[one[is_edge]]].astype(np.float64)


def flat_ones(sides: Sides, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which triangles (T,) bool of a low mesh stand for a large plane, or for faces with sharp edges alone around."""
    nearest, _, _ = Surface(sides.points.astype(np.float32), sides.triangles).closest(
        points[triangles].mean(axis=1).astype(np.float32)
    )
    return sides.is_flat[nearest]


def far_from_segments(places: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """The distance (N,) of places (N, 3) from the nearest of segments (E, 2, 3)."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    lengths = np.maximum((along**2).sum(axis=1), 1e-300)
    result = []
    for some in np.array_split(places, max(1, len(places) * len(segments) // 2_000_000)):
        away = some[:, None] - start
        share = np.clip((away * along).sum(axis=2) / lengths, 0.0, 1.0)
        result.append(np.linalg.norm(away - share[..., None] * along, axis=2).min(axis=1))
    return np.concatenate(result)


def measured(sides: Sides, low: bpy.types.Object) -> dict[str, float]:
    """The figures of a low object, but those of its report."""
    rng = np.random.default_rng(3)
    size = float(np.linalg.norm(np.ptp(sides.points, axis=0)))
    to_world = mesh_reader.matrix(low)
    mesh = mesh_reader.surface(low.data, low.data.uv_layers.active.name, low.name, to_world)
    points = mesh.positions.astype(np.float64) @ to_world[:3, :3].T + to_world[:3, 3]
    triangles = mesh.vertices[mesh.triangles]
    away = sides.off(points, triangles, rng)
    corners = points[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(faces, axis=1)
    faces /= np.maximum(areas, 1e-300)[:, None]
    cosines = np.clip((mesh.normals[mesh.triangles] * faces[:, None]).sum(axis=2), -1.0, 1.0)
    degrees = np.degrees(np.arccos(cosines)).mean(axis=1)
    is_flat = flat_ones(sides, points, triangles)
    # A low edge that turns, as segments
    both = np.stack([triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)], axis=1)
    other = partners(points.astype(np.float32), both)
    one = np.flatnonzero((other >= 0) & (np.arange(len(other)) < other))
    turns = (faces[one // 3] * faces[other[one] // 3]).sum(axis=1) < np.cos(np.radians(20.0))
    segments, of_high = points[both[one[turns]]], sides.edges()
    edges_off = 0.0
    if len(of_high):
        lengths = np.linalg.norm(of_high[:, 1] - of_high[:, 0], axis=1)
        picked = of_high[rng.choice(len(of_high), 4000, p=lengths / lengths.sum())]
        share = rng.random(4000)[:, None]
        edges_off = float(
            np.percentile(far_from_segments(picked[:, 0] * share + picked[:, 1] * (1.0 - share), segments), 99)
        )
    return {
        "planes": float(np.percentile(away[np.isfinite(away)], 99)) / size,
        "gone": 1.0 - float(np.isfinite(away).mean()),
        "edges": edges_off / size,
        "normals": float((degrees * areas).sum() / areas.sum()),
        "flat": float((degrees * areas)[is_flat].sum() / max(areas[is_flat].sum(), 1e-300)),
        **_islands(sides, mesh, points, faces, areas),
    }


def _islands(sides: Sides, mesh, points, faces, areas) -> dict[str, float]:
    """How many islands lie on a planar side, in the mean, and how many there are."""
    of = uv_islands.islands(mesh)
    middles = points[mesh.vertices[mesh.triangles]].mean(axis=1)
    high = np.flatnonzero(sides.of >= 0)
    nearest, _, squares = Surface(sides.points.astype(np.float32), sides.triangles[high]).closest(
        middles.astype(np.float32)
    )
    size = np.linalg.norm(np.ptp(points, axis=0))
    own = sides.points[sides.triangles[high[nearest]]].astype(np.float64)
    normals = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    is_on = (squares < (1e-3 * size) ** 2) & ((normals * faces).sum(axis=1) > 0.999)
    side = sides.of[high[nearest]]
    counts = []
    for number in np.unique(side[is_on]):
        here = is_on & (side == number)
        shares = np.bincount(of[here], areas[here])
        counts.append(np.count_nonzero(shares > 0.02 * shares.sum()))
    return {"of_a_side": float(np.mean(counts)) if counts else 0.0, "islands": int(of.max()) + 1}


def made(name: str, share: float, size: int, pictures: Path | None) -> str:
    """A line of the table."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    if name in cad_parts.PARTS:
        high = cad_parts.PARTS[name]()
    else:
        bpy.ops.wm.stl_import(filepath=name)
        high = bpy.context.view_layer.objects.active
    high.name = "Part_high"
    points, triangles = cad_parts.arrays(high)
    high.data.polygons.foreach_set("use_smooth", np.ones(len(high.data.polygons), bool))
    high.data.set_sharp_from_angle(angle=SHARP)
    to_world = mesh_reader.matrix(high)
    points = (points @ to_world[:3, :3].T + to_world[:3, 3]).astype(np.float32)
    sides = Sides.of_mesh(*weld(points, triangles))
    settings = Settings(width=size, height=size, samples=1, storage="MEMORY")
    wanted = Wanted(triangles=max(4, round(share * len(triangles))))
    start = time.process_time()
    work = asset.work(bpy.context, Job(high, [high]), wanted, settings, Pace(), suffixes=Suffixes())
    (report,) = finish(work)
    seconds = time.process_time() - start
    low = bpy.data.objects[report.low]
    found, seen = measured(sides, low), report.appearance
    if pictures:
        pictured(Path(name).stem, high, low, pictures)
    return (
        f"{Path(name).stem:14} {len(triangles):6,} {report.triangles['low']:5,}  planes {found['planes']:8.4%} "
        f"gone {found['gone']:5.1%}  edges {found['edges']:8.4%}  normals {found['normals']:5.1f} "
        f"(flat {found['flat']:4.1f})  "
        f"a side {found['of_a_side']:5.2f}  islands {found['islands']:4}  "
        f"outline {seen['silhouette']:6.2%}  mean {seen['mean']:5.2f}  {seconds:5.1f} s"
    )


def pictured(
    name: str,
    high: bpy.types.Object,
    low: bpy.types.Object,
    folder: Path,
    engines: Sequence[str] = ("CYCLES", "BLENDER_EEVEE"),
) -> None:
    """Render both by engines, and the wireframe of the low one by the first of them."""
    scene = bpy.context.scene
    folder.mkdir(parents=True, exist_ok=True)
    box = np.array([high.matrix_world @ Vector(corner) for corner in high.bound_box])
    center, size = Vector(box.mean(axis=0)), float(np.linalg.norm(np.ptp(box, axis=0)))
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale, camera.data.clip_end = "ORTHO", 1.02 * size, 100.0 * size
    camera.location = center + VIEW.normalized() * 3.0 * size
    camera.rotation_euler = VIEW.to_track_quat("Z", "Y").to_euler()
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, (0.5, 0.35, 0.9)
    for obj in (camera, sun):
        scene.collection.objects.link(obj)
    scene.camera = camera
    world = scene.world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs[0].default_value = (0.4, 0.45, 0.5, 1.0)
    scene.render.resolution_x = scene.render.resolution_y = 400
    for material in low.data.materials:
        for node in material.node_tree.nodes:
            if node.type == "BSDF_PRINCIPLED":
                node.inputs["Roughness"].default_value = 0.35
    if not high.data.materials:
        material = bpy.data.materials.new("high")
        material.use_nodes = True
        material.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.35
        high.data.materials.append(material)
    wires = low.copy()
    wires.data = low.data.copy()
    wires.data.materials.clear()
    scene.collection.objects.link(wires)
    wires.modifiers.new("wire", "WIREFRAME").thickness = 0.004 * size
    shown = {"high": high, "low": low, "wires": wires}
    for kind, obj in shown.items():
        for other in shown.values():
            other.hide_render = other is not obj
        for engine in engines if kind != "wires" else engines[:1]:
            scene.render.engine = engine
            scene.cycles.samples = scene.eevee.taa_render_samples = 4
            scene.render.filepath = str(folder / f"{name}_{engine[-6:].lower()}_{kind}.png")
            bpy.ops.render.render(write_still=True)
    for obj in (wires, camera, sun):
        bpy.data.objects.remove(obj)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("parts", nargs="*", metavar="PART")
    parser.add_argument("--share", type=float, default=0.1, metavar="SHARE")
    parser.add_argument("--size", type=int, default=512, metavar="TEXELS")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER")
    options = parser.parse_args()
    gpu.init()
    for name in options.parts or cad_parts.PARTS:
        print(made(name, options.share, options.size, options.pictures), flush=True)


if __name__ == "__main__":
    main()
