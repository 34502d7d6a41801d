# SPDX-License-Identifier: GPL-3.0-or-later
"""What a parent and its workers send each other, over a connection of multiprocessing that pickles it.

A worker that has ended a bake sends a bake_result.Done.
"""

from dataclasses import dataclass
from typing import Any

from ..done.bake_record import Draft
from ..plan.plans import Plan


@dataclass(frozen=True)
class Assignment:
    """To a worker: a bake to do. draft: of its record, or None for a bake without one. log: the file for all that its process
    prints; empty for none."""

    plan: Plan
    needs_all: bool
    """As batch.need_all says of all plans of the call."""
    is_reported: bool
    """Whether the run has a report."""
    log: str = ""
    draft: Draft | None = None


@dataclass(frozen=True)
class Answer:
    """To a worker: its files may be used, or the sentence that says why not."""

    problem: str = ""


@dataclass(frozen=True)
class Ready:
    """To the parent: Blender and its GPU have started."""


@dataclass(frozen=True)
class FilesFound:
    """To the parent, which sends an Answer: a bake found more files. Calls a method of run_clashes.Run."""

    method: str
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class Percent:
    """To the parent: how far a bake is. done: from 0 to 1."""

    subject: str
    what: str
    done: float


@dataclass(frozen=True)
class Line:
    """To the parent: a line to print before a bake, which can take long."""

    line: str
