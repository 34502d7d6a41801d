# SPDX-License-Identifier: GPL-3.0-or-later
"""What was baked in this session, for the panel: each report belongs to the scene and the low object that it is of."""

import bpy

from ..core.report import Report

_reports: dict[tuple[int, int], Report] = {}
"""By the session_uid of the scene and of the low object, which no other file, rename or undo changes."""


def remember(context: bpy.types.Context, reports: list[Report]) -> None:
    """Keep what was just baked in the context's scene, instead of what was known of the same low objects."""
    for report in reports:
        key = context.scene.session_uid, report.refs[0].uid
        _reports.pop(key, None)
        _reports[key] = report  # the last one comes last


def forget() -> None:
    """Know of no bake: numbers of one file say nothing about another."""
    _reports.clear()
    for manager in bpy.data.window_managers:
        manager.imprint_summary = manager.imprint_warnings = ""


def is_there(context: bpy.types.Context) -> bool:
    """Whether anything was baked in the context's scene."""
    return any(scene == context.scene.session_uid for scene, _ in _reports)


def of(context: bpy.types.Context, low: bpy.types.Object | None = None) -> Report | None:
    """The report of the last bake onto `low` in the context's scene; without it, onto the low object that the panel means.
    None where there is none."""
    low = low or context.scene.imprint.low or context.active_object
    return _reports.get((context.scene.session_uid, low.session_uid)) if low is not None else None


def named(context: bpy.types.Context, name: str = "") -> Report | None:
    """The report of the last bake onto the low object that is, or was then, called `name`; without a name onto the one that
    the panel means, or else onto any of the context's scene. None where there is none."""
    own = [report for (scene, _), report in _reports.items() if scene == context.scene.session_uid]
    if not name:
        return of(context) or next(reversed(own), None)
    low = bpy.data.objects.get(name)
    return (of(context, low) if low else None) or next((report for report in own if report.low == name), None)


def distances(report: Report | None) -> dict[str, float]:
    """Extrusion and maximum distance as a bake measured them, in scene units; empty where they were set."""
    return report.distances if report is not None and report.measured else {}


def high_objects(report: Report) -> list[bpy.types.Object]:
    """The high objects of a bake that are still there, without the low one where it was its own."""
    low, *highs = (ref.find() for ref in report.refs[: 1 + len(report.high)])
    return [high for high in highs if high not in {None, low}]
