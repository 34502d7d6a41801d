#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows normal maps as WebP and KTX2 files in three.js, and compares what they cost there with what the report says.

    .venv/bin/python scripts/dev/formats_in_three.py [--size 512] [--npm DIR] [PAIR.blend ...]

Needs Chromium and npm, as engines.py does. Each PAIR.blend holds "hi" and "lo"; without one, kepler and king of
../shared/assets.
The low mesh is laid out in its UVs, with its own normals and tangents, so that each pixel of three.js's own shader shows one
texel. What it shows of each file is compared with what it shows of the floats that Imprint reads from the file, and the degrees
between these and the map in floats with the report's `targets`. SwiftShader cuts BC5 to 8 bits, unlike GPUs, and its rows are
compared with that.

Ends with 1 if the medians of the degrees differ by more than 0.05, or what is shown of a file by more in the mean.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import gpu  # noqa: E402

import addon  # noqa: E402
from addon.core.report import Report  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import bake_pair  # noqa: E402
from addon.output import image_file  # noqa: E402
from scripts.dev.in_engines import chromium, drawing, samples  # noqa: E402
from scripts.dev.in_engines.glb_file import Glb, unit  # noqa: E402
from tests.support import angles  # noqa: E402

PAIRS = ROOT / ".." / "shared" / "assets" / "pairs"
FILES = "kepler_199712_9079", "king_40480_4000"
LOSSY = {"lossy_normals": True}
WAYS = {
    "WebP 100": (".webp", {}),
    "WebP 90": (".webp", {"quality": 90, **LOSSY}),
    "WebP 75": (".webp", {"quality": 75, **LOSSY}),
    "KTX2, BC5": (".ktx2", {"compression": "BC5"}),
    "KTX2, BC7": (".ktx2", {"compression": "BC7"}),
}
TO_8_BITS = {"KTX2, BC5"}
TARGET = "three"
MOST = 0.05
"""Degrees."""


def bake(file: Path, output: Path, size: int, **settings) -> Report:
    """The report of a bake without a margin, so that alpha is where the low mesh is."""
    bpy.ops.wm.open_mainfile(filepath=str(file))
    low, high = (bpy.data.objects[name] for name in ("lo", "hi"))
    values = {
        "method": "FLATTEN",
        "margin": 0,
        "storage": "FILE",
        "targets": (TARGET,),
        "basis": "NORMALIZED",
        **settings,
    }
    return bake_pair(bpy.context, low, [high], Settings(width=size, height=size, output=str(output), **values))


def laid_out(glb: Glb) -> Glb:
    """A copy of a file whose vertices lie at their UVs, before a camera that shows the square of UVs."""
    flat = glb.copy()
    for node in flat.document["nodes"]:
        for key in ("matrix", "translation", "rotation", "scale"):
            node.pop(key, None)
    binary = bytearray(flat.binary)
    for part in (part for mesh in flat.document["meshes"] for part in mesh["primitives"]):
        uv = flat.accessor(part["attributes"]["TEXCOORD_0"])
        places = np.stack([uv[:, 0], 1.0 - uv[:, 1], np.zeros(len(uv))], axis=1).astype("<f4")
        about = flat.document["accessors"][part["attributes"]["POSITION"]]
        about |= {"min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist()}
        start = flat.document["bufferViews"][about["bufferView"]].get("byteOffset", 0) + about.get("byteOffset", 0)
        binary[start : start + places.nbytes] = places.tobytes()
    flat.binary = bytes(binary)
    away = 0.5 / np.tan(np.radians(drawing.ANGLE) / 2.0)
    view = np.eye(4)
    view[:3, 3] = -0.5, -0.5, -away
    flat.set_cameras([view], drawing.ANGLE, 0.5 * away, 2.0 * away)
    return flat


def in_floats(texels: np.ndarray) -> tuple[str, bytes]:
    """Texels (S, S, 4), the bottom row first, as chromium.Model has floats."""
    return "f32", np.ascontiguousarray(texels[::-1], "<f4").tobytes()


def in_8_bits(texels: np.ndarray) -> np.ndarray:
    """Normals (S, S, 4) of BC5 as SwiftShader reads them: interpolated values are cut to whole numbers."""
    x, y = np.moveaxis(np.floor(texels[..., :2] * 255.0 + 1e-3) / 127.5 - 1.0, 2, 0)
    z = np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    return np.stack([0.5 + 0.5 * x, 0.5 + 0.5 * y, 0.5 + 0.5 * z, texels[..., 3]], axis=2)


def shown(content: bytes, maps: dict[str, tuple[str, bytes]], modules: Path, size: int) -> dict[str, np.ndarray]:
    """The pixels (S, S, 4) of three.js by map."""
    found: dict[str, np.ndarray] = {}

    def keep(name: str, _view: int, _output: str, values: np.ndarray) -> None:
        found[name] = values.astype(np.float64)

    models = [chromium.Model(str(number), content, map=each) for number, each in enumerate(maps.values())]
    chromium.render(modules, "three", models, views=1, size=size, keep=keep)
    return {name: found[str(number)] for number, name in enumerate(maps)}


def compared(file: Path, modules: Path, size: int) -> bool:
    """Print a row for each way to store the map of a pair. Returns whether all agree."""
    kept = True
    with tempfile.TemporaryDirectory() as name:
        floats = Path(name, "floats.exr")
        glb = samples.export(bake(file, floats, size, depth=32))
        texels = image_file.read(floats)
        maps, reports = {"floats": in_floats(texels)}, {}
        for number, (label, (ending, settings)) in enumerate(WAYS.items()):
            path = Path(name, f"map {number}{ending}")
            reports[label] = bake(file, path, size, **settings, depth=8)
            read = image_file.read(path)
            if label in TO_8_BITS:
                maps[f"in 8 bits {label}"] = in_floats(in_8_bits(read))
            maps[label] = ending[1:], path.read_bytes()
            maps[f"decoded {label}"] = in_floats(read)
        pictures = shown(laid_out(glb).content(), maps, modules, size)
    there = (texels[..., 3] > 0.0) & (pictures["floats"][..., 3] > 0.5)
    normals = {label: unit(picture[there, :3] * 2.0 - 1.0) for label, picture in pictures.items()}
    for label, report in reports.items():
        apart = angles.degrees(normals[label], normals.get(f"in 8 bits {label}", normals[f"decoded {label}"]))
        off = angles.degrees(normals[f"decoded {label}"], normals["floats"])
        said, (median, most) = report.targets[TARGET], np.percentile(off, (50, 99))
        print(
            f"| {file.stem} | {label} | {median:.3f}, {most:.2f} | {said['median']:.3f}, {said['percentile_99']:.2f} | "
            f"{apart.mean():.3f} | {len(off):,} of {said['texels']:,} |",
            flush=True,
        )
        kept &= abs(median - said["median"]) <= MOST and apart.mean() <= MOST
    return bool(kept)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, metavar="PAIR.blend")
    parser.add_argument("--size", type=int, default=512, metavar="TEXELS")
    parser.add_argument("--npm", type=Path, metavar="DIR")
    given = parser.parse_args()
    gpu.init()
    print(
        "| pair | file | three.js: median, p99 | report: median, p99 | mean | texels |\n| --- | --- | --- | --- | --- | --- |"
    )
    try:
        with tempfile.TemporaryDirectory() as temporary:
            modules = chromium.install(given.npm or Path(temporary))
            files = given.files or [PAIRS / f"{name}.blend" for name in FILES]
            kept = [compared(file, modules, given.size) for file in files]
    except chromium.NoEngine as error:
        sys.exit(f"formats_in_three.py: {error}")
    addon.free()
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
