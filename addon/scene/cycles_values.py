# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles evaluates sockets of materials at points of high meshes.

It bakes the emission of a mesh that has a small triangle around each point, with what the high mesh has there. Each triangle
shows one pixel of an image. All datablocks are made for the call, and removed at its end.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from ..core import foreach, quiet
from ..core.declarations import bases
from ..core.errors import BakeError
from ..core.preflight import EXACT_POINTS
from ..mesh.inputs import HitsOfFeed
from ..mesh.triangle_mesh import ATTRIBUTE, GENERATED, TANGENTS, UV_LAYER, tangent_axes
from ..mesh.triangles import transformed
from . import mesh_writer
from .materials import emitted
from .materials.emitted import Keep, emitting

SMALL = 0.1
"""The size of a triangle around a point, as a share of the one that it is on, large enough for the normal of its plane."""
LEAST = 0.02
"""The least size on the image of the triangles of a feed with bumps, as a share of the others'. The places of smaller ones are
rounded by more than a hundredth of their size."""
WIDTH = 1024
"""Of the image, in pixels."""
EDGE = 0.675
"""The length of the largest triangles along both axes of the image, in pixels."""
LOOKED_AT = np.array([0.501, 0.502])
"""Where in a pixel Blender's bake looks: a little beside its center, which edges may cross."""
REFUSED = "Cycles did not bake the materials: wait for a render that runs, or set Exact Materials to Off."
NAME = "Imprint exact materials"


def evaluate(uids: Sequence[int], wanted: Sequence[HitsOfFeed]) -> list[np.ndarray]:
    """The values (N, 3) float32 at the hits of each of `wanted`, linear. uids: session_uid of the high objects, by number.

    Raises BakeError if an object or a material was deleted meanwhile.
    """
    values = [np.zeros((len(one.triangles), 3), np.float32) for one in wanted]
    for number in dict.fromkeys(one.number for one in wanted):
        places = [i for i, one in enumerate(wanted) if one.number == number and len(one.triangles)]
        owner = _found(bpy.data.objects, uids[number - 1])
        for piece in _pieces([(i, len(wanted[i].triangles)) for i in places]):
            baked = _bake(owner, [wanted[i].part(part) for i, part in piece])
            for (i, part), of_part in zip(piece, baked, strict=True):
                values[i][part] = of_part
    return values


def _found(blocks: Iterable[bpy.types.ID], uid: int) -> bpy.types.ID:
    for block in blocks:
        if block.session_uid == uid:
            return block
    raise BakeError("An object or a material of the bake was deleted while it ran.")


def _pieces(counts: Sequence[tuple[int, int]]) -> Iterator[list[tuple[int, slice]]]:
    """Parts of several arrays with these numbers and lengths, together at most EXACT_POINTS long."""
    piece, size = [], 0
    for i, count in counts:
        first = 0
        while first < count:
            part = slice(first, min(count, first + EXACT_POINTS - size))
            piece.append((i, part))
            size += part.stop - part.start
            first = part.stop
            if size == EXACT_POINTS:
                yield piece
                piece, size = [], 0
    if piece:
        yield piece


@contextmanager
def _temporary() -> Iterator[Keep]:
    """A function that takes datablocks, which are removed at the end of the block."""
    blocks: list[bpy.types.ID] = []

    def keep(block: bpy.types.ID) -> bpy.types.ID:
        blocks.append(block)
        return block

    try:
        yield keep
    finally:
        bpy.data.batch_remove(blocks)


def _bake(owner: bpy.types.Object, hits: Sequence[HitsOfFeed]) -> list[np.ndarray]:
    """The values (N, 3) at hits on one object."""
    count = sum(len(one.triangles) for one in hits)
    size = WIDTH, -(-count // WIDTH)
    with _temporary() as keep:
        scene = keep(bpy.data.scenes.new(NAME))
        _set_up(scene)
        image = keep(bpy.data.images.new(NAME, *size, alpha=True, float_buffer=True, is_data=True))
        mesh = keep(bpy.data.meshes.new(NAME))
        corners = _Corners.of(hits)
        layer = _build(mesh, corners, size)
        feeds = list(dict.fromkeys(one.feed for one in hits))
        for feed in feeds:
            material = _found(bpy.data.materials, feed.material)
            shown = emitting(material, feed.socket, image, keep)
            shown.cycles.emission_sampling = "NONE"
            mesh.materials.append(shown)
        slots = np.concatenate([np.full(len(one.triangles), feeds.index(one.feed), np.int32) for one in hits])
        mesh.polygons.foreach_set("material_index", slots)
        obj = keep(bpy.data.objects.new(NAME, mesh))
        _take_after(obj, owner, hits[0].mesh.to_world, corners, mesh)
        scene.collection.objects.link(obj)
        _run(scene, obj, layer)
        pixels = foreach.pixels(image)
    values = pixels.reshape(-1, 4)[:count, :3]
    return np.split(values, np.cumsum([len(one.triangles) for one in hits])[:-1])


def _run(scene: bpy.types.Scene, obj: bpy.types.Object, layer: str) -> None:
    """Bake the emission of `obj` into its images. Raises BakeError where Blender refuses."""
    chosen = {"object": obj, "active_object": obj, "selected_objects": [obj], "selected_editable_objects": [obj]}
    try:
        with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0], **chosen), quiet.silence(1):
            done = bpy.ops.object.bake(
                type="EMIT",
                target="IMAGE_TEXTURES",
                save_mode="INTERNAL",
                margin=0,
                use_clear=True,
                use_selected_to_active=False,
                uv_layer=layer,
            )
    except RuntimeError as error:
        raise BakeError(f"{REFUSED} {str(error).strip()}") from error
    if "FINISHED" not in done:
        raise BakeError(REFUSED)


def _set_up(scene: bpy.types.Scene) -> None:
    before = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples = "CPU", 1
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.use_light_tree = False  # of as many lights as there are triangles, which light nothing
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    scene.frame_current, scene.frame_subframe = (
        before.frame_current,
        before.frame_subframe,
    )  # images and drivers follow them


@dataclass(frozen=True)
class _Corners:
    """The corners of small triangles around points, (N, 3, n) float32 each; layers by their keys.

    Attributes:
        normals: (N, 3) float32, those of the points: triangles are so small that they have one each.
        sizes: (N,), on the image, as shares of the largest.
        axes: Of Normal Map nodes, (N, 3) each, by the names of attributes.
    """

    points: np.ndarray
    normals: np.ndarray
    layers: Mapping[tuple[str, str], np.ndarray]
    sizes: np.ndarray
    axes: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, hits: Sequence[HitsOfFeed]) -> "_Corners":
        shares, sizes = zip(*(_sizes(one) for one in hits), strict=True)
        normals = [np.einsum("nc,nca->na", one.weights, one.mesh.normals[_triangles(one)]) for one in hits]
        parts = [_around(*of_feed) for of_feed in zip(hits, shares, normals, strict=True)]
        keys = list(dict.fromkeys(key for one in hits for key in one.feed.layers if key[0] != TANGENTS))
        joined = {key: _joined(hits, key, parts) for key in keys}
        return cls(
            np.concatenate(
                [
                    _mixed(one.mesh.positions, one.mesh.vertices[part[0]], part[1])
                    for one, part in zip(hits, parts, strict=True)
                ]
            ),
            np.concatenate(normals),
            {key: values for key, values in joined.items() if values is not None},
            np.concatenate(sizes),
            _axes(hits),
        )


def _sizes(hits: HitsOfFeed) -> tuple[np.ndarray, np.ndarray]:
    """The sizes (N,) of small triangles, as shares of those that they are on, and on the image, as shares of the largest.

    A Bump node looks a tenth as far as a pixel reaches on the triangle: with both sizes, that is the distance of the texels.
    """
    count = len(hits.triangles)
    if not len(hits.spacing):
        return np.full(count, SMALL, np.float32), np.ones(count)
    corners = transformed(_places(hits), hits.mesh.to_world)
    edges = np.linalg.norm(corners[:, 1:] - corners[:, :1], axis=-1).mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        wanted = EDGE * hits.spacing / edges
    wanted[~((wanted > 0.0) & np.isfinite(wanted))] = SMALL
    return np.minimum(wanted, SMALL).astype(np.float32), np.clip(SMALL / wanted, LEAST, 1.0)


def _triangles(hits: HitsOfFeed) -> np.ndarray:
    """The corners (N, 3) int of the triangles that are hit."""
    return hits.mesh.triangles[hits.triangles]


def _places(hits: HitsOfFeed) -> np.ndarray:
    """Where the corners of the triangles that are hit are (N, 3, 3), in the mesh's space."""
    return hits.mesh.positions[hits.mesh.vertices[_triangles(hits)]]


def _around(hits: HitsOfFeed, shares: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The corners (N, 3) int of the triangles that are hit, and the weights (N, 3, 3) of these for each corner of small ones.

    shares (N,) float32: their sizes. normals (N, 3): small triangles face as they do, since Cycles turns normals over that
    point behind their triangle; a render shows them as they are.
    """
    away = shares[:, None, None] * (np.eye(3, dtype=np.float32) - np.float32(1.0 / 3.0))
    a, b, c = np.moveaxis(_places(hits), 1, 0)
    is_behind = np.einsum("na,na->n", np.cross(b - a, c - a), normals) < 0.0
    away[is_behind] = away[is_behind][:, ::-1]
    return _triangles(hits), hits.weights[:, None, :] + away


def _axes(hits: Sequence[HitsOfFeed]) -> dict[str, np.ndarray]:
    """As _Corners has them. A mesh without the UV map has its normals alone."""
    found: dict[str, np.ndarray] = {}
    for layer in dict.fromkeys(name for one in hits for kind, name in one.feed.layers if kind == TANGENTS):
        parts = []
        for one in hits:
            corners, tangents = _triangles(one), one.mesh.layers.get((TANGENTS, layer))
            of_corners = np.zeros((*corners.shape, 4), np.float32) if tangents is None else tangents[corners]
            basis = bases.of_name(one.feed.basis)
            parts.append(tangent_axes(basis, one.weights, one.mesh.normals[corners], of_corners))
        for name, axis in zip(emitted.AXES, zip(*parts, strict=True), strict=True):
            found[name.format(layer)] = np.concatenate(axis).astype(np.float32)
    return found


def _mixed(values: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Values (C, n) at the corners (N, 3), mixed by weights (N, 3, 3): (N, 3, n)."""
    return weights @ values[corners]


def _joined(
    hits: Sequence[HitsOfFeed], key: tuple[str, str], parts: Sequence[tuple[np.ndarray, np.ndarray]]
) -> np.ndarray | None:
    """A layer of all hits; zeros where a mesh or a feed lacks it, and None if all meshes do."""
    layers = [one.mesh.layers.get(key) for one in hits]
    width = next((values.shape[1] for values in layers if values is not None), 0)
    if not width:
        return np.zeros((sum(len(one.triangles) for one in hits), 3, 2), np.float32) if key[0] == UV_LAYER else None
    return np.concatenate(
        [
            np.zeros((len(part[0]), 3, width), np.float32) if values is None else _mixed(values, *part)
            for values, part in zip(layers, parts, strict=True)
        ]
    )


def _build(mesh: bpy.types.Mesh, corners: _Corners, size: tuple[int, int]) -> str:
    """Fill an empty mesh with triangles of these corners. Returns the name of the UV map by which they are on pixels."""
    count = len(corners.points)
    mesh_writer.fill(mesh, corners.points.reshape(-1, 3), np.arange(3 * count))
    normals = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "POINT")
    normals.data.foreach_set("vector", corners.normals.repeat(3, axis=0).ravel())
    on_pixels = mesh.uv_layers.new(name=NAME, do_init=False)
    on_pixels.uv.foreach_set("vector", _on_pixels(corners.sizes, size).ravel())
    name = on_pixels.name
    # UV maps first: an attribute of the same name is the UV map.
    for (kind, of_layer), values in sorted(corners.layers.items(), key=lambda item: item[0][0] != UV_LAYER):
        if kind == UV_LAYER:
            _add_uv_map(mesh, of_layer, values)
        elif kind == ATTRIBUTE:
            _add_attribute(mesh, of_layer, values)
    for axis, values in corners.axes.items():
        _add_attribute(mesh, axis, np.pad(values.repeat(3, axis=0), ((0, 0), (0, 1))))
    mesh.update()
    return name


def _add_uv_map(mesh: bpy.types.Mesh, name: str, values: np.ndarray) -> None:
    layer = mesh.uv_layers.new(name=name or f"{NAME}: render", do_init=False)
    if layer is None:
        raise BakeError("The materials of an object read more than seven UV maps: set Exact Materials to Off.")
    layer.uv.foreach_set("vector", np.ascontiguousarray(values[..., :2]).ravel())
    if not name:
        layer.active_render = True


def _add_attribute(mesh: bpy.types.Mesh, name: str, values: np.ndarray) -> None:
    if name and name in mesh.attributes:  # a UV map, or the positions
        return
    attribute = mesh.attributes.new(name or f"{NAME}: color", "FLOAT_COLOR", "POINT")
    attribute.data.foreach_set("color", values.ravel())
    if not name:
        mesh.attributes.default_color_name = attribute.name


def _on_pixels(sizes: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """UVs (N, 3, 2) float32 of triangles whose middles are where the pixels of an image look, row by row.

    sizes (N,): of the triangles, as shares of the largest.
    """
    numbers = np.arange(len(sizes))
    places = np.stack([numbers % size[0], numbers // size[0]], axis=1)[:, None] + LOOKED_AT
    around = np.array([(-1.0, -1.0), (2.0, -1.0), (-1.0, 2.0)]) * (EDGE / 3.0)
    return ((places + sizes[:, None, None] * around) / size).astype(np.float32)


def _take_after(
    obj: bpy.types.Object, owner: bpy.types.Object, to_world: np.ndarray, corners: _Corners, mesh: bpy.types.Mesh
) -> None:
    """Give `obj` what nodes read of an object, and generated coordinates to its mesh."""
    obj.matrix_world = Matrix(to_world.tolist())
    obj.color, obj.pass_index = owner.color, owner.pass_index
    for name, value in owner.items():
        if isinstance(value, int | float) or hasattr(value, "to_list"):
            obj[name] = value
    generated = corners.layers.get((GENERATED, ""))
    if generated is None:
        return
    # Generated coordinates are those of the mesh before it is deformed: a shape key moves them to where the points are.
    mesh.use_auto_texspace = False
    mesh.texspace_location = mesh.texspace_size = (0.5, 0.5, 0.5)
    obj.shape_key_add(name="generated", from_mix=False)
    moved = obj.shape_key_add(name="points", from_mix=False)
    moved.points.foreach_set("co", corners.points.ravel())
    moved.value = 1.0
    obj.data.shape_keys.key_blocks[0].points.foreach_set("co", generated.ravel())
    mesh.vertices.foreach_set("co", generated.ravel())
