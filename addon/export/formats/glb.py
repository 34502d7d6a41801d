# SPDX-License-Identifier: GPL-3.0-or-later
"""Binary glTF: Blender's exporter writes it, with the tangents of the bake and levels of detail put in afterwards."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.errors import BakeError
from .. import staging
from ..baked_low import FileMesh
from ..staging import Stage, Staged
from .glb_file import Glb

CHANNELS = ("+X", "+Y", "+Z")
"""The axes that normal maps store."""
HAS_TANGENTS = LINKS_LEVELS = True
NAMES_FILES = SHARES_FOLDER = False
LEVELS = "MSFT_lod"
"""The extension whose nodes name others as their coarser levels."""


def check() -> None:
    """Raise BakeError if the exporter is missing."""
    if not hasattr(bpy.types, "EXPORT_SCENE_OT_gltf"):
        raise BakeError("Blender's add-on glTF 2.0 is off: enable it in the preferences.")


def write(stage: Stage, path: Path, *, are_levels: bool) -> list[Path]:
    """Write the staged objects to `path`; as levels of detail, from the finest, if `are_levels`. Returns the files."""
    bpy.ops.export_scene.gltf(
        filepath=str(path),
        check_existing=False,
        export_format="GLB",
        collection=stage.collection.name,
        export_image_format="AUTO",
        export_texcoords=True,
        export_normals=True,
        export_tangents=False,  # they would be of the mesh in triangles, without the quads that the bake had
        export_attributes=True,
        export_materials="EXPORT",
        export_yup=True,
        export_apply=False,
        export_animations=False,
        export_current_frame=True,
        export_skins=False,
        export_morph=False,
        export_extras=False,
        export_cameras=False,
        export_lights=False,
        export_vertex_color="NONE",
        export_draco_mesh_compression_enable=False,
        export_hierarchy_full_collections=False,
        use_mesh_edges=False,
        use_mesh_vertices=False,
        will_save_settings=False,
    )
    glb = Glb.parsed(path.read_bytes())
    for mesh in glb.tree.get("meshes", ()):
        for primitive in mesh["primitives"]:
            attributes = primitive["attributes"]
            attributes["TANGENT"] = attributes.pop(staging.TANGENTS)
    if are_levels:
        _link_levels(glb.tree, [one.name for one in stage.objects])
    path.write_bytes(glb.packed())
    return [path]


def _link_levels(tree: dict[str, Any], names: Sequence[str]) -> None:
    """Make the nodes after the first its coarser levels: the scene shows only the first."""
    first, *others = (_node(tree, name) for name in names)
    tree["nodes"][first].setdefault("extensions", {})[LEVELS] = {"ids": others}
    tree.setdefault("extensionsUsed", []).append(LEVELS)
    for scene in tree["scenes"]:
        scene["nodes"] = [number for number in scene["nodes"] if number not in others]


def _node(tree: dict[str, Any], name: str) -> int:
    found = [number for number, node in enumerate(tree["nodes"]) if node.get("name") == name and "mesh" in node]
    if not found:
        raise BakeError(f"Blender's exporter left out {name!r}.")
    return found[0]


def read(path: Path, one: Staged) -> FileMesh:
    """Read an object back. Raises BakeError."""
    glb = Glb.parsed(path.read_bytes())
    tree = glb.tree
    mesh = tree["meshes"][tree["nodes"][_node(tree, one.name)]["mesh"]]
    parts: dict[str, list[np.ndarray]] = {}
    pictures: list[bytes | None] = []
    for number, primitive in enumerate(mesh["primitives"]):
        indices = glb.accessor(primitive["indices"])[:, 0].reshape(-1, 3)
        texture = tree["materials"][primitive["material"]].get("normalTexture") if "material" in primitive else None
        pictures.append(glb.image(texture["index"]) if texture else None)
        layer = f"TEXCOORD_{texture.get('texCoord', 0) if texture else 0}"
        for name, accessor in primitive["attributes"].items():
            key = "uv" if name == layer else name.lower()
            parts.setdefault(key, []).append(glb.accessor(accessor)[indices])
        parts.setdefault("material", []).append(np.full(len(indices), number))
    found = {name: np.concatenate(values) for name, values in parts.items()}
    uv = found["uv"].copy()
    uv[..., 1] = 1.0 - uv[..., 1]
    has_tangents = len(found.get("tangent", ())) == len(found["position"])
    return FileMesh(
        _z_up(found["position"]),
        _z_up(found["normal"]),
        uv,
        _z_up(found["tangent"]) if has_tangents else None,
        found["material"],
        pictures,
    )


def _z_up(values: np.ndarray) -> np.ndarray:
    """Vectors (..., n) of glTF, where Y is up, in Blender's axes. A fourth component stays."""
    return np.concatenate([values[..., :1], -values[..., 2:3], values[..., 1:2], values[..., 3:]], axis=-1)
