#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that OpenGL and Vulkan bake the same maps: random scenes of overlapping layers, and pairs of files.

    python3 scripts/dev/same_backends.py [--blender blender] [--scenes 0:200] [--size 512] [--out DIR] [FILE.blend ...]

Needs numpy and a Blender, which runs in the background with each backend. --blender is a command; it may have arguments
of its own. Each FILE.blend holds two objects, "hi" and "lo". Ends with 1 if a scene ends in a map on one backend only, or if
texels differ that may not.
"""

import argparse
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent.parent
BACKENDS = "opengl", "vulkan"
TOLERANCE = 1e-5
"""The most by which a channel may differ: normals in 32-bit floats, from 0 to 1, and values of other maps."""
MAPS = ("POSITION", "OBJECT_ID", "AO", "BENT_NORMAL", "THICKNESS", "CURVATURE", "BASE_COLOR", "ATTRIBUTE")
"""The maps beside the normal map that are baked of each file."""
MOST = 5e-4
"""Share of the texels that may differ by more: rays along an edge or along the surface, or ties between two layers."""


def bake(out: str, scenes: str, size: str, *files: str) -> None:
    """Inside Blender: bake everything, and write the texels of each map, or the message, by scene to `out`."""
    sys.path.insert(0, str(ROOT))
    import bpy
    import gpu

    import addon
    from addon.core.errors import BakeError
    from addon.core.settings import Settings
    from addon.jobs import bake_pair
    from tests.support import layered_scenes, maps

    gpu.init()
    found = {}

    def add(name: str, low: bpy.types.Object, highs: list, settings: Settings) -> None:
        try:
            report = bake_pair(bpy.context, low, highs, settings)
        except BakeError as error:
            found[name] = np.array(str(error))
            return
        for image in (report.image, *(one["image"] for one in report.maps.values())):
            found[f"{name} {image}"] = maps.pixels(bpy.data.images[image])

    for seed in range(*map(int, scenes.split(":"))):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        add(f"random scene {seed}", *layered_scenes.make(seed))
    side = {"width": int(size), "height": int(size)}
    for file in files:
        bpy.ops.wm.open_mainfile(filepath=file)
        low, high = (bpy.data.objects[name] for name in ("lo", "hi"))
        high.data.color_attributes.new("Col", "FLOAT_COLOR", "POINT").data.foreach_set(
            "color", np.random.default_rng(0).random(len(high.data.vertices) * 4)
        )
        for method in ("CAST", "FLATTEN"):
            settings = Settings(
                method=method,
                space="WORLD",
                image=method,
                depth=32,
                storage="MEMORY",
                material=False,
                maps=MAPS,
                **side,
            )
            add(f"{Path(file).stem} {method}", low, [high], settings)
            for space in ("TANGENT", "OBJECT"):
                settings = Settings(
                    method=method,
                    space=space,
                    image=f"{method} {space} roughness",
                    samples=4,
                    depth=32,
                    storage="MEMORY",
                    material=False,
                    maps=("WIDENED_ROUGHNESS",),
                    **side,
                )
                add(f"{Path(file).stem} {method} {space} roughness", low, [high], settings)
            # A normal map alone has adaptive samples by Cast.
            settings = Settings(
                method=method, image=f"{method} samples", samples=64, depth=32, storage="MEMORY", material=False, **side
            )
            add(f"{Path(file).stem} {method} with samples", low, [high], settings)
    print(
        f"{gpu.platform.backend_type_get()}, {gpu.platform.renderer_get()}: {len(found)} maps and messages", flush=True
    )
    np.savez_compressed(out, **found)
    addon.free()  # Blender crashes on exit while GPU objects exist


def compare(first: dict, second: dict) -> bool:
    """Whether both hold the same maps, but for a share of the texels; prints what differs."""
    failed = sorted(first.keys() ^ second.keys())
    for name in failed:
        print(f"{name}: only one backend has it")
    texels = differing = 0
    for name in sorted(first.keys() & second.keys()):
        one, other = first[name], second[name]
        if one.ndim != 3:
            if str(one) != str(other):
                print(f"{name}: {one}\n  and {other}")
            continue
        wrong = ~(np.abs(one - other).max(axis=2) <= TOLERANCE)  # NaN is wrong
        count, texels = np.count_nonzero(wrong), texels + wrong.size
        differing += count
        if count:
            print(f"{name}: {count} of {wrong.size:,} texels differ, by up to {np.abs(one - other).max():.2g}")
    print(f"{texels - differing:,} of {texels:,} texels are equal to {TOLERANCE}: {1 - differing / max(1, texels):.5%}")
    return not failed and differing <= MOST * texels


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--blender", default="blender")
    parser.add_argument("--scenes", default="0:200")
    parser.add_argument("--size", default="512")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "backends")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    results = []
    for backend in BACKENDS:
        out = given.out.resolve() / f"{backend}.npz"
        command = [*shlex.split(given.blender), "--background", "--factory-startup", "--gpu-backend", backend]
        command += ["--python-exit-code", "1", "--python", __file__, "--"]
        files = [str(file.resolve()) for file in given.files]
        subprocess.run([*command, str(out), given.scenes, given.size, *files], check=True)
        with np.load(out) as found:
            results.append(dict(found))
    return 0 if compare(*results) else 1


if __name__ == "__main__":
    if "bpy" in sys.modules:  # Blender runs this file
        bake(*sys.argv[sys.argv.index("--") + 1 :])
    else:
        sys.exit(main())
