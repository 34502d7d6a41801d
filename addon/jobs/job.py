# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects of one bake: references to them, their match by name, and checks before any mesh is read: whether they can be
baked, whether their maps can be stored, and whether two maps would be written to one place.
"""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import gpu
import numpy as np

from .. import older_blender
from ..core import naming, udim
from ..core.declarations.choices import Method, Storage, VertexDomain
from ..core.errors import BakeError, NoGpu
from ..core.naming import MATERIAL, Suffixes, match, role
from ..core.progress import Progress
from ..core.report import Report
from ..core.settings import SamplingSettings, Settings, StorageSettings, TracingSettings
from ..engine.bands import bands
from ..mesh.closing import Closing
from ..mesh.inputs import Meshes
from ..output import datablocks, materials, outputs, vertex_attributes
from ..output.map_names import map_title, planned_files, settings_by_map
from ..output.path_clashes import Places
from ..passes.shader import is_software
from ..scene import dependencies, object_checks, reading
from ..scene.high_materials import MaterialSet, sets_of
from ..scene.object_checks import ObjectRef
from . import one_material


@dataclass(frozen=True, init=False)
class Job:
    """The objects of one bake, and what is set for them alone. They may be renamed, or be deleted and come back with Undo.

    `low`, `highs` and `cage` are the objects, and raise BakeError if one was deleted. `highs` may be [low]: then the low
    object's modifiers are baked onto its own base mesh. `cage` has the topology of `low`, and rays start on it.
    """

    low_ref: ObjectRef
    high_refs: tuple[ObjectRef, ...]
    cage_ref: ObjectRef | None
    texture_set: MaterialSet | None
    """The faces of the low object that are baked; None for all."""
    size: int
    """Of its square maps in texels; 0 for that of the settings."""
    distance: float
    """How far its rays reach outward and inward, in scene units; 0 for that of the settings."""
    tracing: TracingSettings | None
    """Whose method, extrusion and distance its own pair has; None for those of the settings."""
    sizes: tuple[tuple[str, int], ...]
    """Names of materials whose texture sets have a size of their own, and that size."""
    floaters: frozenset[int]
    """The session_uids of objects that block no rays of ambient occlusion, beside those that are marked."""
    closing: Closing | None
    """What closes holes of the high objects, which the low object does not have; None for nothing."""

    def __init__(
        self,
        low: bpy.types.Object,
        highs: Sequence[bpy.types.Object],
        cage: bpy.types.Object | None = None,
        *,
        texture_set: MaterialSet | None = None,
        size: int = 0,
        distance: float = 0.0,
        tracing: TracingSettings | None = None,
        sizes: Sequence[tuple[str, int]] = (),
        floaters: Iterable[int] = (),
        closing: Closing | None = None,
    ):
        vars(self).update(  # a frozen class has no other way
            low_ref=ObjectRef.of(low),
            high_refs=tuple(map(ObjectRef.of, highs)),
            cage_ref=ObjectRef.of(cage) if cage else None,
            texture_set=texture_set,
            size=size,
            distance=distance,
            tracing=tracing,
            sizes=tuple(sizes),
            floaters=frozenset(floaters),
            closing=closing,
        )

    def but(self, **own: Any) -> "Job":
        """This job with other arguments of its constructor. Raises BakeError if an object was deleted."""
        same = ("low", "highs", "cage", "texture_set", "size", "distance", "tracing", "sizes", "floaters", "closing")
        return Job(**{name: getattr(self, name) for name in same if name not in own} | own)

    @property
    def refs(self) -> list[ObjectRef]:
        """References to the low object, the high ones and the cage, if there is one."""
        return [self.low_ref, *self.high_refs, *([self.cage_ref] if self.cage_ref else [])]

    @property
    def low(self) -> bpy.types.Object:
        return self.low_ref.resolve()

    @property
    def title(self) -> str:
        """The low object in a message, with the texture set."""
        return f"{self.low.name}, {self.material}" if self.material else self.low.name

    @property
    def material(self) -> str:
        """The name of the texture set's material; empty for all faces."""
        return self.texture_set.name if self.texture_set else ""

    @property
    def slots(self) -> tuple[int, ...] | None:
        """The material slots of the texture set; None for all faces."""
        return self.texture_set.slots if self.texture_set else None

    @property
    def highs(self) -> list[bpy.types.Object]:
        return [ref.resolve() for ref in self.high_refs]

    @property
    def found_highs(self) -> list[bpy.types.Object]:
        """The high objects that still exist."""
        return [high for ref in self.high_refs if (high := ref.find()) is not None]

    @property
    def cage(self) -> bpy.types.Object | None:
        return self.cage_ref.resolve() if self.cage_ref else None

    def check_low(self, step: Progress) -> Progress:
        """`step` of the bake. Raises BakeError if the low object was deleted: nothing could get the maps."""
        self.low_ref.check_kept()
        return step


@dataclass(frozen=True)
class Wants:
    """What is wanted of a bake besides its maps."""

    exported: bool = False
    """Whether Imprint writes the low mesh for an engine afterwards."""
    for_others: bool = False
    """Whether programs other than Blender read the normal map."""
    measured: bool = False
    """Whether the report says how far the low mesh with its map deviates from the high mesh."""
    seen: bool = False
    """Whether the shading error is measured, also if the settings do not ask for it."""
    pictured: bool = False
    """Whether the report has a picture."""
    whole: bool = False
    """Whether it is an error if objects lack files, or what their modifiers need."""
    hints: tuple[str, ...] = ()
    """Why low and high meshes may not fit, in sentences. The report has them if rays are cast."""


NOTHING_ELSE = Wants()
"""The maps alone."""


@dataclass(frozen=True)
class Request:
    """One bake as it was asked for."""

    job: Job
    settings: Settings
    """With names filled in."""
    wants: Wants = NOTHING_ELSE
    other_refs: tuple[ObjectRef, ...] = ()
    """Other objects that are occluders."""
    unnamed: Settings | None = None
    """The settings before names were filled in; None for `settings`."""
    is_shared: bool = False
    """Whether low objects share the images."""

    @property
    def asked(self) -> Settings:
        """The settings before names were filled in, which do not change if an object is renamed."""
        return self.unnamed or self.settings


def jobs_by_name(context: bpy.types.Context, suffixes: Suffixes) -> tuple[list[Job], list[str]]:
    """The jobs of the view layer's objects that match by name, and sentences about objects without a match.

    Raises BakeError if there is no job.
    """
    objects = object_checks.by_name(context.view_layer.objects)
    # What is called as a low object without its suffix, and shows nothing, is its parent or its rig, and no high object. Nor
    # are paths, whatever their names.
    named = (
        name
        for name, obj in objects.items()
        if (object_checks.may_show(obj) or role(name, suffixes)) and not object_checks.is_line(obj)
    )
    pairs, problems = match(named, suffixes)
    if not pairs:
        raise BakeError(" ".join(problems) or f"No object has a name that ends in {suffixes.low!r}.")
    jobs = [
        Job(objects[pair.low], [objects[name] for name in pair.highs], objects[pair.cage] if pair.cage else None)
        for pair in pairs
    ]
    return jobs, problems


def check_job(context: bpy.types.Context, job: Job, settings: Settings) -> None:
    """Raise BakeError for problems that show before any mesh is read."""
    # A script may link or move objects and bake without a redraw: view layers and matrices are old until this update.
    context.view_layer.update()
    reason = object_checks.problem(context, job.low, job.highs, job.cage, settings.tracing.method)
    reason = reason or covers_detail(
        job.low, job.highs, [one.storing.image for one in settings_by_map(settings).values()]
    )
    if reason:
        raise BakeError(reason)
    check_outputs(job.low, settings)


def covers_detail(low: bpy.types.Object, highs: Sequence[bpy.types.Object], images: Iterable[str]) -> str:
    """Why a bake of `low` onto itself may not fill these images, in a sentence: one holds a map of high objects, which were
    not selected, or a material shows one that Imprint did not bake. Empty if it may."""
    if not object_checks.shows_own_surface(low, highs):
        return ""
    textures = object_checks.textures_of(low)
    for name in images:
        if name in textures and not datablocks.is_map(name):
            return (
                f"The material {textures[name].name!r} of {low.name!r} shows the image {name!r}, which this bake would fill: "
                "choose another name for the image."
            )
        before = outputs.replaced(name, [low.name]) if object_checks.is_itself(low, highs) else ""
        if datablocks.is_of_itself(name):  # the mesh may have been renamed since
            continue
        users = list(users_of_image(name)) if before else []  # it goes through all objects
        if before and (low in users or not users):  # a map of others stays, see shared_image
            return (
                f"The image {name!r} holds a map of {before}, and {low.name!r} would be baked onto itself: select {before} as "
                "well, or choose another name for the image."
            )
    return ""


def users_of_image(name: str) -> Iterator[bpy.types.Object]:
    """The low objects for which the image of this name was baked."""
    image = datablocks.get(name)
    for obj in bpy.data.objects if image is not None else ():
        is_known = obj.type == "MESH" and hasattr(obj, "imprint") and obj.is_property_set("imprint")
        if is_known and any(item.image == image for item in obj.imprint.maps) and not object_checks.is_deleted(obj):
            yield obj


def check_gpu() -> None:
    """Start the GPU, if it does not run yet. Raises NoGpu."""
    try:
        older_blender.start_gpu()
    except (SystemError, RuntimeError) as error:
        raise NoGpu(f"There is no GPU to bake on: {error}.") from error


def check_materials(low: bpy.types.Object, settings: Settings) -> None:
    """Raise BakeError if maps that go into the materials of `low` cannot."""
    if settings.storing.one_material:
        one_material.check(low, single_user=settings.storing.single_user)
    elif settings.changes_materials:
        materials.check(low, can_be_off=not settings.storing.connect_maps)


def check_outputs(low: bpy.types.Object, settings: Settings) -> None:
    """Raise BakeError if the maps cannot be stored or drawn."""
    for image_settings in settings_by_map(settings).values():
        outputs.check_storage(low.name, image_settings)
    check_materials(low, settings)
    if settings.storing.vertex_domain != VertexDomain.NONE:
        vertex_attributes.check(low)
    check_gpu()
    limit, (width, height) = gpu.capabilities.max_texture_size_get(), settings.sampling.size
    if max(width, _tallest_band(settings.sampling)) > limit:
        raise BakeError(
            f"A map of {width} x {height} texels does not fit this GPU, whose textures have at most {limit} a side."
        )


def band_texels(sampling: SamplingSettings, texel_bytes: int) -> int:
    """The most texels of a map that are drawn at once. texel_bytes: as core.preflight.texel_bytes returns them."""
    return sampling.width * _tallest_band(sampling, texel_bytes)


def draws_in_software() -> bool:
    """Whether the GPU, which is started, is a program on the CPU."""
    return is_software(gpu.platform.renderer_get())


def uses_vulkan() -> bool:
    """Whether Blender draws with Vulkan; False if no GPU has started."""
    try:
        return gpu.platform.backend_type_get() == "VULKAN"
    except SystemError:
        return False


def _tallest_band(sampling: SamplingSettings, texel_bytes: int = 1) -> int:
    return max(band.height for band in bands(*sampling.size, sampling.margin, texel_bytes=texel_bytes))


def files_read_by(jobs: Sequence[Job], *, has_maps: bool = True) -> list[tuple[str, str]]:
    """The files that the bakes of these jobs read and no map may replace: absolute paths, and titles for messages.

    has_maps: whether maps of earlier bakes are among them.
    """
    bakes = [(job.low, job.highs, list(filter(None, [job.cage]))) for job in jobs]
    files = (each for each in dependencies.not_to_replace(bakes) if has_maps or not each.is_own_map)
    return [(path, each.what) for each in files for path in _files(each.path)]


def _files(path: str) -> Iterable[str]:
    """The files behind the path of a dependency, which may be a folder, or have a placeholder for tiles."""
    if os.path.isdir(path):
        return [os.path.join(folder, name) for folder, _, names in os.walk(path) for name in names]
    return [path] if udim.TOKEN in path or not udim.is_tiled(path) else udim.files(path).values()


def files_kept(jobs: Sequence[Job], storing: StorageSettings) -> list[tuple[str, str]]:
    """As `files_read_by`, if the settings write files."""
    return files_read_by(jobs) if storing.storage == Storage.FILE else []


@dataclass(frozen=True)
class PastBake:
    """A finished bake."""

    job: Job
    settings: Settings
    """By the method that it took: AUTO if Flatten left texels to rays."""
    distances: dict[str, float]
    """Of its rays, in scene units; empty without rays."""
    tiles: list[int]

    @classmethod
    def of(cls, report: Report) -> "PastBake":
        """The bake of a report, also of one from a file. Raises BakeError if one of its objects was deleted."""
        names = [report.low, *report.high, *([report.cage] if report.cage else [])]
        refs = report.refs or [ObjectRef(0, name) for name in names]
        low, *others = (ref.resolve() for ref in refs)
        highs, cages = others[: len(report.high)], others[len(report.high) :]
        texture_set = MaterialSet(report.material, tuple(report.slots)) if report.slots else None
        job = Job(low, highs, *cages, texture_set=texture_set)
        settings = Settings.of_json(report.settings).traced(method=Method.AUTO if report.rays else report.method)
        return cls(job, settings, report.distances, report.tiles)


def read_meshes(context: bpy.types.Context, request: Request) -> Meshes:
    """Read the objects of a bake. Errors: as scene.reading.read."""
    job = request.job
    return reading.read(
        context,
        job.low,
        job.highs,
        job.cage,
        request.settings,
        others=[ref.resolve() for ref in request.other_refs],
        texture_set=job.texture_set,
        floaters=job.floaters,
        must_be_whole=request.wants.whole,
    )


def closed(meshes: Meshes, job: Job) -> Meshes:
    """The meshes of a job, with what closes the holes of its high ones."""
    return meshes if job.closing is None else job.closing.added_to(meshes)


def by_material(jobs: Sequence[Job], storing: StorageSettings, *, shares: bool = False) -> list[Job]:
    """A job for each texture set of each of `jobs`, of the size that its material has. Raises BakeError for names that the sets
    would share. shares: whether all that have one material share its texture, of the largest size that one of them has."""
    split = [
        job.but(texture_set=one, size=dict(job.sizes).get(one.name, 0) or (0 if shares else job.size))
        for job in jobs
        for one in sets_of(job.low, is_own_base=job.low in job.highs)
    ]
    materials = {job.material for job in split}
    if len(materials) > 1 if shares else len(split) > len(jobs):
        for text, what in ((storing.output, "file"), (storing.image, "image")):
            if text and MATERIAL not in text and not (shares and naming.has_low(text)):
                raise BakeError(f"Texture sets need {MATERIAL} in the name of the {what}: {text!r} has none.")
    if not shares:
        return split
    largest = {name: max(job.size for job in split if job.material == name) for name in materials}
    return [job.but(size=largest[job.material]) for job in split]


def set_numbers(low: bpy.types.Object, meshes: Meshes) -> np.ndarray | None:
    """The number (T,) int of the texture set of each triangle of the low mesh, as it was read; None if there is only one, or if
    they were not read, as for maps without tangents."""
    sets = sets_of(low, is_own_base=meshes.is_own_base)
    if len(sets) < 2 or meshes.basis is None or len(meshes.basis.triangles) != len(meshes.low.triangles):
        return None
    of_slot = np.zeros(1 + max(slot for one in sets for slot in one.slots), np.int64)
    for number, one in enumerate(sets):
        of_slot[list(one.slots)] = number
    return of_slot[meshes.basis.labels[:, 0].astype(np.int64).clip(0, len(of_slot) - 1)]


def check_clashes(
    storing: StorageSettings, bakes: Sequence[Settings], objects: Sequence[str], read: Iterable[tuple[str, str]]
) -> None:
    """Raise BakeError if two maps would be written to one image or file, or if a map would replace a file that is read.

    bakes: the settings of each bake, which are `storing` with names filled in. objects: the name of its low object, or of
    another subject for messages. read: the files that the bakes read beside those of datablocks.sources, and what they are.
    """
    _check_images(bakes, objects, _advice(storing.image))
    check_file_clashes(bakes, objects, _advice(storing.output), read)


def check_file_clashes(
    bakes: Sequence[Settings], objects: Sequence[str], advice: str, read: Iterable[tuple[str, str]]
) -> None:
    """Raise WrongPlace if two files would be the same, or if a file is one that the scene uses.

    bakes, objects, read: see `check_clashes`. advice: for two files that would be the same, the end of the message.
    """
    places = Places(advice)
    for path, source in (*datablocks.sources(), *read):
        places.read(path, source)
    for settings, low in zip(bakes, objects, strict=True):
        for path, title in planned_files(settings):
            places.write(bpy.path.abspath(path), f"{title} of {low!r}")


def _check_images(bakes: Sequence[Settings], objects: Sequence[str], advice: str) -> None:
    """Raise BakeError if two maps would fill one image. See `check_clashes`."""
    owners: dict[str, str] = {}
    for settings, low in zip(bakes, objects, strict=True):
        for name, of_map in settings_by_map(settings).items():
            owner = f"{map_title(settings.map, name)} of {low!r}"
            other = owners.setdefault(of_map.storing.image.casefold(), owner)
            if other != owner:
                raise BakeError(
                    f"T{owner[1:]} and {other} would both fill the image {of_map.storing.image!r}: {advice}."
                )


def _advice(name: str) -> str:
    """How to avoid two maps with the same `name`, the one in the settings."""
    if not name or naming.has_low(name):  # without a name, an image is named after the low object
        return "rename one of the objects"
    return f"put {naming.LOW} into the name, or let them share it"
