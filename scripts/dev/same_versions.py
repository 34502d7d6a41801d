#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that other versions of Blender bake the same maps as the one of .venv, in the background, and that another process
finds all in the files that they save.

    .venv/bin/python scripts/dev/same_versions.py [--versions 4.5.15 5.3.0 ...] [--size 512] [--environments DIR] [--out DIR]

Each version is a wheel in an environment of its own in DIR, which is made once: 400 MB to download each, and a Python 3.11
or 3.13. It bakes one pair, made of the same numbers in each version, with CASES, on each of its BACKENDS. Ends with 1 if an
output is missing, if a texel differs by more than its tolerance, or if a saved file differs: tests/support/saved_scenes.py has
what is in it.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT))

from scripts.dev.blender_packages import ENVIRONMENTS, OPENGL, PYTHONS, backends, environment  # noqa: E402

TOLERANCE = 1e-6
"""The most by which a channel may differ: normals from 0 to 1, and values of other maps. numpy 1.26 sums in another order."""
OTHER_COMPILER = 5e-5
"""The same on Vulkan, whose compiler sums in another order: 2.6e-5 was measured, of curvature, and 2.2e-6 of normals."""
HALF = 2.0**-11
"""A step of half floats between 0.5 and 1, as files have them: a difference in the last digit may become one."""
POINTS = ("POSITION", "HEIGHT", "DISPLACEMENT", "DISTANCE", "COVERAGE", "OBJECT_ID", "MATERIAL_ID")
FLATTEN, CAST = {"method": "FLATTEN"}, {"method": "CAST"}
TILED = {"low": "low_tiled", "high": "high_tiled", "udim": True}
CASES = {
    "flatten cycles": {**FLATTEN, "basis": "CYCLES"},
    "flatten mikktspace 4": {**FLATTEN, "basis": "MIKKTSPACE", "samples": 4},
    "flatten object": {**FLATTEN, "space": "OBJECT"},
    "flatten world 16": {**FLATTEN, "space": "WORLD", "samples": 16},
    "flatten adjacent": {**FLATTEN, "margin_type": "ADJACENT_FACES"},
    "flatten unlimited": {**FLATTEN, "margin": None},
    "cast cycles": {**CAST, "basis": "CYCLES"},
    "cast vertex": {**CAST, "basis": "MIKKTSPACE_VERTEX"},
    "cast normalized": {**CAST, "basis": "NORMALIZED"},
    "cast mikktspace 4": {**CAST, "basis": "MIKKTSPACE", "samples": 4, "adaptive": False},
    "cast mikktspace 16": {**CAST, "basis": "MIKKTSPACE", "samples": 16},
    "cast object": {**CAST, "space": "OBJECT"},
    "cast world": {**CAST, "space": "WORLD"},
    "cast split": {**CAST, "directions": "SPLIT", "facing_only": True, "mask": True},
    "cast points": {**CAST, "maps": POINTS, "size": 0.5},
    "cast rays": {**CAST, "maps": ("AO", "BENT_NORMAL", "THICKNESS", "CURVATURE"), "rays": 16, "size": 0.5},
    "cast materials": {**CAST, "maps": ("BASE_COLOR", "ROUGHNESS", "METALLIC"), "pack": "GLTF", "size": 0.5},
    "auto": {"method": "AUTO"},
    "tiles flatten": {**FLATTEN, **TILED, "ending": "<UDIM>.exr"},
    "tiles cast": {**CAST, **TILED, "ending": "<UDIM>.exr"},
    "png 8": {**FLATTEN, "green": "-Y", "dither": True, "depth": 8, "ending": "png"},
    "png 16": {**FLATTEN, "depth": 16, "ending": "png"},
    "tiff": {**FLATTEN, "depth": 16, "ending": "tif"},
    "tga": {**FLATTEN, "depth": 8, "ending": "tga"},
    "exr 16": {**FLATTEN, "depth": 16, "ending": "exr"},
    "exr 32": {**FLATTEN, "depth": 32, "ending": "exr"},
    "packed": {**FLATTEN, "storage": "PACK", "depth": 8},
}
"""Settings by name. low, high: the objects. size: as a share of --size. ending: of files; without one, maps stay in memory."""


# Inside each version


def bake(folder: str, size: str) -> None:
    """Bake all CASES, and write the texels of each output to `folder`/maps.npz."""
    import bpy
    import gpu

    import addon
    from addon.jobs import bake_pair
    from tests.support import maps

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for tiles, ending in ((1, ""), (2, "_tiled")):
        rock(f"low{ending}", 54, tiles)
        rock(f"high{ending}", 176, tiles)
    found = {}
    for number, (name, values) in enumerate(CASES.items()):
        place = Path(folder) / str(number)
        place.mkdir(parents=True)
        low, high, settings = settings_of(name, place, int(size))
        report = bake_pair(bpy.context, bpy.data.objects[low], [bpy.data.objects[high]], settings)
        if "ending" in values:
            images = {path.name: load(path) for path in sorted(place.iterdir())}
        else:
            names = dict.fromkeys([report.image, *(one["image"] for one in report.maps.values())])
            images = {image.removeprefix(name): bpy.data.images[image] for image in names}
        found |= {f"{name}: {own}": maps.pixels(image) for own, image in images.items()}
    np.savez(Path(folder) / "maps.npz", **found)
    about = f"Blender {bpy.app.version_string}, numpy {np.__version__}, {gpu.platform.backend_type_get()}"
    print(f"{about}: {len(CASES)} settings, {len(found)} outputs", flush=True)
    addon.free()


def settings_of(name: str, place: Path, size: int):
    """The names of the objects of a case, and its settings."""
    from addon.core.settings import Settings

    values = dict(CASES[name])
    low, high = values.pop("low", "low"), values.pop("high", "high")
    side = int(size * values.pop("size", 1))
    ending = values.pop("ending", "")
    kept = {"storage": "FILE", "output": str(place / f"map.{ending}")} if ending else {"storage": "MEMORY", "depth": 32}
    return low, high, Settings(**{"image": name, "width": side, "height": side, "rays": 64, **kept, **values})


def load(path: Path):
    """An image file, as data."""
    import bpy

    image = bpy.data.images.load(str(path))
    image.colorspace_settings.is_data = True
    return image


def rock(name: str, columns: int, tiles: int) -> None:
    """An object: a band of a bumpy sphere with `columns` x `columns` / 2 quads, on UDIM tiles beside each other.

    All coordinates have few digits, so that they are the same in each version of numpy. The finer the mesh, the more bumps.
    """
    import bpy

    rows = columns // 2
    u, v = np.meshgrid(np.linspace(0.0, 1.0, columns + 1), np.linspace(0.05, 0.95, rows + 1))
    around, up = 2.0 * np.pi * u, np.pi * (v - 0.5)
    detail = 0.02 * np.sin(23.0 * around) * np.cos(31.0 * up) if columns > 100 else 0.0
    radius = 1.0 + 0.15 * np.sin(3.0 * around) * np.cos(2.0 * up) + detail
    points = radius[..., None] * np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1)
    uvs = np.stack([0.02 + u * (tiles - 0.04), v], -1)
    corner = np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)
    quads = np.stack([corner, corner + 1, corner + columns + 2, corner + columns + 1], -1).reshape(-1, 4)
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.round(points.reshape(-1, 3) * 4096.0) / 4096.0, [], quads.tolist())
    uvs = np.round(uvs.reshape(-1, 2) * 4096.0) / 4096.0
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs[quads.ravel()].ravel().astype(np.float32))
    mesh.shade_smooth()
    bpy.context.collection.objects.link(bpy.data.objects.new(name, mesh))


# Outside


def maps_of(python: str, folder: Path, size: int, variables: Mapping[str, str] = OPENGL) -> dict[str, np.ndarray]:
    """The outputs of all CASES, baked by Blender in this Python with more variables of the environment."""
    folder.mkdir(parents=True, exist_ok=True)
    # Not the file itself: its folder would come before Python's modules. Blender 4.5 hangs where its process ends.
    program = (
        f"import os; from scripts.dev import same_versions as own; own.bake({str(folder)!r}, '{size}'); os._exit(0)"
    )
    chosen = {**os.environ, **variables}
    subprocess.run([python, "-c", program], cwd=ROOT, check=True, stdin=subprocess.DEVNULL, env=chosen)
    with np.load(folder / "maps.npz") as found:
        return dict(found)


def lost(python: str, folder: Path) -> list[str]:
    """What of a file that Blender in this Python has saved is not the same when it is opened in another process, in lines."""
    scene = str(folder / "saved" / "scene.blend")
    states = []
    for name, given in (("first_day", [str(folder), scene]), ("opened", [scene])):
        command = [python, "-m", "tests.support.saved_scenes", name, str(folder / f"{name}.json"), *given]
        subprocess.run(command, cwd=ROOT, check=True, stdin=subprocess.DEVNULL)
        states.append(json.loads((folder / f"{name}.json").read_text()))
    saved, found = states[0]["first"], states[1]
    print(f"{len(saved['images'])} images of a saved file", flush=True)
    return [f"{part} of a saved file" for part in saved if found[part] != saved[part]]


def tolerance(name: str, backend: str) -> float:
    """The most by which an output on a backend may differ from that of OpenGL."""
    if backend == "opengl":
        return TOLERANCE
    return HALF if name.endswith(".exr") and not name.startswith("exr 32") else OTHER_COMPILER


def compare(wanted: dict[str, np.ndarray], found: dict[str, np.ndarray], backend: str = "opengl") -> list[str]:
    """What differs by more than its tolerance, in lines; smaller differences are printed."""
    failed = [f"{name}: only one version has it" for name in sorted(wanted.keys() ^ found.keys())]
    for name in sorted(wanted.keys() & found.keys()):
        one, other = wanted[name], found[name]
        if one.shape != other.shape:
            failed.append(f"{name}: another size")
            continue
        difference = np.abs(one - other).max(axis=-1)
        count = np.count_nonzero(~(difference == 0.0))
        line = f"{name}: {count:,} of {difference.size:,} texels differ, by up to {difference.max():.2g}"
        if not difference.max() <= tolerance(name, backend):
            failed.append(line)
        elif count:
            print(f"  {line}")
    return failed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--versions", nargs="+", default=list(PYTHONS), choices=list(PYTHONS))
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--environments", type=Path, default=ENVIRONMENTS)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    if given.out and given.out.exists():
        parser.error(f"{given.out} exists: name a new folder")
    out = given.out or Path(tempfile.mkdtemp(prefix="imprint-same-versions-"))
    wanted = maps_of(sys.executable, out.resolve() / "own", given.size)
    failed = False
    for version in given.versions:
        python = environment(given.environments.resolve(), version)
        for backend, variables in backends(version).items():
            folder, name = out.resolve() / f"{version}-{backend}", f"{version}, {backend}"
            lines = compare(wanted, maps_of(python, folder, given.size, variables), backend)
            print(f"{name}: {len(wanted) - len(lines)} of {len(wanted)} outputs are as in this version", flush=True)
            for line in lines:
                print(f"  differs: {line}")
            failed |= bool(lines)
        lines = lost(python, folder)
        for line in lines:
            print(f"  differs: {line}")
        failed |= bool(lines)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
