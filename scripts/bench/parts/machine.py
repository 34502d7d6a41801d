# SPDX-License-Identifier: GPL-3.0-or-later
"""The machine of the measurements: its processor, its drivers, its memory."""

import os
import platform
import re
from pathlib import Path

import bpy
import gpu

from addon.passes.shader import is_software


def machine() -> dict:
    """The machine of the measurements."""
    gpu.init()
    renderer = gpu.platform.renderer_get()
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.machine()}",
        "renderer": renderer,
        "in_software": is_software(renderer),
        "backend": gpu.platform.backend_type_get(),
        "blender": bpy.app.version_string,
    }


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor()
    found = re.search(r"model name\s*: (.+)", text)
    return found[1] if found else platform.processor()


def forget_peak() -> None:
    """Reset the peak memory of this process, if the system supports it."""
    clear = Path("/proc/self/clear_refs")
    if clear.exists():
        clear.write_text("5", encoding="ascii")


def peak_gigabytes() -> float | None:
    """The peak memory of this process since `forget_peak`, or None if the system does not report it."""
    status = Path("/proc/self/status")
    found = re.search(r"VmHWM:\s+(\d+) kB", status.read_text(encoding="ascii")) if status.exists() else None
    return int(found[1]) * 1024 / 1e9 if found else None
