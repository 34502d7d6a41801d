#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds the zip with a Blender's own command line, installs it into an empty profile, and bakes with it, on any system.

    python3 scripts/dev/in_blender.py 4.5.15 [--backend vulkan] [--folder out/blenders]
    python3 scripts/dev/in_blender.py newest
    python3 scripts/dev/in_blender.py --blender "blender"

A version is downloaded from Blender's releases into --folder, once, and compared with the published SHA-256. --blender is a
command that starts another one; it may have arguments of its own. --mesa adds Mesa's OpenGL on Windows, from MSYS2. On a
Debian or Ubuntu, root also gets the packages that a download needs. Ends with 1 if a step fails, or if the bake used another
backend than --backend.
"""

import argparse
import hashlib
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import tempfile
import urllib.request
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from scripts import imprint  # noqa: E402

RELEASES = "https://download.blender.org/release"
ENDINGS = {"linux": "linux-x64.tar.xz", "darwin": "macos-arm64.dmg", "win32": "windows-x64.zip"}
PROGRAMS = {"linux": "blender", "darwin": "Blender.app/Contents/MacOS/Blender", "win32": "blender.exe"}
BACKENDS = "opengl", "vulkan", "metal"
MORE_PACKAGES = ("libxxf86vm1",)
"""Of Debian: what a Blender needs and the Python package does not."""
VULKAN_DRIVER = ("mesa-vulkan-drivers",)
MSYS2 = Path("C:/msys64")
PLANE = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"
LOW = f"v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\n{PLANE}"
HIGH = LOW.replace("v 0 0 1", "v 0 0.1 1").replace("v 1 0 1", "v 1 0.1 1")


# Blender's releases


def read(url: str) -> bytes:
    """What is at an address."""
    with urllib.request.urlopen(url) as answer:
        return answer.read()


def newest() -> str:
    """The newest release."""
    lines = re.findall(r'href="(?:/release/)?Blender(\d+\.\d+)/"', read(f"{RELEASES}/").decode())
    line = max(lines, key=_numbers)
    names = read(f"{RELEASES}/Blender{line}/").decode()
    return max(re.findall(rf"blender-({re.escape(line)}\.\d+)-linux-x64\.tar\.xz", names), key=_numbers)


def _numbers(version: str) -> list[int]:
    return [int(part) for part in version.split(".")]


def download(version: str, folder: Path) -> Path:
    """The program of a release in a folder of its own, which is made if it is not there."""
    place = folder / version
    found = place / PROGRAMS[sys.platform]
    if found.exists():
        return found
    name = f"blender-{version}-{ENDINGS[sys.platform]}"
    source = f"{RELEASES}/Blender{version.rpartition('.')[0]}"
    sums = dict(reversed(line.split()) for line in read(f"{source}/blender-{version}.sha256").decode().splitlines())
    content = read(f"{source}/{name}")
    if hashlib.sha256(content).hexdigest() != sums[name]:
        raise SystemExit(f"{name} is damaged: its SHA-256 is not the published one")
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        top = unpack(content, Path(scratch))
        top.rename(place)
    return found


def unpack(content: bytes, folder: Path) -> Path:
    """Unpack a release. Returns the folder in which its program is."""
    if sys.platform == "darwin":
        image, volume, top = folder / "blender.dmg", folder / "volume", folder / "top"
        image.write_bytes(content)
        attach = ["hdiutil", "attach", "-quiet", "-nobrowse", "-readonly", "-mountpoint", str(volume), str(image)]
        subprocess.run(attach, check=True)
        try:
            shutil.copytree(volume / "Blender.app", top / "Blender.app", symlinks=True)
        finally:
            subprocess.run(["hdiutil", "detach", "-quiet", str(volume)], check=True)
        return top
    if sys.platform == "win32":
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            archive.extractall(folder)
    else:
        with tarfile.open(fileobj=io.BytesIO(content)) as archive:
            archive.extractall(folder, filter="tar")
    (top,) = (path for path in folder.iterdir() if path.is_dir())
    return top


# Drivers


def install_packages(backend: str | None) -> None:
    """Install what Blender and Mesa's software driver need, as root on a Debian. Other systems are left as they are."""
    command = imprint.remedy(imprint.PACKAGES, imprint.installer())
    if command[:1] == ["apt-get"]:
        command += [*MORE_PACKAGES, *(VULKAN_DRIVER if backend == "vulkan" else ())]
        imprint.install(command, "Blender needs system packages", may_install=True)


def add_mesa(folder: Path) -> None:
    """Put Mesa's OpenGL, and all libraries that may belong to it, beside the program in a folder: Windows looks there first."""
    package = "mingw-w64-ucrt-x86_64-mesa"
    pacman = [str(MSYS2 / "usr" / "bin" / "pacman.exe"), "--sync", "--refresh", "--needed", "--noconfirm", package]
    subprocess.run(pacman, check=True)
    for library in (MSYS2 / "ucrt64" / "bin").glob("*.dll"):
        if not (folder / library.name).exists():
            shutil.copy(library, folder)


# Steps


def check(blender: list[str], backend: str | None, folder: Path) -> None:
    """Build, install and use the extension. All files go into a folder."""
    environment = dict(os.environ, BLENDER_USER_RESOURCES=str(folder / "profile"))
    start = [*blender, "--background", *(["--gpu-backend", backend] if backend else []), "--python-exit-code", "1"]

    def run(*arguments: object) -> str:
        command = [*start, *map(str, arguments)]
        print(f"$ {shlex.join(command)}", flush=True)
        done = subprocess.run(
            command, env=environment, stdout=subprocess.PIPE, text=True, errors="replace", check=False
        )
        print(done.stdout, flush=True)
        if done.returncode:
            raise SystemExit(f"exit code {done.returncode}: {shlex.join(command)}")
        return done.stdout

    run("--command", "extension", "build", "--source-dir", ROOT, "--output-dir", folder)
    (archive,) = folder.glob("*.zip")
    run("--command", "extension", "validate", archive)
    run("--command", "extension", "install-file", "--repo", "user_default", "--enable", archive)
    run("--command", "imprint", "--version")
    bake(run, backend, folder)
    for script, last in (
        ("install_zip.py", "installed, used and removed"),
        ("use_python.py", "baked through the door"),
    ):
        if last not in run("--python", ROOT / "tests" / "package" / script, "--", archive):
            raise SystemExit(f"{script} did not come to its end")


def bake(run, backend: str | None, folder: Path) -> None:
    """Bake by the extension's command, and compare the backend that its report names."""
    (folder / "low.obj").write_text(LOW)
    (folder / "high.obj").write_text(HIGH)
    files = ["--low-file", folder / "low.obj", "--high-file", folder / "high.obj", "--output", folder / "map.png"]
    maps = ["--maps", "ao,height", "--size", 64, "--method", "cast"]
    run("--command", "imprint", *files, *maps, "--report", folder / "report.json")
    (baked,) = json.loads((folder / "report.json").read_text())["bakes"]
    (report,) = baked["reports"]
    print(f"{report['backend']}, {report['renderer']}", flush=True)
    if backend not in (None, report["backend"].lower()):
        raise SystemExit(f"the bake ran on {report['backend']}, not on {backend}")
    missing = [name for name in ("map.png", "map_ao.png", "map_height.png") if not (folder / name).is_file()]
    if missing or report["missed"]:
        raise SystemExit(f"missing files: {missing}; rays that missed: {report['missed']:.2%}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("version", nargs="?", help="of Blender, or newest")
    parser.add_argument("--blender", metavar="COMMAND")
    parser.add_argument("--backend", choices=BACKENDS)
    parser.add_argument("--folder", type=Path, default=ROOT / "out" / "blenders")
    parser.add_argument("--mesa", action="store_true")
    given = parser.parse_args()
    if (given.version is None) == (given.blender is None):
        parser.error("name a version, or a command with --blender")
    if given.blender:
        blender = shlex.split(given.blender)
    else:
        if sys.platform == "linux":
            install_packages(given.backend)
        version = newest() if given.version == "newest" else given.version
        program = download(version, given.folder.resolve())
        if given.mesa:
            add_mesa(program.parent)
        blender = [str(program)]
    with tempfile.TemporaryDirectory(prefix="imprint-in-blender-") as scratch:
        check(blender, given.backend, Path(scratch))
    print("built, installed and used")


if __name__ == "__main__":
    main()
