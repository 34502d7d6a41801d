# SPDX-License-Identifier: GPL-3.0-or-later
"""Gives low meshes a UV map: cuts a copy into charts in several ways, unwraps them by Blender, and takes the sharpest.

The mesh itself only gets the UV map. Its modes, its selection and its seams stay as they are.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial

import bpy
import numpy as np

from ..audit import mip_gaps
from ..core.errors import BakeError
from ..core.progress import Progress, Task, finish, part
from ..core.settings import SamplingSettings, Settings
from ..mesh import uv_crossings, uv_islands, uv_packing, uv_stretch
from ..mesh.edges import is_without_area
from ..mesh.topology import edge_keys
from ..mesh.triangle_mesh import Mesh
from ..mesh.uv_charts import Charts
from ..mesh.uv_packing import PackOptions
from ..mesh.uv_stretch import Layout
from ..scene import mesh_reader, object_checks
from ..scene.object_checks import ObjectRef
from . import temporary

NAME = "UVMap"
"""Of the new UV map, as Blender calls it."""
MOST = 8
"""UV maps of a mesh, in Blender."""
STEPS = (
    (300.0, ""),
    (100.0, "tiny charts"),
    (30.0, ""),
    (10.0, ""),
    (3.0, ""),
    (1.0, "small charts"),
    (0.3, "medium charts"),
    (0.1, "large charts"),
)
"""The steps in which charts grow: how much stretch counts, and their name if they are tried. Where they are bad they are split
into those of the step before."""
QUICK = "medium charts"
"""Those that are tried if it has to be quick."""
MANY = 600
"""More charts than this are not tried, and more islands are packed by boxes alone: both would take long."""
TINIEST, FEW = STEPS[1][1], 200
"""The smallest charts that are tried, and only if there are few: many margins cost more of the map than stretch does."""
AGAIN = 8
"""How often charts are unwrapped anew, at most, because some are bad."""
ANGLE = np.radians(66.0)
"""The angle between faces from which Smart Project cuts, as Blender has it."""


@dataclass(frozen=True)
class Unwrapped:
    """A way to unwrap, and what it gave.

    Attributes:
        mesh: With its UVs.
        of: The island of each of its triangles.
        name: Of the way, for messages.
        side: Texels of the map's shorter side.
    """

    name: str
    mesh: Mesh
    of: np.ndarray
    side: int

    @cached_property
    def layout(self) -> Layout:
        """How the UVs use the map."""
        return uv_stretch.measure(
            _points(self.mesh), self.mesh.uv[self.mesh.triangles], self.side, self.mesh.vertices[self.mesh.triangles]
        )

    @property
    def islands(self) -> int:
        """Their number."""
        return int(self.of.max(initial=-1)) + 1

    @property
    def sentence(self) -> str:
        """The figures, as a clause."""
        layout = self.layout
        return (
            f"{self.islands:,} islands by {self.name}, {layout.used:.0%} of the map used, stretch {layout.angle:.2f} (angles), "
            f"{layout.area:.2f} (areas)"
        )

    def packed(self, margin: float, *, is_quick: bool = False) -> "Unwrapped":
        """With the islands packed by their outlines if that is better. margin: around each, as a share of the map's side."""
        if self.islands > MANY:
            return self
        uv = uv_packing.pack(self.mesh.uv, self.mesh.triangles, PackOptions(margin, self.of, is_quick))
        if uv is None:
            return self
        packed = replace(self, mesh=replace(self.mesh, uv=uv.astype(np.float32)))
        return max(self, packed, key=lambda each: each.layout.sharpness)


def unwrap(low: bpy.types.Object, settings: Settings, *, is_quick: bool = False) -> str:
    """`work`, done at once."""
    return finish(work(low, settings, is_quick=is_quick))


def work(low: bpy.types.Object, settings: Settings, *, is_quick: bool = False) -> Task[str]:
    """Give an object's own mesh a UV map, the active one. Returns a sentence about it. is_quick: whether only one way is tried.

    Raises BakeError if no way works. Then, and if it is closed before its end, nothing has changed.
    """
    ref = ObjectRef.of(low)
    found = yield from find(low, settings.sampling, is_quick=is_quick)
    return apply(ref.resolve(), found)


def find(low: bpy.types.Object, sampling: SamplingSettings, *, is_quick: bool = False) -> Task[Unwrapped]:
    """The best UV map of an object's own mesh, which stays as it is. As `work`."""
    check(low)
    name = low.name
    unwrapped = yield from part(attempts(low, sampling, is_quick=is_quick), 0.0, 0.9)
    best = max(unwrapped, key=lambda each: each.layout.sharpness, default=None)
    if best is None or best.layout.sharpness == 0.0:
        raise BakeError(f"{name!r} has no UV map, and Blender cannot unwrap it: its faces have no area.")
    if not is_quick:
        yield Progress("Packing UV islands", 0.9)
        best = best.packed(margin(sampling))
    return best


def check(low: bpy.types.Object) -> None:
    """Raise BakeError for what keeps an object from being unwrapped, and shows at once."""
    if low.type != "MESH" or not low.data.polygons:
        raise BakeError(f"{low.name!r} has no faces: choose a mesh that has some.")
    if len(low.data.uv_layers) == MOST:
        raise BakeError(f"{low.name!r} has as many UV maps as a mesh can have: remove one.")


def apply(low: bpy.types.Object, found: Unwrapped) -> str:
    """Give an object's own mesh the UV map that was found for it. Returns a sentence. Raises BakeError if it has other faces
    by now."""
    if len(low.data.uv_layers) == MOST or 2 * len(low.data.loops) != found.mesh.uv.size:
        raise BakeError(f"{low.name!r} has changed meanwhile: unwrap it again.")
    shows_textures = bool(low.data.uv_layers) and bool(object_checks.textures_of(low))
    layer = low.data.uv_layers.new(name=NAME, do_init=False)
    layer.uv.foreach_set("vector", found.mesh.uv.reshape(-1))
    low.data.uv_layers.active = layer
    if not shows_textures:  # else these stay where they are, and a bake moves them
        layer.active_render = True
    low.data.update()
    return f"{low.name!r} is unwrapped: {found.sentence}"


def attempts(low: bpy.types.Object, sampling: SamplingSettings, *, is_quick: bool = False) -> Task[list[Unwrapped]]:
    """What each way gives with the margin that the clean mip levels of the settings need, packed quickly."""
    seams = np.zeros(len(low.data.edges), bool)
    low.data.edges.foreach_get("use_seam", seams)
    with _copy(low) as obj:
        mesh = _read(obj)
        if is_without_area(mesh):
            return []
        yield Progress("Cutting into charts", 0.0)
        charts = Charts(mesh.positions, mesh.vertices[mesh.triangles], mesh.faces, margin(sampling), _hard(obj.data))
        ways: dict[str, Callable[[], bool]] = {}
        for stretch, name in STEPS:
            charts.grow(stretch)
            most = FEW if name == TINIEST else MANY
            if name and charts.count <= most and (name == QUICK or not is_quick):
                ways[name] = partial(_by_charts, obj, charts, charts.steps)
        if seams.any() and not is_quick:
            ways["the mesh's seams"] = partial(_by_seams, obj, seams)
        unwrapped: list[Unwrapped | None] = []
        for done, (name, way) in enumerate(ways.items()):
            yield Progress(f"Unwrapping by {name}", (1 + done) / (1 + len(ways)))
            unwrapped.append(_attempt(obj, name, way, sampling))
        if not any(unwrapped):
            unwrapped = [_attempt(obj, "Smart Project", partial(_project, obj), sampling)]
        return [each for each in unwrapped if each]


def _attempt(obj: bpy.types.Object, name: str, way: Callable[[], bool], sampling: SamplingSettings) -> Unwrapped | None:
    """Unwrap an object and pack its islands. Returns None if Blender cannot."""
    try:
        if not way():
            return None
        with editing(obj):
            pack_boxes(margin(sampling))
    except RuntimeError:  # an operator that cannot work says so in this way
        return None
    mesh = _read(obj)
    unwrapped = Unwrapped(name, mesh, uv_islands.islands(mesh), min(sampling.size))
    return unwrapped.packed(margin(sampling), is_quick=True)


def margin(sampling: SamplingSettings) -> float:
    """The margin around islands that the clean mip levels of the settings need, as a share of the map's side."""
    return mip_gaps.needed(sampling) / 2.0 / min(sampling.size)


def _by_charts(obj: bpy.types.Object, charts: Charts, step: int) -> bool:
    """Unwrap by the charts after a number of steps, and again with smaller ones where they fold, overlap or are stretched.

    Returns whether that works.
    """
    steps = np.full(len(obj.data.polygons), step)
    ends = np.empty((len(obj.data.edges), 2), np.int32)
    obj.data.edges.foreach_get("vertices", ends.reshape(-1))
    width = len(obj.data.vertices)
    keys = edge_keys(*ends.T, width)
    for is_again in (False, *[True] * AGAIN):
        _by_seams(obj, np.isin(keys, edge_keys(*charts.seams(steps).T, width)))
        mesh = _read(obj)
        islands = uv_islands.islands(mesh)
        folded, stretched = uv_stretch.bad(_points(mesh), mesh.uv[mesh.triangles], islands)
        folded |= uv_crossings.crossing(mesh, islands)
        if not (folded | stretched).any():
            return True
        # Smaller charts may do. If they still are folded, only the faces where they are become charts of their own.
        smaller = mesh.faces[np.isin(islands, islands[stretched if is_again else stretched | folded])]
        steps[smaller] = np.maximum(steps[smaller] - 1, 0)
        if is_again:
            steps[mesh.faces[folded]] = 0
    return not folded.any()


def _by_seams(obj: bpy.types.Object, seams: np.ndarray) -> bool:
    obj.data.edges.foreach_set("use_seam", seams)
    with editing(obj):
        bpy.ops.uv.unwrap(method="MINIMUM_STRETCH", fill_holes=False, correct_aspect=False, margin=0.0)
        bpy.ops.uv.average_islands_scale()
    return True


def _hard(data: bpy.types.Mesh) -> np.ndarray:
    """The edges that are marked as sharp, as vertices (H, 2)."""
    ends, is_sharp = np.empty((len(data.edges), 2), np.int32), np.empty(len(data.edges), bool)
    data.edges.foreach_get("vertices", ends.reshape(-1))
    data.edges.foreach_get("use_edge_sharp", is_sharp)
    return ends[is_sharp]


def _project(obj: bpy.types.Object) -> bool:
    obj.data.edges.foreach_set("use_seam", np.zeros(len(obj.data.edges), bool))
    with editing(obj):
        bpy.ops.uv.smart_project(angle_limit=ANGLE, island_margin=0.0, area_weight=0.0, correct_aspect=False)
    return True


def _read(obj: bpy.types.Object) -> Mesh:
    return mesh_reader.surface(obj.data, mesh_reader.active_uv_layer(obj.data), obj.name, np.eye(4), with_faces=True)


def _points(mesh: Mesh) -> np.ndarray:
    return mesh.positions[mesh.vertices[mesh.triangles]]


def pack_boxes(margin: float) -> None:
    """Pack islands with a margin around each, as a share of the map's side: the distance between two is twice as large.

    By boxes: the packing by outlines takes minutes for hundreds of islands.
    """
    # An exact margin makes Blender try few layouts, and one that is added before all is scaled makes it try more. Once islands
    # have about their final size, both are the same.
    for method in ("FRACTION", "ADD", "ADD"):
        bpy.ops.uv.pack_islands(
            rotate=True, scale=True, margin_method=method, margin=margin, shape_method="AABB", merge_overlap=False
        )


@contextmanager
def _copy(low: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """A copy of the object's own mesh, as large as the object makes it, with a new UV map, in a scene of its own."""
    with temporary.scene() as scene:
        data = low.data.copy()
        data.transform(low.matrix_world.to_3x3().to_4x4())
        data.uv_layers.active = data.uv_layers.new(name=NAME)
        yield temporary.add_object(scene, data)


@contextmanager
def editing(obj: bpy.types.Object) -> Iterator[None]:
    """Edit Mode, with everything selected, for the operators of the UV editor."""
    (scene,) = obj.users_scene
    scene.tool_settings.use_uv_select_sync = True  # so that the selection of faces counts
    layer = scene.view_layers[0]
    with bpy.context.temp_override(
        scene=scene, view_layer=layer, active_object=obj, object=obj, selected_objects=[obj]
    ):
        layer.objects.active = obj
        bpy.ops.object.mode_set(mode="EDIT")
        try:
            with bpy.context.temp_override(edit_object=obj, objects_in_mode_unique_data=[obj]):
                bpy.ops.mesh.reveal(select=True)
                bpy.ops.mesh.select_all(action="SELECT")
                yield
        finally:
            bpy.ops.object.mode_set(mode="OBJECT")
