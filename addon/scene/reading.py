# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads all objects of a bake into arrays at once, so that Blender's state changes only for a short time."""

import zlib
from collections.abc import Collection, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import partial

import bpy
import numpy as np
from mathutils import Matrix

from ..core.declarations.choices import Method, Modifiers, Occluders, Space
from ..core.errors import LENGTH_DIGITS, BakeError, Incomplete, Length, plain_length, shorten_list
from ..core.material_feeds import HighMaterial
from ..core.settings import Settings, TracingSettings
from ..mesh import cutouts, triangle_mesh
from ..mesh.edges import is_without_area
from ..mesh.inputs import Meshes
from ..mesh.local_space import local_space_of
from ..mesh.triangle_mesh import Mesh
from . import (
    complaints,
    cycles_values,
    evaluation,
    high_materials,
    high_reader,
    mesh_reader,
    object_checks,
    poses,
    render_view,
)
from .high_materials import MaterialSet
from .high_reader import Reader, with_labels
from .high_reader import uv_layer as uv_layer_of
from .mesh_elements import weights


def lengths_of(scene: bpy.types.Scene) -> Length:
    """Lengths as Blender shows them in this scene."""
    units = scene.unit_settings
    system, scale = units.system, units.scale_length
    if system == "NONE":
        return plain_length
    return lambda value: bpy.utils.units.to_string(system, "LENGTH", value * scale, precision=LENGTH_DIGITS).strip()


SMALLEST, LARGEST = 5e-9, 1e9
"""The limits of a mesh's radius. The first is multiplied by the square root of the number of triangles.

Blender computes face normals from the cross product of two edges. In float32, its squared length is 0 for edges of 2e-9, and
infinite for 4e9."""


def read(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None,
    settings: Settings,
    *,
    others: Sequence[bpy.types.Object] = (),
    texture_set: MaterialSet | None = None,
    floaters: frozenset[int] = frozenset(),
    must_be_whole: bool = False,
) -> Meshes:
    """Evaluate and read all objects.

    others: other objects that are occluders. texture_set: the faces of the low object to bake; None for all. floaters: as in
    Reader. must_be_whole: whether objects may lack no files, and nothing that their modifiers need.

    Raises BakeError for missing faces or UV layers, and for a cage of another topology.
    """
    objects = list(dict.fromkeys([low, *highs, *others, *([cage] if cage else [])]))
    for_render = settings.map.modifiers == Modifiers.RENDER
    lacks = complaints.of_files(objects, for_render=for_render)
    if lacks and must_be_whole:
        raise Incomplete(" ".join(lacks))

    of_others: list[HighMaterial] = []

    def work(depsgraph: bpy.types.Depsgraph) -> Meshes:
        meshes = _read(depsgraph, low, highs, cage, settings, floaters=floaters)
        if texture_set is not None:
            meshes = high_materials.restricted(meshes, texture_set)
        if not others:
            return meshes
        # Rays only meet them: they need neither UVs nor materials, but for where they are clear.
        reader = Reader(depsgraph, low, "", settings.of_shapes())
        if settings.tracing.occluders == Occluders.SCENE:
            read = list(_those_with_faces(reader, others))
        else:
            read = reader.read(dict(enumerate(others)))
        of_others[:] = reader.materials.materials
        return replace(meshes, others=read)

    rest = poses.at_rest(context, low, highs, for_render=for_render) if settings.map.rest_pose else nullcontext()
    listener = complaints.Listener(objects, for_render=for_render)
    failed = None
    try:
        with rest, listener.listening():
            meshes = evaluation.evaluate(
                context, objects, work, modifiers=settings.map.modifiers, own_base=low if low in highs else None
            )
    except BakeError as error:
        failed = error
    lacks += listener.complaints()
    if lacks and must_be_whole:
        raise Incomplete(" ".join(lacks))
    if failed is not None:
        raise BakeError(" ".join([str(failed), *lacks])) if lacks else failed
    other_highs = cutouts.cut_out(replace(meshes, highs=meshes.others, materials=of_others)).highs
    return replace(cutouts.cut_out(replace(meshes, lacks=lacks)), others=other_highs)


def _those_with_faces(reader: Reader, others: Sequence[bpy.types.Object]) -> Iterator[Mesh]:
    """The meshes of objects that the scene shows: nobody chose them, and one without faces shades nothing."""
    for number, obj in enumerate(others):
        with suppress(BakeError):
            yield from reader.read({number: obj})


def read_again(
    context: bpy.types.Context,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None,
    settings: Settings,
    *,
    before: Meshes | None = None,
    changed: Collection[int] = (),
) -> Meshes:
    """Read the objects as `read` does, but as the viewport shows them, in their current modes.

    Objects whose session_uid is not in `changed` are copied from `before`, the result for the same objects and settings.
    """
    hidden = next((obj for obj in (low, *highs, cage) if obj and not evaluation.is_followed(context, obj)), None)
    if hidden is not None:
        raise BakeError(f"{hidden.name!r} is hidden in viewports, which Live follows: show it, or its collection.")
    with evaluation.with_visible_instances(context, highs) as depsgraph:
        if before is None or {low.session_uid, cage and cage.session_uid}.intersection(changed):
            meshes = _read(depsgraph, low, highs, cage, settings)
        else:
            known = dict(enumerate(before.highs, start=1))
            new = {number: high for number, high in enumerate(highs, start=1) if high.session_uid in changed}
            kept = before.materials, known, before.parts, object_checks.is_itself(low, highs)
            reader = Reader(depsgraph, low, before.uv_layer, settings, *kept)
            all_highs = with_labels(list((known | dict(zip(new, reader.read(new), strict=True))).values()))
            meshes = replace(
                before, highs=all_highs, materials=reader.materials.materials, parts=reader.part_names, lacks=[]
            )
            _check_triangles(meshes.highs)
    if meshes.is_own_base and evaluation.smooths_uvs(low):
        meshes = _with_kept_uvs(context, low, settings, meshes, before)
    return cutouts.cut_out(meshes, before.highs if before else ())


def differences(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object]
) -> list[tuple[bpy.types.Object, int, int]]:
    """Those of `objects` that renders see otherwise than the viewport shows them, with the number of their triangles in the
    viewport and in renders. Objects in Edit Mode and with Dyntopo, which are edited otherwise than they are evaluated, are left
    out.

    Raises BakeError while a render runs.
    """
    asked = [
        obj
        for obj in dict.fromkeys(objects)
        if obj.mode in {"OBJECT", "SCULPT"} and not (obj.mode == "SCULPT" and obj.use_dynamic_topology_sculpting)
        if object_checks.may_differ_in_renders(obj, context.scene)
    ]
    if not asked:
        return []
    shown = _shapes(context.evaluated_depsgraph_get(), asked)
    rendered = render_view.read(context, asked, lambda depsgraph: _shapes(depsgraph, asked))
    pairs = zip(asked, shown, rendered, strict=True)
    return [(obj, one[0], other[0]) for obj, one, other in pairs if one != other]


def _shapes(depsgraph: bpy.types.Depsgraph, objects: Sequence[bpy.types.Object]) -> list[tuple[int, int]]:
    """The number of triangles that each object shows, with its instances, and a checksum of all places."""
    shapes = [(0, 0)] * len(objects)
    known: dict[int, tuple[int, int]] = {}

    def add(number: int, data: bpy.types.Mesh, matrix: Matrix) -> None:
        key = data.as_pointer()
        if key not in known:
            triangles = len(data.loops) - 2 * len(data.polygons)
            known[key] = triangles, zlib.crc32(mesh_reader.points(data))
        triangles, checksum = known[key]
        checksum = zlib.crc32(np.array(matrix, np.float32).tobytes(), checksum)
        shapes[number] = shapes[number][0] + triangles, shapes[number][1] ^ checksum

    for number, obj in enumerate(objects):
        if object_checks.shows_itself(obj, for_render=depsgraph.mode == "RENDER"):
            shown = obj.evaluated_get(depsgraph)
            add(number, shown.data, shown.matrix_world)
    for number, obj, matrix in high_reader.instances_shown(depsgraph, objects):
        add(number, obj.data, matrix)
    return shapes


def _with_kept_uvs(
    context: bpy.types.Context, low: bpy.types.Object, settings: Settings, meshes: Meshes, before: Meshes | None
) -> Meshes:
    """`meshes`, whose high mesh is the low object's own surface, with the UVs before modifiers moved them.

    Reading those UVs changes the scene, so they are read only if the viewport's UVs differ from those in `before`.
    """
    (shown,) = meshes.highs
    if shown.uv is None:
        return meshes
    last = before and before.shown
    if last is not None and last.uv.shape == shown.uv.shape and np.array_equal(last.uv, shown.uv):
        uv = before.highs[0].uv
    else:
        with evaluation.with_fixed_uvs(context, low) as depsgraph:
            uv = Reader(depsgraph, low, meshes.uv_layer, settings).read({1: low})[0].uv
    return replace(meshes, highs=[replace(shown, uv=uv)], shown=shown)


def _read(
    depsgraph: bpy.types.Depsgraph,
    low: bpy.types.Object,
    highs: Sequence[bpy.types.Object],
    cage: bpy.types.Object | None,
    settings: Settings,
    *,
    floaters: frozenset[int] = frozenset(),
) -> Meshes:
    meshes = read_low(depsgraph, low, cage, settings, is_own_base=low in highs)
    is_itself = object_checks.is_itself(low, highs)
    reader = Reader(depsgraph, low, meshes.uv_layer, settings, is_itself=is_itself, floaters=floaters)
    read = reader.read(dict(enumerate(highs, start=1)))
    meshes = replace(
        meshes,
        highs=read,
        materials=reader.materials.materials,
        parts=reader.part_names,
        load_image=reader.materials.images.load,
        evaluate=partial(cycles_values.evaluate, [high.session_uid for high in highs]),
    )
    _check_triangles([meshes.low, *meshes.highs, *([meshes.cage] if meshes.cage else [])])
    if settings.tracing.method != Method.FLATTEN:
        check_area([meshes.low])
    return meshes


def read_low(
    depsgraph: bpy.types.Depsgraph,
    low: bpy.types.Object,
    cage: bpy.types.Object | None,
    settings: Settings,
    *,
    is_own_base: bool,
    with_uv: bool = True,
) -> Meshes:
    """Read only the low mesh and its cage. Without UVs, there are no tangents either. Errors: as `read`."""
    shown = low if is_own_base else low.evaluated_get(depsgraph)
    with mesh_reader.base(low) if is_own_base else mesh_reader.evaluated(low, depsgraph) as data:
        uv_layer = uv_layer_of(low.name, data, settings.map.uv_layer) if with_uv else ""
        to_world = mesh_reader.matrix(low.evaluated_get(depsgraph))
        low_mesh = mesh_reader.surface(data, uv_layer, low.name, to_world, with_faces=True)
        smooth_normals = mesh_reader.smooth_normals(data, low_mesh)
        has_basis = settings.map.space == Space.TANGENT and with_uv
        basis = mesh_reader.with_tangents(data, uv_layer, low.name, to_world, low_mesh) if has_basis else None
        if basis is not None:
            # A face whose index is too high shows the last slot.
            last = max(0, len(shown.material_slots) - 1)
            basis = replace(basis, labels=basis.labels.clip(0, last))
            basis = triangle_mesh.with_stretch(basis, settings.map.basis)
        if settings.map.texture_sets:
            low_mesh = high_materials.with_slots(low_mesh, data, shown)
        offset, straight = _painted(shown, data, low_mesh, settings.tracing)
        # The cage comes last: if it is the low object itself, reading it frees the mesh.
        cage_mesh = cage and _cage(cage, depsgraph, low_mesh, len(data.polygons))
    return Meshes(
        low_mesh,
        [],
        basis,
        smooth_normals,
        cage_mesh,
        uv_layer,
        is_own_base,
        [],
        offset=offset,
        straight=straight,
    )


def _painted(
    owner: bpy.types.Object, data: bpy.types.Mesh, low: Mesh, tracing: TracingSettings
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """`offset` and `straight`, as Meshes has them. owner: of `data`, which `low` was read from."""
    if tracing.method == Method.FLATTEN:
        return None, None
    offset, straight = weights(owner, data, (tracing.offset_group, tracing.straight_group))
    return (
        None if offset is None else 2.0 * offset[low.vertices],
        None if straight is None else 2.0 * straight[low.vertices] - 1.0,
    )


def _check_triangles(meshes: Sequence[Mesh]) -> None:
    for mesh in meshes:
        if not len(mesh.triangles):
            raise BakeError(
                f"{mesh.name!r} has no valid triangles: the coordinates of all of them are NaN or infinite."
            )
        _check_size(mesh)


def check_surface(meshes: Sequence[Mesh]) -> None:
    """Raise BakeError unless all meshes have valid triangles, some of which have an area."""
    _check_triangles(meshes)
    check_area(meshes)


def check_area(meshes: Sequence[Mesh]) -> None:
    """Raise BakeError if all triangles of all meshes are points or lines."""
    if all(map(is_without_area, meshes)):
        names = shorten_list(repr(mesh.name) for mesh in meshes)
        raise BakeError(f"All faces of {names} are points or lines without an area: no ray can meet them.")


def _check_size(mesh: Mesh) -> None:
    lowest, highest = mesh.box
    most, longest = float(np.abs(mesh.box).max()), float((highest - lowest).max())
    stretch = max(1.0, float(np.linalg.norm(mesh.to_world[:3, :3])))
    smallest = SMALLEST * len(mesh.triangles) ** 0.5
    if smallest < longest and most < LARGEST / stretch:  # a quick check, which is enough for nearly all meshes
        return
    in_object, in_scene = (
        local_space_of([replace(mesh, to_world=to_world)]).size for to_world in (np.eye(4), mesh.to_world)
    )
    if in_object < smallest:
        raise BakeError(
            f"{mesh.name!r} has a radius of {in_object:.1g}, too small for its normals: scale the mesh itself up."
        )
    if max(in_object, in_scene) > LARGEST:
        raise BakeError(
            f"{mesh.name!r} has a radius of {max(in_object, in_scene):.1g}, too large for its normals: scale it down, or "
            "remove faces that are far away."
        )


def _cage(cage: bpy.types.Object, depsgraph: bpy.types.Depsgraph, low: Mesh, low_faces: int) -> Mesh:
    with mesh_reader.evaluated(cage, depsgraph) as data:
        mesh = mesh_reader.surface(data, "", cage.name, mesh_reader.matrix(cage.evaluated_get(depsgraph)))
        _check_cage(low, mesh, (low_faces, len(data.polygons)))
    return mesh


def _check_cage(low: Mesh, cage: Mesh, faces: tuple[int, int]) -> None:
    """Raise BakeError unless `cage` has the topology of `low`. faces: the numbers of faces of `low` and `cage`."""
    if faces[0] != faces[1]:
        raise BakeError(
            f"The cage {cage.name!r} has {faces[1]:,} faces and {low.name!r} has {faces[0]:,}: use a copy of the low mesh."
        )
    if len(cage.vertices) != len(low.vertices):
        raise BakeError(
            f"The cage {cage.name!r} has {len(cage.vertices):,} face corners and {low.name!r} has {len(low.vertices):,}: "
            "use a copy of the low mesh."
        )
