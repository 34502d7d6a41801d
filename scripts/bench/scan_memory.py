# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes a scan in a process of its own, and prints its seconds by stage and the most memory that it held.

.venv/bin/python scripts/bench/scan_memory.py [--triangles 2000000] [--textures 16] [--texture-size 4096] [--far] -- [option]...

The options after -- go to the bake, as --maps base-color. With --textures 0, the scan is a .blend of a sphere with painted
vertices; with more, it is an .obj. The files are made once, in out/scan_memory.
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
    parser.add_argument("--textures", type=int, default=16, metavar="N", help="a square number; 0 for painted vertices")
    parser.add_argument("--texture-size", type=int, default=4096, metavar="TEXELS")
    parser.add_argument("--far", action="store_true", help="georeferenced coordinates")
    parser.add_argument("bake", nargs="*", help="options of the bake")
    options = parser.parse_args()
    side = round((options.triangles / 2) ** 0.5)
    name = f"{side}_{options.textures}_{options.texture_size}{'_far' if options.far else ''}"
    folder = ROOT / "out" / "scan_memory" / name
    folder.mkdir(parents=True, exist_ok=True)
    if not options.textures:
        words = [str(folder / "scan.blend"), "--low", "low", "--high", "scan"]
        if not (folder / "scan.blend").exists():
            subprocess.run([sys.executable, __file__, "--paint", str(folder / "scan.blend"), str(side)], check=True)
    else:
        words = ["--low-file", str(folder / "low.obj"), "--high-file", str(folder / "scan.obj")]
        if not (folder / "scan.obj").exists():
            write_textures(folder, options.textures, options.texture_size)
            place = FAR if options.far else np.zeros(3)
            write_surface(folder / "low.obj", 50, place, 1)
            write_surface(folder / "scan.obj", side, place, options.textures)
    print(json.dumps(measured(folder, [*words, *options.bake]), indent=2))


def measured(folder: Path, words: list[str]) -> dict:
    """Seconds, the most memory in bytes and what the report says of a bake with these words."""
    files = ["--output", str(folder / "map.png"), "--report", str(folder / "report.json"), "--method", "cast"]
    start = time.perf_counter()
    done = subprocess.run([sys.executable, str(ROOT / "scripts" / "bake.py"), "--", *words, *files], check=False)
    seconds = time.perf_counter() - start
    if done.returncode:
        sys.exit(done.returncode)
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))["bakes"][0]["reports"][0]
    most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return {
        "seconds": round(seconds, 2),
        "peak_gib": round(most / 2**30, 2),
        "stages": {name: round(value, 2) for name, value in report["seconds"].items()},
        "triangles": report["triangles"],
    }


def write_painted(path: str, side: int) -> None:
    """Save a bumpy sphere of `side` x `side` quads, each of two triangles, with painted vertices, and a low sphere with UVs."""
    import bpy

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for name, bump, (columns, rows) in (("low", 0.0, (64, 32)), ("scan", 0.005, (side, side))):
        u, v = np.meshgrid(
            np.linspace(0.0, 1.0, columns + 1, dtype=np.float32), np.linspace(0.01, 0.99, rows + 1, dtype=np.float32)
        )
        around, down = 2.0 * np.pi * u, np.pi * v
        radius = 1.0 + bump * (np.sin(40.0 * around) * np.sin(40.0 * down) + 0.2 * np.sin(400.0 * around))
        across = radius * np.sin(down)
        points = np.stack([across * np.cos(around), across * np.sin(around), -radius * np.cos(down)], axis=-1)
        uv = np.stack([u, v], axis=-1).reshape(-1, 2)
        column, row = np.meshgrid(np.arange(columns, dtype=np.int32), np.arange(rows, dtype=np.int32))
        first = (column + row * (columns + 1)).ravel()
        quads = np.stack([first, first + 1, first + columns + 2, first + columns + 1], axis=1)
        triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        mesh = bpy.data.meshes.new(name)
        mesh.vertices.add(len(uv))
        mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
        mesh.loops.add(triangles.size)
        mesh.loops.foreach_set("vertex_index", triangles.ravel())
        mesh.polygons.add(len(triangles))
        mesh.polygons.foreach_set("loop_start", np.arange(0, triangles.size, 3, dtype=np.int32))
        mesh.update()
        mesh.shade_smooth()
        if name == "low":
            mesh.uv_layers.new().uv.foreach_set("vector", uv[triangles.ravel()].ravel())
        else:
            colors = np.ones((len(uv), 4), np.float32)
            colors[:, :2] = uv
            mesh.color_attributes.new("paint", "BYTE_COLOR", "POINT").data.foreach_set("color", colors.ravel())
            mesh.materials.append(painted())
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))
    bpy.ops.wm.save_as_mainfile(filepath=path)


def painted():
    """A material whose base color is the attribute "paint"."""
    import bpy

    material = bpy.data.materials.new("paint")
    material.use_nodes = True
    tree = material.node_tree
    source = tree.nodes.new("ShaderNodeVertexColor")
    source.layer_name = "paint"
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    tree.links.new(source.outputs["Color"], shader.inputs["Base Color"])
    return material


def write_surface(path: Path, side: int, place: np.ndarray, textures: int) -> None:
    """Write a bumpy square of `side` x `side` quads in a square number of textures, with a material for each."""
    u, v = (axis.ravel() for axis in np.meshgrid(*[np.linspace(0.0, 1.0, side + 1)] * 2))
    height = 2.0 * np.sin(3.0 * u) * np.sin(2.0 * v)
    if textures > 1:
        height += 0.05 * np.sin(211.0 * u) * np.sin(173.0 * v)
    points = np.stack([100.0 * u, height, -100.0 * v], axis=1) + place
    across = round(textures**0.5)
    scale = across if textures > 1 else 1
    uv = np.stack([u * scale, v * scale], axis=1)
    column, row = np.meshgrid(np.arange(side), np.arange(side))
    first = (column + row * (side + 1) + 1).ravel()
    quads = np.stack([first, first + 1, first + side + 2, first + side + 1], axis=1)
    texture = (column * across // side + row * across // side * across).ravel()
    with path.open("w", encoding="utf-8") as file:
        file.write("mtllib scan.mtl\n" if textures > 1 else "")
        file.write("v %.5f %.5f %.5f\n" * len(points) % tuple(points.ravel().tolist()))
        file.write("vt %.6f %.6f\n" * len(uv) % tuple(uv.ravel().tolist()))
        for number in range(textures):
            file.write(f"usemtl texture_{number}\n" if textures > 1 else "")
            own = quads[texture == number]
            triangles = np.concatenate([own[:, [0, 1, 2]], own[:, [0, 2, 3]]])
            file.write("f %d/%d %d/%d %d/%d\n" * len(triangles) % tuple(np.repeat(triangles.ravel(), 2).tolist()))


def write_textures(folder: Path, textures: int, size: int) -> None:
    """Write the textures, each of noise around its own color, and their material library."""
    import bpy

    random = np.random.default_rng(SEED)
    lines = []
    for number in range(textures):
        name = f"scan_u{number + 1}_v1_diffuse.jpg"
        lines.append(f"newmtl texture_{number}\nKd 1 1 1\nmap_Kd {name}\n")
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
    if sys.argv[1:2] == ["--paint"]:  # in a process of its own, whose memory does not count
        write_painted(sys.argv[2], int(sys.argv[3]))
    else:
        main()
