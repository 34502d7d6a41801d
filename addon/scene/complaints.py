# SPDX-License-Identifier: GPL-3.0-or-later
"""What objects lack when Blender evaluates them: files, linked datablocks, modifiers with an error or without their object.

Blender shows an error of a modifier in its panel and prints it, and names it nowhere else. So objects with modifiers of such
kinds are evaluated while this listens.
"""

import os
import re
import tempfile
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass

import bpy

from ..core import quiet
from ..core.sentences import WRONG, rated
from . import dependencies

_SAID = re.compile(rb'^.*Object: "(.*)", Modifier: "(.*)", (.*)$', re.MULTILINE)
"""A line that Blender prints of a modifier: 4.5 and 5.2 begin it in different ways."""
_MOST = 1 << 20
"""Bytes that are searched."""
_PRINTED = {
    *("ARRAY", "BOOLEAN", "CORRECTIVE_SMOOTH", "DATA_TRANSFER", "HOOK", "LAPLACIANDEFORM", "MESH_CACHE"),
    *("MESH_DEFORM", "MESH_SEQUENCE_CACHE", "MESH_TO_VOLUME", "NORMAL_EDIT", "OCEAN", "REMESH", "SKIN"),
    *("SURFACE_DEFORM", "UV_PROJECT", "VOLUME_DISPLACE", "VOLUME_TO_MESH"),
}
"""The types of modifiers whose errors Blender only prints. Those of nodes are in their modifier."""


@dataclass(frozen=True)
class Complaint:
    """A modifier that Blender leaves out.

    Attributes:
        text: Why, as a clause without a full stop.
        owner: The name of the object.
    """

    owner: str
    modifier: str
    text: str

    def __str__(self) -> str:
        why = self.text[:1].upper() + self.text[1:]
        return (
            f"Blender leaves out the modifier {self.modifier!r} of {self.owner!r}. {why}: repair it, or switch it off."
        )


def of_files(objects: Sequence[bpy.types.Object], *, for_render: bool) -> list[str]:
    """The files and linked datablocks that `objects`, and those that they use, lack, in sentences.

    This evaluates nothing: a file that ends too early can crash Blender. for_render: as in dependencies.of.
    """
    lacking = dependencies.lacking(dependencies.of(objects, for_render=for_render))
    files = [f"{each.path!r}, {each.what}, {each.problem}: restore it, or remove what uses it." for each in lacking]
    return rated([*files, *dependencies.missing_blocks(objects)], WRONG)


class Listener:
    """Notes which modifiers Blender leaves out of `objects`, and of those that they use, while a block evaluates them.

    for_render: as in dependencies.of.
    """

    def __init__(self, objects: Sequence[bpy.types.Object], *, for_render: bool):
        self._used = dependencies.used_by(objects)
        lacking = dependencies.lacking(dependencies.of(objects, for_render=for_render))
        self._paths = {each.path for each in lacking}
        owners = [block for block in self._used if isinstance(block, bpy.types.Object)]
        modifiers = [(obj, modifier) for obj in owners for modifier in obj.modifiers]
        modifiers = [each for each in modifiers if (each[1].show_render if for_render else each[1].show_viewport)]
        self._shown = [each for each in modifiers if not self._paths & set(dependencies.paths_of_modifier(each[1]))]
        self._said = b""

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Listen in a block that evaluates the objects."""
        asked = dict.fromkeys(obj for obj, modifier in self._shown if modifier.type in _PRINTED)
        for obj in asked:
            obj.update_tag(refresh={"DATA"})  # or the viewport would not evaluate it again
        with _heard(self._take) if asked else nullcontext():
            yield

    def _take(self, said: bytes) -> None:
        self._said = said

    def complaints(self) -> list[str]:
        """The modifiers that were left out, in sentences. Those that lack a file are left out, which `of_files` names."""
        listed = [
            Complaint(obj.name, modifier.name, text) for obj, modifier in self._shown if (text := _lack(modifier))
        ]
        listed += self._printed()
        for obj, modifier in self._shown:
            for each in modifier.node_warnings if modifier.type == "NODES" else ():
                if each.type == "ERROR":
                    listed.append(Complaint(obj.name, modifier.name, each.message.rstrip(".")))
        once = {(each.owner, each.modifier): each for each in reversed(listed)}
        texts = [*map(str, reversed(once.values())), *_unread_images(self._used, self._paths)]
        return rated(texts, WRONG)

    def _printed(self) -> Iterator[Complaint]:
        """What Blender has printed of these modifiers."""
        names = {(obj.name, modifier.name) for obj, modifier in self._shown}
        for owner, modifier, text in _SAID.findall(self._said):
            key = owner.decode(errors="replace"), modifier.decode(errors="replace")
            if key in names:
                yield Complaint(*key, text.decode(errors="replace").strip().rstrip("."))


def _unread_images(used: Sequence[bpy.types.ID], lacking: Container[str]) -> Iterator[str]:
    """Images of modifiers that Blender cannot read, in sentences, except those of the paths in `lacking`."""
    for image in used:
        if isinstance(image, bpy.types.Image) and image.source in {"FILE", "MOVIE"} and image.filepath:
            path = dependencies.absolute(image.filepath, image)
            if path not in lacking and not image.packed_file and not image.size[0]:
                yield f"{path!r}, the image {image.name!r}, cannot be read: restore it, or remove what uses it."


@contextmanager
def _heard(take: Callable[[bytes], None]) -> Iterator[None]:
    """Give `take` what the block prints, in C as well. Streams receive the rest of it afterwards."""
    try:
        os.fstat(1), os.fstat(2)
    except OSError:  # a window may have no streams
        yield
        return
    said = b""
    try:
        with tempfile.TemporaryFile() as file:
            try:
                with quiet.silence(into=file.fileno()):
                    yield
            finally:
                file.seek(0)
                said = file.read(_MOST)
    finally:
        take(said)
        rest = b"\n".join(line for line in said.split(b"\n") if not _SAID.match(line)).strip()
        if rest:
            os.write(1, rest + b"\n")


def _lack(modifier: bpy.types.Modifier) -> str:
    """What a modifier lacks, so that Blender skips it without a word; empty if nothing."""
    check = _LACKS.get(modifier.type)
    return check(modifier) if check else ""


def _needs(name: str, text: str) -> Callable[[bpy.types.Modifier], str]:
    return lambda modifier: "" if getattr(modifier, name) else text


def _boolean(modifier: bpy.types.BooleanModifier) -> str:
    if modifier.operand_type == "OBJECT":
        return "" if modifier.object else "it has no object"
    return "" if modifier.collection else "it has no collection"


def _bound(target: str) -> Callable[[bpy.types.Modifier], str]:
    return lambda modifier: (
        "it has no object" if not getattr(modifier, target) else "" if modifier.is_bound else "it is not bound"
    )


def _nodes(modifier: bpy.types.NodesModifier) -> str:
    if modifier.node_group is None:
        return "it has no nodes"
    outputs = [each for each in modifier.node_group.interface.items_tree if getattr(each, "in_out", "") == "OUTPUT"]
    if not any(node.type == "GROUP_OUTPUT" for node in modifier.node_group.nodes):
        return "its nodes have no output"
    return "" if outputs and outputs[0].socket_type == "NodeSocketGeometry" else "the first output is no geometry"


def _sequence_cache(modifier: bpy.types.MeshSequenceCacheModifier) -> str:
    if modifier.cache_file is None:
        return "it has no cache file"
    return "" if modifier.object_path else "it names no object of its cache file"


def _displace(modifier: bpy.types.DisplaceModifier) -> str:
    texture = modifier.texture
    return "its texture has no image" if texture and texture.type == "IMAGE" and texture.image is None else ""


def _warp(modifier: bpy.types.WarpModifier) -> str:
    return "" if modifier.object_from and modifier.object_to else "it has no objects"


_LACKS: dict[str, Callable[[bpy.types.Modifier], str]] = {
    "ARMATURE": _needs("object", "it has no object"),
    "BOOLEAN": _boolean,
    "CURVE": _needs("object", "it has no object"),
    "DATA_TRANSFER": _needs("object", "it has no object"),
    "DISPLACE": _displace,
    "HOOK": _needs("object", "it has no object"),
    "LAPLACIANDEFORM": _needs("is_bind", "it is not bound"),
    "LATTICE": _needs("object", "it has no object"),
    "MESH_CACHE": _needs("filepath", "it has no file"),
    "MESH_DEFORM": _bound("object"),
    "MESH_SEQUENCE_CACHE": _sequence_cache,
    "NODES": _nodes,
    "PARTICLE_INSTANCE": _needs("object", "it has no object"),
    "SHRINKWRAP": _needs("target", "it has no target"),
    "SURFACE_DEFORM": _bound("target"),
    "VOLUME_TO_MESH": _needs("object", "it has no object"),
    "WARP": _warp,
}
"""What each type of modifier lacks, where Blender prints nothing."""
