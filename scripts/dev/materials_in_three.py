#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes the materials of .glb files into one by the command line, and compares the files in three.js before and after.

    .venv/bin/python scripts/dev/materials_in_three.py [--size 1024] [--npm DIR] [--words=--export-webp] [FILE.glb ...]

Needs Chromium and npm, as engines.py does. Without files, those of tests/support/gltf_characters.py: a character of eleven
materials, a cart of four objects with vertex colors, and all of the first file packed into a new UV map. Cameras around the
scene see it from several sides. On each pixel that both files show, the base color of three.js's own shader, as sRGB, is
compared.

Ends with 1 if the mean difference is more than 2 of 255, or if another outline is shown on more than 0.2 % of the pixels.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from scripts.dev.assets_in_three import DIRECTIONS  # noqa: E402
from scripts.dev.in_engines import chromium, drawing  # noqa: E402
from scripts.dev.in_engines.glb_file import Glb  # noqa: E402
from tests.support import gltf_characters  # noqa: E402

MOST, MOST_OUTLINE = 2.0, 0.002
MAPS = "base-color,roughness,metallic,emission,alpha"


def baked(file: Path, words: list[str], size: int) -> Path:
    """The file that the command line writes, with one material."""
    target = file.with_name(f"{file.stem}_one.glb")
    command = [sys.executable, str(ROOT / "scripts" / "imprint.py"), "bake", str(file), *words, "--one-material"]
    command += ["--no-normal", "--maps", MAPS, "--size", str(size), "--samples", "4", "--export", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{file.stem}: nothing was baked:\n{done.stdout}{done.stderr}")
    print("\n".join(line for line in done.stderr.splitlines() if "warning" in line))
    return target


def shown(files: list[Path], modules: Path, pixels: int) -> list[np.ndarray]:
    """The pixels (views, S, S, 4) of three.js's base color, by file, all with the same cameras."""
    sights, pictures = drawing.look_around(Glb.read(files[0]).surface().position, DIRECTIONS, pixels), {}

    def keep(name: str, view: int, _output: str, values: np.ndarray) -> None:
        pictures[name, view] = values.astype(np.float64)

    models = []
    for number, file in enumerate(files):
        glb = Glb.read(file)
        for node in glb.document["nodes"]:
            node.pop("camera", None)  # it would come before ours
        glb.set_cameras(sights.matrices, drawing.ANGLE, sights.near, sights.far)
        models.append(chromium.Model(str(number), glb.content(), outputs=(chromium.COLOR,)))
    chromium.render(modules, "three", models, views=len(DIRECTIONS), size=pixels, keep=keep)
    return [np.stack([pictures[str(number), view] for view in range(len(DIRECTIONS))]) for number in range(len(files))]


def compared(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, float]:
    """The differences of all pixels that show both, of 255 as sRGB, and the share of those that show one alone."""
    both, either = (way(before[..., 3] > 0.5, after[..., 3] > 0.5) for way in (np.logical_and, np.logical_or))
    off = np.abs(_srgb(before[both, :3]) - _srgb(after[both, :3])) * 255.0
    return off.mean(axis=-1), 1.0 - np.count_nonzero(both) / np.count_nonzero(either)


def _srgb(linear: np.ndarray) -> np.ndarray:
    clipped = linear.clip(0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1.0 / 2.4) - 0.055)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.glb")
    parser.add_argument("--words", default="", metavar="WORDS", help="options of the bake of each file")
    parser.add_argument("--size", type=int, default=1024, metavar="TEXELS")
    parser.add_argument("--view", type=int, default=768, metavar="PIXELS")
    parser.add_argument("--npm", type=Path, metavar="DIR")
    given = parser.parse_args()
    is_far = False
    try:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            modules = chromium.install(given.npm or folder)
            wanted = [(file, []) for file in given.files] or [
                (gltf_characters.character(folder / "character.glb"), ["--low", "Figure", "--uv", "UVMap.001"]),
                (gltf_characters.cart(folder / "cart.glb"), []),
                (gltf_characters.character(folder / "all.glb", seed=3), ["--pack-uvs"]),
            ]
            for file, words in wanted:
                target = baked(file, [*words, *given.words.split()], given.size)
                counts = [len(Glb.read(each).document["materials"]) for each in (file, target)]
                off, outline = compared(*shown([file, target], modules, given.view))
                print(
                    f"{file.stem}: {counts[0]} materials, then {counts[1]}: base color off by {off.mean():.2f} of 255 (mean), "
                    f"{np.percentile(off, 99):.1f} at the 99th percentile, {outline:.2%} outline, {len(off):,} pixels",
                    flush=True,
                )
                is_far |= bool(off.mean() > MOST or outline > MOST_OUTLINE)
    except chromium.NoEngine as error:
        sys.exit(f"materials_in_three.py: {error}")
    return int(is_far)


if __name__ == "__main__":
    sys.exit(main())
