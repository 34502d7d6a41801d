# SPDX-License-Identifier: GPL-3.0-or-later
"""The exit codes of the command line, for farms: what a failure means, and whether another try may help."""

from .run_report import Cause, Entry, State

DONE = 0
FAILED = 1
"""A bake failed. The report has the reason."""
WRONG_USAGE = 2
"""The call or its input is wrong, so that nothing was baked. Another try does not help."""
NO_MACHINE = 3
"""This machine has no GPU for Blender, or too little memory. Another machine may do it."""
GATE = 4
"""All bakes are done, but a figure is over its limit."""


class Tally:
    """Counts results for the exit code of a call."""

    def __init__(self):
        self._causes: set[Cause] = set()
        self._is_over = False

    def add(self, entry: Entry) -> None:
        """Count a result."""
        if entry.state == State.FAILED:
            self._causes.add(entry.cause)
        self._is_over |= entry.state == State.GATE

    @property
    def code(self) -> int:
        """The exit code, if no signal stopped the call."""
        if self._causes:
            return NO_MACHINE if self._causes <= {Cause.GPU, Cause.MEMORY} else FAILED
        return GATE if self._is_over else DONE


def code(entry: Entry) -> int:
    """The exit code of a call that made one bake."""
    tally = Tally()
    tally.add(entry)
    return tally.code
