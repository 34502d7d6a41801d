# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the maps of a part are true: what a bake of it would read now, compared with what its last bake has read.

A bake computes its state from the arrays that it draws (state_pieces), the low object keeps it (`keep`), and `look` computes
that of now in the same way. The images of the maps are pieces as well: they are there, and nobody else has written them.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from enum import StrEnum

import bpy

from ..core.declarations.all_settings import DECLARED
from ..core.declarations.choices import Modifiers
from ..core.errors import BakeError
from ..core.naming import ATLAS
from ..core.progress import Progress, Task
from ..core.settings import Settings
from ..output import map_names
from ..scene import object_checks
from . import bake_jobs, map_contents
from .job import Job, Request, read_meshes
from .map_contents import Written
from .state_pieces import (
    CODE,
    IMAGE,
    MATERIAL,
    MESH,
    ORDER,
    OTHERS,
    PLACE,
    PROBLEM,
    SETTING,
    TARGET,
    UVS,
    Other,
    State,
    are_same_uvs,
    of_read,
    of_texture,
)

__all__ = ["State", "Status", "changes", "keep", "kept", "look", "status"]


class Status(StrEnum):
    """What the sign of a part says of its maps."""

    NEVER = "NEVER"
    """It was never baked."""
    TRUE = "TRUE"
    """A bake would make the same maps."""
    CHANGED = "CHANGED"
    """Something that it reads has changed, or a map."""
    FAILED = "FAILED"
    """Its last bake failed."""
    UNKNOWN = "UNKNOWN"
    """Nobody has looked since the file was opened, or something was touched."""


def look(
    context: bpy.types.Context,
    job: Job,
    settings: Settings,
    *,
    then: State | None = None,
    jobs: Sequence[Job] = (),
    share_image: bool = False,
    shared_name: str = ATLAS,
    known: dict[int, Other | None] | None = None,
) -> Task[State]:
    """What a bake of `job` would read now. A generator: Blender can continue between its steps.

    Args:
        settings: As for bake_jobs.work, with "{low}" in names.
        then: The state of the last bake: at whose images to look.
        jobs: Those that are baked together, whose high objects may be occluders; with `job`. Empty for `job` alone.
        share_image, shared_name: As for bake_jobs.work.
        known: Objects that only shade, by session_uid, which are not read again. Adds to it. To be cleared when an object
            changes.

    What cannot be baked has the sentence of the problem as a piece.
    """
    name, known = job.low_ref.name, {} if known is None else known
    yield Progress(f"Looking at {name}", 0.0)
    try:
        settings.check()
        requests = bake_jobs.requests_of(
            context, job, settings, jobs=jobs, shared_name=shared_name if share_image else ""
        )
        state = _read(context, requests, known)
    except BakeError as error:
        state = State({f"{PROBLEM}:": str(error)})
    yield Progress(f"Looking at {name}", 1.0)
    return state.with_images(map_contents.look(job.low_ref.find(), then.images) if then is not None else {})


def _read(context: bpy.types.Context, requests: Sequence[Request], known: dict[int, Other | None]) -> State:
    """What the bakes of all texture sets of a low object would read now, which is read once. known: as in `look`."""
    first = requests[0]
    new = tuple(ref for ref in first.other_refs if ref.uid not in known)
    meshes = read_meshes(
        context, _as_shown(context, replace(first, job=first.job.but(texture_set=None), other_refs=new))
    )
    read = {mesh.name: Other.of(mesh) for mesh in meshes.others}
    known |= {ref.uid: read.get(ref.name) for ref in new}
    others = [other for ref in first.other_refs if (other := known[ref.uid]) is not None]
    return of_read(first, meshes, others).joined(map(of_texture, requests[1:]))


def _as_shown(context: bpy.types.Context, request: Request) -> Request:
    """The request, to be read as the viewport shows its objects where renders see the same: these would be evaluated anew."""
    refs, depsgraph = (*request.job.refs, *request.other_refs), context.evaluated_depsgraph_get()
    objects = [ref.resolve() for ref in refs]
    if request.settings.map.rest_pose or any(
        object_checks.may_differ_in_renders(obj, context.scene) or not obj.evaluated_get(depsgraph).is_evaluated
        for obj in objects
    ):
        return request
    return replace(request, settings=request.settings.mapped(modifiers=Modifiers.VIEWPORT))


def displaced(context: bpy.types.Context, jobs: Sequence[Job], settings: Settings, baked: Collection[int]) -> set[int]:
    """Which low objects, by session_uid, have to be baked with others, as their maps are in images that these bakes fill: those
    of objects that had their names before.

    Args:
        jobs: All of them, of which each fills images of its own.
        baked: The session_uids of the low objects that are baked.
    """
    shown, new, found = {}, [job for job in jobs if job.low_ref.uid in baked], set()
    for job in jobs:
        state = kept(job.low) if job.low_ref.uid not in baked else None
        shown |= {job: map_contents.names(job.low, state.images)} if state is not None else {}
    while new:
        filled = {name for job in new for name in _filled(context, job, settings)}
        new = [job for job, names in shown.items() if names & filled and job.low_ref.uid not in found]
        found |= {job.low_ref.uid for job in new}
    return found


def _filled(context: bpy.types.Context, job: Job, settings: Settings) -> set[str]:
    """The names of the images that a bake of a job fills; none if it cannot be baked."""
    try:
        requests = bake_jobs.requests_of(context, job, settings)
    except BakeError:
        return set()
    by_map = [map_names.settings_by_map(each.settings).values() for each in requests]
    return {of_map.storing.image for maps in by_map for of_map in maps}


def changes(then: State, now: State) -> list[str]:
    """What differs between two states, in clauses, the worst first; none if a bake would make the same maps.

    Of several that `then` has, the one counts whose settings are most like those of `now`: it is of the same set.
    """
    if not then.pieces:  # an earlier version did not note it
        return ["Imprint itself"]
    problem = now.of_kind(PROBLEM)
    if problem:
        return list(problem.values())

    def unlike(state: State) -> int:
        return len(_differing(state, now, SETTING) + _differing(state, now, TARGET))

    return _changes(min((then, *then.earlier), key=unlike), now)


def _changes(then: State, now: State) -> list[str]:
    clauses = list(_of_maps(then, now))
    shapes = dict.fromkeys([*_differing(then, now, MESH), *_differing(then, now, UVS)])
    clauses += [f"the mesh of {name!r}" for name in shapes]
    moved = [name for name in _differing(then, now, PLACE) if f"the mesh of {name!r}" not in clauses]
    clauses += [f"the place of {name!r}" for name in moved]
    if not shapes and not moved:  # the order of meshes has their keys
        clauses += ["the order of the high objects" for _ in _differing(then, now, ORDER)]
    clauses += ["the objects that shade it" for _ in _differing(then, now, OTHERS)]
    clauses += [f"the material {name!r}" for name in _differing(then, now, MATERIAL)]
    settings = _differing(then, now, SETTING)
    clauses += map(_of_setting, settings)
    if _STORING.isdisjoint(settings):
        targets = dict.fromkeys(name.partition(" ")[0] for name in _differing(then, now, TARGET))
        clauses += [f"the name of the {target}" for target in targets]
    clauses += ["Imprint itself" for _ in _differing(then, now, CODE)]
    return clauses


_STORING = {"image", "output", "storage", "texture_sets"}
"""Settings that decide by themselves which images and files a bake fills."""


def _of_setting(name: str) -> str:
    """A clause about a setting. name: of its piece, with the texture set that it is for."""
    setting, _, material = name.partition(" ")
    label = DECLARED[setting].label if setting in DECLARED else setting
    return f"the setting {label}" + (f" of {material!r}" if material else "")


def _of_maps(then: State, now: State) -> Iterator[str]:
    found = now.of_kind(IMAGE)
    for name, key in then.of_kind(IMAGE).items():
        match found.get(name, key):
            case Written.GONE:
                yield f"the image {name!r} is gone"
            case Written.NO_FILE:
                yield f"the file of {name!r} is gone"
            case Written.EDITED:
                yield f"the image {name!r} was edited"
            case Written.OTHER:
                yield f"the image {name!r} is of another bake"


def _differing(then: State, now: State, kind: str) -> list[str]:
    """The names of the pieces of a kind that differ: those that are new or other, and those that are gone.

    What was only renamed has the same key at the same place in the order.
    """
    before, after = then.of_kind(kind), now.of_kind(kind)
    if kind == UVS:
        after = {
            name: before[name] if name in before and are_same_uvs(before[name], key) else key
            for name, key in after.items()
        }
    if kind in {SETTING, TARGET}:  # another one, which differs, decides whether a setting has a meaning
        return [name for name in after if before.get(name, after[name]) != after[name]]
    if list(before.values()) == list(after.values()):
        return []
    changed = [name for name, key in after.items() if before.get(name) != key]
    renamed = [before[name] for name in before if name not in after]
    for name in [name for name in changed if name not in before]:
        if after[name] in renamed:
            renamed.remove(after[name])
            changed.remove(name)
    gone = [name for name in before if name not in after and before[name] in renamed]
    return [*changed, *gone]


def status(then: State | None, now: State | None) -> Status:
    """The sign of a part. then: of its last bake; None without one. now: None while nobody has looked."""
    if then is None:
        return Status.NEVER
    if now is None:
        return Status.UNKNOWN
    return Status.CHANGED if changes(then, now) else Status.TRUE


def keep(low: bpy.types.Object, states: Sequence[State]) -> None:
    """Keep the states of a bake of a low object, one for each texture set, with its pair.

    Those of bakes into other images stay beside it: a low object can be a part of several sets.
    """
    if low.is_editable and hasattr(low, "imprint"):
        before = State.of_json(low.imprint.state)
        low.imprint.state = states[0].joined(states[1:]).after(before).to_json() if states else ""


def kept(low: bpy.types.Object) -> State | None:
    """The state of the last bake of a low object, empty if it is not known; None if it was never baked, or copied since from
    one that was."""
    if not _was_baked(low):
        return None
    state = State.of_json(low.imprint.state) or State()
    return None if _original(low, state) is not None else state


def original(low: bpy.types.Object) -> bpy.types.Object | None:
    """The object whose maps a low object shows because it is a copy of it, which was not baked itself; None for others."""
    return _original(low, State.of_json(low.imprint.state) or State()) if _was_baked(low) else None


def _original(low: bpy.types.Object, state: State) -> bpy.types.Object | None:
    """As `original`. state: of the low object. Copies have the state of one bake, and its images.

    The original has the name that it had at that bake, or else is the first of them: it was only renamed if it is the only one.
    """
    name = map_contents.baked_as(low, state.of_kind(IMAGE))
    if name in {"", low.name}:
        return None
    images = {item.image for item in low.imprint.maps} - {None}
    same = [
        obj
        for obj in bpy.data.objects
        if _was_baked(obj)
        and obj.imprint.state == low.imprint.state
        and not object_checks.is_deleted(obj)
        and any(item.image in images for item in obj.imprint.maps)
    ]
    first = min(same, key=lambda obj: (obj.name != name, obj.session_uid), default=low)
    return None if first == low else first


def _was_baked(obj: bpy.types.Object) -> bool:
    return hasattr(obj, "imprint") and obj.is_property_set("imprint") and bool(obj.imprint.result)
