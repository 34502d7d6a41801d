# SPDX-License-Identifier: GPL-3.0-or-later
"""Times the shaders without Blender, on the machine's OpenGL: moderngl on EGL, with meshes from .npz files.

python3 scripts/dev/hardware.py FILE.npz ... [--output RESULT.json]     needs numpy and moderngl

The files come from scripts/dev/export.py, on a machine with Blender. The shader files are taken as they are; the
interface that addon/passes declares for them becomes plain GLSL here, where in Blender its backend writes it.
"""

import argparse
import json
import statistics
import sys
import time
from functools import partial
from pathlib import Path

import moderngl
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.core.declarations.choices import Hit  # noqa: E402
from addon.mesh.local_space import FARTHEST  # noqa: E402
from addon.passes import data_texture  # noqa: E402
from addon.passes.bake import cast, flatten, rays  # noqa: E402
from addon.passes.program import Program, in_software, prelude, source  # noqa: E402

REPEATS = 9
TABLES = "nodes", "triangles", "points", "normals", "low_nodes", "low_corners", "edge_nodes", "edge_ends"
"""The arrays of a file that shaders read as data textures."""
TYPES = {
    "VEC2": "vec2",
    "VEC3": "vec3",
    "VEC4": "vec4",
    "MAT4": "mat4",
    "FLOAT": "float",
    "INT": "int",
    "IVEC4": "ivec4",
}
SAMPLERS = {"FLOAT_2D": "sampler2D", "UINT_2D": "usampler2D", "INT_2D": "isampler2D"}
IMAGES = {"FLOAT_2D": "image2D", "UINT_2D": "uimage2D", "INT_2D": "iimage2D"}
QUALIFIERS = {"WRITE": "writeonly", "READ": "readonly", "READ WRITE": ""}


def header(program: Program, stage: str, as_images: bool) -> str:
    """The declarations of a Program for one stage, "vertex", "fragment" or "compute", in plain GLSL.

    as_images: whether what is read by whole numbers is an image, or a sampler.
    """
    lines = ["#version 430"]
    if stage == "compute":
        lines.append(f"layout(local_size_x = {program.group[0]}, local_size_y = {program.group[1]}) in;")
    if stage == "vertex":
        lines += [f"layout(location = {i}) in {TYPES[kind]} {name};" for i, (kind, name) in enumerate(program.inputs)]
    way = {"vertex": "out", "fragment": "in"}.get(stage)
    lines += [f"smooth {way} {TYPES[kind]} {name};" for kind, name in program.varyings if way]
    lines += [f"flat {way} {TYPES[kind]} {name};" for kind, name in program.flat if way]
    lines += [f"uniform {SAMPLERS[kind]} {name};" for kind, name in program.all_samplers(as_images)]
    lines += [f"uniform {TYPES[kind]} {name};" for kind, name in program.constants]
    if stage == "fragment":
        lines += [f"layout(location = {i}) out {TYPES[kind]} {name};" for i, (kind, name) in enumerate(program.outputs)]
    lines += [
        f"layout({texel.lower()}, binding = {i}) uniform {QUALIFIERS[access]} {IMAGES[kind]} {name};"
        for i, (texel, kind, name, access) in enumerate(program.all_images(as_images))
        if stage != "vertex"
    ]
    return "\n".join(lines)


def load(ctx: moderngl.Context, program: Program, as_images: bool):
    """Compile a Program with moderngl."""
    stages = {stage: getattr(program, stage) for stage in ("vertex", "fragment", "compute") if getattr(program, stage)}
    sources = {
        stage: f"{header(program, stage, as_images)}\n{prelude(as_images)}{source(name)}"
        for stage, name in stages.items()
    }
    if "compute" in sources:
        return ctx.compute_shader(sources["compute"])
    return ctx.program(vertex_shader=sources["vertex"], fragment_shader=sources["fragment"])


class Scene:
    """One pair on the GPU: the meshes of a file, targets of one size, and the shaders."""

    def __init__(self, ctx: moderngl.Context, data, size: int, *, as_images: bool):
        self.ctx, self.size, self.data, self.as_images = ctx, size, data, as_images
        self.flatten, self.rays, self.packet_traversal, self.trace, self.trace_first, self.lookup = (
            load(ctx, program, as_images)
            for program in (flatten.PROGRAM, rays.PROGRAM, cast.PACKETS, cast.TRACE, cast.TRACE_FIRST, cast.LOOKUP)
        )
        self.uv_to_clip = (2.0, 2.0, -1.0, -1.0)
        self.identity = tuple(np.eye(4).ravel().tolist())
        self.high = self._mesh(self.flatten, flatten.PROGRAM, "high", data["high_triangles"])
        self.low = self._mesh(self.rays, rays.PROGRAM, "low", np.arange(len(data["low_uv"])))
        self.triangle = ctx.vertex_array(
            self.lookup, [(ctx.buffer(np.array([-1, -1, 3, -1, -1, 3], "f4").tobytes()), "2f", "position")]
        )
        self.tables = {name: self._table(data[name]) for name in TABLES}
        self.positions, self.directions, self.map = (self._texture("f4") for _ in range(3))
        self.hits, self.packets = (self._texture("u4") for _ in range(2))
        self.places = ctx.framebuffer([self.positions, self.directions])
        self.drawn = ctx.framebuffer([self.map])

    def _bind(self, compiled, program, **values) -> None:
        """Set samplers, images and constants by their declared types, except those that the compiler removed."""
        for unit, (_, name) in enumerate(program.all_samplers(self.as_images)):
            values[name].use(location=unit)
            if name in compiled:
                compiled[name].value = unit
        for unit, (_, _, name, access) in enumerate(program.all_images(self.as_images)):
            values[name].bind_to_image(unit, read="READ" in access, write="WRITE" in access)
        for kind, name in program.constants:
            if name in compiled:
                value = values[name]
                compiled[name].value = int(value) if kind == "INT" else value

    def _texture(self, dtype: str) -> moderngl.Texture:
        texture = self.ctx.texture((self.size, self.size), 4, dtype=dtype)
        texture.filter = moderngl.NEAREST, moderngl.NEAREST
        return texture

    def _mesh(self, compiled, program, which: str, triangles: np.ndarray) -> moderngl.VertexArray:
        """The arrays of the file that begin with `which`, "low" or "high"."""
        parts = []
        for kind, name in program.inputs:
            if name in compiled:
                values = np.ascontiguousarray(self.data[f"{which}_{name}"], np.float32)
                components = 1 if kind == "FLOAT" else TYPES[kind][-1]
                parts.append((self.ctx.buffer(values.tobytes()), f"{components}f", name))
        index = self.ctx.buffer(np.ascontiguousarray(triangles, np.int32).tobytes())
        return self.ctx.vertex_array(compiled, parts, index_buffer=index)

    def _table(self, texels: np.ndarray) -> moderngl.Texture:
        size = data_texture.WIDTH, len(texels) // data_texture.WIDTH
        texture = self.ctx.texture(size, 4, np.ascontiguousarray(texels, np.float32).tobytes(), dtype="f4")
        texture.filter = moderngl.NEAREST, moderngl.NEAREST
        return texture

    def bake_flat(self) -> None:
        """Draw the high mesh in UV space, as the paper does."""
        self.drawn.use()
        self.drawn.clear()
        self._bind(self.flatten, flatten.PROGRAM, normal_matrix=self.identity, uv_to_clip=self.uv_to_clip)
        self.high.render(moderngl.TRIANGLES)

    def start_rays(self) -> None:
        """Draw the starts and directions of the rays."""
        self.places.use()
        self.places.clear()
        self._bind(
            self.rays,
            rays.PROGRAM,
            uv_to_clip=self.uv_to_clip,
            **{name: self.tables[name] for name in ("edge_nodes", "edge_ends")},
            edge_origin=self._place("edge_origin"),
            edge_scale=self._place("edge_scale"),
            edge_first_leaf=int(self.data["edge_first_leaf"]),
            **{name: float(self.data[name]) for name in ("blend_width", "straight_share", "start_offset")},
            start_on_cage=0,
        )
        self.low.render(moderngl.TRIANGLES)

    def _place(self, name: str) -> tuple[float, ...]:
        """A vector of the file as a VEC4."""
        return (*self.data[name].tolist(), 0.0)

    def cast_rays(self, rule: Hit = Hit.OWN) -> None:
        """Trace all rays to the triangles that they hit. rule: which hit counts."""
        data, is_own = self.data, rule == Hit.OWN
        values = {
            "positions": self.positions,
            "directions": self.directions,
            **{
                name: self.tables[name]
                for name in ("nodes", "triangles", "points", "normals", "low_nodes", "low_corners")
            },
            "packets": self.packets,
            "hits": self.hits,
            "grid_origin": self._place("origin"),
            "grid_scale": self._place("scale"),
            "low_origin": self._place("low_origin"),
            "low_scale": self._place("low_scale"),
            "first_row": 0,
            "max_t": FARTHEST,
            **{name: float(data[name]) for name in ("inside", "near")},
            "first_leaf": int(data["first_leaf"]),
            "low_first_leaf": int(data["low_first_leaf"]),
            "has_packets": 1,
            "facing_only": 0,
            "is_nearest": int(rule == Hit.NEAREST),
            "active_texels": self.tables["nodes"],
            "active_count": -1,
        }
        program, compiled = (cast.TRACE, self.trace) if is_own else (cast.TRACE_FIRST, self.trace_first)
        for each, shader, side in ((cast.PACKETS, self.packet_traversal, cast.PACKET_SIDE), (program, compiled, 1)):
            self._bind(shader, each, **values)
            groups = -(-self.size // (8 * side))
            shader.run(groups, groups, 1)
            self.ctx.memory_barrier()

    def look_up(self) -> None:
        """Write the normals at the hits."""
        self.drawn.use()
        self._bind(
            self.lookup,
            cast.LOOKUP,
            hits=self.hits,
            positions=self.positions,
            triangles=self.tables["triangles"],
            normals=self.tables["normals"],
            normal_matrix=self.identity,
        )
        self.triangle.render(moderngl.TRIANGLES)

    def read(self) -> np.ndarray:
        """Read the map, (size, size, 4) float32."""
        return np.frombuffer(self.map.read(), np.float32).reshape(self.size, self.size, 4)


def timed(ctx: moderngl.Context, *works) -> float:
    """The median seconds to run `works` one after another, until the GPU has finished."""
    times = []
    for _ in range(REPEATS + 1):
        ctx.finish()
        start = time.perf_counter()
        for work in works:
            work()
        ctx.finish()
        times.append(time.perf_counter() - start)
    return statistics.median(times[1:])


def measure(ctx: moderngl.Context, path: Path, size: int, is_software: bool) -> dict:
    """Time one pair at one size."""
    with np.load(path) as file:
        data = dict(file)
    scene = Scene(ctx, data, size, as_images=is_software)
    flat = timed(ctx, scene.bake_flat)
    flat_with_reading = timed(ctx, scene.bake_flat, scene.read)
    covered = float((scene.read()[..., 3] > 0.0).mean())
    starts = timed(ctx, scene.start_rays)
    ray_count = int((np.frombuffer(scene.positions.read(), np.float32).reshape(-1, 4)[:, 3] > 0.0).sum())
    by_rule = {rule: timed(ctx, partial(scene.cast_rays, rule)) for rule in Hit}
    own = by_rule[Hit.OWN]
    whole = timed(ctx, scene.start_rays, scene.cast_rays, scene.look_up, scene.read)
    hit = int((np.frombuffer(scene.hits.read(), np.uint32).reshape(-1, 4)[:, 0] > 0).sum())
    triangles = len(data["high_triangles"])
    other = Scene(ctx, data, size, as_images=not is_software)
    other.start_rays()
    own_otherwise = timed(ctx, other.cast_rays)
    return {
        "pair": path.stem,
        "size": size,
        "high": triangles,
        "low": len(data["low_uv"]) // 3,
        "flatten_ms": flat * 1e3,
        "flatten_with_read_back_ms": flat_with_reading * 1e3,
        "triangles_per_second": triangles / flat,
        "coverage": covered,
        "starts_ms": starts * 1e3,
        **{f"cast_{rule.lower()}_ms": seconds * 1e3 for rule, seconds in by_rule.items()},
        "cast_with_read_back_ms": whole * 1e3,
        "cast_from_images_ms": (own if is_software else own_otherwise) * 1e3,
        "cast_from_samplers_ms": (own_otherwise if is_software else own) * 1e3,
        "rays": ray_count,
        "hits": hit,
        "rays_per_second": ray_count / own,
    }


def main() -> None:
    parser = argparse.ArgumentParser(prog="hardware.py", description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.npz")
    parser.add_argument("--sizes", type=int, nargs="+", default=[512, 1024, 2048])
    parser.add_argument("--output", type=Path, help="write the figures as JSON")
    options = parser.parse_args()
    ctx = moderngl.create_standalone_context(backend="egl", require=430)
    renderer = ctx.info["GL_RENDERER"]
    is_software = in_software(renderer)
    print(renderer, "(in software)" if is_software else "")
    rows = [measure(ctx, path, size, is_software) for path in options.files for size in options.sizes]
    for row in rows:
        print(
            f"{row['pair']:32} {row['size']:5}",
            f"flatten {row['flatten_ms']:8.3f} ms ({row['triangles_per_second'] / 1e6:8.1f} M triangles/s)",
            f"cast {row['cast_own_ms']:8.2f} ms ({row['rays_per_second'] / 1e6:8.1f} M rays/s)",
            f"outermost {row['cast_outermost_ms']:8.2f} ms, nearest {row['cast_nearest_ms']:8.2f} ms",
            f"{row['hits'] / max(1, row['rays']):.2%} hit",
            sep="  ",
        )
    result = {"renderer": renderer, "in_software": is_software, "rows": rows}
    if options.output:
        options.output.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
