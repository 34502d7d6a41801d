# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that objects are made from: those of their modifiers, nodes, caches, fonts, textures and libraries.

Blender names paths, but not what depends on them. This follows the datablocks that objects use, to the files that these name.
"""

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar, NamedTuple

import bpy

from .. import older_blender
from ..core import udim
from ..core.file_structure import usd_layers, whole_files
from ..core.map_types import MARK, ORIGIN
from . import textures

IMPORT_NODES = "GeometryNodeImport"
"""The start of the names of the nodes that read files, at paths that other nodes can make."""
_BUILT_IN = "<builtin>"
"""The path of Blender's own font."""
_PACKABLE = {bpy.types.Volume: "the volume", bpy.types.VectorFont: "the font", bpy.types.Sound: "the sound"}
_NUMBER = re.compile(r"(\d+)(?!.*\d)", re.DOTALL)
"""The number of a frame in a file's name: the last one."""
_BROKEN = whole_files.CUT, whole_files.POINTER
"""Problems of files in the folder of a cache, where some may be empty."""
_FOREIGN = bpy.types.Scene, bpy.types.MovieClip, bpy.types.Text
"""Types whose files decide nothing of a mesh."""


@dataclass(frozen=True)
class Dependency:
    """A file that objects are made from.

    Attributes:
        path: Absolute. A name that udim.is_tiled stands for the files of all tiles, and a folder for all files in it.
        what: In messages.
        is_surface: Whether only materials show it.
        is_needed: Whether the object differs without it; else it may be missing.
        is_own_map: Whether it is an image that Imprint baked.
        tiles: Of an image, those that it has, empty for one without tiles; None for other files.
    """

    path: str
    what: str
    is_surface: bool = False
    is_needed: bool = True
    is_own_map: bool = False
    tiles: tuple[int, ...] | None = None


class Lacking(NamedTuple):
    """A file that is missing or not whole.

    Attributes:
        what: As in Dependency.
        problem: A clause, as whole_files.problem returns it.
    """

    path: str
    what: str
    problem: str


def of(
    objects: Iterable[bpy.types.Object], shown: Iterable[bpy.types.Object] = (), *, for_render: bool = True
) -> list[Dependency]:
    """The files that the meshes of `objects` are made from, and those that the materials of `shown` name, each once.

    for_render: whether modifiers count that are rendered, or those that the viewport shows.
    """
    used = Uses.now()
    blocks = used.by(objects)
    files = [each for block in blocks for each in _of_block(block, for_render=for_render)]
    files += _libraries(blocks)
    files += _others(blocks)
    of_materials = used.by_materials(used.by(shown))
    files += [each for block in of_materials for each in _of_block(block, is_surface=True)]
    once: dict[str, Dependency] = {}
    for each in sorted(files, key=lambda each: not each.is_needed):
        once.setdefault(each.path, each)
    return list(once.values())


def not_to_replace(
    bakes: Iterable[tuple[bpy.types.Object, Sequence[bpy.types.Object], Sequence[bpy.types.Object]]],
) -> list[Dependency]:
    """The files that bakes read, each once: a map that takes the place of one of them would be lost, or the file.

    bakes: the low object of each, its high objects, and other objects that it reads. Maps that an earlier bake has put into the
    low object's materials may be replaced, also where the high objects show the same materials.
    """
    bakes, used = list(bakes), Uses.now()
    read = of([each for low, highs, others in bakes for each in (low, *highs, *others)])
    for low, highs, _ in bakes:
        own = used.materials_of(low)
        shown = [block for block in used.by(highs) if isinstance(block, bpy.types.Material)]
        for is_shared in (False, True):
            images = used.by_materials(each for each in shown if (each in own) == is_shared)
            surfaces = (each for image in images for each in _of_block(image, is_surface=True))
            read += [each for each in surfaces if not (is_shared and each.is_own_map)]
    return list({each.path: each for each in reversed(read)}.values())


def lacking(files: Iterable[Dependency]) -> list[Lacking]:
    """The files that are needed, and missing or not whole, also those in folders."""
    return [each for wanted in files if wanted.is_needed for each in _lacking(wanted)]


def _lacking(wanted: Dependency) -> Iterator[Lacking]:
    is_image = wanted.tiles is not None
    if os.path.isdir(wanted.path) and not is_image:
        paths = [os.path.join(folder, name) for folder, _, names in os.walk(wanted.path) for name in names]
        if not paths:
            yield Lacking(wanted.path, wanted.what, whole_files.EMPTY)
        problems = ((path, whole_files.problem(path)) for path in paths)
        yield from (Lacking(path, wanted.what, problem) for path, problem in problems if problem in _BROKEN)
        return
    for path in [udim.fill_all(wanted.path, tile) for tile in wanted.tiles or ()] or [wanted.path]:
        problem = whole_files.problem(path, is_image=is_image) or (_unreadable(path) if is_image else "")
        if problem:
            yield Lacking(path, wanted.what, problem)


def _unreadable(path: str) -> str:
    """A clause if an image gives no pixels, and only who decodes it sees that; else empty."""
    try:
        state = os.stat(path)
        if whole_files.says_end(path):
            return ""
    except OSError:
        return ""
    return "" if _has_pixels(path, state.st_size, state.st_mtime_ns) else whole_files.NO_PIXELS


@lru_cache(maxsize=4096)
def _has_pixels(path: str, _size: int, _time: int) -> bool:
    """Whether Blender decodes an image. The last two change with the file."""
    image = bpy.data.images.load(path)
    try:
        return min(image.size) > 0
    finally:
        bpy.data.images.remove(image)


def packed_without_pixels(shown: Iterable[bpy.types.Object]) -> list[str]:
    """The names of the packed images that the materials of `shown` use and that Blender cannot decode."""
    used = Uses.now()
    images = [image for image in used.by_materials(used.by(shown)) if image.packed_files]
    return [image.name for image in images if image.source == "FILE" and min(textures.size_of(image)) == 0]


def missing_blocks(objects: Iterable[bpy.types.Object]) -> list[str]:
    """Sentences about datablocks that `objects` use and that are not in the libraries from which they are linked."""
    return [
        f"{block.name!r} is linked from {block.library.filepath!r}, but is not in that file."
        for block in Uses.now().by(objects)
        if block.is_missing and not isinstance(block, bpy.types.Material)
        if os.path.isfile(absolute(block.library.filepath, block.library))
    ]


def used_by(objects: Iterable[bpy.types.Object]) -> list[bpy.types.ID]:
    """`objects` and all datablocks that their meshes are made from."""
    return Uses.now().by(objects)


def paths_of_modifier(modifier: bpy.types.Modifier) -> list[str]:
    """The files that a modifier reads, also those of its nodes, its cache and its volume."""
    owner = modifier.id_data
    paths = [each.path for each in _of_modifier(owner, modifier, is_on=True)]
    blocks = [getattr(modifier, "node_group", None), getattr(modifier, "cache_file", None)]
    if modifier.type == "VOLUME_TO_MESH" and modifier.object:
        blocks.append(modifier.object.data)
    for block in filter(None, blocks):
        paths += [each.path for inner in Uses.now().by([block]) for each in _of_block(inner)]
    return paths


def not_followed(objects: Iterable[bpy.types.Object]) -> list[str]:
    """Clauses about files that `objects` are made from and whose paths are only known while they are evaluated."""
    blocks = Uses.now().by(objects)
    clauses = [
        f"the node {node.name!r} of {tree.name!r} computes the path of its file"
        for tree in blocks
        if isinstance(tree, bpy.types.NodeTree)
        for node in _import_nodes(tree)
        if _paths_of(node.inputs[0]) is None
    ]
    caches = [block for block in blocks if isinstance(block, bpy.types.CacheFile)]
    return [*clauses, *filter(None, (usd_layers.named(absolute(each.filepath, each)).unknown for each in caches))]


class Uses:
    """Which datablocks use which, in the open file."""

    _shared: ClassVar["Uses | None"] = None

    def __init__(self):
        self._uses: dict[bpy.types.ID, list[bpy.types.ID]] = {}
        for block, users in bpy.data.user_map().items():
            for user in users:
                self._uses.setdefault(user, []).append(block)

    @contextmanager
    def shared(self) -> Iterator[None]:
        """Let all functions of this module use this in the block, in which no datablock may come or go that they ask for."""
        Uses._shared = self
        try:
            yield
        finally:
            Uses._shared = None

    @classmethod
    def now(cls) -> "Uses":
        """That of `shared`, or else a new one."""
        return cls._shared or cls()

    def by(self, objects: Iterable[bpy.types.Object]) -> list[bpy.types.ID]:
        """`objects` and all datablocks that they use, also those that these use, except what materials use."""
        return self._walk(objects, lambda block: not isinstance(block, bpy.types.Material))

    def all_of(self, objects: Iterable[bpy.types.Object]) -> list[bpy.types.ID]:
        """`objects` and all datablocks that they use, also those that these and their materials use."""
        return self._walk(objects, lambda _: True)

    def materials_of(self, obj: bpy.types.Object) -> set[bpy.types.ID]:
        """The materials of an object: of its slots, and those that its modifiers set."""
        reached = self._walk(
            [obj], lambda block: block == obj or not isinstance(block, bpy.types.Material | bpy.types.Object)
        )
        return {block for block in reached if isinstance(block, bpy.types.Material)}

    def by_materials(self, blocks: Iterable[bpy.types.ID]) -> list[bpy.types.ID]:
        """The images that the materials among `blocks` use, also in groups of nodes."""
        materials = [block for block in blocks if isinstance(block, bpy.types.Material)]
        inner = bpy.types.Material, bpy.types.NodeTree
        return [
            block
            for block in self._walk(materials, lambda block: isinstance(block, inner))
            if isinstance(block, bpy.types.Image)
        ]

    def _walk(self, starts: Iterable[bpy.types.ID], is_followed: Callable[[bpy.types.ID], bool]) -> list[bpy.types.ID]:
        left, seen = list(starts)[::-1], {}
        while left:
            block = left.pop()
            if block in seen or isinstance(block, _FOREIGN):
                continue
            seen[block] = None
            if is_followed(block):
                left += reversed(self._used_by(block))
        return list(seen)

    def _used_by(self, block: bpy.types.ID) -> list[bpy.types.ID]:
        used = self._uses.get(block, [])
        if not isinstance(block, bpy.types.Object):
            return used
        if block.type == "EMPTY":  # it shows an image, which is no part of a mesh
            return [each for each in used if each != block.data]
        noted = noted_by(block)
        return [each for each in used if each not in noted] if noted else used


def noted_by(obj: bpy.types.Object) -> set[bpy.types.ID]:
    """The high objects, the cage and the maps that Imprint keeps with a low object, if its mesh is not made from them."""
    pair = older_blender.kept_properties(obj).get("imprint")
    if pair is None:
        return set()
    noted = {item.get(name) for name, items in (("object", "highs"), ("image", "maps")) for item in pair.get(items, ())}
    noted.add(pair.get("cage"))
    used = {obj.parent, *(value for part in (*obj.modifiers, *obj.constraints) for value in _pointers_of(part))}
    return noted - used - {None}


def _pointers_of(part: bpy.types.Modifier | bpy.types.Constraint) -> Iterator[bpy.types.ID]:
    """The datablocks that the settings of a modifier or constraint name, with the inputs of its nodes."""
    values = [getattr(part, prop.identifier) for prop in part.bl_rna.properties if prop.type == "POINTER"]
    if isinstance(part, bpy.types.NodesModifier) and part.node_group is not None:
        values += [
            older_blender.modifier_input(part, item.identifier)
            for item in part.node_group.interface.items_tree
            if item.item_type == "SOCKET" and item.in_out == "INPUT"
        ]
    return (value for value in values if isinstance(value, bpy.types.ID))


def files_of(block: bpy.types.ID) -> list[Dependency]:
    """The files that a datablock names itself."""
    return list(_of_block(block))


def _of_block(block: bpy.types.ID, *, for_render: bool = True, is_surface: bool = False) -> Iterator[Dependency]:
    """The files that a datablock names itself and that decide something."""
    if isinstance(block, bpy.types.Object):
        yield from _of_object(block, for_render=for_render)
    elif isinstance(block, bpy.types.Image):
        yield from _of_image(block, is_surface=is_surface)
    elif isinstance(block, bpy.types.ImageTexture) and block.image and block.image.source == "SEQUENCE":
        if frame := _frame_of(block.image_user):
            path = _numbered(block.image.filepath, frame)
            yield from _of_path(block.image, path, f"the image {block.image.name!r}")
    elif isinstance(block, bpy.types.CacheFile):
        title = f"the cache {block.name!r}"
        yield from _of_path(block, block.filepath, title, is_sequence=block.is_sequence)
        named = usd_layers.named(absolute(block.filepath, block))
        yield from (Dependency(path, f"a layer of {title}", is_needed=not named.has_variants) for path in named.layers)
        for layer in block.layers:
            yield from _of_path(block, layer.filepath, f"a layer of {title}", is_needed=not layer.hide_layer)
    elif (title := _PACKABLE.get(type(block))) and not block.packed_file and block.filepath != _BUILT_IN:
        is_sequence = isinstance(block, bpy.types.Volume) and block.is_sequence
        yield from _of_path(block, block.filepath, f"{title} {block.name!r}", is_sequence=is_sequence)
    elif isinstance(block, bpy.types.GeometryNodeTree):
        for node in _import_nodes(block):
            for owner, path in _paths_of(node.inputs[0]) or ():
                yield from _of_path(owner, path, f"the file of the node {node.name!r}")


def _of_object(obj: bpy.types.Object, *, for_render: bool) -> Iterator[Dependency]:
    """The files of an object's modifiers and caches."""
    for modifier in obj.modifiers:
        is_on = modifier.show_render if for_render else modifier.show_viewport
        yield from _of_modifier(obj, modifier, is_on=is_on)
    for system in obj.particle_systems:
        yield from _of_points(obj, system.point_cache)


def _of_modifier(obj: bpy.types.Object, modifier: bpy.types.Modifier, *, is_on: bool) -> Iterator[Dependency]:
    title = f"the file of the modifier {modifier.name!r} of {obj.name!r}"
    if modifier.type == "MESH_CACHE" or (modifier.type == "MULTIRES" and modifier.is_external):
        yield from _of_path(obj, modifier.filepath, title, is_needed=is_on)
    elif modifier.type == "OCEAN" and modifier.is_cached:
        yield from _of_path(obj, modifier.filepath, f"the cache of the ocean of {obj.name!r}", is_needed=is_on)
    elif modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN":
        domain = modifier.domain_settings
        if domain.cache_type != "REPLAY":  # that is simulated while frames change
            title = f"the cache of the fluid of {obj.name!r}"
            yield from _of_path(obj, domain.cache_directory, title, is_needed=is_on)
    elif modifier.type == "NODES":
        folders = [modifier.bake_directory, *(bake.directory for bake in modifier.bakes if bake.use_custom_path)]
        for folder in folders:  # without them, the nodes are evaluated
            yield from _of_path(obj, folder, f"the bakes of the nodes of {obj.name!r}", is_needed=False)
    for cache in _caches_of(modifier):
        yield from _of_points(obj, cache, is_needed=is_on)


def point_caches(obj: bpy.types.Object) -> list[bpy.types.PointCache]:
    """The caches of an object's simulations."""
    of_modifiers = [cache for modifier in obj.modifiers for cache in _caches_of(modifier)]
    return [*of_modifiers, *(system.point_cache for system in obj.particle_systems)]


def _caches_of(modifier: bpy.types.Modifier) -> list[bpy.types.PointCache]:
    """The caches of points of a modifier, except that of particles."""
    if modifier.type in {"CLOTH", "SOFT_BODY"}:
        return [modifier.point_cache]
    if modifier.type == "DYNAMIC_PAINT" and modifier.canvas_settings is not None:
        return [
            each.point_cache for each in modifier.canvas_settings.canvas_surfaces if each.surface_format == "VERTEX"
        ]
    return []


def _of_points(obj: bpy.types.Object, cache: bpy.types.PointCache, *, is_needed: bool = True) -> Iterator[Dependency]:
    """The folder of the files of a simulation's cache, and the file of the frame that is shown."""
    title = f"the cache of a simulation of {obj.name!r}"
    if cache.use_external:
        folder = cache.filepath
    elif cache.use_disk_cache and cache.is_baked:
        stem = os.path.splitext(os.path.basename(obj.library.filepath if obj.library else bpy.data.filepath))[0]
        folder = f"//blendcache_{stem}"
    else:
        return
    for each in _of_path(obj, folder, title, is_needed=False):
        yield each
        yield Dependency(_shown_frame(obj, cache, each.path), title, is_needed=is_needed)


def _shown_frame(obj: bpy.types.Object, cache: bpy.types.PointCache, folder: str) -> str:
    """The file of a simulation's cache for the current frame, or for the last one before it that has a file of its own."""
    frame = min(max(bpy.context.scene.frame_current, cache.frame_start), cache.frame_end)
    frame -= (frame - cache.frame_start) % max(cache.frame_step, 1)
    name = cache.name or os.fsencode(obj.name).hex().upper()
    ends = [f"_{max(cache.index, 0):02}.bphys"] + [".bphys"] * (cache.use_external and cache.index < 0)
    paths = [os.path.join(folder, f"{name}_{frame:06}{end}") for end in ends]
    return next(filter(os.path.isfile, paths), paths[-1])


def _of_image(image: bpy.types.Image, *, is_surface: bool) -> Iterator[Dependency]:
    """The files of an image; none for one that is packed, or without a file."""
    if image.packed_file or not image.filepath or image.source not in {"FILE", "TILED", "SEQUENCE", "MOVIE"}:
        return
    for each in _of_path(image, image.filepath, f"the image {image.name!r}", is_sequence=image.source == "SEQUENCE"):
        is_own = bool(image.get(ORIGIN) or image.get(MARK))
        tiles = tuple(tile.number for tile in image.tiles) if image.source == "TILED" else ()
        is_movie = image.source == "MOVIE"
        yield replace(each, is_surface=is_surface, is_own_map=is_own, tiles=None if is_movie else tiles)


def _of_path(
    owner: bpy.types.ID, path: str, what: str, *, is_needed: bool = True, is_sequence: bool = False
) -> Iterator[Dependency]:
    """The files at a path that a datablock names."""
    if not path:
        return
    path = absolute(path, owner)
    frames = _frames_beside(path) if is_sequence else []
    yield from (Dependency(frame, what, is_needed=False) for frame in frames)
    if not frames:
        yield Dependency(path, what, is_needed=is_needed)


def absolute(path: str, owner: bpy.types.ID) -> str:
    """The absolute path of a path that a datablock names."""
    # The paths of libraries start at the open file, also those of libraries that others link.
    library = None if isinstance(owner, bpy.types.Library) else owner.library
    return os.path.normpath(bpy.path.abspath(path, library=library))


def _frames_beside(path: str) -> list[str]:
    """The files of all frames of a sequence, of which `path` is one."""
    folder, name = os.path.split(path)
    stem, ending = os.path.splitext(name)
    if not _NUMBER.search(stem):
        return []
    before, after = _NUMBER.sub("\0", stem, count=1).split("\0")
    pattern = re.compile(rf"{re.escape(before)}\d+{re.escape(after + ending)}")
    try:
        return sorted(os.path.join(folder, each) for each in os.listdir(folder) if pattern.fullmatch(each))
    except OSError:
        return []


def _frame_of(user: bpy.types.ImageUser) -> int | None:
    """The number of the file of a sequence that is shown now; None before its start, and if it is not known."""
    frame = bpy.context.scene.frame_current - user.frame_start + 1
    if not user.use_auto_refresh or not user.frame_duration or (frame < 1 and not user.use_cyclic):
        return None
    if user.use_cyclic:
        frame = (frame - 1) % user.frame_duration + 1
    return min(frame, user.frame_duration) + user.frame_offset


def _numbered(path: str, frame: int) -> str:
    """`path` with the number of another frame."""
    stem, ending = os.path.splitext(path)
    return _NUMBER.sub(lambda digits: f"{frame:0{len(digits[0])}}", stem, count=1) + ending


def _libraries(blocks: Iterable[bpy.types.ID]) -> Iterator[Dependency]:
    """The libraries of the open file. Those that `blocks` come from are needed."""
    needed = {block.library for block in blocks}
    for library in bpy.data.libraries:
        if library.packed_file or getattr(library, "is_archive", False):  # it has no file of its own
            continue
        yield Dependency(absolute(library.filepath, library), "a linked library", is_needed=library in needed)


def _others(blocks: Sequence[bpy.types.ID]) -> list[Dependency]:
    """Files of datablocks as Blender lists them, for what this module does not know."""
    others, wanted = [], {block for block in blocks if not isinstance(block, bpy.types.Image)}

    def visit(owner: bpy.types.ID, path: str, _about: object) -> None:
        if owner in wanted and path and path != _BUILT_IN:
            others.append(Dependency(absolute(path, owner), f"a file of {owner.name!r}", is_needed=False))

    older_blender.visit_file_paths(visit)
    return others


def _import_nodes(tree: bpy.types.NodeTree) -> Iterator[bpy.types.Node]:
    """The nodes of a tree that read files."""
    return (node for node in tree.nodes if node.bl_idname.startswith(IMPORT_NODES) and not node.mute)


def _paths_of(socket: bpy.types.NodeSocket) -> list[tuple[bpy.types.ID, str]] | None:
    """The paths that a socket of an import node can have, with the datablocks that name them; None if nodes compute them."""
    tree, at = socket.id_data, socket
    while at.is_linked:
        link = at.links[0]
        node, source = link.from_node, link.from_socket
        if node.type == "REROUTE":
            at = node.inputs[0]
        elif node.bl_idname == "FunctionNodeInputString":
            return [(tree, node.string)]
        elif node.type == "GROUP_INPUT":
            return _given(tree, source.identifier)
        else:
            return None
    return [(tree, at.default_value)]


def _given(tree: bpy.types.NodeTree, identifier: str) -> list[tuple[bpy.types.ID, str]] | None:
    """The texts that the users of a group of nodes give to an input; None if nodes compute one."""
    given: list[tuple[bpy.types.ID, str]] = []
    for other in bpy.data.node_groups:
        for node in other.nodes if isinstance(other, bpy.types.GeometryNodeTree) else ():
            if node.type == "GROUP" and node.node_tree == tree:
                socket = next((each for each in node.inputs if each.identifier == identifier), None)
                paths = _paths_of(socket) if socket is not None else []
                if paths is None:
                    return None
                given += paths
    for obj in bpy.data.objects:
        for modifier in obj.modifiers:
            if modifier.type == "NODES" and modifier.node_group == tree:
                given.append((obj, str(older_blender.modifier_input(modifier, identifier) or "")))
    return [each for each in given if each[1]]
