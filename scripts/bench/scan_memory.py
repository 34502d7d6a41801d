# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes a scan with many pages in a process of its own, and prints its seconds and the most memory that it held.

.venv/bin/python scripts/bench/scan_memory.py [--triangles 2000000] [--pages 16] [--page-size 4096] [--far] -- [option ...]

The options after -- go to the bake, as --maps base-color. The files are made once, in out/scan_memory.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
SEED = 1
FAR = np.array([512_345.0, 5_412_345.0, 312.0])
"""A place in meters, as in maps of a country."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--triangles", type=int, default=2_000_000, metavar="N")
    parser.add_argument("--pages", type=int, default=16, metavar="N", help="a square number")
    parser.add_argument("--page-size", type=int, default=4096, metavar="TEXELS")
    parser.add_argument("--far", action="store_true", help="georeferenced coordinates")
    parser.add_argument("bake", nargs="*", help="options of the bake")
    options = parser.parse_args()
    side = round((options.triangles / 2) ** 0.5)
    name = f"{side}_{options.pages}_{options.page_size}{'_far' if options.far else ''}"
    folder = ROOT / "out" / "scan_memory" / name
    if not (folder / "scan.obj").exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_pages(folder, options.pages, options.page_size)
        place = FAR if options.far else np.zeros(3)
        write_surface(folder / "low.obj", 50, place, 1)
        write_surface(folder / "scan.obj", side, place, options.pages)
    print(json.dumps(measured(folder, options.bake), indent=2))


def measured(folder: Path, words: list[str]) -> dict:
    """Seconds, the most memory in bytes and the report of a bake of the files in `folder`."""
    files = ["--low-file", str(folder / "low.obj"), "--high-file", str(folder / "scan.obj")]
    files += ["--output", str(folder / "map.png"), "--report", str(folder / "report.json"), "--method", "cast"]
    start = time.perf_counter()
    done = subprocess.run([sys.executable, str(ROOT / "scripts" / "bake.py"), "--", *files, *words], check=False)
    seconds = time.perf_counter() - start
    if done.returncode:
        sys.exit(done.returncode)
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return {
        "seconds": round(seconds, 2),
        "peak_bytes": most,
        "peak_gib": round(most / 2**30, 2),
        "said_before": report.get("memory", {}),
        "bake_seconds": report["seconds"],
        "triangles": report["triangles"],
    }


def write_surface(path: Path, side: int, place: np.ndarray, pages: int) -> None:
    """Write a bumpy square of `side` x `side` quads in a square number of pages, with a material for each."""
    u, v = (axis.ravel() for axis in np.meshgrid(*[np.linspace(0.0, 1.0, side + 1)] * 2))
    height = 2.0 * np.sin(3.0 * u) * np.sin(2.0 * v)
    if pages > 1:
        height += 0.05 * np.sin(211.0 * u) * np.sin(173.0 * v)
    points = np.stack([100.0 * u, height, -100.0 * v], axis=1) + place
    across = round(pages**0.5)
    scale = across if pages > 1 else 1
    uv = np.stack([u * scale, v * scale], axis=1)
    column, row = np.meshgrid(np.arange(side), np.arange(side))
    first = (column + row * (side + 1) + 1).ravel()
    quads = np.stack([first, first + 1, first + side + 2, first + side + 1], axis=1)
    page = (column * across // side + row * across // side * across).ravel()
    with path.open("w", encoding="utf-8") as file:
        file.write("mtllib scan.mtl\n" if pages > 1 else "")
        file.write("v %.5f %.5f %.5f\n" * len(points) % tuple(points.ravel().tolist()))
        file.write("vt %.6f %.6f\n" * len(uv) % tuple(uv.ravel().tolist()))
        for number in range(pages):
            file.write(f"usemtl page_{number}\n" if pages > 1 else "")
            own = quads[page == number]
            triangles = np.concatenate([own[:, [0, 1, 2]], own[:, [0, 2, 3]]])
            file.write("f %d/%d %d/%d %d/%d\n" * len(triangles) % tuple(np.repeat(triangles.ravel(), 2).tolist()))


def write_pages(folder: Path, pages: int, size: int) -> None:
    """Write the pages, each of noise around its own color, and their material library."""
    import bpy

    random = np.random.default_rng(SEED)
    lines = []
    for number in range(pages):
        name = f"scan_u{number + 1}_v1_diffuse.jpg"
        lines.append(f"newmtl page_{number}\nKd 1 1 1\nmap_Kd {name}\n")
        coarse = random.uniform(0.2, 0.8, (1, 1, 3)) + random.uniform(-0.2, 0.2, (size // 16, size // 16, 3))
        pixels = np.ones((size, size, 4), np.float32)
        pixels[..., :3] = coarse.repeat(16, axis=0).repeat(16, axis=1)
        image = bpy.data.images.new(name, size, size)
        image.pixels.foreach_set(pixels.ravel())
        image.filepath_raw, image.file_format = os.fspath(folder / name), "JPEG"
        image.save()
        bpy.data.images.remove(image)
    (folder / "scan.mtl").write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
