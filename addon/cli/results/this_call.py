# SPDX-License-Identifier: GPL-3.0-or-later
"""What a report says about the call that wrote it: when it began, on which machine, and its arguments."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime


@dataclass(frozen=True)
class ThisCall:
    """A call. Worker processes have that of their parent."""

    started: str
    """The time in UTC, as 2026-01-31T23:59:59Z."""
    host: str
    """The name of the machine in its network."""
    call: tuple[str, ...]
    """The arguments."""

    @classmethod
    def of(cls, words: Sequence[str]) -> "ThisCall":
        """The call that begins now. words: the arguments."""
        now = datetime.now(UTC).replace(microsecond=0, tzinfo=None)
        return cls(f"{now.isoformat()}Z", platform.node(), tuple(words))


_noted: list[ThisCall] = []
"""The call that is going on. A process does one at a time."""


def note(call: ThisCall) -> None:
    """Reports are of this call from now on."""
    _noted[:] = [call]


def noted() -> ThisCall:
    """The call that is going on."""
    return _noted[0] if _noted else ThisCall.of(())
