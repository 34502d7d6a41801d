# SPDX-License-Identifier: GPL-3.0-or-later
"""The bakers that the benchmark times: Imprint, Cycles and Blender's multires bake; and how they take turns."""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import bpy
import numpy as np

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.engine import tree_cache
from addon.jobs import bake_pair
from scripts.bench.comparing import CYCLES, MULTIRES
from scripts.bench.scenes import Pair
from tests.support import angles


@dataclass
class Contender:
    """A baker of one pair at one size. `bake` returns the seconds of one bake, `normals` its map."""

    name: str
    bake: Callable[[], float]
    normals: Callable[[], np.ndarray]


@dataclass
class Timed:
    """The seconds of one baker: for the first bake, and for one bake per round. gap: why there are no more."""

    first: float = 0.0
    seconds: list[float] = field(default_factory=list)
    gap: str = ""

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)


def clocked(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def race(contenders: Sequence[Contender], rounds: int, *, warm_up: bool = True) -> dict[str, Timed]:
    """Bake in rounds. Each contender bakes once per round, so that a disturbance affects all.

    warm_up: bake once more before the rounds; that bake does not count.
    """
    result = {contender.name: Timed() for contender in contenders}
    for turn in range(-warm_up, rounds):
        for contender in contenders:
            timed = result[contender.name]
            if timed.gap:
                continue
            try:
                seconds = contender.bake()
            except (BakeError, RuntimeError) as error:  # Blender's operators raise RuntimeError
                timed.gap = str(error).strip().splitlines()[0]
                timed.seconds.clear()
                continue
            if turn >= 0:
                timed.seconds.append(seconds)
            timed.first = timed.first or seconds
    return result


class Imprint(Contender):
    """Imprint, from the objects to an image in the low object's material. keep: whether bakes reuse the ray tree."""

    def __init__(self, name: str, pair: Pair, size: int, *, keep: bool = False, **settings):
        self.pair, self.size, self.keep = pair, size, keep
        if settings["method"] == "CAST":
            settings |= {"extrusion": pair.extrusion, "max_distance": 2.0 * pair.extrusion}
        settings = {"image": name, **settings}
        self.image = settings["image"]
        self.settings = Settings(width=size, height=size, depth=32, storage="MEMORY", **settings)
        super().__init__(name, self._bake, self._normals)

    def _bake(self) -> float:
        if not self.keep:
            tree_cache.trees.free()
        return clocked(lambda: bake_pair(bpy.context, self.pair.low, [self.pair.high], self.settings))

    def _normals(self) -> np.ndarray:
        return normals_of(bpy.data.images[self.image], self.size)


def cycles(pair: Pair, size: int, *, samples: int = 1, space: str = "TANGENT") -> Contender:
    """Blender's selected-to-active bake, with the same rays as Cast."""
    image = target_image(pair.low, "cycles", size)

    def bake() -> float:
        scene = bpy.context.scene
        scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", samples
        scene.cycles.use_denoising = False
        scene.render.bake.use_multires = False
        activate(pair.low, "cycles")
        for obj in bpy.data.objects:
            obj.select_set(obj in (pair.low, pair.high))
        bpy.context.view_layer.objects.active = pair.low
        return clocked(
            lambda: bpy.ops.object.bake(
                type="NORMAL",
                normal_space=space,
                margin=16,
                use_selected_to_active=True,
                cage_extrusion=pair.extrusion,
                max_ray_distance=2.0 * pair.extrusion,
            )
        )

    return Contender(CYCLES, bake, lambda: normals_of(image, size))


def multires(sculpt: bpy.types.Object, size: int) -> Contender:
    """Blender's multires bake in tangent space, which equals world space for a plane along x and y."""
    image = target_image(sculpt, "multires", size)

    def bake() -> float:
        scene = bpy.context.scene
        scene.render.engine = "CYCLES"
        settings = scene.render.bake
        settings.use_multires, settings.type, settings.margin = True, "NORMALS", 16
        for obj in bpy.data.objects:
            obj.select_set(obj is sculpt)
        bpy.context.view_layer.objects.active = sculpt
        return clocked(bpy.ops.object.bake_image)

    return Contender(MULTIRES, bake, lambda: normals_of(image, size))


def target_image(obj: bpy.types.Object, name: str, size: int) -> bpy.types.Image:
    """Add an image node to each of the object's materials, which Blender's bakers need."""
    if old := bpy.data.images.get(name):
        bpy.data.images.remove(old)
    image = bpy.data.images.new(name, size, size, float_buffer=True, is_data=True)
    if not any(slot.material for slot in obj.material_slots):
        obj.data.materials.append(bpy.data.materials.new("target"))
    for slot in obj.material_slots:
        if slot.material:
            nodes = slot.material.node_tree.nodes
            node = nodes.get(name) or nodes.new("ShaderNodeTexImage")
            node.name, node.image = name, image
    activate(obj, name)
    return image


def activate(obj: bpy.types.Object, name: str) -> None:
    """Make the image node of this name active. Blender bakes to the active image node."""
    for slot in obj.material_slots:
        if slot.material:
            nodes = slot.material.node_tree.nodes
            nodes.active = nodes[name]
            nodes[name].select = True


def normals_of(image: bpy.types.Image, size: int) -> np.ndarray:
    """The world-space normals (size, size, 3) in an image that stores n * 0.5 + 0.5."""
    texels = np.empty(size * size * 4, np.float32)
    image.pixels.foreach_get(texels)
    return angles.decode(texels.reshape(size, size, 4))
