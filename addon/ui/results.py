# SPDX-License-Identifier: GPL-3.0-or-later
"""The reports of the last bake of each low object, one for each texture set, which object_pairs stores in the file."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace

import bpy

from ..core.report import Report
from ..core.sentences import Sentence, by_harm
from . import object_pairs
from .callbacks import events, until_change


@dataclass(frozen=True)
class Batch:
    """The session's last bake of pairs.

    Attributes:
        left_out: What it left out: names of low objects, empty where there is no pair, and why in a sentence.
        baked: The names of the low objects that it baked; empty after a later bake.
    """

    left_out: Sequence[tuple[str, str]] = ()
    baked: Sequence[str] = ()


def remember(reports: list[Report]) -> None:
    """Keep the reports of a bake, and its pairs, in place of earlier ones of the same low objects."""
    object_pairs.remember(reports)
    baked = {ref.name for report in reports for ref in report.refs[:1]}
    keep_batch(Batch([one for one in batch().left_out if one[0] not in baked]))


def batch() -> Batch:
    """The last bake of pairs, with the objects that are still there."""
    text = bpy.context.window_manager.imprint_batch
    kept = Batch(**json.loads(text)) if text else Batch()
    left_out = [(name, reason) for name, reason in kept.left_out if not name or name in bpy.data.objects]
    return replace(kept, left_out=left_out)


def keep_batch(made: Batch) -> None:
    """Keep a bake of pairs, until another file is opened; and with each low object why it was left out."""
    for name, reason in made.left_out:
        if (low := bpy.data.objects.get(name)) is not None:
            object_pairs.keep_failure(low, reason)
    bpy.context.window_manager.imprint_batch = json.dumps(asdict(made))


def forget() -> None:
    """Clear the lines about the session's last bake: they mean nothing in another file."""
    for manager in bpy.data.window_managers:
        manager.imprint_summary = manager.imprint_warnings = manager.imprint_batch = ""


def has_any(context: bpy.types.Context) -> bool:
    """Whether the panel's low object, or any other one in the context's scene, was baked."""
    scene = context.scene
    return of(context) is not None or until_change.get("results", scene.session_uid, lambda: bool(_baked(scene)))


def all_of(context: bpy.types.Context, low: bpy.types.Object | None = None) -> list[Report]:
    """The reports of the last bake onto `low`: one for each texture set. low: by default, the low object of the panel."""
    pair = object_pairs.of(low or context.scene.imprint.low or context.active_object)
    return pair.reports() if pair is not None else []


def warnings_of(reports: Iterable[Report]) -> list[Sentence]:
    """The warnings of reports and of their exported files, each of them once, the worst first."""
    return by_harm(text for each in reports for text in (*each.warnings, *each.export.get("warnings", ())))


def of(context: bpy.types.Context, low: bpy.types.Object | None = None) -> Report | None:
    """The first report of `all_of`, or None."""
    return next(iter(all_of(context, low)), None)


def with_image(context: bpy.types.Context, own: Report) -> list[Report]:
    """The report `own`, and those of other low objects of the scene whose last bake filled the same image."""
    others = (report for _, reports in of_scene(context) for report in reports)
    return [own, *(one for one in others if one.image == own.image and one.refs[0] != own.refs[0])]


def of_scene(context: bpy.types.Context) -> list[tuple[bpy.types.Object, list[Report]]]:
    """The low objects of the scene that were baked, with their reports, by name."""
    lows = sorted(_baked(context.scene), key=lambda low: low.name.casefold())
    return [(low, all_of(context, low)) for low in lows]


def named(context: bpy.types.Context, name: str = "") -> Report | None:
    """The report of the last bake onto the low object that has this name or had it then, or None. Without a name: onto
    the low object of the panel, or the last one in the context's scene."""
    baked = _baked(context.scene)
    if not name:
        last = max(baked, key=lambda low: low.imprint.baked, default=None)
        return of(context) or (of(context, last) if last is not None else None)
    low = bpy.data.objects.get(name)
    reports = (of(context, low) for low in baked)
    return (of(context, low) if low else None) or next((one for one in reports if one.low == name), None)


def _baked(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of a scene with a result."""
    return [obj for obj in scene.objects if (pair := object_pairs.of(obj)) is not None and pair.reports()]


def distances(report: Report | None) -> dict[str, float]:
    """Extrusion and maximum distance as a bake measured them, in scene units; empty if they were set."""
    return report.distances if report is not None and report.measured else {}


def high_objects(report: Report) -> list[bpy.types.Object]:
    """The high objects of a bake that still exist, without the low object if it was its own high object."""
    low, *highs = (ref.find() for ref in report.refs[: 1 + len(report.high)])
    return [high for high in highs if high not in {None, low}]


events.hear(end=forget)
