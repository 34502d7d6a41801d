# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of scans as other programs write them: text meshes with pages."""

import bpy
import numpy as np

from addon.scene import dependencies

COLORS = ((0.9, 0.1, 0.2), (0.2, 0.8, 0.1), (0.1, 0.3, 0.9), (0.7, 0.6, 0.1))
"""A color, as stored, for each page."""


def texture(path, color, side=8):
    """Write an image of one color, as stored."""
    image = bpy.data.images.new("page", side, side)
    image.pixels.foreach_set(np.tile(np.array([*color, 1.0], np.float32), side * side))
    image.filepath_raw, image.file_format = str(path), "PNG" if path.suffix == ".png" else "JPEG"
    image.save()
    bpy.data.images.remove(image)


def strips(count, place=(0.0, 0.0, 0.0), height=0.0, n=8):
    """A wavy square -1..1 in (n, n) quads around `place`, in `count` strips along x.

    Returns points (V, 3) float64, UVs (V, 2) that fill 0..1, and for each strip its faces (F, 4).
    """
    u, v = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1)))
    points = np.stack([2 * u - 1, 2 * v - 1, height * np.sin(9 * u) * np.sin(7 * v)], axis=1) + np.array(place)
    i, j = np.meshgrid(np.arange(n), np.arange(n))
    first = i + j * (n + 1)
    faces = np.stack([first, first + 1, first + n + 2, first + n + 1], axis=-1)
    return (
        points,
        np.stack([u, v], axis=1),
        [faces[:, part].reshape(-1, 4) for part in np.array_split(np.arange(n), count)],
    )


def write_obj(path, surface, *, materials=None, library=None, uv_offsets=None, digits=6):
    """Write an .obj, whose Y is up. surface: as `strips` returns it. materials: of each part. uv_offsets: (2,) of each part."""
    points, uv, parts = surface
    rows = [f"mtllib {library}"] if library else []
    rows += [f"v {x:.{digits}f} {z:.{digits}f} {-y:.{digits}f}" for x, y, z in points]
    offsets = np.zeros((len(parts), 2)) if uv_offsets is None else np.array(uv_offsets)
    rows += [f"vt {u:.6f} {v:.6f}" for offset in offsets for u, v in uv + offset]
    for number, faces in enumerate(parts):
        rows += [f"usemtl {materials[number]}"] if materials else []
        shift = number * len(uv)
        rows += ["f " + " ".join(f"{corner + 1}/{corner + 1 + shift}" for corner in face) for face in faces]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def write_library(path, pages, word="map_Kd"):
    """Write a material library: the image of each material by name."""
    path.write_text("".join(f"newmtl {name}\nKd 0.5 0.5 0.5\n{word} {image}\n" for name, image in pages.items()))


def write_ply(path, points, faces, *, colors=None, kind="double"):
    """Write a binary .ply. colors: (V, 3) uint8."""
    more = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue")) if colors is not None else ""
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property {kind} {axis}\n" for axis in "xyz") + more
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    real = "<f8" if kind == "double" else "<f4"
    table = np.zeros(len(points), [("at", real, 3)] + ([("color", "u1", 3)] if more else []))
    table["at"] = points
    if more:
        table["color"] = colors
    polygons = np.zeros(len(faces), [("count", "u1"), ("corners", "<i4", faces.shape[1])])
    polygons["count"], polygons["corners"] = faces.shape[1], faces
    path.write_bytes(head.encode() + table.tobytes() + polygons.tobytes())


def write_textured_ply(path, surface, images, names, *, form="binary_little_endian"):
    """Write a .ply of triangles with UVs by face, as MeshLab does.

    surface: points (V, 3), faces (F, 3) and uv (F, 3, 2). images: (F,), numbers of `names`.
    """
    points, faces, uv = surface
    head = f"ply\nformat {form} 1.0\n" + "".join(f"comment TextureFile {name}\n" for name in names)
    head += f"element vertex {len(points)}\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    head += f"property uchar flags\nelement face {len(faces)}\nproperty list uchar int vertex_indices\n"
    head += "property list uchar float texcoord\nproperty int texnumber\nend_header\n"
    if form == "ascii":
        rows = [f"{x:.6f} {y:.6f} {z:.6f} 7" for x, y, z in points]
        for face, corners, number in zip(faces, uv, images, strict=True):
            numbers = " ".join(f"{value:.6f}" for value in corners.ravel())
            rows.append(f"3 {face[0]} {face[1]} {face[2]} 6 {numbers} {number}")
        path.write_text(head + "\n".join(rows) + "\n")
        return
    order = "<" if "little" in form else ">"
    vertices = np.zeros(len(points), [("at", order + "f4", 3), ("flags", "u1")])
    vertices["at"], vertices["flags"] = points, 7
    fields = [
        ("sides", "u1"),
        ("corners", order + "i4", 3),
        ("count", "u1"),
        ("uv", order + "f4", 6),
        ("image", order + "i4"),
    ]
    triangles = np.zeros(len(faces), fields)
    triangles["sides"], triangles["count"], triangles["corners"] = 3, 6, faces
    triangles["uv"], triangles["image"] = np.reshape(uv, (-1, 6)), images
    path.write_bytes(head.encode() + vertices.tobytes() + triangles.tobytes())


def damage(path, random):
    """Change some bytes near the start of a file, and cut half of all files off. random: a numpy generator."""
    content = bytearray(path.read_bytes())
    for place in random.integers(0, min(len(content), 600), 6):
        content[place] = random.choice(list(b"0 \n\0-x9\xff"))
    path.write_bytes(content[: random.integers(len(content) // 2, len(content))] if random.integers(2) else content)


def missing(objects):
    """The paths of images that materials of `objects` use and that cannot be read."""
    return [each.path for each in dependencies.lacking(dependencies.of((), objects))]
