# SPDX-License-Identifier: GPL-3.0-or-later
"""The nodes: their sockets, as ComfyUI's executor reads them, and what each asks Imprint for."""

import json

import numpy as np
import torch

from . import meshes, process
from .process import ImprintError

CATEGORY = "3d/imprint"
MAPS = ("normal", "ao", "curvature", "thickness", "height", "position")
"""Those that Bake All Maps has a socket for."""
_LENGTHS = ("height", "position")
"""Maps of lengths, which an image from 0 to 1 holds only with another scale."""
_SIZE = ("INT", {"default": 1024, "min": 16, "max": 16384, "step": 16, "tooltip": "The side of the maps in texels"})
_SAMPLES = ([1, 2, 4, 8, 16, 64], {"default": 4, "tooltip": "Samples a texel"})
_SETTINGS = (
    "STRING",
    {"default": "", "tooltip": 'Further settings of Imprint as JSON, as {"max_distance": 0.1, "green": "-y"}'},
)


def _settings(text):
    """The settings of a text. Raises ImprintError."""
    try:
        values = json.loads(text) if text.strip() else {}
    except ValueError as error:
        raise ImprintError(f'settings: {text!r} is not JSON, such as {{"samples": 4}}.') from error
    if not isinstance(values, dict):
        raise ImprintError(f'settings: {text!r} is not an object of JSON, such as {{"samples": 4}}.')
    return values


def _with(arguments, settings):
    """The arguments of a node, and settings beside them. Raises ImprintError."""
    values = _settings(settings)
    for name in arguments.keys() & values.keys():
        raise ImprintError(f"settings: {name!r} is an input of the node: set it there.")
    return arguments | values


def _is_stopped():
    """Raise ComfyUI's exception if the user has stopped the graph."""
    try:
        from comfy.model_management import throw_exception_if_processing_interrupted
    except ImportError:  # in tests
        return
    throw_exception_if_processing_interrupted()


def _called(name, batches, arguments):
    """The answers of Imprint for each mesh of batches, of which one may have a single mesh for all of another one.

    batches: of meshes of ComfyUI, by the names of arguments.
    """
    found = {role: meshes.items(mesh, role) for role, mesh in batches.items()}
    count = max(map(len, found.values()))
    for role, each in found.items():
        if len(each) not in (1, count):
            raise ImprintError(f"{role} has {len(each)} meshes, and another input {count}: give as many, or one.")
    answers = []
    for number in range(count):
        chosen = {role: each[number if len(each) > 1 else 0] for role, each in found.items()}
        answers.append(process.call(name, chosen, arguments, _is_stopped))
    told = [line for each, _ in answers for line in each["warnings"]]
    return [arrays for _, arrays in answers], "\n".join(dict.fromkeys(told))


def _images(answers, name):
    """A map of all answers, as an image. Lengths are scaled so that they fill it."""
    maps = [each[f"map.{name}"] for each in answers]
    if name in _LENGTHS:
        most = np.max([np.abs(each[..., :3]).max() for each in maps]) or 1.0
        maps = [0.5 + 0.5 * each / most for each in maps]
    return meshes.image(maps)


def _with_maps(mesh, answers):
    """The mesh with its maps, as ComfyUI saves them."""
    if "map.normal" in answers[0]:
        mesh.normal_map = _images(answers, "normal")
    if "map.ao" in answers[0]:
        shade = meshes.array(_images(answers, "ao"))[..., :1]
        packed = np.concatenate([shade, np.ones_like(shade), np.zeros_like(shade)], axis=3)  # rough, no metal
        mesh.metallic_roughness, mesh.occlusion_in_mr = torch.from_numpy(packed), True
    return mesh


class _Bake:
    """Bakes the detail of a high mesh into maps of a low one, which is unwrapped if it has no UVs."""

    CATEGORY, FUNCTION = CATEGORY, "bake"
    MAPS = ()
    """The maps of the node, in the order of its sockets."""

    @classmethod
    def INPUT_TYPES(cls):  # noqa: N802
        """The sockets and fields."""
        return {
            "required": {"low": ("MESH",), "high": ("MESH",), "size": _SIZE, "samples": _SAMPLES},
            "optional": {"settings": _SETTINGS},
        }

    @classmethod
    def VALIDATE_INPUTS(cls, settings=""):  # noqa: N802
        """True, or a sentence."""
        try:
            _settings(settings)
        except ImprintError as error:
            return str(error)
        return True

    def bake(self, low, high, size, samples, settings=""):
        """The images, the low mesh with them, and warnings."""
        arguments = _with({"maps": list(self.MAPS), "size": size, "samples": samples}, settings)
        answers, told = _called("bake", {"low": low, "high": high}, arguments)
        mesh = _with_maps(meshes.mesh_of(answers), answers)
        return (*(_images(answers, name) for name in self.MAPS), mesh, told)


class BakeNormal(_Bake):
    """Bakes a normal map."""

    MAPS, RETURN_TYPES, RETURN_NAMES = ("normal",), ("IMAGE", "MESH", "STRING"), ("normal", "mesh", "warnings")


class BakeOcclusion(_Bake):
    """Bakes ambient occlusion."""

    MAPS, RETURN_TYPES, RETURN_NAMES = ("ao",), ("IMAGE", "MESH", "STRING"), ("ao", "mesh", "warnings")


class BakeMaps(_Bake):
    """Bakes all maps that need no materials."""

    MAPS, RETURN_TYPES = MAPS, (*("IMAGE",) * len(MAPS), "MESH", "STRING")
    RETURN_NAMES = (*MAPS, "mesh", "warnings")


class GameAsset:
    """Makes a low mesh with UVs and maps of a high one."""

    CATEGORY, FUNCTION = CATEGORY, "make"
    RETURN_TYPES, RETURN_NAMES = ("MESH", "IMAGE", "IMAGE", "STRING"), ("mesh", "normal", "ao", "warnings")
    VALIDATE_INPUTS = _Bake.VALIDATE_INPUTS

    @classmethod
    def INPUT_TYPES(cls):  # noqa: N802
        """The sockets and fields."""
        triangles = ("INT", {"default": 5000, "min": 4, "max": 1_000_000, "tooltip": "Of the low mesh"})
        return {
            "required": {"high": ("MESH",), "triangles": triangles, "size": _SIZE, "samples": _SAMPLES},
            "optional": {"settings": _SETTINGS},
        }

    def make(self, high, triangles, size, samples, settings=""):
        """The low mesh with its maps, the maps, and warnings."""
        arguments = {"maps": ["normal", "ao"], "triangles": triangles, "size": size, "samples": samples}
        answers, told = _called("asset", {"high": high}, _with(arguments, settings))
        mesh = _with_maps(meshes.mesh_of(answers), answers)
        return mesh, _images(answers, "normal"), _images(answers, "ao"), told


class FromTrimesh:
    """Makes a mesh of ComfyUI of a trimesh, as other packs of nodes have it."""

    CATEGORY, FUNCTION, RETURN_TYPES = CATEGORY, "convert", ("MESH",)

    @classmethod
    def INPUT_TYPES(cls):  # noqa: N802
        """The socket."""
        return {"required": {"trimesh": ("TRIMESH",)}}

    def convert(self, trimesh):
        """The mesh."""
        return (meshes.from_trimesh(trimesh),)


class ToTrimesh:
    """Makes a trimesh of a mesh of ComfyUI, with its normal map."""

    CATEGORY, FUNCTION, RETURN_TYPES = CATEGORY, "convert", ("TRIMESH",)

    @classmethod
    def INPUT_TYPES(cls):  # noqa: N802
        """The socket."""
        return {"required": {"mesh": ("MESH",)}}

    def convert(self, mesh):
        """The trimesh."""
        return (meshes.to_trimesh(mesh),)


NODE_CLASS_MAPPINGS = {
    "ImprintBakeNormal": BakeNormal,
    "ImprintBakeOcclusion": BakeOcclusion,
    "ImprintBakeMaps": BakeMaps,
    "ImprintGameAsset": GameAsset,
    "ImprintFromTrimesh": FromTrimesh,
    "ImprintToTrimesh": ToTrimesh,
}
NODE_DISPLAY_NAME_MAPPINGS = {
    "ImprintBakeNormal": "Bake Normal Map (Imprint)",
    "ImprintBakeOcclusion": "Bake Ambient Occlusion (Imprint)",
    "ImprintBakeMaps": "Bake All Maps (Imprint)",
    "ImprintGameAsset": "Make Game Asset (Imprint)",
    "ImprintFromTrimesh": "Mesh from Trimesh (Imprint)",
    "ImprintToTrimesh": "Mesh to Trimesh (Imprint)",
}
