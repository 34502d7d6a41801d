# SPDX-License-Identifier: GPL-3.0-or-later
"""What the views show of a session: its meshes in their places, lit with the map and without, and how far off they are."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import gpu
import numpy as np
from mathutils.bvhtree import BVHTree

from ..core import bases
from ..core.errors import BakeError
from ..core.settings import Settings
from ..engine import post_process, uv_agreement
from ..engine.bands import BAND_TEXELS
from ..mesh.inputs import Meshes
from ..mesh.local_space import LocalSpace, gap, local_space_of
from ..mesh.triangle_mesh import Mesh, normal_matrix
from ..output import quantize
from ..passes import mesh_upload, target
from ..passes.view import deviation, lit
from ..scene import mesh_reader
from .live_session import Session

MODES = ("MAP", "SPLIT", "DEVIATION", "BARE_DEVIATION")
MIDDLE = 0.25
"""Of the view's width, for the low mesh without its map between the other two."""
PULL = 0.1
"""Of the low mesh's radius: how far what is drawn is pulled towards the viewer at least, so that neither the low object nor
the high one, which lies around it, shows through."""
SIDEWAYS = 3.0
"""Of the height of the highest bump: how far the view must be pulled, since one that is seen aslant hides more behind it."""
PROBES = 1000
"""Vertices of the high meshes together, beside the outermost of each, whose height over the low one is looked at."""


@dataclass(frozen=True)
class Eye:
    """From where and in which light.

    view, projection (4, 4): from world to view space, from there to clip space. light (4,): where the light comes from in
    the world and 0, or where it is and 1.
    """

    view: np.ndarray
    projection: np.ndarray
    light: np.ndarray


@dataclass(frozen=True)
class Figures:
    """Degrees between what is seen and the high surface, with the map and without, over texels from all over the map.

    elsewhere: the share of texels that do not count, since the high surface that was laid flat there belongs to another
    place: what a map of it shows cannot be measured by itself. All others are NaN where no texel counts.
    """

    mean: float
    percentile_99: float
    bare_mean: float
    bare_percentile_99: float
    elsewhere: float = 0.0


@dataclass(frozen=True)
class _Scene:
    """What is drawn: batches with the normal matrices of their objects, in a frame around the low mesh. pull: how far it is
    pulled towards the viewer, in the frame's units."""

    local_space: LocalSpace
    pull: float
    low: tuple[gpu.types.GPUBatch, np.ndarray]
    highs: list[tuple[gpu.types.GPUBatch, np.ndarray]]


def settings_for(settings: Settings) -> Settings:
    """The same map, but one that goes nowhere, of one tile, and no larger than what is drawn at once."""
    width, height = settings.width, settings.height
    while width * height > BAND_TEXELS:
        width, height = width // 2, height // 2
    return replace(
        settings, width=width, height=height, udim=False, tiles=(), material=False, storage="MEMORY", output=""
    )


def zones(width: int, split: float) -> list[range]:
    """The columns of a view `width` pixels wide for the high mesh, the low one and the low one with its map, around the
    line at `split` of the width."""
    first, last = (round(min(max(split + side * MIDDLE / 2, 0.0), 1.0) * width) for side in (-1, 1))
    return [range(first), range(first, last), range(last, width)]


class Shading:
    """Draws the objects of `session`, which has drawn a map, as they stand now; their shapes are as it has last read them.

    figures: what was measured of the last map that `update` saw, or None.
    """

    def __init__(self, session: Session):
        """Raises BakeError for a map that is not on the GPU as a whole."""
        if session.map is None:
            settings = session.settings
            raise BakeError(
                f"A map of {settings.width} x {settings.height} texels is drawn in bands and never there as a whole: choose a "
                "smaller one to see it live."
            )
        self.session = session
        self.figures: Figures | None = None
        self._texels: np.ndarray | None = None
        self._measured: target.Target | None = None
        self._scene: _Scene | None = None
        self._seen: tuple[Meshes, list[bytes]] | None = None
        self._square: gpu.types.GPUBatch | None = None
        self._near: tuple[tuple | None, BVHTree | None] = None, None

    def update(self, *, is_measured: bool) -> None:
        """Take up the session's last map, if it is another than the last time. Not while a view is being drawn."""
        if self.session.texels is not self._texels:
            self._texels, self.figures, self._measured = self.session.texels, None, None
        if is_measured and self._measured is None:
            self._measure()

    def draw(self, mode: str, eye: Eye, *, split: float = 0.5, limit: float = 5.0, is_alone: bool = False) -> None:
        """Draw one of MODES into the framebuffer that is bound, which has depth.

        split: where the line of SPLIT is, from 0 to 1. limit: degrees that the colours of deviations end at. is_alone:
        whether no high object is there that could show through. Nothing is drawn when an object is gone or pressed flat, or
        what is asked for has not been updated.
        """
        scene = self._placed(with_highs=mode == "SPLIT")
        drawn = self.session.map
        if scene is None or drawn is None:
            return
        matrix = _view_projection(eye, scene.local_space, PULL if is_alone else scene.pull)
        light = np.append(
            (eye.light[:3] - eye.light[3] * scene.local_space.origin) / scene.local_space.size, eye.light[3]
        )
        with _tested_for_depth():
            if mode == "MAP":
                self._draw_map(scene, matrix, light)
            elif mode == "SPLIT":
                x, y, width, height = gpu.state.viewport_get()
                high, low, mapped = zones(width, split)
                with _only(x + high.start, y, len(high), height):
                    _draw_bare(scene.highs, matrix, light)
                with _only(x + low.start, y, len(low), height):
                    _draw_bare([scene.low], matrix, light)
                with _only(x + mapped.start, y, len(mapped), height):
                    self._draw_map(scene, matrix, light)
            elif self._measured is not None:
                without_map = mode == "BARE_DEVIATION"
                deviation.draw(scene.low[0], self._measured.texture, matrix, limit=limit, without_map=without_map)

    def draw_legend(self, place: tuple[float, float], size: tuple[float, float]) -> None:
        """Draw what the colours of deviations mean as a bar, in pixels from the lower left."""
        if self._square is None:
            corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)], np.float32)
            self._square = mesh_upload.upload(np.array([(0, 1, 2), (2, 1, 3)], np.int32), position=corners)
        view = np.array(gpu.state.viewport_get()[2:])
        deviation.draw_legend(self._square, (*(np.multiply(size, 2) / view), *(np.multiply(place, 2) / view - 1.0)))

    def _draw_map(self, scene: _Scene, matrix: np.ndarray, light: np.ndarray) -> None:
        low, normals = scene.low
        lit.draw(low, self.session.map, matrix, self._reading(normals, light))

    def _reading(self, normals: np.ndarray, light: np.ndarray | None = None) -> np.ndarray:
        """What shaders know of the map."""
        settings = self.session.settings
        kinds = {"WORLD": lit.WORLD, "OBJECT": lit.OBJECT}
        return lit.shading(
            normals,
            light,
            kind=kinds.get(settings.space, bases.of_name(settings.basis).index),
            channels=post_process.channels(settings),
            steps=255 if settings.depth == 8 else 0,
        )

    def _measure(self) -> None:
        settings, low = self.session.settings, self._low()
        size = settings.width, settings.height
        with target.using(target.TargetPool()):  # what is drawn on the way is let go
            self._measured = target.get("deviation", *size, "RGBA32F")
            reading = self._reading(normal_matrix(low.to_world))
            truth, elsewhere = self.session.truth(), self._elsewhere()
            deviation.measure(self._measured, self._upload(low), self.session.map, truth, reading, elsewhere=elsewhere)
            values = np.empty((size[1], size[0], 4), np.float32)
            self._measured.read(values)
        texels = quantize.sample(values)
        known, elsewhere = texels[texels[:, 3] > 0.0], np.count_nonzero(texels[:, 3] < -1.5)
        if len(known) + elsewhere:
            means, highest = np.full((2, 2), np.nan)
            if len(known):
                means = known[:, :2].mean(axis=0, dtype=np.float64)
                highest = np.percentile(known[:, :2], 99, axis=0)
            share = elsewhere / (len(known) + elsewhere)
            self.figures = Figures(*map(float, (means[0], highest[0], means[1], highest[1], share)))

    def _elsewhere(self) -> np.ndarray:
        """Which parts of the map, (rows, columns) bool, are of another place than the low mesh's."""
        meshes = self.session.meshes
        if self.session.plan.method != "FLATTEN" or meshes.is_own_base:  # which share their UVs
            return np.zeros((1, 1), bool)
        return uv_agreement.elsewhere(meshes.low, meshes.highs)

    def _low(self) -> Mesh:
        meshes = self.session.meshes
        return meshes.basis or meshes.low

    def _upload(self, low: Mesh, **attributes: np.ndarray) -> gpu.types.GPUBatch:
        tangents = np.zeros((len(low.normals), 4), np.float32) if low.tangents is None else low.tangents
        return self.session.upload(
            f"{low.name} as basis", low, uv=low.uv, normal=low.normals, tangent=tangents, **attributes
        )

    def _placed(self, *, with_highs: bool) -> _Scene | None:
        """The objects where they are now; of the high ones those that are there, and all of them if `with_highs`."""
        meshes = self.session.meshes
        shown = [self._low(), *meshes.highs]
        objects = [ref.find() for ref in self.session.job.refs[: len(shown)]]
        if objects[0] is None or (with_highs and None in objects):
            return None
        shown = [mesh for mesh, obj in zip(shown, objects, strict=True) if obj is not None]
        matrices = [mesh_reader.matrix(obj) for obj in objects if obj is not None]
        if not all(np.isfinite(matrix).all() and np.linalg.det(matrix[:3, :3]) for matrix in matrices):
            return None
        places = [matrix.tobytes() for matrix in matrices]
        if self._seen is None or self._seen[0] is not meshes or self._seen[1] != places:
            low, *highs = (replace(mesh, to_world=matrix) for mesh, matrix in zip(shown, matrices, strict=True))
            self._scene, self._seen = self._place(low, highs), (meshes, places)
        return self._scene

    def _place(self, low: Mesh, highs: list[Mesh]) -> _Scene:
        local_space = local_space_of([low])
        around, pull = local_space, PULL
        if highs and gap(low, highs) > 0.0:  # moved aside: shown as if it were not
            around = LocalSpace(local_space_of(highs).origin, local_space.size)
        elif highs:
            surface = self._surface(low, local_space)
            pull = max(
                PULL, SIDEWAYS * max(_height(surface, local_space.points(high), PROBES // len(highs)) for high in highs)
            )
        return _Scene(
            local_space,
            pull,
            (self._upload(low, position=_positions(low, local_space)), normal_matrix(low.to_world)),
            [
                (
                    self.session.upload(high.name, high, normal=high.normals, position=_positions(high, around)),
                    normal_matrix(high.to_world),
                )
                for high in highs
            ],
        )

    def _surface(self, low: Mesh, local_space: LocalSpace) -> BVHTree:
        """The low mesh to look for the nearest point on, which is made anew only when it is another."""
        key = low.triangles, low.positions, low.to_world.tobytes()
        known, surface = self._near
        if known is None or known[0] is not key[0] or known[1] is not key[1] or known[2] != key[2]:
            surface = BVHTree.FromPolygons(local_space.points(low).tolist(), low.vertices[low.triangles].tolist())
            self._near = key, surface
        return surface


def _positions(mesh: Mesh, local_space: LocalSpace) -> np.ndarray:
    return local_space.points(mesh)[mesh.vertices]


def _height(surface: BVHTree, points: np.ndarray, count: int) -> float:
    """How far points (V, 3) lie off a surface at most: those that stand out most, and about `count` others from all over."""
    outermost = [*points.argmin(axis=0), *points.argmax(axis=0)]
    probes = np.concatenate([points[outermost], points[:: -(-len(points) // max(1, count))]])
    return max(surface.find_nearest(probe)[3] or 0.0 for probe in probes.tolist())


def _draw_bare(parts: list[tuple[gpu.types.GPUBatch, np.ndarray]], matrix: np.ndarray, light: np.ndarray) -> None:
    for drawn, normals in parts:
        lit.draw_bare(drawn, matrix, lit.shading(normals, light))


def _view_projection(eye: Eye, local_space: LocalSpace, pull: float) -> np.ndarray:
    """From `local_space` to clip space, pulled towards the viewer by so many of its units: in depth
    alone, what is seen stays where
    it is."""
    to_world = np.diag([*[local_space.size] * 3, 1.0])
    to_world[:3, 3] = local_space.origin
    projection, pull = np.array(eye.projection, np.float64), pull * local_space.size
    if projection[3, 3] == 0.0:  # perspective: points go along their rays, all by the same share of their distance
        distance = max(-(eye.view @ (*local_space.origin, 1.0))[2], 2.0 * pull)
        projection[2, 3] /= 1.0 - pull / distance
    else:
        projection[2, 3] += pull * projection[2, 2]
    return projection @ eye.view @ to_world


@contextmanager
def _tested_for_depth() -> Iterator[None]:
    before = gpu.state.depth_test_get(), gpu.state.depth_mask_get(), gpu.state.blend_get()
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    gpu.state.blend_set("NONE")
    try:
        yield
    finally:
        gpu.state.depth_test_set(before[0])
        gpu.state.depth_mask_set(before[1])
        gpu.state.blend_set(before[2])


@contextmanager
def _only(x: int, y: int, width: int, height: int) -> Iterator[None]:
    """In this block nothing is drawn outside."""
    gpu.state.scissor_test_set(True)
    gpu.state.scissor_set(x, y, width, height)
    try:
        yield
    finally:
        gpu.state.scissor_test_set(False)
