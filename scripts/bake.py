# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes inside Blender, without an installed extension.

blender --background FILE.blend --python scripts/bake.py -- --low lo --high hi --output MAP.png
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import addon  # noqa: E402
from addon.cli import (  # noqa: E402
    blender_process,  # noqa: E402
    command,
    interruption,
    set_options,
    standard_streams,
)
from addon.core.progress import startup  # noqa: E402

startup.add_launcher()
set_options.read = addon.scene_sets
arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
standard_streams.reserve()
interruption.listen()  # before bpy is loaded, which takes a second and crashes on exceptions
try:
    code = command.run(arguments, may_start_processes=True)
finally:
    addon.free()  # Blender crashes on exit while GPU objects exist
code = interruption.leave() or code
if __name__ == "__main__":
    blender_process.end(code)
sys.exit(code)
