# SPDX-License-Identifier: GPL-3.0-or-later
"""UV islands that lie on each other, which count as one for packing, and faces of the same shape, which may do so."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from . import topology, uv_islands, uv_layout
from .triangle_mesh import Mesh
from .triangles import diagonal, face_areas

NEAR = 1e-4
"""Points that are closer than this share of the mesh's diagonal are in one place."""
MOST_MIRRORED, SAME = 0.5, 0.9
"""The shares of the area that have a mirror, at least, where halves are copies, and where they are cut alike."""
KINDS, ATTEMPTS = 8, 6
"""With how many parts of other shapes a part is compared that could be the same, and in how many ways for two points each."""


class Stacks:
    """The UV islands of a mesh, of which those with a face on the same place are one, also mirrored, or moved by whole tiles.
    Faces of different materials are not: one texture of all shows one of them.

    Attributes:
        corners: (N,) int, of the mesh.
        uv: (N, 2) float64, of each, moved back by `tiles`.
        tiles: (N, 2) float64, by how many whole tiles copies are moved away from what they lie on.
        of: (N,) int from 0, the island of each.
        surface: Of all triangles, in the world.
        drawn: The area of all of them in UV space.
        used: The same without what lies on others.
        factors: (I,) float64, by which each island has as much area as the surface that it shows; 0 without area.
        places: (P,) int, one of `corners` for each place of an island.
        triangles: (T, 3) int, of `places`; those without area are left out.
    """

    def __init__(self, mesh: Mesh, materials: np.ndarray):
        """mesh: with faces and UVs, and triangles. materials: (T,) int from 0, of each triangle."""
        self.corners, inverse = np.unique(mesh.triangles, return_inverse=True)
        triangles, alone = inverse.reshape(mesh.triangles.shape), uv_islands.islands(mesh)
        self.tiles = self._tiles(mesh, triangles, alone, materials)
        self.uv = mesh.uv[self.corners] - self.tiles
        uv = mesh.uv.copy()
        uv[self.corners] = self.uv
        mesh = replace(mesh, uv=uv)
        joined = uv_islands.stacked(mesh, materials)
        self.of = np.zeros(len(self.corners), np.int64)
        self.of[triangles] = joined[:, None]
        world = mesh.positions[mesh.vertices[mesh.triangles]] @ mesh.to_world[:3, :3].T
        surface, drawn = face_areas(world), 0.5 * np.abs(uv_layout.areas(mesh)).astype(np.float64)
        self.surface, self.drawn = float(surface.sum()), float(drawn.sum())
        shown, shown_in = np.bincount(alone, surface), np.bincount(alone, drawn)
        of_alone = np.zeros(len(shown), np.int64)
        of_alone[alone] = joined
        self.factors = np.zeros(int(joined.max()) + 1)
        factors = np.sqrt(np.divide(shown, shown_in, out=np.zeros_like(shown), where=shown_in > 0.0))
        np.maximum.at(self.factors, of_alone, factors)  # of what lies on each other, the largest has what it needs
        largest = np.zeros(len(self.factors))
        np.maximum.at(largest, of_alone, shown_in)
        self.used = float(largest.sum())
        self._merge(uv_islands.places(mesh)[self.corners], triangles)

    def _tiles(self, mesh: Mesh, triangles: np.ndarray, alone: np.ndarray, materials: np.ndarray) -> np.ndarray:
        """`tiles`. triangles: of `corners`. alone: the island of each triangle. materials: as of Stacks."""
        away, tiles = uv_islands.moved_copies(mesh), np.zeros((len(self.corners), 2))
        if away.any() and materials.any():
            of_kind = [materials == kind for kind in np.unique(materials[away])]
            for is_kind in of_kind:
                away[is_kind] &= uv_islands.moved_copies(mesh.with_triangles(is_kind))
            away &= (np.bincount(alone, ~away) == 0)[alone]  # whole islands alone
        middles = mesh.uv[mesh.triangles].mean(axis=1)
        of_island = [np.bincount(alone, middle) / np.bincount(alone) for middle in middles.T]
        tiles[triangles[away]] = np.floor(np.stack(of_island, axis=1))[alone[away]][:, None]
        return tiles

    def _merge(self, places: np.ndarray, triangles: np.ndarray) -> None:
        """Set `places` and `triangles`. places: of the corners. triangles: (T, 3) int, of the corners."""
        keys = np.stack([self.of, places], axis=1)
        _, self.places, numbers = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        merged = numbers.reshape(-1)[triangles]
        self.triangles = merged[(merged != np.roll(merged, 1, axis=1)).all(axis=1)]

    @cached_property
    def points(self) -> np.ndarray:
        """The UVs (P, 2) of `places`."""
        return self.uv[self.places]

    def scaled(self, size: float) -> np.ndarray:
        """The UVs (P, 2) of `places`, by `factors` and by `size`."""
        return self.points * (size * self.factors)[self.of[self.places]][:, None]

    def placed(self, after: np.ndarray) -> np.ndarray:
        """The UVs (N, 2) of `corners`, moved, turned and scaled by islands as `points` went to `after` (P, 2) float64.

        Islands without area go to the middle of the map.
        """
        used = np.unique(self.triangles)
        count, islands = len(self.factors), self.of[self.places[used]]
        number = np.maximum(np.bincount(islands, minlength=count), 1)

        def total(values: Any) -> Any:
            return np.bincount(islands, values.real, count) + 1j * np.bincount(islands, values.imag, count)

        start, end = (points[used] @ (1.0, 1.0j) for points in (self.points, after))
        middle, middle_after = total(start) / number, total(end) / number
        apart = start - middle[islands]
        squares = total(apart * apart.conj()).real
        factor = total(apart.conj() * (end - middle_after[islands])) / np.where(squares > 0.0, squares, 1.0)
        middle_after = np.where(squares > 0.0, middle_after, 0.5 + 0.5j)
        moved = factor[self.of] * (self.uv @ (1.0, 1.0j) - middle[self.of]) + middle_after[self.of]
        return np.stack([moved.real, moved.imag], axis=1) + self.tiles


@dataclass(frozen=True, eq=False)
class Copies:
    """Faces that are copies of others, as mirrored halves, and parts that are there several times.

    Attributes:
        is_copy: (F,) bool, of faces.
        corners: (C,) int, the corner whose UV each corner of the mesh can have: its own, or that of its original.
    """

    is_copy: np.ndarray
    corners: np.ndarray


@dataclass(frozen=True, eq=False)
class Mirror:
    """A mesh that is its own mirror, but for some faces.

    Attributes:
        corners: (C,) int, the corner that is the mirror image of each corner; -1 for none.
        faces: (F,) int, the same of faces; those that lie across the plane are their own.
        sides: (F,) int, 1 for faces above the plane, -1 for those below, 0 for those across it.
    """

    corners: np.ndarray
    faces: np.ndarray
    sides: np.ndarray


def mirror(mesh: Mesh, starts: np.ndarray, materials: np.ndarray) -> Mirror | None:
    """The mirror images of nearly all faces of a mesh; None if it is not its own mirror along x, y or z. As `copies`."""
    if not len(mesh.triangles):
        return None
    faces = _Faces(mesh, starts, materials)
    every, best, most = np.ones(len(faces.sizes), bool), None, SAME * faces.areas.sum()
    for side, image in faces.mirrors():
        if np.mean(image >= 0) <= MOST_MIRRORED:
            continue
        found = faces.matches(every, every, image, is_mirrored=True)
        first = found[faces.starts]
        area = faces.areas[first >= 0].sum()
        if area > most * (1.0 + 1e-6):
            sides = np.where(np.abs(side) > faces.near, np.sign(side), 0.0).astype(np.int64)
            best, most = Mirror(found, np.where(first >= 0, faces.of[first], -1), sides), area
    return best


def copies(mesh: Mesh, starts: np.ndarray, materials: np.ndarray) -> Copies | None:
    """The faces of a mesh that can have the UVs of others, as they have the same shape, turned or mirrored; None for none.

    Loose parts of the same shape are copies of the first of them. Of the rest, if most of it is its own mirror, what is below
    the middle along x, y or z, or below 0, is a copy of what is above.

    Args:
        mesh: with faces.
        starts: (F,) int, the first corner of each face, in order; the others follow.
        materials: (F,) int, of faces; copies have those of their originals.
    """
    if not len(mesh.triangles):
        return None
    faces, corners = _Faces(mesh, starts, materials), np.arange(len(mesh.vertices))
    alone = faces.repeated(corners)
    faces.mirrored(corners, alone)
    if (corners == np.arange(len(corners))).all():
        return None
    return Copies(corners[faces.starts] != faces.starts, corners)


class _Faces:
    """The faces of a mesh. points (P, 3): those that are apart. at (C,) int: the point of each corner."""

    def __init__(self, mesh: Mesh, starts: np.ndarray, materials: np.ndarray):
        """As `copies`."""
        places, at = np.unique(topology.places(mesh.positions)[mesh.vertices], return_inverse=True)
        points = mesh.positions[places].astype(np.float64)
        starts = np.append(starts.astype(np.int64), len(at))
        self.points, self.at, self.starts, self.sizes = points, at, starts[:-1], np.diff(starts)
        self.of = np.repeat(np.arange(len(self.sizes)), self.sizes)
        following = np.arange(1, len(at) + 1)
        following[starts[1:] - 1] = starts[:-1]
        self.ends = at[following]
        self.near, self.marks = NEAR * diagonal(points), topology.hashes(materials[:, None].astype(np.int64))
        self.areas = np.bincount(mesh.faces, face_areas(mesh.positions[mesh.vertices[mesh.triangles]]), len(self.sizes))
        self.middles = topology.sums_of(self.of, points[at], len(self.sizes)) / self.sizes[:, None]

    def matches(self, chosen: np.ndarray, originals: np.ndarray, image: np.ndarray, *, is_mirrored: bool) -> np.ndarray:
        """The corner (C,) int of originals that each corner of chosen faces lies on, if points go to their image; -1 for none.

        Args:
            chosen: (F,) bool.
            originals: (F,) bool.
            image: (P,) int, the point to which each point goes; -1 for none.
        """
        start, end = image[self.at], image[self.ends]
        is_there = (start >= 0) & (end >= 0)
        if is_mirrored:
            start, end = end, start
        found = np.full(len(self.at), -1)
        # Faces have the same sides, whichever is the first.
        keys, keys_there = (
            self._sums(topology.hashes(np.stack(sides, axis=1).astype(np.int64)))
            for sides in ((self.at, self.ends), (start, end))
        )
        chosen = chosen & (np.bincount(self.of, ~is_there, len(self.sizes)) == 0.0)
        faces, wanted = np.flatnonzero(originals), np.flatnonzero(chosen)
        if not len(faces) or not len(wanted):
            return found
        order = faces[np.argsort(keys[faces], kind="stable")]
        where = np.minimum(np.searchsorted(keys[order], keys_there[wanted]), len(order) - 1)
        is_same = keys[order[where]] == keys_there[wanted]
        face = np.full(len(self.sizes), -1)
        face[wanted[is_same]] = order[where[is_same]]
        here = np.flatnonzero(face[self.of] >= 0)
        corner_keys = self.of * len(self.points) + self.at
        sorted_corners = np.argsort(corner_keys, kind="stable")
        looked_for = face[self.of[here]] * len(self.points) + image[self.at[here]]
        position = np.minimum(np.searchsorted(corner_keys[sorted_corners], looked_for), len(self.at) - 1)
        corner = sorted_corners[position]
        found[here] = np.where(corner_keys[corner] == looked_for, corner, -1)
        is_whole = np.bincount(self.of, found < 0, len(self.sizes)) == 0.0
        return np.where(is_whole[self.of], found, -1)

    def _sums(self, values: np.ndarray) -> np.ndarray:
        sums = self.marks.copy()
        np.add.at(sums, self.of, values)
        return sums

    def mirrored(self, corners: np.ndarray, free: np.ndarray) -> None:
        """Give corners of `free` faces (F,) bool those of their mirror, if there is a plane of which most of them have one."""
        best, most = None, MOST_MIRRORED * self.areas[free].sum()
        for side, image in self.mirrors():
            found = self.matches(free, free & (side > self.near), image, is_mirrored=True)
            area = 2.0 * self.areas[np.unique(self.of[found >= 0])].sum()
            if area > most * (1.0 + 1e-6):
                best, most = found, area
        if best is not None:
            corners[best >= 0] = best[best >= 0]

    def mirrors(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """For each plane that is tried, how far above it faces are (F,), and the images (P,) of points, see `matches`."""
        box = np.stack([self.points.min(axis=0), self.points.max(axis=0)])
        for axis in range(3):
            for middle in dict.fromkeys([float(box[:, axis].mean()), 0.0]):
                mirror = self.points.copy()
                mirror[:, axis] = 2.0 * middle - mirror[:, axis]
                yield self.middles[:, axis] - middle, self._image(mirror)

    def _image(self, moved: np.ndarray) -> np.ndarray:
        """The point (P,) int in the place of each moved point (P, 3); -1 for none."""
        image = topology.places(np.concatenate([self.points, moved]), self.near)[len(moved) :]
        return np.where(image < len(moved), image, -1)

    def repeated(self, corners: np.ndarray) -> np.ndarray:
        """Give corners of loose parts those of an earlier part of the same shape. Returns the faces (F,) bool of all others."""
        roots, part = topology.numbered(topology.connected(len(self.points), self.at, self.ends))
        of_faces, is_free = part[self.at[self.starts]], np.ones(len(self.sizes), bool)
        image, (is_copy, is_original) = np.full(len(self.points), -1), np.zeros((2, len(roots)), bool)
        by_part = np.argsort(part, kind="stable")
        points_of = np.split(by_part, np.flatnonzero(np.diff(part[by_part])) + 1)
        for group in self._alike(part, of_faces, len(roots)):
            known: list[int] = []
            for number in group:
                here = points_of[number]
                for other in known[:KINDS]:
                    there = points_of[other]
                    found = _motion(self.points[here], self.points[there], self.near)
                    if found is not None:
                        image[here], is_copy[number], is_original[other] = there[found], True, True
                        break
                else:
                    known.append(number)
        for is_mirrored in (False, True):  # flat parts are turned over by both
            found = self.matches(is_copy[of_faces], is_original[of_faces], image, is_mirrored=is_mirrored)
            is_whole = (np.bincount(part[self.at], found < 0, len(roots)) == 0.0) & is_copy
            is_taken = is_whole[part[self.at]]
            corners[is_taken] = found[is_taken]
            is_free &= ~is_whole[of_faces]
            is_copy &= ~is_whole
        is_used = np.zeros(len(self.sizes), bool)
        is_used[self.of[corners[corners != np.arange(len(corners))]]] = True
        of_used = np.bincount(of_faces, is_used, len(roots)) > 0.0
        return is_free & ~of_used[of_faces]

    def _alike(self, part: np.ndarray, of_faces: np.ndarray, count: int) -> list[list[int]]:
        """Parts with as many faces, corners and points, and as much area, in groups of two or more."""
        numbers = [np.bincount(x, minlength=count) for x in (of_faces, part[self.at], part)]
        areas = np.bincount(of_faces, self.areas, count)
        order = np.lexsort((areas, *numbers))
        differs = np.any([x[order[1:]] != x[order[:-1]] for x in numbers], axis=0)
        differs |= np.diff(areas[order]) > 10.0 * self.near * np.sqrt(areas[order[1:]])
        groups = np.split(order, np.flatnonzero(differs) + 1)
        return [np.sort(group).tolist() for group in groups if len(group) > 1]


def _motion(points: np.ndarray, others: np.ndarray, near: float) -> np.ndarray | None:
    """Which of others (N, 3) each of points (N, 3) lies on if they are turned, or mirrored; None if that is not possible.

    Two points far from the middle, and from the line to it, go to each two that are as far.
    """
    points, others = points - points.mean(axis=0), others - others.mean(axis=0)
    far, far_there = np.linalg.norm(points, axis=1), np.linalg.norm(others, axis=1)
    one = int(far.argmax())
    aside = np.linalg.norm(np.cross(points, points[one]), axis=1)
    two = int(aside.argmax())
    if not aside[two] > near * far[one]:
        return None
    frame = _frame(points[one], points[two])
    apart = np.linalg.norm(points[one] - points[two])
    for is_mirrored in (False, True):
        for first in np.flatnonzero(np.abs(far_there - far[one]) < near)[:ATTEMPTS]:
            distances = np.linalg.norm(others - others[first], axis=1)
            fits = (np.abs(far_there - far[two]) < near) & (np.abs(distances - apart) < near)
            for second in np.flatnonzero(fits)[:ATTEMPTS]:
                turn = _frame(others[first], others[second])
                turn[2] *= -1.0 if is_mirrored else 1.0
                moved = points @ frame.T @ turn
                image = topology.places(np.concatenate([others, moved]), near)[len(others) :]
                if image.max() < len(others) and len(np.unique(image)) == len(others):
                    return image
    return None


def _frame(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Axes (3, 3) in rows: to a point, aside to another, and across both."""
    first = one / np.linalg.norm(one)
    second = two - (two @ first) * first
    second /= np.maximum(np.linalg.norm(second), 1e-300)
    return np.stack([first, second, np.cross(first, second)])
