# SPDX-License-Identifier: GPL-3.0-or-later
"""A GPU that draws nothing and takes its time: the engine's own passes run, and a clock says how long each of them would take.

Nothing is created on a real GPU, so that maps of any size are drawn in moments.
"""

from contextlib import contextmanager
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from addon.core import progress
from addon.engine import tree_cache
from addon.passes import allocation, blender_gpu, shader, target


@dataclass(frozen=True)
class Speeds:
    """What a GPU does in a second, by hardware measured or judged on a map of 2048 x 2048.

    own: rays with own hits. rays: those of occlusion. texels: that a pass reads and writes. triangles: of a high mesh. lines:
    seconds of each half of the search for the margin.
    """

    own: float
    rays: float
    texels: float
    triangles: float
    lines: float


COVERED = 0.75 * 2048 * 2048
"""The texels of the table of what GPUs take."""
GPUS = {
    "RTX 3060": Speeds(COVERED / 0.025, 64 * COVERED / 0.6, 3e9, 400e6, 0.004),
    "M2": Speeds(COVERED / 0.07, 64 * COVERED / 1.5, 1e9, 200e6, 0.008),
    "Iris Xe 96 EU": Speeds(COVERED / 0.1, 64 * COVERED / 2.5, 600e6, 100e6, 0.012),
    "UHD 630": Speeds(COVERED / 0.4, 64 * COVERED / 10.0, 250e6, 40e6, 0.02),
}

IN_OWN = {
    "bake/cast_comp.glsl": 1.0,
    "bake/cast_first_comp.glsl": 0.5,
    "bake/packets_comp.glsl": 0.02,
    "bake/rays_frag.glsl": 0.6,
    "bake/left_frag.glsl": 2.0,
    "bake/clearance_frag.glsl": 4.0,
    "surface/add_image_comp.glsl": 0.5,
    "surface/normal_map_comp.glsl": 0.7,
    "surface/bump_comp.glsl": 2.5,
    "surface/served_blocks_frag.glsl": 32.0 * 32.0 / 40.0,
    "margin/seam_across_frag.glsl": 2.0,
}
"""What a covered texel of a program takes, in rays with own hits, at most. Others read and write texels."""
IN_RAYS = {
    "hemisphere/openness_comp.glsl": 1.0,
    "hemisphere/thickness_comp.glsl": 1.0,
    "hemisphere/curvature_comp.glsl": 2.0,
}
"""What a ray of a covered texel takes, in rays of occlusion."""
PER_BLOCK = {"surface/add_image_comp.glsl", "surface/normal_map_comp.glsl", "surface/bump_comp.glsl"}
LINES = {"margin/margin_rows_comp.glsl", "margin/margin_columns_comp.glsl"}
ON_ALL = {"margin/seam_across_frag.glsl", "surface/served_blocks_frag.glsl", "bake/clearance_frag.glsl"}
"""Programs whose texels are not those of the map, or that may work on all of them."""
READ = 2.0**24 - 1.0
"""What is read back: served blocks with all materials."""


class _Anything:
    """Takes any call and has any attribute."""

    def __call__(self, *_args, **_options):
        return self

    def __getattr__(self, _name):
        return self

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None


@dataclass
class _Texture:
    width: int
    height: int


@dataclass
class SimulatedGpu:
    """speeds: of the GPU. covered: gives how many texels the rows of a band cover, as (band height, rows) -> texels.

    longest: the seconds of the longest draw or dispatch of each program. submitted: the longest time between two waits.
    """

    speeds: Speeds
    covered: object = None
    longest: dict[str, float] = field(default_factory=dict)
    rows: dict[str, list[int]] = field(default_factory=dict)
    submitted: float = 0.0
    now: float = 0.0
    last: float = 0.0
    _queued: float = 0.0
    _into: tuple = ()
    _bound: tuple = ()

    def wait(self, *_args) -> np.ndarray:
        self.now += self._queued + 1e-4
        self.submitted = max(self.submitted, self._queued)
        self._queued = 0.0
        return np.zeros(4)

    def run(self, program, seconds: float, rows: int) -> None:
        name = program.compute or program.fragment
        self._queued += seconds
        self.longest[name] = max(self.longest.get(name, 0.0), seconds)
        self.rows.setdefault(name, []).append(rows)

    def draw_bound(self, program, _mesh, parts=None, **bindings) -> None:
        self.bind(None, program, **bindings)
        triangles = sum(count for _, count in parts or ())
        self.run(program, self.last + triangles / self.speeds.triangles, triangles)

    # What passes call

    def bind(self, compiled, program, **bindings) -> None:
        self._bound = program, bindings
        if not program.compute:
            into, rows = self._into
            rows = rows or range(into.height)
            self.last = self._seconds(program, into.width, into.height, rows)
            if program.vertex == "lib/fullscreen_vert.glsl":
                self.run(program, self.last, len(rows))

    def dispatch(self, _compiled, across: int, up: int, _deep: int) -> None:
        program, bindings = self._bound
        name = program.compute
        if name in LINES:
            self.run(program, self.speeds.lines, up)
        elif name in PER_BLOCK:
            self.run(program, up * 32 * 32 * IN_OWN[name] / self.speeds.own, up)
        else:
            height = (bindings.get("hits") or bindings.get("positions") or _Texture(0, across * 8)).height
            start = bindings.get("first_row", 0)
            rows = range(start, start + up * 8)
            if bindings.get("active_count", -1) >= 0:  # a list of texels, all of which are covered
                seconds = len(rows) * across * 8 * IN_OWN.get(name, 0.02) / self.speeds.own
            else:
                times = bindings["numbers"][1] if name in IN_RAYS else 1
                seconds = self._seconds(program, across * 8, height, rows, times)
            self.run(program, seconds, len(rows))

    def _seconds(self, program, width: int, height: int, rows: range, rays: int = 1) -> float:
        name = program.compute or program.fragment
        whole = len(rows) * width
        covered = whole if name in ON_ALL or self.covered is None else self.covered(width, height, rows)
        if name in IN_RAYS:
            work = covered * rays * IN_RAYS[name] / self.speeds.rays
        else:
            work = covered * IN_OWN.get(name, 0.0) / self.speeds.own
        return work + whole / self.speeds.texels

    @contextmanager
    def drawing(self, into, rows=None, **_options):
        self._into = into, rows
        yield

    def install(self, monkeypatch) -> None:
        """Take the place of the real GPU until the test ends."""
        monkeypatch.setattr(blender_gpu, "state", _Anything(), raising=False)
        monkeypatch.setattr(blender_gpu, "types", _Anything(), raising=False)
        monkeypatch.setattr(blender_gpu, "compute", SimpleNamespace(dispatch=self.dispatch), raising=False)
        monkeypatch.setattr(shader, "load", lambda _program: _Anything())
        monkeypatch.setattr(shader, "in_software", lambda: False)
        monkeypatch.setattr(
            blender_gpu, "capabilities", SimpleNamespace(max_texture_size_get=lambda: 16384), raising=False
        )
        monkeypatch.setattr(target, "bind", self.bind)
        monkeypatch.setattr(target, "draw_bound", self.draw_bound)
        monkeypatch.setattr(target, "drawing", self.drawing)
        monkeypatch.setattr(target.Target, "first", self.wait)
        monkeypatch.setattr(target.Target, "read", lambda _self, out, *_args, **_options: self._read(out))
        monkeypatch.setattr(allocation, "texture", lambda size, *_args: _Texture(*size))
        monkeypatch.setattr(
            allocation, "offscreen", lambda size, _texel: SimpleNamespace(texture_color=_Texture(*size))
        )
        monkeypatch.setattr(allocation, "corners", lambda _name, _values: _Anything())
        monkeypatch.setattr(allocation, "triangles", lambda _values: _Anything())
        monkeypatch.setattr(
            progress, "time", SimpleNamespace(perf_counter=lambda: self.now, monotonic=lambda: self.now)
        )
        monkeypatch.setattr(tree_cache, "trees", tree_cache.TreeCache())

    def _read(self, out: np.ndarray) -> None:
        self.wait()
        out[...] = 0 if out.dtype == np.uint8 else READ
