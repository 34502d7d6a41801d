# SPDX-License-Identifier: GPL-3.0-or-later
"""Render targets: creates them, keeps them between bakes, draws into them and reads them into numpy arrays."""

from __future__ import annotations

import math
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from typing import TypeVar

import numpy as np

from ..core import progress
from . import allocation, shader
from . import blender_gpu as gpu
from .allocation import TEXEL_BYTES
from .shader import Program

_drawn_part: ContextVar[tuple[range, range] | None] = ContextVar("columns and rows to draw", default=None)


@contextmanager
def limited_to(columns: range, rows: range) -> Iterator[None]:
    """In this block, drawing and clearing leave all other texels of targets as they are. Compute shaders are not limited."""
    token = _drawn_part.set((columns, rows))
    try:
        yield
    finally:
        _drawn_part.reset(token)


def drawn_part(width: int, height: int) -> tuple[range, range]:
    """The columns and rows that are drawn of targets of this size."""
    return _drawn_part.get() or (range(width), range(height))


def _limit(width: int, rows: range | None = None) -> bool:
    """Limit the bound framebuffer, of this width, to the part, and to these rows. Returns whether there is a limit, which
    `end` removes."""
    part = _drawn_part.get()
    if part is None and rows is None:
        return False
    columns, of_part = part or (range(width), rows or range(0))
    of_both = of_part if rows is None else range(max(rows.start, of_part.start), min(rows.stop, of_part.stop))
    gpu.state.scissor_test_set(True)
    gpu.state.scissor_set(columns.start, of_both.start, len(columns), len(of_both))
    return True


def _end_limit() -> None:
    """Draw everywhere again."""
    gpu.state.scissor_test_set(False)


KEPT_BYTES = 512 * 2**20
"""The memory that targets may keep between bakes, in bytes; above it they are freed at the end of a bake."""


_READ_FORMAT = {"RGBA32F": ("FLOAT", 4, np.float32), "R16F": ("FLOAT", 1, np.float32), "R8": ("UBYTE", 1, np.uint8)}
_READ_FORMAT |= {"R32F": ("FLOAT", 1, np.float32), "RGBA8": ("UBYTE", 4, np.uint8)}
COPY = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="lib/copied_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "source"),),
    outputs=(("VEC4", "copied_out"),),
)


class Target:
    """Textures to draw into, all of `width` x `height` texels; row 0 is v = 0. A depth format comes last.

    framebuffer: the one of the current `bound` block, or of the last one.
    """

    def __init__(self, width: int, height: int, formats: tuple[str, ...]):
        self.width, self.height, self.formats = width, height, formats
        self.textures = [allocation.texture((width, height), name) for name in formats]
        self.framebuffer = None
        self.bytes = width * height * sum(TEXEL_BYTES[name] for name in formats)

    @classmethod
    def of(cls, width: int, height: int, texel: str, texture: gpu.types.GPUTexture) -> Target:
        """A target of a texture that exists."""
        result = cls(width, height, ())
        result.formats, result.textures = (texel,), [texture]
        return result

    @property
    def texture(self) -> gpu.types.GPUTexture:
        return self.textures[0]

    def read(self, out: np.ndarray, slot: int = 0, start: tuple[int, int] = (0, 0)) -> None:
        """Fill `out`, a C-contiguous array of rows x columns (x channels), from texture `slot`, which was drawn: for one that
        a compute shader wrote there is `read` of this module. start: its first column and row."""
        kind, channels, dtype = _READ_FORMAT[self.formats[slot]]
        if out.dtype != dtype or not out.flags.c_contiguous:
            raise ValueError(f"reading {self.formats[slot]} takes a contiguous {dtype.__name__} array")
        rows, columns = out.shape[:2]
        # The buffer is a view of the array, so that the driver writes where the caller wants the texels.
        buffer = gpu.types.Buffer(kind, (rows, columns, channels), out.reshape(rows, columns, channels))
        with self.bound() as framebuffer:
            framebuffer.read_color(*start, columns, rows, channels, slot, kind, data=buffer)

    def texels(self, slot: int = 0) -> np.ndarray:
        """Texture `slot` as `read` has it: (height, width, channels), or (height, width) for one channel."""
        _, channels, dtype = _READ_FORMAT[self.formats[slot]]
        out = np.empty((self.height, self.width, channels)[: 2 + (channels > 1)], dtype)
        self.read(out, slot)
        return out

    def finish(self) -> None:
        """Wait until all drawing is done: drivers run asynchronously, so that a timer would stop too early."""
        self.first()

    def first(self) -> np.ndarray:
        """The first texel of the first texture, which was drawn. Integers have their first channel alone.

        OpenGL refuses to read four channels of integers as Blender asks for them, and then does not wait either. Vulkan writes
        four channels whatever is asked for, so that there must be room for them.
        """
        kind, channels = ("UINT", 1) if self.formats[0].endswith("UI") else ("FLOAT", 4)
        read = gpu.types.Buffer(kind, 4)
        with self.bound() as framebuffer:
            framebuffer.read_color(0, 0, 1, 1, channels, 0, kind, data=read)
        return np.array(read.to_list()[:channels])

    @contextmanager
    def bound(self, depth: gpu.types.GPUTexture | None = None) -> Iterator[gpu.types.GPUFrameBuffer]:
        """Bind a framebuffer of these textures for this block. depth: a depth texture of the same size, if they have none.

        Each block creates its own: on OpenGL a framebuffer belongs to the window in which it was first bound, and the next
        block may run in another window. All windows share textures.
        """
        own = self.textures[-1] if self.formats[-1].startswith("DEPTH") else None
        colors = [texture for texture in self.textures if texture is not own]
        depth = own or depth
        self.framebuffer = gpu.types.GPUFrameBuffer(depth_slot=depth, color_slots=colors)
        with self.framebuffer.bind():
            yield self.framebuffer


class Offscreen(Target):
    """A gpu.types.GPUOffScreen of one format. Blender adds a depth buffer, which takes memory and is not used.

    Do not create one while drawing into another target: Blender then binds the window's framebuffer instead.
    """

    DEPTH_BYTES = 8
    """Bytes per texel of the depth buffer: single precision and a stencil, as drivers align them."""

    def __init__(self, width: int, height: int, formats: tuple[str]):
        self.width, self.height, self.formats = width, height, formats
        self.offscreen = allocation.offscreen((width, height), formats[0])
        self.textures = [self.offscreen.texture_color]
        self.bytes = width * height * (TEXEL_BYTES[formats[0]] + self.DEPTH_BYTES)

    @contextmanager
    def bound(self, depth: None = None) -> Iterator[gpu.types.GPUFrameBuffer]:
        """As Target.bound, with its own depth buffer. Do not keep the framebuffer: it belongs to the current window."""
        with self.offscreen.bind():
            yield gpu.state.active_framebuffer_get()


def read(texture: gpu.types.GPUTexture, out: np.ndarray) -> None:
    """Fill `out`, a C-contiguous float32 array of rows x width x 4, with the first rows of `texture` (RGBA32F).

    Compute shaders may have written the texture: it is copied by drawing first, since Blender has no barrier on OpenGL between
    them and a framebuffer that is read.
    """
    copied = Target(out.shape[1], out.shape[0], ("RGBA32F",))
    fill(copied, COPY, source=texture)
    copied.read(out)


Kind = TypeVar("Kind", bound=Target)


_pools: weakref.WeakSet[TargetPool] = weakref.WeakSet()
allocation.held.append(lambda: sum(pool.bytes for pool in _pools))


class TargetPool:
    """Targets by their roles, each kept until one of another size or format is asked for.

    most_bytes: what they may hold between bakes; `trim` frees them all when it is more.
    """

    def __init__(self, most_bytes: int = KEPT_BYTES):
        self.most_bytes = most_bytes
        self._targets: dict[str, Target] = {}
        _pools.add(self)
        self._last_use = -math.inf

    def __len__(self) -> int:
        return len(self._targets)

    @property
    def roles(self) -> list[str]:
        return sorted(self._targets)

    @property
    def bytes(self) -> int:
        """What the targets hold on the GPU."""
        return sum(target.bytes for target in self._targets.values())

    @property
    def idle_seconds(self) -> float:
        """Seconds since the last bake asked for a target, whichever pool it uses."""
        return time.monotonic() - self._last_use

    def note_use(self) -> None:
        """Start `idle_seconds` from 0 again."""
        self._last_use = time.monotonic()

    def find(self, role: str) -> Target | None:
        """The target kept for `role`, or None."""
        return self._targets.get(role)

    def get(self, role: str, kind: type[Kind], width: int, height: int, formats: tuple[str, ...]) -> Kind:
        """The target kept for `role` if it is of this kind, size and formats, else a new one in its place."""
        target = self._targets.get(role)
        if isinstance(target, kind) and (target.width, target.height, target.formats) == (width, height, formats):
            return target
        del target
        self._targets.pop(role, None)  # freed before the new one is made
        made = self._targets[role] = kind(width, height, formats)
        return made

    def trim(self) -> None:
        """Free the targets if they hold more than `most_bytes`."""
        if self.bytes > self.most_bytes:
            self.free()

    def free(self) -> None:
        """Free all targets."""
        self._targets.clear()


common = TargetPool()
"""The pool that bakes share."""
_in_use = ContextVar("pool in use", default=common)


def get(role: str, width: int, height: int, *formats: str) -> Target:
    """The target for `role` from the pool in use."""
    common.note_use()
    return _in_use.get().get(role, Target, width, height, formats)


def offscreen(role: str, width: int, height: int, texel: str) -> Offscreen:
    """As `get`, of one format and a gpu.types.GPUOffScreen; `get` returns it too when asked for the same role."""
    common.note_use()
    return _in_use.get().get(role, Offscreen, width, height, (texel,))


def free_current() -> None:
    """Free all targets of the pool in use."""
    _in_use.get().free()


@contextmanager
def using(pool: TargetPool) -> Iterator[None]:
    """In this block targets come from `pool` and stay there; bakes that go on outside do not draw into them."""
    token = _in_use.set(pool)
    try:
        yield
    finally:
        _in_use.reset(token)


@contextmanager
def drawing(
    into: Target,
    rows: range | None = None,
    *,
    clear: bool = True,
    stopped: gpu.types.GPUTexture | None = None,
    writes_depth: bool = False,
) -> Iterator[None]:
    """Draw into `into` in this block. It is cleared first, unless `clear` is False. rows: limits drawing to these rows.

    stopped: a depth texture, which limits drawing to the texels that are not drawn in it; it stays as it is. writes_depth:
    draw into the depth of `into` too, where the first of several stays.
    """
    blending, test, mask = gpu.state.blend_get(), gpu.state.depth_test_get(), gpu.state.depth_mask_get()
    gpu.state.blend_set("NONE")  # a script may have left another state
    gpu.state.depth_test_set("LESS" if stopped or writes_depth else "NONE")
    gpu.state.depth_mask_set(writes_depth)
    gpu.state.color_mask_set(True, True, True, True)
    with into.bound(stopped) as framebuffer:
        gpu.state.viewport_set(0, 0, into.width, into.height)
        is_limited = _limit(into.width)
        if clear:
            framebuffer.clear(color=(0.0, 0.0, 0.0, 0.0), **({"depth": 1.0} if writes_depth else {}))
        is_limited |= _limit(into.width, rows)
        try:
            yield
        finally:
            if is_limited:
                _end_limit()
            gpu.state.depth_mask_set(mask)
            gpu.state.depth_test_set(test)
            gpu.state.blend_set(blending)


def clear(target: Target) -> None:
    """Set all of `target` to 0: the memory of a new texture is not initialized."""
    with drawing(target):
        pass


def fill(
    target: Target,
    program: Program,
    rows: range | None = None,
    *,
    clear: bool = False,
    stopped: gpu.types.GPUTexture | None = None,
    writes_depth: bool = False,
    **bindings,
) -> None:
    """Run `program`'s fragment shader on every texel of `target`, or of these rows; options as in `drawing`, `bindings` as in
    `bind`."""
    compiled = shader.load(program)

    def draw_triangle() -> None:
        compiled.bind()
        bind(compiled, program, **bindings)
        _triangle().draw(compiled)

    _draw_in_pieces(target, program, rows, draw_triangle, clear=clear, stopped=stopped, writes_depth=writes_depth)


def draw(
    into: Target,
    program: Program,
    mesh: gpu.types.GPUBatch,
    *,
    clear: bool = True,
    stopped: gpu.types.GPUTexture | None = None,
    writes_depth: bool = False,
    parts: Sequence[tuple[int, int]] | None = None,
    **bindings,
) -> None:
    """Draw a mesh into `into`; options as in `drawing`, the others as in `draw_bound`."""
    drawn = partial(draw_bound, program, mesh, parts, **bindings)
    _draw_in_pieces(into, program, None, drawn, clear=clear, stopped=stopped, writes_depth=writes_depth)


def _draw_in_pieces(
    into: Target, program: Program, rows: range | None, draw_piece: Callable[[], None], *, clear: bool, **options
) -> None:
    """Draw these rows of `into`, or all of them, at once or in pieces as core.progress has them; options as in `drawing`."""
    _, drawn = drawn_part(into.width, into.height)
    pieces = (
        [rows] if rows is not None else progress.pieces(into.height, program.cost * into.width, progress.SLICE_ROWS)
    )
    pieces = [piece for piece in pieces if piece.start < drawn.stop and drawn.start < piece.stop]
    for number, piece in enumerate(pieces):
        with drawing(into, piece if len(pieces) > 1 else rows, clear=clear and not number, **options):
            draw_piece()
        if len(pieces) > 1:
            into.finish()


def draw_bound(
    program: Program, mesh: gpu.types.GPUBatch, parts: Sequence[tuple[int, int]] | None = None, **bindings
) -> None:
    """Draw a mesh into the bound framebuffer; `bindings` as in `bind`. parts: the first triangle and the number of triangles of
    each part that is drawn; None for all."""
    compiled = shader.load(program)
    compiled.bind()
    bind(compiled, program, **bindings)
    if parts is None:
        mesh.draw(compiled)
    for first, count in parts or ():
        mesh.draw_range(compiled, elem_start=3 * first, elem_count=3 * count)


def dispatch(program: Program, width: int, rows: range, **bindings) -> None:
    """Run `program`'s compute shader on these rows of `width` texels; `bindings` as in `bind`, less first_row."""
    groups = -(-width // program.group[0]), -(-len(rows) // program.group[1])
    dispatch_groups(program, groups, first_row=rows.start, **bindings)


def dispatch_groups(program: Program, groups: tuple[int, int], **bindings) -> None:
    """Run so many workgroups of `program`'s compute shader, across and up; `bindings` as in `bind`."""
    compiled = shader.load(program)
    compiled.bind()
    bind(compiled, program, **bindings)
    gpu.compute.dispatch(compiled, *groups, 1)


def bind(compiled: gpu.types.GPUShader, program: Program, **bindings) -> None:
    """Set the samplers, images and push constants of `program` by name, according to their declared types."""
    as_images = shader.reads_images()
    for _, name in program.all_samplers(as_images):
        compiled.uniform_sampler(name, bindings.pop(name))
    for _, _, name, _ in program.all_images(as_images):
        compiled.image(name, bindings.pop(name))
    for kind, name in program.constants:
        value = bindings.pop(name)
        (compiled.uniform_int if kind in {"INT", "IVEC4"} else compiled.uniform_float)(name, value)
    if bindings:
        raise TypeError(f"{program.fragment or program.compute} declares no {', '.join(bindings)}")


def _triangle() -> gpu.types.GPUBatch:
    corners = np.array([(-1.0, -1.0), (3.0, -1.0), (-1.0, 3.0)], np.float32)
    return gpu.types.GPUBatch(type="TRIS", buf=allocation.corners("position", corners))
