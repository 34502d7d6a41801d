#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what Format Auto saves where the ending of files is open, beside the best single format.

    .venv/bin/python scripts/bench/format_bytes.py [PAIR.blend ...] [--size 512] [--degrees 1] [--steps 2]

Each PAIR.blend holds two objects, "hi" and "lo"; without one, those of ../shared/assets/pairs that share UVs. Normals and
ambient occlusion are baked as 32-bit floats, and again by Format Auto, without alpha. Pillow reads what that stored. A single
format stores all maps of all pairs, and counts if 99 % of the covered texels of each map keep the limit of that map.

Ends with 1 if Auto exceeds a limit.
"""

import argparse
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import gpu  # noqa: E402
import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

import addon  # noqa: E402
from addon.core.settings import Settings  # noqa: E402
from addon.jobs import bake_pair  # noqa: E402
from addon.output import image_file  # noqa: E402
from tests.support import angles  # noqa: E402

WITHOUT = "normaltangenttest_published"
"""The pair that shares no UVs."""
QUALITIES = 100, 98, 95, 90, 80, 60
SINGLE = [
    ("PNG", ".png", 100),
    *((name, end, each) for name, end in (("WebP", ".webp"), ("JPEG", ".jpg")) for each in QUALITIES),
]
"""Labels, endings and qualities. WebP has no losses at 100."""


def bake(file: Path, output: Path, **settings) -> dict[str, Path]:
    """The files of the maps of a pair, by map."""
    bpy.ops.wm.open_mainfile(filepath=str(file))
    low, high = (bpy.data.objects[name] for name in ("lo", "hi"))
    values = {
        "method": "CAST",
        "maps": ("AO",),
        "material": False,
        "storage": "FILE",
        "targets": ("three",),
        **settings,
    }
    report = bake_pair(bpy.context, low, [high], Settings(output=str(output), **values))
    return dict(zip(("normal", "ao"), map(Path, report.output), strict=True))


def error(name: str, read: np.ndarray, truth: np.ndarray, covered: np.ndarray) -> float:
    """The 99th percentile, in degrees or steps, of texels (H, W, 3) that are covered (H, W)."""
    read, truth = read[covered].astype(np.float64), truth[covered].astype(np.float64)
    if name == "normal":
        off = angles.degrees(angles.decode(read), angles.decode(truth))
    else:
        off = np.abs(read - truth).max(axis=1) * 255.0
    return float(np.percentile(off, 99))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", nargs="*", type=Path, metavar="PAIR.blend")
    parser.add_argument("--size", type=int, default=512, help="of the maps, in texels along a side")
    parser.add_argument("--degrees", type=float, default=1.0, help="the limit of normals")
    parser.add_argument("--steps", type=float, default=2.0, help="the limit of ambient occlusion, of 255")
    given = parser.parse_args()
    folder = ROOT.parent / "shared" / "assets" / "pairs"
    pairs = given.pairs or [file for file in sorted(folder.glob("*.blend")) if file.stem != WITHOUT]
    limits = {"normal": given.degrees, "ao": given.steps}
    size = {"width": given.size, "height": given.size}
    totals, sums, kept = {label_of(single): (0, True) for single in SINGLE}, 0, True
    gpu.init()
    print("| pair | map | stored as | bytes | off | limit |\n| --- | --- | --- | --- | --- | --- |")
    for file in pairs:
        with tempfile.TemporaryDirectory() as name:
            truths = bake(file, Path(name, "truth_normal.exr"), depth=32, **size)
            alone = bake(file, Path(name, "alone_normal.exr"), margin=0, depth=32, **size)
            covered = image_file.read(alone["normal"])[..., 3] > 0
            chosen = {"format": "AUTO", "alpha": False, "most_degrees": given.degrees, "most_steps": given.steps}
            for kind, path in bake(file, Path(name, "auto_normal"), **chosen, **size).items():
                texels = image_file.read(truths[kind])
                read = np.asarray(Image.open(path).convert("RGB"), np.float64)[::-1] / 255.0
                off = error(kind, read, texels[..., :3], covered)
                kept &= off <= limits[kind] * 1.001
                count = path.stat().st_size
                sums += count
                print(
                    f"| {file.stem} | {kind} | {path.suffix} | {count:,} | {off:.2f} | {limits[kind]:g} |", flush=True
                )
                for single in SINGLE:
                    of_single = Path(name, "single").with_suffix(single[1])
                    how = {"has_alpha": False, "is_gray": kind == "ao", "quality": single[2]}
                    content = image_file.content(texels, of_single, 8, **how)
                    of_single.touch()
                    content.write(of_single, iter([part() for part in content.parts]))
                    is_kept = error(kind, image_file.read(of_single)[..., :3], texels[..., :3], covered) <= limits[kind]
                    total, are_kept = totals[label_of(single)]
                    totals[label_of(single)] = total + of_single.stat().st_size, are_kept and is_kept
    print("\n| single format | bytes | keeps all limits |\n| --- | --- | --- |")
    for label, (total, are_kept) in totals.items():
        print(f"| {label} | {total:,} | {'yes' if are_kept else 'no'} |")
    best = min((total for total, are_kept in totals.values() if are_kept), default=0)
    print(f"\nAuto: {sums:,} bytes" + (f", {1 - sums / best:.1%} fewer than the best single format" if best else ""))
    addon.free()
    return 0 if kept else 1


def label_of(single: tuple[str, str, int]) -> str:
    return f"{single[0]} {single[2]}" if single[1] != ".png" else single[0]


if __name__ == "__main__":
    sys.exit(main())
