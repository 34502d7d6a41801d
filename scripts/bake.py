# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes inside Blender, without the extension being installed.

blender --background FILE.blend --python scripts/bake.py -- --low lo --high hi --output MAP.png
"""

import signal
import sys
from pathlib import Path

# Until the bake takes Ctrl-C into its own hands: Blender takes a second to load.
signal.signal(signal.SIGINT, lambda *_: sys.exit("imprint: stopped, nothing was finished."))

import bpy  # noqa: E402, F401 - the wheel has to be loaded before its submodules

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import addon  # noqa: E402
from addon import commands  # noqa: E402

arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
try:
    code = commands.run(arguments)
finally:
    addon.free()  # Blender crashes on exit while GPU objects live
sys.exit(code)
