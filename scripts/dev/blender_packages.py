# SPDX-License-Identifier: GPL-3.0-or-later
"""The other versions of Blender's Python package that are tested, and their environments, which are made at their first use."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from scripts import imprint

PYTHONS = {"4.5.15": "3.11", "5.0.1": "3.11", "5.1.2": "3.13", "5.3.0": "3.13"}
"""The Python that each wheel needs."""
NEWEST = "5.3.0"
"""The version of which tests/package/test_same_versions.py makes the environment, and with which it runs other tests."""
OPENGL = {"VK_DRIVER_FILES": os.devnull, "VK_ICD_FILENAMES": os.devnull}
"""Variables with which Blender's Python package starts on OpenGL: they hide Vulkan's drivers, which it prefers from 5.3 on."""
BACKENDS = {"5.3.0": {"vulkan": {}, "opengl": OPENGL}}
"""The variables of each backend of a version; of others: OpenGL, without variables."""
TOOLS = ("pillow", "pytest")
"""What tests need beside Blender, in the environment of the newest version, pinned as in scripts/requirements.txt."""
ENVIRONMENTS = imprint.ROOT / "out" / "blender"
"""The folder of the environments: one for each version."""


def environment(folder: Path, version: str) -> str:
    """The Python of the environment with this version, which is made if it is not there, once if two processes need it."""
    place = folder / version
    python = place / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    stamp, wanted = place / "complete", packages(version)
    with open(__file__, "r+b") as file:  # a file that always exists
        imprint.lock(file)
        if not stamp.exists():
            try:
                imprint.empty(place)
                base = find_python(PYTHONS[version])
            except imprint.Failure as error:
                sys.exit(f"blender_packages.py: {error}")
            subprocess.run([base, "-m", "venv", str(place)], check=True)
        if not stamp.exists() or stamp.read_text() != " ".join(wanted):
            subprocess.run([str(python), "-m", "pip", "install", "--quiet", *wanted], check=True)
            stamp.write_text(" ".join(wanted))
    return str(python)


def packages(version: str) -> list[str]:
    """What pip installs into the environment with a version."""
    pins = imprint.REQUIREMENTS.read_text(encoding="utf-8").splitlines() if version == NEWEST else ()
    return [f"bpy=={version}", *(line for line in pins if line.partition("==")[0] in TOOLS)]


def find_python(wanted: str) -> str:
    """A Python of this version: that of .venv, or one from pyenv or from the path."""
    if wanted == imprint.WANTED:
        return imprint.find_python(imprint.python_candidates())
    found = [str(path) for root in imprint.pyenv_roots() for path in root.glob(f"versions/{wanted}.*/bin/python")]
    found.append(shutil.which(f"python{wanted}"))
    if not found[0]:
        sys.exit(f"Python {wanted} is needed, and was not found.")
    return found[0]


def backends(version: str) -> dict[str, dict[str, str]]:
    """The backends on which the package of a version can be started, with the variables that choose them."""
    return BACKENDS.get(version, {"opengl": {}})
