# SPDX-License-Identifier: GPL-3.0-or-later
"""The rights of the workers of a run with untrusted files, and how they are started with no more."""

import glob
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from ...output.files.atomic_file import make_folder
from . import landlock, system_calls
from .bounds import Bounds

SECONDS = 3600.0
"""That a bake may take, unless the caller says otherwise."""
BYTES = 16 << 30
"""Of memory that a worker may have, unless the caller says otherwise, and at most three quarters of the machine's."""
ROOT = str(Path(__file__).resolve().parents[3])
_START = (
    "import sys; sys.path.insert(0, {!r})\n"
    "from addon.cli.trust import confined_process\n"
    "confined_process.start(sys.argv[1:])"
)
"""A program in a process of its own. The folder of an installed extension is no package, but addon/ in it is one."""
_SYSTEM = (
    *("/usr", "/lib", "/lib32", "/lib64", "/bin", "/sbin", "/opt", "/nix/store", "/run/opengl-driver", "/sys"),
    *(
        "/etc/ld.so.cache",
        "/etc/ld.so.conf",
        "/etc/ld.so.conf.d",
        "/etc/alternatives",
        "/etc/glvnd",
        "/etc/egl",
        "/etc/drirc",
    ),
    *("/etc/vulkan", "/etc/OpenCL", "/etc/fonts", "/etc/localtime", "/etc/nsswitch.conf", "/etc/nvidia"),
)
"""Programs, libraries and drivers."""
_OF_THE_KERNEL = (
    *(
        "/proc/self",
        "/proc/cpuinfo",
        "/proc/meminfo",
        "/proc/stat",
        "/proc/version",
        "/proc/filesystems",
        "/proc/devices",
    ),
    *(
        "/proc/modules",
        "/proc/driver",
        "/proc/sys/vm",
        "/proc/sys/kernel",
        "/proc/pressure",
        "/proc/loadavg",
        "/proc/uptime",
    ),
)
_DEVICES = ("/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom", "/dev/dri", "/dev/kfd", "/dev/dxg")
"""Without the cards of NVIDIA, which have numbers."""
_VARIABLES = (
    "LD_LIBRARY_PATH",
    "LIBGL_DRIVERS_PATH",
    "GBM_BACKENDS_PATH",
    "__EGL_VENDOR_LIBRARY_DIRS",
    "VK_DRIVER_FILES",
)
_VARIABLES += ("__EGL_VENDOR_LIBRARY_FILENAMES", "VK_ICD_FILENAMES")
"""Variables with further paths of drivers."""


def missing() -> str:
    """What this system cannot take away from a worker, as a sentence; "" if it can do all."""
    lacks = []
    if not landlock.version():
        lacks.append("files outside the folders")
    if not system_calls.is_known():
        lacks.append("the network and other processes")
    return f"This system cannot keep a worker from {' and '.join(lacks)}: only names are checked." if lacks else ""


def most_memory() -> int:
    """The bytes of memory that a worker may have."""
    try:
        return min(BYTES, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") * 3 // 4)
    except (AttributeError, ValueError, OSError):  # Windows
        return BYTES


class Confinement:
    """The rights of all workers of a run. They have a folder of their own for temporary files until `close`."""

    def __init__(self, bounds: Bounds, log: str | None = None):
        """Make the output folder. log: the folder for their logs. Raises BakeError."""
        self.bounds, self._log = bounds, log
        bounds.make()
        if log:
            make_folder(Path(log).absolute())
        self._folder = tempfile.TemporaryDirectory(prefix="imprint-untrusted-")

    @property
    def folders(self) -> tuple[str, ...]:
        """Those that the bakes may read."""
        return self.bounds.inputs, self.bounds.outputs

    def close(self) -> None:
        """Remove the temporary files."""
        self._folder.cleanup()

    def words(self, command: Sequence[str]) -> list[str]:
        """The command that starts `command` confined. On Windows that cannot be done."""
        if os.name == "nt":
            return list(command)
        rules = json.dumps(list(self._rules(command)))
        return [sys.executable, "-E", "-s", "-B", "-c", _START.format(ROOT), rules, *command]

    def variables(self) -> dict[str, str]:
        """Environment variables by which the worker uses the temporary folder, also for compiled shaders: those in the user's
        own folder stay as they are."""
        names = ("TMPDIR", "TMP", "TEMP", "XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR", "__GL_SHADER_DISK_CACHE_PATH")
        return {**dict.fromkeys(names, self._folder.name), "PYTHONDONTWRITEBYTECODE": "1"}

    def _rules(self, command: Sequence[str]) -> Iterator[tuple[str, int]]:
        """Paths with what is allowed there and below."""
        programs = {sys.prefix, sys.base_prefix, sys.exec_prefix, os.path.dirname(os.path.realpath(command[0])), ROOT}
        yield from ((path, landlock.READ | landlock.EXECUTE) for path in (*_SYSTEM, *sorted(programs)))
        yield from ((path, landlock.READ) for path in (*_OF_THE_KERNEL, *_named(), *_resources(), self.bounds.inputs))
        devices = (*_DEVICES, *glob.glob("/dev/nvidia*"))
        yield from ((path, landlock.READ | landlock.WRITE_FILE | landlock.IOCTL_DEV) for path in devices)
        yield self.bounds.outputs, landlock.WRITE
        yield self._folder.name, landlock.WRITE | landlock.MAKE_SYM
        if self._log:
            yield os.path.abspath(self._log), landlock.WRITE


def _named() -> Iterator[str]:
    """Folders and files of drivers that environment variables name."""
    for name in _VARIABLES:
        yield from (path for path in os.environ.get(name, "").split(os.pathsep) if os.path.isabs(path))


def _resources() -> Iterator[str]:
    """Where Blender has its own files and the user's extensions, in Blender; its Python package has them beside it."""
    bpy = sys.modules.get("bpy")
    if bpy is not None and not bpy.app.module:
        yield from filter(None, (bpy.utils.resource_path(kind) for kind in ("USER", "SYSTEM", "LOCAL")))
