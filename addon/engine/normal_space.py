# SPDX-License-Identifier: GPL-3.0-or-later
"""The space of the normals of a map, and the channels that they are stored in."""

import math
from dataclasses import replace

import gpu
import numpy as np

from ..core.declarations import bases
from ..core.declarations.choices import Space
from ..core.declarations.targets import TargetEngine
from ..core.map_types import WRITTEN, Map, states_of_raw
from ..core.settings import MapSettings, Settings
from ..mesh import triangle_mesh, uv_layout
from ..mesh.triangle_mesh import Mesh
from ..passes import lit, low_in_uv, mesh_upload, samples, target
from .bands import Band

CENTER = (0.0, 0.0)
SQUARE = 8
"""The side of the squares of texels in which triangles are looked for."""


class NormalSpace:
    """The space of the normals of a bake. mesh: the low mesh with tangents; None for normals that keep the source's space.
    uploads: a cache of uploaded meshes."""

    program = low_in_uv.TANGENT

    def __init__(self, mesh: Mesh | None, settings: Settings, uploads: mesh_upload.UploadCache | None = None):
        self.mesh = mesh
        if mesh is not None:
            name = f"{mesh.name} as basis"
            attributes = {"uv": mesh.uv, "normal": mesh.normals, "tangent": mesh.tangents}
            self._uploaded = (uploads or mesh_upload.UploadCache()).upload(name, mesh.triangles, **attributes)
        self.flags = bases.of_name(settings.map.basis).flags
        # The last one that is drawn over a texel stays: the one closest to the center.
        beside = [offset for offset in samples.offsets(settings.sampling.samples) if offset != CENTER]
        self._beside = sorted(beside, key=lambda offset: -math.hypot(*offset))

    def of_sample(self, normals: gpu.types.GPUTexture, band: Band) -> gpu.types.GPUTexture:
        """The normals of one sample in this space, by the tangents at its place."""
        return normals if self.mesh is None else self._drawn(self.mesh, "low", normals, band).texture

    def of_texels(self, normals: gpu.types.GPUTexture, band: Band, role: str = "low") -> gpu.types.GPUTexture:
        """The means of all samples in this space, by the tangents at the centers of texels, where programs read them.

        Where the low mesh covers samples but not the center, by those at the sample closest to it. role: of the target.
        """
        if self.mesh is None:
            return normals
        into = self._drawn(self.mesh, role, normals, replace(band, offset=CENTER))
        if self._beside:
            self._draw_beside(self.mesh, into, normals, band)
        return into.texture

    def _draw_beside(self, mesh: Mesh, into: target.Target, normals: gpu.types.GPUTexture, band: Band) -> None:
        """Turn the texels whose center the low mesh does not cover."""
        stopped, places = low_in_uv.not_turned(normals, into)
        size, blocks = (band.width, band.height), np.zeros((-(-band.height // SQUARE), -(-band.width // SQUARE)), bool)
        blocks[tuple(places.T // SQUARE)] = True
        near = uv_layout.touching(mesh, replace(band, offset=CENTER).uv_to_clip, size, blocks, SQUARE)
        if not near.any():
            return
        corners = mesh.triangles[near].reshape(-1)
        low = mesh_upload.upload_corners(
            uv=mesh.uv[corners], normal=mesh.normals[corners], tangent=mesh.tangents[corners]
        )
        for offset in self._beside:
            to_clip = replace(band, offset=offset).uv_to_clip
            low_in_uv.draw_in_tangent_space(
                into,
                low,
                normals,
                to_clip,
                basis_flags=self.flags,
                stretch=mesh.stretch,
                clear=False,
                stopped=stopped,
                program=self.program,
            )

    def _drawn(self, mesh: Mesh, role: str, normals: gpu.types.GPUTexture, band: Band) -> target.Target:
        into = target.get(role, band.width, band.height, "RGBA32F")
        how = {"basis_flags": self.flags, "stretch": mesh.stretch, "program": self.program}
        low_in_uv.draw_in_tangent_space(into, self._uploaded, normals, band.uv_to_clip, **how)
        return into


class VectorSpace(NormalSpace):
    """The tangent space of vectors in the low object's space, of any length. mesh: Meshes.basis, in tangent space."""

    program = low_in_uv.TANGENT_VECTOR

    def __init__(self, mesh: Mesh, settings: Settings):
        super().__init__(triangle_mesh.without_stretch(mesh, settings.map.basis), settings)
        self.flags = bases.OF_DISPLACEMENT.flags


def channels(map_settings: MapSettings) -> np.ndarray:
    """The (3, 3) matrix from a normal to its red, green and blue channels."""
    return axes(map_settings.red, map_settings.green, map_settings.blue)


def axes(*names: str) -> np.ndarray:
    """The (3, 3) matrix from a normal to channels that store these axes, such as "+X"."""
    matrix = np.zeros((3, 3))
    for row, axis in enumerate(names):
        matrix[row, "XYZ".index(axis[1])] = 1.0 if axis[0] == "+" else -1.0
    return matrix


def reading(map_settings: MapSettings) -> tuple[int, int, int]:
    """How a map of these settings is meant to be read, as lit.reading has it, before it is rounded."""
    kinds: dict[str, int] = {Space.WORLD: lit.WORLD, Space.OBJECT: lit.OBJECT}
    kind = kinds.get(map_settings.space, lit.TANGENT + bases.of_name(map_settings.basis).flags)
    return lit.reading(kind, channels(map_settings))


def reading_by(engine: TargetEngine, settings: Settings, *, is_compressed: bool = False) -> tuple[int, int, int]:
    """How an engine reads a tangent-space map of these settings.

    Args:
        is_compressed: whether its compressor made blocks of the map, which GPUs read as floats.
    """
    depth, storing = min(settings.storing.depth, engine.depth), settings.storing
    is_exact = is_compressed or storing.is_blocks or (depth > 8 and storing.is_float)
    steps = 0 if is_exact else 2**depth - 1
    read = axes("+X", engine.green, "+Z")
    return lit.reading(lit.TANGENT + engine.basis.flags, read, steps=steps, rebuilds_z=engine.rebuilds_z)


def stored(normals: np.ndarray, settings: Settings) -> Map:
    """Normals as baking.Renderer.raw returns them, as they are stored in a map of these settings, before rounding."""
    texels = np.ones_like(normals)
    texels[..., :3] = normals[..., :3] @ (0.5 * channels(settings.map).T).astype(np.float32) + 0.5
    return texels, states_of_raw(normals[..., 3])


def backwards(texels: np.ndarray, state: np.ndarray, map_settings: MapSettings) -> int:
    """The number of written texels whose z is 0 or less. texels (height, width, 4): normals as they are stored."""
    z = channels(map_settings)[:, 2]
    stored = texels[..., int(np.argmax(np.abs(z)))]
    half = np.float32(0.5)
    return int(np.count_nonzero((stored <= half if z.sum() > 0.0 else stored >= half) & (state == WRITTEN)))


def upwards(texels: np.ndarray, map_settings: MapSettings) -> np.ndarray:
    """Half the z of the normals in stored texels (height, width, 4): (height, width)."""
    z = channels(map_settings)[:, 2]
    return texels[..., int(np.argmax(np.abs(z)))] * np.float32(z.sum()) - np.float32(0.5 * z.sum())
