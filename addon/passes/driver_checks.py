# SPDX-License-Identifier: GPL-3.0-or-later
"""What Imprint relies on a driver for, each as a check of its own that takes the passes' way: uploads, drawing, computing,
read-backs, memory.

The work of a check is in short slices, so that no driver takes a slow GPU for a hang.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ..core import udim
from ..core.errors import BakeError, NoGpuMemory
from . import audit, data_texture, high_in_uv, mesh_upload, shader, target
from . import blender_gpu as gpu
from .shader import Program

Check: TypeAlias = Generator[None, None, str]
"""Yields between slices. Returns what was measured, in a few words, or nothing. Raises CheckFailed."""


class CheckFailed(Exception):
    """The driver fails a check. The message is a sentence that says what happened."""


@dataclass(frozen=True)
class DriverCheck:
    """A check of the driver.

    Attributes:
        name: For the report.
        check: Raises CheckFailed where the driver does something else.
    """

    name: str
    check: Callable[[], Check]


LONG = Program(
    compute="driver_checks/long_comp.glsl",
    images=(("RGBA32F", "FLOAT_2D", "values", "WRITE"), ("RGBA32UI", "UINT_2D", "numbers", "WRITE")),
    constants=(("INT", "first"), ("INT", "turns")),
)
ONE_MORE = Program(
    compute="driver_checks/step_comp.glsl",
    texels=(("RGBA32F", "FLOAT_2D", "source"),),
    images=(("RGBA32F", "FLOAT_2D", "into", "WRITE"),),
)
_INTEGERS = (
    ("RGBA32UI", "UINT_2D", "hits"),
    ("R16I", "INT_2D", "offsets"),
    ("R32I", "INT_2D", "source_rows"),
)
WRITE_INTEGERS = Program(
    compute="driver_checks/integers_comp.glsl", images=tuple((*each, "WRITE") for each in _INTEGERS)
)


def _drawn(name: str, texels: tuple[tuple[str, str, str], ...], outputs: Iterable[str], **more) -> Program:
    return Program(
        vertex="lib/fullscreen_vert.glsl",
        fragment=f"driver_checks/{name}_frag.glsl",
        inputs=(("VEC2", "position"),),
        texels=texels,
        outputs=tuple(("VEC4", name) for name in outputs),
        **more,
    )


_TABLE = (("RGBA32F", "FLOAT_2D", "table"),)
READ_INTEGERS = _drawn("integers", _INTEGERS, ("unsigned_out", "signed_out"))
READ_NUMBERS = _drawn("numbers", _TABLE, ("number_out",))
READ_CORNERS = _drawn("corners", _TABLE, ("value_out", "size_out"))
READ_VECTORS = _drawn("vectors", _TABLE, ("unit_out", "components_out"))
READ_CONSTANTS = _drawn("constants", (), ("constant_out",), constants=(("MAT4", "left"), ("MAT4", "right")))


def _expect(actual: np.ndarray, wanted: np.ndarray, what: str) -> None:
    """Raise CheckFailed unless both arrays (..., channels) are equal to the bit."""
    wanted = np.ascontiguousarray(np.broadcast_to(wanted, actual.shape), actual.dtype)
    differs = (actual.view(np.uint32) != wanted.view(np.uint32)).any(axis=-1)
    if differs.any():
        place = np.unravel_index(int(np.argmax(differs)), differs.shape)
        raise CheckFailed(
            f"{what}: {np.count_nonzero(differs):,} of {differs.size:,} are wrong, first {tuple(map(int, place))}: "
            f"{_numbers(actual[place])}, not {_numbers(wanted[place])}."
        )


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values.tolist())


def _hashed(count: int, seed: int) -> np.ndarray:
    """`count` texels (count, 4) float32, numbers from 1 to 2. They differ from texel to texel, and from seed to seed."""
    numbers = np.arange(4 * count, dtype=np.uint32) * np.uint32(2654435761)
    numbers = (numbers ^ (numbers >> np.uint32(15))) * np.uint32(2246822519 + 2 * seed)
    return ((numbers >> np.uint32(9)) | np.uint32(0x3F800000)).view(np.float32).reshape(count, 4)


def _compute(program: Program, size: tuple[int, int], **bindings) -> None:
    """Run a compute shader on all texels of textures of this size."""
    groups = -(-size[0] // program.group[0]), -(-size[1] // program.group[1])
    target.dispatch_groups(program, groups, **bindings)


def _read(texture: gpu.types.GPUTexture) -> np.ndarray:
    """All texels (height, width, 4) float32, by the way of textures that compute shaders wrote."""
    out = np.empty((texture.height, texture.width, 4), np.float32)
    target.read(texture, out)
    return out


# Waiting

COMPARED_SIDE = 64
"""Texels along each side of what is compared."""
LONG_SECONDS = 0.06
"""A dispatch of this length stands out from the clock and from other programs. Windows resets a GPU after 2 seconds."""
SAFE_TURNS = 2**15
"""The most turns of loops that Imprint takes: see shaders/lib/turns_lib.glsl."""
MOST_SIDE = 2**11
"""Texels along each side of what a long dispatch writes, at most."""
STEPS_OF_TURN = 8
"""As in shaders/driver_checks/long_comp.glsl."""
WAITED = 0.3
"""A wait that leaves more than this share of the time to the read-back after it is none."""
ATTEMPTS = 5
"""One of them is enough: other programs may take the processor for as long as the dispatch takes."""


def _sequence(first: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """What long_comp writes: values (N, N, 4) float32 and numbers (N, N) uint32, N = COMPARED_SIDE."""
    factor, added, power, plus = 1, 0, 1664525, 1013904223
    while steps:  # n steps of the sequence at once are one such step with other numbers
        if steps & 1:
            factor, added = factor * power % 2**32, (added * power + plus) % 2**32
        power, plus, steps = power * power % 2**32, (power + 1) * plus % 2**32, steps >> 1
    numbers = np.arange(first, first + COMPARED_SIDE * COMPARED_SIDE, dtype=np.uint32).reshape(
        COMPARED_SIDE, COMPARED_SIDE
    )
    numbers = numbers * np.uint32(factor) + np.uint32(added)
    values = np.ones((COMPARED_SIDE, COMPARED_SIDE, 4), np.float32)
    values[..., 0], values[..., 1], values[..., 3] = numbers >> np.uint32(8), numbers & np.uint32(255), -1.0
    return values, numbers


class _LongDispatch:
    """Textures that a long dispatch writes. turns: of its loop; seconds: what it took."""

    def __init__(self, side: int = COMPARED_SIDE):
        self.turns, self.seconds, self._first = 2**9, 0.0, 0
        self._resize(side)

    def _resize(self, side: int) -> None:
        self.values = target.Target(side, side, ("RGBA32F",))
        self.numbers = target.Target(side, side, ("RGBA32UI",))

    def grow(self) -> Check:
        """Find out how many turns, and for how many texels, take LONG_SECONDS, from few on."""
        shader.load(LONG)
        while self.seconds < LONG_SECONDS and self.values.width < MOST_SIDE:
            # Four times the work is at most four times the slice.
            if self.turns < SAFE_TURNS:
                self.turns *= 2 if self.seconds > LONG_SECONDS / 4.0 or self.turns * 4 > SAFE_TURNS else 4
            else:
                self._resize(2 * self.values.width)
            start = time.perf_counter()
            self.run()
            self.read()
            self.seconds = time.perf_counter() - start
            yield
        return ""

    def run(self) -> None:
        self._first += 1000
        _compute(
            LONG,
            (self.values.width, self.values.height),
            values=self.values.texture,
            numbers=self.numbers.texture,
            first=self._first,
            turns=self.turns,
        )

    def read(self) -> np.ndarray:
        """The first texels of the values, (COMPARED_SIDE, COMPARED_SIDE, 4) float32, or all if these are fewer."""
        side = min(COMPARED_SIDE, self.values.width)
        out = np.empty((side, side, 4), np.float32)
        target.read(self.values.texture, out)
        return out

    @property
    def expected(self) -> np.ndarray:
        """What `read` returns after `run`."""
        return _sequence(self._first, self.turns * STEPS_OF_TURN)[0][: self.values.width, : self.values.width]


MOST_TURNS = 2**20
"""The most turns of a loop that are tried."""


def _loops_end_where_they_should() -> Check:
    """Drivers in software end loops after 65,535 turns, which is enough."""
    work = _LongDispatch(side=8)

    def is_right(turns: int) -> bool:
        work.turns = turns
        work.run()
        return np.array_equal(work.read(), work.expected)

    if not is_right(SAFE_TURNS):
        raise CheckFailed(f"A loop of {SAFE_TURNS:,} turns ends too early, or its numbers are wrong.")
    right, wrong = SAFE_TURNS, 2 * SAFE_TURNS
    while wrong <= MOST_TURNS and is_right(wrong):
        right, wrong = wrong, 2 * wrong
        yield
    if wrong > MOST_TURNS:
        return f"{right:,} turns and more"
    while wrong - right > 1:
        middle = (right + wrong) // 2
        right, wrong = (middle, wrong) if is_right(middle) else (right, middle)
        yield
    return f"this driver ends loops after {right:,} turns, Imprint's are shorter"


def _read_waits() -> Check:
    work = _LongDispatch()
    yield from work.grow()
    for _ in range(3):
        work.run()
        _expect(work.read(), work.expected, "A read-back after a long dispatch")
        yield
    return f"{work.seconds * 1e3:.0f} ms"


def _finish_waits() -> Check:
    work = _LongDispatch()
    yield from work.grow()
    done = []
    for each in (work.values, work.numbers):
        texel, took, left = each.formats[0], 0.0, 0.0
        for _ in range(ATTEMPTS):
            began = time.perf_counter()
            work.run()
            start = time.perf_counter()
            each.finish()
            waited = time.perf_counter()
            _expect(work.read(), work.expected, f"A read-back after waiting for {texel}")
            took, left, whole = waited - start, time.perf_counter() - waited, time.perf_counter() - began
            yield
            if left < WAITED * whole:
                break
        else:
            raise CheckFailed(
                f"Waiting for {texel} took {1e3 * took:.1f} ms, and the dispatch was still running: the next read-back took "
                f"{1e3 * left:.0f} ms."
            )
        done.append(f"{texel} {1e3 * took:.1f} ms")
    return ", ".join(done)


# Computing

STEPS = 48


def _dispatches_are_done() -> Check:
    values = _hashed(40 * 24, 1).reshape(24, 40, 4)
    pair = [target.Target(40, 24, ("RGBA32F",)) for _ in range(2)]
    # The first one is drawn, as sums are.
    target.fill(pair[0], target.COPY, source=data_texture.image(values))
    expected = values
    for step in range(STEPS):
        source, into = pair[step % 2], pair[1 - step % 2]
        _compute(ONE_MORE, (40, 24), source=source.texture, into=into.texture)
        expected = np.roll(expected, (-3, 1), axis=(0, 1)) + np.float32(1.0)
        if step % 16 == 15:
            _expect(_read(into.texture), expected, f"{step + 1} dispatches in a row")
            yield
    return f"{STEPS} dispatches"


def _drawing_sees_computing() -> Check:
    first, second = (target.Target(40, 24, ("RGBA32F",)) for _ in range(2))
    for turn in range(8):
        values = _hashed(40 * 24, turn).reshape(24, 40, 4)
        target.fill(first, target.COPY, source=data_texture.image(values))
        _compute(ONE_MORE, (40, 24), source=first.texture, into=second.texture)
        target.fill(first, target.COPY, source=second.texture)
        actual = np.empty_like(values)
        first.read(actual)
        _expect(actual, np.roll(values, (-3, 1), axis=(0, 1)) + np.float32(1.0), "Drawing what was computed")
        yield
    return ""


# Numbers


def _integers_are_kept() -> Check:
    width, height = 80, 24
    written = [target.Target(width, height, (each[0],)) for each in _INTEGERS]
    textures = {name: each.texture for (_, _, name), each in zip(_INTEGERS, written, strict=True)}
    _compute(WRITE_INTEGERS, (width, height), **textures)
    read = target.Target(width, height, ("RGBA32F", "RGBA32F"))
    target.fill(read, READ_INTEGERS, **textures)
    place = np.arange(width * height, dtype=np.int64).reshape(height, width)
    row = (place - 100) * 65537
    unsigned = [place, place + 0.5, ((1 << 31) + place) >> 8, np.full_like(place, 65535)]
    signed = [place - 32000, row >> 16, row & 65535, place & 255]
    for slot, channels in enumerate((unsigned, signed)):
        _expect(read.texels(slot), np.stack(channels, axis=-1).astype(np.float32), "Textures of whole numbers")
        yield
    return ""


def _floats_are_kept() -> Check:
    whole = np.unique(np.concatenate([base + np.arange(-40, 41) for base in 2 ** np.arange(1, 25)]))
    whole = whole[(whole >= 0) & (whole <= 2**24)].astype(np.float32)
    others = np.array([1 / 3, 0.1, 1e-30, 1e30, 2.0**-126, 3.4e38, np.pi, 65519.0, 65520.0, 1.0 + 2.0**-23], np.float32)
    values = np.concatenate([whole, -whole, others, -others])
    table = np.resize(values, (-(-len(values) // 4), 4))
    texture = data_texture.upload(table)
    _expect(_read(texture)[0, : len(table)], table, "Floats, and whole numbers up to 2^24")
    yield
    numbers = np.resize(np.concatenate([whole, whole[whole < 2**22] * 4]).astype(np.int64), (900, 4))
    numbers[0] = 0, 1, 2**23, 2**24 - 1
    read = target.Target(len(numbers), 1, ("RGBA32F",))
    target.fill(read, READ_NUMBERS, table=data_texture.upload_numbers(numbers))
    _expect(read.texels()[0], numbers.astype(np.float32), "Whole numbers in the bits of floats")
    return ""


def _corners_are_read() -> Check:
    sizes = (4096, 7), (1, 1), (77, 131), (gpu.capabilities.max_texture_size_get(), 1)
    for number, (width, height) in enumerate(sizes):
        values = _hashed(width * height, number).reshape(height, width, 4)
        read = target.Target(2, 2, ("RGBA32F", "RGBA32F"))
        target.fill(read, READ_CORNERS, table=data_texture.image(values))
        _expect(
            read.texels(1), np.array([width, height, 0, 0], np.float32), f"The size of a texture of {width} x {height}"
        )
        corners = values[[0, -1]][:, [0, -1]]
        _expect(read.texels(), corners, f"The corners of a texture of {width} x {height}")
        yield
    return ""


TABLE_ROWS = 263
"""Of a table of 4096 texels a row: 17 MB. A prime number, which no block divides."""


def _tables_arrive() -> Check:
    count = TABLE_ROWS * data_texture.WIDTH - 5
    values = _hashed(count, 7)
    try:
        texture = data_texture.upload(values)
    except NoGpuMemory as error:  # the upload reads the last texel back
        raise CheckFailed(f"The end of a table of {values.nbytes / 1e6:.0f} MB did not arrive.") from error
    yield
    texels = _read(texture).reshape(-1, 4)
    yield
    _expect(texels[:count], values, f"The texels of a table of {texture.height} rows")
    return f"{texels.nbytes / 1e6:.0f} MB"


def _vectors_without_length() -> Check:
    """Nothing is asked of vectors that are no numbers: fast math, as on Metal, takes them to be absent."""
    vectors = np.zeros((5, 4), np.float32)
    vectors[:, :3] = (0, 0, 0), (1e-18, 0, 0), (1e18, 0, 0), (3, 0, 4), (0, -1e-3, 0)
    exists = np.array([0, 0, 0, 1, 1], np.float32)
    read = target.Target(len(vectors), 1, ("RGBA32F", "RGBA32F"))
    target.fill(read, READ_VECTORS, table=data_texture.image(vectors[None]))
    yield
    units, components = read.texels(0)[0], read.texels(1)[0]
    _expect(units[:, 3:], exists[:, None], "Vectors that have a direction")
    if not (units[0, :3] == 0.0).all():
        raise CheckFailed(f"The unit vector of (0, 0, 0) is {_numbers(units[0, :3])}, not 0 0 0.")
    if not (np.abs(units[3:, :3] - np.array([(0.6, 0, 0.8), (0, -1, 0)], np.float32)) < 1e-6).all():
        raise CheckFailed(f"The unit vector of (3, 0, 4) is {_numbers(units[3, :3])}, not 0.6 0 0.8.")
    if not (components[[0, 3, 4], :3] == 0.0).all():
        raise CheckFailed("The components of a vector in a basis without volume are not 0.")
    return ""


def _constants_arrive() -> Check:
    matrices = _hashed(8, 3).reshape(2, 4, 4)
    read = target.Target(4, 2, ("RGBA32F",))
    left, right = map(shader.mat4, matrices.astype(np.float64))
    target.fill(read, READ_CONSTANTS, left=left, right=right)
    yield
    _expect(read.texels(), matrices.transpose(0, 2, 1), "128 bytes of constants")
    return ""


# Drawing


def _first_row_is_lowest() -> Check:
    size = 32
    uv = np.array([(0, 0), (0.5, 0), (0, 0.25), (1, 1), (1, 0.75), (0.5, 1)], np.float32)
    normal = np.repeat(np.array([(0.6, 0.0, 0.8), (0.0, 0.0, 1.0)], np.float32), 3, axis=0)
    # One triangle runs counter-clockwise, the other one clockwise: both are drawn.
    mesh = mesh_upload.upload(np.array([[0, 1, 2], [3, 4, 5]], np.int32), uv=uv, normal=normal)
    flipped = mesh_upload.upload(np.array([[0, 2, 1], [3, 5, 4]], np.int32), uv=uv, normal=normal)
    u, v = np.meshgrid(*[(np.arange(size) + 0.5) / size] * 2)
    wanted = np.zeros((size, size, 4), np.float32)
    wanted[u / 0.5 + v / 0.25 < 1.0] = 0.6, 0.0, 0.8, 1.0
    wanted[(1.0 - u) / 0.5 + (1.0 - v) / 0.25 < 1.0] = 0.0, 0.0, 1.0, 1.0
    # Texels on the edges between both rows belong to either side.
    inside = np.abs(np.minimum(u / 0.5 + v / 0.25, (1.0 - u) / 0.5 + (1.0 - v) / 0.25) - 1.0) > 1e-3
    for winding, each in (("counter-clockwise", mesh), ("clockwise", flipped)):
        into = target.Target(size, size, ("RGBA32F",))
        high_in_uv.draw_normals(into, [(each, np.eye(3))], udim.uv_to_clip(1001))
        drawn = into.texels()
        wrong = inside & (np.abs(drawn - wanted) > 1e-6).any(axis=-1)
        if wrong.any():
            where = tuple(map(int, np.argwhere(wrong)[0]))
            raise CheckFailed(
                f"Triangles that run {winding}: {np.count_nonzero(wrong)} of {wrong.size} texels are wrong, the first in row "
                f"{where[0]}, column {where[1]}: {_numbers(drawn[where])}, not {_numbers(wanted[where])}."
            )
        yield
    part = np.empty((5, 7, 4), np.float32)
    into.read(part, start=(2, 1))
    _expect(part, drawn[1:6, 2:9], "A part of a texture")
    return ""


def _only_the_last_stays() -> Check:
    """Without blending, and with it."""
    size = 16
    first, second = (_hashed(size * size, seed).reshape(size, size, 4) for seed in (11, 12))
    into = target.Target(size, size, ("RGBA32F",))
    left = gpu.state.blend_get()
    gpu.state.blend_set("ADDITIVE")  # as a script may leave it
    try:
        for values in (first, second):
            target.fill(into, target.COPY, source=data_texture.image(values))
    finally:
        gpu.state.blend_set(left)
    _expect(into.texels(), second, "What is drawn last, without blending")
    yield
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    mesh = mesh_upload.upload(np.array([[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 1, 2], [0, 2, 3]], np.int32), uv=square)
    counts = audit.counts(mesh, (size, size), udim.uv_to_clip(1001))
    below = np.add.outer(-np.arange(size), np.arange(size)) > 0  # the triangle at the lower right
    if not ((counts[below] == 3).all() and (counts[below.T] == 2).all()):
        raise CheckFailed(f"Three and two triangles that are added up are {sorted(set(counts.ravel().tolist()))}.")
    return ""


def _depth_and_rows_limit() -> Check:
    size = 16
    first, second, third = (_hashed(size * size, seed).reshape(size, size, 4) for seed in (21, 22, 23))
    stopped = target.Target(size, size, ("RGBA32F", "DEPTH_COMPONENT32F"))
    rows, rest = range(3, 9), np.r_[0:3, 9:size]
    target.fill(stopped, target.COPY, rows, clear=True, writes_depth=True, source=data_texture.image(first))
    target.fill(stopped, target.COPY, writes_depth=True, source=data_texture.image(second))
    wanted = second.copy()
    wanted[rows] = first[rows]
    _expect(stopped.texels(), wanted, "What is drawn first, with depth")
    yield
    limit = target.Target(size, size, ("RGBA32F", "DEPTH_COMPONENT32F"))
    target.fill(limit, target.COPY, rows, clear=True, writes_depth=True, source=data_texture.image(first))
    into = target.Target(size, size, ("RGBA32F",))
    target.fill(into, target.COPY, source=data_texture.image(second))
    target.fill(into, target.COPY, stopped=limit.textures[1], source=data_texture.image(third))
    wanted = second.copy()
    wanted[rest] = third[rest]
    _expect(into.texels(), wanted, "Drawing beside what a depth texture stops")
    return ""


# Memory


def _targets_are_cleared() -> Check:
    size = 256
    for _ in range(4):
        spoiled = target.Target(size, size, ("RGBA32F",))
        target.fill(spoiled, target.COPY, source=data_texture.image(np.full((size, size, 4), np.nan)))
        spoiled.finish()
        del spoiled
        fresh = target.Target(size, size, ("RGBA32F",))
        target.clear(fresh)
        _expect(fresh.texels(), np.zeros(4, np.float32), "A new texture after it was cleared")
        yield
    return ""


MOST_MEMORY = 2**30
"""Bytes that the check of memory takes at most."""
MEMORY_STEP = 2**26
IN_SOFTWARE = 2**28
"""Bytes at most where the GPU is a program, whose memory is that of the system."""


def _memory_is_granted() -> Check:
    """Blender's gpu module does not say how much memory there is."""
    side = math.isqrt(MEMORY_STEP // 16)
    most = IN_SOFTWARE if shader.in_software() else MOST_MEMORY
    held = []
    while len(held) * MEMORY_STEP < most:
        into = target.Target(side, side, ("RGBA32F",))
        with target.drawing(into, clear=False):
            gpu.state.active_framebuffer_get().clear(color=(float(len(held) + 1), 0.0, 0.0, 1.0))
        held.append(into)
        yield
    texels = np.empty((2, side, 4), np.float32)
    for number, into in enumerate(held, start=1):
        into.read(texels, start=(0, side - 2))
        _expect(texels, np.array((number, 0, 0, 1), np.float32), f"Texture {number} of {len(held)}")
    del into
    held.clear()
    yield
    again = target.Target(side, side, ("RGBA32F",))
    target.clear(again)
    again.read(texels)
    _expect(texels, np.zeros(4, np.float32), "A texture after the others were freed")
    return f"{most // 2**20:,} MiB"


def _too_much_is_refused() -> Check:
    side = gpu.capabilities.max_texture_size_get()
    try:
        data_texture.empty(data_texture.limit() + 1)
    except BakeError:
        pass
    else:
        raise CheckFailed(f"A table of more than {data_texture.limit():,} texels was not refused.")
    yield
    # On OpenGL, Blender asks the driver first. On Vulkan and Metal such a texture is a fault of the program, which may end it.
    if gpu.platform.backend_type_get() == "OPENGL":
        try:
            gpu.types.GPUTexture((2 * side, 4), format="RGBA32F")
        except (RuntimeError, ValueError, MemoryError):
            pass
        else:
            raise CheckFailed(f"A texture of {2 * side:,} texels a side was granted, where {side:,} are the most.")
    yield
    values = _hashed(64, 5).reshape(8, 8, 4)
    into = target.Target(8, 8, ("RGBA32F",))
    target.fill(into, target.COPY, source=data_texture.image(values))
    _expect(into.texels(), values, "Drawing after a texture was refused")
    return ""


DRIVER_CHECKS = (
    DriverCheck("Loops end where they should", _loops_end_where_they_should),
    DriverCheck("Read-backs wait", _read_waits),
    DriverCheck("Waiting waits", _finish_waits),
    DriverCheck("No dispatch is left out", _dispatches_are_done),
    DriverCheck("Drawing sees what was computed", _drawing_sees_computing),
    DriverCheck("Whole numbers stay whole", _integers_are_kept),
    DriverCheck("Floats keep 32 bits", _floats_are_kept),
    DriverCheck("Corners of textures", _corners_are_read),
    DriverCheck("Large tables arrive whole", _tables_arrive),
    DriverCheck("Vectors without a direction", _vectors_without_length),
    DriverCheck("128 bytes of constants", _constants_arrive),
    DriverCheck("Row 0 is v = 0", _first_row_is_lowest),
    DriverCheck("Blending", _only_the_last_stays),
    DriverCheck("Depth and rows", _depth_and_rows_limit),
    DriverCheck("New textures are cleared", _targets_are_cleared),
    DriverCheck("Memory is granted and freed", _memory_is_granted),
    DriverCheck("Too much is refused", _too_much_is_refused),
)
