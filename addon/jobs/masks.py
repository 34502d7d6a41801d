# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the checks of a finished bake found something: on which texels of the map, and on which faces of the low mesh."""

from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property, partial

import bpy
import numpy as np

from ..audit import mip_gaps, uv_checks
from ..core import progress
from ..core.declarations.choices import Method, Space
from ..core.errors import BakeError
from ..core.map_types import NORMAL
from ..core.progress import Progress, Task
from ..core.report import Report
from ..core.settings import Run, Settings
from ..engine import baking, gpu_memory, separation
from ..engine.bands import Band
from ..engine.planning import Plan, plan_of
from ..engine.unsure_texels import Explorer
from ..mesh import face_shapes, uv_islands, uv_layout, uv_seams
from ..mesh.inputs import Meshes
from ..mesh.local_space import local_space_of
from ..mesh.triangles import unit_normals
from ..output import outputs
from ..passes import audit, mesh_upload, target
from ..scene import evaluation, mesh_elements, mesh_reader
from .job import Job, PastBake, Request, check_job, read_meshes

ON_TEXELS = ("overlap", "uncovered", "far", "unsure", "gaps", "backwards")
SKEWED = "skewed"
"""The kind of texels whose rays lean: they show detail from beside them. No check counts them, because that can be wanted."""
LEAN = 30.0
"""Degrees between a ray and the normal of its triangle from which a texel is skewed: shifted by half of the detail's height."""
ON_TRIANGLES = ("mirrored", "outside", "no_area", "behind")
ON_EDGES = ("hard_edges",)
ON_FACES = ("polygons", "uneven")
KINDS = (*ON_TEXELS, *ON_TRIANGLES, *ON_EDGES, *ON_FACES)
"""As in Report.checks."""
TEXELS = 1024 * 1024
"""How many texels are checked together. They take about 100 bytes each, and 200 where rays are followed farther."""


def of_low(report: Report) -> bpy.types.Object:
    """The low object of a past bake. Raises BakeError if an object of the bake was deleted."""
    return PastBake.of(report).job.low


def find(context: bpy.types.Context, report: Report, kind: str) -> np.ndarray:
    """The low object's faces (N,) int with issues of this kind, or edges (N, 2) for kinds ON_EDGES, as the objects are now.

    report: of the bake whose settings apply. Raises BakeError if the objects can no longer be baked like that, or if
    modifiers make faces that come from no face of the object.
    """
    view = _view(context, report, kind)
    if kind in ON_EDGES:
        return _in_edit_mesh(context, view, uv_seams.hard_edges(view.meshes.low), "EDGE")
    if kind in ON_FACES:
        numbers = np.flatnonzero(
            {"polygons": face_shapes.non_triangles, "uneven": face_shapes.non_planar}[kind](view.meshes.low)
        )
    else:
        numbers = np.unique(view.meshes.low.faces[_triangles(view, kind)])
    return _in_edit_mesh(context, view, numbers, "FACE")


def draw_mask(context: bpy.types.Context, report: Report, kind: str) -> bpy.types.Image:
    """Fill an image that is white on texels with issues of a kind ON_TEXELS. Its name has the map's name and the kind.

    report and errors: as in `find`.
    """
    view = _view(context, report, kind)
    with outputs.MapWriter("", view.settings) as writer:
        for tile, mask in progress.finish(_whole_masks(view, kind)).items():
            writer.add(tile, outputs.black_and_white(mask))
        return writer.commit()


def mask_work(context: bpy.types.Context, report: Report, kind: str) -> Task[dict[int, np.ndarray]]:
    """Find the texels (height, width) bool with issues of a kind ON_TEXELS, or SKEWED, for each UDIM tile.

    report and errors: as in `find`.
    """
    yield Progress("Reading the objects", 0.0)
    return (yield from _whole_masks(_view(context, report, kind), kind))


def _whole_masks(view: "_View", kind: str) -> Task[dict[int, np.ndarray]]:
    size = view.size[::-1]
    masks: dict[int, np.ndarray] = {}
    for band, rows, _ in _masks(view, kind):
        mask = masks.setdefault(band.tile, np.zeros(size, bool))
        mask[band.start : band.stop] = rows
        yield Progress("Checking the texels", (len(masks) - 1 + band.stop / size[0]) / len(view.plan.tiles))
    return masks


@dataclass(frozen=True)
class _View:
    """A past bake with its objects as they are now.

    Attributes:
        settings: Of the mask.
        distances: Of the bake's rays; empty for Flatten.
    """

    job: Job
    plan: Plan
    settings: Settings
    distances: dict[str, float]

    @property
    def meshes(self) -> Meshes:
        return self.plan.meshes

    @property
    def size(self) -> tuple[int, int]:
        return self.settings.sampling.width, self.settings.sampling.height

    @cached_property
    def drawing(self) -> baking.Drawing:
        """What draws it as the bake did."""
        return progress.finish(baking.draw(self.plan, Run(self.settings.traced(**self.distances))))


def _view(context: bpy.types.Context, report: Report, kind: str) -> _View:
    past = PastBake.of(report)
    # Settings of the map's appearance do not matter, because only the mask is written.
    space = Space.TANGENT if kind == "backwards" else Space.OBJECT
    settings = past.settings.without_other_maps().without_file().without_materials().mapped(space=space)
    settings = settings.stored(image=f"{settings.storing.image}_{kind}", depth=8, dither=False)
    check_job(context, past.job, settings)
    plan = plan_of(read_meshes(context, Request(past.job, settings)), settings, tiles=past.tiles)
    return _View(past.job, plan, settings, past.distances)


def _triangles(view: _View, kind: str) -> np.ndarray:
    """Which triangles of the low mesh, (T,) bool, have issues of this kind."""
    low = view.meshes.low
    if kind == "outside":
        outside = uv_layout.outside(low, uv_checks.space(view.settings.sampling))
        harmful = outside if view.settings.sampling.udim else outside & ~uv_islands.moved_copies(low)
        return harmful if harmful.any() else outside
    if kind == "behind":
        return face_shapes.normals_behind(low)
    if kind in ON_TRIANGLES:
        areas = uv_layout.areas(low)
        return areas < 0.0 if kind == "mirrored" else areas == 0.0
    is_marked = np.zeros(len(low.triangles) + 1, bool)
    uploaded = audit.upload_with_ids(low.triangles, low.uv)
    for band, mask, depth in _masks(view, kind):
        if mask.any():
            for numbers in audit.layers_of_triangles(uploaded, mask.shape[::-1], band.uv_to_clip, depth):
                is_marked[numbers[mask].astype(np.int64)] = True
    return is_marked[1:]


def _masks(view: _View, kind: str) -> Iterator[tuple[Band, np.ndarray, int]]:
    """Yields each band, which of its texels (height, width) bool have issues, and the most triangles on one of them."""
    tiles, bands = view.plan.tiles, _bands(view)
    with gpu_memory.trimmed():
        if kind == "overlap":
            yield from _shared(view, bands)
        elif kind == "unsure":
            yield from _unsure(view, bands)
        elif kind == SKEWED:
            yield from _skewed(view, bands)
        elif kind in {"gaps", "backwards"}:
            whole = dict(zip(tiles, (_close if kind == "gaps" else _backwards)(view), strict=False))
            for band in bands:
                yield band, whole[band.tile][band.start : band.stop], 1
        else:
            yield from _separated(view, kind, bands)


def _bands(view: _View) -> list[Band]:
    """The parts of all tiles that are checked together."""
    width, height = view.size
    rows = max(1, TEXELS // width)
    return [
        Band(start, min(start + rows, height), view.size, 0, tile)
        for tile in view.plan.tiles
        for start in range(0, height, rows)
    ]


def _shared(view: _View, bands: list[Band]) -> Iterator[tuple[Band, np.ndarray, int]]:
    """The texels that triangles share, as `_masks` has them."""
    uploaded = mesh_upload.upload(view.meshes.low.triangles, uv=view.meshes.low.uv)
    for band in bands:
        counts = audit.counts(uploaded, (band.width, band.height), band.uv_to_clip)
        yield band, counts > 1, int(counts.max())


def _separated(view: _View, kind: str, bands: list[Band]) -> Iterator[tuple[Band, np.ndarray, int]]:
    """The texels that are uncovered or far, as `_masks` has them."""
    ray_cast = view.drawing.ray_cast
    probe = separation.full_probe(view.meshes, ray_cast)
    texels = separation.sample(probe, view.size, view.plan.tiles)
    method = Method.CAST if ray_cast else Method.FLATTEN
    offset, limit = separation.offset(texels, method), separation.limit(view.meshes.low, view.settings.tracing)
    for band in bands:
        texels = probe((band.width, band.height), band.uv_to_clip)
        mask = texels[..., 3] < 0.0 if kind == "uncovered" else separation.distances(texels, offset) > limit
        yield band, mask, 1


def _unsure(view: _View, bands: list[Band]) -> Iterator[tuple[Band, np.ndarray, int]]:
    """The texels that may show the wrong layer, as `_masks` has them; none without rays."""
    ray_cast = view.drawing.ray_cast
    explorer = Explorer(ray_cast, view.meshes.whole_low) if ray_cast else None
    for band in bands:
        size = band.width, band.height
        yield band, explorer.doubts(size, band.uv_to_clip).unsure if explorer else np.zeros(size[::-1], bool), 1


def _skewed(view: _View, bands: list[Band]) -> Iterator[tuple[Band, np.ndarray, int]]:
    """The texels whose rays lean, as `_masks` has them; none without rays."""
    ray_cast, low = view.drawing.ray_cast, view.meshes.whole_low
    corners = local_space_of([low]).points(low)[low.vertices[low.front_triangles]]
    normals, _ = unit_normals(corners)
    for band in bands:
        skewed = np.zeros((band.height, band.width), bool)
        if ray_cast:
            drawn = target.get("audit rays", band.width, band.height, "RGBA32F", "RGBA32F")
            ray_cast.draw(drawn, band.uv_to_clip)
            places, away = drawn.texels(), drawn.texels(1)
            on_low = places[..., 3] > 0.0
            of_triangles = normals[places[on_low][:, 3].astype(np.int64) - 1]
            skewed[on_low] = (away[on_low][:, :3] * of_triangles).sum(axis=1) < np.cos(np.radians(LEAN))
        yield band, skewed, 1


def _close(view: _View) -> Iterator[np.ndarray]:
    """Tile by tile, the texels (height, width) bool that are too close to another island or to the border."""
    sparse = mip_gaps.grid(view.settings.sampling, mip_gaps.FULL_SIDE)
    columns, rows = sparse.steps
    for gaps in mip_gaps.find(view.meshes.low, view.plan.tiles, view.settings.sampling, sparse, overlaps=True):
        close = np.repeat(np.repeat(gaps.close | gaps.border, rows, axis=0), columns, axis=1)
        yield close[: view.settings.sampling.height, : view.settings.sampling.width]


def _backwards(view: _View) -> Iterator[np.ndarray]:
    """Tile by tile, the texels (height, width) bool whose normal points into the low mesh: drawn as in the bake."""
    for tile in view.plan.tiles:
        normals = progress.finish(view.drawing.renderer.raw(tile))[NORMAL.name]
        yield (normals[..., 2] <= 0.0) & (normals[..., 3] > 0.0)


def _in_edit_mesh(context: bpy.types.Context, view: _View, elements: np.ndarray, domain: str) -> np.ndarray:
    """The object's own faces (N,), or edges (N, 2) by their vertices, for faces or edges of the baked mesh.

    domain: "FACE" or "EDGE". elements: in the baked mesh, which modifiers may have changed.
    """
    low = view.job.low
    has_modifiers = low not in view.job.highs and len(low.modifiers) > 0
    if domain == "FACE" and not has_modifiers:
        return elements

    def look(depsgraph: bpy.types.Depsgraph, name: str) -> tuple[np.ndarray | None, np.ndarray]:
        if not has_modifiers:
            return None, mesh_elements.edges(low.data, elements)
        with mesh_reader.evaluated(low, depsgraph) as data:
            chosen = elements if domain == "FACE" else mesh_elements.edges(data, elements)
            return mesh_reader.numbers(data, name, domain), chosen

    modifiers = view.settings.map.modifiers
    with (
        evaluation.in_object_mode(context, [low]),
        mesh_reader.numbered(low, domain) if has_modifiers else nullcontext("") as name,
    ):
        numbers, elements = evaluation.evaluate(context, [low], partial(look, name=name), modifiers=modifiers)
    if not has_modifiers:
        return elements
    if numbers is None:
        raise BakeError(
            f"The modifiers of {low.name!r} make new faces, which cannot be selected: apply the modifiers first."
        )
    numbers = np.unique(numbers[elements])
    return numbers[numbers >= 0]
