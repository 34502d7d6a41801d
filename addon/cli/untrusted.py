# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes of files that are not trusted: the folders that they keep to, and the sandbox of their workers.

Names are checked before a file is opened. The sandbox is one command line of bubblewrap (bwrap), the sandbox of Flatpak.
"""

import argparse
import glob
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..core import naming, udim
from ..core.errors import WrongPlace
from ..core.naming import printable
from ..output.atomic_file import make_folder
from . import arguments, system_calls
from .options import RunOptions

OUTPUT = "out"
"""The folder beside a job file that its bakes write to, unless the caller names one."""
LARGEST_JOB_FILE = 1 << 26
"""Of a job file."""
MOST_READ = 32 << 30
"""Bytes of a file, which may have holes that take no place on the disk."""
MOST_FILES = 1_000_000
"""Maps that a run may name: bakes times frames."""
_PLACEHOLDER = re.compile("|".join(map(re.escape, (naming.LOW, naming.NAME, naming.MATERIAL, udim.TOKEN))) + "|#+")


@dataclass(frozen=True)
class Bounds:
    """The folder that is read, and the one that is written, as absolute paths without links."""

    inputs: str
    """The folder that is read."""
    outputs: str
    """The folder that is written."""
    spelled: tuple[str, ...] = ()
    """The same folders as the caller named them, as absolute paths that may lead over links."""

    def check_read(self, path: str, title: str) -> None:
        """Raise WrongPlace unless `path` is in the input folder, or in the output folder, after its links. title: the file, for
        messages."""
        _check_name(path, title)
        for each in _with_tiles(path):
            real = os.path.realpath(each)
            if not (is_below(real, self.inputs) or is_below(real, self.outputs)):
                raise WrongPlace(self._not_read(path, title))
            _check_file(each, title)

    def check_write(self, path: str, title: str) -> None:
        """Raise WrongPlace unless `path` is in the output folder, after its links, and is itself none. title: the file, for
        messages."""
        _check_name(path, title)
        for each in _with_tiles(path):
            if not is_below(os.path.realpath(each), self.outputs):
                raise WrongPlace(
                    f"{_subject(title)}, {path!r}, is not in {self.outputs!r}, the only folder that --untrusted writes to: "
                    "choose a path there, or name another one with --output-folder."
                )
            if os.path.islink(each):
                raise WrongPlace(
                    f"{_subject(title)}, {path!r}, is a link, which --untrusted does not follow: remove it."
                )

    def may_read(self, path: str) -> bool:
        """Whether `path` is a file in one of the folders, or nothing is there."""
        return _passes(self.check_read, path)

    def may_write(self, path: str) -> bool:
        """Whether `path` is in the output folder, and a file if it exists."""
        return _passes(self.check_write, path) and _passes(_check_file, path)

    def check_sets(self, sets: Sequence[argparse.Namespace]) -> None:
        """Raise WrongPlace for folders of pairs elsewhere, and for more maps than a run with untrusted files may name."""
        for options in filter(arguments.is_folder, sets):
            if not is_below(os.path.realpath(options.pairs), self.inputs):
                raise WrongPlace(self._not_read(options.pairs, "the folder of pairs"))
        count = sum(each.frames[1] - each.frames[0] + 1 if each.frames else 1 for each in sets)
        if count > MOST_FILES:
            raise WrongPlace(
                f"{count:,} maps are more than {MOST_FILES:,}, the most that --untrusted plans: divide the job."
            )

    def _not_read(self, path: str, title: str) -> str:
        return (
            f"{_subject(title)}, {path!r}, is not in {self.inputs!r}, the only folder that --untrusted reads: move it "
            "there, or name another one with --input-folder."
        )

    def make(self) -> None:
        """Make the output folder. Raises WrongPlace."""
        try:
            make_folder(Path(self.outputs))
        except OSError as error:
            raise WrongPlace(f"The folder {self.outputs!r} cannot be made: {error.strerror}.") from error


def bounds_of(options: RunOptions, first: argparse.Namespace) -> Bounds | None:
    """The bounds of a run whose files are not trusted; None for others. Raises WrongPlace.

    Args:
        first: The options of the first bake, by whose files the folders are chosen where there is no job file.
    """
    if not options.untrusted:
        return None
    if options.jobs:
        folder = os.path.dirname(os.path.abspath(options.jobs))
        inputs, outputs = folder, os.path.join(folder, OUTPUT)
    else:
        inputs = options.folder or os.path.dirname(os.path.abspath(next(iter(first.file), first.low_file)))
        outputs = fixed_folder(os.path.abspath(first.output))
    named = options.input_folder or inputs
    inputs = os.path.realpath(named)
    if not os.path.isdir(inputs):
        raise WrongPlace(f"There is no folder {inputs!r}.")
    outputs = options.output_folder or outputs
    for path in (
        outputs,
        options.report,
        options.report and f"{options.report}.lines",
        options.log,
        options.sheet,
        options.pictures,
        options.records,
    ):
        if path:
            _check_links(path, inputs)
    spelled = os.path.abspath(named), os.path.abspath(outputs)
    outputs = os.path.realpath(outputs)
    _check_records(options.records, (inputs, outputs, options.log and os.path.realpath(options.log)))
    return Bounds(inputs, outputs, spelled)


def fixed_folder(path: str) -> str:
    """The folder of a path, up to the first placeholder in it."""
    return os.path.dirname(_PLACEHOLDER.split(path)[0])


def check_job_file(name: str) -> None:
    """Raise WrongPlace for a job file that is too large, or no file. One that is missing is left to its reader."""
    _check_file(name, "the job file")
    if os.path.exists(name) and os.path.getsize(name) > LARGEST_JOB_FILE:
        raise WrongPlace(
            f"{name!r} has more than {LARGEST_JOB_FILE >> 20} MiB, the most that --untrusted reads as a job file."
        )


def _check_records(path: str | None, folders: Sequence[str | None]) -> None:
    """Raise WrongPlace if the records would be where files of others are, or where these can write."""
    for folder in filter(None, folders):
        if path and is_below(os.path.realpath(path), folder):
            raise WrongPlace(
                f"--records: {path!r} is in {folder!r}, where untrusted files can be: name a folder elsewhere."
            )


def _check_links(path: str, inputs: str) -> None:
    """Raise WrongPlace if a path of the caller leads out of the input folder by a link there, which came with the files."""
    path = os.path.abspath(path)
    for each in (path, *map(str, Path(path).parents)):
        is_inside = is_below(os.path.realpath(os.path.dirname(each)), inputs)
        if is_inside and os.path.islink(each) and not is_below(os.path.realpath(each), inputs):
            raise WrongPlace(
                f"{each!r} is a link out of {inputs!r}, the folder of the untrusted files: choose another path."
            )


def _passes(check: Callable[[str, str], None], path: str) -> bool:
    try:
        check(path, "the file")
    except WrongPlace:
        return False
    return True


def is_below(path: str, folder: str) -> bool:
    """Whether a path is in a folder. Both are absolute and without links."""
    return Path(path).is_relative_to(folder)


def _check_name(path: str, title: str) -> None:
    """Raise WrongPlace for what the system does not take as a path: a process that lies can name anything."""
    try:
        is_path = "\0" not in os.fsdecode(os.fsencode(path))
    except UnicodeError:
        is_path = False
    if not is_path:
        raise WrongPlace(f"{_subject(title)}, {path!r}, is not a path of this system.")


def _with_tiles(path: str) -> Iterator[str]:
    """The path, and those of the tiles that it stands for and that exist."""
    yield path
    if udim.is_tiled(path):
        yield from udim.files(path).values()


def _check_file(path: str, title: str) -> None:
    """Raise WrongPlace for pipes, devices and folders, whose opening may never return, and for a file that takes very long to
    read. What is missing is left to its reader."""
    try:
        state = os.stat(path)
    except (OSError, ValueError):
        return
    if not stat.S_ISREG(state.st_mode):
        raise WrongPlace(f"{_subject(title)}, {path!r}, is not a file.")
    if state.st_size > MOST_READ:
        raise WrongPlace(
            f"{_subject(title)}, {path!r}, has more than {MOST_READ >> 30} GiB, the most that --untrusted reads."
        )


def _subject(title: str) -> str:
    return title[:1].upper() + title[1:]


try:
    import resource
except ImportError:  # Windows
    resource = None

MOST_SECONDS = 3600.0
"""The time limit of a bake, unless the caller sets another one."""
MOST_MEMORY = 16 << 30
"""The memory limit of a worker, unless the caller sets another one, and at most three quarters of the machine's memory."""
LARGEST_FILE = 32 << 30
"""The largest file that a worker may write. A map of 32768 x 32768 texels with four channels of 32 bits has half of it."""
MOST_OPEN = 4096
"""The files that a worker may have open."""
MOST_PROCESSES = 4096
"""The processes and threads that a worker may have. Blender and its drivers have a few for each core."""
TRIAL = 60.0
"""Seconds that the trial of the sandbox may take."""
ROOT = str(Path(__file__).resolve().parents[2])
_SYSTEM = (
    *("/usr", "/lib", "/lib32", "/lib64", "/bin", "/sbin", "/opt", "/nix/store", "/run/opengl-driver"),
    *("/sys/bus", "/sys/class", "/sys/dev", "/sys/devices", "/sys/module"),
    *("/etc/ld.so.cache", "/etc/ld.so.conf", "/etc/ld.so.conf.d", "/etc/alternatives", "/etc/glvnd", "/etc/egl"),
    *("/etc/drirc", "/etc/vulkan", "/etc/OpenCL", "/etc/fonts", "/etc/localtime", "/etc/nsswitch.conf", "/etc/nvidia"),
)
"""Programs, libraries and drivers, which the worker may read and execute."""
_DEVICES = ("/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom")
_GPUS = (
    *("/dev/dri/renderD*", "/dev/kfd", "/dev/dxg", "/dev/nvidia[0-9]*", "/dev/nvidiactl", "/dev/nvidia-modeset"),
    *("/dev/nvidia-uvm", "/dev/nvidia-uvm-tools", "/dev/nvidia-caps/nvidia-cap[3-9]*"),
    "/dev/nvidia-caps/nvidia-cap[12][0-9]*",
)
"""Devices that draw and compute. Others beside them set screens, and root divides GPUs by them."""
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
_LOOK = """
import os, socket, sys
for path in "/", "/proc", "/proc/sys", "/dev", "/sys":
    if not os.statvfs(path).f_flag & os.ST_RDONLY:
        sys.exit(f"{path} can be written to in it")
os.fstat(int(sys.argv[1]))
try:
    socket.socket(socket.AF_UNIX)
except PermissionError:
    sys.exit(0)
sys.exit("it lets sockets through")
"""
"""The program that looks at the sandbox before anything else runs there."""
_INSTEAD = "bake each job in a container of its own, as the manual's page about farms shows"


def most_memory() -> int:
    """The default memory limit of a worker, in bytes."""
    try:
        return min(MOST_MEMORY, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") * 3 // 4)
    except (AttributeError, ValueError, OSError):  # Windows
        return MOST_MEMORY


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
        if not system_calls.known():
            raise WrongPlace(f"--untrusted needs a machine with x86_64 or aarch64: {_INSTEAD}.")
        for program, package in (("bwrap", "bubblewrap"), ("prlimit", "util-linux"), ("choom", "util-linux")):
            if shutil.which(program) is None:
                raise WrongPlace(f"--untrusted needs {program}: install the package {package}, or {_INSTEAD}.")
        bounds.make()
        if log:
            make_folder(Path(log).absolute())
        self._folder = tempfile.TemporaryDirectory(prefix="imprint-untrusted-")
        self._shared, self._calls = (os.path.join(self._folder.name, name) for name in ("shared", "calls"))
        os.mkdir(self._shared)
        Path(self._calls).write_bytes(system_calls.program())
        self._scope = _scope(memory)
        problem = self._try()
        if problem and self._scope:  # systemd may have no session for this user
            self._scope = ()
            problem = self._try()
        if problem:
            self.close()
            raise WrongPlace(f"--untrusted needs bubblewrap, which may not run here ({problem}): {_INSTEAD}.")

    @property
    def folders(self) -> tuple[str, ...]:
        """The folders that the bakes may read."""
        return self.bounds.inputs, self.bounds.outputs

    def close(self) -> None:
        """Remove the temporary files."""
        self._folder.cleanup()

    def command(self, words: Sequence[str], taken: int = -1) -> list[str]:
        """The command that runs `words` in the sandbox: no network, no other processes, and no files but those named here.

        taken: a file descriptor that the command inherits.
        """
        here = os.getcwd()
        number = 8 if taken == 9 else 9  # shells know those of one digit
        writable = list(self._writable())
        readable = [path for path in self._readable(words) if not _is_in(path, writable)]
        return [
            *self._scope,
            *("/bin/sh", "-c", f'exec "$@" {number}< "$0"', self._calls),
            *("choom", "--adjust", "1000", "--"),  # if the machine's memory runs out, this process ends first
            *("prlimit", "--core=0", f"--fsize={_lowered('FSIZE', LARGEST_FILE)}"),
            *(f"--nofile={_lowered('NOFILE', MOST_OPEN)}", f"--data={_lowered('DATA', 2 * self._memory)}"),
            *("bwrap", "--unshare-all", "--die-with-parent", "--new-session", "--cap-drop", "ALL"),
            *("--seccomp", str(number)),
            *(word for name in _OF_SYSTEMD for word in ("--unsetenv", name)),
            *("--dir", "/tmp", "--dir", here),
            *(word for link, path in self._links([*readable, *writable]).items() for word in ("--symlink", path, link)),
            *(word for path in readable for word in ("--ro-bind-try", path, path)),
            *("--proc", "/proc", "--remount-ro", "/proc", "--dir", "/dev/shm"),  # root may write there
            *(word for name in ("fd", "stdin", "stdout", "stderr") for word in _standard_link(name)),
            *(word for path in (*_DEVICES, *_gpus()) for word in ("--dev-bind-try", path, path)),
            *(word for path in writable for word in ("--bind", path, path)),
            *("--remount-ro", "/"),  # else files there would take memory without limit
            *("--chdir", here, "--"),
            *("prlimit", f"--nproc={_lowered('NPROC', MOST_PROCESSES)}", "--", *words),  # here, where no others count
        ]

    def environment(self) -> dict[str, str]:
        """The environment variables of the sandbox. Compiled shaders are kept in the temporary folder."""
        given = (*_VARIABLES, *(_OF_SYSTEMD if self._scope else ()))
        kept = {name: value for name, value in os.environ.items() if name.startswith(given)}
        names = ("TMPDIR", "TMP", "TEMP", "XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR", "__GL_SHADER_DISK_CACHE_PATH")
        return {**kept, **dict.fromkeys(names, self._shared), "PYTHONDONTWRITEBYTECODE": "1"}

    def _try(self) -> str:
        """Run a program in the sandbox that looks at it. Returns what is wrong, or ""."""
        own, inherited = os.pipe()
        words = self.command([sys.executable, "-I", "-S", "-c", _LOOK, str(inherited)], inherited)
        try:
            done = subprocess.run(
                words,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                env=self.environment(),
                check=False,
                timeout=TRIAL,
                pass_fds=[inherited],
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return printable(str(error))
        finally:
            os.close(own)
            os.close(inherited)
        lines = done.stderr.decode(errors="replace").split("\n")
        return printable(next(filter(None, lines), f"exit code {done.returncode}")) if done.returncode else ""

    def _writable(self) -> Iterator[str]:
        """The folders that the worker may write to, without those in another one of them."""
        folders = [self.bounds.outputs, os.path.realpath(self._shared)]
        folders += [os.path.realpath(self._log)] if self._log else []
        for place, path in enumerate(folders):
            if not _is_in(path, [*folders[:place], *(each for each in folders[place + 1 :] if each != path)]):
                yield path

    def _readable(self, words: Sequence[str]) -> Iterator[str]:
        """The files and folders that the worker may read. words: as in `command`."""
        yield from _SYSTEM
        of_python = {sys.prefix, sys.base_prefix, sys.exec_prefix, os.path.dirname(os.path.realpath(words[0]))}
        yield from sorted(of_python | set(map(os.path.realpath, of_python)))  # .venv can be a link in the checkout
        yield ROOT
        for name in _PATHS_OF_DRIVERS:
            yield from (path for path in os.environ.get(name, "").split(os.pathsep) if os.path.isabs(path))
        yield from _resources()
        yield self.bounds.inputs

    def _links(self, folders: Sequence[str]) -> dict[str, str]:
        """The symbolic links outside `folders` by which paths lead into them, and what they lead to."""
        given = (*self.bounds.spelled, os.path.abspath(self._log or "."), self._shared, sys.executable)
        return {link: path for each in given for link, path in _links_of(each) if not _is_in(link, folders)}


def processes_in(number: int) -> list[int]:
    """The processes in the sandbox that the process `number` waits for: first its init, then the command, then others."""
    numbers, places = [], [number]
    while places:
        place = places.pop(0)
        with suppress(OSError, ValueError):
            children = Path(f"/proc/{place}/task/{place}/children").read_text(encoding="ascii").split()
            numbers += map(int, children)
            places += map(int, children)
    return numbers


_SYSTEMD = "systemd-run"
_OF_SYSTEMD = ("XDG_RUNTIME_DIR", "DBUS_SESSION_BUS_ADDRESS")
"""Environment variables by which systemd-run finds the user's systemd. What it starts does not get them."""


def _scope(memory: int) -> tuple[str, ...]:
    """The words before a command that limit all its memory and its processes by a cgroup; none where systemd does not run.

    memory: the memory limit of a worker, in bytes. What its processes have in use is looked at as well, and is less.
    """
    if not (os.path.isdir("/run/systemd/system") and shutil.which(_SYSTEMD)):
        return ()
    limits = {"MemoryMax": memory + memory // 8, "MemorySwapMax": 0, "TasksMax": MOST_PROCESSES}
    whose = ["--user"] if os.getuid() else []
    properties = (word for name, value in limits.items() for word in ("-p", f"{name}={value}"))
    return _SYSTEMD, *whose, "--scope", "--quiet", "--collect", *properties, "--"


def _gpus() -> list[str]:
    return [path for pattern in _GPUS for path in sorted(glob.glob(pattern))]


def _standard_link(name: str) -> tuple[str, str, str]:
    """The words that make a link in /dev to the descriptors of each process, or to one of them."""
    numbers = {"fd": "", "stdin": "/0", "stdout": "/1", "stderr": "/2"}
    return "--symlink", f"/proc/self/fd{numbers[name]}", f"/dev/{name}"


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
