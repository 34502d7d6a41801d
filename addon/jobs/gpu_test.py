# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the GPU: what it is, whether its driver does what Imprint relies on, whether its maps are right, and how fast it is.

It draws meshes of its own, and neither reads nor changes the open file.
"""

import os
import platform
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import bpy
import gpu
import numpy as np

from .. import older_blender, passes
from ..core import progress, versions
from ..core.declarations.choices import Method, Space
from ..core.errors import BakeError, NoGpu
from ..core.gpu_report import GpuReport, Outcome, Timed, Verdict
from ..core.progress import Pace, Progress, Task
from ..core.settings import Run, Settings
from ..engine import baking, gpu_memory, margins
from ..engine.bands import Band
from ..engine.planning import plan_of
from ..engine.sources import Rays
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..passes import data_texture, hemisphere, margin_fill, shader, target
from ..passes.driver_checks import DRIVER_CHECKS, CheckFailed, DriverCheck
from . import gpu_pairs
from .gpu_pairs import PAIRS, Pair

STEP = Progress("Testing the GPU", 0.0)
"""The step in the progress bar, at the start."""
_SHARES = 0.4, 0.8
"""The share of the test that is done after the checks of the driver, and after the maps."""


def test(on_progress: Callable[[Progress], None] | None = None) -> GpuReport:
    """Test the GPU at once. on_progress: called between slices. Raises NoGpu."""
    return older_blender.with_gpu(lambda: progress.finish(work(), on_progress))


def work(pace: Pace | None = None) -> Task[GpuReport]:
    """Test the GPU in slices of `pace`. Maps and trees that are cached on the GPU are freed. Raises NoGpu."""
    start = time.perf_counter()
    yield STEP
    try:
        older_blender.start_gpu()
    except (SystemError, RuntimeError) as error:
        raise NoGpu(f"Blender has no GPU to draw on here: {error}.") from error
    pool = target.TargetPool()
    try:
        report = yield from progress.relay(
            _work(pace), lambda step: replace(STEP, done=step.done), partial(target.using, pool)
        )
    finally:
        pool.free()
        gpu_memory.free()
    report.seconds = time.perf_counter() - start
    return report


def _work(pace: Pace | None) -> Task[GpuReport]:
    gpu_memory.free()
    passes.free()  # so that all programs are compiled
    report = GpuReport(_machine(), _limits())
    compiling = 0.0
    for number, check in enumerate(DRIVER_CHECKS):
        done = _SHARES[0] * number / len(DRIVER_CHECKS)
        report.driver_checks += yield from progress.part(_checked(check), done, done)
    for number, pair in enumerate(PAIRS):
        done = _SHARES[0] + (_SHARES[1] - _SHARES[0]) * number / len(PAIRS)
        tests, longer = yield from progress.part(_baked(pair, pace), done, done)
        report.maps += tests
        compiling += longer
    count = shader.load.cache_info().currsize
    report.times.append(
        Timed("First use", compiling, "s", f"{count} programs; what first bakes took longer than second ones")
    )
    for number, (name, measure) in enumerate(MEASURES.items()):
        done = _SHARES[1] + (1.0 - _SHARES[1]) * number / len(MEASURES)
        with _noted(f"Times: {name.lower()}", report.driver_checks):
            report.times += yield from progress.part(measure(), done, done)
    return report


OF_DRIVERS = CheckFailed, BakeError, RuntimeError, SystemError, ValueError, TypeError, MemoryError
"""What a driver makes Blender raise. Where a program does not compile, it raises Exception itself."""


@contextmanager
def _noted(name: str, tests: list[Outcome]) -> Iterator[None]:
    """Note in `tests` what a driver raises in this block, as the error of a test with a name."""
    try:
        yield
    except Exception as error:
        if not isinstance(error, OF_DRIVERS) and type(error) is not Exception:
            raise
        tests.append(Outcome(name, Verdict.WRONG, " ".join(str(error).split()) or type(error).__name__))


def _checked(driver_check: DriverCheck) -> Task[list[Outcome]]:
    tests: list[Outcome] = []
    with _noted(driver_check.name, tests):
        measured = yield from progress.relay(driver_check.check(), lambda _: STEP)
        tests.append(Outcome(driver_check.name, Verdict.RIGHT, measured))
    return tests


def _baked(pair: Pair, pace: Pace | None) -> Task[tuple[list[Outcome], float]]:
    """Also returns by how many seconds the first bake took longer than the second one."""
    tests: list[Outcome] = []
    seconds = []
    with _noted(pair.name, tests):
        bakes = []
        for _ in range(2):
            start = time.perf_counter()
            bakes.append((yield from pair.bake(pace)))
            seconds.append(time.perf_counter() - start)
        first, second = bakes
        for name, answer in gpu_pairs.answers_of(pair).items():
            tests.append(gpu_pairs.compare(pair, name, answer, first[name]))
            count = np.count_nonzero((first[name][0] != second[name][0]).any(axis=-1))
            if count:
                tests[-1] = replace(
                    tests[-1], verdict=Verdict.WRONG, note=f"{count:,} texels are others when it is baked again"
                )
    return tests, seconds[0] - seconds[-1] if seconds else 0.0


# The machine


def _machine() -> dict[str, str]:
    way = "background" if bpy.app.background else "window"
    return {
        "system": f"{_system()}, {platform.machine()}, {os.cpu_count()} cores",
        "blender": f"{versions.blender()}, {way}",
        "imprint": f"{versions.imprint()}, code {versions.code()[:12]}",
        "backend": gpu.platform.backend_type_get(),
        "vendor": gpu.platform.vendor_get(),
        "renderer": gpu.platform.renderer_get(),
        "driver": gpu.platform.version_get(),
        "kind": f"{gpu.platform.device_type_get()}, {'software' if shader.in_software() else 'hardware'}",
        "reads": "images" if shader.reads_images() else "samplers",
    }


def _system() -> str:
    """The name and the version of the system, without that of the computer."""
    if platform.system() == "Linux":
        try:
            return platform.freedesktop_os_release()["PRETTY_NAME"]
        except (OSError, KeyError):
            return "Linux"
    if platform.system() == "Darwin":
        return f"macOS {platform.mac_ver()[0]}"
    return f"{platform.system()} {platform.release()}, {platform.version()}"


def _limits() -> dict[str, int | str]:
    """What Blender tells. Of push constants it tells nothing: a check of the driver takes as many as Imprint has."""
    told = {
        "texture size": "max_texture_size_get",
        "samplers": "max_textures_frag_get",
        "images": "max_images_get",
        "varying floats": "max_varying_floats_get",
        "vertex attributes": "max_vertex_attribs_get",
    }
    limits: dict[str, int | str] = {}
    for name, get in told.items():
        limits[name] = getattr(gpu.capabilities, get)()
    for name, get in (("work groups", "max_work_group_count_get"), ("work group size", "max_work_group_size_get")):
        limits[name] = " x ".join(str(getattr(gpu.capabilities, get)(axis)) for axis in range(3))
    return limits


# Times

ENOUGH = 0.04
"""Seconds that a measurement takes at least, unless the largest size takes less: shorter ones are mostly overhead."""
TURNS = 3
SIDES = 128, 256, 512, 1024
"""Of maps, in texels. A slow GPU is measured on a small one."""


def _seconds(act: Callable[[], None]) -> float:
    start = time.perf_counter()
    act()
    return time.perf_counter() - start


def _steady(of_side: Callable[[int], Callable[[], None]]) -> Task[tuple[int, float]]:
    """The side of the map, and the median of the seconds, of the first side that takes long enough, or of the largest."""
    for side in SIDES:
        act = of_side(side)
        act()  # compiles, and allocates
        yield STEP
        taken = []
        for _ in range(TURNS):
            taken.append(_seconds(act))
            yield STEP
        if statistics.median(taken) >= ENOUGH:
            break
    return side, statistics.median(taken)


def _upload() -> Task[list[Timed]]:
    def of_side(side: int) -> Callable[[], None]:
        values = np.ones((2 * side, 2 * side, 4), np.float32)
        into = target.Target(1, 1, ("RGBA32F",))
        texel = np.empty((1, 1, 4), np.float32)

        def act() -> None:
            target.fill(into, target.COPY, source=data_texture.image(values))
            into.read(texel)

        return act

    side, seconds = yield from _steady(of_side)
    return [_of_bytes("Upload", side, seconds)]


def _read_back() -> Task[list[Timed]]:
    def of_side(side: int) -> Callable[[], None]:
        values = np.ones((2 * side, 2 * side, 4), np.float32)
        drawn = target.Target(2 * side, 2 * side, ("RGBA32F",))
        target.clear(drawn)
        return lambda: drawn.read(values)

    side, seconds = yield from _steady(of_side)
    return [_of_bytes("Read-back", side, seconds)]


def _of_bytes(name: str, side: int, seconds: float) -> Timed:
    count = 16 * (2 * side) ** 2
    return Timed(name, count / seconds / 1e9, "GB/s", f"{count / 1e6:.0f} MB")


RAYS = 16
"""From each hit."""


def _sheet(name: str, columns: int, waves: float) -> Mesh:
    """A square of columns x columns quads that covers the map. waves: their height."""
    across, up = np.meshgrid(*[np.linspace(0.0, 1.0, columns + 1)] * 2)
    height = waves * (1.5 + np.sin(9.0 * across + 1.0) * np.sin(8.0 * up + 1.0))
    points = np.stack([2.0 * across - 1.0, 2.0 * up - 1.0, height], axis=-1).reshape(-1, 3)
    first = np.add.outer((columns + 1) * np.arange(columns), np.arange(columns)).reshape(-1, 1)
    above = columns + 2
    triangles = np.concatenate([first + (0, 1, above), first + (0, above, above - 1)], axis=1).reshape(-1, 3)
    return Mesh.of_arrays(name, points, triangles, np.stack([across, up], axis=-1).reshape(-1, 2))


def _rays() -> Task[list[Timed]]:
    """Rays from a low mesh to a high one, and those from the hits."""
    low, high = _sheet("low", 16, 0.0), _sheet("high", 100, 0.03)
    meshes = replace(Meshes.of(low, [high]), basis=low)
    run = Run(Settings(method=Method.CAST, space=Space.WORLD, maps=("AO",), width=SIDES[0], height=SIDES[0], margin=0))
    source = (yield from baking.draw(plan_of(meshes, run.settings), run)).source
    side, seconds = yield from _steady(partial(_casting, source))
    note = f"{side} x {side}, {len(high.triangles):,} triangles"
    own_hits = Timed("Own hits", side * side / seconds / 1e6, "M rays/s", note)
    side, seconds = yield from _steady(partial(_occluding, source))
    note = f"{side} x {side}, {RAYS} rays from each hit"
    return [own_hits, Timed("Occlusion", RAYS * side * side / seconds / 1e6, "M rays/s", note)]


def _casting(source: Rays, side: int) -> Callable[[], None]:
    """What casts the rays of a map of this side."""
    band = Band(0, side, (side, side), 0)

    def act() -> None:
        for _ in source.normals(band):
            pass
        source.drawn().finish()

    return act


def _occluding(source: Rays, side: int) -> Callable[[], None]:
    """What casts RAYS from each hit of a map of this side."""
    _casting(source, side)()
    hits, sums = source.hits(Band(0, side, (side, side), 0)), target.get("sums of the test", side, side, "RGBA32F")
    covered = np.full(side // progress.SLICE_ROWS, side * progress.SLICE_ROWS)
    pace, lattice = Pace(), hemisphere.lattice_of(RAYS)

    def draw(rows: range, some: range, is_first: bool) -> None:
        rays = hemisphere.Rays(hits.texture, source.surface.tables, lattice, some, rows, is_first)
        hemisphere.add_openness(sums, rays, hemisphere.Occluders())

    def act() -> None:
        for _ in hemisphere.slices(pace, hemisphere.ADD_OPENNESS, (side, side), covered, range(RAYS), draw=draw):
            pass

    return act


def _margin() -> Task[list[Timed]]:
    def of_side(side: int) -> Callable[[], None]:
        settings = Settings(width=side, height=side, margin=16, space=Space.WORLD)
        texels = np.zeros((side, side, 4), np.float32)
        texels[(np.indices((side, side)) // 48).sum(axis=0) % 2 == 0] = 1.0
        values, process = data_texture.image(texels), margins.PostProcess(settings, margin_fill.VALUE)
        band = Band(0, side, (side, side), 0)
        return lambda: process.draw(band, values).finish()

    side, seconds = yield from _steady(of_side)
    return [Timed("Margin", 1e3 * seconds, "ms", f"{side} x {side}, 16 texels")]


MEASURES = {"Upload": _upload, "Read-back": _read_back, "Rays": _rays, "Margin": _margin}
