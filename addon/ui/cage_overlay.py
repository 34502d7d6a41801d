# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows in the 3D viewport where rays start and end: two shells around the low mesh that follow the two distances."""

from dataclasses import dataclass
from enum import Enum

import bpy
import gpu
import numpy as np

from ..core.declarations.choices import Directions
from ..core.errors import BakeError
from ..core.settings import Settings
from ..engine import ray_casting, ray_distances, tree_cache
from ..engine.ray_casting import RayLengths
from ..jobs import bake
from ..mesh import subdividing
from ..mesh.inputs import Meshes
from ..mesh.local_space import LocalSpace, local_space_of
from ..mesh.triangles import unit
from ..passes import mesh_upload, rays
from ..passes.viewport import draw_cage_shell
from ..scene import reading
from ..scene.mesh_elements import without_missing
from ..scene.object_checks import ObjectRef
from ..scene.updates import Shapes
from . import results
from .callbacks import DrawCallbacks, Timer, events, redraw
from .live import live

OUTER, INNER = (0.1, 0.45, 1.0, 0.25), (1.0, 0.45, 0.1, 0.25)
"""Colors of where rays start and where they end."""


MODES = {"OBJECT", "WEIGHT_PAINT"}
"""The modes of the low object in which the shells are drawn: in others, its mesh may change with each stroke."""
PARTS_OF_BLEND = 4
"""How many parts of a divided triangle lie across the width in which directions blend."""
PARTS = 8
"""Into how many parts the edges of triangles are divided where directions bend without a blend."""
MOST_PARTS = 32
"""The most parts along an edge of a triangle."""
MOST_PIECES = 2**18
"""The most triangles of a shell, beyond those of the low mesh."""
BULGE = 0.98
"""A triangle is divided if the mean of its corners' directions is shorter."""
SAME = 1e-6
"""Normals whose difference is less, squared, are the same."""


class CageState(Enum):
    """The state of the overlay."""

    OFF = "off"
    READING = "reading"
    """It waits for the timer to read the low mesh."""
    SHOWN = "shown"
    """It draws the low mesh as it is, or cannot read it."""


@dataclass(frozen=True)
class Subject:
    """What the shells are of.

    Attributes:
        settings: Only those of rays that give the shells their shape.
        blend_width: In scene units.
        is_own_base: Whether the low object is its own high object.
    """

    low: ObjectRef
    cage: ObjectRef | None
    settings: Settings
    blend_width: float
    is_own_base: bool

    @classmethod
    def of_panel(cls, context: bpy.types.Context, low: bpy.types.Object, blend_width: float) -> "Subject":
        """The subject for the settings of the panel."""
        panel = context.scene.imprint
        chosen = panel.chosen(context, low)
        cage = chosen.cage
        is_blended = ray_distances.may_blend(panel.directions, has_cage=cage is not None)
        return cls(
            ObjectRef.of(low),
            ObjectRef.of(cage) if cage else None,
            Settings(directions=panel.directions, offset_group=panel.offset_group, straight_group=panel.straight_group),
            blend_width if is_blended else 0.0,
            chosen.highs == [low],
        )

    @property
    def uids(self) -> list[int]:
        """The session_uid of the objects that are read."""
        return [ref.uid for ref in (self.low, self.cage) if ref is not None]

    def is_same(self, other: "Subject") -> bool:
        """Whether it is the same as `other`, whatever the objects are called."""
        mine, others = ((one.uids, one.settings, one.blend_width, one.is_own_base) for one in (self, other))
        return mine == others

    def upload(self, context: bpy.types.Context) -> gpu.types.GPUBatch | None:
        """The mesh of the shells; None if it cannot be read."""
        low, cage = self.low.find(), self.cage and self.cage.find()
        if low is None:
            return None
        try:
            return upload_shells(
                low,
                cage,
                context.evaluated_depsgraph_get(),
                self.settings,
                blend_width=self.blend_width,
                is_own_base=self.is_own_base,
            )
        except BakeError:
            return None


class CageOverlay:
    """Draws the shells of the panel's low object."""

    def __init__(self):
        self._draw_callbacks = DrawCallbacks((bpy.types.SpaceView3D, self._draw, "POST_VIEW"))
        events.hear(
            depsgraph_update_post=self._on_update,
            frame_change_post=self._on_update,
            undo_post=self._on_undo,
            redo_post=self._on_undo,
            end=self.hide,
        )
        self._shapes = Shapes()
        self.timer = Timer(self.catch_up)
        self._wanted: Subject | None = None
        """The shells that a view needed when it was last drawn."""
        self._read: Subject | None = None
        self._mesh: gpu.types.GPUBatch | None = None
        """The low mesh of `_read`; None where it cannot be read."""
        self._is_outdated = False
        """Whether that mesh has changed since."""
        self._measured: dict[int, RayLengths] = {}
        """By the session_uid of low objects that were not baked before."""

    @property
    def state(self) -> CageState:
        if not self._draw_callbacks.are_added:
            return CageState.OFF
        return CageState.READING if self.timer.is_running else CageState.SHOWN

    @property
    def is_on(self) -> bool:
        """Whether the shells are drawn."""
        return self.state is not CageState.OFF

    def show(self) -> None:
        """Draw the shells from now on."""
        self._draw_callbacks.add()

    def hide(self) -> None:
        """Stop drawing. No timer or mesh remains."""
        self._draw_callbacks.remove()
        self.timer.stop()
        self._wanted = self._read = self._mesh = None
        self._measured.clear()

    def measure(self, context: bpy.types.Context) -> None:
        """Measure what the settings do not set, if neither Live nor a bake has measured it. Raises BakeError."""
        panel = context.scene.imprint
        chosen = panel.chosen(context)
        low, highs = chosen.low, chosen.highs
        is_set = not chosen.rays.measure and panel.directions != Directions.BLENDED
        if low is None or not highs or is_set or _known_lengths(context, low) is not None:
            return
        measured = bake.measure_rays(context, low, highs, chosen.settings, chosen.cage)
        if measured is not None:
            self._measured[low.session_uid] = measured

    def mesh_of(self, subject: Subject) -> gpu.types.GPUBatch | None:
        """The mesh of the shells as last read, or None. If it is missing or outdated, the timer reads it."""
        self._wanted = subject
        if self._read is None or not self._read.is_same(subject) or self._is_outdated:
            self.timer.start()
        # The last shells of the same objects stay until the new ones are there.
        return self._mesh if self._read is not None and self._read.uids == subject.uids else None

    def catch_up(self) -> None:
        """Read the meshes. Do not call this while a view is being drawn: reading evaluates the scene."""
        if self._wanted is None:
            return
        self._read, self._mesh, self._is_outdated = self._wanted, self._wanted.upload(bpy.context), False
        redraw()

    def lengths(self, context: bpy.types.Context, low: bpy.types.Object) -> RayLengths:
        """The lengths of rays from `low`: as the panel sets them, else as Live, a bake or `measure` found them, else 0."""
        rays = context.scene.imprint.chosen(context, low).rays
        known = _known_lengths(context, low) or self._measured.get(low.session_uid, RayLengths())
        return known if rays.measure else RayLengths(rays.extrusion, rays.max_distance, known.blend_width)

    def _on_update(self, _scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """Only changes of the low object and the cage count: the user may move or sculpt another object for minutes."""
        if self._read is None:
            return
        moved = {update.id.original.session_uid for update in depsgraph.updates if update.is_updated_transform}
        self._is_outdated |= not (self._shapes.changed(depsgraph) | moved).isdisjoint(self._read.uids)

    def _on_undo(self, *_) -> None:
        self._is_outdated = True

    def _draw(self) -> None:
        context = bpy.context
        low = context.scene.imprint.chosen(context).low
        if low is None or low.type != "MESH" or low.mode not in MODES or not low.data.polygons:
            return
        lengths = self.lengths(context, low)
        subject = Subject.of_panel(context, low, lengths.blend_width)
        mesh = self.mesh_of(subject)
        if mesh is None:
            return
        gpu.state.blend_set("ALPHA")
        gpu.state.depth_test_set("LESS_EQUAL")
        view = context.region_data.perspective_matrix
        if subject.cage is not None:
            shells = {OUTER: (1.0, 0.0), INNER: (1.0, -lengths.max_distance)}
        else:  # painting moves where rays start, not where they end
            shells = {OUTER: (lengths.extrusion, 0.0), INNER: (0.0, lengths.extrusion - lengths.max_distance)}
        for color, (scale, offset) in shells.items():
            draw_cage_shell(mesh, view, color, scale=scale, offset=offset)
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")


def _known_lengths(context: bpy.types.Context, low: bpy.types.Object) -> RayLengths | None:
    """What Live or the last bake of `low` used; None without them."""
    session, report = live.session, results.of(context, low)
    is_followed = session is not None and session.job.low_ref.uid == low.session_uid
    if is_followed and session.rays is not None:
        return session.rays
    if report is None or not report.distances:
        return None
    return RayLengths(
        **report.distances, blend_width=report.blend_width, low_offset=report.low_offset, is_measured=report.measured
    )


overlay = CageOverlay()


def upload_shells(
    low: bpy.types.Object,
    cage: bpy.types.Object | None,
    depsgraph: bpy.types.Depsgraph,
    settings: Settings,
    *,
    blend_width: float,
    is_own_base: bool,
) -> gpu.types.GPUBatch:
    """The low mesh in world space with its rays, as draw_cage_shell takes it. Raises BakeError for a mesh that rays cannot use.

    A ray starts at the distance `start` times the extrusion or, with a cage, at the distance `start`. settings: of the rays; a
    vertex group that does not exist counts as unpainted. blend_width: in scene units; 0 if directions do not blend.
    is_own_base: whether rays start on the low mesh without its modifiers.
    """
    settings = without_missing(low, settings)
    meshes = reading.read_low(depsgraph, low, cage, settings, is_own_base=is_own_base, with_uv=False)
    local_space = local_space_of([meshes.low])
    edges = tree_cache.upload_hard_edges(meshes.low, local_space)[0] if blend_width > 0.0 else rays.no_edges()
    directions = ray_distances.of_width(settings.tracing.directions, edges, blend_width / local_space.size)
    pieces = subdividing.divide(parts(meshes, local_space, directions.blend_width))
    cast = ray_casting.rays_at_points(meshes, pieces, local_space, directions, extrusion=1.0)
    starts = cast.starts if meshes.cage is None else cast.starts * np.float32(local_space.size)
    return mesh_upload.upload(
        pieces.triangles,
        position=(cast.places * local_space.size + local_space.origin).astype(np.float32),
        direction=cast.directions,
        start=starts[:, None],
    )


def parts(meshes: Meshes, local_space: LocalSpace, blend_width: float) -> np.ndarray:
    """Into how many parts (T,) int the edges of each low triangle are divided: more where directions bend within it."""
    low, corners = meshes.low, meshes.low.triangles
    smooth, straight = unit(meshes.smooth_normals), unit(low.normals)
    is_turned = (((smooth - straight) ** 2).sum(axis=1) > SAME)[corners].any(axis=1)
    # Directions have length one between corners as well, so the shell bulges where they differ much.
    is_bent = is_turned & (blend_width > 0.0)
    for normals in (smooth, straight):
        is_bent |= np.linalg.norm(normals[corners].mean(axis=1), axis=1) < BULGE
    if meshes.cage is not None:
        is_bent[:] = False
    places = local_space.points(low)[low.vertices[corners]]
    longest = np.linalg.norm(places - np.roll(places, 1, axis=1), axis=2).max(axis=1)
    parts = np.full(len(longest), PARTS)
    if blend_width > 0.0:
        parts = np.clip(np.ceil(longest * (PARTS_OF_BLEND / blend_width)), 1, MOST_PARTS).astype(np.int64)
    parts = np.where(is_bent, parts, 1)
    pieces = int((parts[is_bent] ** 2).sum())
    return np.maximum(1, parts * MOST_PIECES**0.5 / pieces**0.5).astype(np.int64) if pieces > MOST_PIECES else parts


class IMPRINT_OT_show_cage(bpy.types.Operator):
    """Show or hide two shells around the low mesh: where rays start (blue) and where they end (orange)"""

    bl_idname = "imprint.show_cage"
    bl_label = "Show Cage"

    def execute(self, context: bpy.types.Context) -> set[str]:
        if overlay.is_on:
            overlay.hide()
        else:
            overlay.show()
            try:
                overlay.measure(context)
            except BakeError as error:  # the shells are drawn as far as they are known
                self.report({"WARNING"}, str(error))
        redraw()
        return {"FINISHED"}


CLASSES = (IMPRINT_OT_show_cage,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
