# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake of some low objects keeps of a map that others share: who these are, and whether their texels can stay.

The texels of a low object, with its margin, stay to the bit while another one is baked into the same image or file. Where they
could not, the bake is refused before it starts.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from ..core import udim
from ..core.declarations.choices import Space, Storage
from ..core.errors import BakeError
from ..core.map_types import BY_NAME, Kind
from ..core.settings import SamplingSettings, Settings
from ..engine import coverage
from ..mesh import uv_layout
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..output import datablocks, map_names, shared_maps, value_encoding
from ..output.shared_maps import Part
from ..scene import evaluation, object_checks, reading
from ..scene.high_materials import MaterialSet, restricted, sets_of
from . import map_contents
from .job import Job, users_of_image


@dataclass(frozen=True)
class Kept:
    """The parts of each map that are not baked, by the map's name.

    Attributes:
        tiles: Of each map, in which their texels were found.
        lows: Their low meshes with UVs.
    """

    parts: dict[str, list[Part]] = field(default_factory=dict)
    tiles: dict[str, list[int]] = field(default_factory=dict)
    lows: dict[Part, Mesh] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.lows)

    @property
    def meshes(self) -> list[Mesh]:
        """Each of `lows` once."""
        return list({id(low): low for low in self.lows.values()}.values())

    def covered(self, tile: int, sampling: SamplingSettings) -> np.ndarray:
        """The texels (height, width) bool of a tile that they have, by the samples with which they were baked."""
        is_covered = np.zeros(sampling.size[::-1], bool)
        for samples in {part.samples for part in self.lows}:
            lows = [low for part, low in self.lows.items() if part.samples == samples]
            is_covered |= coverage.covered(lows, tile, replace(sampling, samples=samples or sampling.samples))
        return is_covered


def kept(context: bpy.types.Context, jobs: Sequence[Job], settings: Settings, *, is_shared: bool = False) -> Kept:
    """What the bake of these jobs into the same maps keeps. Raises BakeError if it would lose texels of others.

    settings: with names filled in. is_shared: whether the low objects share the maps on purpose, also those without a record,
    of earlier versions.
    """
    search, parts, tiles = _Search(context, jobs, settings), {}, {}
    for name, of_map in map_names.settings_by_map(settings).items():
        others = list(search.others(of_map, is_shared=is_shared))
        shared_maps.check_room(map_names.output_for(of_map), len(jobs) + len(others))
        if others:
            parts[name] = others
            tiles[name] = _check(name, of_map, others, [search.found[part] for part in others], search)
    return Kept(parts, tiles, {part: search.found[part] for others in parts.values() for part in others})


def lost(context: bpy.types.Context, jobs: Sequence[Job], others: Sequence[Job], settings: Settings) -> list[Job]:
    """The `others` of which some map would have no texels, or other ones than a bake of all, if `jobs` alone are baked into the
    maps that they share. settings: as for `kept`. Raises BakeError as `kept`."""
    by_map = map_names.settings_by_map(settings)
    if any(_problem(name, of_map) for name, of_map in by_map.items()):
        return [*others]

    def are_in(job: Job, parts: dict[str, list[Part]]) -> bool:
        own = (job.low.name, job.material), (job.low.name, "")
        return all(any((part.name, part.material) in own for part in parts.get(name, ())) for name in by_map)

    noted = {
        name: shared_maps.joined(shared_maps.parts_of_files(of_map), shared_maps.parts_of_image(of_map.storing.image))
        for name, of_map in by_map.items()
    }
    unknown = [job for job in others if not are_in(job, noted)]
    found = kept(context, jobs, settings, is_shared=True).parts if unknown else {}  # also of objects that were renamed
    return [job for job in unknown if not are_in(job, found)]


def check_alone(context: bpy.types.Context, job: Job, settings: Settings, what: str) -> None:
    """Raise BakeError if others are in the maps of a job that writes all of them. what: that job, in a sentence."""
    search = _Search(context, [job], settings)
    for of_map in map_names.settings_by_map(settings).values():
        others = list(search.others(of_map, is_shared=False))
        if others:
            raise BakeError(
                f"{_place(of_map)} also has the map of {shared_maps.listed(others)}, which {what} would replace: choose "
                "another name."
            )


def part_of(meshes: Meshes, material: str = "", samples: int = 1) -> Part:
    """The part of a low mesh that is baked. material: the name of that of its faces; empty for all of them."""
    return Part.of(
        meshes.low.name,
        meshes.uv_layer,
        _uvs(meshes.low, material),
        is_own_base=meshes.is_own_base,
        material=material,
        samples=samples if samples > 1 else 0,
    )


def _uvs(low: Mesh, material: str) -> np.ndarray:
    """The UVs of a low mesh, or of its faces with a material, of which the mesh has no others then."""
    return low.uv[np.unique(low.triangles)] if material else low.uv


Faces = tuple[bpy.types.Object, MaterialSet | None]
"""A low object, and which of its faces are in a map; None for all."""


class _Search:
    """Looks for the low objects of parts in the open file. found: their meshes."""

    def __init__(self, context: bpy.types.Context, jobs: Sequence[Job], settings: Settings):
        self.context, self.jobs, self.settings = context, jobs, settings
        self.lows = [job.low for job in jobs]
        self.found: dict[Part, Mesh] = {}
        self._own: list[tuple[Part, Mesh]] | None = None
        self._known: dict[tuple[int, str, bool, MaterialSet | None], tuple[Part, Mesh]] = {}
        self._by_name: dict[str, list[bpy.types.Object]] = {}

    def others(self, of_map: Settings, *, is_shared: bool) -> Iterator[Part]:
        """The parts of a map that are not baked, as they are in this file. Raises BakeError for one that is not in it."""
        name = of_map.storing.image
        in_image, in_files = shared_maps.parts_of_image(name), shared_maps.parts_of_files(of_map)
        parts = shared_maps.joined(in_files, in_image)
        written = Counter((job.low.name, job.material) for job in self.jobs)
        if parts and not Counter((part.name, part.material) for part in parts) - written:
            return
        users, kept, lost = list(users_of_image(name)), [], []
        for part in parts:
            is_sure = any(part.is_same(known) for known in in_image)
            faces = self._find(part, parts, users, is_sure=is_sure)
            if faces is not None and faces not in kept:
                kept.append(faces)
                if not self._is_baked(*faces):
                    yield self._kept(*faces, of_map, part)
            elif faces is None and part in in_files and not (is_sure and self._was_deleted(part, of_map)):
                why = "whose UVs are others in this file" if self._objects(part.name) else "which is not in this file"
                raise BakeError(
                    f"{_place(of_map)} also has the map of {shared_maps.listed([part])}, {why}, and "
                    "would lose it: choose another name for the map, or delete that file first."
                )
            elif faces is None:
                lost.append(part)
        if lost or (is_shared and not parts):  # what was noted may have another name and other UVs now
            known = [obj for obj, _ in kept]
            for faces in ((obj, self._texture_set(obj)) for obj in users if obj not in known):
                if not self._is_baked(*faces):
                    yield self._kept(*faces, of_map, Part("", "", False, 0))

    def baked(self) -> list[tuple[Part, Mesh]]:
        """The low objects that are baked."""
        if self._own is None:
            layer = self.settings.map.uv_layer
            self._own = [self._part(job.low, layer, job.low in job.highs, job.texture_set) for job in self.jobs]
        return self._own

    def _is_baked(self, obj: bpy.types.Object, faces: MaterialSet | None) -> bool:
        """Whether these faces of an object are baked, or there are none."""
        own = [job for job in self.jobs if job.low == obj]
        if any(job.texture_set is None for job in own) or (faces is not None and not faces.slots):
            return True
        names = {faces.name} if faces is not None else _materials(obj, own)
        return bool(names) and names <= {job.material for job in own}

    def _texture_set(self, obj: bpy.types.Object) -> MaterialSet | None:
        """The faces of an object that the map may have, of which nothing is noted: those with the material that is baked."""
        material = self.jobs[0].material
        sets = sets_of(obj, is_own_base=False) if material else []
        return next((one for one in sets if one.name == material), MaterialSet(material, ()) if material else None)

    def _find(
        self, part: Part, parts: Sequence[Part], users: Sequence[bpy.types.Object], *, is_sure: bool
    ) -> Faces | None:
        """The faces of a part: of the object of its name, or of one with its UVs that was renamed. None if they are not there.

        parts: of the same map; one whose UVs the object has is that one, if names were swapped. is_sure: whether it is the part
        with other UVs, too.
        """
        named = self._objects(part.name)
        edited = None
        for obj in named:
            for faces in _candidates(obj, part):
                layouts = self._layouts(obj, part, faces)
                if part.layout in layouts:
                    return obj, faces
                is_meant = faces is None or faces.name == part.material
                if edited is None and is_meant and all(other.layout not in layouts for other in parts):
                    edited = obj, faces
        if edited is not None and (is_sure or self._is_baked(*edited)):
            return edited
        for obj in (*users, *self.lows):
            for faces in _candidates(obj, part):
                if part.layout in self._layouts(obj, part, faces):
                    return obj, faces
        is_worn_no_more = is_sure and bool(named) and part.material and edited is None
        return (named[0], MaterialSet(part.material, ())) if is_worn_no_more else None

    def _was_deleted(self, part: Part, of_map: Settings) -> bool:
        """Whether a part that the image knows is gone from this .blend, which has written the file last: it may be in no other
        one then. Those of a library that cannot be read are not gone."""
        image = datablocks.get(of_map.storing.image)
        is_own = shared_maps.is_at_home(image) and map_contents.is_as_written(image)
        if not is_own or any(obj.is_missing and obj.name == part.name for obj in bpy.data.objects):
            return False
        tiles = udim.files(bpy.path.abspath(map_names.output_for(of_map))) if of_map.sampling.udim else [udim.FIRST]
        return not any(shared_maps.is_elsewhere(of_map, tile) for tile in tiles)

    def _objects(self, name: str) -> list[bpy.types.Object]:
        """The meshes of a name: those of libraries may have the same."""
        if not self._by_name:
            for obj in bpy.data.objects:
                if obj.type == "MESH" and not object_checks.is_deleted(obj):
                    self._by_name.setdefault(obj.name, []).append(obj)
        return self._by_name.get(name, []) if name else []

    def _layouts(self, obj: bpy.types.Object, part: Part, faces: MaterialSet | None) -> tuple[int, ...]:
        """The checksums of the UVs of faces, also the former one; none without UVs."""
        try:
            own, mesh = self._read(obj, part.uv_layer, part.is_own_base, faces)
        except BakeError:
            return ()
        return own.layout, shared_maps.former_checksum(_uvs(mesh, own.material))

    def _kept(self, obj: bpy.types.Object, faces: MaterialSet | None, of_map: Settings, noted: Part) -> Part:
        """The part of an object that is not baked, as it is now, whose mesh is noted. Raises BakeError if it has no UVs any
        more."""
        try:
            part, mesh = self._read(obj, noted.uv_layer, noted.is_own_base, faces)
        except BakeError as error:
            raise BakeError(
                f"{_place(of_map)} also has the map of {obj.name!r}, whose texels cannot be told "
                f"({str(error).removesuffix('.')}): mend or delete that object, or choose another name for the map."
            ) from error
        part = replace(part, samples=noted.samples)
        self.found[part] = mesh
        return part

    def _read(
        self, obj: bpy.types.Object, uv_layer: str, is_own_base: bool, faces: MaterialSet | None
    ) -> tuple[Part, Mesh]:
        """An object as a part with that UV map, or with another one if it has that no more."""
        key = obj.session_uid, uv_layer, is_own_base, faces
        if key not in self._known:
            try:
                self._known[key] = self._part(obj, uv_layer, is_own_base, faces)
            except BakeError:
                self._known[key] = self._part(obj, "", False, faces)
        return self._known[key]

    def _part(
        self, obj: bpy.types.Object, uv_layer: str, is_own_base: bool, faces: MaterialSet | None
    ) -> tuple[Part, Mesh]:
        settings = self.settings.mapped(uv_layer=uv_layer, space=Space.OBJECT, texture_sets=faces is not None)
        meshes = evaluation.evaluate(
            self.context,
            [obj],
            lambda depsgraph: reading.read_low(depsgraph, obj, None, settings, is_own_base=is_own_base),
            modifiers=settings.map.modifiers,
        )
        if faces is not None:
            meshes = restricted(meshes, faces)
        return part_of(meshes, faces.name if faces is not None else ""), meshes.low


def _candidates(obj: bpy.types.Object, part: Part) -> list[MaterialSet | None]:
    """The faces of an object that may be a part, those of the same material first."""
    whole: list[MaterialSet | None] = [None] if not part.material else []
    if part.name and not part.material:
        return whole
    sets = sets_of(obj, is_own_base=part.is_own_base)
    return whole + sorted(sets, key=lambda one: one.name != part.material)


def _materials(obj: bpy.types.Object, jobs: Sequence[Job]) -> set[str]:
    """The materials of a low object of jobs; none without a job."""
    return {one.name for job in jobs[:1] for one in sets_of(obj, is_own_base=job.low in job.highs)}


def _place(of_map: Settings) -> str:
    output = map_names.output_for(of_map)
    return f"The file {output!r}" if output else f"The image {of_map.storing.image!r}"


def _check(name: str, of_map: Settings, parts: Sequence[Part], lows: Sequence[Mesh], search: _Search) -> list[int]:
    """The tiles in which texels of `parts` are stored. Raises BakeError if they cannot stay in a map."""
    whose = shared_maps.listed(parts)
    reason = _problem(name, of_map)
    if reason:
        raise BakeError(f"{_place(of_map)} also has the map of {whose}, which would change: {reason}")
    tiles = _tiles(of_map, lows)
    _check_place(of_map, parts, tiles, search)
    wanted = shared_maps.wanted(of_map)
    stored = {tile: one for tile in tiles if (one := shared_maps.stored(of_map, tile)) is not None}
    for one in stored.values():
        if one.format != wanted:
            raise BakeError(
                f"{one.where} also has the map of {whose}, as {one.format}, and this bake would make it {wanted}: bake "
                "all of them together, or with the same settings as before."
            )
    return list(stored)


def _tiles(of_map: Settings, lows: Iterable[Mesh]) -> list[int]:
    return sorted({tile for low in lows for tile in uv_layout.tiles(low)}) if of_map.sampling.udim else [udim.FIRST]


def _check_place(of_map: Settings, parts: Sequence[Part], tiles: Sequence[int], search: _Search) -> None:
    """Raise BakeError if the image has texels of `parts` that this bake would replace, and not find to keep them. tiles: of the
    parts. Other tiles than those that are baked stay, or are copied to the new place."""
    image = datablocks.get(of_map.storing.image)
    if image is not None and shared_maps.parts_of_files(of_map):  # the others are only in the files
        in_image = shared_maps.parts_of_image(image.name)
        parts = [part for part in parts if any(part.is_same(known) for known in in_image)]
    if image is None or not parts:
        return
    where, whose = _place(of_map), shared_maps.listed(parts)
    lost = [tile for tile in tiles if shared_maps.is_elsewhere(of_map, tile)]
    if lost and not shared_maps.is_other_kind(of_map):
        lost = set(lost).intersection(_tiles(of_map, (low for _, low in search.baked())))
    if lost and of_map.storing.storage == Storage.FILE:
        raise BakeError(
            f"The map of {whose} in the image {image.name!r} is not in {_lower(where)}: bake all of them together."
        )
    if lost:
        raise BakeError(f"{where} has the map of {whose} in another way than this bake: bake all of them together.")
    if of_map.storing.storage == Storage.FILE and image.is_dirty:
        raise BakeError(f"The image {image.name!r} has unsaved changes, also on {whose}: save it first.")


def _lower(where: str) -> str:
    return where[0].lower() + where[1:]


def _problem(name: str, of_map: Settings) -> str:
    """Why texels of a map do not stay true beside new ones, and what to do, in a clause; empty if they do."""
    if of_map.storing.is_auto:
        return "its format is chosen for all texels. Bake all of them together, or with a fixed format."
    if of_map.storing.is_lossy:
        return "its format changes texels a little each time. Bake all of them together, or into a PNG file."
    if len(map_names.levels_of(of_map, name)):
        return "its mip levels mix all objects. Bake all of them together, or without mip files."
    packing = of_map.map.packing
    own = packing.maps if packing is not None and name == packing.map_type.name else [name]
    types = [BY_NAME[each] for each in own if each in BY_NAME]
    if any(each.kind is Kind.LABEL for each in types):
        return "its colors are numbered over all objects. Bake all of them together."
    is_fixed = of_map.storing.value_range is not None
    if any(value_encoding.needs_range(each, of_map.storing) and (each.is_color or not is_fixed) for each in types):
        return (
            "its values are scaled by the largest of all objects. Bake all of them together, into a file of floats, or with a "
            "fixed range."
        )
    return ""
