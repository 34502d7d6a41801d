#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""What BC7 loses of base colors and packed maps: PSNR of our encoder and of etcpak's (bc7enc) at its slowest setting.

    .venv/bin/python scripts/bench/format_colors.py PAIRS_FOLDER [--size 1024] [--kept FOLDER] [PAIR ...]

PAIRS_FOLDER has .blend files with the objects "hi" and "lo". Their places are baked, and the maps are painted from
these, since the pairs have no materials: stone, rust and worn edges with grain as colors; the sky that is seen, roughness
and metal as a packed map; and the colors with an alpha of holes and soft edges. --kept keeps the bakes in a folder.

Needs `pip install etcpak texture2ddecoder`; PYTHONPATH may name where they are. The decoder is texture2ddecoder for both.
PSNR is of linear values for colors, of stored values for packed maps, over covered texels. Seconds are of the processor.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402, F401
import etcpak  # noqa: E402
import gpu  # noqa: E402
import numpy as np  # noqa: E402
import texture2ddecoder  # noqa: E402

import addon  # noqa: E402
from addon.blocks.formats import BC7, Purpose  # noqa: E402
from addon.passes import block_encoding  # noqa: E402
from scripts.bench import scenes  # noqa: E402
from tests.support import maps  # noqa: E402

PAIRS = ("helmet", "king", "shaderball_48048", "spot_1696")
SEED = 46


# Maps


def baked(folder: Path, name: str, size: int, kept: Path | None) -> np.ndarray:
    """The places (H, W, 4) of the high surface in the world, whose alpha is coverage, the top row first."""
    file = kept and kept / f"{name}_{size}.npy"
    if file and file.is_file():
        return np.load(file)
    pair = scenes.opened(next(iter(sorted(folder.glob(f"{name}*.blend")))))
    found = maps.bake_all_maps(pair.low, pair.high, maps=["POSITION"], size=size, space="WORLD")[1]
    places = np.ascontiguousarray(found["position"][::-1])
    if file:
        file.parent.mkdir(parents=True, exist_ok=True)
        np.save(file, places)
    return places


def normals_of(places: np.ndarray) -> np.ndarray:
    """Unit normals (H, W, 3), from the places of texels beside each other."""
    across, along = (np.gradient(places[..., :3], axis=axis) for axis in (1, 0))
    normals = np.cross(along, across)
    return normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)


def waves(places: np.ndarray, random: np.random.Generator, frequency: float, count: int = 12) -> np.ndarray:
    """Smooth noise (H, W) about 0 with a deviation of about 1: waves in random directions."""
    directions = random.normal(size=(3, count)) * frequency
    phases = random.uniform(0.0, 2.0 * np.pi, count)
    return np.sqrt(2.0 / count) * np.sin(places[..., :3] @ directions + phases).sum(-1)


def smooth_step(low: float, high: float, values: np.ndarray) -> np.ndarray:
    share = np.clip((values - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def painted(places: np.ndarray) -> dict[str, np.ndarray]:
    """The maps by name, (H, W, 4) float32 from 0 to 1; 0 and opaque where nothing is covered."""
    random = np.random.default_rng(SEED)
    covered = places[..., 3] > 0.0
    places = places / np.ptp(places[covered][:, :3], axis=0).max()
    octaves = [waves(places, random, 2.0 * np.pi * 2.0**octave) / 1.5**octave for octave in range(1, 8)]
    normals = normals_of(places)
    turns = np.linalg.norm(normals - np.roll(normals, 1, (0, 1)), axis=-1)
    sky = np.clip(0.6 + 0.4 * normals[..., 2] + 0.1 * octaves[2], 0.0, 1.0)
    rust = smooth_step(0.2, 0.9, sum(octaves) * 0.5 + 0.5 - sky)
    worn = smooth_step(0.1, 0.5, turns + 0.1 * waves(places, random, 300.0))
    grain = random.normal(size=places.shape[:2]) * 0.012
    stone, orange, bare = np.array([[0.42, 0.44, 0.40], [0.46, 0.22, 0.10], [0.72, 0.70, 0.66]])
    color = stone + (orange - stone) * rust[..., None] + 0.05 * octaves[3][..., None] * np.array([1.0, 0.8, 0.6])
    color += (bare - color) * worn[..., None]
    color *= 0.6 + 0.4 * sky[..., None]
    color += grain[..., None]
    metal = smooth_step(0.45, 0.55, 1.0 - rust)
    roughness = 0.35 + 0.45 * rust - 0.2 * worn + 0.08 * octaves[5] + grain
    alpha = smooth_step(-0.3, -0.2, octaves[2] + 0.4 * octaves[4])
    opaque = np.ones_like(metal)
    layers = {
        "base color": [*color.transpose(2, 0, 1), opaque],
        "packed": [sky, roughness, metal, opaque],
        "color, alpha": [*color.transpose(2, 0, 1), alpha],
    }
    background = np.array([0.0, 0.0, 0.0, 1.0])
    return {
        name: np.where(covered[..., None], np.clip(np.stack(each, -1), 0.0, 1.0), background).astype(np.float32)
        for name, each in layers.items()
    }


# Encoders


def rival(texels: np.ndarray, has_alpha: bool) -> np.ndarray:
    """etcpak's blocks (R, C, 16) by bc7enc with all partitions, least squares and the most attempts."""
    params = etcpak.BC7CompressBlockParams()
    params.init_linear_weights()
    params.m_max_partitions, params.m_uber_level, params.m_try_least_squares = 64, 4, True
    params.m_mode17_partition_estimation_filterbank = False
    rounded = np.round(255.0 * texels).astype(np.uint8)
    if not has_alpha:
        rounded[..., 3] = 255
    height, width = texels.shape[:2]
    blocks = etcpak.compress_bc7(rounded.tobytes(), width, height, params)
    return np.frombuffer(blocks, np.uint8).reshape(height // 4, width // 4, 16)


def shown(blocks: np.ndarray) -> np.ndarray:
    """The texels (H, W, 4) of blocks, from 0 to 1."""
    rows, columns = blocks.shape[:2]
    texels = texture2ddecoder.decode_bc7(np.ascontiguousarray(blocks).tobytes(), 4 * columns, 4 * rows)
    return np.frombuffer(texels, np.uint8).reshape(4 * rows, 4 * columns, 4)[..., [2, 1, 0, 3]] / 255.0


def linear(values: np.ndarray) -> np.ndarray:
    curved = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return np.concatenate([curved[..., :3], values[..., 3:]], -1)


def psnr(found: np.ndarray, texels: np.ndarray, covered: np.ndarray, *, is_color: bool, has_alpha: bool) -> float:
    """In decibels, over covered texels (H, W) and the channels that the map has."""
    if is_color:
        found, texels = linear(found), linear(texels)
    off = (found - texels)[covered][:, : 4 if has_alpha else 3]
    return float(-10.0 * np.log10(np.mean(np.square(off, dtype=float))))


def rows(folder: Path, names: list[str], size: int, kept: Path | None) -> Iterator[str]:
    yield "| pair | map | ours, dB | etcpak, dB | more | ours, s for 1,000 blocks | etcpak |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for name in names:
        places = baked(folder, name, size, kept)
        for kind, texels in painted(places).items():
            is_color, has_alpha = kind != "packed", kind == "color, alpha"
            purpose = Purpose.COLOR if is_color else Purpose.DATA
            started = time.process_time()
            ours = block_encoding.encoded(texels, BC7, purpose)
            between = time.process_time()
            theirs = rival(texels, has_alpha)
            ended = time.process_time()
            found = [
                psnr(shown(blocks), texels, places[..., 3] > 0.0, is_color=is_color, has_alpha=has_alpha)
                for blocks in (ours, theirs)
            ]
            thousands = ours.shape[0] * ours.shape[1] / 1000.0
            seconds = (between - started) / thousands, (ended - between) / thousands
            yield (
                f"| {name} | {kind} | {found[0]:.2f} | {found[1]:.2f} | {found[0] - found[1]:+.2f} | {seconds[0]:.3f} "
                f"| {seconds[1]:.3f} |"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", default=PAIRS)
    parser.add_argument("--size", type=int, default=1024)
    parser.add_argument("--kept", type=Path)
    options = parser.parse_args()
    gpu.init()
    block_encoding.encoded(np.ones((8, 8, 4), np.float32), BC7, Purpose.COLOR)  # compiles
    for line in rows(options.folder, options.names, options.size, options.kept):
        print(line, flush=True)
    addon.free()


if __name__ == "__main__":
    main()
