#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what storing a normal map costs, in degrees: Imprint's blocks beside 8-bit, WebP and JPEG files and the encoders of
others.

    .venv/bin/python scripts/bench/format_degrees.py [PAIR.blend ...] [--size 1024] [--samples 4] [--rivals FOLDER]

Each PAIR.blend holds two objects, "hi" and "lo"; without one, those of NAMES in ../shared/assets/pairs. Maps are baked in
32-bit floats. What a format keeps of them is decoded as GPUs do, z is made from x and y in two channels, and each texel that
the low mesh covers is compared with the bake: mean and 99th percentile.

Imprint encodes floats, the others the same map in 8 bits, which is what they take. --rivals: where their packages are,
`pip install --target FOLDER etcpak quicktex`. Those that are missing are left out; nvcompress is found by its path.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import gpu  # noqa: E402
import numpy as np  # noqa: E402

import addon  # noqa: E402
from addon.blocks.decoding import decoded  # noqa: E402
from addon.blocks.formats import BC5, BC7, BlockFormat, Purpose  # noqa: E402
from addon.output import image_file  # noqa: E402
from addon.passes.block_encoding import encoded  # noqa: E402
from tests.support import angles, maps  # noqa: E402

NAMES = "helmet_23358_6117", "kepler_199712_9079", "king_40480_4000", "spot_1696_536"
MARGIN = 16
QUALITIES = 100, 90, 75
"""Of WebP and JPEG. WebP has no losses at 100."""
BESIDE = 1.0 / 16.0
"""The weight of texels that the low mesh does not cover."""

Encoder = Callable[[np.ndarray], np.ndarray]
"""From a map (H, W, 4) float32, the top row first, to what is read of it: (H, W, channels)."""


def imprint_encoders(weights: np.ndarray) -> dict[str, Encoder]:
    """Those of Imprint. weights: (H, W) float32."""

    def bc5(texels: np.ndarray) -> np.ndarray:
        return decoded(encoded(texels, BC5, Purpose.NORMAL, weights), BC5)

    def bc7(texels: np.ndarray) -> np.ndarray:
        opaque = np.concatenate([texels[..., :3], np.ones_like(texels[..., 3:])], axis=2)
        return decoded(encoded(opaque, BC7, Purpose.NORMAL, weights), BC7)[..., :3]

    plain: dict[str, Encoder] = {"8-bit RGB": eight_bits, "8-bit RG": lambda texels: eight_bits(texels)[..., :2]}
    lossy = {
        f"{name} {quality}": partial(in_file, ending=ending, quality=quality)
        for name, ending in (("WebP", ".webp"), ("JPEG", ".jpg"))
        for quality in QUALITIES
    }
    return {**plain, "BC5, Imprint": bc5, "BC7, Imprint": bc7, **lossy}


def in_file(texels: np.ndarray, ending: str, quality: int) -> np.ndarray:
    """The map as a file of a lossy format keeps it, (H, W, 3)."""
    return image_file.after_losses(texels, f"map{ending}", quality)[..., :3]


def eight_bits(texels: np.ndarray) -> np.ndarray:
    """The map as an 8-bit file keeps it, (H, W, 3)."""
    return np.round(np.clip(texels[..., :3], 0.0, 1.0) * 255.0) / 255.0


def rivals() -> dict[str, Encoder]:
    """Those of other packages that are installed."""
    found: dict[str, Encoder] = {}
    try:
        import etcpak

        found["BC5, etcpak"] = lambda texels: of_bytes(etcpak.compress_bc5(*in_bytes(texels)), texels, BC5)
        found["BC7, etcpak"] = lambda texels: of_bytes(etcpak.compress_bc7(*in_bytes(texels)), texels, BC7)
    except ImportError:
        print("without etcpak")
    try:
        import quicktex
        import quicktex.s3tc.bc5

        def by_quicktex(texels: np.ndarray) -> np.ndarray:
            raw = quicktex.RawTexture.frombytes(*in_bytes(texels))
            return of_bytes(quicktex.s3tc.bc5.BC5Encoder().encode(raw).tobytes(), texels, BC5)

        found["BC5, quicktex"] = by_quicktex
    except ImportError:
        print("without quicktex")
    if (program := shutil.which("nvcompress")) is not None:
        found["BC5, nvcompress"] = lambda texels: by_nvcompress(program, texels)
    return found


def in_bytes(texels: np.ndarray) -> tuple[bytes, int, int]:
    """A map in 8 bits, with its width and height."""
    height, width = texels.shape[:2]
    filled = np.ones((height, width, 4))
    filled[..., :3] = eight_bits(texels)
    return np.round(filled * 255.0).astype(np.uint8).tobytes(), width, height


def of_bytes(blocks: bytes, texels: np.ndarray, block_format: BlockFormat) -> np.ndarray:
    """The texels of blocks of a map as large as `texels`; of BC7, red, green and blue."""
    shape = texels.shape[0] // 4, texels.shape[1] // 4, block_format.size
    return decoded(np.frombuffer(blocks, np.uint8).reshape(shape), block_format)[..., :3]


def by_nvcompress(program: str, texels: np.ndarray) -> np.ndarray:
    """BC5 by NVIDIA's texture tools 2, not at their fast setting."""
    with tempfile.TemporaryDirectory() as folder:
        source, result = Path(folder, "map.tga"), Path(folder, "map.dds")
        data, width, height = in_bytes(texels)
        colors = np.frombuffer(data, np.uint8).reshape(height, width, 4)[..., [2, 1, 0, 3]]
        head = bytes([0, 0, 2, *[0] * 9, width % 256, width // 256, height % 256, height // 256, 32, 0x28])
        source.write_bytes(head + colors.tobytes())
        command = [program, "-nomips", "-bc5", str(source), str(result)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        size = width * height
        return of_bytes(result.read_bytes()[-size:], texels, BC5)


def normals(read: np.ndarray) -> np.ndarray:
    """The unit normals (H, W, 3) float64 that an engine makes of a map (H, W, 2 or 3)."""
    if read.shape[2] == 3:
        return angles.decode(read)
    plane = read.astype(np.float64) * 2.0 - 1.0
    z = np.sqrt(np.maximum(0.0, 1.0 - (plane**2).sum(axis=2, keepdims=True)))
    vectors = np.concatenate([plane, z], axis=2)
    return vectors / np.linalg.norm(vectors, axis=2, keepdims=True)


def baked(file: Path, size: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """The normal map of a pair (H, W, 4) float32, the top row first, with a margin, and where the low mesh has a hit."""
    bpy.ops.wm.open_mainfile(filepath=str(file))
    low, high = (bpy.data.objects[name] for name in ("lo", "hi"))
    with_margin, alone = (
        maps.bake(low, high, size=(size, size), samples=samples, method="CAST", margin=margin)[::-1]
        for margin in (MARGIN, 0)
    )
    return np.ascontiguousarray(with_margin), alone[..., 3] > 0.0


def rows(texels: np.ndarray, covered: np.ndarray) -> Iterator[tuple[str, float, float, float]]:
    """For each format: its name, the mean and the 99th percentile in degrees, and seconds of this process."""
    truth = angles.decode(texels)[covered]
    weights = np.where(covered, 1.0, BESIDE).astype(np.float32)
    for name, encode in {**imprint_encoders(weights), **rivals()}.items():
        start = time.process_time()
        read = encode(texels)
        seconds = time.process_time() - start
        off = angles.degrees(normals(read)[covered], truth)
        yield name, float(off.mean()), float(np.percentile(off, 99)), seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", nargs="*", type=Path, metavar="PAIR.blend")
    parser.add_argument("--size", type=int, default=1024, help="of the maps, in texels along a side")
    parser.add_argument("--samples", type=int, default=4, help="of a texel")
    parser.add_argument("--rivals", type=Path, metavar="FOLDER", help="where packages of others are")
    given = parser.parse_args()
    if given.size < 4 or given.size % 4:
        parser.error(f"--size has to be a multiple of 4, not {given.size}")
    if given.rivals:
        sys.path.append(str(given.rivals))
    folder = ROOT.parent / "shared" / "assets" / "pairs"
    gpu.init()
    for file in given.pairs or [folder / f"{name}.blend" for name in NAMES]:
        texels, covered = baked(file, given.size, given.samples)
        print(f"\n{file.stem}: {covered.mean():.0%} covered\n", flush=True)
        print("| format | mean, degrees | p99 | processor, s |\n| --- | --- | --- | --- |")
        for name, mean, most, seconds in rows(texels, covered):
            print(f"| {name} | {mean:.3f} | {most:.2f} | {seconds:.2f} |", flush=True)
    addon.free()


if __name__ == "__main__":
    main()
