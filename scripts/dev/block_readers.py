#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares what Imprint reads from blocks with OpenImageIO, Pillow and texture2ddecoder.

    .venv/bin/python scripts/dev/block_readers.py [--seed 1] [FILE.dds FILE.ktx2 MAP.exr ...]

Without files, random blocks of each mode of each format are read. With files, the largest level of each: OpenImageIO reads a
DDS file itself, the others its blocks. Other images are stored in all formats of blocks first. The first call installs
texture2ddecoder into out/decoders. Ends with 1 if any differs by more than its rule:

- BC7: not at all, in 8 bits. Pillow shows blocks without a mode in opaque black, which are left out.
- BC4, BC5: below 1/255. Imprint keeps the floats that GPUs interpolate; the others round to 8 bits, each its own way.
- BC6H: OpenImageIO not at all, in halfs. Pillow makes 8 bits of it, below 1.2/255, and texture2ddecoder, 0.51/255: both
  without signs. texture2ddecoder 1.0.6 takes an end in the middle of the range for the largest, and the largest for none of its
  own: it is compared with texels of blocks that are read in this way.
"""

import argparse
import subprocess
import sys
import tempfile
from itertools import product
from pathlib import Path
from unittest import mock

import bpy  # noqa: F401  it has gpu
import gpu
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import addon  # noqa: E402
from addon.blocks import decoding, formats  # noqa: E402
from addon.core import file_formats  # noqa: E402
from addon.output import containers, image_file  # noqa: E402
from tests.support import packed_blocks, pictures  # noqa: E402

ENVIRONMENT = ROOT / "out" / "decoders"
PACKAGE = "texture2ddecoder==1.0.6"


def installed():
    """The module texture2ddecoder."""
    if not (ENVIRONMENT / "texture2ddecoder").is_dir():
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--target", str(ENVIRONMENT), PACKAGE]
        subprocess.run(command, check=True)
    sys.path.append(str(ENVIRONMENT))
    import texture2ddecoder

    return texture2ddecoder


def by_texture2ddecoder(blocks, block_format):
    """(H, W, channels) uint8."""
    height, width = 4 * blocks.shape[0], 4 * blocks.shape[1]
    read = getattr(installed(), "decode_" + block_format.name.split("-")[0].removesuffix("h"))
    values = np.frombuffer(read(blocks.tobytes(), width, height), np.uint8).reshape(height, width, 4)
    return values[..., [2, 1, 0, 3][: block_format.channels]]


def unquantized_by_texture2ddecoder(values, precision, is_signed):
    """As decoding._unquantized, with the ends that texture2ddecoder confuses."""
    assert not is_signed
    if precision >= 15:
        return values
    wide = (values << 16) + 0x8000 >> precision
    return np.where(values == 0, 0, np.where(values == 1 << precision - 1, 0xFFFF, wide))


def largest(difference, is_left_out=None):
    """The largest difference (H, W, channels) of texels, without those of blocks (R, C) that are left out."""
    of_blocks = difference.reshape(difference.shape[0] // 4, 4, -1, 4, difference.shape[2]).max((1, 3, 4))
    return float(of_blocks[~is_left_out].max(initial=0) if is_left_out is not None else of_blocks.max())


def compared(path, blocks, block_format, size):
    """Rows of a program, the largest difference in 255ths (of halfs: of values), and the rule."""
    width, height = size
    ours = decoding.decoded(blocks, block_format)
    low = blocks[..., 0]
    theirs = pictures.as_stored(path)[..., : block_format.channels].astype(np.float32)
    if block_format.is_float:
        yield "OpenImageIO", float(np.abs(ours[:height, :width] - theirs).max()), 0.0
        if block_format.is_signed:
            return
        steps = np.clip(ours, 0, 1) * 255
        yield "Pillow", largest(np.abs(steps - packed_blocks.pillow(blocks, block_format.dxgi)[..., :3])), 1.2
        with mock.patch.object(decoding, "_unquantized", unquantized_by_texture2ddecoder):
            as_theirs = np.clip(decoding.decoded(blocks, block_format), 0, 1) * 255
        own = float((np.rint(steps) != np.rint(as_theirs)).any(2).mean())
        print(f"texture2ddecoder confuses ends of {own:.1%} of the texels")
        yield "texture2ddecoder", largest(np.abs(as_theirs - by_texture2ddecoder(blocks, block_format))), 0.51
        return
    is_exact = block_format is formats.BC7
    steps = np.rint(ours * 255) if is_exact else ours * 255
    rule = 0.0 if is_exact else 0.999
    yield "OpenImageIO", float(np.abs(steps[:height, :width] - theirs).max()), rule
    bytes_of_pillow = packed_blocks.pillow(blocks, block_format.dxgi)[..., : block_format.channels]
    yield "Pillow", largest(np.abs(steps - bytes_of_pillow), low == 0 if is_exact else None), rule
    yield "texture2ddecoder", largest(np.abs(steps - by_texture2ddecoder(blocks, block_format))), rule


def in_blocks(path, folder):
    """The file at a path, if it has blocks; an image in each format of blocks and each container, in a folder."""
    if file_formats.of(path).is_blocks:
        yield path
        return
    gpu.init()
    texels = image_file.read(path)
    for each, container in product(formats.FORMATS, (file_formats.DDS, file_formats.KTX2)):
        file = folder / f"{path.stem} {each.name}{container.endings[0]}"
        purpose = formats.Purpose.NORMAL if each is formats.BC5 else formats.Purpose.DATA
        values = texels * 2.0 - 1.0 if each.is_signed else texels
        held = image_file.Blocks(each, purpose, has_map_in_alpha=True)
        how = {"has_alpha": each.channels == 4, "is_color": False, "note": ""}
        held.content(values.astype(np.float32), file, **how).write(file, iter(()))
        yield file


def show(name, rows):
    """Print the rows, and tell whether all keep their rules."""
    kept = True
    for program, difference, rule in rows:
        kept &= difference <= rule
        print(f"{name:24} {program:18} {difference:10.5f}  {'kept' if difference <= rule else f'above {rule}'}")
    return kept


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    kept, count = True, 0
    with tempfile.TemporaryDirectory() as folder:
        files = [file for path in arguments.files for file in in_blocks(path, Path(folder))]
        contents = [(path.name, path, containers.read(path)) for path in files]
        maps = [(name, path, content.levels[0], content.block_format, content.size) for name, path, content in contents]
        for each in formats.FORMATS if not arguments.files else ():
            blocks = packed_blocks.random_blocks(each.name, arguments.seed, 1024)
            maps.append((f"random {each.label}", None, blocks, each, (4 * blocks.shape[1], 4 * blocks.shape[0])))
        for name, path, blocks, block_format, size in maps:
            rows = compared(path, blocks, block_format, size)
            if path is None or path.suffix.lower() != ".dds":
                made = Path(folder, "blocks.dds")
                made.write_bytes(packed_blocks.dds(blocks, block_format.dxgi))
                rows = compared(made, blocks, block_format, (4 * blocks.shape[1], 4 * blocks.shape[0]))
            rows = list(rows)
            kept, count = kept & show(name, rows), count + len(rows)
    print(f"{len(maps)} of blocks, {count} comparisons")
    addon.free()
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
