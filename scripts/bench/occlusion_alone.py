#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes ambient occlusion of meshes onto themselves, and says how far it is from that of Cycles.

    .venv/bin/python scripts/bench/occlusion_alone.py [alone] [room] [--samples 4096] [--side 64]

alone: ten single objects. room: 40 objects in a room, each shaded by all others, with Occluders on Scene.

Truth is Cycles' AO bake with so many samples. Imprint casts RAYS rays from each texel, without a limit, at both sides of faces.
noise is the root mean square error of RAYS random directions; bias the mean of the differences, in times of its standard error.
Cycles mirrors samples beside a triangle back into it: texels at the borders of triangles do not count where it moves them.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import numpy as np  # noqa: E402
from mathutils import Matrix  # noqa: E402

import addon  # noqa: E402
from tests.support import angles, cycles, maps, zoo  # noqa: E402

RAYS = 128
SEED = 43
OBJECTS = 40


@dataclass(frozen=True)
class Difference:
    """Between Imprint and Cycles, over texels.

    Attributes:
        texels: how many.
        mean: of Cycles' values.
        rms: of the differences.
        noise: what RAYS random directions would differ by.
        bias: the mean of the differences.
        error: the standard error of `bias`.
    """

    texels: int
    mean: float
    rms: float
    noise: float
    bias: float
    error: float

    @classmethod
    def of(cls, ours: np.ndarray, truth: np.ndarray, samples: int) -> "Difference":
        """Of values (N,) with so many samples of the truth."""
        differences = ours.astype(np.float64) - truth
        variance = float((truth * (1.0 - truth)).clip(0.0).mean())
        return cls(
            len(truth),
            float(truth.mean()),
            float(np.sqrt((differences**2).mean())),
            float(np.sqrt(variance * (1.0 / RAYS + 1.0 / samples))),
            float(differences.mean()),
            float(differences.std() / np.sqrt(max(1, len(truth)))),
        )

    def __str__(self) -> str:
        return (
            f"{self.texels:5} texels, mean {self.mean:.3f}, RMS {self.rms:.4f} of {self.noise:.4f}, bias {self.bias:+.5f} = "
            f"{self.bias / max(self.error, 1e-12):+.1f} standard errors"
        )


def values(obj: bpy.types.Object, side: int, many: int, **settings) -> tuple[np.ndarray, np.ndarray]:
    """Ambient occlusion (N,) of an object onto itself at the texels that count: of Imprint, and of Cycles with many samples."""
    scene = bpy.context.scene
    scene.world = scene.world or bpy.data.worlds.new("world")
    scene.world.light_settings.distance = 1e6
    for each in scene.objects:
        each.shadow_terminator_geometry_offset = 0.0  # Cycles moves points on smooth surfaces off their triangles
    truth, written = cycles.bake(obj, (side, side), "AO", samples=many, seed=SEED)
    wanted = {"rays": RAYS, "two_sided": True, "samples": 1, **settings}
    _, found = maps.bake_all_maps(obj, obj, maps=["AO"], size=side, method="AUTO", **wanted)
    counts = angles.eroded(written & (found["ao"][..., 3] == 1.0), 1) & ~cycles.shared(obj, (side, side))
    return found["ao"][counts][:, 0], truth[counts][:, 0]


def unwrapped(obj: bpy.types.Object) -> bpy.types.Object:
    """An object with a new UV map of large islands."""
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(angle_limit=1.1, island_margin=0.02)
    bpy.ops.object.mode_set(mode="OBJECT")
    return obj


def added(operator: str, name: str, **options) -> bpy.types.Object:
    """A primitive of Blender."""
    getattr(bpy.ops.mesh, f"primitive_{operator}_add")(**options)
    bpy.context.object.name = name
    return bpy.context.object


def revolved(
    name: str, profile: list[tuple[float, float]], sides: int = 16, *, smooth: bool = True
) -> bpy.types.Object:
    """A surface around z, from the radii and heights of its profile."""

    def surface(u, v):
        places = v * (len(profile) - 1)
        radius, height = (np.interp(places, np.arange(len(profile)), axis) for axis in np.transpose(profile))
        return np.stack([radius * np.cos(2 * np.pi * u), radius * np.sin(2 * np.pi * u), height], axis=1)

    return zoo.sheet(name, surface, sides, len(profile) - 1, smooth=smooth)


def stairs() -> bpy.types.Object:
    """Five steps, open below."""
    profile = [(step + side, step + rise) for step in range(5) for side, rise in ((0.0, 0.0), (0.0, 1.0), (1.0, 1.0))]
    points = [(0.25 * x, y, 0.25 * z) for y in (-1.0, 1.0) for x, z in profile]
    faces = [(i, i + 1, i + 1 + len(profile), i + len(profile)) for i in range(len(profile) - 1)]
    faces = [tuple(reversed(face)) for face in faces if len({points[i] for i in face}) == 4]
    return zoo.build("stairs", np.array(points), faces, smooth=False)


def modified(obj: bpy.types.Object, kind: str, **options) -> bpy.types.Object:
    """An object with a modifier applied."""
    modifier = obj.modifiers.new(kind, kind)
    for name, value in options.items():
        setattr(modifier, name, value)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.modifier_apply(modifier=modifier.name)
    return obj


def block(n: int = 16) -> bpy.types.Object:
    """Steep waves on a block. Of an open surface, Cycles' rays leave through the face they start from, where smooth
    normals lean out of it, and end below."""
    uv, faces = zoo.grid_uv(n, n), zoo.grid_faces(n, n)
    heights = 0.4 * np.sin(4 * np.pi * uv[:, 0]) * np.sin(4 * np.pi * uv[:, 1])
    top, bottom = (np.column_stack([2 * uv - 1, z]) for z in (heights, np.full(len(uv), -1.0)))
    grid = np.arange(len(uv)).reshape(n + 1, n + 1)
    around = np.concatenate([grid[0, :-1], grid[:-1, -1], grid[-1, :0:-1], grid[:0:-1, 0]])
    after, below = np.roll(around, -1), len(uv)
    sides = np.stack([around, around + below, after + below, after], axis=1)
    obj = zoo.build("block", np.concatenate([top, bottom]), np.concatenate([faces, faces[:, ::-1] + below, sides]))
    return modified(obj, "TRIANGULATE")


def alone() -> dict:
    """What makes each of ten objects, by name. They have few triangles, so that texels are small beside them."""
    return {
        "monkey": lambda: added("monkey", "monkey"),
        "torus": lambda: added("torus", "torus", major_segments=24, minor_segments=10, minor_radius=0.4),
        "stairs": stairs,
        "block": block,
        "cup": lambda: revolved("cup", [(0.1, -0.5), (0.8, -0.5), (1.0, 1.0)], 24),
        "bowl": lambda: modified(revolved("bowl", [(0.2, 0.0), (0.8, 0.3), (1.0, 1.0)]), "SOLIDIFY", thickness=0.1),
        "column": lambda: revolved(
            "column", [(1, 0), (1, 0.2), (0.6, 0.4), (0.6, 2), (1, 2.2), (1, 2.4)], smooth=False
        ),
        "frame": lambda: modified(added("cube", "frame"), "WIREFRAME", thickness=0.5),
        "fan": lambda: modified(
            zoo.plane("fan", n=2, slope=0.7), "ARRAY", count=6, relative_offset_displace=(0.3, 0.0, 0.0)
        ),
        "knot": lambda: modified(
            added("torus", "knot", major_segments=24, minor_segments=8, minor_radius=0.25),
            "SIMPLE_DEFORM",
            deform_method="TWIST",
            angle=2.0,
        ),
    }


def room() -> list[bpy.types.Object]:
    """40 objects on the floor of a room without a ceiling; some touch, some hang, some are open."""
    random = np.random.default_rng(SEED)
    walls = added("cube", "room", size=8.0, location=(0.0, 0.0, 1.25), scale=(1.0, 1.0, 0.3125))
    kept = [[*face.vertices][::-1] for face in walls.data.polygons if face.normal.z < 0.5]
    data = bpy.data.meshes.new("room")
    data.from_pydata([vertex.co for vertex in walls.data.vertices], [], kept)
    walls.data = data
    objects = [walls]
    for number in range(OBJECTS - 1):
        kind = ("cube", "torus", "monkey", "cylinder", "cone")[number % 5]
        options = {
            "torus": {"major_segments": 16, "minor_segments": 8},
            "cylinder": {"vertices": 12},
            "cone": {"vertices": 12},
        }
        obj = added(kind, f"{kind} {number}", **options.get(kind, {}))
        place = np.array([number % 7 - 3, number // 7 - 2.5, 0.0]) * 1.1 + random.uniform(-0.2, 0.2, 3)
        turn = Matrix.Rotation(random.uniform(0.0, 6.0), 4, random.normal(size=3))
        obj.matrix_world = Matrix.Translation((*place[:2], random.uniform(0.3, 1.5))) @ turn @ Matrix.Scale(0.4, 4)
        objects.append(obj)
    bpy.context.view_layer.update()
    return [unwrapped(obj) for obj in objects]


def rows(parts: list[str], side: int, samples: int) -> Iterator[tuple[str, Difference]]:
    """The differences of each object, and of all of the room."""
    for name, make in alone().items() if "alone" in parts else ():
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        yield name, Difference.of(*values(unwrapped(make()), side, samples), samples)
    if "room" in parts:
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        found = []
        for obj in room():
            found.append(values(obj, side, samples, occluders="SCENE"))
            yield obj.name, Difference.of(*found[-1], samples)
        yield "all", Difference.of(*map(np.concatenate, zip(*found, strict=True)), samples)


def main() -> None:
    """Print a line for each object."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("parts", nargs="*", metavar="alone|room", default=["alone", "room"])
    parser.add_argument("--samples", type=int, default=4096)
    parser.add_argument("--side", type=int, default=64)
    options = parser.parse_args()
    addon.register()
    for name, found in rows(options.parts, options.side, options.samples):
        print(f"{name:12} {found}", flush=True)


if __name__ == "__main__":
    main()
