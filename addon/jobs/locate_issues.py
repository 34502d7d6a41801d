# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the flaws are that the audit counted: on all texels of a map, and on which faces of the low mesh."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..audit import mip_gaps
from ..audit.checks import uv_space
from ..core import progress
from ..core.errors import BakeError
from ..core.report import Report
from ..core.settings import Settings
from ..engine import gpu_memory, method_choice, rendering, separation
from ..engine.bands import Band
from ..mesh import face_shapes, uv_islands, uv_layout, uv_seams
from ..mesh.inputs import Meshes
from ..output import image_writer
from ..passes import mesh_upload, target
from ..passes.audit import overlap, triangle_ids
from ..scene import bake_objects, mesh_reader, reading
from . import several

ON_TEXELS = ("overlap", "uncovered", "far", "gaps", "backwards")
ON_TRIANGLES = ("mirrored", "outside", "no_area", "behind")
ON_EDGES = ("hard_edges",)
ON_FACES = ("polygons", "uneven")
KINDS = (*ON_TEXELS, *ON_TRIANGLES, *ON_EDGES, *ON_FACES)
"""As in Report.checks."""
TEXELS = 1024 * 1024
"""How many texels are looked at together: what is read of them takes some 100 bytes each."""


def of_low(report: Report) -> bpy.types.Object:
    """The low object of a bake that was done. Raises BakeError if it is gone."""
    return _objects(report)[0]


def _objects(report: Report) -> list[bpy.types.Object]:
    """The low object of a bake that was done, the high ones and the cage. Raises BakeError if one is gone."""
    names = [report.low, *report.high, *([report.cage] if report.cage else [])]
    refs = report.refs or [bake_objects.ObjectRef(0, name) for name in names]  # from a file: whatever is called so
    return [ref.resolve() for ref in refs]


def find(context: bpy.types.Context, report: Report, kind: str) -> np.ndarray:
    """The low object's own faces (N,) int that have flaws of this kind, or edges for kinds ON_EDGES, as the objects are now.

    report: of the bake whose settings count. Raises BakeError if the objects cannot be baked like that any more, or if
    modifiers make faces of which nobody knows where they come from.
    """
    view = _view(context, report, kind)
    if kind in ON_EDGES:
        return _own(context, view, uv_seams.hard_edges(view.meshes.low), "EDGE")
    if kind in ON_FACES:
        found = np.flatnonzero(
            {"polygons": face_shapes.non_triangles, "uneven": face_shapes.non_planar}[kind](view.meshes.low)
        )
    else:
        found = np.unique(view.meshes.low.faces[_triangles(view, kind)])
    return _own(context, view, found, "FACE")


def draw_mask(context: bpy.types.Context, report: Report, kind: str) -> bpy.types.Image:
    """Fill an image, called after the map and the kind, that is white on the texels with flaws of a kind ON_TEXELS.

    report and errors: as in `find`.
    """
    view = _view(context, report, kind)
    mask = np.empty((view.settings.height, view.settings.width), bool)
    with image_writer.Writer("", view.settings) as writer:
        for band, seen, _ in _masks(view, kind):
            mask[band.start : band.stop] = seen
            if band.stop == len(mask):
                writer.add(band.tile, image_writer.black_and_white(mask))
        return writer.commit()


@dataclass(frozen=True)
class _View:
    """What is looked at. settings: those of the mask."""

    job: several.Job
    meshes: Meshes
    settings: Settings
    report: Report


def _view(context: bpy.types.Context, report: Report, kind: str) -> _View:
    low, *highs = _objects(report)
    job = several.Job(low, highs[: len(report.high)], highs[-1] if report.cage else None)
    settings = Settings(**{k: tuple(v) if isinstance(v, list) else v for k, v in report.settings.items()})
    # Of all that can be set, what the map looks like does not count, and nothing is written but the mask.
    space = "TANGENT" if kind == "backwards" else "OBJECT"
    settings = replace(settings, method=report.method, space=space, maps=(), mask=False, material=False)
    settings = replace(settings, output="", storage="PACK" if settings.udim else "MEMORY")
    settings = replace(settings, image=f"{settings.image}_{kind}", depth=8, dither=False)
    several.check(context, job, settings)
    told = Report(report.method, space, report.size, report.low, report.high, distances=report.distances)
    meshes = reading.read(context, job.low, job.highs, job.cage, settings)
    return _View(
        job, method_choice.choose(meshes, report.tiles, settings, told), settings, replace(told, tiles=report.tiles)
    )


def _triangles(view: _View, kind: str) -> np.ndarray:
    """Which triangles of the low mesh, (T,) bool, have flaws of this kind."""
    low = view.meshes.low
    if kind == "outside":
        outside = uv_layout.outside(low, uv_space(view.settings))
        harmful = outside if view.settings.udim else outside & ~uv_islands.moved_copies(low)
        return harmful if harmful.any() else outside
    if kind == "behind":
        return face_shapes.normals_behind(low)
    if kind in ON_TRIANGLES:
        areas = uv_layout.areas(low)
        return areas < 0.0 if kind == "mirrored" else areas == 0.0
    found = np.zeros(len(low.triangles) + 1, bool)
    uploaded = triangle_ids.upload(low.triangles, low.uv)
    for band, mask, depth in _masks(view, kind):
        if mask.any():
            for numbers in triangle_ids.layers(uploaded, mask.shape[::-1], band.uv_to_clip, depth):
                found[numbers[mask].astype(np.int64)] = True
    return found[1:]


def _masks(view: _View, kind: str) -> Iterator[tuple[Band, np.ndarray, int]]:
    """Band by band, which texels (height, width) bool have flaws, and how many triangles lie on one of them at most."""
    settings, tiles = view.settings, view.report.tiles
    size, rows = (settings.width, settings.height), max(1, TEXELS // settings.width)
    bands = [
        Band(start, min(start + rows, settings.height), size, 0, tile)
        for tile in tiles
        for start in range(0, settings.height, rows)
    ]
    try:
        if kind == "overlap":
            yield from _shared(view, bands)
        elif kind in {"gaps", "backwards"}:
            whole = dict(zip(tiles, (_close if kind == "gaps" else _backwards)(view), strict=False))
            for band in bands:
                yield band, whole[band.tile][band.start : band.stop], 1
        else:
            yield from _apart(view, kind, bands)
    finally:
        gpu_memory.trim()


def _shared(view: _View, bands: list[Band]) -> Iterator[tuple[Band, np.ndarray, int]]:
    """The texels that triangles share, as `_masks` has them."""
    uploaded = mesh_upload.upload(view.meshes.low.triangles, uv=view.meshes.low.uv)
    for band in bands:
        drawn = target.get("overlap", band.width, band.height, "R16F")
        overlap.draw(drawn, uploaded, band.uv_to_clip)
        counts = np.empty((band.height, band.width), np.float32)
        drawn.read(counts)
        yield band, counts > 1.0, int(counts.max())


def _apart(view: _View, kind: str, bands: list[Band]) -> Iterator[tuple[Band, np.ndarray, int]]:
    """The texels that are uncovered or far, as `_masks` has them."""
    look = separation.looking(view.meshes, view.settings, view.report)
    texels = separation.probe(look, (view.settings.width, view.settings.height), view.report.tiles)
    offset, limit = separation.offset(texels, view.report.method), separation.limit(view.meshes.low, view.settings)
    for band in bands:
        texels = look((band.width, band.height), band.uv_to_clip)
        mask = texels[..., 3] < 0.0 if kind == "uncovered" else separation.distances(texels, offset) > limit
        yield band, mask, 1


def _close(view: _View) -> Iterator[np.ndarray]:
    """Tile by tile, the texels (height, width) bool that lie too close to another island or to the border."""
    sparse = mip_gaps.grid(view.settings, mip_gaps.MOST)
    columns, rows = sparse.steps
    for found in mip_gaps.find(view.meshes.low, view.report.tiles, view.settings, sparse, overlaps=True):
        close = np.repeat(np.repeat(found.close | found.border, rows, axis=0), columns, axis=1)
        yield close[: view.settings.height, : view.settings.width]


def _backwards(view: _View) -> Iterator[np.ndarray]:
    """Tile by tile, the texels (height, width) bool whose normal points into the low mesh: drawn as in the bake."""
    meshes, report, settings = view.meshes, view.report, replace(view.settings, **view.report.distances)
    source = progress.finish(method_choice.source(meshes, report.tiles, settings, report, progress.Pace()))
    renderer = rendering.Renderer(source, meshes.basis, settings, report, progress.Pace())
    for tile in report.tiles:
        normals = progress.finish(renderer.raw(tile))["NORMAL"]
        yield (normals[..., 2] <= 0.0) & (normals[..., 3] > 0.0)


def _own(context: bpy.types.Context, view: _View, found: np.ndarray, domain: str) -> np.ndarray:
    """Faces (N,) or edges (N, 2), named by their vertices, of the mesh that was baked as those of the object that an artist
    edits. domain: "FACE" or "EDGE"."""
    low = view.job.low
    has_modifiers = low not in view.job.highs and len(low.modifiers) > 0
    if domain == "FACE" and not has_modifiers:
        return found
    with bake_objects.ready(context, low, [], None, view.settings.modifiers):
        if not has_modifiers:
            return mesh_reader.edges(low.data, found)
        with (
            mesh_reader.numbered(low, domain),
            mesh_reader.evaluated(low, context.evaluated_depsgraph_get()) as data,
        ):
            own = mesh_reader.numbers(data, domain)
            found = found if domain == "FACE" else mesh_reader.edges(data, found)
    if own is None:
        raise BakeError(f"The modifiers of {low.name!r} make faces that are not its own: apply them first.")
    own = np.unique(own[found])
    return own[own >= 0]


def add_triangulate(context: bpy.types.Context, report: Report) -> tuple[bpy.types.Modifier, int]:
    """Give the low object a modifier that cuts its faces as Blender draws them, and as they were baked.

    Also returns how many quads the modifier nevertheless cuts otherwise: those that Blender turns since they would be
    folded. Raises BakeError if the object cannot take one, or has one already.
    """
    low = of_low(report)
    if not low.is_editable:
        raise BakeError(f"{low.name!r} is linked from another file: make it local, so that it takes a modifier.")
    if low.name in report.high:
        raise BakeError(
            f"{low.name!r} was baked from its own modifiers onto its base mesh: triangulate that one instead."
        )
    if low.modifiers and low.modifiers[-1].type == "TRIANGULATE":
        raise BakeError(f"{low.name!r} has a Triangulate modifier already: {low.modifiers[-1].name!r}.")
    with (
        bake_objects.ready(context, low, [], None, report.settings["modifiers"]) as depsgraph,
        mesh_reader.evaluated(low, depsgraph) as data,
    ):
        mesh = mesh_reader.surface(data, "", low.name, mesh_reader.matrix(low), with_faces=True)
    modifier = low.modifiers.new("Triangulate", "TRIANGULATE")
    modifier.quad_method, modifier.ngon_method = "FIXED", "CLIP"
    modifier.keep_custom_normals = True
    return modifier, int(np.count_nonzero(face_shapes.folded(mesh)))
