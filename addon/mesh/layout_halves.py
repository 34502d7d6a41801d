# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes with a UV layout that equal their mirror images: as a half that has the UVs of both sides, and whole again.

What becomes of the half becomes of both sides, whatever the layout has of each: it need not be its own mirror image.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from . import mirrors, topology
from .layout_collapse import Charted
from .mirrors import Plane
from .triangles import unit

WITHIN = 1e-6
"""How far mirror images may be off, as a share of the longest side of the box: rounding."""


@dataclass(frozen=True, eq=False)
class Halves:
    """A mesh whose triangles are one another's mirror images.

    Attributes:
        mesh: The mesh.
        plane: Between its halves. No triangle crosses it, or lies in it.
        vertices: (V,) int, the mirror image of each vertex.
        corners: (T, 3) int, that of each corner, as 3 * triangle + corner.
    """

    mesh: Charted
    plane: Plane
    vertices: np.ndarray
    corners: np.ndarray

    @classmethod
    def of(cls, mesh: Charted) -> "Halves | None":
        """Those of a mesh, along the first of its axes on which it has them; None if it has none."""
        used = mesh.points[mesh.triangles.reshape(-1)]
        if not len(used):
            return None
        least, most = used.min(axis=0), used.max(axis=0)
        within = WITHIN * float((most - least).max())
        planes = (Plane(axis, float(least[axis] + most[axis]) / 2.0) for axis in range(3))
        return next(filter(None, (cls._along(mesh, plane, within) for plane in planes)), None)

    @classmethod
    def _along(cls, mesh: Charted, plane: Plane, within: float) -> "Halves | None":
        triangles, count, numbers = mesh.triangles, len(mesh.points), np.arange(len(mesh.points))
        is_used = np.zeros(count, bool)
        is_used[triangles] = True
        both = np.concatenate([mesh.points, plane.mirrored(mesh.points)])
        vertices = np.where(is_used, topology.places(both, within, np.tile(is_used, 2))[count:], numbers)
        if (vertices >= count).any() or (vertices[vertices] != numbers).any():
            return None
        sides = np.where(vertices == numbers, 0.0, np.sign(mesh.points[:, plane.axis] - plane.place))[triangles]
        if ((sides.min(axis=1) < 0.0) == (sides.max(axis=1) > 0.0)).any():
            return None
        images = vertices[triangles]
        every = np.concatenate([triangles, images[:, ::-1]])
        turns = (every.argmin(axis=1)[:, None] + np.arange(3)) % 3
        faces = topology.first_rows(np.take_along_axis(every, turns, axis=1))
        if not np.array_equal(faces[: len(triangles)], np.arange(len(triangles))) or faces.max() >= len(triangles):
            return None
        faces = faces[len(triangles) :]
        corners = 3 * faces[:, None] + (triangles[faces][:, None] == images[..., None]).argmax(axis=2)
        return cls(mesh, plane, vertices, corners)

    @cached_property
    def half(self) -> Charted:
        """The half beyond the plane. Its layers are those of the mesh, here and at the mirror image."""
        mesh, points = self.mesh, self.mesh.points.copy()
        points[self.vertices == np.arange(len(points)), self.plane.axis] = self.plane.place
        is_beyond = points[:, self.plane.axis] > self.plane.place
        faces = np.flatnonzero(is_beyond[mesh.triangles].any(axis=1))
        corners = self.corners[faces]
        own, other = mesh.values[faces], mesh.values.reshape(mesh.triangles.size, -1)[corners]
        layers = 2 * mesh.layers
        values = np.concatenate(
            [own[..., :layers], other[..., :layers], own[..., layers:], other[..., layers:]], axis=2
        )
        pairs = np.stack([mesh.labels[faces], mesh.labels[corners[:, 0] // 3]], axis=1)
        labels = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1)
        return Charted(points, mesh.triangles[faces], values, labels, layers, faces, self.plane)

    def joined(self, half: Charted) -> Charted:
        """A coarser half and its mirror image, to the bit as single precision has them; its triangles come first."""
        points, triangles = mirrors.doubled(half.points, half.triangles, half.on_plane, self.plane)
        layers, rest = half.layers, (half.values.shape[2] - 2 * half.layers) // 2
        own, other, *more = np.split(half.values, np.cumsum([layers, layers, rest]), axis=2)
        values = [np.concatenate(each, axis=2) for each in ((own, more[0]), (other, more[1]))]
        faces = np.concatenate([half.faces, self.corners[half.faces, 0] // 3])
        return replace(
            self.mesh,
            points=points.astype(np.float64),
            triangles=triangles,
            values=np.concatenate([values[0], values[1][:, ::-1]]),
            labels=self.mesh.labels[faces],
            faces=faces,
        )

    def motions(self, motions: np.ndarray | None) -> np.ndarray | None:
        """Motions (2 P, V, 3, 4) of the half: those (P, V, 3, 4) of the mesh, and the mirror images of those of the other half.
        None for none."""
        if motions is None:
            return None
        mirror = np.eye(4)
        mirror[self.plane.axis, self.plane.axis] = -1.0
        mirror[self.plane.axis, 3] = 2.0 * self.plane.place
        whole = np.broadcast_to(np.eye(4), (*motions.shape[:2], 4, 4)).copy()
        whole[..., :3, :] = motions[:, self.vertices]
        return np.concatenate([motions, (mirror @ whole @ mirror)[..., :3, :]])

    def even(self, normals: np.ndarray, *, is_joined: bool) -> np.ndarray:
        """Normals (T, 3, 3) at corners, as the mean with their mirror images. is_joined: of what `joined` returned, else of the
        mesh itself."""
        corners = self.corners
        if is_joined:
            corners = np.arange(3 * len(normals)).reshape(2, -1, 3)[::-1, :, ::-1].reshape(-1, 3)
        images = Plane(self.plane.axis, 0.0).mirrored(normals.reshape(-1, 3)[corners])
        return unit(normals + images)
