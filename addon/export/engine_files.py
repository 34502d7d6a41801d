# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes a file of low meshes with their maps, reads it back, and says what an engine would show of it. All or nothing."""

import os
import tempfile
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack, redirect_stdout
from dataclasses import asdict, dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..core import file_formats, naming, progress
from ..core.declarations import targets
from ..core.errors import BakeError
from ..core.progress import Progress, Task
from ..core.report import VISIBLE, Report
from ..output import atomic_file, datablocks, image_file
from ..output.atomic_file import Partial, all_or_none
from ..output.path_clashes import Places
from . import baked_low, basis_textures, comparison, map_pictures, same_file, staging, webp_pictures
from .baked_low import BakedLow, FileMesh
from .binary_gltf import Glb
from .comparison import Baked, Measured
from .formats import FORMATS, MeshFormat
from .staging import Staged

WRITTEN = 0.3
"""The share of the work that is done when the file is written."""


@dataclass(frozen=True)
class Exported:
    """One low object in a written file.

    Attributes:
        paths: Of the file, and of those beside it.
        basis: The name of the basis that its normal map was made for.
        has_applied_scale: As BakedLow has it.
        measured: None without a normal map.
        triangles: How many triangles the file has of it.
        warnings: Sentences.
    """

    low: str
    paths: list[str]
    triangles: int
    basis: str
    has_applied_scale: bool
    measured: Measured | None
    warnings: list[str]

    def to_dict(self) -> dict:
        """Plain data, as Report.export has it."""
        measured = asdict(self.measured) if self.measured else {}
        written = {"files": self.paths, "triangles": self.triangles, "basis": self.basis}
        return {**written, "has_applied_scale": self.has_applied_scale, **measured}


def check_export(path: str) -> None:
    """Raise BakeError if no format has the ending of `path`, or Blender's exporter is missing."""
    _format(Path(path)).check()


def export_files(
    context: bpy.types.Context,
    bakes: Sequence[Sequence[Report]],
    path: Path,
    *,
    are_levels: bool = False,
    check_beside: Callable[[str], None] | None = None,
    source: Path | None = None,
) -> list[Exported]:
    """Do the whole task of `work` at once."""
    steps = work(context, bakes, path, are_levels=are_levels, check_beside=check_beside, source=source)
    return progress.finish(steps)


def work(
    context: bpy.types.Context,
    bakes: Sequence[Sequence[Report]],
    path: Path,
    *,
    are_levels: bool = False,
    check_beside: Callable[[str], None] | None = None,
    source: Path | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Task[list[Exported]]:
    """Write low objects with their maps to `path`, which is absolute.

    bakes: for each low object the reports of its last bake, one for each texture set. are_levels: whether they are levels of
    detail of one object, from the finest. check_beside: called with the path of each file beside that at `path` before any is
    written; it may raise BakeError. source: the .glb that the objects came from, if all else of it is to stay. settings: those
    of webp_pictures.NAMES, where they are not those of the bakes. Raises BakeError, and then no file has changed. Nothing else
    of the scene changes, not even between two steps.
    """
    file_format = _format(path)
    file_format.check()
    if are_levels and not file_format.links_levels:
        raise BakeError(f"{str(path)!r} cannot hold levels of detail: only a {file_formats.MESHES[0]} file can.")
    atomic_file.check_writable(path)
    yield Progress("Writing the file", 0.0)
    lows = [baked_low.read(context, reports) for reports in bakes]
    settings = settings or lows[0].reports[0].settings
    changes_maps = file_format.has_webp and webp_pictures.changes(settings)
    if changes_maps and settings.get("export_ktx2", False):
        basis_textures.check()
    elif changes_maps and settings["export_webp"]:
        image_file.check_format(f"map{file_formats.WEBP.endings[0]}")
    lows = [same_file.with_maps_alone(low) for low in lows] if source is not None else lows
    with tempfile.TemporaryDirectory(prefix="imprint-") as name:
        folder = Path(name)
        files, objects = _written(context, file_format, lows, folder / path.name, path, are_levels=are_levels)
        if changes_maps:
            glb = Glb.parsed(files[0].read_bytes())
            webp_pictures.store(glb, objects, settings, folder)
            files[0].write_bytes(glb.packed())
        done = []
        for number, one in enumerate(objects):
            yield Progress("Reading the file back", WRITTEN + (1.0 - WRITTEN) * number / len(objects))
            done.append(_exported(file_format, one, folder / path.name))
        if source is not None:
            data, notes = same_file.rewritten(source, Glb.parsed(files[0].read_bytes()), objects)
            files[0].write_bytes(data)
            done[0] = replace(done[0], warnings=[*done[0].warnings, *notes])
        maps = {file for low in lows for report in low.reports for file in report.output}
        destinations = _destinations(files, folder, path, maps)
        _check_read(destinations)
        for other in destinations[1:] if check_beside else ():
            check_beside(str(other))
        _move(files, destinations)
    paths = list(map(str, destinations))
    return [replace(one, paths=paths) for one in done]


def _format(path: Path) -> MeshFormat:
    file_format = FORMATS.get(path.suffix.lower())
    if file_format is None:
        raise BakeError(f"{str(path)!r} is no file for an engine: {', '.join(file_formats.MESHES)} are.")
    return file_format


def _written(
    context: bpy.types.Context,
    file_format: MeshFormat,
    lows: Sequence[BakedLow],
    temporary: Path,
    path: Path,
    *,
    are_levels: bool,
) -> tuple[list[Path], list[Staged]]:
    """Write `temporary`, which becomes the file at `path`, and those beside it. Returns them, and what was staged for them."""
    with staging.staged(
        context,
        lows,
        temporary.parent,
        file_format.channels,
        with_tangents=file_format.has_tangents,
        names_files=file_format.names_files,
        before_names=f"{path.stem}_" if file_format.shares_folder else "",
    ) as stage:
        first = stage.objects[0].object
        try:
            # Exporters leave the mode of the active object, and print.
            with context.temp_override(active_object=first, object=first), redirect_stdout(StringIO()):
                return file_format.write(stage, temporary, are_levels=are_levels), stage.objects
        except (RuntimeError, OSError) as error:
            raise BakeError(f"{str(path)!r} could not be written: {atomic_file.reason(error)}.") from error


def _destinations(files: Sequence[Path], folder: Path, path: Path, maps: Collection[str]) -> list[Path]:
    """Where the files written to `folder` go: beside `path`. Raises BakeError for one of `maps`, which stay as they are."""
    destinations = [path.parent / file.relative_to(folder) for file in files]
    known = set(map(os.path.realpath, maps))
    taken = next((str(one) for one in destinations if os.path.realpath(one) in known), None)
    if taken is not None:
        raise BakeError(
            f"The export would replace {taken!r}, a map of the bake: choose another folder for one of them."
        )
    return destinations


def _check_read(destinations: Sequence[Path]) -> None:
    """Raise WrongPlace if a file is one that the open scene reads. Images that Imprint has baked are its maps."""
    places = Places()
    for path, title in (*datablocks.sources(), *datablocks.pictures()):
        places.read(path, title)
    for destination in destinations:
        places.write(
            str(destination), "the file for an engine" if destination is destinations[0] else "a texture of the file"
        )


def _move(files: Sequence[Path], destinations: Sequence[Path]) -> None:
    """Put files in their places, all or none. Raises BakeError."""
    partials = []
    with ExitStack() as discards, atomic_file.all_or_none():
        for file, destination in zip(files, destinations, strict=True):
            partials.append(Partial(destination))
            discards.callback(partials[-1].discard)
            with partials[-1].writing():
                partials[-1].temporary.write_bytes(file.read_bytes())
        for partial in partials:
            partial.commit()


def _exported(file_format: MeshFormat, one: Staged, path: Path) -> Exported:
    """Read one object back, and measure it. Raises BakeError if the file has something else than was baked."""
    low = one.baked
    mesh = file_format.read(path, one)
    baked = Baked(
        low.positions[one.order],
        low.normals[one.order],
        low.tangents[one.order],
        one.uv,
        one.faces,
        low.basis,
        _kept(lambda texture: _baked_texels(one, texture, path.parent)),
    )
    comparison.check_surface(baked, mesh, low.name)
    measured = None
    if low.has_normal_map:
        measured = comparison.measure(
            baked,
            mesh,
            _kept(
                lambda texture: _texels_in(mesh, texture, file_format.channels or one.channels(texture), path.parent)
            ),
            [targets.BY_NAME[name] for name in low.reports[0].settings["targets"]],
            () if file_format.channels else one.channels(0),
        )
    about = low.name, [], len(one.faces), low.basis.name, low.has_applied_scale
    return Exported(*about, measured, _warnings(one, measured))


def _kept(load: Callable[[int], np.ndarray | None]) -> Callable[[int], np.ndarray | None]:
    """`load`, called once for each texture after the other."""
    latest: dict[int, np.ndarray | None] = {}

    def kept(texture: int) -> np.ndarray | None:
        if texture not in latest:
            latest.clear()
            latest[texture] = load(texture)
        return latest[texture]

    return kept


def _baked_texels(one: Staged, texture: int, folder: Path) -> np.ndarray | None:
    slot, tile = one.textures[texture]
    report = one.baked.report_of(slot)
    image = datablocks.get(report.image) if report is not None else None
    if image is None:
        return None
    with map_pictures.one_tile(image, tile, folder) as part:
        return map_pictures.turned(map_pictures.pixels(part), one.channels(texture))


def _texels_in(mesh: FileMesh, texture: int, channels: Sequence[str], folder: Path) -> np.ndarray | None:
    picture = mesh.pictures[texture]
    if picture is None:
        return None
    if picture.startswith(basis_textures.MAGIC):
        values = basis_textures.decoded(picture)[::-1].astype(np.float32) / np.float32(255.0)
        return map_pictures.turned(values, channels)
    path = folder / f"read back{file_formats.PNG.endings[0]}"
    path.write_bytes(picture)
    with map_pictures.loaded(path) as image:
        return map_pictures.turned(map_pictures.pixels(image), channels)


def _warnings(one: Staged, measured: Measured | None) -> list[str]:
    notes = list(dict.fromkeys(one.notes))
    if measured is not None and not measured.has_tangents:
        off = measured.degrees[one.baked.basis.name]["percentile_99"]
        if off > VISIBLE:
            notes.append(
                f"Engines make their own tangents of this file: normals of {one.baked.name!r} then differ by {off:.1f} degrees "
                f"(99th percentile), as it was baked with quads. Cut its faces into triangles and bake again, or export a "
                f"{file_formats.MESHES[0]} file, which has the tangents of the bake."
            )
    return notes


def check_levels(path: str, count: int) -> None:
    """Raise BakeError if `path` cannot take `count` levels. It may be relative to the .blend file."""
    if path.startswith("//") and not bpy.data.filepath:
        raise BakeError(f"{path!r} is relative to a .blend file that was never saved: save it first.")
    check_export(path)
    one_file = file_formats.MESHES[0]
    if count > 1 and not naming.has_low(path) and Path(path).suffix.lower() != one_file:
        raise BakeError(f"Only {one_file} has levels in one file: put {naming.LOW} into the path of the export.")


def export_levels(context: bpy.types.Context, reports: Sequence[Report], path: str) -> list[Exported]:
    """Write levels, from the finest, with their maps: a file for each if `path` has LOW. reports: of their maps.

    Raises BakeError, and then no file has changed.
    """
    groups = [[report] for report in reports] if naming.has_low(path) else [list(reports)]
    done = []
    with all_or_none():
        for group in groups:
            suffix = group[0].settings.get("low_suffix", "")
            target = Path(bpy.path.abspath(naming.fill(path, group[0].low, low_suffix=suffix))).absolute()
            bakes = [[report] for report in group]
            done += export_files(context, bakes, target, are_levels=len(group) > 1)
    return done
