# SPDX-License-Identifier: GPL-3.0-or-later
"""The reports of the last bakes, for the panels: read from the low objects, which keep them in the file."""

import bpy

from ..core.report import Report
from . import object_pairs


class BakeResults:
    """The reports of the last bake of each low object: one for each texture set. object_pairs stores them."""

    def remember(self, _context: bpy.types.Context, reports: list[Report]) -> None:
        """Keep the reports of a bake, and its pairs, in place of earlier ones of the same low objects."""
        object_pairs.remember(reports)

    def forget(self) -> None:
        """Clear the lines about the session's last bake: they mean nothing in another file."""
        for manager in bpy.data.window_managers:
            manager.imprint_summary = manager.imprint_warnings = ""

    def has_any(self, context: bpy.types.Context) -> bool:
        """Whether the panel's low object, or any other one in the context's scene, was baked."""
        return self.of(context) is not None or bool(_baked(context.scene))

    def all_of(self, context: bpy.types.Context, low: bpy.types.Object | None = None) -> list[Report]:
        """The reports of the last bake onto `low`: one for each texture set. low: by default, the low object of the panel."""
        pair = object_pairs.of(low or context.scene.imprint.low or context.active_object)
        return pair.reports() if pair is not None else []

    def of(self, context: bpy.types.Context, low: bpy.types.Object | None = None) -> Report | None:
        """The first report of `all_of`, or None."""
        return next(iter(self.all_of(context, low)), None)

    def named(self, context: bpy.types.Context, name: str = "") -> Report | None:
        """The report of the last bake onto the low object that has this name or had it then, or None. Without a name: onto
        the low object of the panel, or the last one in the context's scene."""
        baked = _baked(context.scene)
        if not name:
            last = max(baked, key=lambda low: low.imprint.baked, default=None)
            return self.of(context) or (self.of(context, last) if last is not None else None)
        low = bpy.data.objects.get(name)
        reports = (self.of(context, low) for low in baked)
        return (self.of(context, low) if low else None) or next((one for one in reports if one.low == name), None)


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


results = BakeResults()
