# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes one plan after the other in this process."""

import time
from collections.abc import Iterator, Sequence

import numpy as np

from ...core.errors import BakeError
from ...output import png_writer
from .. import batch, blender_process, interruption
from ..done import recording
from ..done.bake_record import Draft
from ..done.contents import Contents
from ..done.turns import Resumed, Turns
from ..plan import clashes
from ..plan.plans import Plan
from ..results import bake_result
from ..results.bake_result import Done, Result, Wanted
from ..results.run_report import State
from ..scene_files import Stage
from ..terminal_progress import Meter
from .chains import Chains

MOST_PICTURES = 4
"""Pairs or frames of a bake that have pictures."""
WAIT = 0.1
"""Seconds after which signals are checked again, while other processes do all bakes that are left."""


class Baker:
    """Bakes one plan after the other in this process. A bake that fails does not stop the others."""

    def __init__(
        self, files: clashes.RunFiles, meter: Meter, wanted: Wanted, *, needs_all: bool, folders: Sequence[str] = ()
    ):
        """files: must have all plans. needs_all: as batch.need_all says of all. folders: as in Stage."""
        self._files, self._meter, self._folders, self._stage = files, meter, folders, Stage(folders)
        self._wanted, self._contents = wanted, Contents()
        if needs_all:
            blender_process.complete()  # before a file is opened: Cycles brings its settings in old files up to date

    def bake(self, plan: Plan, draft: Draft | None = None) -> Done:
        """Bake a plan. draft: of the record to write."""
        start, found, not_followed = time.perf_counter(), [], []
        hashes = self._contents if self._wanted.hashes or draft is not None else None
        try:
            interruption.check()
            opened = batch.open_files(
                plan, self._stage, self._files, self._meter, hashes, is_pictured=self._wanted.pictures
            )
            found, not_followed = opened.found, opened.not_followed
            result = batch.run(opened, self._stage, self._files, self._meter)
        except interruption.Stopped:
            result = Result(plan.name, is_stopped=True)
        except (BakeError, MemoryError) as error:
            result = bake_result.failure(plan.name, error)
            self._stage = Stage(self._folders)  # the failed bake may have changed the open scene
        result.seconds = time.perf_counter() - start
        self._meter.clear()
        done = Done.of(result, plan.number, _picture(result))
        return recording.finish(draft, done, found, self._contents, not_followed)


def _picture(result: Result) -> bytes:
    """The pictures of the first few reports, one above the other, as a PNG file; empty if there are none."""
    found = [report.picture for report in result.reports if report.picture is not None][:MOST_PICTURES]
    return png_writer.small(np.concatenate(found)) if found else b""


def bake_all(turns: Turns, files: clashes.RunFiles, meter: Meter, wanted: Wanted) -> Iterator[Done]:
    """Do all that is left of `turns`. The last result may be of a bake that was stopped. files: as in Baker."""
    count, place, chains = turns.count, 0, Chains()
    baker = Baker(files, meter, wanted, needs_all=batch.need_all([turn.plan for turn in turns.left]))
    while turns.count:
        turn = turns.next()
        if turn is None:
            time.sleep(WAIT)
            if interruption.code():
                turns.stop()
            continue
        place += 1
        if isinstance(turn, Resumed):
            yield Done.resumed(turn.plan, turn.result)
            continue
        meter.begin(turn.plan, f"{place}/{count} ")
        refusal = chains.refusal(turn.plan)
        done = Done.of(refusal, turn.plan.number) if refusal else baker.bake(turn.plan, turn.draft)
        chains.ended(turn.plan, done)
        yield done
        if done.entry.state == State.STOPPED:
            turns.stop()
