# SPDX-License-Identifier: GPL-3.0-or-later
"""Sets to a job file, which a shell or a farm bakes without the window, and sets from one."""

import json
import os
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from ..core import file_formats, naming
from ..core.errors import BakeError, shorten_list
from ..core.scene_sets import JobSet, Part, SceneSet
from ..output import atomic_file
from ..scene.object_checks import object_by_name
from . import declared_properties, set_description
from .modal import FileOperator, file_filter, warning_of_files
from .object_pairs import SIZES
from .set_operators import SetOperator, add, check_editable, put_pair, put_part
from .sets import ImprintSet
from .texts import labeled

ENDINGS = (".toml", ".json")
"""Of job files."""


def written(path: Path, described: Sequence[SceneSet]) -> str:
    """The text of a job file with sets of the open file. path: where it is written, from which paths in it start."""
    tables = [_relative(one.keys(bpy.data.filepath), path.parent) for one in described]
    if path.suffix.lower() == ".json":
        return json.dumps({"bake": tables}, indent=2, ensure_ascii=False) + "\n"
    return "\n".join("[[bake]]\n" + "".join(f"{key} = {_toml(table[key])}\n" for key in table) for table in tables)


def _relative(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A set with paths that start at `folder`, where they can."""
    return table | {
        key: [_path(each, folder) for each in table[key]] if key == "file" else _path(table[key], folder)
        for key in ("file", "output", "export")
        if table.get(key)
    }


def _path(path: str, folder: Path) -> str:
    try:
        return os.path.relpath(path, folder).replace(os.sep, "/")
    except ValueError:  # another drive
        return path


def _toml(value: Any) -> str:
    """A value as TOML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)} = {_toml(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, str):  # TOML has the escapes of JSON, and one character more that it refuses
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return json.dumps(value)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _toml(name)


def read(path: Path) -> Iterator[dict[str, Any]]:
    """The tables of the sets of a job file, with its defaults. Raises BakeError."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        table = json.loads(text) if path.suffix.lower() == ".json" else tomllib.loads(text)
        tables, defaults = table["bake"], table.get("defaults", {})
        yield from ({**defaults, **each} for each in tables)
    except OSError as error:
        raise BakeError(f"{str(path)!r} cannot be read: {error.strerror}.") from error
    except (ValueError, RecursionError, KeyError, TypeError, AttributeError) as error:
        raise BakeError(f"{str(path)!r} is no job file: {error}.") from error


class IMPRINT_OT_sets_to_job_file(FileOperator, bpy.types.Operator):
    """Write the sets that are on to a job file, which bakes them in a shell or on a farm without the window"""

    bl_idname = "imprint.sets_to_job_file"
    bl_label = "Sets to Job File"

    filepath: labeled(
        StringProperty, "Job File", "File to write, .toml or .json", subtype="FILE_PATH", options={"SKIP_SAVE"}
    )
    filter_glob: file_filter("*.toml;*.json")
    check_existing: warning_of_files()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.filepath and bpy.data.filepath:
            self.filepath = str(Path(bpy.data.filepath).with_suffix(ENDINGS[0]))
        return super().invoke(context, event)

    def apply(self, context: bpy.types.Context) -> str:
        if not bpy.data.filepath:
            raise BakeError("The job file names the .blend: save it first.")
        path = Path(bpy.path.abspath(self.filepath)).absolute()
        if path.suffix.lower() not in ENDINGS:
            path = path.with_name(f"{path.name}.toml")
        described = [set_description.describe(one) for one in context.scene.imprint_sets if one.is_on]
        made = [_with_output(one, path.parent) for one in described if not one.problem]
        if not made:
            raise BakeError(described[0].problem if described else "No set is on: switch one on, or add one.")
        with atomic_file.replacing(path) as temporary:
            temporary.write_text(written(path, made), encoding="utf-8")
        left = [one.problem for one in described if one.problem]
        return " ".join([f"Written: {shorten_list(repr(one.name) for one in made)} to {path.name!r}.", *left])


def _with_output(one: SceneSet, folder: Path) -> SceneSet:
    """The set; if it stores its maps in the .blend, with files beside the job file, where other programs find them."""
    if one.output:
        return one
    storing = one.settings.storing
    image = storing.image or (naming.of_texture_sets(naming.USUAL) if one.settings.map.texture_sets else naming.USUAL)
    ending = ".exr" if storing.depth > file_formats.USUAL_DEPTH else ".png"
    return replace(one, output=str(folder / f"{image}{ending}"))


class IMPRINT_OT_sets_from_job_file(SetOperator, FileOperator, bpy.types.Operator):
    """Add the sets of a job file that are of this .blend"""

    bl_idname = "imprint.sets_from_job_file"
    bl_label = "Sets from Job File"

    filepath: labeled(
        StringProperty, "Job File", "File to read, .toml or .json", subtype="FILE_PATH", options={"SKIP_SAVE"}
    )
    filter_glob: file_filter("*.toml;*.json")

    def apply(self, context: bpy.types.Context) -> str:
        path = Path(bpy.path.abspath(self.filepath)).absolute()
        tables = list(read(path))
        made, left = [], []
        for number, table in enumerate(tables, 1):
            try:
                made.append(_take(context, JobSet.of_keys(table), path.parent).name)
            except BakeError as error:
                left.append(f"Set {number}: {error}")
        if not made:
            raise BakeError(left[0] if left else f"{str(path)!r} has no set.")
        return " ".join([f"Added: {shorten_list(map(repr, made))}.", *left])


def _take(context: bpy.types.Context, made: JobSet, folder: Path) -> ImprintSet:
    """Add a set of a job file. folder: where its paths start. Raises BakeError, and then nothing was added."""
    _check_place(context, made, folder)
    if made.settings.map.texture_sets and not made.share_image and len(made.parts) > 1:
        raise BakeError("Its images are of each part and each material: a set shares them by one of the two.")
    for part in made.parts:
        for name, size in ((part.low, part.size), *part.sizes):
            if str(size) not in {"0", *map(str, SIZES)}:
                raise BakeError(
                    f"{name!r} cannot have {size} texels of its own: {', '.join(map(str, SIZES))} are possible."
                )
    jobs = [(part, *_objects(part)) for part in made.parts]
    one = add(context, made.name or (naming.without_suffix(made.parts[0].low) if made.parts else ""))
    one.source = "NAMES" if made.pairs else "PARTS"
    one.textures = "MATERIAL" if made.settings.map.texture_sets else "ONE" if made.share_image else "PART"
    output = bpy.path.relpath(str(folder / made.settings.storing.output)) if bpy.data.filepath else ""
    declared_properties.put_settings(one.own.whole, made.settings.stored(output=output or made.settings.storing.output))
    export = bpy.path.relpath(str(folder / made.export)) if made.export else ""
    if export != one.own.whole.export:
        one.own.export = export
    for part, low, highs, cage in jobs:
        put_part(one, low)
        if part.low not in made.by_name:
            put_pair(context, low, highs or [low], cage)
        low.imprint_size, low.imprint_distance, low.imprint_is_baked = str(part.size), part.distance, part.is_on
        for name, size in part.sizes:
            if name in bpy.data.materials:
                bpy.data.materials[name].imprint_size = str(size)
    return one


def _objects(part: Part) -> tuple[bpy.types.Object, list[bpy.types.Object], bpy.types.Object | None]:
    """The low object, the high ones and the cage of a part. Raises BakeError if one is missing, or is of another file."""
    low = object_by_name(part.low)
    check_editable(low)
    return low, list(map(object_by_name, part.highs)), object_by_name(part.cage) if part.cage else None


def _check_place(context: bpy.types.Context, made: JobSet, folder: Path) -> None:
    """Raise BakeError if a set is not of the open file and scene, or has keys that no set has."""
    for file in made.file:
        if not bpy.data.filepath or os.path.realpath(folder / file) != os.path.realpath(bpy.data.filepath):
            raise BakeError(f"It is of the file {file!r}, which is not open.")
    if made.scene not in {"", context.scene.name}:
        raise BakeError(f"It is of the scene {made.scene!r}: show that scene first.")
    if made.others:
        raise BakeError(f"A set has no {made.others[0]!r}.")
    if not made.parts and not made.pairs:
        raise BakeError("It names no low object.")
    made.settings.check()


CLASSES = (IMPRINT_OT_sets_to_job_file, IMPRINT_OT_sets_from_job_file)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
