# SPDX-License-Identifier: GPL-3.0-or-later
"""What runs in Blender's Python for a node: reads a call from a folder, and writes what came of it there.

calls.json has the name of a function of the package `imprint` and its arguments, arrays.npz the arrays of its meshes.
"""

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np

CHECKOUT = Path(__file__).resolve().parents[2]
MESHES = ("low", "high", "mesh")


def package():
    """The package `imprint`: the checkout that this file is in, or an installed one."""
    entry = CHECKOUT / "__init__.py"
    if (CHECKOUT / "addon" / "api.py").is_file():
        spec = importlib.util.spec_from_file_location("imprint", entry, submodule_search_locations=[str(CHECKOUT)])
        sys.modules["imprint"] = module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
    return importlib.import_module("imprint")


def surface(imprint, arrays, name):
    """A mesh of the call."""
    known = {part: arrays[f"{name}.{part}"] for part in ("uv", "normals") if f"{name}.{part}" in arrays}
    return imprint.Surface(arrays[f"{name}.vertices"], arrays[f"{name}.triangles"], name=name, **known)


def answer(imprint, folder):
    """Do the call. Returns plain data and arrays."""
    call = json.loads((folder / "call.json").read_text(encoding="utf-8"))
    with np.load(folder / "arrays.npz") as file:
        arrays = dict(file)
    meshes = {name: surface(imprint, arrays, name) for name in MESHES if f"{name}.vertices" in arrays}
    if call["name"] == "bake" and meshes["low"].uv is None:
        meshes["low"] = imprint.unwrap(meshes["low"], size=call["arguments"]["size"])
    result = getattr(imprint, call["name"])(**meshes, **call["arguments"])
    mesh = result.mesh if call["name"] == "asset" else meshes["low"]
    found = {f"map.{name}": texels for name, texels in result.maps.items()}
    found |= {f"mesh.{part}": getattr(mesh, part) for part in ("vertices", "triangles", "uv", "normals")}
    told = {"warnings": result.warnings, "deviation": result.report.get("deviation", {})}
    return told, {name: np.asarray(values) for name, values in found.items() if values is not None}


def main(folder):
    """Write answer.json, and answer.npz if the call was done."""
    try:
        imprint = package()
        failures = imprint.BakeError
        told, arrays = answer(imprint, folder)
        np.savez(folder / "answer.npz", **arrays)
    except ImportError as error:
        told = {
            "error": f"{sys.executable} has no Imprint with Blender's package ({error}): pip install 'imprint-bake[bpy]' there."
        }
    except failures as error:
        told = {"error": str(error)}
    (folder / "answer.json").write_text(json.dumps(told), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
