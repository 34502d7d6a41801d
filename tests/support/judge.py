"""The judge of layers: a script beside the real meshes that compares Cast with Flatten on pairs that share UVs."""

import importlib.util
import json
import subprocess
import sys

from scripts import imprint


def path(assets):
    """The script. assets: the folder of the real meshes."""
    return assets.parent / "tools" / "layers.py"


def module(assets):
    """The script as a module, for its functions."""
    spec = importlib.util.spec_from_file_location("layers", path(assets))
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def figures(assets, file, folder, *options):
    """Judge a .blend with the command line's Cast: its figures, shares in percent. options: of Cast."""
    out = folder / "judged.json"
    command = [sys.executable, path(assets), imprint.ROOT, file, "--json", out, "--", *options]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    print(done.stdout.strip().splitlines()[-1])
    return json.loads(out.read_text())
