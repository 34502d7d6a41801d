# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls of Imprint in a process of its own: Blender's Python is another one than ComfyUI's, and draws in its main thread."""

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
WORKER = HERE / "worker.py"
PYTHON = "IMPRINT_PYTHON"
"""The environment variable with the Python that has Blender's package."""
WAIT = 0.1
"""Seconds between two looks whether the user has stopped the graph."""


class ImprintError(Exception):
    """What ComfyUI shows of a node that failed: one sentence."""


def python():
    """The Python that has Blender's package. Raises ImprintError."""
    named = os.environ.get(PYTHON)
    if named:
        if not os.path.isfile(named):
            raise ImprintError(
                f"{PYTHON} is {named!r}, where no file is: name the Python that has Blender's package bpy."
            )
        return named
    for known in ("bin/python", "Scripts/python.exe"):
        if (HERE.parents[1] / ".venv" / known).is_file():
            return str(HERE.parents[1] / ".venv" / known)
    if importlib.util.find_spec("bpy") is not None:
        return sys.executable
    raise ImprintError(
        f"Imprint needs a Python with Blender's package: pip install 'imprint-bake[bpy]' into one, and set {PYTHON} to it."
    )


def call(name, meshes, arguments, is_stopped=lambda: None):
    """Do one call of Imprint.

    Args:
        name: "bake" or "asset".
        meshes: by the names of arguments, each a dict of vertices (V, 3), triangles (T, 3), and perhaps uv and normals.
        arguments: the others, as plain data.
        is_stopped: raises if the user has stopped the graph.

    Returns:
        What is told, as plain data, and arrays by their names.
    """
    with tempfile.TemporaryDirectory(prefix="imprint-comfyui-") as folder:
        arrays = {f"{role}.{part}": values for role, mesh in meshes.items() for part, values in mesh.items()}
        np.savez(Path(folder, "arrays.npz"), **arrays)
        Path(folder, "call.json").write_text(json.dumps({"name": name, "arguments": arguments}), encoding="utf-8")
        with open(Path(folder, "output"), "w+b") as output:
            _finish([python(), str(WORKER), folder], output, is_stopped)
            output.seek(0)
            printed = output.read().decode(errors="replace").strip().splitlines()
        try:
            told = json.loads(Path(folder, "answer.json").read_text(encoding="utf-8"))
        except OSError as error:
            last = f": {printed[-1]}" if printed else ""
            raise ImprintError(f"Blender's process ended before the maps were done{last}") from error
        if "error" in told:
            raise ImprintError(told["error"])
        with np.load(Path(folder, "answer.npz")) as file:
            return told, dict(file)


def _finish(command, output, is_stopped):
    variables = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=variables)
    try:
        while process.poll() is None:
            is_stopped()
            time.sleep(WAIT)
    finally:
        if process.poll() is None:
            process.kill()
        with suppress(OSError):
            process.wait()
