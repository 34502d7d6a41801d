# SPDX-License-Identifier: GPL-3.0-or-later
"""A set: low objects that are baked together, with the same settings, under one name. Here as plain data, for any caller; and
what is wrong within a set, and between several."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import bpy

from ..core.errors import BakeError
from ..core.progress import Pace, Task
from ..core.report import Report
from ..core.settings import Settings
from ..output.map_names import planned_files, settings_by_map
from ..output.path_clashes import Places
from ..scene.mesh_reader import active_uv_layer
from . import bake_jobs, part_state
from .job import NOTHING_ELSE, Job, Wants, by_material


@dataclass(frozen=True)
class SetJob:
    """What is baked of a set.

    Attributes:
        name: Of the set, which an image has that all parts share.
        jobs: One for each part.
        settings: Of all of them, with placeholders in names.
        share_image: Whether parts share images: one for all, or one for each material if the settings have texture sets.
        left_out: What is not baked, and why in a sentence: names of low objects, empty where it is no single part.
        off: The session_uids of the low objects that are switched off. They keep their texels, and shade others as usual.
    """

    name: str
    jobs: tuple[Job, ...]
    settings: Settings
    share_image: bool = False
    left_out: tuple[tuple[str, str], ...] = ()
    off: frozenset[int] = field(default_factory=frozenset)

    def wanted(self, only: Collection[int] | None = None) -> list[Job]:
        """The jobs that are baked. only: the session_uids of the low objects, of which those that are off are none."""
        return [
            job for job in self.jobs if job.low_ref.uid not in self.off and (only is None or job.low_ref.uid in only)
        ]

    def without(self, reasons: dict[str, str]) -> "SetJob":
        """This set without parts that cannot be baked. reasons: why, by the names of low objects, or "" for the whole set."""
        jobs = () if "" in reasons else tuple(job for job in self.jobs if job.low_ref.name not in reasons)
        off = {job.low_ref.name for job in self.jobs if job.low_ref.uid in self.off}
        left_out = [*self.left_out, *((name, reason) for name, reason in reasons.items() if name not in off)]
        if not jobs and not left_out:
            left_out.append(("", all_off(self.name)))
        return replace(self, jobs=jobs, left_out=tuple(left_out))


def work(
    context: bpy.types.Context,
    set_job: SetJob,
    pace: Pace,
    *,
    only: Collection[int] | None = None,
    wants: Wants = NOTHING_ELSE,
) -> Task[list[Report]]:
    """Bake a set, as bake_jobs.work. A part that fails does not end the others: a step with the failure follows it.

    only: the session_uids of the low objects that are baked; None for all. The others keep their texels; those that were baked
        into another image than the one that they share now, or whose texels cannot stay beside new ones, are baked as well.
    """
    wanted = [job.low_ref.uid for job in set_job.wanted(only)]
    if not wanted:
        raise BakeError(nothing_to_bake(set_job))
    baked = {job.low_ref.uid for job in set_job.wanted() if part_state.kept(job.low) is not None}
    return (
        yield from bake_jobs.work(
            context,
            set_job.jobs,
            set_job.settings,
            pace,
            wants=wants,
            share_image=set_job.share_image,
            shared_name=set_job.name,
            only=wanted,
            also=baked,
            goes_on=True,
        )
    )


def nothing_to_bake(set_job: SetJob) -> str:
    """Why nothing of a set is baked."""
    return all_off(set_job.name) if set_job.jobs or not set_job.left_out else set_job.left_out[0][1]


def all_off(name: str) -> str:
    """Why nothing is baked of a set of this name whose parts are switched off."""
    return f"All parts of the set {name!r} are off: switch one on."


def check_highs(set_job: SetJob) -> SetJob:
    """The set without parts that have another part as a high object."""
    lows = {job.low_ref.uid: job.low_ref.name for job in set_job.jobs}
    reasons = {}
    for job in set_job.jobs:
        others = [ref.uid for ref in job.high_refs if ref.uid in lows and ref.uid != job.low_ref.uid]
        if others:
            name = lows[others[0]]
            reasons[job.low_ref.name] = (
                f"{name!r} is a high object of {job.low_ref.name!r} and also a part of the set {set_job.name!r}: remove it "
                "from one of the two."
            )
    return set_job.without(reasons) if reasons else set_job


def apart(set_jobs: Sequence[SetJob]) -> list[SetJob]:
    """The sets without what an earlier one bakes already: into the same images or files, or into the same materials by another
    UV map."""
    known = _Known()
    return [set_job.without(reasons) if (reasons := known.add(set_job)) else set_job for set_job in set_jobs]


class _Known:
    """What the sets so far write."""

    def __init__(self):
        self._places = Places()
        self._images: dict[str, str] = {}
        """The names of sets by the names of their images, in lower case."""
        self._uv_layers: dict[int, tuple[str, str]] = {}
        """The UV map by which materials of a low object show maps, and the set, by session_uid."""

    def add(self, set_job: SetJob) -> dict[str, str]:
        """Add a set. Returns why parts of it cannot be baked, as SetJob.without takes it."""
        reasons: dict[str, str] = {}
        with suppress(BakeError):  # names that the set itself cannot have, which its bake tells
            for job, settings in _filled(set_job):
                name = job.low_ref.name
                if reason := self._other(set_job, settings):
                    reasons["" if set_job.share_image else name] = reason
                elif reason := self._other_uv_layer(set_job, job, settings):
                    reasons[name] = reason
        return reasons

    def _other(self, set_job: SetJob, settings: Settings) -> str:
        """Why an earlier set writes the same as a bake with these settings, or ""."""
        for image in (of_map.storing.image for of_map in settings_by_map(settings).values()):
            owner = self._images.setdefault(image.casefold(), set_job.name)
            if owner != set_job.name:
                return _twice("fill the image", image, owner, set_job)
        for path in (bpy.path.abspath(path) for path, _ in planned_files(settings)):
            owners = [owner for owner, _ in self._places.written_by(path) if owner != set_job.name]
            if owners:
                return _twice("write the file", path, owners[0], set_job)
            with suppress(BakeError):  # its bake tells of two parts with one file
                self._places.write(path, set_job.name)
        return ""

    def _other_uv_layer(self, set_job: SetJob, job: Job, settings: Settings) -> str:
        """Why the materials of a part cannot show its maps beside those of an earlier set, or ""."""
        if not (settings.changes_materials or settings.storing.one_material):
            return ""
        own = settings.map.uv_layer or active_uv_layer(job.low.data)
        layer, owner = self._uv_layers.setdefault(job.low_ref.uid, (own, set_job.name))
        if layer == own or owner == set_job.name:
            return ""
        return (
            f"{job.low_ref.name!r} is also a part of the set {owner!r}, by the UV map {layer!r} and not {own!r}, and its "
            "materials can show the maps of one: switch Material and Connect Maps off in one of the sets."
        )


def _filled(set_job: SetJob) -> Iterator[tuple[Job, Settings]]:
    """The bakes of a set with the names of their images and files. Raises BakeError."""
    jobs: Iterable[Job] = set_job.jobs
    if set_job.settings.map.texture_sets:
        jobs = by_material(set_job.jobs, set_job.settings.storing, shares=set_job.share_image)
    shared_name = set_job.name if set_job.share_image else ""
    for job in jobs:
        yield job, bake_jobs.named(set_job.settings, job, shared_name)


def _twice(what: str, place: str, owner: str, set_job: SetJob) -> str:
    return (
        f"The sets {owner!r} and {set_job.name!r} would both {what} {place!r}: give it another name in one of them, or switch "
        "one off."
    )
