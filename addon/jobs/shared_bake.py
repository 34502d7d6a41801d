# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes several low objects into the same images: lays their maps together, beside what others have there, and shows them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import bpy
import numpy as np

from ..audit import severity
from ..core import progress
from ..core.errors import PACKS, BakeError, shorten_list
from ..core.map_types import BY_NAME, MARGIN, MISSED, NORMAL, Labeled, Map
from ..core.progress import Pace, Progress, Task, Timings, part, relay
from ..core.report import Report
from ..core.sentences import WRONG, Sentence
from ..core.settings import Run
from ..engine import gpu_memory, margins, mip_levels
from ..engine.baking import texels_of
from ..engine.bands import DrawnMaps
from ..mesh.triangle_mesh import Mesh
from ..output import materials
from ..output.materials import into_materials
from ..output.outputs import Outputs, Stored
from ..scene.high_materials import NO_MATERIAL
from ..scene.mesh_reader import is_rendered
from ..scene.object_checks import ObjectRef
from . import one_material, shared_image
from .bake import bake_job, draw_raw
from .baked import Baked
from .job import Request
from .one_material import Shown
from .shared_image import Kept

MOST_TAKEN = 0.1
"""The share of the texels of what is baked that others in the same image may have."""


@dataclass(frozen=True)
class Texture:
    """What is baked into the same images.

    Attributes:
        kept: What others keep in them.
        name: Of what all share, which a new material for faces without one has; empty for one bake into its own images.
        lows: All low objects that share the images, also those that are not baked.
    """

    requests: Sequence[Request]
    kept: Kept
    name: str = ""
    lows: frozenset[ObjectRef] = frozenset()


def into_one(
    context: bpy.types.Context, texture: Texture, pace: Pace, failed: dict[str, str] | None = None
) -> Task[list[Report]]:
    """Do all bakes of a texture. Raises BakeError, and then nothing has changed.

    failed: takes the low objects that cannot be baked, which then keep what they have in the images, and why. None if it is
    baked with all of them, or not at all.
    """
    if not texture.name and not texture.kept:
        return [(yield from bake_job(context, texture.requests[0], pace))]
    requests, atlas = texture.requests, Atlas(texture)
    for number, request in enumerate(requests):
        run = Run(request.settings, pace)
        steps = run.timings.counted(relay(draw_raw(context, request, run), partial(_check_lows, requests)))
        try:
            drawn = yield from part(steps, number / len(requests), (number + 1) / len(requests))
        except BakeError as error:
            if failed is None or len(requests) == 1:
                raise
            failed[request.job.low_ref.name] = str(error)
        else:
            atlas.add(*drawn)
    if not atlas.drawn:
        raise BakeError(next(iter(failed.values())))
    if failed:
        jobs = [drawn.request.job for drawn in atlas.drawn]
        atlas.kept = shared_image.kept(context, jobs, requests[0].settings, is_shared=True)
    yield Progress("Storing", 1.0)
    return atlas.store()


def _check_lows(requests: Sequence[Request], step: Progress) -> Progress:
    """`step` of a bake into the image of all. Raises BakeError if one of their low objects was deleted."""
    for request in requests:
        request.job.check_low(step)
    return step


class Atlas:
    """Collects the maps of bakes, as Renderer.raw returns them, and stores them as one. kept: what others have in it."""

    def __init__(self, texture: Texture):
        self.texture, self.kept = texture, texture.kept
        # All samples and the tangent spaces of the objects are already in the maps.
        self.settings = texture.requests[0].settings.sampled(samples=1)
        self.drawn: list[Baked] = []
        self.tiles: dict[int, dict[str, np.ndarray]] = {}
        self._owners: dict[int, np.ndarray] = {}
        """Of each texel (height, width) int16 of a tile, the number of the bake that drew it, from 1; 0 for none."""
        self.labels: dict[Labeled, list[str]] = {labeled: [] for labeled in Labeled}
        self._warnings: list[list[str]] = []

    def add(self, drawn: Baked, maps: dict[int, dict[str, np.ndarray]]) -> None:
        """Add the maps of one bake, by tile and name. Hits replace misses; among hits, the later bake wins."""
        self._renumber(maps, drawn.labels)
        self.drawn.append(drawn)
        self._warnings.append([])
        for tile, above in maps.items():
            if tile in self.tiles:
                self._lay_over(tile, above)
            else:
                self.tiles[tile] = above
                self._owners[tile] = (above[NORMAL.name][..., 3] != 0.0).astype(np.int16) * len(self.drawn)

    def store(self) -> list[Report]:
        """Add the margin and store the maps. Returns a report of each bake. Raises BakeError."""
        last = self.drawn[-1].timings
        baked = [
            shared_image.part_of(each.meshes, each.request.job.material, each.request.settings.sampling.samples)
            for each in self.drawn
        ]
        with last.in_total(), Outputs(self.settings, baked, self.kept.parts, self.kept.tiles) as outputs:
            # Before anything changes: it raises if one was deleted.
            lows = [drawn.request.job.low for drawn in self.drawn]
            for low, drawn in zip(lows, self.drawn, strict=True):
                meshes = drawn.meshes
                slots = drawn.request.job.slots
                outputs.sample_onto(low, meshes.uv_layer, is_own_base=meshes.is_own_base, slots=slots)
            margin = self._fill(outputs, last)
            with last.timed("image"):
                stored = outputs.commit(self.labels, lows)
                self._warnings[0] += stored.warnings
                self._show(lows, stored)
        return [
            Report.of(drawn.stored_as(stored, warnings, margin))
            for drawn, warnings in zip(self.drawn, self._warnings, strict=True)
        ]

    def _show(self, lows: Sequence[bpy.types.Object], stored: Stored) -> None:
        """Show the stored maps in the materials of the low objects. Adds to the warnings."""
        shown = [
            Shown(low, drawn.meshes.uv_layer, stored.image, stored.maps, drawn.meshes.is_own_base)
            for low, drawn in zip(lows, self.drawn, strict=True)
        ]
        if self.settings.storing.one_material:
            self._warnings[0] += one_material.put(
                shown, self.settings, self.texture.name if len(lows) > 1 else lows[0].name
            )
            return
        layers = self._layers(lows)
        for each, drawn, warnings in zip(shown, self.drawn, self._warnings, strict=True):
            own, job = drawn.request.settings, drawn.request.job
            if own.changes_materials and job.material == NO_MATERIAL and self.texture.name:
                how = {"single_user": own.storing.single_user, "is_own_base": each.is_own_base}
                materials.fill_slots(each.low, self.texture.name, [*layers], **how)
            layer, note = self._layer_of(each, layers) if own.changes_materials else (each.uv_layer, "")
            warnings.extend([note] if note else [])
            warnings.extend(into_materials(each.low, stored, layer, own, slots=job.slots, is_own_base=each.is_own_base))

    def _layers(self, lows: Sequence[bpy.types.Object]) -> dict[bpy.types.Object, str]:
        """The UV map of each object that shares the images; empty where it is not known."""
        found = {low: "" for ref in self.texture.lows if (low := ref.find()) is not None}
        noted = {part.name: part.uv_layer for parts in self.kept.parts.values() for part in parts}
        found |= {low: layer for name, layer in noted.items() if (low := bpy.data.objects.get(name)) is not None}
        return found | {low: drawn.meshes.uv_layer for low, drawn in zip(lows, self.drawn, strict=True)}

    def _layer_of(self, shown: Shown, layers: dict[bpy.types.Object, str]) -> tuple[str, str]:
        """The UV map that the materials of a low object name; "" for that which each object renders, where others that show
        one of them have theirs under another name. And a warning if that is not the right one."""
        own = {slot.material for slot in shown.low.material_slots if slot.material}
        others = {
            low: layer
            for low, layer in layers.items()
            if layer and any(slot.material in own for slot in low.material_slots)
        }
        if len(set(others.values())) < 2:
            return shown.uv_layer, ""
        wrong = [low for low, layer in others.items() if not is_rendered(low, layer)]
        if not wrong:
            return "", ""
        names = shorten_list(repr(low.name) for low in others)
        return "", (
            f"{names} show the same material, and have the map in UV maps of several names, of which a material can name one: "
            f"give them one name, or make that of {shorten_list(repr(low.name) for low in wrong)} active for rendering."
        )

    def _fill(self, outputs: Outputs, timings: Timings) -> float:
        """Add all maps with their margin to `outputs`. Returns the share of the texels that is margin."""
        lows = [*self._lows, *self.kept.meshes]
        post_processes = margins.for_maps(lows, self.settings, has_owner=bool(self.kept))
        margin = texels = 0
        with gpu_memory.trimmed():
            for tile, maps in self.tiles.items():
                run, is_kept = Run(self.settings, timings=timings), None
                if self.kept:
                    is_of_others = self._of_others(tile, maps)
                    self._owners[tile][is_of_others] = 0
                    maps = margins.with_owner(maps, is_of_others)  # noqa: PLW2901 - the same, with more
                finished = progress.finish(texels_of(DrawnMaps(maps), tile, run, post_processes))
                if self.kept:
                    is_kept = margins.without_others(finished, post_processes)
                self._fill_misses(tile, maps, finished, run, post_processes)
                state = finished[NORMAL.name][1]
                margin += int(np.count_nonzero(state == MARGIN))
                texels += state.size
                outputs.add(tile, finished, progress.finish(mip_levels.of(finished, tile, run)), is_kept)
        return margin / texels

    def _fill_misses(
        self,
        tile: int,
        maps: dict[str, np.ndarray],
        finished: dict[str, Map],
        run: Run,
        processes: dict[str, margins.PostProcess],
    ) -> None:
        """Let the colors of each bake go on where its own rays miss: those of others may be nearer, or not known.

        Args:
            maps: Of the tile, without a margin.
            finished: The maps as they are stored, which change in place.
        """
        names = [name for name in finished if BY_NAME[name].fills_misses]
        missed = self._owners[tile] * (finished[NORMAL.name][1] == MISSED)
        numbers = np.unique(missed[missed > 0]) if len(self.drawn) > 1 or self.kept else ()
        for number in numbers:
            is_own, is_missed = self._owners[tile] == number, missed == number
            for name in names:
                own = {name: np.where(is_own[..., None], maps[name], np.float32(0.0))}
                filled = texels_of(DrawnMaps(own), tile, run, {name: processes[name]})
                for whole, part_of in zip(finished[name], progress.finish(filled)[name], strict=True):
                    whole[is_missed] = part_of[is_missed]

    @property
    def _lows(self) -> list[Mesh]:
        return [drawn.meshes.low for drawn in self.drawn]

    def _of_others(self, tile: int, maps: dict[str, np.ndarray]) -> np.ndarray:
        """The texels (height, width) bool of a tile that low objects have which are not baked."""
        is_covered = self.kept.covered(tile, self.drawn[0].request.settings.sampling)
        is_hit = maps[NORMAL.name][..., 3] > 0.0
        lost = np.count_nonzero(is_hit & is_covered)
        if lost > MOST_TAKEN * np.count_nonzero(is_hit):
            names = [shorten_list(repr(low.name) for low in lows) for lows in (self._lows, self.kept.meshes)]
            raise BakeError(
                f"{names[0]} and {names[1]}, which the image has already, have the same texels: choose another name for "
                "the image, or give them UV maps side by side and bake all of them together."
            )
        share = lost / max(1, np.count_nonzero(is_hit))
        if share > severity.MUCH_OVERLAP:
            text = (
                f"{lost:,} texels overlap texels of other objects in the same image, which stay as they are: {PACKS}, or bake "
                "a map for each with {low} in the name."
            )
            self._warnings[0].append(Sentence(text, WRONG, severity.SHARED, float(share)))
        return is_covered

    def _lay_over(self, tile: int, above: dict[str, np.ndarray]) -> None:
        """Combine one tile of the last bake with those of the bakes before it."""
        below = self.tiles[tile]
        alpha, alpha_below = above[NORMAL.name][..., 3], below[NORMAL.name][..., 3]
        is_hit, was_hit = alpha > 0.0, alpha_below > 0.0
        lost = np.count_nonzero(is_hit & was_hit)
        share = lost / max(1, np.count_nonzero(is_hit))
        if share > severity.MUCH_OVERLAP:
            low, *before = [drawn.request.job.low for drawn in self.drawn[::-1]]
            same = [repr(other.name) for other in before if other.data == low.data]
            whose = f"{shorten_list(same)}, which have the same mesh" if same else "other objects in the same image"
            apart = "make it a single user and pack the UV maps" if same else PACKS
            text = (
                f"{lost:,} texels of {low.name!r} overlap texels of {whose}: {apart}, or bake a map for each with "
                "{low} in the name."
            )
            self._warnings[-1].append(Sentence(text, WRONG, severity.SHARED, float(share)))
        wins = is_hit | ((alpha < 0.0) & (alpha_below <= 0.0))
        for name, values in above.items():
            np.copyto(below[name], values, where=wins[..., None])
        self._owners[tile][wins] = len(self.drawn)

    def _renumber(self, maps: dict[int, dict[str, np.ndarray]], labels: dict[Labeled, Sequence[str]]) -> None:
        """Give each name in the atlas its own number. Each bake numbers its objects and materials from 1."""
        numbers = {}
        for labeled, names in labels.items():
            known = self.labels[labeled]
            known += [name for name in dict.fromkeys(names) if name not in known]
            numbers[labeled] = np.array([0, *(known.index(name) + 1 for name in names)], np.float32)
        for tile_maps in maps.values():
            for name, values in tile_maps.items():
                labeled = BY_NAME[name].labeled
                if labeled:
                    values[..., :3] = numbers[labeled][values[..., :3].astype(np.int32)]
