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

MODULES = ("open3d", "pymeshlab", "moderngl")


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


BAKERS = {"open3d": open3d, "pymeshlab": pymeshlab}


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
