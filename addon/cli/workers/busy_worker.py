# SPDX-License-Identifier: GPL-3.0-or-later
"""A worker with what it does now."""

import os
import time
from dataclasses import replace

from ..plan.plans import Plan
from ..sandbox import Sandbox
from . import last_words
from .messages import Assignment
from .worker_process import WorkerProcess


class BusyWorker:
    """A worker process, and the bake that it has. Raises OSError if the process cannot be started."""

    def __init__(self, sandbox: Sandbox | None = None):
        """sandbox: as in WorkerProcess."""
        self.process = WorkerProcess(sandbox)
        self.started = time.monotonic()
        self.assigned: Assignment | None = None
        """Its bake."""
        self.has_begun = False
        """Whether it has received that."""
        self.is_well = False
        """Whether it has received any bake: one may end after Blender has started, and before that."""
        self.chain = 0
        """The chain of its last bake, whose scene is open in it."""
        self.begun = 0.0
        """When its bake began, by time.monotonic."""
        self._printed = 0
        """The bytes that it had printed by then."""

    @property
    def plan(self) -> Plan | None:
        return self.assigned and self.assigned.plan

    @property
    def log(self) -> str:
        """The file that has what its bake prints, or ""."""
        return self.assigned.log if self.assigned and os.path.exists(self.assigned.log) else ""

    def begin(self, assigned: Assignment) -> None:
        """Send it a bake. One whose files are not trusted writes no record."""
        self.assigned, self.has_begun, self.chain = assigned, False, assigned.plan.chain
        self._printed = self.process.printed
        self.begun = time.monotonic()
        self.process.send(replace(assigned, draft=None) if assigned.call.folders else assigned)

    def last_words(self) -> str:
        """The clause of last_words about its bake."""
        if self.log:
            return last_words.of_file(self.log)
        return last_words.clause(self.process.last_printed(self._printed))
