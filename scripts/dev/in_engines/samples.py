# SPDX-License-Identifier: GPL-3.0-or-later
"""A low mesh as a .glb, with the maps that Imprint bakes and exports for each basis, and in object space."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from addon.core.declarations import bases
from addon.core.report import Report
from addon.core.settings import Settings
from addon.export import engine_files
from addon.jobs import bake_pair
from scripts.dev.in_engines import drawing
from scripts.dev.in_engines.glb_file import Glb, Surface, node_matrix, unit

MARGIN = 16
"""Texels around the islands of a map."""
TO_GLTF = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From Blender's axes to those of glTF, whose Y points up."""


@dataclass(frozen=True)
class Sample:
    """A mesh with maps of S x S texels, bottom row first.

    files: by basis, as exported with its map. normal_matrix: (3, 3), from the space of the mesh to world space. laid_out: which
    triangle each texel shows. baked: (S, S), whether the high mesh is at a texel that one triangle of the low mesh has for
    itself, so that no margin fills it. object_map: (S, S, 3), normals in the space of the mesh.
    """

    name: str
    files: dict[str, Glb]
    surface: Surface
    normal_matrix: np.ndarray
    laid_out: drawing.Drawn
    baked: np.ndarray
    object_map: np.ndarray

    @property
    def uv(self) -> np.ndarray:
        """(T, 3, 2), with v up."""
        return with_v_up(self.surface.uv)


def with_v_up(uv: np.ndarray) -> np.ndarray:
    return np.stack([uv[..., 0], 1.0 - uv[..., 1]], axis=-1)


def make(path: Path, size: int) -> Sample:
    """Bake the objects "hi" and "lo" of a .blend, and export "lo". Raises ValueError if its file has no tangents."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    covered = bake(low, high, size, "OBJECT", margin=0)[0][..., 3] > 0.5
    object_map = normals(bake(low, high, size, "OBJECT")[0]) @ TO_GLTF.T
    files = {basis: export(bake(low, high, size, "TANGENT", basis)[1]) for basis in bases.BY_NAME}
    glb = files["MIKKTSPACE"]
    surface = glb.surface()
    if surface.tangent is None:
        raise ValueError(f"{path.name}: the exported mesh has no tangents")
    normal_matrix = np.linalg.inv(mesh_matrix(glb)[:3, :3]).T
    laid_out = drawing.lay_out(with_v_up(surface.uv), size)
    baked = covered & (laid_out.count == 1)
    return Sample(path.stem, files, surface, normal_matrix, laid_out, baked, object_map)


def normals(texels: np.ndarray) -> np.ndarray:
    """The vectors (H, W, 3) of length one that a map (H, W, 4) stores."""
    return unit(texels[..., :3].astype(np.float64) * 2.0 - 1.0)


def bake(
    low: bpy.types.Object, high: bpy.types.Object, size: int, space: str, basis: str = "AUTO", *, margin: int = MARGIN
) -> tuple[np.ndarray, Report]:
    """The texels (size, size, 4) float32 of a normal map, and the report of its bake."""
    chosen = {"width": size, "height": size, "samples": 1, "margin": margin, "depth": 32, "storage": "MEMORY"}
    report = bake_pair(
        bpy.context,
        low,
        [high],
        Settings(method="FLATTEN", space=space, basis=basis, image="map", material=False, **chosen),
    )
    texels = np.empty(size * size * 4, np.float32)
    bpy.data.images["map"].pixels.foreach_get(texels)
    return texels.reshape(size, size, 4), report


def export(report: Report) -> Glb:
    """What Imprint writes of a bake, with one-sided materials: the pictures show no triangle from behind."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "low.glb"
        engine_files.export_files(bpy.context, [[report]], path)
        glb = Glb.read(path)
    for material in glb.document["materials"]:
        material.pop("doubleSided", None)
    return glb


def mesh_matrix(glb: Glb) -> np.ndarray:
    """The matrix (4, 4) of the only node with a mesh, which is at the top. Raises ValueError for other files."""
    nodes = glb.document["nodes"]
    found = [index for index in glb.roots() if "mesh" in nodes[index]]
    if len(found) != 1 or sum("mesh" in one for one in nodes) != 1:
        raise ValueError("the file has another number of meshes than one")
    return node_matrix(nodes[found[0]])
