# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes and images of ComfyUI, as arrays of Imprint and back.

ComfyUI's meshes are as in glTF: Y up, and v counts from the top of an image. Imprint's have Z up, and v counts from the bottom.
"""

import types

import numpy as np
import torch

from .process import ImprintError


def array(values):
    """A tensor, or what is like an array, as an array of numpy."""
    return values.detach().cpu().numpy() if hasattr(values, "detach") else np.asarray(values)


def items(mesh, role):
    """The meshes of a batch, as arrays of Imprint. Raises ImprintError."""
    for name in ("vertices", "faces"):
        if getattr(mesh, name, None) is None:
            raise ImprintError(f"{role} is no mesh: it has no {name}.")
    points, faces = array(mesh.vertices), array(mesh.faces)
    if points.ndim != 3 or faces.ndim != 3 or len(points) != len(faces) or not len(points):
        raise ImprintError(f"{role} is no batch of meshes: its vertices are {points.shape}, its faces {faces.shape}.")
    counts = [getattr(mesh, name, None) for name in ("vertex_counts", "face_counts")]
    ends = [
        np.full(len(points), len(each[0])) if own is None else array(own)
        for own, each in zip(counts, (points, faces), strict=True)
    ]
    own = {"uv": getattr(mesh, "uvs", None), "normals": getattr(mesh, "normals", None)}
    found = []
    for number, (last, last_face) in enumerate(zip(*ends, strict=True)):
        one = {"vertices": _z_up(points[number, :last]), "triangles": faces[number, :last_face].astype(np.int64)}
        if own["uv"] is not None:
            one["uv"] = _turned_over(array(own["uv"])[number, :last])
        if own["normals"] is not None:
            one["normals"] = _z_up(array(own["normals"])[number, :last])
        found.append(one)
    return found


def mesh_of(answers):
    """A batch of meshes of ComfyUI, of what calls of Imprint return."""
    split = [_by_vertex(answer) for answer in answers]
    mesh = _new(*(_padded([each[name] for each in split]) for name in ("vertices", "faces")))
    mesh.uvs = _padded([each["uvs"] for each in split])
    has_normals = all("mesh.normals" in answer for answer in answers)  # else readers of the mesh make their own
    mesh.normals = _padded([each["normals"] for each in split]) if has_normals else None
    if len({(len(each["vertices"]), len(each["faces"])) for each in split}) > 1:
        mesh.vertex_counts, mesh.face_counts = (
            torch.from_numpy(np.array([len(each[name]) for each in split])) for name in ("vertices", "faces")
        )
    return mesh


def image(maps):
    """A batch of images (B, H, W, 3) from 0 to 1, the top row first. maps: (H, W, 4), row 0 at v = 0."""
    texels = np.stack([each[::-1, :, :3] for each in maps])
    return torch.from_numpy(np.clip(texels, 0.0, 1.0).astype(np.float32))


def from_trimesh(source):
    """A mesh of ComfyUI. source: a Trimesh, or a Scene of them."""
    if hasattr(source, "to_geometry"):
        source = source.to_geometry()
    if not (hasattr(source, "vertices") and hasattr(source, "faces")):
        raise ImprintError(f"{type(source).__name__} is no trimesh: it has no vertices and faces.")
    mesh = _new(
        *(torch.from_numpy(np.array(each)[None]) for each in (np.float32(source.vertices), np.int64(source.faces)))
    )
    uv = getattr(getattr(source, "visual", None), "uv", None)
    mesh.uvs = None if uv is None else torch.from_numpy(_turned_over(np.float32(uv))[None])
    mesh.normals = torch.from_numpy(np.array(source.vertex_normals, np.float32)[None])
    return mesh


def to_trimesh(mesh):
    """A Trimesh of the first mesh of a batch."""
    try:
        import trimesh
    except ImportError as error:
        raise ImprintError("trimesh is missing in ComfyUI's Python: pip install trimesh there.") from error
    (one, *_), own = items(mesh, "The mesh"), getattr(mesh, "normal_map", None)
    visual = None
    if "uv" in one:
        material = trimesh.visual.material.PBRMaterial(normalTexture=None if own is None else _picture(array(own)[0]))
        visual = trimesh.visual.TextureVisuals(uv=one["uv"], material=material)
    known = {"vertex_normals": _y_up(one["normals"])} if "normals" in one else {}
    return trimesh.Trimesh(_y_up(one["vertices"]), one["triangles"], visual=visual, process=False, **known)


def _picture(texels):
    from PIL import Image

    return Image.fromarray(np.round(255.0 * texels).astype(np.uint8))


def _new(vertices, faces):
    """An empty mesh of the class that this ComfyUI has."""
    try:
        from comfy_api.latest import Types

        kind = Types.MESH
    except (ImportError, AttributeError):  # ComfyUI 0.3.64 and older
        return types.SimpleNamespace(vertices=vertices, faces=faces)
    return kind(vertices, faces)


def _by_vertex(answer):
    """A mesh whose UVs and normals are by corner, with a vertex for each that differs."""
    triangles = answer["mesh.triangles"]
    points, uv = answer["mesh.vertices"], answer["mesh.uv"]
    normals = answer.get("mesh.normals", np.zeros((*triangles.shape, 3)))
    corners = [each if each.ndim == 3 else each[triangles] for each in (uv, normals)]
    rows = np.concatenate([triangles[..., None], *corners], axis=2).reshape(-1, 6).astype(np.float64)
    kept, places = np.unique(rows, axis=0, return_inverse=True)
    return {
        "vertices": np.float32(_y_up(points[kept[:, 0].astype(np.int64)])),
        "faces": places.reshape(-1, 3).astype(np.int64),
        "uvs": np.float32(_turned_over(kept[:, 1:3])),
        "normals": np.float32(_y_up(kept[:, 3:])),
    }


def _padded(parts):
    """Arrays of different lengths as one tensor, with zeros at their ends."""
    whole = np.zeros((len(parts), max(map(len, parts)), parts[0].shape[1]), parts[0].dtype)
    for row, part in zip(whole, parts, strict=True):
        row[: len(part)] = part
    return torch.from_numpy(whole)


def _z_up(values):
    return np.stack([values[:, 0], -values[:, 2], values[:, 1]], axis=1)


def _y_up(values):
    return np.stack([values[:, 0], values[:, 2], -values[:, 1]], axis=1)


def _turned_over(uv):
    return np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)
