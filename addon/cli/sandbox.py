# SPDX-License-Identifier: GPL-3.0-or-later
"""The sandbox of the workers that bake untrusted files: one command line of bubblewrap (bwrap), the sandbox of Flatpak."""

import glob
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from ..core.errors import WrongPlace
from ..core.naming import printable
from ..output.atomic_file import make_folder
from .bounds import Bounds, is_below

try:
    import resource
except ImportError:  # Windows
    resource = None

MOST_SECONDS = 3600.0
"""The time limit of a bake, unless the caller sets another one."""
BYTES = 16 << 30
"""The memory limit of a worker, unless the caller sets another one, and at most three quarters of the machine's memory."""
MOST_BYTES = 32 << 30
"""The largest file that a worker may write. A map of 32768 x 32768 texels with four channels of 32 bits has half of it."""
MOST_OPEN = 4096
"""The files that a worker may have open."""
TRIAL = 60.0
"""Seconds that the trial of the sandbox may take."""
ROOT = str(Path(__file__).resolve().parents[2])
_SYSTEM = (
    *("/usr", "/lib", "/lib32", "/lib64", "/bin", "/sbin", "/opt", "/nix/store", "/run/opengl-driver", "/sys"),
    *("/etc/ld.so.cache", "/etc/ld.so.conf", "/etc/ld.so.conf.d", "/etc/alternatives", "/etc/glvnd", "/etc/egl"),
    *("/etc/drirc", "/etc/vulkan", "/etc/OpenCL", "/etc/fonts", "/etc/localtime", "/etc/nsswitch.conf", "/etc/nvidia"),
)
"""Programs, libraries and drivers, which the worker may read and execute."""
_DEVICES = ("/dev/dri", "/dev/kfd", "/dev/dxg")
"""GPUs, beside those of NVIDIA, which have numbers."""
_PATHS_OF_DRIVERS = (
    *("LD_LIBRARY_PATH", "LIBGL_DRIVERS_PATH", "GBM_BACKENDS_PATH", "VK_DRIVER_FILES", "VK_ICD_FILENAMES"),
    *("__EGL_VENDOR_LIBRARY_DIRS", "__EGL_VENDOR_LIBRARY_FILENAMES"),
)
"""Environment variables with further files and folders of drivers."""
_VARIABLES = (
    *("HOME", "LANG", "LC_", "PATH", "PYTHON", "TZ", "BLENDER_", "IMPRINT_", "LD_LIBRARY_PATH", "OMP_", "OPENBLAS_"),
    *("AMD_", "CUDA_", "DRI_", "EGL_", "GALLIUM_", "GBM_", "HIP_", "HSA_", "INTEL_", "LIBGL_", "LP_", "MESA_"),
    *("NVIDIA_", "RADV_", "ROCR_", "VK_", "ZINK_", "__EGL_", "__GLX_", "__GL_", "__NV_"),
)
"""The starts of the names of environment variables that the worker gets: those of Blender, Python and drivers."""
_INSTEAD = "bake each job in a container of its own, as the manual's page about farms shows"


def most_memory() -> int:
    """The default memory limit of a worker, in bytes."""
    try:
        return min(BYTES, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") * 3 // 4)
    except (AttributeError, ValueError, OSError):  # Windows
        return BYTES


class Sandbox:
    """What the workers of a run may do. They share a folder for temporary files, which `close` removes."""

    def __init__(self, bounds: Bounds, memory: int, log: str | None = None):
        """Make the folders, and try the sandbox.

        Args:
            bounds: The input and the output folder.
            memory: The memory limit of a worker, in bytes.
            log: The folder for logs.

        Raises BakeError, and WrongPlace where bubblewrap is missing or may not run.
        """
        self.bounds, self._memory, self._log = bounds, memory, log
        if sys.platform != "linux":
            raise WrongPlace(f"--untrusted needs bubblewrap, which exists on Linux alone: {_INSTEAD}.")
        for program, package in (("bwrap", "bubblewrap"), ("prlimit", "util-linux"), ("choom", "util-linux")):
            if shutil.which(program) is None:
                raise WrongPlace(f"--untrusted needs {program}: install the package {package}, or {_INSTEAD}.")
        bounds.make()
        if log:
            make_folder(Path(log).absolute())
        self._folder = tempfile.TemporaryDirectory(prefix="imprint-untrusted-")
        if problem := self._try():
            self.close()
            raise WrongPlace(f"--untrusted needs bubblewrap, which may not run here ({problem}): {_INSTEAD}.")

    @property
    def folders(self) -> tuple[str, ...]:
        """The folders that the bakes may read."""
        return self.bounds.inputs, self.bounds.outputs

    def close(self) -> None:
        """Remove the temporary files."""
        self._folder.cleanup()

    def command(self, words: Sequence[str]) -> list[str]:
        """The command that runs `words` in the sandbox: no network, no other processes, and no files but those named here."""
        here = os.getcwd()
        writable = list(self._writable())
        readable = [path for path in self._readable(words) if not _is_in(path, writable)]
        return [
            *("choom", "--adjust", "1000", "--"),  # if the machine's memory runs out, this process ends first
            *("prlimit", "--core=0", f"--fsize={_lowered('FSIZE', MOST_BYTES)}"),
            *(f"--nofile={_lowered('NOFILE', MOST_OPEN)}", f"--data={_lowered('DATA', 2 * self._memory)}"),
            *("bwrap", "--unshare-all", "--die-with-parent", "--new-session", "--cap-drop", "ALL"),
            *("--dir", "/tmp", "--dir", here),
            *(word for link, path in self._links([*readable, *writable]).items() for word in ("--symlink", path, link)),
            *(word for path in readable for word in ("--ro-bind-try", path, path)),
            *("--proc", "/proc", "--dev", "/dev"),
            *(word for path in (*_DEVICES, *glob.glob("/dev/nvidia*")) for word in ("--dev-bind-try", path, path)),
            *(word for path in writable for word in ("--bind", path, path)),
            *("--remount-ro", "/dev", "--remount-ro", "/"),  # else files there would take memory without limit
            *("--chdir", here, "--", *words),
        ]

    def environment(self) -> dict[str, str]:
        """The environment variables of the sandbox. Compiled shaders are kept in the temporary folder."""
        kept = {name: value for name, value in os.environ.items() if name.startswith(_VARIABLES)}
        names = ("TMPDIR", "TMP", "TEMP", "XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR", "__GL_SHADER_DISK_CACHE_PATH")
        return {**kept, **dict.fromkeys(names, self._folder.name), "PYTHONDONTWRITEBYTECODE": "1"}

    def _try(self) -> str:
        """Run a program in the sandbox that does nothing. Returns why that fails, or ""."""
        words = self.command([sys.executable, "-I", "-S", "-c", ""])
        try:
            done = subprocess.run(
                words,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                env=self.environment(),
                check=False,
                timeout=TRIAL,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return printable(str(error))
        lines = done.stderr.decode(errors="replace").split("\n")
        return printable(next(filter(None, lines), f"exit code {done.returncode}")) if done.returncode else ""

    def _writable(self) -> Iterator[str]:
        """The folders that the worker may write to, without those in another one of them."""
        folders = [self.bounds.outputs, os.path.realpath(self._folder.name)]
        folders += [os.path.realpath(self._log)] if self._log else []
        for place, path in enumerate(folders):
            if not _is_in(path, [*folders[:place], *(each for each in folders[place + 1 :] if each != path)]):
                yield path

    def _readable(self, words: Sequence[str]) -> Iterator[str]:
        """The files and folders that the worker may read. words: as in `command`."""
        yield from _SYSTEM
        yield from sorted({sys.prefix, sys.base_prefix, sys.exec_prefix, os.path.dirname(os.path.realpath(words[0]))})
        yield ROOT
        for name in _PATHS_OF_DRIVERS:
            yield from (path for path in os.environ.get(name, "").split(os.pathsep) if os.path.isabs(path))
        yield from _resources()
        yield self.bounds.inputs

    def _links(self, folders: Sequence[str]) -> dict[str, str]:
        """The symbolic links outside `folders` by which paths lead into them, and what they lead to."""
        given = (*self.bounds.spelled, os.path.abspath(self._log or "."), self._folder.name, sys.executable)
        return {link: path for each in given for link, path in _links_of(each) if not _is_in(link, folders)}


def processes_in(number: int) -> list[int]:
    """The processes in the sandbox that the process `number` waits for: first its init, then the command, then others."""
    found, places = [], [number]
    while places:
        place = places.pop(0)
        with suppress(OSError, ValueError):
            children = Path(f"/proc/{place}/task/{place}/children").read_text(encoding="ascii").split()
            found += map(int, children)
            places += map(int, children)
    return found


def _is_in(path: str, folders: Iterable[str]) -> bool:
    return any(is_below(path, folder) for folder in folders)


def _links_of(path: str) -> Iterator[tuple[str, str]]:
    """The symbolic links on the way to an absolute path, and the paths that they lead to."""
    place = "/"
    for name in Path(path).parts[1:]:
        place = os.path.join(place, name)
        if os.path.islink(place):
            real = os.path.realpath(place)
            yield place, real
            place = real


def _lowered(name: str, most: int) -> int:
    """A limit of processes: `most`, or what it is already if that is lower."""
    _, hard = resource.getrlimit(getattr(resource, f"RLIMIT_{name}"))
    return most if hard == resource.RLIM_INFINITY else min(most, hard)


def _resources() -> Iterator[str]:
    """Where Blender has its own files and the user's extensions, in Blender; its Python package has them beside it."""
    bpy = sys.modules.get("bpy")
    if bpy is not None and not bpy.app.module:
        yield from filter(None, (bpy.utils.resource_path(kind) for kind in ("USER", "SYSTEM", "LOCAL")))
