# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine's door: meshes as arrays in, maps as arrays out, without files and without Blender's data."""

from ..core.errors import BakeError
from ..core.map_types import Map
from ..core.progress import Task, part
from ..core.settings import Run
from ..mesh.inputs import Meshes
from . import margins, shared_uvs
from .maps.maps_of_bake import maps_of_bake
from .method_choice import choose_method, nothing_drawn, tiles_to_bake
from .rendering import Renderer
from .sources import normal_source

READY = 0.2
"""The share of a bake that is done when drawing begins."""


def bake(meshes: Meshes, run: Run) -> Task[dict[int, dict[str, Map]]]:
    """Bake the normal map and the maps in the settings. `core.progress.finish` runs it to its end.

    Args:
        meshes: for a map in tangent space, with `basis`.
        run: its settings need no names, files or formats.

    Returns:
        The maps by UDIM tile (1001 without UDIM) and name: texels (H, W, 4) float32 with row 0 at v = 0, and their states
        (H, W) uint8, see core.map_types.
    """
    tiles = tiles_to_bake(meshes, run.settings.sampling)
    in_order = shared_uvs.ordered(meshes, tiles, run.settings.sampling)
    plan = choose_method(in_order, tiles, run.settings.tracing)
    source = yield from part(normal_source(plan, run), 0.0, READY)
    renderer = Renderer(maps_of_bake(in_order, source, run), run)
    processes = margins.for_maps([plan.meshes.low], run.settings)
    maps, share = {}, (1.0 - READY) / len(plan.tiles)
    for number, tile in enumerate(plan.tiles):
        start = READY + number * share
        maps[tile] = yield from part(renderer.texels(tile, processes), start, start + share)
    if not any(state.any() for of_tile in maps.values() for _, state in of_tile.values()):
        raise BakeError(nothing_drawn(plan))
    return maps
