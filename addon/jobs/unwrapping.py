# SPDX-License-Identifier: GPL-3.0-or-later
"""Gives low meshes a UV map: unwraps a copy in several ways by Blender's own operators, and takes the sharpest.

The mesh itself only gets the UV map. Its modes, its selection and its seams stay as they are.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice

import bpy
import numpy as np

from ..audit import mip_gaps
from ..core.errors import BakeError
from ..core.settings import SamplingSettings, Settings
from ..mesh import uv_islands, uv_stretch
from ..mesh.uv_stretch import Layout
from ..scene import mesh_reader
from . import temporary

NAME = "UVMap"
"""Of the new UV map, as Blender calls it."""
FEW_CUTS, MANY_CUTS = np.radians(80.0), np.radians(66.0)
"""The angle between faces from which Smart Project cuts: of islands that are unwrapped anew, and of those that stay flat."""


@dataclass(frozen=True)
class Unwrapped:
    """A way to unwrap, and what it gave. uv: (C, 2) float32 by corner."""

    name: str
    layout: Layout
    islands: int
    uv: np.ndarray

    @property
    def sentence(self) -> str:
        """The figures, as a clause."""
        found = self.layout
        return (
            f"{self.islands:,} islands by {self.name}, {found.used:.0%} of the map used, stretch {found.angle:.2f} (angles), "
            f"{found.area:.2f} (areas)"
        )


def unwrap(low: bpy.types.Object, settings: Settings, *, is_quick: bool = False) -> str:
    """Give an object's own mesh a UV map. Returns a sentence about it. is_quick: whether only the first way is tried.

    Raises BakeError if no way works, and then nothing has changed.
    """
    if low.type != "MESH" or not low.data.polygons:
        raise BakeError(f"{low.name!r} has no faces: choose a mesh that has some.")
    ways = islice(attempts(low, settings.sampling), 1 if is_quick else None)
    best = max(ways, key=lambda each: each.layout.sharpness, default=None)
    if best is None or best.layout.sharpness == 0.0:
        raise BakeError(f"{low.name!r} has no UV map, and Blender cannot unwrap it: its faces have no area.")
    layer = low.data.uv_layers.new(name=NAME, do_init=False)
    if layer is None:
        raise BakeError(f"{low.name!r} has as many UV maps as a mesh can have: remove one.")
    layer.uv.foreach_set("vector", best.uv.reshape(-1))
    low.data.uv_layers.active = layer
    layer.active_render = True
    low.data.update()
    return f"{low.name!r} is unwrapped: {best.sentence}"


def attempts(low: bpy.types.Object, sampling: SamplingSettings) -> Iterator[Unwrapped]:
    """What each way gives with the margin that the clean mip levels of the settings need."""
    for name in _ways(low.data):
        found = _attempt(low, sampling, name)
        if found is not None:
            yield found


def _attempt(low: bpy.types.Object, sampling: SamplingSettings, name: str) -> Unwrapped | None:
    """Unwrap a copy of the object's mesh. Returns None if Blender cannot."""
    margin = mip_gaps.needed(sampling) / 2.0 / min(sampling.size)
    with _copy(low) as obj:
        try:
            with editing(obj):
                _ways(low.data)[name]()
                pack_boxes(margin)
        except RuntimeError:  # an operator that cannot work says so in this way
            return None
        layer = obj.data.uv_layers.active.name
        mesh = mesh_reader.surface(obj.data, layer, low.name, np.eye(4))
        layout = uv_stretch.measure(mesh.positions[mesh.vertices[mesh.triangles]], mesh.uv[mesh.triangles])
        islands = int(uv_islands.islands(mesh).max(initial=-1)) + 1
        return Unwrapped(name, layout, islands, mesh_reader.uvs(obj.data, layer))


def _ways(data: bpy.types.Mesh) -> dict[str, Callable[[], None]]:
    """How to unwrap, by what the closing note calls it."""
    methods = {item.identifier for item in bpy.ops.uv.unwrap.get_rna_type().properties["method"].enum_items}
    ways = {"Smart Project": lambda: _project(MANY_CUTS)}
    seams = np.zeros(len(data.edges), bool)
    data.edges.foreach_get("use_seam", seams)
    for method, title in (("ANGLE_BASED", "Angle Based"), ("MINIMUM_STRETCH", "Minimum Stretch")):
        if method in methods:  # Minimum Stretch is there from Blender 4.3 on
            ways[title] = lambda method=method: _flatten(method)
            if seams.any():
                ways[f"{title} and the mesh's seams"] = lambda method=method: _by_seams(method)
    return ways


def _project(angle: float) -> None:
    bpy.ops.uv.smart_project(angle_limit=angle, island_margin=0.0, area_weight=0.0, correct_aspect=False)


def _flatten(method: str) -> None:
    """Unwrap the islands of Smart Project anew: they may be more bent then, so that there are fewer."""
    _project(FEW_CUTS)
    bpy.ops.uv.seams_from_islands(mark_seams=True, mark_sharp=False)
    _by_seams(method)


def _by_seams(method: str) -> None:
    bpy.ops.uv.unwrap(method=method, fill_holes=False, correct_aspect=False, margin=0.0)
    bpy.ops.uv.average_islands_scale()


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
