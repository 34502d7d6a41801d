#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks the types of the packages that pyproject.toml names, with pyright.

    .venv/bin/python scripts/dev/check_types.py

The first call installs pyright, with the Node.js that it needs, and stubs of Blender's modules into out/pyright: 360 MB.
"""

import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT))

from scripts.imprint import empty  # noqa: E402

ENVIRONMENT = ROOT / "out" / "pyright"
PACKAGES = ["pyright[nodejs]==1.1.414", "fake-bpy-module-5.2==20260730", "numpy==2.5.5", "zstandard==0.25.0"]
"""Stubs of Blender's modules take the place of its own package, which has no types."""


def main() -> int:
    programs = ENVIRONMENT / ("Scripts" if sys.platform == "win32" else "bin")
    installed = ENVIRONMENT / "packages.txt"
    if not installed.is_file() or installed.read_text(encoding="utf-8") != "\n".join(PACKAGES):
        empty(ENVIRONMENT)
        venv.create(ENVIRONMENT, with_pip=True)
        subprocess.run([programs / "python", "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
        installed.write_text("\n".join(PACKAGES), encoding="utf-8")
    command = [programs / "pyright", "--pythonpath", programs / "python", *sys.argv[1:]]
    return subprocess.run(command, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
