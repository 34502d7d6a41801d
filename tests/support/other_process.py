# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks at a saved file in another process, as a user does on another day."""

import json
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

from scripts.imprint import ROOT


def elsewhere(path: Path, code: str) -> Any:
    """Run code in a new process with a file open, where `low` is the active object. Returns what it stores in `found`."""
    script = f"""
        import json, sys
        sys.path.insert(0, {str(ROOT)!r})
        import bpy, addon
        addon.register()
        bpy.ops.wm.open_mainfile(filepath={str(path)!r})
        from addon.ui import object_pairs, sets
        from addon.ui.bake_results import results
        low = bpy.context.active_object
    """
    script = (
        textwrap.dedent(script) + textwrap.dedent(code) + "\nprint('found: ' + json.dumps(found))\naddon.unregister()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.rpartition("found: ")[2].splitlines()[0])
