# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes inside Blender, without an installed extension.

blender --background FILE.blend --python scripts/bake.py -- --low lo --high hi --output MAP.png
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import addon  # noqa: E402
from addon.cli import blender_process  # noqa: E402

code = addon.run(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
if __name__ == "__main__":
    blender_process.end(code)
sys.exit(code)
