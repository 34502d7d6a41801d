# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares UV maps of 30 shapes: by Unwrap, by Smart UV Project with concave packing, and by xatlas, with equal margins.

.venv/bin/python scripts/bench/unwrap_shapes.py [SHAPE ...] [--size 1024] [--rivals FILE.json] [--pictures FOLDER]
    [--assets FOLDER]

--rivals measures the other two as well, once for each shape and size: the file keeps what they gave. xatlas takes part if its
wheel is on the PYTHONPATH. --pictures draws each layout and its islands on the shape (needs matplotlib). king, spot, helmet and
mountain are low meshes of the folder --assets, and are left out without it.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.core.settings import Settings  # noqa: E402
from addon.jobs import unwrapping  # noqa: E402
from addon.mesh import uv_stretch  # noqa: E402
from addon.mesh.triangle_mesh import Mesh  # noqa: E402
from addon.scene import mesh_reader  # noqa: E402
from scripts.bench import made_highs  # noqa: E402
from scripts.bench.asset_by_hand import ANGLE, decimated  # noqa: E402

OURS, SMART, XATLAS = "Unwrap", "Smart UV", "xatlas"
EQUAL = 0.999
"""Figures that differ by less than this factor count as equal."""
SEED = 5


# Shapes. Each function makes an object without UVs.


def build(points, faces) -> bpy.types.Object:
    data = bpy.data.meshes.new("shape")
    data.from_pydata(np.asarray(points, float).tolist(), [], [list(map(int, face)) for face in faces])
    return linked(data)


def linked(data: bpy.types.Mesh) -> bpy.types.Object:
    obj = bpy.data.objects.new("shape", data)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.update()
    return obj


def primitive(name: str, **options) -> bpy.types.Object:
    getattr(bpy.ops.mesh, f"primitive_{name}_add")(**options)
    return bpy.context.object


def modified(obj: bpy.types.Object, kind: str, **options) -> bpy.types.Object:
    """An object with a modifier applied."""
    modifier = obj.modifiers.new(kind, kind)
    for name, value in options.items():
        setattr(modifier, name, value)
    return linked(bpy.data.meshes.new_from_object(obj.evaluated_get(bpy.context.evaluated_depsgraph_get())))


def loop_quads(rows: int, columns: int, *, is_closed: bool) -> list[tuple[int, int, int, int]]:
    """Quads between rows of points, each a closed loop. is_closed: whether the last row meets the first."""
    return [
        (i * columns + j, i * columns + (j + 1) % columns, k * columns + (j + 1) % columns, k * columns + j)
        for i, k in ((i, (i + 1) % rows) for i in range(rows if is_closed else rows - 1))
        for j in range(columns)
    ]


def tube_along(path: np.ndarray, profile: np.ndarray, *, is_closed: bool = False) -> bpy.types.Object:
    """Loops of points (M, 2) along points (N, 3), in a frame that turns with the path around the z axis."""
    along = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0)
    if not is_closed:
        along[0], along[-1] = path[1] - path[0], path[-1] - path[-2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, (0.0, 0.0, 1.0))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, along)
    points = path[:, None] + profile[:, :1] * side[:, None] + profile[:, 1:] * up[:, None]
    return build(points.reshape(-1, 3), loop_quads(len(path), len(profile), is_closed=is_closed))


def circle(count: int, radius: float = 1.0) -> np.ndarray:
    angles = np.arange(count) * 2.0 * np.pi / count
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def ring() -> bpy.types.Object:
    return build(
        np.pad(np.concatenate([circle(24), circle(24, 0.6)]), ((0, 0), (0, 1))), loop_quads(2, 24, is_closed=False)
    )


def frame() -> bpy.types.Object:
    points = [(0, 0), (4, 0), (4, 3), (0, 3), (0.4, 0.4), (3.6, 0.4), (3.6, 2.6), (0.4, 2.6)]
    return build(np.pad(points, ((0, 0), (0, 1))), loop_quads(2, 4, is_closed=False))


def plate(holes: int) -> bpy.types.Object:
    """A flat plate with so many holes a side."""
    side = 2 * holes + 1
    v, u = np.divmod(np.arange((side + 1) ** 2), side + 1)
    j, i = np.divmod(np.arange(side**2), side)
    start = (j * (side + 1) + i)[(i % 2 == 0) | (j % 2 == 0)]
    faces = np.stack([start, start + 1, start + side + 2, start + side + 1], axis=1)
    used, faces = np.unique(faces, return_inverse=True)
    return build(np.stack([u, v, 0 * u], axis=1)[used] / side, faces.reshape(-1, 4))


def gear() -> bpy.types.Object:
    """A wheel with 16 teeth and a bore."""
    radii = np.repeat(np.tile([1.0, 0.8], 16), 2)
    flat = np.concatenate([radii[:, None] * circle(64), circle(64, 0.4)])
    count = len(flat)
    points = np.concatenate([np.pad(flat, ((0, 0), (0, 1)), constant_values=z) for z in (0.0, 0.3)])
    caps = np.array(loop_quads(2, 64, is_closed=False))
    rim = np.stack(
        [np.arange(64), (np.arange(64) + 1) % 64, (np.arange(64) + 1) % 64 + count, np.arange(64) + count], axis=1
    )
    return build(points, [*caps, *(caps[:, ::-1] + count), *rim[:, ::-1], *(rim + 64)])


def boxes(lows, highs) -> bpy.types.Object:
    """Boxes between corners (N, 3)."""
    lows, highs = np.asarray(lows, float), np.asarray(highs, float)
    corners = np.array([[(k >> axis) & 1 for axis in range(3)] for k in range(8)])
    points = lows[:, None] + corners * (highs - lows)[:, None]
    faces = np.array([(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)])
    return build(points.reshape(-1, 3), (faces + 8 * np.arange(len(lows))[:, None, None]).reshape(-1, 4))


def vent() -> bpy.types.Object:
    """A frame of four bars with ten slats."""
    slats = [((0.1, 0.12 + 0.078 * k, 0.02), (1.9, 0.15 + 0.078 * k, 0.12)) for k in range(10)]
    bars = [
        ((0, 0, 0), (2, 0.1, 0.15)),
        ((0, 0.9, 0), (2, 1, 0.15)),
        ((0, 0.1, 0), (0.1, 0.9, 0.15)),
        ((1.9, 0.1, 0), (2, 0.9, 0.15)),
    ]
    return boxes(*zip(*bars, *slats, strict=True))


def letters() -> bpy.types.Object:
    """A word in Blender's own font, with a thickness."""
    curve = bpy.data.curves.new("letters", "FONT")
    curve.body, curve.extrude, curve.resolution_u = "Bake 8&g", 0.1, 3
    obj = linked(curve)
    return modified(linked(bpy.data.meshes.new_from_object(obj)), "WELD", merge_threshold=1e-5)


def pipe() -> bpy.types.Object:
    """A bent pipe with a flange at both ends."""
    angles = np.linspace(0.0, 0.5 * np.pi, 9)
    bend = np.stack([1.0 - np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    path = np.concatenate(
        [
            [(0.0, -1.0, 0.0), (0.0, -0.9, 0.0), (0.0, -0.9, 0.0)],
            bend,
            [(1.9, 1.0, 0.0), (1.9, 1.0, 0.0), (2.0, 1.0, 0.0)],
        ]
    )
    radii = np.array([0.35, 0.35, 0.2, *[0.2] * 9, 0.2, 0.35, 0.35])
    obj = tube_along(np.stack([np.arange(len(path)), 0 * radii, 0 * radii], axis=1).astype(float), circle(16))
    along = np.array([(0, 1, 0)] * 3 + [(np.sin(a), np.cos(a), 0) for a in angles] + [(1, 0, 0)] * 3, float)
    side = np.cross(along, (0.0, 0.0, 1.0))
    points = path[:, None] + radii[:, None, None] * (
        circle(16)[:, :1] * side[:, None] + circle(16)[:, 1:] * (0.0, 0.0, 1.0)
    )
    obj.data.vertices.foreach_set("co", points.astype(np.float32).reshape(-1))
    return obj


def strap() -> bpy.types.Object:
    """A closed band with a thickness, as a belt lies: waved, and wider than thick."""
    a = np.arange(72) * 2.0 * np.pi / 72
    path = np.stack(
        [(1.0 + 0.1 * np.cos(3 * a)) * np.cos(a), (0.7 + 0.1 * np.sin(2 * a)) * np.sin(a), 0.15 * np.sin(2 * a)], axis=1
    )
    return tube_along(path, np.array([(-0.02, -0.1), (0.02, -0.1), (0.02, 0.1), (-0.02, 0.1)]), is_closed=True)


def spring() -> bpy.types.Object:
    a = np.linspace(0.0, 8.0 * np.pi, 129)
    return tube_along(np.stack([np.cos(a), np.sin(a), a / 12.0], axis=1), circle(8, 0.12))


def sphere(rings: int) -> bpy.types.Object:
    """With its faces in one order: Blender gives them another one each time, and charts that grow from them differ."""
    data = primitive("uv_sphere", segments=2 * rings, ring_count=rings).data
    faces = [tuple(polygon.vertices) for polygon in data.polygons]
    firsts = [face.index(min(face)) for face in faces]
    turned = sorted(face[first:] + face[:first] for face, first in zip(faces, firsts, strict=True))
    return build(mesh_reader.points(data), turned)


def bumpy(rings: int) -> bpy.types.Object:
    obj = sphere(rings)
    points = mesh_reader.points(obj.data).astype(np.float64)
    x, y, z = points.T
    points *= (1.0 + 0.08 * np.sin(9.0 * x) * np.cos(7.0 * y + 5.0 * z))[:, None]
    obj.data.vertices.foreach_set("co", points.astype(np.float32).reshape(-1))
    return obj


def cards(count: int) -> bpy.types.Object:
    """Thin strips of five quads in random directions, beside a plane."""
    rng = np.random.default_rng(SEED)
    start, along = rng.uniform(-1.0, 1.0, (count, 1, 3)), rng.normal(size=(count, 1, 3))
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    side = np.cross(along, (0.0, 0.0, 1.0))
    side *= 0.01 / np.linalg.norm(side, axis=2, keepdims=True)
    one = start + along * np.linspace(0.0, 1.0, 6)[:, None]
    points = np.stack([one, one + side], axis=2).reshape(-1, 3)
    first = (12 * np.arange(count)[:, None] + 2 * np.arange(5)).reshape(-1)
    strips = np.stack([first, first + 1, first + 3, first + 2], axis=1)
    square = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    return build(np.concatenate([points, square]), [*strips, np.arange(4) + len(points)])


def soup(count: int) -> bpy.types.Object:
    """Loose quads of several sizes."""
    rng = np.random.default_rng(SEED)
    size = np.exp(rng.normal(0.0, 0.5, (count, 1, 1)))
    axes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * 0.05
    points = rng.uniform(-1.0, 1.0, (count, 1, 3)) + size * np.einsum("kc,ncd->nkd", corners, axes[:, :2])
    return build(points.reshape(-1, 3), np.arange(4 * count).reshape(-1, 4))


def rock() -> bpy.types.Object:
    return decimated(made_highs.scan(np.random.default_rng(made_highs.SEED), 60_000), 3000)


def of_file(folder: Path, start: str, name: str = "lo", triangles: int = 0) -> bpy.types.Object:
    (file,) = folder.glob(f"{start}*.blend")
    with bpy.data.libraries.load(str(file)) as (_, into):
        into.objects = [name]
    bpy.context.scene.collection.objects.link(into.objects[0])
    return decimated(into.objects[0], triangles) if triangles else into.objects[0]


def shapes(assets: Path | None) -> dict[str, Callable[[], bpy.types.Object]]:
    """What makes each shape, by its name."""
    made = {
        "cube": partial(primitive, "cube"),
        "cylinder": partial(primitive, "cylinder", vertices=24),
        "tube": partial(primitive, "cylinder", vertices=24, end_fill_type="NOTHING"),
        "cone": partial(primitive, "cone", vertices=24),
        "torus": partial(primitive, "torus", major_segments=24, minor_segments=12),
        "sphere": partial(sphere, 12),
        "rounded": lambda: modified(primitive("cube"), "BEVEL", width=0.3, segments=3),
        "ring": ring,
        "frame": frame,
        "plate-1": partial(plate, 1),
        "plate-8": partial(plate, 8),
        "plate-50": partial(plate, 50),
        "grille": lambda: modified(plate(5), "SOLIDIFY", thickness=0.02),
        "gear": gear,
        "vent": vent,
        "letters": letters,
        "pipe": pipe,
        "strap": strap,
        "spring": spring,
        "monkey": partial(primitive, "monkey"),
        "head": lambda: modified(primitive("monkey"), "SUBSURF", levels=1),
        "bumpy-40": partial(bumpy, 40),
        "bumpy-100": partial(bumpy, 100),
        "rock": rock,
        "cards": partial(cards, 300),
        "soup": partial(soup, 1000),
    }
    if assets is not None:
        made |= {name: partial(of_file, assets, name) for name in ("king", "spot_1696", "helmet")}
        made["mountain"] = partial(of_file, assets, "sthelens", "hi", 3000)
    return made


# What is measured.


@dataclass(frozen=True)
class Measured:
    """A layout of a shape. seconds: of processor time. The others are as Layout has them."""

    used: float
    angle: float
    area: float
    sound: float
    islands: int
    split: float
    border: float
    figure: float
    seconds: float

    @classmethod
    def of(cls, points: np.ndarray, uv: np.ndarray, vertices: np.ndarray, side: int, start: float) -> "Measured":
        """Measure triangles, as uv_stretch.measure takes them. start: processor time before they were unwrapped."""
        seconds = time.process_time() - start
        found = uv_stretch.measure(points, uv, side, vertices)
        kept = {name: getattr(found, name) for name in cls.__dataclass_fields__ if name != "seconds"}
        return cls(**kept, seconds=seconds)

    def row(self, shape: str, way: str) -> str:
        """A line of the table."""
        sound = "" if self.sound > EQUAL else f" ({self.sound:.0%} sound)"
        return (
            f"| {shape:10} | {way:8} | {self.used:4.0%}{sound} | {self.angle:5.2f} | {self.area:5.2f} | {self.islands:6,} | "
            f"{self.split:6.2f} | {self.border:5.3f} | {self.figure:.3f} | {self.seconds:6.2f} |"
        )


HEAD = """| shape | way | used | stretch, angles | stretch, areas | islands | split | border | figure | seconds |
|---|---|--:|--:|--:|--:|--:|--:|--:|--:|"""


def read(obj: bpy.types.Object) -> Mesh:
    data = obj.data
    return mesh_reader.surface(data, data.uv_layers.active.name, obj.name, np.eye(4), with_faces=True)


def measured(obj: bpy.types.Object, side: int, start: float) -> Measured:
    mesh = read(obj)
    vertices = mesh.vertices[mesh.triangles]
    return Measured.of(mesh.positions[vertices], mesh.uv[mesh.triangles], vertices, side, start)


def by_unwrap(obj: bpy.types.Object, settings: Settings) -> Measured:
    start = time.process_time()
    unwrapping.unwrap(obj, settings)
    return measured(obj, min(settings.sampling.size), start)


def by_smart(obj: bpy.types.Object, settings: Settings) -> Measured:
    start = time.process_time()
    obj.data.uv_layers.new()
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(angle_limit=ANGLE, island_margin=0.0, area_weight=0.0, correct_aspect=False)
    bpy.ops.uv.pack_islands(
        rotate=True, scale=True, margin_method="FRACTION", margin=unwrapping.margin(settings.sampling),
        shape_method="CONCAVE", merge_overlap=False,
    )  # fmt: skip
    bpy.ops.object.mode_set(mode="OBJECT")
    return measured(obj, min(settings.sampling.size), start)


def by_xatlas(obj: bpy.types.Object, settings: Settings) -> Measured:
    """By xatlas in a square map, whose margin to the border is half of that between islands, as with the others."""
    import xatlas

    side, margin = min(settings.sampling.size), unwrapping.margin(settings.sampling)
    data = obj.data
    triangles = mesh_reader.corner_vertices(data)[mesh_reader.triangles(data)]
    points = mesh_reader.points(data)
    points *= 100.0 / np.ptp(points, axis=0).max()  # small meshes get other sizes of texels
    start = time.process_time()
    atlas = xatlas.Atlas()
    atlas.add_mesh(points, triangles.astype(np.uint32))
    pack = xatlas.PackOptions()
    pack.resolution, pack.padding, pack.bilinear = side, int(np.ceil(2.0 * margin * side)), False
    pack.bruteForce = len(triangles) < 5000
    atlas.generate(xatlas.ChartOptions(), pack)
    vertices, corners, uv = atlas[0]
    # The map may be larger than asked for, and then the gaps are smaller: they get as wide as those of the others. So does the
    # margin at the border, of which xatlas leaves parts of a texel out.
    uv = (uv * (atlas.width, atlas.height))[corners]
    uv = (uv - uv.min(axis=(0, 1))) / np.ptp(uv, axis=(0, 1)).max() * (1.0 - 2.0 * margin) + margin
    return Measured.of(points[vertices[corners]], uv, vertices[corners], side, start)


def draw(obj: bpy.types.Object, file: Path, title: str) -> None:
    """Draw the UV layout, and the islands on the shape from two sides."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.collections import PolyCollection

    from addon.mesh import uv_islands

    mesh = read(obj)
    islands = uv_islands.islands(mesh)
    colors = np.random.default_rng(SEED).uniform(0.3, 1.0, (int(islands.max()) + 1, 3))[islands]
    points = mesh.positions[mesh.vertices[mesh.triangles]].astype(np.float64)
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    figure, (flat, *views) = plt.subplots(1, 3, figsize=(18, 6.3), dpi=80)
    flat.add_collection(PolyCollection(mesh.uv[mesh.triangles], facecolors=colors, edgecolors="k", linewidths=0.2))
    flat.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", title=title)
    for view, side in zip(views, ((0.6, -1.0, 0.7), (-0.6, 1.0, -0.7)), strict=True):
        toward = np.array(side) / np.linalg.norm(side)
        right = np.cross((0.0, 0.0, 1.0), toward)
        right /= np.linalg.norm(right)
        seen = points @ np.stack([right, np.cross(toward, right)], axis=1)
        order = np.argsort((points @ toward).mean(axis=1))
        shade = (0.55 + 0.45 * np.abs(normals @ toward))[:, None]
        view.add_collection(
            PolyCollection(seen[order], facecolors=(colors * shade)[order], edgecolors="k", linewidths=0.1)
        )
        view.autoscale()
        view.set_aspect("equal")
        view.axis("off")
    figure.tight_layout()
    figure.savefig(file)
    plt.close(figure)


def summary(found: dict[str, dict[str, Measured]]) -> str:
    """On how many shapes Unwrap is at least as good as the best of the others."""
    both = [(ways[OURS], [one for way, one in ways.items() if way != OURS]) for ways in found.values() if len(ways) > 1]
    if not both:
        return ""
    figure = sum(ours.figure >= EQUAL * max(one.figure for one in others) for ours, others in both)
    used = sum(ours.used >= EQUAL * max(one.used * one.sound for one in others) for ours, others in both)
    islands = sum(ours.islands <= max(one.islands for one in others) for ours, others in both)
    return (
        f"Of {len(both)} shapes, Unwrap is at least as good as the best of the others on {figure} by its figure, on {used} by "
        f"the share of the map used; on {islands} it has no more islands than the worse."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("shapes", nargs="*", metavar="SHAPE")
    parser.add_argument("--size", type=int, default=1024, metavar="TEXELS")
    parser.add_argument("--rivals", type=Path, metavar="FILE.json")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER")
    parser.add_argument("--assets", type=Path, metavar="FOLDER")
    options = parser.parse_args()
    settings = Settings(width=options.size, height=options.size)
    made = shapes(options.assets)
    if unknown := [name for name in options.shapes if name not in made]:
        parser.error(f"no shape {unknown[0]!r}: choose some of {', '.join(made)}")
    known = json.loads(options.rivals.read_text()) if options.rivals and options.rivals.exists() else {}
    ways = {OURS: by_unwrap}
    if options.rivals:
        ways[SMART] = by_smart
        if "xatlas" in sys.modules or _has_xatlas():
            ways[XATLAS] = by_xatlas
    print(HEAD)
    found: dict[str, dict[str, Measured]] = {}
    for shape in options.shapes or made:
        for way, measure in ways.items():
            key = f"{shape} {way} {options.size}"
            if way == OURS or key not in known:
                bpy.ops.wm.read_factory_settings(use_empty=True)
                obj = made[shape]()
                while obj.data.uv_layers:
                    obj.data.uv_layers.remove(obj.data.uv_layers[0])
                one = measure(obj, settings)
                if options.pictures and way != XATLAS:
                    options.pictures.mkdir(parents=True, exist_ok=True)
                    title = f"{shape} by {way}: {one.used:.0%}, {one.islands} islands, figure {one.figure:.3f}"
                    draw(obj, options.pictures / f"{shape}_{way.split()[0].lower()}.png", title)
            else:
                one = Measured(**known[key])
            found.setdefault(shape, {})[way] = one
            print(one.row(shape, way), flush=True)
            if options.rivals and way != OURS:
                known[key] = asdict(one)
                options.rivals.write_text(json.dumps(known, indent=1))
    print(summary(found))


def _has_xatlas() -> bool:
    import importlib.util

    return importlib.util.find_spec("xatlas") is not None


if __name__ == "__main__":
    main()
