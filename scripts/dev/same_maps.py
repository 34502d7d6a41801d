#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that two checkouts bake the same bits: bakes each pair of a folder with both and compares the files.

    .venv/bin/python scripts/dev/same_maps.py OLD_CHECKOUT PAIRS_FOLDER [--size 512] [--out DIR]

Each .blend of PAIRS_FOLDER holds two objects, "hi" and "lo". They are baked by both methods, in all spaces, with all other
maps, once with one sample to OpenEXR, and once with four samples and Adjacent Faces to 16-bit PNG. For files that differ it
says by how much, and on how many texels. Both checkouts need their .venv.
"""

import argparse
import itertools
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parent.parent.parent
MAPS = ["position", "height", "displacement", "distance", "coverage", "object-id", "material-id"]
VARIANTS = {
    "one": ("exr", {"samples": 1}),
    "four": ("png", {"samples": 4, "margin-type": "adjacent-faces"}),
}


def sets(pairs: Path, out: Path, size: int):
    """The sets of the job file: each pair by each method, in each space, in each variant."""
    for file in sorted(pairs.glob("*.blend")):
        for method, space, variant in itertools.product(("flatten", "cast"), ("tangent", "object", "world"), VARIANTS):
            ending, options = VARIANTS[variant]
            yield {
                "file": str(file),
                "low": "lo",
                "high": ["hi"],
                "output": str(out / f"{file.stem}-{method}-{space}-{variant}.{ending}"),
                "method": method,
                "space": space,
                "size": size,
                "maps": MAPS,
                "mask": True,
                "no-material": True,
                **options,
            }


def bake(checkout: Path, pairs: Path, out: Path, size: int) -> None:
    out.mkdir(parents=True, exist_ok=True)
    jobs = out / "jobs.json"
    jobs.write_text(json.dumps({"bake": list(sets(pairs, out, size))}), encoding="utf-8")
    command = [sys.executable, str(checkout / "scripts" / "imprint.py"), "bake", "--jobs", str(jobs)]
    subprocess.run([*command, "--report", str(out / "report.json")], check=False, stdout=subprocess.DEVNULL)


def difference(old: Path, new: Path) -> str:
    """The difference between two image files, as text."""
    if not (old.is_file() and new.is_file()):
        return f"{(new if old.is_file() else old).parent.name} is missing"
    found = []
    for path in (old, new):
        image = bpy.data.images.load(str(path))
        image.colorspace_settings.is_data = True
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        found.append(pixels.reshape(-1, 4))
        bpy.data.images.remove(image)
    if found[0].shape != found[1].shape:
        return "another size"
    differences = np.abs(found[0] - found[1]).max(axis=1)
    return f"at most {differences.max():.2g}, on {np.count_nonzero(differences):,} of {len(differences):,} texels"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("pairs", type=Path)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    out = given.out or Path(tempfile.mkdtemp(prefix="imprint-same-maps-"))
    for name, checkout in (("old", given.old.resolve()), ("new", ROOT)):
        if not (out / name / "report.json").is_file():
            bake(checkout, given.pairs.resolve(), out / name, given.size)
    ignored = {"report.json", "jobs.json"}
    names = {path.name for which in ("old", "new") for path in (out / which).iterdir()} - ignored
    differing = [
        name
        for name in sorted(names)
        if not all((out / which / name).is_file() for which in ("old", "new"))
        or (out / "old" / name).read_bytes() != (out / "new" / name).read_bytes()
    ]
    print(f"{len(names) - len(differing)} of {len(names)} files are equal to the byte")
    for name in differing:
        print(f"differs: {name}: {difference(out / 'old' / name, out / 'new' / name)}")
    return bool(differing)


if __name__ == "__main__":
    sys.exit(main())
