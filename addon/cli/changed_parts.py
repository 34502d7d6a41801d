# SPDX-License-Identifier: GPL-3.0-or-later
"""Which low objects of a bake have maps that it would change: --changed. What they read is compared with what the bake of their
record, or of the window, has read."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import bpy

from ..core import progress, versions
from ..core.contents import Contents
from ..core.report import Report
from ..core.settings import PART_OF, Settings
from ..jobs import part_state
from ..jobs.job import Job
from ..jobs.state_pieces import IMAGE, State
from . import records, run_report
from .records import Record


@dataclass(frozen=True)
class Kept:
    """What a bake leaves out, since its maps are true."""

    lows: frozenset[int] = frozenset()
    """The session_uids of the low objects."""
    reports: list[dict[str, Any]] = field(default_factory=list)
    """Of their bakes, as far as their record has them."""
    states: dict[str, str] = field(default_factory=dict)
    """What those have read, by the names of the low objects."""


NONE = Kept()
_COUNTED = {*PART_OF, "size", "part"}
"""Options that states have."""


def look(
    options: argparse.Namespace,
    jobs: Sequence[Job],
    settings: Settings,
    record: Record | None,
    contents: Contents,
    **shared: Any,
) -> Kept:
    """Compare what jobs would read now with their record, and with what a window has baked. shared: as for bake_jobs.work."""
    if options.convert or options.levels or options.asset or options.frames or options.pack_uvs:
        return NONE
    before = _of_record(options, record, contents)
    known: dict[str, dict[int, Any]] = {}

    def is_true(job: Job, then: str, of_job: Settings, whose: str, **shared: Any) -> bool:
        state = State.of_json(then) if then else None
        if state is None:
            return False
        looked = part_state.look(
            bpy.context, job, of_job, then=state, jobs=jobs, known=known.setdefault(whose, {}), **shared
        )
        return not part_state.changes(state, progress.finish(looked))

    lows, reports, states = set(), [], {}
    of_window, its_settings, is_shared = options.of_window or ({}, settings, False)
    in_window = shared | {"share_image": is_shared}  # also one part alone
    for job in jobs:
        name = job.low.name
        state, own = before.get(name, ("", []))
        if is_true(job, state, settings, "record", **shared):
            reports += own
            states[name] = state
        elif options.export or not is_true(job, of_window.get(name, ""), its_settings, "window", **in_window):
            continue
        lows.add(job.low_ref.uid)
    is_whole = options.export or options.save_blend  # a file of all low objects
    return NONE if is_whole and len(lows) < len(jobs) else Kept(frozenset(lows), reports, states)


def _of_record(
    options: argparse.Namespace, record: Record | None, contents: Contents
) -> dict[str, tuple[str, list[dict[str, Any]]]]:
    """The states and reports of a record, by the names of low objects, whose files are as they were."""
    if record is None or record.key.blender != versions.blender():
        return {}
    now, old = records.deciding_settings(options), record.key.settings
    if any(now.get(name) != old.get(name) for name in {*now, *old} - _COUNTED):
        return {}
    same = {each.path for each in record.files if records.is_unchanged(each, contents)}
    found: dict[str, list[dict[str, Any]]] = {}
    for report in record.result.reports:
        found.setdefault(report["low"], []).append(report)
    return {
        low: (record.states[low], reports)
        for low, reports in found.items()
        if low in record.states and same.issuperset(path for report in reports for path in _written(report))
    }


def _written(report: Mapping[str, Any]) -> Iterator[str]:
    yield from (path for paths in run_report.written_paths(dict(report)).values() for path in paths)


def states_of(reports: Sequence[Report]) -> dict[str, str]:
    """What bakes have read, by the names of their low objects, without images: those of a shell are in no file."""
    found: dict[str, list[State]] = {}
    for report in reports:
        if report.state is not None:
            found.setdefault(report.low, []).append(report.state)
    return {low: _without_images(states[0].joined(states[1:])).to_json() for low, states in found.items()}


def _without_images(state: State) -> State:
    return State({name: key for name, key in state.pieces.items() if not name.startswith(f"{IMAGE}:")})
