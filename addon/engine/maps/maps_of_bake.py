# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes what draws the maps of a bake: the families of maps that the settings name, and the basis of the normals."""

from collections.abc import Iterator

import gpu
import numpy as np

from ...core.declarations.choices import Space
from ...core.map_types import BY_NAME, Family
from ...mesh.inputs import Meshes
from ...passes import mesh_upload
from ..sources import Source
from .family import MapFamily, Run
from .material_maps import MaterialMaps
from .point_maps import PointMaps
from .ray_maps import CurvatureMaps, OpennessMaps, ThicknessMaps
from .sampling import SampledMaps


def maps_of_bake(
    meshes: Meshes,
    source: Source,
    run: Run,
    *,
    uploads: mesh_upload.UploadCache | None = None,
) -> SampledMaps:
    """What draws the maps of a bake, band by band. uploads: a cache of uploaded meshes."""
    basis = None
    if meshes.basis is not None:
        with run.timings.timed("upload"):
            basis = _upload_basis(meshes, uploads or mesh_upload.UploadCache())
    with run.timings.timed("upload"):
        families = list(_families(meshes, source, basis, run))
    return SampledMaps(source, basis, families, None, run)


def _upload_basis(meshes: Meshes, uploads: mesh_upload.UploadCache) -> gpu.types.GPUBatch:
    basis = meshes.basis
    return uploads.upload(
        f"{basis.name} as basis", basis.triangles, uv=basis.uv, normal=basis.normals, tangent=basis.tangents
    )


def _families(
    meshes: Meshes,
    source: Source,
    basis: gpu.types.GPUBatch | None,
    run: Run,
) -> Iterator[MapFamily]:
    def names(family: Family) -> list[str]:
        return [name for name in run.settings.maps if BY_NAME[name].family is family]

    surface = source.surface
    if names(Family.POINTS):
        yield PointMaps(names(Family.POINTS), meshes.low, surface, run)
    if names(Family.OPENNESS):
        matrix = meshes.low.to_world[:3, :3]
        yield OpennessMaps(
            names(Family.OPENNESS),
            surface,
            run,
            others=meshes.others,
            to_space=np.eye(3) if run.settings.space == Space.WORLD else matrix.T / np.abs(matrix).max(),
            basis=basis,
        )
    if names(Family.MATERIAL):
        yield MaterialMaps(names(Family.MATERIAL), meshes, surface, run)
    for kind in (ThicknessMaps, CurvatureMaps):
        if names(kind.family):
            yield kind(names(kind.family), surface, run)
