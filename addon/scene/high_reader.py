# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads high objects, with their modifiers: joins the mesh and the instances of each into one mesh."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter

import bpy
import numpy as np

from ..core import foreach
from ..core.declarations import bases
from ..core.declarations.choices import ExactMaterials, Method, Space
from ..core.errors import UNWRAP_FIRST, BakeError
from ..core.map_types import BY_NAME, PART_ID
from ..core.material_feeds import HighMaterial
from ..core.settings import Settings
from ..mesh import joining, topology
from ..mesh.joining import Part, usable
from ..mesh.triangle_mesh import GENERATED, FaceCorners, Mesh, changed_rows, changed_share
from . import mesh_elements, mesh_reader, mesh_writer, object_checks, part_ids
from .high_materials import Itself, MaterialNumbers, Shown, read_layers
from .materials.material_reading import CUT_OUTS, NORMAL
from .textures import ImageTextures

MOST = 200_000_000
"""The largest number of triangles of a high object with its instances: more do not fit into memory or on a GPU."""


ReadMesh = Callable[[bpy.types.Object, bpy.types.Object, bpy.types.Mesh], Mesh]
"""A function that converts a mesh to arrays. It takes the object that shows the instance, the instanced object and its mesh."""


@dataclass
class Reader:
    """Reads the high objects of one bake.

    Attributes:
        low, low_layer: The low object, and its mesh's UV layer.
        before: The materials of an earlier reading, which keep their numbers.
        known: Meshes of that reading, by the number of their high object; if only vertices have moved, little is read again.
        parts: The names of parts of that reading, which keep their numbers.
        depsgraph: In which they are evaluated.
        is_itself: Whether the low object is baked onto itself.
        floaters: The session_uids of objects that block no rays of ambient occlusion, beside those that are marked.
    """

    depsgraph: bpy.types.Depsgraph
    low: bpy.types.Object
    low_layer: str
    settings: Settings
    before: Sequence[HighMaterial] = ()
    known: Mapping[int, Mesh] = field(default_factory=dict)
    parts: Sequence[str] = ()
    is_itself: bool = False
    floaters: frozenset[int] = frozenset()

    @property
    def part_names(self) -> list[str]:
        """The names of the parts of the meshes, by their numbers from 1."""
        return list(self._part_numbers)

    @property
    def is_for_render(self) -> bool:
        """Whether the objects are read as renders see them."""
        return self.depsgraph.mode == "RENDER"

    def __post_init__(self):
        self._part_numbers = {name: number for number, name in enumerate(self.parts, start=1)}
        sockets = {BY_NAME[name].socket for name in self.settings.map.drawn_maps} - {""}
        if self.settings.map.detail_maps:
            sockets.add(NORMAL)
        if self.settings.tracing.cut_outs:
            sockets.add(CUT_OUTS)
        self.materials = MaterialNumbers(
            ImageTextures(),
            self.low.evaluated_get(self.depsgraph),
            sockets=sockets,
            is_exact=self.settings.map.exact_materials == ExactMaterials.AUTO,
            itself=self._itself() if self.is_itself else None,
            before=self.before,
        )

    def _itself(self) -> Itself:
        is_rendered = mesh_elements.render_layer(self.low.data) == self.low_layer
        is_tangent = self.settings.map.space == Space.TANGENT
        basis = self.settings.map.basis if is_tangent else bases.CYCLES.name
        return Itself(frozenset([self.low_layer, *([""] if is_rendered else [])]), basis)

    def read(self, highs: Mapping[int, bpy.types.Object]) -> list[Mesh]:
        """Read the meshes of `highs`, labeled with their numbers. Raises BakeError for an object without a mesh."""
        owners = {number: high for number, high in highs.items() if object_checks.shows_more(high)}
        numbers = {high.session_uid: number for number, high in highs.items()}
        instances = read_instances(
            self.depsgraph,
            list(owners.values()),
            lambda owner, obj, data: self._mesh(numbers[owner.session_uid], owner.name, obj, data, np.eye(4)),
        )
        shown = dict(zip(owners, instances, strict=True))
        meshes = [
            _marked(self._joined(number, high, shown.get(number, [])), self._is_floater(high))
            for number, high in highs.items()
        ]
        return with_labels(meshes)

    def _is_floater(self, high: bpy.types.Object) -> bool:
        return high.session_uid in self.floaters or object_checks.is_floater(high)

    def _joined(self, number: int, high: bpy.types.Object, parts: Sequence[Part]) -> Mesh:
        """The mesh of `high` joined with its instances."""
        evaluated = high.evaluated_get(self.depsgraph)
        to_world = mesh_reader.matrix(evaluated)
        mesh = None
        if object_checks.shows_itself(high, for_render=self.is_for_render):
            with mesh_reader.evaluated(high, self.depsgraph) as data:
                if data.polygons or not parts:
                    copied = mesh_reader.copied(high, self.depsgraph)
                    mesh = self._mesh(number, high.name, evaluated, data, to_world, copied=copied)
        if not parts:
            if mesh is None or not len(mesh.vertices):
                raise BakeError(_no_faces(high))
            return mesh
        if sum(len(part.matrices) * len(part.mesh.triangles) for part in parts) > MOST:
            raise BakeError(
                f"{high.name!r} has more than {MOST:,} triangles with its instances: reduce the number of instances."
            )
        labeled = [part.mesh.labels[:, 1].astype(np.int64) for part in parts if part.mesh.labels is not None]
        if labeled:
            why = f"its nodes read the object, which differs between the instances of {high.name!r}"
            self.materials.give_up(np.unique(np.concatenate(labeled)).tolist(), attrgetter("is_of_object"), why)
        if mesh is not None:
            parts = [Part(mesh, to_world[None]), *parts]
        if self.settings.tracing.method == Method.AUTO and max(len(part.matrices) for part in parts) > 1:
            # All instances of a mesh have the same UVs, so Flatten would draw them on top of each other.
            parts = [Part(replace(part.mesh, uv=None), part.matrices) for part in parts]
        return joining.join(high.name, to_world, parts)

    def _mesh(
        self,
        number: int,
        name: str,
        obj: bpy.types.Object,
        data: bpy.types.Mesh,
        to_world: np.ndarray,
        *,
        copied: mesh_reader.Copied | None = None,
    ) -> Mesh:
        """Read the mesh `data` of the evaluated object `obj`, which belongs to the high object `name`.

        Its materials are those of the evaluated object: modifiers set some. copied: as mesh_reader.surface has it.
        """
        layer, method = "", self.settings.tracing.method
        if not data.polygons:
            raise BakeError(_no_faces(obj))
        if method == Method.FLATTEN or (method == Method.AUTO and data.uv_layers):
            # Use the layer with the name of the low mesh's layer, or else the active one.
            layer = uv_layer(name, data, self.low_layer if self.low_layer in data.uv_layers else "")
        slots = self.materials.of_slots(obj, data)
        has_labels = bool(self.settings.map.drawn_maps) or self.settings.map.texture_sets
        if has_labels or self.settings.map.detail_maps or self.settings.tracing.cut_outs:
            shown = [self.materials.read(material) for material in slots]
            has_labels = has_labels or any(material.detail or material.cutout for material in shown)
        known, mesh = self.known.get(number), None
        if known is not None and known.name == name and not known.instances:
            mesh = read_moved(data, layer, known, to_world, with_faces=has_labels)
        if mesh is None:
            is_drawn_in_uv = method == Method.FLATTEN
            mesh = mesh_reader.surface(
                data,
                layer,
                name,
                to_world,
                is_drawn_in_uv=is_drawn_in_uv,
                with_faces=has_labels,
                copied=copied,
            )
        if not has_labels:
            return mesh
        mesh = self._labeled(mesh, number, slots, data)
        if PART_ID.name in self.settings.map.drawn_maps:
            mesh = self._with_parts(mesh, data, obj)
        layers = read_layers(obj.original, data, shown, self.settings.map, for_render=self.is_for_render)
        if (GENERATED, "") not in layers:
            why = f"the generated coordinates of {obj.name!r} are not known after its modifiers"
            used = [self.materials.number(material) for material in slots]
            self.materials.give_up(used, lambda feed: (GENERATED, "") in feed.layers, why)
        return replace(mesh, layers=layers)

    def _labeled(self, mesh: Mesh, number: int, slots: Sequence[Shown], data: bpy.types.Mesh) -> Mesh:
        """`mesh` labeled with the numbers of its high object and of its materials."""
        indices = mesh_reader.material_slots(data, mesh, len(slots))
        numbers = np.array([self.materials.number(material) for material in slots])
        labels = np.stack([np.full(len(indices), number), numbers[indices]], axis=1).astype(np.float32)
        return replace(mesh, labels=labels)

    def _with_parts(self, mesh: Mesh, data: bpy.types.Mesh, obj: bpy.types.Object) -> Mesh:
        """`mesh` with a third label, the number of each triangle's part."""
        parts, names = part_ids.of_triangles(mesh, data, obj, self.settings.map.own(PART_ID)["id_by"])
        known = self._part_numbers
        numbers = np.array([known.setdefault(name, len(known) + 1) for name in names], np.float32)
        return replace(mesh, labels=np.column_stack([mesh.labels, numbers[parts]]))


def _marked(mesh: Mesh, is_floater: bool) -> Mesh:
    """The mesh itself where it is marked so: what was made of it is kept with it."""
    return mesh if mesh.is_floater == is_floater else replace(mesh, is_floater=is_floater)


def with_labels(meshes: Sequence[Mesh]) -> list[Mesh]:
    """`meshes`, all with labels if one has them. The number 0 stands for no object, no material and no part."""
    count = max((mesh.labels.shape[1] for mesh in meshes if mesh.labels is not None), default=0)
    return [
        replace(mesh, labels=np.zeros((len(mesh.triangles), count), np.float32))
        if count and mesh.labels is None
        else mesh
        for mesh in meshes
    ]


def instances_shown(depsgraph: bpy.types.Depsgraph, owners: Sequence[bpy.types.Object]) -> Iterator[tuple]:
    """Each instance that `owners` show: the owner's index, the evaluated object shown, and its matrix.

    The object is valid only until the next step of the iteration.
    """
    numbers = {owner.session_uid: number for number, owner in enumerate(owners)}
    for item in depsgraph.object_instances if owners else ():
        if item.is_instance and item.object.type == "MESH":
            number = numbers.get(item.parent.original.session_uid)
            if number is not None:
                yield number, item.object, item.matrix_world


def read_instances(
    depsgraph: bpy.types.Depsgraph, owners: Sequence[bpy.types.Object], as_mesh: ReadMesh
) -> list[list[Part]]:
    """The instances of each of `owners`. Each mesh is read once, however many instances it has."""
    by_owner: list[dict[tuple, tuple[Mesh | None, list]]] = [{} for _ in owners]
    for number, obj, matrix in instances_shown(depsgraph, owners):
        # Objects that share a mesh can have different materials.
        key = obj.data.as_pointer(), obj.original.session_uid
        if key not in by_owner[number]:
            try:
                data = obj.to_mesh()
                by_owner[number][key] = as_mesh(owners[number], obj, data) if data.polygons else None, []
            finally:
                obj.to_mesh_clear()
        by_owner[number][key][1].append(matrix.copy())
    parts = [
        [Part(mesh, usable(np.array(matrices, np.float64))) for mesh, matrices in meshes.values() if mesh is not None]
        for meshes in by_owner
    ]
    return [[part for part in of_owner if len(part.matrices)] for of_owner in parts]


def uv_layer(name: str, data: bpy.types.Mesh, wanted: str) -> str:
    """The name of the UV layer to read from `data`, the mesh of the object `name`. Raises BakeError if there is none."""
    if not data.polygons:
        raise BakeError(f"{name!r} has no faces.")
    if not data.uv_layers:
        raise BakeError(f"{name!r} has no UV layer: {UNWRAP_FIRST}.")
    if wanted and wanted not in data.uv_layers:
        existing = ", ".join(repr(layer.name) for layer in data.uv_layers)
        raise BakeError(f"{name!r} has no UV layer {wanted!r}: it has {existing}.")
    return wanted or mesh_reader.active_uv_layer(data)


def _no_faces(high: bpy.types.Object) -> str:
    if high.type == "META" and "." in high.name:
        return f"{high.name!r} has no faces: the surface of its metaballs belongs to {high.name.rpartition('.')[0]!r}."
    return f"{high.name!r} has no faces."


MOVED_SHARE = 0.25
"""Share of the vertices. If more have moved, reading the whole mesh takes as long."""


def read_moved(
    data: bpy.types.Mesh, uv_layer: str, known: Mesh, to_world: np.ndarray, *, with_faces: bool = False
) -> Mesh | None:
    """What mesh_reader.surface returns for `data`, if it differs from `known` at most in the positions of few vertices, and in
    the normals and triangles that follow from them; otherwise None. Arrays that are the same are those of `known`, but labels
    and layers are left out: they follow from materials, which may have changed."""
    is_known = known.normals_domain in {"POINT", "FACE"} and not known.not_finite
    if not is_known or mesh_reader.normals_domain(data) != known.normals_domain:
        return None
    if (len(data.vertices), len(data.loops)) != (len(known.positions), len(known.vertices)):
        return None
    positions = mesh_reader.points(data)
    if changed_share(positions, known.positions) > 2.0 * MOVED_SHARE:
        return None
    moved = changed_rows(positions, known.positions)
    if len(moved) > MOVED_SHARE * len(positions) or (known.uv is not None) != bool(uv_layer):
        return None
    if uv_layer and not _holds(data.uv_layers[uv_layer].uv, known.uv, lambda: mesh_reader.uvs(data, uv_layer)):
        return None
    corners = data.attributes[".corner_vert"].data
    if not _holds(corners, known.vertices, lambda: mesh_reader.corner_vertices(data)):
        return None
    known = _with_triangles(data, known)
    if known is None:
        return None
    faces = mesh_reader.triangle_faces(data) if with_faces else None
    known = replace(known, to_world=to_world, faces=faces, labels=None, layers={})
    if not len(moved):
        return known
    corners, around = _normals_around(positions, known.face_corners, moved, known.normals_domain)
    if not (np.isfinite(around).all() and np.isfinite(positions[moved]).all()):
        return None
    normals = known.normals.copy()
    normals[corners] = around
    return replace(known, positions=positions, normals=normals)


def _with_triangles(data: bpy.types.Mesh, known: Mesh) -> Mesh | None:
    """`known` with the triangles of `data`, which has the same corners, and with its face_corners. None for other faces."""
    data.calc_loop_triangles()
    if len(data.loop_triangles) != len(known.triangles):
        return None
    is_same = _holds(data.loop_triangles, known.triangles, lambda: mesh_reader.triangles(data))
    if is_same and known.face_corners is not None:
        return known
    faces = mesh_reader.triangle_faces(data)
    # Blender takes three times as long to list the faces themselves.
    starts = np.zeros(len(data.polygons) + 1, np.int32)
    np.cumsum(np.bincount(faces, minlength=len(data.polygons)) + 2, out=starts[1:])
    corners = FaceCorners(starts, known.vertices)
    if is_same:
        return replace(known, face_corners=corners)
    triangles = mesh_reader.triangles(data)
    other = changed_rows(triangles, known.triangles)
    if not _are_of_faces(known.triangles[other], faces[other], starts):
        return None
    return replace(known, triangles=triangles, face_corners=known.face_corners or corners)


def _are_of_faces(triangles: np.ndarray, faces: np.ndarray, starts: np.ndarray) -> bool:
    """Whether the corners of each of `triangles` (T, 3) belong to the face in `faces` (T,): then they divide these faces."""
    first, end = starts[faces], starts[faces + 1]
    return all(((corner >= first) & (corner < end)).all() for corner in triangles.T)


def _holds(collection: bpy.types.bpy_prop_collection, known: np.ndarray, read: Callable[[], np.ndarray]) -> bool:
    """Whether a collection of Blender has the values `known`, to the bit. read: reads it.

    Compares Blender's memory itself if the elements lie one after the other: copying it takes longer.
    """
    memory = mesh_reader.memory_of(collection, known.size // max(1, len(collection)))
    if memory is not None:
        return np.array_equal(memory.reshape(-1), known.reshape(-1).view(np.int32))
    return np.array_equal(read(), known)


def _normals_around(
    positions: np.ndarray, faces: FaceCorners, moved: np.ndarray, domain: str
) -> tuple[np.ndarray, np.ndarray]:
    """The corners (N,) whose normals depend on the `moved` vertices, and their normals (N, 3) float32."""
    touched = faces.faces_of(faces.corners_at(moved, len(positions)))
    corners = faces.corners_of(touched)
    if domain == "FACE":
        normals = _normals_of(positions, faces.vertices[corners], faces.sizes(touched), "polygon_normals")
        return corners, np.repeat(normals, faces.sizes(touched), axis=0)
    corners = faces.corners_at(np.unique(faces.vertices[corners]), len(positions))
    around = faces.faces_of(corners)
    used, numbers = topology.numbered(faces.vertices[faces.corners_of(around)])
    normals = _normals_of(positions[used], numbers.astype(np.int32), faces.sizes(around), "vertex_normals")
    return corners, normals[np.searchsorted(used, faces.vertices[corners])]


def _normals_of(positions: np.ndarray, vertices: np.ndarray, sizes: np.ndarray, kind: str) -> np.ndarray:
    """The "vertex_normals" or "polygon_normals" (N, 3) float32 of faces with these sizes and vertices by corner."""
    # Outside of bpy.data: a new mesh in the open file would make Blender look at the whole scene again.
    with bpy.data.temp_data() as temporary:
        data = temporary.meshes.new("Imprint vertices")
        mesh_writer.fill(data, positions, vertices, np.cumsum(sizes) - sizes)
        return foreach.vectors(getattr(data, kind))
