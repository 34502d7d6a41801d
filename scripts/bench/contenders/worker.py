# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs other bakers in the separate environment: reads requests as lines of JSON, and answers each with a line.

Started by peers.py. A request is {"do": "versions"}, {"do": "load", "path": PAIR.npz} or {"do": "bake", "peer": NAME,
"size": N, "save": MAP.npy or null}. The answer to a request that fails is {"error": TEXT}.
"""

import contextlib
import ctypes
import importlib
import importlib.metadata
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

MODULES = ("open3d", "embreex", "pymeshlab", "moderngl")


def open3d(pair, size: int) -> np.ndarray:
    """Texels (size, size, 3) of unit normals by RaycastingScene; 0 for misses. pair: see scenes.arrays_of."""
    import open3d as o3d

    low = o3d.t.geometry.TriangleMesh(
        o3d.core.Tensor(pair["low_corners"].reshape(-1, 3)),
        o3d.core.Tensor(np.arange(pair["low_uv"].size // 2, dtype=np.int32).reshape(-1, 3)),
    )
    low.vertex["directions"] = o3d.core.Tensor(pair["low_directions"].reshape(-1, 3))
    low.triangle["texture_uvs"] = o3d.core.Tensor(pair["low_uv"])
    drawn = low.bake_vertex_attr_textures(size, {"positions", "directions"}, margin=0.0, update_material=False)
    # Row 0 is at the top of the image.
    positions, outward = (drawn[name].numpy()[::-1].reshape(-1, 3) for name in ("positions", "directions"))
    covered = np.flatnonzero(np.abs(outward).sum(axis=1) > 0.0)
    outward = outward[covered] / np.linalg.norm(outward[covered], axis=1, keepdims=True)
    rays = np.concatenate([positions[covered] + pair["extrusion"] * outward, -outward], axis=1).astype(np.float32)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(pair["high_points"]), o3d.core.Tensor(pair["high_triangles"].astype(np.uint32)))
    answer = scene.cast_rays(o3d.core.Tensor(rays))
    hit = np.flatnonzero(answer["t_hit"].numpy() <= 2.0 * pair["extrusion"])
    first, second = answer["primitive_uvs"].numpy()[hit].T[:, :, None]
    corners = pair["high_normals"][answer["primitive_ids"].numpy()[hit]]
    normals = (1.0 - first - second) * corners[:, 0] + first * corners[:, 1] + second * corners[:, 2]
    texels = np.zeros((size * size, 3), np.float32)
    texels[covered[hit]] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return texels.reshape(size, size, 3)


def pymeshlab(pair, size: int) -> np.ndarray:
    """Texels (size, size, 3) of normals by its transfer to a texture with 8 bits per channel. pair: see scenes.arrays_of."""
    import pymeshlab as pml
    from PIL import Image

    low_triangles = np.arange(pair["low_uv"].size // 2, dtype=np.int32).reshape(-1, 3)
    normals = np.zeros_like(pair["high_points"], dtype=np.float64)
    normals[pair["high_triangles"].ravel()] = pair["high_normals"].reshape(-1, 3)
    meshes = pml.MeshSet()
    meshes.add_mesh(pml.Mesh(pair["high_points"].astype(np.float64), pair["high_triangles"], v_normals_matrix=normals))
    meshes.add_mesh(
        pml.Mesh(
            pair["low_corners"].reshape(-1, 3).astype(np.float64),
            low_triangles,
            v_normals_matrix=pair["low_directions"].reshape(-1, 3).astype(np.float64),
            w_tex_coords_matrix=pair["low_uv"].reshape(-1, 2).astype(np.float64),
        )
    )
    with tempfile.TemporaryDirectory() as folder:
        meshes.transfer_attributes_to_texture_per_vertex(
            sourcemesh=0,
            targetmesh=1,
            attributeenum="Vertex Normal",
            upperbound=pml.PureValue(2.0 * float(pair["extrusion"])),
            textname="map.png",
            textw=size,
            texth=size,
            overwrite=False,
            pullpush=False,
        )
        meshes.save_current_mesh(str(Path(folder) / "low.obj"))
        with Image.open(Path(folder) / "map.png") as picture:
            texels = np.asarray(picture.convert("RGBA"), np.float32)[::-1] / 255.0
    return np.where(texels[..., 3:] > 0.5, texels[..., :3] * 2.0 - 1.0, 0.0)


def embreex(pair, size: int) -> np.ndarray:
    """Texels (size, size, 3) of normals by Embree's rays, in one thread; 0 for misses. pair: see scenes.arrays_of.

    Where the rays start is not part of its time: it is in the pair, see `prepare`.
    """
    from embreex import mesh_construction, rtcore_scene

    texel, origins, directions = pair["rays"]
    scene = rtcore_scene.EmbreeScene()
    mesh_construction.TriangleMesh(scene, pair["high_points"], pair["high_triangles"].astype(np.int32))
    lengths = np.full(len(origins), 2.0 * pair["extrusion"], np.float32)
    answer = scene.run(origins, directions, dists=lengths, query="INTERSECT", output=1)
    hit = np.flatnonzero(answer["primID"] >= 0)
    first, second = (answer[name][hit, None] for name in ("u", "v"))
    corners = pair["high_normals"][answer["primID"][hit]]
    normals = (1.0 - first - second) * corners[:, 0] + first * corners[:, 1] + second * corners[:, 2]
    texels = np.zeros((size * size, 3), np.float32)
    texels[texel[hit]] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return texels.reshape(size, size, 3)


def prepare(pair, peer: str, size: int) -> None:
    """Put the rays of all texels into the pair for bakers that have no rasterizer: texel, start (N, 3), direction (N, 3)."""
    if peer != "embreex" or pair.get("rays_size") == size:
        return
    texels, weights, triangles = rasterized(pair["low_uv"].astype(np.float64) * size - 0.5, size)
    points, outward = (
        np.einsum("nc,ncx->nx", weights, pair[name][triangles]) for name in ("low_corners", "low_directions")
    )
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    rays = points + pair["extrusion"] * outward, -outward
    pair["rays"] = texels, *(np.ascontiguousarray(values, np.float32) for values in rays)
    pair["rays_size"] = size


def rasterized(corners: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The texels whose centers are in triangles: index, the weights (N, 3) of the corners, and the triangle's number.

    corners: (T, 3, 2) float64, where the center of texel (i, j) is at (i, j).
    """
    least = np.clip(np.ceil(corners.min(axis=1)), 0, size).astype(np.int64)
    count = np.maximum(np.clip(np.floor(corners.max(axis=1)) + 1, 0, size).astype(np.int64) - least, 0)
    area = count.prod(axis=1)
    found = []
    for part in np.array_split(np.arange(len(corners)), max(1, int(area.sum()) >> 20)):
        triangles = np.repeat(part, area[part])
        inside_box = np.arange(len(triangles)) - np.repeat(np.cumsum(area[part]) - area[part], area[part])
        x = least[triangles, 0] + inside_box % count[triangles, 0]
        y = least[triangles, 1] + inside_box // count[triangles, 0]
        a, b, c = corners[triangles].transpose(1, 2, 0)
        twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        with np.errstate(divide="ignore", invalid="ignore"):  # triangles without an area have no texels
            second = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / twice
            third = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / twice
            weights = np.stack([1.0 - second - third, second, third], axis=1)
        inside = (weights >= 0.0).all(axis=1)
        found.append((y[inside] * size + x[inside], weights[inside], triangles[inside]))
    return tuple(np.concatenate(values) for values in zip(*found, strict=True))


BAKERS = {"open3d": open3d, "embreex": embreex, "pymeshlab": pymeshlab}


def preload() -> None:
    """Load libusb, which Open3D's wheel needs, from another wheel, in case the system lacks it."""
    with contextlib.suppress(ImportError, OSError):
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), ctypes.RTLD_GLOBAL)


def versions() -> dict[str, str]:
    """The modules that can be imported, with their versions."""
    found = {}
    for name in MODULES:
        try:
            importlib.import_module(name)
        except (ImportError, OSError) as error:
            print(f"{name}: {error}", file=sys.stderr)
        else:
            found[name] = importlib.metadata.version(name)
    return found


GAPS = (
    ArithmeticError,
    AttributeError,
    ImportError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
)
"""Errors of other libraries, which leave a gap in the table."""


def main() -> None:
    # Libraries print to standard output. Send that to standard error, and only answers to standard output.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    preload()
    pair = {}
    for line in sys.stdin:
        request = json.loads(line)
        answer = {}
        try:
            if request["do"] == "versions":
                answer = versions()
            elif request["do"] == "load":
                with np.load(request["path"]) as file:
                    pair = dict(file)
            else:
                prepare(pair, request["peer"], request["size"])
                start = time.perf_counter()
                texels = BAKERS[request["peer"]](pair, request["size"])
                answer = {"seconds": time.perf_counter() - start}
                if request["save"]:
                    np.save(request["save"], texels)
        except GAPS as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
