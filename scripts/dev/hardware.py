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
from pathlib import Path

import moderngl
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.passes import data_texture  # noqa: E402
from addon.passes.bake import cast, flatten, gbuffer  # noqa: E402
from addon.passes.program import Program, in_software, prelude, source  # noqa: E402

REPEATS = 9
TYPES = {"VEC2": "vec2", "VEC3": "vec3", "VEC4": "vec4", "MAT4": "mat4", "FLOAT": "float", "INT": "int"}
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
    lines += [f"smooth {way} {TYPES[kind]} {name};" for kind, name in program.varyings]
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
        self.flatten, self.gbuffer, self.trace, self.lookup = (
            load(ctx, program, as_images) for program in (flatten.PROGRAM, gbuffer.PROGRAM, cast.TRACE, cast.LOOKUP)
        )
        self.uv_to_clip = (2.0, 2.0, -1.0, -1.0)
        self.identity = tuple(np.eye(4).ravel().tolist())
        self.high = self._mesh(self.flatten, flatten.PROGRAM, "high_triangles", uv="high_uv", normal="high_normal")
        self.low = self._mesh(
            self.gbuffer, gbuffer.PROGRAM, "low_triangles", uv="low_uv", position="low_position",
            direction="low_direction",
        )  # fmt: skip
        self.triangle = ctx.vertex_array(
            self.lookup, [(ctx.buffer(np.array([-1, -1, 3, -1, -1, 3], "f4").tobytes()), "2f", "position")]
        )
        self.nodes, self.corners, self.normals = (self._table(name) for name in ("nodes", "corners", "normals"))
        self.positions, self.directions, self.map = (self._texture("f4") for _ in range(3))
        self.hits = self._texture("u4")
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

    def _mesh(self, compiled, program, triangles: str, **attributes: str) -> moderngl.VertexArray:
        parts = []
        for kind, name in program.inputs:
            values = np.ascontiguousarray(self.data[attributes[name]], np.float32)
            parts.append((self.ctx.buffer(values.tobytes()), f"{TYPES[kind][-1]}f", name))
        index = self.ctx.buffer(np.ascontiguousarray(self.data[triangles], np.int32).tobytes())
        return self.ctx.vertex_array(compiled, parts, index_buffer=index)

    def _table(self, name: str) -> moderngl.Texture:
        values = self.data[name].reshape(-1, self.data[name].shape[-1])
        padded, width = data_texture.empty(len(values)), data_texture.WIDTH
        padded[: len(values), : values.shape[1]] = values
        texture = self.ctx.texture((width, len(padded) // width), 4, padded.tobytes(), dtype="f4")
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
        self._bind(self.gbuffer, gbuffer.PROGRAM, uv_to_clip=self.uv_to_clip)
        self.low.render(moderngl.TRIANGLES)

    def cast_rays(self) -> None:
        """Trace all rays to the triangles that they hit."""
        data = self.data
        self._bind(
            self.trace,
            cast.TRACE,
            positions=self.positions,
            directions=self.directions,
            nodes=self.nodes,
            corners=self.corners,
            hits=self.hits,
            grid_origin=(*data["origin"].tolist(), 0.0),
            grid_scale=(*data["scale"].tolist(), 0.0),
            first_row=0,
            direction_sign=-1.0,
            start_offset=float(data["extrusion"]),
            max_t=float(data["reach"]),
            first_leaf=int(data["first_leaf"]),
            facing_only=0,
        )
        self.trace.run(-(-self.size // 8), -(-self.size // 8), 1)
        self.ctx.memory_barrier()

    def look_up(self) -> None:
        """Write the normals at the hits."""
        self.drawn.use()
        self._bind(
            self.lookup,
            cast.LOOKUP,
            hits=self.hits,
            positions=self.positions,
            normals=self.normals,
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
    rays = int((np.frombuffer(scene.positions.read(), np.float32).reshape(-1, 4)[:, 3] > 0.0).sum())
    cast = timed(ctx, scene.cast_rays)
    whole = timed(ctx, scene.start_rays, scene.cast_rays, scene.look_up, scene.read)
    hit = int((np.frombuffer(scene.hits.read(), np.uint32).reshape(-1, 4)[:, 0] > 0).sum())
    triangles = len(data["high_triangles"])
    other = Scene(ctx, data, size, as_images=not is_software)
    other.start_rays()
    cast_otherwise = timed(ctx, other.cast_rays)
    return {
        "pair": path.stem,
        "size": size,
        "high": triangles,
        "low": len(data["low_triangles"]),
        "flatten_ms": flat * 1e3,
        "flatten_with_read_back_ms": flat_with_reading * 1e3,
        "triangles_per_second": triangles / flat,
        "coverage": covered,
        "starts_ms": starts * 1e3,
        "cast_ms": cast * 1e3,
        "cast_with_read_back_ms": whole * 1e3,
        "cast_from_images_ms": (cast if is_software else cast_otherwise) * 1e3,
        "cast_from_samplers_ms": (cast_otherwise if is_software else cast) * 1e3,
        "rays": rays,
        "hits": hit,
        "rays_per_second": rays / cast,
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
            f"cast {row['cast_ms']:8.2f} ms ({row['rays_per_second'] / 1e6:8.1f} M rays/s)",
            f"{row['hits'] / max(1, row['rays']):.2%} hit",
            sep="  ",
        )
    result = {"renderer": renderer, "in_software": is_software, "rows": rows}
    if options.output:
        options.output.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
