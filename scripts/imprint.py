#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs Imprint from a checkout: demo, bake, lod, asset, check, farm, gpu, mcp, bench, test and build, with what they need.

This script runs on any Python from 3.9, with only the standard library. It finds a Python 3.13, which Blender's wheel
needs, creates a virtual environment in .venv, and runs each command there.
"""

import signal
import sys

if __name__ == "__main__":
    if sys.version_info < (3, 9):  # noqa: UP036 - it says so, where a later line would only fail
        sys.exit("imprint: Python 3.9 or later has to start this, and this is Python {}.{}".format(*sys.version_info))
    if signal.getsignal(signal.SIGINT) == signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C during the imports ends this without a traceback

import argparse
import contextlib
import ctypes
import errno
import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import tempfile
import threading
import time
from pathlib import Path

try:
    import fcntl
    import resource
except ImportError:  # Windows
    fcntl = resource = None
    import msvcrt

BEGUN = time.time()
DESCRIPTION = "Runs Imprint from a checkout. Sets up what a command needs at its first use."
ROOT = Path(__file__).resolve().parent.parent
SCRIPTS = ROOT / "scripts"
REQUIREMENTS = SCRIPTS / "requirements.txt"

WINDOWS = os.name == "nt"
WANTED = "3.13"
VENV = ROOT / ".venv"
PYTHON = VENV / ("Scripts/python.exe" if WINDOWS else "bin/python")
SITE_PACKAGES = VENV / ("Lib/site-packages" if WINDOWS else f"lib/python{WANTED}/site-packages")
STAMP = VENV / "imprint-stamp"  # written last: an environment without it is incomplete
BYTE_CODE = VENV / "imprint-byte-code"
MARK = "imprint-made"  # a file in each folder that Imprint has made and may empty
GPU_STAMP = VENV / "imprint-gpu"  # has the name of a machine on which Blender's gpu module has started

IS_ROOT = hasattr(os, "geteuid") and os.geteuid() == 0
INSTALL = {"apt-get": "apt-get install --no-install-recommends", "dnf": "dnf install"}
DRIVER = "a working OpenGL driver"
PACKAGES = {  # the system libraries that Blender's wheel needs, and their packages for each installer above
    "libEGL.so.1": ("libegl1", "libglvnd-egl"),
    "libGL.so.1": ("libgl1", "libglvnd-glx"),
    "libICE.so.6": ("libice6", "libICE"),
    "libSM.so.6": ("libsm6", "libSM"),
    "libX11.so.6": ("libx11-6", "libX11"),
    "libXext.so.6": ("libxext6", "libXext"),
    "libXfixes.so.3": ("libxfixes3", "libXfixes"),
    "libXi.so.6": ("libxi6", "libXi"),
    "libXrender.so.1": ("libxrender1", "libXrender"),
    "libxkbcommon.so.0": ("libxkbcommon0", "libxkbcommon"),
    DRIVER: ("libgl1-mesa-dri", "mesa-dri-drivers"),
}
LAVAPIPE = "lavapipe"  # Mesa's Vulkan in software, on which its OpenGL draws later than it is called
VULKAN_DRIVERS = Path("/usr/share/vulkan/icd.d")
FOR_TESTS = {  # the programs that tests start, a driver, and their packages
    "bwrap": ("bubblewrap", "bubblewrap"),
    "clang": ("clang", "clang"),
    "glslangValidator": ("glslang-tools", "glslang"),
    "spirv-cross": ("spirv-cross", ""),
    "spirv-val": ("spirv-tools", "spirv-tools"),
    LAVAPIPE: ("mesa-vulkan-drivers", "mesa-vulkan-drivers"),
}


class Failure(Exception):
    """An error that the user can fix. Its text is the message, in one line."""

    code = 1
    """The exit code."""


class NoGpu(Failure):
    """Blender does not start here. Another machine may have what is missing."""

    code = 3


class NoEnvironment(Failure):
    """The environment is not there and cannot be made here. On another machine it may be."""

    code = 3


def print_message(text, severity="error"):
    """Print a message to standard error. Standard output is for the command."""
    # Names come from files, and must not control the terminal.
    line = "".join(each if each.isprintable() or each == "\n" else "?" for each in f"imprint: {text}")
    if "--progress json" in " ".join(sys.argv).replace("=", " "):
        line = json.dumps({"event": "message", "severity": severity, "text": line})  # as addon/cli/terminal.py
    with contextlib.suppress(OSError):  # for example, a full disk: then there is only the exit code
        print(line, file=sys.stderr, flush=True)


# A Python 3.13


def pyenv_roots():
    """Yield folders that may have pyenv's Pythons. HOME may be another one than when pyenv was installed."""
    if os.environ.get("PYENV_ROOT"):
        yield Path(os.environ["PYENV_ROOT"])
    yield Path(os.path.expanduser("~/.pyenv"))
    command = shutil.which("pyenv")
    if command:
        yield Path(command).resolve().parent.parent


def python_candidates():
    """Yield commands that may start a Python 3.13, in order of preference."""
    yield [sys.executable]
    yield [f"python{WANTED}"]
    if WINDOWS:
        yield ["py", f"-{WANTED}"]
    for root in pyenv_roots():
        for pattern in (f"versions/{WANTED}*/bin/python{WANTED}", f"versions/{WANTED}*/python.exe"):
            yield from ([str(path)] for path in sorted(root.glob(pattern), reverse=True))
    if shutil.which("uv"):
        # Without --system, uv finds .venv itself, which may be replaced.
        find = ["uv", "python", "find", "--system", WANTED]
        yield [subprocess.run(find, capture_output=True, text=True, check=False).stdout.strip()]


def base_python(command):
    """Return the interpreter that a command starts, or None unless it is a Python 3.13 that can create environments.

    This runs the command, because its name is not enough: pyenv has shims for versions that are not installed, Debian has
    ensurepip in another package, Blender's wheel does not load in a free-threaded build, and a virtual environment has a base
    Python.
    """
    program = (
        "import ensurepip, sys, sysconfig, venv\n"
        "if not sysconfig.get_config_var('Py_GIL_DISABLED'):\n"
        "    print('%d.%d' % sys.version_info[:2], sys._base_executable)"
    )
    try:
        answer = subprocess.run([*command, "-c", program], capture_output=True, text=True, check=False)
    except OSError:
        return None
    version, _, path = answer.stdout.strip().partition(" ")
    return path if answer.returncode == 0 and version == WANTED else None


def find_python(candidates):
    """Return the first working Python 3.13 among the candidates."""
    for command in candidates:
        path = base_python(command)
        if path:
            return path
    raise NoEnvironment(
        f"no Python {WANTED} with venv was found, and Blender's wheel needs one: install it, for example with "
        f"'uv python install {WANTED}' or 'apt-get install python{WANTED}-venv', and run this again"
    )


# The environment


def lock(file):
    """Lock the file until it is closed. Waits while another process holds the lock."""
    if fcntl:
        fcntl.flock(file, fcntl.LOCK_EX)
        return
    file.seek(1 << 30)  # far past the end: Windows does not let others read locked bytes
    while True:
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_LOCK, 1)
        except OSError as error:  # the call gives up after ten seconds; creating an environment takes longer
            if error.errno != errno.EDEADLK:
                raise
        else:
            return


def wanted_stamp():
    """Return the stamp's text for an environment that fits the requirements."""
    return f"{WANTED} {hashlib.sha256(REQUIREMENTS.read_bytes()).hexdigest()}\n"


def is_ready():
    """Whether the environment is complete, fits the requirements and still has its Python."""
    return PYTHON.is_file() and STAMP.is_file() and STAMP.read_text() == wanted_stamp()


def check_own(folder, *marks):
    """Fail unless Imprint has made a folder, or nothing is lost in it. What a link leads to belongs to another place.

    marks: the names of other files by which Imprint knows it.
    """
    if os.path.islink(folder):
        kind = f"is a link to {os.readlink(folder)}, which Imprint does not change"
    elif not os.path.lexists(folder):
        return
    elif not os.path.isdir(folder):
        kind = "is no folder"
    else:
        names = os.listdir(folder)
        if not names or not {MARK, *marks}.isdisjoint(names):
            return
        kind = "was not made by Imprint, which does not empty it"
    raise NoEnvironment(f"{folder} {kind}, but the environment has to be there: remove it, or give it another name")


def empty(folder, *marks):
    """Make a folder, or empty one that Imprint has made. Fails as `check_own`, and before anything is changed."""
    check_own(folder, *marks)
    os.makedirs(folder, exist_ok=True)
    mark = Path(folder, MARK)
    mark.write_text("Imprint has made this folder, and may remove what is in it.\n")
    for each in os.scandir(folder):
        if each.is_dir(follow_symlinks=False):
            shutil.rmtree(each.path)
        elif each.name != MARK:
            os.unlink(each.path)


def make_environment():
    """Create .venv. One that was complete for other requirements is updated, and what is incomplete is replaced.

    Only what Imprint has made is changed.
    """
    marks = (STAMP.name, BYTE_CODE.name, GPU_STAMP.name)
    check_own(VENV, *marks)
    quiet = [] if sys.stderr.isatty() else ["--quiet"]
    pip = [str(PYTHON), "-m", "pip", "install", "--disable-pip-version-check", "--no-input", *quiet]
    commands = [[*pip, "-r", str(REQUIREMENTS)]]
    if base_python([str(PYTHON)]) and STAMP.is_file():
        print_message(f"updating {VENV}", "info")
        (VENV / MARK).touch()
        STAMP.unlink()
    else:
        base = find_python(python_candidates())
        print_message(f"setting up {VENV} with {base}: about 500 MB to download, once", "info")
        empty(VENV, *marks)
        commands.insert(0, [base, "-m", "venv", str(VENV)])
    for command in commands:
        if subprocess.call(command, stdout=sys.stderr):
            raise NoEnvironment("the environment could not be set up, for the reason above; the next run starts over")
    STAMP.write_text(wanted_stamp())


def environment():
    """Return the environment's Python. Creates the environment if needed, only once if two processes run at a time."""
    if not is_ready():
        try:
            with open(REQUIREMENTS, "r+b") as file:  # lock a file that always exists, also while .venv is replaced
                lock(file)
                if not is_ready():
                    make_environment()
        except OSError as error:
            if of_another_user(error) and os.path.lexists(VENV):
                raise
            reason = error.strerror or error
            raise NoEnvironment(
                f"there is no complete environment in {VENV}, and none can be made here: {reason}; make it once where you "
                f"may write to {ROOT}, by any command of this script"
            ) from error
    return str(PYTHON)


def of_another_user(error):
    """Return a clause for an environment that another user made and this one may not use, or "" for other errors."""
    path = Path(getattr(error, "filename", None) or os.devnull)
    if not isinstance(error, PermissionError) or not {VENV, REQUIREMENTS}.intersection((path, *path.parents)):
        return ""
    path = Path(os.path.realpath(path))
    closed = next((above for above in reversed(path.parents) if not os.access(above, os.X_OK)), path)
    try:
        owner = closed.owner()
    except (KeyError, OSError, NotImplementedError):  # a user without a name, or Windows
        owner = "another user"
    return (
        f"{closed} belongs to {owner}, and you may not use it, but the environment in {VENV} needs it: ask for the right "
        "to read it, or use a checkout of your own"
    )


def isolate():
    """Forget what the shell says to other Pythons: their modules do not fit the environment's, which has all it needs."""
    for name in ("PYTHONPATH", "PYTHONHOME", "PYTHONOPTIMIZE", "PYTHONPLATLIBDIR", "PYTHONWARNINGS"):
        os.environ.pop(name, None)


# The GPU


def crash(code):
    """Return the signal or exception that ended a process with this exit code, or "" if it exited."""
    if code < 0:
        return f"signal {-code}, {signal.strsignal(-code)}"
    return f"exception {code:#x}" if code >= 0x80000000 else ""  # Windows


def is_loadable(library):
    """Whether the system finds a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError as error:
        return "cannot open shared object" not in str(
            error
        )  # other errors, such as a memory limit, mean that it exists
    return True


def memory_limit():
    """Return a clause about the memory limit of the shell, or "" without one. Drivers crash if the limit is too low."""
    most = resource.getrlimit(resource.RLIMIT_AS)[0] if resource else -1
    unlimited = resource.RLIM_INFINITY if resource else -1
    return "" if most == unlimited else f", with memory limited to {most // 2**20:,} MiB by ulimit -v"


def missing(code, output):
    """Return the missing shared libraries, or the driver, that explain this result of the probe.

    The loader names only the first missing library, and gpu.init() names none, so all libraries are tried.
    """
    if sys.platform != "linux":
        return []
    named = re.findall(r"ImportError: (\S+\.so\S*): cannot open shared object", output)
    absent = sorted({*named, *(name for name in PACKAGES if name != DRIVER and not is_loadable(name))})
    return absent or ([DRIVER] if crash(code) and not memory_limit() else [])


def remedy(absent, installer):
    """Return the command that installs the absent libraries or driver, or [] if it is not known."""
    if not installer:
        return []
    known = {**PACKAGES, **FOR_TESTS}
    packages = sorted(filter(None, (known[name][list(INSTALL).index(installer)] for name in absent if name in known)))
    return [*([] if IS_ROOT else ["sudo"]), *INSTALL[installer].split(), *packages] if packages else []


def explain(absent, command, code, output):
    """Return a message of one line: why Blender cannot start, and how to fix it if that is known."""
    if not absent:
        lines = output.strip().splitlines() or [f"exit code {code}"]
        return f"Blender cannot start: {crash(code) or lines[-1]}{memory_limit()}"
    return f"Blender cannot start: missing {', '.join(absent)}; {how_to_fix(command)}"


def how_to_fix(command):
    """Return a clause with the command that installs what is missing, which may be []."""
    return f"to fix it: {' '.join(command)}" if command else "install the package that provides it"


def probe(python):
    """Start Blender's gpu module in a child process. Returns its exit code and its error output.

    A child process, because gpu.init() crashes with a segmentation fault if there is no usable EGL.
    """
    program = [python, "-c", "import bpy, gpu; gpu.init()"]
    done = subprocess.run(program, capture_output=True, text=True, errors="replace", check=False)
    return done.returncode, done.stderr


def installer():
    """Return the system's installer of packages among those that are known, or None."""
    return next(filter(shutil.which, INSTALL), None)


def install(command, reason, may_install):
    """Run a command that installs packages, if `may_install`, as root on Debian. Returns whether it was run.

    It adds missing packages and upgrades none, because this happens without a question.
    """
    if not (may_install and IS_ROOT and command and command[0] == "apt-get"):
        return False
    print_message(f"{reason}: {' '.join(command)}", "info")
    noninteractive = dict(os.environ, DEBIAN_FRONTEND="noninteractive")
    for step in (["apt-get", "update", "-qq"], [*command, "--no-upgrade", "--yes", "-qq"]):
        subprocess.call(step, stdout=subprocess.DEVNULL, env=noninteractive)
    return True


def require_gpu(python, may_install):
    """Make sure that Blender and its gpu module start. As root on Debian, install missing packages if `may_install`.

    A probe takes a second, so a file records its success on this machine. A crash of Blender removes the file.
    """
    machine = f"{platform.node()} {platform.release()}\n"
    if GPU_STAMP.is_file() and GPU_STAMP.read_text() == machine:
        return
    for is_first in (True, False):
        code, output = probe(python)
        if code == 0:
            with contextlib.suppress(OSError):  # in a container that is read only
                GPU_STAMP.write_text(machine)
            return
        absent = missing(code, output)
        command = remedy(absent, installer())
        if not install(command, f"Blender needs {', '.join(absent)}", is_first and may_install):
            raise NoGpu(explain(absent, command, code, output))


def missing_for_tests():
    """Return what tests need and do not find."""
    absent = [name for name in FOR_TESTS if name != LAVAPIPE and not shutil.which(name)]
    return absent if any(VULKAN_DRIVERS.glob("lvp_icd*.json")) else [*absent, LAVAPIPE]


def require_test_programs():
    """Make sure that tests find the programs that they start, on Linux. Without them, say what to install."""
    absent = missing_for_tests()
    if sys.platform != "linux" or not absent:
        return
    command = remedy(absent, installer())
    if install(command, f"tests need {', '.join(absent)}", may_install=True):
        absent = missing_for_tests()
    if absent:
        print_message(f"tests need {', '.join(absent)}, missing here; {how_to_fix(command)}")


def run_blender(arguments, may_install=False, **options):
    """Run the environment's Python with `arguments`, on a script that uses the GPU. Returns the exit code."""
    python = environment()
    require_gpu(python, may_install)
    code = subprocess.call([python, *arguments], **options)
    if crash(code):
        raise Failure(post_mortem(python, code))
    return code


def post_mortem(python, code, baking=""):
    """Return a message of one line about a crash of Blender. If a probe crashes as well, it says what the machine lacks."""
    crashed = f"Blender crashed with {crash(code)}" + (f" while baking {baking}" if baking else "") + memory_limit()
    if -code == signal.SIGKILL:
        return f"{crashed}: another process killed it, or memory ran out"
    with contextlib.suppress(OSError):
        GPU_STAMP.unlink(missing_ok=True)
    probed, output = probe(python)
    if probed != code:
        return crashed
    absent = missing(probed, output)
    return explain(absent, remedy(absent, installer()), probed, output)


# Stopping


def byte_code():
    """Return environment variables with which Python keeps its byte code in .venv, where it would keep none.

    PYTHONDONTWRITEBYTECODE, which containers set, keeps Python from writing beside the code. Compiling it at each run takes
    half a second. Where .venv cannot be written to, Python reads what is beside the code.
    """
    if not os.environ.get("PYTHONDONTWRITEBYTECODE") or os.environ.get("PYTHONPYCACHEPREFIX"):
        return {}
    if not (os.path.isdir(BYTE_CODE) or os.access(VENV, os.W_OK)):
        return {}
    return {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(BYTE_CODE)}


class Bake:
    """A child process that runs scripts/bake.py in Blender, and stops cleanly when this process gets a signal.

    The child gets another signal than this process. The original signal may have reached the whole process group, and a
    second one would end the bake at once. addon/cli/interruption.py receives the signals in the child.
    """

    STOP = ("SIGINT", "SIGTERM", "SIGHUP")
    PATIENCE = 20.0
    """Seconds from the first signal until this sends a second one. Farms send SIGKILL 30 seconds after the first one. Many
    bakes end sooner by themselves: addon/cli/worker_pool.py."""
    GRACE = 3.0
    """Seconds from the second signal to SIGKILL. Blender may be busy in code that ignores signals."""

    SHOWN = 4096
    """Bytes of what Blender printed that are shown after a crash."""

    def __init__(self, python, arguments):
        self.signals = []
        """The signals received."""
        self._command = [python, str(SCRIPTS / "bake.py"), "--", *arguments]
        self._process = None

    def run(self):
        """Run the bake. Returns its exit code, the name of the object that was being baked when it ended, and what Blender
        printed if it crashed."""
        numbers = [getattr(signal, name) for name in self.STOP if hasattr(signal, name)]
        numbers = [
            number for number in numbers if (number.name, signal.getsignal(number)) != ("SIGHUP", signal.SIG_IGN)
        ]
        before = {number: signal.signal(number, self._receive) for number in numbers}
        try:
            with tempfile.TemporaryFile() as baking, tempfile.TemporaryFile() as output:
                self._start(numbers, baking.fileno(), output.fileno())
                if self._process is None:
                    return 0, "", []
                code = self._process.wait()
                baking.seek(0)
                output.seek(max(0, output.seek(0, os.SEEK_END) - self.SHOWN))
                return code, os.fsdecode(baking.read()), output.read().decode(errors="replace").splitlines()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _start(self, numbers, baking, output):
        """Start Blender, unless this process has received a signal.

        Signals are blocked in the child until it handles them, and in this process until the child exists.
        """
        environment = dict(os.environ, IMPRINT_BEGUN=str(BEGUN), **byte_code())
        if WINDOWS:  # on Windows, Ctrl-C reaches all processes of a console
            self._process = subprocess.Popen(self._command, env=environment)
            return
        environment.update(IMPRINT_LAUNCHER=str(os.getpid()), IMPRINT_BAKING=str(baking), IMPRINT_OUTPUT=str(output))
        blocked = [*numbers, signal.SIGUSR1, signal.SIGUSR2]
        signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
        try:
            if not self.signals:
                self._process = subprocess.Popen(self._command, env=environment, pass_fds=[baking, output])
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, blocked)

    def _receive(self, number, _):
        self.signals.append(number)
        if WINDOWS or self._process is None:
            return
        if len(self.signals) == 1:
            self._process.send_signal(signal.SIGUSR1)
            self._after(self.PATIENCE, self._end)
        else:
            self._end()

    def _end(self):
        self._process.send_signal(signal.SIGUSR2)
        self._after(self.GRACE, self._process.kill)

    def _after(self, seconds, act):
        waiting = threading.Timer(seconds, act)
        waiting.daemon = True
        waiting.start()


# The commands


def demo(options):
    """Bake the example."""
    return run_blender([str(SCRIPTS / "demo.py"), *options.rest], may_install=True)


def bench(options):
    """Compare Imprint with other bakers, with Blender's factory settings instead of the user's."""
    with tempfile.TemporaryDirectory(prefix="imprint-bench-") as profile:
        variables = dict(os.environ, BLENDER_USER_RESOURCES=profile)
        return run_blender([str(SCRIPTS / "bench" / "run.py"), *options.rest], env=variables)


def bake(options):
    """Bake with scripts/bake.py, or run another of its commands that need Blender. It gets its arguments after "--", as inside
    Blender."""
    python = environment()
    require_gpu(python, may_install=False)
    running = Bake(python, [*([] if options.command == "bake" else [options.command]), *options.rest])
    code, baking, output = running.run()
    if running.signals:
        return 128 + running.signals[0]
    if crash(code):
        for line in filter(str.strip, output):
            print_message(f"Blender: {line.strip()}", "info")
        raise Failure(post_mortem(python, code, baking))
    return code


def without_blender(options):
    """Run a command of scripts/bake.py that starts no Blender."""
    return subprocess.call([environment(), str(SCRIPTS / "bake.py"), "--", options.command, *options.rest])


def cores():
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def test(options):
    """Run ruff and then pytest, even if ruff fails, with Blender's factory settings instead of the user's.

    The tests run in processes of their own, each with a GPU context. Mesa's software drivers would start a thread for each
    core in each of them, so that the cores are divided among the processes.
    """
    parser = argparse.ArgumentParser(
        prog="imprint.py test",
        usage="%(prog)s [-h] [--all] [-n PROCESSES] [ARGUMENT ...]",
        description="Run ruff, then the fast tests. Other arguments are for pytest.",
        epilog="tests/pure needs no Blender: any Python from 3.11 with numpy and pytest runs python -m pytest tests/pure",
        allow_abbrev=False,
    )
    parser.add_argument("--all", action="store_true", help="run the slow tests as well")
    processes_help = "run the tests in so many processes; 0 for one without pytest-xdist (default: one for each core)"
    parser.add_argument("-n", dest="processes", metavar="PROCESSES", type=int, default=cores(), help=processes_help)
    known, rest = parser.parse_known_args(options.rest)
    lane = [] if known.all else ["-m", "not slow"]
    parallel = ["-n", str(known.processes), "--dist", "loadfile", "--no-loadscope-reorder"]  # see tests/conftest.py
    threads = max(1, cores() // max(1, known.processes))
    linted = subprocess.call([environment(), "-m", "ruff", "check"], cwd=ROOT)
    require_test_programs()
    with tempfile.TemporaryDirectory(prefix="imprint-test-") as profile:
        variables = {"LP_NUM_THREADS": str(threads), **os.environ, **byte_code(), "BLENDER_USER_RESOURCES": profile}
        pytest = ["-m", "pytest", *parallel, *lane, *rest]
        tested = run_blender(pytest, may_install=True, cwd=ROOT, env=variables)
    return tested or linted


def build_zip(python, site_packages, source, output):
    """Build the extension from a source folder with Blender's own tool, validate it, and return the path of the zip."""
    scripts = next(site_packages.glob("bpy/*/scripts"))
    tool = [python, str(scripts / "addons_core/bl_pkg/cli/blender_ext.py")]
    tags = ["--valid-tags", str(scripts / "modules/_bpy_internal/extensions/tags.py")]

    def run(*arguments):
        done = subprocess.run([*tool, *arguments, *tags], capture_output=True, text=True, check=False)
        if done.returncode:
            raise Failure(f"the extension could not be built: {(done.stdout + done.stderr).strip()}")
        return done.stdout

    output.mkdir(parents=True, exist_ok=True)
    built = run("build", "--source-dir", str(source), "--output-dir", str(output))
    archive = Path(re.search(r'created: "(.+)", \d+', built).group(1))
    run("validate", str(archive))
    return archive


def build(options):
    """Build the extension's zip and print its path."""
    print(build_zip(environment(), SITE_PACKAGES, ROOT, Path(options.output).resolve()))
    return 0


def version():
    """Print the versions, of Blender's Python package too if the environment is there."""
    if is_ready():
        return subprocess.call([str(PYTHON), str(SCRIPTS / "bake.py"), "--", "--version"])
    manifest = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    found = re.search('^version = "(.+)"$', manifest, re.MULTILINE)
    print(f"Imprint {found.group(1)}")
    return 0


COMMANDS = {
    "demo": (demo, "bake the example"),
    "bake": (bake, "bake a normal map; see bake --help"),
    "lod": (bake, "make levels of detail of a mesh; see lod --help"),
    "asset": (bake, "make a game asset of high meshes: a low mesh with UVs and maps; see asset --help"),
    "check": (bake, "say what the high mesh of a bake is, and what will be changed of it; takes the options of bake"),
    "farm": (without_blender, "send a job file to a farm; see farm --help"),
    "gpu": (bake, "test the GPU and its driver; see gpu --help"),
    "report": (without_blender, "put the reports of several machines together; see report --help"),
    "mcp": (without_blender, "serve agents by the Model Context Protocol; see mcp --help"),
    "bench": (bench, "compare Imprint with other bakers, and write a report; see bench --help"),
    "test": (test, "run ruff and the tests; see test --help"),
}
"""What each command runs, and its help. The scripts behind them parse their own options, --help included."""


def parse(arguments):
    """Return the options."""
    parser = argparse.ArgumentParser(prog="imprint.py", description=DESCRIPTION)
    parser.add_argument("--version", action="store_true", help="print the versions of Imprint and of Blender")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (run, text) in COMMANDS.items():
        commands.add_parser(name, help=text, add_help=False).set_defaults(run=run)
    building = commands.add_parser("build", help="make the extension's zip and print its path")
    building.add_argument("--output", metavar="DIR", default=ROOT / "dist", help="folder for the zip (default: dist)")
    building.set_defaults(run=build)
    passes_on = bool(arguments) and arguments[0] in COMMANDS
    options = parser.parse_args(arguments[:1] if passes_on else arguments)
    options.rest = arguments[1:] if passes_on else []
    return options


def main(arguments):
    """Run a command and return its exit code."""
    try:
        if arguments[:1] == ["--version"]:
            return version()
        options = parse(arguments)
        return options.run(options)
    except (Failure, OSError) as failure:  # the user can also fix, for example, a folder without write permission
        print_message(of_another_user(failure) or failure)
        return getattr(failure, "code", 1)
    except KeyboardInterrupt:
        return 130


def reserve_streams():
    """Open closed standard streams. Otherwise a new file could get the number of a stream, and output would go into it."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # open() takes the smallest free number
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - stays open until the process ends


def end_on_signals():
    """Exit cleanly on SIGTERM and SIGHUP, as on Ctrl-C: end child processes and remove temporary folders."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)):
        if signal.getsignal(number) == signal.SIG_DFL:  # nohup makes a process ignore SIGHUP
            signal.signal(number, lambda number, _: sys.exit(128 + number))


if __name__ == "__main__":
    reserve_streams()
    isolate()
    end_on_signals()
    sys.exit(main(sys.argv[1:]))
