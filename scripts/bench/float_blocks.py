#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what BC6H keeps of floats: Imprint's encoder beside Intel's ISPCTextureCompressor.

    .venv/bin/python scripts/bench/float_blocks.py [FILE.exr ...] [--size 512] [--rivals FOLDER]

Without files, maps are made: independent channels of high range, the same with edges, a light in one color, heights. All are
at least 0. For each encoder: the signal-to-noise ratio of values, in dB of the range of the map; the root mean square of the
differences in stops (log2), of values from 1/1000 of the largest on; and processor time, that of drivers for the CPU too.
--rivals: where the package is, `pip install --target FOLDER ispc-texcomp`.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402, F401
import gpu  # noqa: E402
import numpy as np  # noqa: E402

import addon  # noqa: E402
from addon.blocks.decoding import decoded  # noqa: E402
from addon.blocks.formats import BC6H, Purpose  # noqa: E402
from addon.passes.block_encoding import encoded  # noqa: E402
from tests.support import pictures  # noqa: E402

Encoder = Callable[[np.ndarray], np.ndarray]
"""From texels (H, W, 3) float32 to blocks."""


def encoders() -> dict[str, Encoder]:
    """Those of Imprint, and those of the other package that are there."""

    def of(purpose: Purpose) -> Encoder:
        return lambda texels: encoded(with_alpha(texels, np.float32), BC6H, purpose)

    found = {"Imprint, data": of(Purpose.DATA), "Imprint, colors": of(Purpose.COLOR)}
    try:
        import ispc_texcomp
    except ImportError:
        print("without ispc-texcomp")
        return found

    def by_ispc(profile: str) -> Encoder:
        settings = ispc_texcomp.BC6HEncSettings.from_profile(profile)

        def encode(texels: np.ndarray) -> np.ndarray:
            height, width = texels.shape[:2]
            halfs = with_alpha(np.minimum(texels, 65504), np.float16)
            surface = ispc_texcomp.RGBASurface(halfs.tobytes(), width, height, width * 8)
            blocks = ispc_texcomp.compress_blocks_bc6h(surface, settings)
            return np.frombuffer(blocks, np.uint8).reshape(height // 4, width // 4, 16)

        return encode

    return found | {f"ISPC, {profile}": by_ispc(profile) for profile in ("veryfast", "basic", "veryslow")}


def with_alpha(texels: np.ndarray, dtype: type) -> np.ndarray:
    """Colors (H, W, 3) with alpha 1."""
    return np.concatenate([texels, np.ones_like(texels[..., :1])], axis=2).astype(dtype)


def made_maps(size: int) -> Iterator[tuple[str, np.ndarray]]:
    """Names and maps (size, size, 3) float32."""
    random = np.random.default_rng(5)
    y, x = np.mgrid[:size, :size] / 128.0

    def waves(frequency: float) -> np.ndarray:
        """A sum of twelve waves of about so many periods in 128 texels."""
        sums = np.zeros((size, size))
        for _ in range(12):
            a, b = random.normal(0.0, frequency, 2)
            sums += random.normal() * np.sin(2.0 * np.pi * (a * x + b * y + random.random()))
        return sums

    channels = np.exp(0.5 * np.stack([waves(3.0) for _ in range(3)], axis=2))
    edges = np.where(waves(4.0)[..., None] > 0.0, 8.0, 1.0)
    light = np.exp(-((waves(1.0) - 1.0) ** 2))[..., None] * np.array([40.0, 22.0, 6.0])
    height = np.repeat(0.05 * waves(2.0)[..., None], 3, axis=2)
    for name, texels in (
        *(("independent channels", channels), ("the same with edges", channels * edges)),
        *(("light", light), ("heights", height - height.min())),
    ):
        yield name, texels.astype(np.float32)


def measured(texels: np.ndarray, read: np.ndarray) -> tuple[float, float]:
    """Decibels of values, and stops."""
    decibels = 10.0 * np.log10(np.ptp(texels) ** 2 / np.square(texels - read, dtype=float).mean())
    counted = texels > texels.max() / 1000.0
    stops = np.log2(np.maximum(read[counted], 1e-12)) - np.log2(texels[counted])
    return float(decibels), float(np.sqrt(np.square(stops, dtype=float).mean()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--rivals", type=Path)
    arguments = parser.parse_args()
    if arguments.rivals:
        sys.path.append(str(arguments.rivals))
    gpu.init()
    maps = [(path.name, pictures.as_stored(path)[..., :3]) for path in arguments.files]
    for name, given in maps or made_maps(arguments.size):
        height, width = (side // 4 * 4 for side in given.shape[:2])
        texels = np.maximum(given[:height, :width].astype(np.float32), 0.0)
        for encoder, encode in encoders().items():
            start = time.process_time()
            blocks = encode(texels)
            seconds = time.process_time() - start
            decibels, stops = measured(texels, decoded(blocks, BC6H))
            print(f"{name:22} {encoder:16} {decibels:6.2f} dB {stops:8.5f} stops {seconds:6.2f} s")
    addon.free()


if __name__ == "__main__":
    main()
