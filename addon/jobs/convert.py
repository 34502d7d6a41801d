# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversions of normal maps: reads the stored map, judges whether it fits the low object, and stores the new map."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from .. import older_blender
from ..audit import severity, uv_checks
from ..core import naming, progress, stored_normals
from ..core.declarations import bases
from ..core.declarations.choices import Method, Space, Storage, VertexDomain
from ..core.declarations.map_settings import MAX_SIZE, MIN_SIZE
from ..core.errors import BakeError
from ..core.map_types import MARGIN, NORMAL, WRITTEN, Labeled
from ..core.progress import Pace, Progress, Task, Timings, part
from ..core.settings import Run, SamplingSettings, Settings
from ..core.stored_normals import ConversionReport, StoredNormals, in_words
from ..engine import gpu_memory, margins, mip_levels
from ..engine.baking import texels_of
from ..engine.converted_map import ConvertedMap, Fit
from ..mesh import uv_layout
from ..mesh.triangle_mesh import Mesh
from ..output import datablocks, value_encoding
from ..output.materials import into_materials
from ..output.outputs import Outputs
from ..scene import evaluation, object_checks, reading, textures
from ..scene.object_checks import ObjectRef
from . import shared_image
from .job import Job, check_file_clashes, check_outputs, files_kept


class SourceMap:
    """The texels of a stored normal map by UDIM tile, (height, width, 4) float32 each. They change: z is rebuilt if the map has
    no z, and alpha is 1 if it holds other data than coverage.

    depth, loss: as ConversionReport has them. notes: sentences about such channels.
    """

    def __init__(self, name: str, tiles: Mapping[int, np.ndarray], stored: StoredNormals):
        self.tiles = tiles
        some = np.concatenate([value_encoding.sample_texels(values) for values in tiles.values()])
        self._is_coverage = stored_normals.is_coverage(some)
        self._lacks_z = stored_normals.lacks_z(some, stored)
        self.notes = list(self._notes(name, stored))
        self.depth, self.loss = self._rounding(some, stored)
        for values in tiles.values():
            self._complete(values, stored)

    def _complete(self, values: np.ndarray, stored: StoredNormals) -> None:
        if not self._is_coverage:
            values[..., 3] = 1.0
        if self._lacks_z:
            stored_normals.rebuild_z(values, stored)

    def _rounding(self, some: np.ndarray, stored: StoredNormals) -> tuple[int, dict[str, float]]:
        depth = stored_normals.bits(some[:, :3])
        if depth == 32:
            return depth, {}
        before = some.copy()
        before[:, :3] = stored_normals.moved(some[:, :3], depth)
        for values in (before, some):
            self._complete(values, stored)
        angles = value_encoding.angles_between(before, some)
        return depth, {"median": float(np.median(angles)), "maximum": float(angles.max())} if len(angles) else {}

    def _notes(self, name: str, stored: StoredNormals) -> Iterator[str]:
        if self._lacks_z:
            channel = stored_normals.z_channel(stored)
            yield f"The {channel} channel of {name!r} is the same everywhere: z is rebuilt from the other two."
        if not self._is_coverage:
            yield (
                f"The alpha of {name!r} has values between 0 and 1, as other data than coverage has: it is not used, and the "
                "new map does not contain it."
            )


LEAST_UNIT = 0.75
"""The share of a normal map's texels whose vectors have a length near 1, at least. In photos, few have."""
MOST_AWAY = 0.25
"""The share of a map's texels whose normals may point into the low mesh. In a map of another space, about half do."""
MANY_MISSED, MOST_MISSED = 0.05, 0.9
"""The shares of the covered texels with alpha 0 above which there is a warning, and above which the map is another mesh's."""


def not_on(low: str, image: str) -> str:
    """A sentence about an image on which the low mesh has no texels."""
    return f"No triangle of {low!r} lies on {image!r}: its UVs are outside the map, or empty."


def check(fit: Fit, low: str, image: str, before: StoredNormals) -> None:
    """Raise BakeError for an image that is no normal map of the low object."""
    if not fit.covered:
        raise BakeError(not_on(low, image))
    if fit.missed > fit.covered * MOST_MISSED:
        raise BakeError(
            f"{fit.missed / fit.covered:.0%} of the texels of {image!r} on {low!r} have alpha 0: it is no map of it."
        )
    if fit.unit < (fit.covered - fit.missed) * LEAST_UNIT:
        share = fit.unit / fit.covered
        raise BakeError(
            f"{image!r} is no normal map of {low!r}: only {share:.0%} of its texels on the mesh hold a unit vector."
        )
    if fit.away > fit.directed * MOST_AWAY:
        raise BakeError(
            f"{fit.away / fit.directed:.0%} of the normals in {image!r} point into {low!r} when read in "
            f"{before.from_space.lower()} space: choose another From Space, or the axes that the channels store."
        )


def missing(fit: Fit, image: str) -> Iterator[str]:
    """A sentence if the map lacks many texels of the mesh."""
    if fit.missed > fit.covered * MANY_MISSED:
        yield f"{fit.missed / fit.covered:.0%} of the texels of {image!r} on the mesh have alpha 0, and stay so."


def overlapping(low: Mesh, before: StoredNormals, settings: Settings, tiles: Sequence[int]) -> Iterator[str]:
    """A sentence if triangles of the mesh share texels of the map that mean another normal on each.

    settings, tiles: of the new map.
    """
    spaces = {before.from_space, settings.map.space}
    if Space.TANGENT not in spaces:  # the triangle does not matter
        return
    # Stacked parts share a tangent-space map. In the other spaces, each part has normals of its own.
    (space,) = spaces - {Space.TANGENT} or {Space.TANGENT}
    overlap = uv_checks.overlap(low, settings.sampling.size, tiles)
    if severity.rate("overlap", overlap, settings.mapped(space=space)) == severity.WRONG:
        yield (
            f"{overlap['share']:.2%} of the texels of {low.name!r} belong to two or more of its triangles (overlapping UVs): "
            "the new map can be right on only one of them."
        )


class Conversion:
    """A map to convert. low: the object whose map it is. before: what the colors of `image` mean. is_own_base: whether it is a
    map of the object's mesh without its modifiers. The attribute `low` raises BakeError if the object was deleted."""

    def __init__(
        self, low: bpy.types.Object, image: bpy.types.Image, before: StoredNormals, *, is_own_base: bool = False
    ):
        self._low, self.image, self.before, self.is_own_base = ObjectRef.of(low), image, before, is_own_base

    @property
    def low(self) -> bpy.types.Object:
        return self._low.resolve()


@dataclass(frozen=True)
class _Ready:
    """All that is read of a conversion.

    Attributes:
        name, origin: Of the image, as datablocks.origin has it.
        mesh: The low mesh, with tangents if one of the spaces is tangent.
        settings: Of the new map, with its names and its size.
    """

    name: str
    origin: list[str]
    before: StoredNormals
    settings: Settings
    source: SourceMap
    mesh: Mesh
    uv_layer: str


def convert(context: bpy.types.Context, conversion: Conversion, settings: Settings) -> ConversionReport:
    """Do all of `work` at once."""
    return older_blender.with_gpu(lambda: progress.finish(work(context, conversion, settings, Pace())))


def work(context: bpy.types.Context, conversion: Conversion, settings: Settings, pace: Pace) -> Task[ConversionReport]:
    """Make a new map of the normals that an image shows on its low object.

    settings: of the new map. Its size and its tiles are those of the image, and settings of rays and of other maps do not
    count. Without a name, or with that of the image, it is named after the image.

    Raises BakeError, and then nothing has changed.
    """
    run = Run(settings, pace)
    return (yield from run.timings.counted(_work(context, conversion, run)))


def _work(context: bpy.types.Context, conversion: Conversion, run: Run) -> Task[ConversionReport]:
    timings = run.timings
    yield Progress(f"Reading {conversion.image.name}", 0.0)
    ready = _read(context, conversion, run.settings, timings)
    settings, mesh, counts = ready.settings, ready.mesh, np.zeros(3, np.int64)
    shared_image.check_alone(context, Job(conversion.low, [conversion.low]), settings, "the converted map")
    with Outputs(settings) as outputs:
        with gpu_memory.trimmed():
            drawn = ConvertedMap(mesh, ready.before, settings.map)
            run = replace(run, settings=settings)
            post_processes = margins.for_maps([mesh], settings)
            for number, (tile, values) in enumerate(ready.source.tiles.items()):
                drawn.texels = values
                share = number / len(ready.source.tiles), (number + 1) / len(ready.source.tiles)
                maps = yield from part(texels_of(drawn, tile, run, post_processes), *share)
                counts += _counts(maps[NORMAL.name][1])
                levels = yield from part(mip_levels.of(maps, tile, run), share[1], share[1])
                with timings.timed("image"):
                    outputs.add(tile, maps, levels)
            check(drawn.fit, mesh.name, ready.name, ready.before)
            problems = [
                *missing(drawn.fit, ready.name),
                *overlapping(mesh, ready.before, settings, list(ready.source.tiles)),
            ]
        yield Progress("Storing", 1.0)
        low = conversion.low  # before anything changes: it raises if the object was deleted
        with timings.timed("image"):
            stored = outputs.commit({labeled: [] for labeled in Labeled}, [low])
            datablocks.set_source_objects(stored.image, ready.origin)
            notes = into_materials(low, stored, ready.uv_layer, settings, is_own_base=conversion.is_own_base)
    written, margin, texels = counts
    return ConversionReport(
        source=ready.name,
        low=mesh.name,
        size=settings.sampling.size,
        before=asdict(ready.before),
        settings=settings.flat(),
        was=ready.before.words,
        now=in_words(settings.map.space, settings.map.basis, settings.map.channels),
        source_depth=ready.source.depth,
        source_loss=ready.source.loss,
        loss=stored.loss,
        coverage=float(written / texels),
        margin=float(margin / texels),
        tiles=stored.tiles,
        uv_layer=ready.uv_layer,
        image=stored.image.name,
        output=stored.paths,
        mip_files=stored.mip_files,
        seconds=timings.seconds,
        warnings=[*ready.source.notes, *problems, *stored.warnings, *notes],
    )


def _read(context: bpy.types.Context, conversion: Conversion, wanted: Settings, timings: Timings) -> _Ready:
    """Check and read the image and the low mesh. Raises BakeError."""
    low, image, is_own_base = conversion.low, conversion.image, conversion.is_own_base
    context.view_layer.update()  # a script may have moved the object
    engine = context.scene.render.engine
    conversion.before.check()
    before = conversion.before.read_by(engine)
    settings = _for_map(wanted.read_by(engine), low, image, before)
    settings.check()
    if reason := object_checks.low_problem(context, low, is_own_base=is_own_base):
        raise BakeError(reason)
    with timings.timed("textures"):
        tiles = {tile: textures.read_stored(image, tile) for tile in _tiles(image, settings.sampling)}
    settings = _sized(image, tiles, settings)
    settings.check()  # again, as formats of files do not take all sizes
    check_outputs(low, settings)
    read = [(bpy.path.abspath(image.filepath, library=image.library), "the map to convert")] if image.filepath else []
    check_file_clashes([settings], [low.name], "", [*read, *files_kept([Job(low, [])], settings.storing)])
    has_basis = Space.TANGENT in (before.from_space, settings.map.space)
    # The tangents as they were read: ConvertedMap makes those of both bases.
    space = Space.TANGENT if has_basis else Space.OBJECT
    reading_settings = settings.mapped(space=space, basis=bases.CYCLES.name)
    with timings.timed("extract"):
        meshes = evaluation.evaluate(
            context,
            [low],
            lambda depsgraph: reading.read_low(depsgraph, low, None, reading_settings, is_own_base=is_own_base),
            modifiers=settings.map.modifiers,
            own_base=low if is_own_base else None,
        )
    mesh = meshes.basis or meshes.low
    if settings.sampling.udim:
        covered = uv_layout.tiles(mesh)
        tiles = {tile: values for tile, values in tiles.items() if tile in covered}
    if not tiles:
        raise BakeError(not_on(low.name, image.name))
    return _Ready(
        image.name,
        datablocks.origin(image.name),
        before,
        settings,
        SourceMap(image.name, tiles, before),
        mesh,
        meshes.uv_layer,
    )


def _ending(settings: Settings, before: StoredNormals) -> str:
    """What is new about a map, for its name: its space, its basis, or else its green."""
    if settings.map.space != Space.TANGENT:
        return settings.map.space.lower()
    basis = bases.of_name(settings.map.basis).name
    is_same_basis = before.from_space == Space.TANGENT and bases.of_name(before.from_basis).name == basis
    greens = {"+Y": "opengl", "-Y": "directx"}
    is_of_green = is_same_basis and before.from_green != settings.map.green
    return greens.get(settings.map.green, basis.lower()) if is_of_green else basis.lower()


def _for_map(settings: Settings, low: bpy.types.Object, image: bpy.types.Image, before: StoredNormals) -> Settings:
    """The settings of the new map alone, with names filled in. before: of the map that is converted."""
    suffix = settings.storing.low_suffix
    name = naming.fill_low(settings.storing.image, low.name, suffix)
    if name in ("", image.name):
        name = f"{image.name.removesuffix(Path(image.name).suffix)}_{_ending(settings, before)}"
    output = naming.fill(settings.storing.output, low.name, low_suffix=suffix)
    if settings.storing.storage == Storage.FILE and output and image.filepath:
        old, new = (os.path.realpath(bpy.path.abspath(path)) for path in (image.filepath, output))
        if old == new:
            raise BakeError(f"The new map would replace the file of {image.name!r}: choose another file.")
    settings = settings.stored(vertex_domain=VertexDomain.NONE, connect_maps=False, image=name, output=output)
    is_tiled = image.source == "TILED"
    settings = settings.sampled(samples=1, udim=is_tiled, tiles=settings.sampling.tiles if is_tiled else ())
    return settings.without_other_maps().mapped(texture_sets=False).traced(method=Method.FLATTEN)


def _tiles(image: bpy.types.Image, sampling: SamplingSettings) -> tuple[int, ...]:
    stored = textures.stored_tiles(image)
    wanted = tuple(tile for tile in stored if not sampling.tiles or tile in sampling.tiles)
    if not wanted:
        raise BakeError(f"The image {image.name!r} has none of the tiles {', '.join(map(str, sampling.tiles))}.")
    return wanted


def _sized(image: bpy.types.Image, stored: dict[int, np.ndarray], settings: Settings) -> Settings:
    """The settings with the size of the image."""
    sizes = {values.shape[1::-1] for values in stored.values()}
    if len(sizes) > 1:
        different = ", ".join(f"{width} x {height}" for width, height in sorted(sizes))
        raise BakeError(f"The tiles of {image.name!r} have several sizes, {different}: scale them to one.")
    ((width, height),) = sizes
    if not (min(width, height) >= MIN_SIZE and max(width, height) <= MAX_SIZE):
        raise BakeError(f"{image.name!r} has {width} x {height} texels: a map has {MIN_SIZE} to {MAX_SIZE} a side.")
    return settings.sampled(width=width, height=height)


def _counts(state: np.ndarray) -> tuple[int, int, int]:
    """The numbers of written texels, of those in the margin, and of all."""
    counts = (np.count_nonzero(state == which) for which in (WRITTEN, MARGIN))
    return *map(int, counts), state.size
