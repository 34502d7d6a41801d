# SPDX-License-Identifier: GPL-3.0-or-later
"""The door for other programs: meshes in as arrays, Blender's objects or files, maps out as arrays and files."""

import os
import threading
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import bpy
import numpy as np

from . import older_blender
from .blocks.formats import BY_NAME, Purpose
from .core import asset_limits, file_formats, map_types, naming, progress
from .core.asset_limits import CRUMBS, HOLES, Mending, Wanted
from .core.declarations import kinds
from .core.declarations.all_settings import ASSET, DECLARED
from .core.declarations.choices import Storage
from .core.errors import BakeError, NoGpu
from .core.file_formats import SMOOTH_BELOW
from .core.naming import Suffixes, did_you_mean
from .core.progress import Pace, Progress
from .core.report import Report
from .core.settings import PART_OF, Settings
from .jobs import Job, bake_all, bake_jobs, encoding, unwrapping, uv_density
from .jobs import asset as game_asset
from .scene import importing, mesh_reader, mesh_writer, new_datablocks

__all__ = [
    "Asset",
    "BakeError",
    "Encoded",
    "NoGpu",
    "Progress",
    "Result",
    "Surface",
    "asset",
    "bake",
    "encode",
    "unwrap",
]


Choice = TypeVar("Choice")


@dataclass(frozen=True)
class Surface:
    """A triangle mesh as arrays, in one space with the others of the bake, Z up.

    Attributes:
        vertices: (V, 3) floats.
        triangles: (T, 3) indices of vertices, counter-clockwise where seen from the front.
        uv: (V, 2) by vertex, or (T, 3, 2) by corner; row 0 of a map is v = 0. The low mesh needs them.
        normals: (V, 3) by vertex, or (T, 3, 3) by corner. None for smooth normals.
        name: In messages, and for "{low}" in `output`.
    """

    vertices: Any
    triangles: Any
    uv: Any = None
    normals: Any = None
    name: str = ""


Source: TypeAlias = Surface | bpy.types.Object | str | os.PathLike[str]
"""What `bake` reads: arrays, an object of the open scene, or a mesh file. An object with `vertices` and `faces`, as trimesh has
them, is read as arrays."""


@dataclass(frozen=True)
class Result:
    """What a bake made.

    Attributes:
        maps: The maps by the names that were asked for, and found in any spelling: (H, W, 4) float32, row 0 at v = 0. Normals
            lie in 0 to 1, other values are those of a 32-bit file, or of the files that were written. Empty for UDIM tiles,
            which are in files alone.
        files: The absolute paths of the files that were written.
        warnings: Sentences.
        report: Everything that is known of the bake, as `bake --report` writes it.
    """

    maps: dict[str, np.ndarray]
    files: list[str]
    warnings: list[str]
    report: dict[str, Any]


@dataclass(frozen=True)
class Asset(Result):
    """A low mesh that was made, and its maps.

    Attributes:
        mesh: The low mesh, with UVs and normals by corner, in the space of the high meshes.
        levels: The levels of detail that follow, from the finest, with the same maps unless they own textures.
    """

    mesh: Surface
    levels: tuple["Asset", ...] = ()


@dataclass(frozen=True)
class Encoded:
    """Texels in blocks that GPUs read.

    Attributes:
        levels: Of each mip level, from the largest on, its blocks (rows, columns, bytes) uint8, the top row first.
        format: The name of the block format.
        size: Width and height of the largest level, in texels.
        texels: (H, W, 4) float32, row 0 at v = 0: what a GPU shows of the largest level.
        files: The absolute path of the file that was written, or nothing.
    """

    levels: list[np.ndarray]
    format: str
    size: tuple[int, int]
    texels: np.ndarray
    files: list[str]


def bake(
    low: Source,
    high: Source | list[Source] | tuple[Source, ...] | None = None,
    *,
    maps: Sequence[str] | str = ("normal",),
    size: int | tuple[int, int] = 1024,
    cage: Source | None = None,
    output: str | os.PathLike[str] = "",
    smooth_files: int = SMOOTH_BELOW,
    on_progress: Callable[[Progress], None] | None = None,
    **settings: Any,
) -> Result:
    """Bake the detail of high meshes into maps for a low mesh. The open scene stays as it was.

    Args:
        low: with UVs. A file must hold one mesh.
        high: one mesh or a list of them; None to bake `low` onto itself: its materials and its shape.
        maps: names as on the command line: "normal", "ao", "height", "basecolor" ...
        size: the side of a square map in texels, or its width and height.
        cage: a mesh with the vertices of `low` in the same order, on which rays start.
        output: the file of the normal map; those of other maps stand beside it. Empty to write no file.
        smooth_files: the degrees from which edges are hard in high files that do not say how they are shaded; 0 for flat.
        on_progress: called between slices of the work. What it raises ends the bake, which then has changed nothing.
        settings: other settings, as job files name them but with underscores: `samples=4, max_distance=0.1, space="object"`.

    Raises:
        BakeError: for what cannot be baked, with a sentence that says what to fix.
    """
    _check_call("bake", on_progress)
    names = _names(maps)
    asked = _settings(names, size, output, settings)
    degrees = _ANGLE.coerced(smooth_files)
    sources = [] if high is None else _listed(high)
    if not sources and high is not None:
        raise BakeError("high: the list is empty. Leave it out to bake the low mesh onto itself.")
    with _nothing_left() as made_by_caller:
        low_object = _only(_objects(low, "low"), "low")
        highs, smooth_highs = _highs(sources, degrees)
        cages = _objects(cage, "cage") if cage is not None else []
        if isinstance(low, Surface) and low.uv is None:
            raise BakeError("The low mesh has no UVs: give `uv` by vertex (V, 2) or by corner (T, 3, 2).")
        job = Job(low_object, highs or [low_object], _only(cages, "cage") if cages else None)
        with _without_users(low_object):
            (report,) = bake_all(bpy.context, [job], asked, on_progress=on_progress and made_by_caller(on_progress))
            report = replace(report, smooth_files=smooth_highs)
            texels = _named(_arrays(report, asked), names)
            return Result(texels, list(report.output), list(report.warnings), report.to_dict())


def asset(
    high: Source | list[Source] | tuple[Source, ...],
    *,
    triangles: int | None = None,
    degrees: float | None = None,
    distance: float | None = None,
    levels: int = 0,
    own_textures: bool = False,
    stack_mirrored: bool = False,
    density_group: str = "",
    crumbs: float = CRUMBS,
    holes: float = HOLES,
    symmetry: str = "auto",
    quads: bool = False,
    keep: bool = False,
    maps: Sequence[str] | str = ("normal",),
    size: int | tuple[int, int] | str = 1024,
    output: str | os.PathLike[str] = "",
    smooth_files: int = SMOOTH_BELOW,
    on_progress: Callable[[Progress], None] | None = None,
    **settings: Any,
) -> Asset:
    """Make a game asset of high meshes: a low mesh with UVs, and its maps. The open scene stays as it was.

    Args:
        high: one mesh, or a list of them.
        triangles: how many the low mesh has; None for at most 5000; with degrees or distance, the most.
        degrees: the shading error that 99 % of the pixels may have: the fewest triangles within it are searched.
        distance: how far 99 % of the surfaces may be apart, in percent of the longest side of the box.
        levels: how many levels of detail follow, each with half the triangles of the one before it, or twice its limits.
        own_textures: whether each level has UVs and maps of its own.
        stack_mirrored: whether mirrored halves and equal parts have the same UVs.
        density_group: a vertex group whose mean weight on a UV island scales its texel density: 0 halves it, 1 doubles it.
        crumbs: the size in percent of the largest part below which parts are left out; 0 for none.
        holes: the size in percent of the largest part below which holes are filled; 0 for none.
        symmetry: "x", "y" or "z" for a low mesh that equals its mirror image, "auto" if the high mesh does, or "none".
        quads: whether the low mesh is made of quads, which come as two triangles each.
        keep: whether the high mesh itself gets UVs and maps, with all its triangles.
        maps, smooth_files, on_progress, settings: as for `bake`.
        size: as for `bake`, "auto" for texels as small as the high meshes' triangles, or "512/m" for at least 512 a meter.
        output: the file of the normal map; those of other maps stand beside it. With `own_textures`, it has "{low}".

    Raises:
        BakeError: for what cannot be made, with a sentence that says what to fix.
    """
    _check_call("asset", on_progress)
    names = _names(maps)
    texts = {
        "degrees": degrees,
        "triangles": triangles,
        "distance": distance,
        "size": size,
        "crumbs": crumbs,
        "holes": holes,
    }
    ways = {"levels": levels, "own_textures": own_textures, "stack_mirrored": stack_mirrored, "symmetry": symmetry}
    wanted = _wanted(texts, ways | {"quads": quads, "keep": keep, "density_group": density_group})
    asked = _settings(names, asset_limits.SIZES[1] if wanted.finds_size else size, output, settings)
    angle, sources = _ANGLE.coerced(smooth_files), _listed(high)
    if not sources:
        raise BakeError("high: the list is empty.")
    if wanted.owns_textures:
        asked = asked.stored(image=f"{asked.storing.image} {naming.LOW}")
    with _nothing_left() as made_by_caller:
        highs, smooth_highs = _highs(sources, angle)
        suffixes = _free_suffixes(highs[0].name)
        listener = made_by_caller(on_progress) if on_progress else None
        pace = Pace(bake_jobs.PROGRESS_SECONDS if on_progress else None)
        work = game_asset.work(bpy.context, Job(highs[0], highs), wanted, asked, pace, suffixes=suffixes)
        reports = older_blender.with_gpu(lambda: progress.finish(work, listener))
        made = [_made_asset(replace(report, smooth_files=smooth_highs), asked, names) for report in reports]
        return replace(made[0], levels=tuple(made[1:]))


def unwrap(
    mesh: Source,
    *,
    size: int | tuple[int, int] = 1024,
    stack_mirrored: bool = False,
    density_group: str = "",
    on_progress: Callable[[Progress], None] | None = None,
    **settings: Any,
) -> Surface:
    """Give a mesh a UV map. The open scene stays as it was, and so does an object in it.

    Args:
        mesh: of arrays, which keep their order; an object of the open scene, without its modifiers; a file of one mesh.
        size: of the maps that it is for, as for `bake`: it decides how far islands lie apart.
        settings: as for `bake`, of which `margin` and `mips` count.
        stack_mirrored: whether mirrored halves and equal parts have the same UVs.
        density_group: as for `asset`.
        on_progress: as for `bake`.

    Returns:
        The mesh with `uv` by corner (T, 3, 2).

    Raises:
        BakeError: for what cannot be unwrapped, with a sentence that says what to fix.
    """
    _check_call("unwrap", on_progress)
    sampling = _settings({"normal": "NORMAL"}, size, "", settings).sampling
    way = _ways({"stack_mirrored": stack_mirrored, "density_group": density_group})
    with _nothing_left() as made_by_caller:
        obj = _only(_objects(mesh, "mesh"), "mesh")
        weights = uv_density.of_mesh(obj, way["density_group"])
        work = unwrapping.find(obj, sampling, stacks=way["stack_mirrored"], weights=weights)
        found = progress.finish(work, made_by_caller(on_progress) if on_progress else None)
        return _surface(obj, found.uv)


def encode(
    texels: Any,
    format: str = "bc7",  # noqa: A002 - the word of the command line
    *,
    purpose: str = "data",
    mips: bool = True,
    output: str | os.PathLike[str] = "",
) -> Encoded:
    """Encode texels on the GPU in blocks, as engines load them. The open scene stays as it was.

    Args:
        texels: (H, W), (H, W, 3) or (H, W, 4) numbers, row 0 at v = 0, as maps of `bake` are. Whole numbers are uint8, from 0
            to 255, or uint16, to 65,535. Or the path of an image.
        format: "bc4", "bc5", "bc7", "bc6h" or "bc6h-signed".
        purpose: what texels are, whose error is made small: "normal" for unit normals as 0.5 + 0.5 n, "color" for sRGB (in BC6H
            for linear values, which have no range), or "data".
        mips: whether levels down to one texel follow.
        output: a .dds or .ktx2 file to write; "//" starts at the folder of the open .blend file. Empty to write no file.

    Raises:
        BakeError: for what cannot be encoded, with a sentence that says what to fix.
    """
    _check_call("encode", None)
    block_format = _one_of("format", format, BY_NAME)
    kind = _one_of("purpose", purpose, {each.value.lower(): each for each in Purpose})
    has_mips = kinds.Switch(label="mips", tooltip="").coerced(mips)
    path = _value("output", output)
    if path and not ((file_format := file_formats.known(path)) and file_format.is_blocks):
        raise BakeError(f"output: {path!r} is no file of blocks: end it with .dds or .ktx2.")
    files = [encoding.absolute(os.path.abspath(path))] if path else []
    values, has_alpha = _texels(texels)
    if path:
        file_formats.check_size(path, (values.shape[1], values.shape[0]))
    content = older_blender.with_gpu(
        lambda: encoding.encode(values, block_format, kind, has_alpha=has_alpha, mips=has_mips)
    )
    for each in files:
        encoding.write(Path(each), content)
    return Encoded(list(content.levels), block_format.name, content.size, encoding.shown(content), files)


def _one_of(name: str, value: Any, known: Mapping[str, Choice]) -> Choice:
    """What a word of a call names. Raises BakeError."""
    found = {kinds.spelled(each): item for each, item in known.items()}.get(kinds.spelled(value))
    if not isinstance(value, str) or found is None:
        raise BakeError(f"{name}: {kinds.shown(value)} is not one of {', '.join(known)}.")
    return found


def _texels(source: Any) -> tuple[np.ndarray, bool]:
    """The texels (H, W, 4) float32 of a call, and whether they have alpha. Raises BakeError."""
    if isinstance(source, str | os.PathLike):
        path = _value("output", source, "texels")
        if not os.path.isfile(path):
            raise BakeError(f"texels: there is no file {path!r}.")
        _check_side(encoding.size_of(path))
        values, has_alpha = encoding.read(path)
    else:
        array = _array(source)
        array = array[..., None] if array.ndim == 2 else array
        if array.dtype.kind not in "iuf" or array.ndim != 3 or array.shape[2] not in (1, 3, 4) or not array.size:
            shape = array.shape if array.ndim else kinds.shown(source)
            raise BakeError(f"texels: {shape} are no numbers of the shape (H, W), (H, W, 3) or (H, W, 4).")
        if array.dtype.kind != "f" and array.dtype not in (np.uint8, np.uint16):
            raise BakeError(
                f"texels: {array.dtype} does not say what is white: give floats from 0 to 1, uint8 or uint16."
            )
        _check_side(array.shape[:2])
        most = np.float32(1.0 if array.dtype.kind == "f" else np.iinfo(array.dtype).max)
        values, has_alpha = np.ones((*array.shape[:2], 4), np.float32), array.shape[2] == 4
        values[..., : max(array.shape[2], 3)] = array / most
    if not np.isfinite(values).all():
        raise BakeError("texels: some are not finite: give each a number.")
    return values, has_alpha


def _check_side(size: tuple[int, ...]) -> None:
    """Raise BakeError for texels that are too many along a side."""
    if max(size) > file_formats.LONGEST_SIDE:
        raise BakeError(
            f"texels: a side of {max(size):,} is above {file_formats.LONGEST_SIDE:,}, which GPUs do not load."
        )


class _Maps(dict[str, np.ndarray]):
    """The maps by their names, which are found in any spelling."""

    def __missing__(self, name: Any) -> np.ndarray:
        for each, texels in self.items():
            if kinds.spelled(each) == kinds.spelled(name):
                return texels
        raise KeyError(name)


_ELSEWHERE = {"width": "size", "height": "size", "normal": "maps"}
"""Settings that an argument of another name holds."""
_OF_SCENES = ("image", "storage", "material", "connect_maps", "one_material", "texture_sets")
"""Settings of what a bake leaves in the file, where this one leaves nothing."""


def _check_call(name: str, on_progress: Any) -> None:
    """Raise BakeError for a call in another thread than the first, and for a listener that is none."""
    if threading.current_thread() is not threading.main_thread():
        raise BakeError(
            f"imprint.{name} was called in a thread: Blender draws in the main thread alone. Call it there."
        )
    if on_progress is not None and not callable(on_progress):
        raise BakeError(f"on_progress: {kinds.shown(on_progress)} is not a function.")


_WAYS = {
    name: f"asset_{'keeps' if name == 'keep' else name}"
    for name in ("levels", "own_textures", "stack_mirrored", "symmetry", "quads", "keep", "density_group")
}
"""The declarations of arguments of an asset."""


def _ways(ways: dict[str, Any]) -> dict[str, Any]:
    """Checked values of ASSET. Raises BakeError."""
    return {name: replace(ASSET[_WAYS[name]], label=name).coerced(value) for name, value in ways.items()}


def _wanted(texts: dict[str, Any], ways: dict[str, Any]) -> Wanted:
    """The limits of an asset. texts: numbers or texts, by their names; ways: values of ASSET. Raises BakeError."""
    text = {name: _text(value) for name, value in texts.items()}
    way = _ways(ways)
    if way["keep"] and text["triangles"]:
        raise BakeError("keep: the mesh keeps all its triangles. Leave out `triangles`.")
    return Wanted.of_texts(
        text["degrees"],
        text["triangles"],
        text["size"],
        text["distance"],
        way["levels"],
        mending=Mending.of_texts(text["crumbs"], text["holes"], way["symmetry"]),
        owns_textures=way["own_textures"],
        stacks_mirrored=way["stack_mirrored"],
        quads=way["quads"],
        keeps=way["keep"],
        density_group=way["density_group"],
    )


def _text(value: Any) -> str:
    """A number or a text as a panel's field holds it; empty for None."""
    value = kinds.plain(value)
    return "" if value is None else value if isinstance(value, str) else kinds.shown(value)


def _made_asset(report: Report, settings: Settings, names: dict[str, str]) -> Asset:
    """A low mesh of an asset, by the report of its bake."""
    texels = _named(_arrays(report, settings), names)
    mesh = _surface(report.refs[0].resolve())
    return Asset(texels, list(report.output), list(report.warnings), report.to_dict(), mesh)


def _free_suffixes(high: str) -> Suffixes:
    """Endings by which nothing in the open file is called that is made of a high object of this name."""
    usual = Suffixes()
    made = {*naming.made_names(high, usual, asset_limits.MOST_LEVELS), naming.low_name_of(high, usual) + naming.LEVELS}
    if made.isdisjoint([*bpy.data.objects.keys(), *bpy.data.collections.keys()]):
        return usual
    return replace(usual, low=f"_low {uuid.uuid4().hex}")


def _names(maps: Any) -> dict[str, str]:
    """The maps of a call: as it spells them, with their names among map_types."""
    parts = maps.split(",") if isinstance(maps, str) else kinds.listed(maps)
    if parts is None or not all(isinstance(part, str) for part in parts):
        raise BakeError(f'maps: {kinds.shown(maps)} is not a list of names, such as ["normal", "ao"].')
    known = {kinds.spelled(each.name): each.name for each in (map_types.NORMAL, *map_types.OTHERS)}
    for part in parts:
        if kinds.spelled(part) not in known:
            raise BakeError(f"There is no map {part!r}{did_you_mean([kinds.spelled(part)], known) or '.'}")
    return {part.strip(): known[kinds.spelled(part)] for part in parts}


def _named(arrays: dict[str, np.ndarray], names: dict[str, str]) -> _Maps:
    """The maps of a bake, first those of `names`, by the spelling there."""
    keys = {name: key.lower() for name, key in names.items() if key.lower() in arrays}
    others = {key: texels for key, texels in arrays.items() if key not in keys.values()}
    return _Maps({name: arrays[key] for name, key in keys.items()} | others)


def _settings(names: dict[str, str], size: Any, output: Any, values: dict[str, Any]) -> Settings:
    """The settings of a call. Raises BakeError for names that are unknown and for values that are not valid."""
    _check_names(values)
    size = kinds.plain(size)
    both = size if isinstance(size, list | tuple) else (size, size)
    if len(both) != 2:
        raise BakeError(f"size: {kinds.shown(size)} is neither a number of texels nor a width and a height.")
    path = _value("output", output)
    values = {"depth": file_formats.usual_depth(path) if path else 32, **values}
    result = Settings(
        width=_value("width", both[0], "size"),
        height=_value("height", both[1], "size"),
        normal=map_types.NORMAL.name in names.values(),
        maps=tuple(name for name in map_types.NAMES if name in names.values()),
        storage=Storage.FILE if path else Storage.MEMORY,
        output=os.path.abspath(path) if path else "",
        image=f".imprint {uuid.uuid4().hex}",  # no image of the open file has this name
        material=False,
        **{name: _value(name, value) for name, value in values.items()},
    )
    result.check()
    return result


def _check_names(values: dict[str, Any]) -> None:
    names = [name for name in PART_OF if name not in {*_ELSEWHERE, *_OF_SCENES}]
    for name in values:
        if name in _ELSEWHERE:
            raise BakeError(f"There is no setting {name!r} here: give {_ELSEWHERE[name]!r}.")
        if name in _OF_SCENES:
            raise BakeError(
                f"There is no setting {name!r} here: the maps are arrays and files, and the scene stays as it was."
            )
        if name not in names:
            raise BakeError(f"There is no setting {name!r} of a bake{did_you_mean([name], names) or '.'}")


def _value(name: str, value: Any, title: str = "") -> Any:
    """A value as Settings has it. title: the name in messages, if it differs."""
    return replace(DECLARED[name], label=title or name).coerced(value)


def _objects(source: Source, name: str) -> list[bpy.types.Object]:
    """The objects of a source, which are made or imported if they are not in the scene. name: of one that has none."""
    if isinstance(source, bpy.types.Object):
        try:
            source.name  # noqa: B018
        except ReferenceError:
            raise BakeError(f"The object of {name!r} was deleted: give one of the open file.") from None
        return [source]
    if isinstance(source, str | os.PathLike):
        with importing.scene_apart():
            return importing.import_meshes(_value("output", source, name), importing.PLAIN)
    if not isinstance(source, Surface) and hasattr(source, "vertices") and hasattr(source, "faces"):
        visual = getattr(source, "visual", None)
        normals = getattr(source, "vertex_normals", None)
        source = Surface(source.vertices, source.faces, getattr(visual, "uv", None), normals)
    if not isinstance(source, Surface):
        raise BakeError(
            f"{type(source).__name__} is not a mesh: give a Surface, an object of Blender or the path of a file."
        )
    if not isinstance(source.name, str):
        raise BakeError(f"The name of the Surface for {name!r} is not a text: {kinds.shown(source.name)}.")
    return [_made(source, source.name or name)]


_ANGLE = kinds.WholeNumber(label="smooth_files", tooltip="", default=SMOOTH_BELOW, least=0, most=180)


def _listed(sources: Any) -> list:
    return list(sources) if isinstance(sources, list | tuple) else [sources]


def _highs(sources: Sequence[Source], degrees: int) -> tuple[list[bpy.types.Object], dict[str, int]]:
    """The objects of high meshes, and how those of files are shaded, as `_smoothed` says."""
    highs, smooth = [], {}
    for number, source in enumerate(sources, start=1):
        objects = _objects(source, f"high {number}")
        smooth |= _smoothed(source, objects, degrees)
        highs += objects
    return highs, smooth


def _surface(obj: bpy.types.Object, uv: np.ndarray | None = None) -> Surface:
    """An object's own mesh where it is in the scene. uv: of its corners (C, 2), in place of its own UVs."""
    data, to_world = obj.data, mesh_reader.matrix(obj)
    if not isinstance(data, bpy.types.Mesh):
        raise BakeError(f"{obj.name!r} is no mesh: convert it to one.")
    corners, linear = mesh_reader.triangles(data), to_world[:3, :3]
    if np.linalg.det(linear) < 0.0:
        corners = corners[:, ::-1]  # a mirrored object shows the other sides of its triangles
    points = mesh_reader.points(data) @ linear.T + to_world[:3, 3]
    normals = (mesh_reader.corner_normals(data) @ np.linalg.pinv(linear))[corners]
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-30)
    uv = mesh_reader.uvs(data, mesh_reader.active_uv_layer(data)) if uv is None else uv
    return Surface(points, mesh_reader.corner_vertices(data)[corners], uv[corners], normals, obj.name)


def _smoothed(source: Source, objects: Sequence[bpy.types.Object], degrees: int) -> dict[str, int]:
    """Shade objects of a file as `smooth_files` says. Returns the degrees by their names."""
    path = Path(os.fspath(source)) if isinstance(source, str | os.PathLike) else None
    meshes = [(obj, obj.data) for obj in objects if isinstance(obj.data, bpy.types.Mesh)]
    unshaded = [(obj, data) for obj, data in meshes if path and degrees and importing.lacks_normals(path, data)]
    for _, data in unshaded:
        importing.smooth(data, degrees)
    return {obj.name: degrees for obj, _ in unshaded}


def _only(objects: Sequence[bpy.types.Object], role: str) -> bpy.types.Object:
    if len(objects) > 1:
        raise BakeError(f"The {role} file holds {len(objects)} meshes where one is wanted: join them.")
    return objects[0]


def _made(surface: Surface, name: str) -> bpy.types.Object:
    """An object of the open scene with the mesh of a surface."""
    vertices, triangles = _rows(surface.vertices, 3, f"The vertices of {name!r}"), _array(surface.triangles)
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
        raise BakeError(f"The triangles of {name!r} are not whole numbers of the shape (T, 3).")
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise BakeError(f"The triangles of {name!r} name vertices that it does not have: indices count from 0.")
    if not triangles.size:
        raise BakeError(f"{name!r} has no triangles.")
    data = bpy.data.meshes.new(name)
    mesh_writer.fill(data, vertices, triangles)
    data.update(calc_edges=True)
    if surface.uv is not None:
        uv = _by_corner(surface.uv, 2, (len(vertices), triangles), f"The UVs of {name!r}")
        data.uv_layers.new(name="UVMap", do_init=False).uv.foreach_set("vector", uv.ravel())
    if surface.normals is not None:
        normals = _by_corner(surface.normals, 3, (len(vertices), triangles), f"The normals of {name!r}")
        # Blender keeps the vectors exactly; normals_split_custom_set would round them.
        attribute = data.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
        attribute.data.foreach_set("vector", normals.ravel())  # pyright: ignore[reportAttributeAccessIssue]
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def _by_corner(values: Any, width: int, of: tuple[int, np.ndarray], what: str) -> np.ndarray:
    """Values by vertex or corner as (3 T, width) float32. of: the number of vertices, and the triangles."""
    array, (count, triangles) = _array(values), of
    if array.shape == (*triangles.shape, width):
        return _rows(array.reshape(-1, width), width, what)
    if array.shape == (count, width):
        return _rows(array, width, what)[triangles.ravel()]
    raise BakeError(
        f"{what} have the shape {array.shape}: give {(count, width)} by vertex or {(*triangles.shape, width)} by corner."
    )


def _rows(values: Any, width: int, what: str) -> np.ndarray:
    """Values as (N, width) float32."""
    array = _array(values)
    if array.dtype.kind not in "iuf" or array.ndim != 2 or array.shape[1] != width:
        raise BakeError(f"{what} are not numbers of the shape (N, {width}).")
    with np.errstate(over="ignore"):  # what no single-precision number holds is infinite, and left out as that
        return np.ascontiguousarray(array, np.float32)


def _array(values: Any) -> np.ndarray:
    """Values as an array, of the kind "O" if they are not the numbers of one."""
    try:
        return np.asarray(values)
    except ValueError:  # rows of different lengths
        return np.asarray(None)


def _arrays(report: Report, settings: Settings) -> dict[str, np.ndarray]:
    """The images of a bake as arrays, by the names of the maps."""
    if settings.sampling.udim:
        return {}
    images = {"normal": report.image} if settings.map.normal else {}
    images |= {name: how["image"] for name, how in report.maps.items()}
    return {name: encoding.stored(bpy.data.images[image]) for name, image in images.items()}


@contextmanager
def _nothing_left() -> Iterator[Callable[[Callable[[Progress], None]], Callable[[Progress], None]]]:
    """Remove what the block adds to the open file. Yields a decorator of functions of the caller: what these add stays."""
    before = new_datablocks.known()

    def kept(on_progress: Callable[[Progress], None]) -> Callable[[Progress], None]:
        def called(progress: Progress) -> None:
            start = new_datablocks.known()
            try:
                on_progress(progress)
            finally:
                before.update(new_datablocks.known() - start)

        return called

    try:
        yield kept
    finally:
        new_datablocks.remove_new(before)


@contextmanager
def _without_users(low: bpy.types.Object) -> Iterator[None]:
    """Take from the object's list of maps what the block adds to it. Only the window's Blender has the list."""
    imprint = getattr(low, "imprint", None)
    maps = None if imprint is None else imprint.maps
    count = len(maps) if maps is not None else 0
    try:
        yield
    finally:
        while maps is not None and len(maps) > count:
            maps.remove(len(maps) - 1)
