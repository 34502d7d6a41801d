# SPDX-License-Identifier: GPL-3.0-or-later
"""What a worker for untrusted files starts as: it gives up its rights, and becomes Blender.

The rights are given up in a process of its own before Blender has threads, which would keep theirs.
"""

import json
import os
import sys
from collections.abc import Sequence

from . import landlock, system_calls

try:
    import resource
except ImportError:  # Windows
    resource = None

MOST_BYTES = 32 << 30
"""Of a file that it writes. A map of 32768 x 32768 texels with four channels of 32 bits has half of it."""
MOST_OPEN = 4096
"""Files that it may have open."""


def start(words: Sequence[str]) -> None:
    """Become another program with fewer rights. words: the rules for landlock.restrict as JSON, then the command.

    Raises OSError.
    """
    rules, *command = words
    _limit()
    _prefer_to_end()
    if sys.platform == "linux":
        system_calls.forbid_privileges()
        if landlock.version():
            landlock.restrict([(path, rights) for path, rights in json.loads(rules)])
        if system_calls.is_known():
            system_calls.restrict()
    os.execv(command[0], command)


def _limit() -> None:
    """No core files, no file or number of files that is too large. A limit that is lower already stays."""
    for kind, most in (("CORE", 0), ("FSIZE", MOST_BYTES), ("NOFILE", MOST_OPEN)):
        number = getattr(resource, f"RLIMIT_{kind}")
        _, hard = resource.getrlimit(number)
        limit = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(number, (limit, limit))


def _prefer_to_end() -> None:
    """If memory runs out, the system ends this process first."""
    if sys.platform == "linux":
        with open("/proc/self/oom_score_adj", "w", encoding="ascii") as file:
            file.write("1000")
