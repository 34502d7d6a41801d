#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes game assets by the command line, draws their .glb in three.js, and compares them with the high meshes.

    .venv/bin/python scripts/dev/assets_in_three.py [--degrees 2] [--size 2048] [--npm DIR] FILE.blend ...

Needs Chromium and npm, as engines.py does. The object "hi" of each file is the high mesh; all others are left out. Cameras
around the asset see it from several sides. On each pixel that shows the asset in three.js and the high mesh, the shading error
is the angle between the normals: of three.js's own shader, and of the high mesh's corners in float64.

Ends with 1 if the 99th percentile of an asset is more than a degree above the limit, or above what `asset` itself reports if
that misses the limit.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402

from addon.core.declarations import targets  # noqa: E402
from scripts.dev.in_engines import chromium, drawing, samples  # noqa: E402
from scripts.dev.in_engines.glb_file import Glb, unit  # noqa: E402
from tests.support import angles  # noqa: E402

MORE = 1.0
"""Degrees by which three.js may show more than the limit."""
DIRECTIONS = (
    (0.4, 0.3, 1.0),
    (-0.5, -0.2, -1.0),
    (1.0, 0.5, -0.3),
    (-1.0, 0.1, 0.4),
    (0.2, 1.0, 0.3),
    (0.3, -1.0, -0.2),
)
"""From the asset to the eyes, in the axes of glTF."""


def alone(file: Path, into: Path) -> tuple[np.ndarray, np.ndarray]:
    """Save the high object of a file alone. Returns its triangles by corner in the axes of glTF: points and normals
    (T, 3, 3)."""
    bpy.ops.wm.open_mainfile(filepath=str(file))
    high = bpy.data.objects["hi"]
    for obj in [obj for obj in bpy.data.objects if obj is not high]:
        bpy.data.objects.remove(obj)
    bpy.ops.wm.save_as_mainfile(filepath=str(into))
    mesh, matrix = high.data, np.array(high.matrix_world)
    mesh.calc_loop_triangles()
    corners = np.array([triangle.loops for triangle in mesh.loop_triangles])
    points = np.array([vertex.co for vertex in mesh.vertices]) @ matrix[:3, :3].T + matrix[:3, 3]
    vertices = np.array([loop.vertex_index for loop in mesh.loops])
    normals = np.array([normal.vector for normal in mesh.corner_normals])
    normals = unit(normals @ np.linalg.inv(matrix[:3, :3])) @ samples.TO_GLTF.T
    return (points @ samples.TO_GLTF.T)[vertices[corners]], normals[corners]


def made(file: Path, glb: Path, degrees: float, size: int) -> dict:
    """Make an asset by the command line. Returns its report."""
    report = glb.with_suffix(".json")
    words = [
        str(ROOT / "scripts" / "imprint.py"),
        "asset",
        str(file),
        "--degrees",
        f"{degrees:g}",
        "--export",
        str(glb),
    ]
    words += ["--size", str(size), "--basis", targets.BY_NAME["three"].basis.name, "--report", str(report)]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    if not glb.is_file():
        raise SystemExit(f"{file.stem}: the asset was not made:\n{done.stdout}{done.stderr}")
    return json.loads(report.read_text(encoding="utf-8"))


def compared(
    glb: Glb, high: tuple[np.ndarray, np.ndarray], modules: Path, pixels: int, *, shape: np.ndarray | None = None
) -> tuple[np.ndarray, float]:
    """The degrees of all pixels that show both, and the share of those that show one alone. shape (T, 3, 3): where the corners
    of the file are, if bones move them."""
    points, normals = high
    sights = drawing.look_around(glb.surface().position if shape is None else shape, DIRECTIONS, pixels)
    glb.set_cameras(sights.matrices, drawing.ANGLE, sights.near, sights.far)
    shown: dict[int, np.ndarray] = {}

    def keep(_name: str, view: int, _output: str, values: np.ndarray) -> None:
        shown[view] = values.astype(np.float64)

    model = chromium.Model("asset", glb.content())
    chromium.render(modules, "three", [model], views=len(DIRECTIONS), size=pixels, keep=keep)
    lens = drawing.perspective(drawing.ANGLE, sights.near, sights.far)
    whole = np.concatenate([points, np.ones((*points.shape[:2], 1))], axis=-1)
    found, single, either = [], 0, 0
    for view, matrix in enumerate(sights.matrices):
        drawn = drawing.draw(whole @ (lens @ matrix).T, pixels)
        is_low = shown[view][..., 3] > 0.5
        both = is_low & drawn.there
        expected = np.einsum("ncx,nc->nx", normals[drawn.triangle[both]], drawn.weights[both])
        found.append(angles.degrees(unit(shown[view][both, :3] * 2.0 - 1.0), unit(expected)))
        single += np.count_nonzero(is_low ^ drawn.there)
        either += np.count_nonzero(is_low | drawn.there)
    return np.concatenate(found), single / either


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.blend")
    parser.add_argument("--degrees", type=float, default=2.0, metavar="DEGREES")
    parser.add_argument("--size", type=int, default=2048, metavar="TEXELS")
    parser.add_argument("--view", type=int, default=1536, metavar="PIXELS")
    parser.add_argument("--npm", type=Path, metavar="DIR")
    given = parser.parse_args()
    is_far = False
    try:
        with tempfile.TemporaryDirectory() as temporary:
            modules = chromium.install(given.npm or Path(temporary))
            for file in given.files:
                source, glb = Path(temporary) / f"{file.stem}.blend", Path(temporary) / f"{file.stem}.glb"
                high = alone(file, source)
                report = made(source, glb, given.degrees, given.size)
                (asset,) = report["bakes"][0]["reports"]
                degrees, single = compared(Glb.read(glb), high, modules, given.view)
                median, most = np.percentile(degrees, (50, 99))
                own = asset["appearance"]["percentile_99"]
                print(
                    f"{file.stem}: {asset['triangles']['low']:,} of {asset['triangles']['high']:,} triangles, Imprint "
                    f"{own:.2f} degrees at the 99th percentile, three.js {median:.2f} median, {most:.2f} at the 99th, "
                    f"{single:.2%} outline, {len(degrees):,} pixels",
                    flush=True,
                )
                is_far |= bool(most > max(given.degrees, own) + MORE)
    except chromium.NoEngine as error:
        sys.exit(f"assets_in_three.py: {error}")
    return int(is_far)


if __name__ == "__main__":
    sys.exit(main())
