# SPDX-License-Identifier: GPL-3.0-or-later
"""The reports of this session's bakes, for the panels: each belongs to a scene and a low object."""

import bpy

from ..core.report import Report


class BakeResults:
    """The reports of the last bake of each low object of each scene: one for each texture set."""

    def __init__(self):
        self._reports: dict[tuple[int, int], list[Report]] = {}
        """By the session_uid of the scene and of the low object, which a rename or Undo does not change."""

    def remember(self, context: bpy.types.Context, reports: list[Report]) -> None:
        """Keep the reports of a bake in the context's scene, in place of earlier ones of the same low objects."""
        by_low: dict[tuple[int, int], list[Report]] = {}
        for report in reports:
            by_low.setdefault((context.scene.session_uid, report.refs[0].uid), []).append(report)
        for key, found in by_low.items():
            self._reports.pop(key, None)
            self._reports[key] = found  # the last one comes last

    def forget(self) -> None:
        """Forget all reports: a session_uid of one file means nothing in another."""
        self._reports.clear()
        for manager in bpy.data.window_managers:
            manager.imprint_summary = manager.imprint_warnings = ""

    def has_any(self, context: bpy.types.Context) -> bool:
        """Whether anything was baked in the context's scene."""
        return any(scene == context.scene.session_uid for scene, _ in self._reports)

    def all_of(self, context: bpy.types.Context, low: bpy.types.Object | None = None) -> list[Report]:
        """The reports of the last bake onto `low` in the context's scene: one for each texture set. low: by default, the low
        object of the panel."""
        low = low or context.scene.imprint.low or context.active_object
        return self._reports.get((context.scene.session_uid, low.session_uid), []) if low is not None else []

    def of(self, context: bpy.types.Context, low: bpy.types.Object | None = None) -> Report | None:
        """The first report of `all_of`, or None."""
        return next(iter(self.all_of(context, low)), None)

    def named(self, context: bpy.types.Context, name: str = "") -> Report | None:
        """The report of the last bake onto the low object that has this name or had it then, or None. Without a name: onto
        the low object of the panel, or the last one in the context's scene."""
        own = [reports[0] for (scene, _), reports in self._reports.items() if scene == context.scene.session_uid]
        if not name:
            return self.of(context) or next(reversed(own), None)
        low = bpy.data.objects.get(name)
        return (self.of(context, low) if low else None) or next((report for report in own if report.low == name), None)


def distances(report: Report | None) -> dict[str, float]:
    """Extrusion and maximum distance as a bake measured them, in scene units; empty if they were set."""
    return report.distances if report is not None and report.measured else {}


def high_objects(report: Report) -> list[bpy.types.Object]:
    """The high objects of a bake that still exist, without the low object if it was its own high object."""
    low, *highs = (ref.find() for ref in report.refs[: 1 + len(report.high)])
    return [high for high in highs if high not in {None, low}]


results = BakeResults()
