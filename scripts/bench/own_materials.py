#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes materials of many kinds onto their own object, and says how far the maps are from what Cycles bakes of it.

    .venv/bin/python scripts/bench/own_materials.py [NAME ...] [--size 512] [--mixes 20]

Without NAME, all of tests/support/material_setups.py, and mixes of them. Numbers are steps of 8 bits: of colors as sRGB, of
normals in object space.
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import gpu  # noqa: E402

import addon  # noqa: E402
from tests.support import material_setups, own_bakes  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--size", type=int, default=512, metavar="TEXELS")
    parser.add_argument("--mixes", type=int, default=20, metavar="N")
    options = parser.parse_args()
    setups = dict(material_setups.SETUPS)
    if options.names:
        setups = {name: setups[name] for name in options.names}
    else:
        setups |= {f"mix {seed}": material_setups.mixed(seed) for seed in range(options.mixes)}
    gpu.init()
    addon.register()
    print("| set-up | input | mean | worst | on edges |\n|---|---|--:|--:|--:|")
    found = []
    for name, make in setups.items():
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        differences, _ = own_bakes.compare(name, make, (options.size, options.size))
        found += differences.values()
        for socket, one in differences.items():
            print(f"| {name} | {socket} | {one.mean:.3f} | {one.worst:.2f} | {one.jumps:.2%} |", flush=True)
    worst, mean = max(one.worst for one in found), sum(one.mean for one in found) / len(found)
    print(
        f"\n{len(setups)} materials, {len(found)} maps: mean {mean:.3f}, largest mean {max(one.mean for one in found):.3f}, "
    )
    print(f"worst {worst:.2f}; {sum(one.worst > 2.0 for one in found)} maps have a texel that is more than 2 off")


if __name__ == "__main__":
    main()
