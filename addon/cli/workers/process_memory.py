# SPDX-License-Identifier: GPL-3.0-or-later
"""The memory of other processes, by what the system says."""

import ctypes
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path


def of(number: int) -> int:
    """The bytes of memory that a process has in use; 0 if it has ended, or where the system does not say."""
    with suppress(OSError, ValueError, IndexError, AttributeError):
        if sys.platform == "linux":
            pages = int(Path(f"/proc/{number}/statm").read_text(encoding="ascii").split()[1])
            return pages * os.sysconf("SC_PAGE_SIZE")
        if os.name == "nt":
            return _on_windows(number)
        found = subprocess.run(["ps", "-o", "rss=", "-p", str(number)], capture_output=True, text=True, check=False)
        return int(found.stdout) * 1024
    return 0


def kills() -> int:
    """How many processes the system has ended since memory ran out; 0 where it does not say."""
    for path, word in (("/sys/fs/cgroup/memory.events", "oom_kill"), ("/proc/vmstat", "oom_kill")):
        with suppress(OSError, ValueError):
            fields = dict(line.split() for line in Path(path).read_text(encoding="ascii").splitlines())
            if word in fields:
                return int(fields[word])
    return 0


class _Counters(ctypes.Structure):
    """PROCESS_MEMORY_COUNTERS of Windows."""

    _fields_ = (
        ("length", ctypes.c_uint32),
        ("faults", ctypes.c_uint32),
        ("peak", ctypes.c_size_t),
        ("working_set", ctypes.c_size_t),
        *((name, ctypes.c_size_t) for name in ("a", "b", "c", "d", "page_file", "page_file_peak")),
    )


def _on_windows(number: int) -> int:
    query_and_read = 0x0410
    handle = ctypes.windll.kernel32.OpenProcess(query_and_read, False, number)
    if not handle:
        return 0
    try:
        counters = _Counters(length=ctypes.sizeof(_Counters))
        found = ctypes.windll.psapi.GetProcessMemoryInfo(handle, ctypes.byref(counters), counters.length)
        return counters.working_set if found else 0
    finally:
        ctypes.windll.kernel32.CloseHandle(handle)
