# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes what draws the maps of a bake: the families of maps that the settings name, and the basis of the normals."""

from collections.abc import Iterator

import gpu

from ...core.map_types import BY_NAME, Family
from ...core.settings import Run
from ...mesh.inputs import Meshes
from ...passes import mesh_upload
from ..mips.slope_maps import SlopeMaps
from ..sources import Source, world_to_space
from .family import MapFamily
from .material_maps import MaterialMaps
from .normal_space import NormalSpace
from .own_normals import OwnNormals
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
        space = NormalSpace(basis, meshes.basis, run.settings)
        families = list(_families(meshes, source, space, run))
        to_space = world_to_space(meshes.low, run.settings.map)
        detail = OwnNormals(meshes, source.surface, to_space, run) if meshes.has_detail else None
    return SampledMaps(source, space, families, detail, run)


def _upload_basis(meshes: Meshes, uploads: mesh_upload.UploadCache) -> gpu.types.GPUBatch:
    basis = meshes.basis
    return uploads.upload(
        f"{basis.name} as basis", basis.triangles, uv=basis.uv, normal=basis.normals, tangent=basis.tangents
    )


def _families(
    meshes: Meshes,
    source: Source,
    space: NormalSpace,
    run: Run,
) -> Iterator[MapFamily]:
    def names(family: Family) -> list[str]:
        return [name for name in run.settings.map.drawn_maps if BY_NAME[name].family is family]

    surface = source.surface
    if names(Family.POINTS):
        yield PointMaps(names(Family.POINTS), meshes.low, surface, run)
    if names(Family.OPENNESS):
        yield OpennessMaps(
            names(Family.OPENNESS),
            surface,
            run,
            others=meshes.others,
            to_space=world_to_space(meshes.low, run.settings.map),
            space=space,
        )
    if names(Family.MATERIAL):
        yield MaterialMaps(names(Family.MATERIAL), meshes, surface, run)
    if names(Family.SLOPES):
        yield SlopeMaps(meshes, surface, run, space=space)
    for kind in (ThicknessMaps, CurvatureMaps):
        if names(kind.family):
            yield kind(names(kind.family), surface, run)
