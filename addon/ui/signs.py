# SPDX-License-Identifier: GPL-3.0-or-later
"""Signs: whether the maps of a part or a set are those of the scene as it is.

    signs.of(context, low)            # of a part of the active set; without a set, of the last bake
    signs.of_past(context, low)       # of the last bake, with the settings that it had
    signs.of_set(context, one)
    signs.waiting(context, one)       # how far looks are, in a line

Rows ask while they are drawn, which costs no more than a look-up: looks are made afterwards.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import bpy

from ..core.errors import BakeError, in_window, shorten_list
from ..core.progress import Progress, Task
from ..jobs import part_state
from ..jobs.part_state import Status
from ..jobs.sets import SetJob
from . import object_pairs, results, sets
from .findings import findings
from .looks import Asked, Looks, Part, shading
from .sets import ImprintSet
from .texts import message

ICONS = {
    Status.TRUE: "CHECKMARK",
    Status.NEVER: "RADIOBUT_OFF",
    Status.CHANGED: "FILE_REFRESH",
    Status.FAILED: "CANCEL",
    Status.UNKNOWN: "QUESTION",
}
WORST = (Status.FAILED, Status.CHANGED, Status.UNKNOWN, Status.NEVER, Status.TRUE)
"""What a set shows of its parts: the first of these that one of them has."""
MOST_CHANGES = 2
"""Changes that a sign names."""

looks = Looks()


@dataclass(frozen=True)
class Sign:
    """What a row shows.

    Attributes:
        text: A sentence, translated.
        icon: Of Blender.
    """

    status: Status
    text: str
    icon: str


def of(context: bpy.types.Context, low: bpy.types.Object) -> Sign:
    """The sign of a part of the active set; while the panel bakes the selection, of the last bake of `low`."""
    one = sets.active(context)
    return _of(context, low, one.name if one is not None else "")


def of_past(context: bpy.types.Context, low: bpy.types.Object) -> Sign:
    """The sign of the last bake of `low`, with the settings that it had."""
    return _of(context, low, "")


def _of(context: bpy.types.Context, low: bpy.types.Object, of_set: str) -> Sign:
    seen, is_marked = looks.of(Part(context.scene.session_uid, of_set, low.session_uid), low)
    failure = _failure(low)
    if failure:
        return _sign(Status.FAILED, in_window(failure)[0])
    if is_marked and seen.status == Status.TRUE:
        return _sign(Status.UNKNOWN, _text(Status.UNKNOWN))
    if seen.problem:
        return _sign(seen.status, in_window(seen.problem)[0])
    if of_set and seen.status == Status.TRUE and findings.is_wrong(context, low):
        return _wrong(message("The maps show the scene as it is, and their bake has found something wrong"))
    return _sign(seen.status, _text(seen.status, seen.changes))


def _failure(low: bpy.types.Object) -> str:
    """Why the last bake left a low object out, in a sentence; empty if it did not."""
    pair = object_pairs.of(low)
    return pair.failure if pair is not None else ""


def _text(status: Status, changes: Sequence[str] = ()) -> str:
    if status == Status.CHANGED:
        return message("Changed since the bake: {}").format(shorten_list(changes, MOST_CHANGES))
    if status == Status.NEVER and changes:
        return message("Never baked: a copy of {}").format(changes[0])
    return {
        Status.TRUE: message("The maps show the scene as it is"),
        Status.NEVER: message("Never baked"),
        Status.UNKNOWN: message("It is not known yet whether something has changed"),
    }[status]


@lru_cache(maxsize=4096)  # rows are drawn many times a second
def _sign(status: Status, text: str) -> Sign:
    return Sign(status, text, ICONS[status])


@lru_cache(maxsize=4096)
def _wrong(text: str) -> Sign:
    """The sign of maps that are of the scene as it is, but wrong."""
    return Sign(Status.TRUE, text, "ERROR")


def of_set(context: bpy.types.Context, one: ImprintSet) -> Sign:
    """The sign of a set: the worst of its parts that are on, and which of them have it."""
    collection = one.collection.session_uid if one.collection is not None else 0
    place = one.source, len(one.parts), collection, len(bpy.data.objects)
    key = looks.version, place, message("Never baked")  # in another language, it is another sign
    kept = _of_sets.get((context.scene.session_uid, one.name))
    if kept is None or kept[0] != key:
        sign = _sign_of_set(context, one)
        key = looks.version, *key[1:]  # parts that are asked for the first time change it
        kept = _of_sets[context.scene.session_uid, one.name] = key, sign
    return kept[1]


def _sign_of_set(context: bpy.types.Context, one: ImprintSet) -> Sign:
    try:
        lows = [low for low in sets.lows(context, one) if low.imprint_is_baked]
    except BakeError as error:  # suffixes that are the same
        return _sign(Status.FAILED, in_window(str(error))[0])
    wrong: list[str] = []
    by_status: dict[Status, list[str]] = {}
    for low in lows:
        sign = _of(context, low, one.name)
        by_status.setdefault(sign.status, []).append(repr(low.name))
        if sign.icon != ICONS[sign.status]:
            wrong.append(repr(low.name))
    worst = next((status for status in WORST if status in by_status), Status.NEVER)
    names = by_status.get(worst, [])
    if worst == Status.TRUE and wrong:
        text = message(
            "The maps show the scene as it is, and their bake has found something wrong, in {} of {} parts: {}"
        )
        return _wrong(text.format(len(wrong), len(lows), shorten_list(wrong, MOST_CHANGES)))
    if len(names) == len(lows) and worst in {Status.TRUE, Status.NEVER, Status.UNKNOWN}:
        return _sign(worst, _text(worst))
    text = {
        Status.FAILED: message("Failed, {} of {} parts: {}"),
        Status.CHANGED: message("Changed since the bake, {} of {} parts: {}"),
        Status.UNKNOWN: message("Not known yet, {} of {} parts: {}"),
        Status.NEVER: message("Never baked, {} of {} parts: {}"),
    }[worst]
    return _sign(worst, text.format(len(names), len(lows), shorten_list(names, MOST_CHANGES)))


_of_sets: dict[tuple[int, str], tuple[tuple, Sign]] = {}
"""The signs of sets, by scene and name, each with what it was made of."""


def waiting(context: bpy.types.Context, one: ImprintSet) -> str:
    """How many parts of a set were looked at, in a line; empty if all were, and if no object was ever baked."""
    done, number = looks.progress(context.scene.session_uid, one.name)
    if not results.has_any(context):
        return ""
    return message("Looked at {} of {} parts").format(done, number) if done < number else ""


def untrue(context: bpy.types.Context, set_job: SetJob) -> Task[set[int]]:
    """Look at all parts of a set that are on, in steps. Returns the session_uids of the low objects whose maps are not those of
    the scene as it is, or would be lost by these bakes."""
    wanted, found = set_job.wanted(), set()
    shared_name = set_job.name if set_job.share_image else ""
    looks.begin()
    shading_all = shading(context, set_job.settings, set_job.jobs)
    for number, job in enumerate(wanted):
        yield Progress(f"Looking at {job.low_ref.name}", number / len(wanted))
        part = Part(context.scene.session_uid, set_job.name, job.low_ref.uid)
        status = looks.look(context, part, Asked(job, set_job.settings, set_job.jobs, shared_name, shading_all))
        if status != Status.TRUE or _failure(job.low):
            found.add(job.low_ref.uid)
    if not set_job.share_image:
        found |= part_state.displaced(context, wanted, set_job.settings, found)
    return found
