# SPDX-License-Identifier: GPL-3.0-or-later
"""The maps of the last bake of a low object, as the file has them, on the low mesh as it is now. Nothing is baked."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import bpy
import gpu
import numpy as np

from ..core import foreach, udim
from ..core.declarations.choices import Method, Modifiers
from ..core.errors import BakeError
from ..core.map_types import BY_NAME, NORMAL, Kind, MapType, Range
from ..core.material_feeds import ImagePixels
from ..core.report import Report
from ..core.settings import Settings
from ..jobs.job import Job
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..passes import data_texture, lit, viewport
from ..passes.mesh_upload import UploadCache
from ..scene import evaluation, object_checks, reading
from ..scene.textures import SINGLE, ImageTextures
from . import object_pairs, view_shading
from .view_scene import ViewScene

Part = tuple[tuple[int, ...], int]
"""A part of a low mesh that shows one image: its material slots, none for all, and its UDIM tile, or SINGLE."""
WHOLE: Part = (), SINGLE
"""The whole low mesh."""
FIRST_SIDE = 1024
"""Texels of the longer side of the texture that is shown first of a larger image. For its own, Blender makes all mip levels, in
a second or two for 4096 x 4096 texels on a software driver."""


@dataclass(frozen=True)
class StoredMap:
    """A map in an image of the file.

    Attributes:
        name: That of a MapType, or of a packed image.
        report: Of its texture set.
        tile: Of UDIM, or SINGLE.
    """

    name: str
    image: bpy.types.Image
    report: Report
    tile: int = SINGLE

    @property
    def map_type(self) -> MapType | None:
        """None for a packed image."""
        return BY_NAME.get(self.name)

    @property
    def part(self) -> Part:
        """The part of the low mesh that shows the image."""
        return tuple(self.report.slots), self.tile


def maps_of(low: bpy.types.Object | None) -> dict[str, list[StoredMap]]:
    """The maps of the last bake of a low object whose images exist, by name: an image for each texture set and tile."""
    pair, by_name = object_pairs.of(low), {}
    for report in pair.reports() if pair is not None else ():
        images = {NORMAL.name: report.image} if report.settings.get("normal", True) else {}
        images |= {name.upper(): how["image"] for name, how in report.maps.items()}
        for name, image_name in images.items():
            image = bpy.data.images.get((image_name, None)) or bpy.data.images.get(image_name)
            if image is not None:
                tiles = [tile.number for tile in image.tiles] if image.source == "TILED" else [SINGLE]
                maps = (StoredMap(name, image, report, tile) for tile in tiles if tile in (SINGLE, *report.tiles))
                by_name.setdefault(name, []).extend(maps)
    return by_name


class StoredBake:
    """A low object that was baked, and its high ones: a view_scene.Subject.

    job: its objects. baked: the time of the bake. settings: of the bake. meshes: the low one as last read, and the high ones
    after `read_highs`.
    """

    def __init__(self, context: bpy.types.Context, low: bpy.types.Object):
        """Raises BakeError if the low mesh cannot be read."""
        pair = object_pairs.of(low)
        report = pair.reports()[0]
        self.baked = pair.baked
        self.settings = Settings.of_json(report.settings).read_by(context.scene.render.engine)
        self.job = Job(low, pair.found())
        self.meshes: Meshes = self._read_low(context, report.uv_layer)
        self._uploads, self._parts, self._tiles, self._bounds = UploadCache(), {}, {}, {}
        self._first: dict[int, tuple[gpu.types.GPUTexture, tuple[float, float]]] = {}
        self._whole: set[int] = set()

    @property
    def low(self) -> Mesh:
        """The low mesh, with tangents where the normal map has them."""
        return self.meshes.basis or self.meshes.low

    def upload(self, key: str, mesh: Mesh, **attributes: np.ndarray) -> gpu.types.GPUBatch:
        """As UploadCache.upload, in a cache of its own."""
        return self._uploads.upload(key, mesh.triangles, **attributes)

    def read_highs(self, context: bpy.types.Context) -> None:
        """Read the high objects that still exist, if they are not read yet. Raises BakeError if they cannot be read."""
        highs = self.job.highs
        if self.meshes.highs or not highs:
            return
        # Only their shape matters: rays would need no UVs either.
        plain = self.settings.of_shapes()
        is_as_seen = all(evaluation.is_followed(context, obj) for obj in (self.job.low, *highs))
        read = reading.read_again if is_as_seen and not self._is_rendered(*highs) else reading.read
        self.meshes = replace(self.meshes, highs=read(context, self.job.low, highs, None, plain).highs)

    def _is_rendered(self, *objects: bpy.types.Object) -> bool:
        """Whether to read objects as renders see them: the bake did, and they may differ from what the viewport shows. Objects
        in other modes are shown as they are edited."""
        if self.settings.map.modifiers != Modifiers.RENDER or any(obj.mode != "OBJECT" for obj in objects):
            return False
        return any(object_checks.may_differ_in_renders(obj, bpy.context.scene) for obj in objects)

    def _read_low(self, context: bpy.types.Context, uv_layer: str) -> Meshes:
        low, is_own_base = self.job.low, self.job.low in self.job.highs
        settings = self.settings.mapped(uv_layer=uv_layer, texture_sets=True).traced(method=Method.FLATTEN)
        read = partial(reading.read_low, low=low, cage=None, settings=settings, is_own_base=is_own_base)
        if not is_own_base and self._is_rendered(low):
            meshes = evaluation.evaluate(context, [low], read, modifiers=Modifiers.RENDER)
        else:
            meshes = read(context.evaluated_depsgraph_get())
        if not len(meshes.low.triangles):
            raise BakeError(f"{low.name!r} has no faces.")
        return meshes

    def part(self, part: Part) -> Mesh | None:
        """The triangles of the low mesh in some material slots and a tile, with UVs from 0 to 1; None if there are none.

        Parts that were moved by whole tiles read the same texels, unless there are several tiles.
        """
        if part not in self._parts:
            slots, tile = part
            low = self.low
            places = np.floor(low.uv[low.triangles].mean(axis=1))
            kept = np.ones(len(places), bool)
            if slots:
                kept = np.isin(low.labels[:, 0], slots)
            if tile != SINGLE:
                kept &= (places == udim.place(tile)).all(axis=1)
            uv = low.uv.copy()
            uv[low.triangles[kept]] -= places[kept][:, None].astype(np.float32)
            is_whole = bool(kept.all()) and not places.any()
            mesh = low if is_whole else replace(low.with_triangles(kept), uv=uv)
            self._parts[part] = mesh if kept.any() else None
        return self._parts[part]

    def texture(self, stored: StoredMap) -> tuple[gpu.types.GPUTexture, bool]:
        """The image on the GPU, and whether its texels have linear colors, rather than values as they are stored.

        A large image has fewer texels there until `load_whole`.
        """
        image, is_data = stored.image, stored.image.colorspace_settings.is_data
        if stored.tile == SINGLE and self.is_whole(stored):  # Blender keeps it, and notices changes
            return viewport.texture_of(image), not is_data
        if stored.tile == SINGLE:
            return self._first_of(image)[0], image.is_float and not is_data
        key = image.session_uid, stored.tile
        if key not in self._tiles:  # Blender gives the first tile alone
            pixels = _pixels(stored)
            self._tiles[key] = data_texture.image(pixels.values, "RGBA16F"), not (is_data or pixels.is_srgb)
        return self._tiles[key]

    def _first_of(self, image: bpy.types.Image) -> tuple[gpu.types.GPUTexture, tuple[float, float]]:
        """Some of the texels of a large image on the GPU, and their lowest and highest value."""
        if image.session_uid not in self._first:
            texels = _fewer_texels(image)
            self._first[image.session_uid] = data_texture.image(texels, "RGBA16F"), _extent(texels)
        return self._first[image.session_uid]

    def is_whole(self, stored: StoredMap) -> bool:
        """Whether `texture` has all texels of the image."""
        is_small = stored.tile != SINGLE or max(stored.image.size) <= FIRST_SIDE
        return is_small or stored.image.session_uid in self._whole

    def load_whole(self, stored: StoredMap) -> None:
        """Let `texture` have all texels of the image. This may take seconds. Do not call it while a view is being drawn."""
        viewport.texture_of(stored.image)
        self._whole.add(stored.image.session_uid)
        self._first.pop(stored.image.session_uid, None)

    def bounds(self, maps: Sequence[StoredMap]) -> tuple[float, float]:
        """The values of the images of a map that are black and white. Images of floats have lengths in scene units."""
        kind = maps[0].map_type
        if kind is None or kind.range is Range.UNIT or kind.is_color or not maps[0].image.is_float:
            return 0.0, 1.0
        how = maps[0].report.maps[maps[0].name.lower()]
        if (how["midlevel"], how["scale"]) != (0.0, 1.0):
            return 0.0, 1.0  # they are shares of the range
        key = kind.name, all(map(self.is_whole, maps))
        if key not in self._bounds:
            extents = (
                _extent(_pixels(stored).values) if self.is_whole(stored) else self._first_of(stored.image)[1]
                for stored in maps
            )
            lows, highs = zip(*extents, strict=True)
            low, high = min(lows), max(highs)
            if kind.range is Range.SIGNED:  # 0 is gray
                low, high = -max(-low, high), max(-low, high)
            self._bounds[key] = (low, high) if high > low else (low, low + 1.0)
        return self._bounds[key]


def _fewer_texels(image: bpy.types.Image) -> np.ndarray:
    """Every so many texels of an image, (height, width, 4) float32, at most FIRST_SIDE to a side."""
    width, height = image.size
    rows, columns = (
        ((np.arange(count) + 0.5) * side / count).astype(int)
        for side in (height, width)
        for count in (max(1, side * FIRST_SIDE // max(width, height)),)
    )
    return foreach.pixels(image)[rows[:, None], columns]


def _pixels(stored: StoredMap) -> ImagePixels:
    return ImageTextures().load(f"{stored.image.session_uid}", stored.tile)


def _extent(texels: np.ndarray) -> tuple[float, float]:
    """The lowest and the highest value of the texels (height, width, 4) that have one."""
    is_known = texels[..., 3] > 0.0
    known = (texels if is_known.all() else texels[is_known])[..., :3]
    return (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)


MASK_COLOR = (0.9, 0.12, 0.0, 1.0)
"""Of the texels of a mask, linear."""


@dataclass(frozen=True)
class Mask:
    """Which texels a check has found: a texture for each tile, and texture set by its slots, 1 where it did.

    Attributes:
        kind: One of the masks of jobs.masks.
    """

    kind: str
    textures: dict[Part, gpu.types.GPUTexture]


class StoredShading(view_shading.Drawing):
    """Draws a low object with the maps that the file has, and its high objects.

    name: of the map. mask: what lies over it, or None. target_engine: as in view_shading.Shading.
    """

    def __init__(self, context: bpy.types.Context, low: bpy.types.Object):
        """Raises BakeError if the low mesh cannot be read."""
        super().__init__(StoredBake(context, low))
        self.bake: StoredBake = self.subject
        self.name, self.target_engine, self.mask = NORMAL.name, "", None
        self._scene: ViewScene | None = None
        self._batches: dict[tuple, gpu.types.GPUBatch | None] = {}

    def shown(self) -> list[StoredMap]:
        """The images of the chosen map, or else of the first one that there is."""
        low = self.bake.job.low_ref.find()
        maps = maps_of(low)
        return maps.get(self.name) or next(iter(maps.values()), [])

    @property
    def is_whole(self) -> bool:
        return all(self.bake.is_whole(stored) for stored in self.shown())

    def load_whole(self) -> None:
        coarse = next((stored for stored in self.shown() if not self.bake.is_whole(stored)), None)
        if coarse is not None:
            self.bake.load_whole(coarse)

    def draw_map(self, scene: ViewScene, matrix: np.ndarray, light: np.ndarray) -> None:
        normals, shown = scene.low[1], self.shown()
        for stored in shown:
            batch = self._batch(scene, stored.part)
            if batch is None:
                continue
            texture, is_linear = self.bake.texture(stored)
            if stored.map_type is NORMAL:
                lit.draw(
                    batch, texture, matrix, view_shading.reading(self.bake.settings, self.target_engine, normals, light)
                )
            else:
                kind = stored.map_type.kind if stored.map_type else Kind.VALUE
                viewport.draw_texture(
                    batch,
                    texture,
                    matrix,
                    is_stored_color=not is_linear,
                    takes_nearest=kind is Kind.LABEL,
                    bounds=self.bake.bounds(shown),
                )

    def draw_over(self, scene: ViewScene, matrix: np.ndarray) -> None:
        for part, texture in self.mask.textures.items() if self.mask is not None else ():
            batch = self._batch(scene, part)
            if batch is not None:
                viewport.draw_mask(batch, texture, matrix, MASK_COLOR)

    def _batch(self, scene: ViewScene, part: Part) -> gpu.types.GPUBatch | None:
        """The triangles of a part, in the place of the scene; None if there are none."""
        if self._scene is not scene:
            self._scene, self._batches = scene, {}
        if part not in self._batches:
            mesh = self.bake.part(part)
            is_whole = mesh is self.bake.low
            self._batches[part] = scene.low[0] if is_whole else mesh and scene.part(mesh)
        return self._batches[part]
