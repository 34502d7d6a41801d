# SPDX-License-Identifier: GPL-3.0-or-later
"""A bake of some parts leaves all texels of the others as they are, with their margins, in images and files, or is refused.

Three squares wear two materials, which have an image each. All are baked, everything about them changes, and one is baked
again in some way. Which texels are whose is told by the rectangles of the faces in UV space.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.core import udim
from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import Job, bake_jobs
from addon.jobs.job import by_material
from addon.output import datablocks, image_file, map_names, shared_maps
from addon.passes import samples
from tests.support import maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SIDE = 32
PLACES = {"a": (0.03, 0.06, 0.45, 0.5), "b": (0.5, 0.06, 0.44, 0.4), "c": (0.06, 0.66, 0.8, 0.28)}
"""Left, bottom, width and height of the UVs of each. Their margins meet."""
WORN = {"a": ["Wood"], "b": ["Wood", "Metal"], "c": ["Metal"], "d": ["Wood"]}
"""The materials of each: the first half of the faces has the first, the second half the last."""
SAME = {"method": "CAST", "width": SIDE, "height": SIDE, "margin": 4, "texture_sets": True, "depth": 8}


@dataclass
class World:
    """The scene of a test."""

    folder: Path
    values: dict
    jobs: dict[str, Job] = field(default_factory=dict)
    again: set[str] = field(default_factory=lambda: {"b"})
    """The parts that are baked again."""
    shares: bool = True
    offsets: list[tuple[float, float]] = field(default_factory=list)
    """Of the samples of the first bake, in texels from the center."""

    def add(self, name: str, place: tuple[float, float, float, float], number: int) -> None:
        low = zoo.plane(f"{name}_low", 2)
        scenes.move_uvs(low, place[2:], place[:2])
        for material in WORN[name]:
            low.data.materials.append(bpy.data.materials.get(material) or bpy.data.materials.new(material))
        for face in low.data.polygons:
            face.material_index = 0 if face.index < 2 else len(WORN[name]) - 1
        high = zoo.terrain(f"{name}_high", 12, height=0.1 + 0.05 * number)
        low.location.x = high.location.x = 4.0 * number
        self.jobs[name] = Job(low, [high])

    @property
    def settings(self) -> Settings:
        values = SAME | {"storage": "MEMORY"} | self.values
        if values.get("output"):
            values |= {"output": str(self.folder / values["output"]), "storage": "FILE"}
        return Settings(**values)

    def bend(self) -> None:
        """Change all high objects, so that each map differs everywhere."""
        for job in self.jobs.values():
            mesh = job.highs[0].data
            points = np.empty((len(mesh.vertices), 3), np.float32)
            mesh.vertices.foreach_get("co", points.ravel())
            points[:, 2] *= -2.0
            mesh.vertices.foreach_set("co", points.ravel())
            mesh.update()
        bpy.context.view_layer.update()

    def bake(self, names: set[str] | None = None) -> None:
        only = None if names is None else {self.jobs[name].low.session_uid for name in names}
        bake_jobs.bake_all(bpy.context, list(self.jobs.values()), self.settings, share_image=self.shares, only=only)

    def owners(self, material: str, tile: int) -> np.ndarray:
        """The number of the part in `jobs` that has each texel (SIDE, SIDE) of a tile, or is nearest to it; -1 for none, or
        where two are about as near."""
        width, height = self.settings.sampling.size
        near = []
        points = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        for job in self.jobs.values():
            low = job.low_ref.find()
            is_own = np.zeros((height, width), bool)
            for rectangle in [] if low is None else rectangles(low, material):
                left, bottom, right, top = (rectangle - np.tile(udim.place(tile), 2)) * np.tile((width, height), 2)
                for across, up in self.offsets:
                    x, y = points[..., 0] + 0.5 + across, points[..., 1] + 0.5 + up
                    is_own |= (x > left) & (x < right) & (y > bottom) & (y < top)
            own = points[is_own]
            apart = (
                np.linalg.norm(points[:, :, None] - own, axis=-1).min(axis=-1)
                if len(own)
                else np.full((height, width), 1e9)
            )
            near.append(apart)
        nearest, second = np.sort(near, axis=0)[:2]
        return np.where((nearest < second - 0.5), np.argmin(near, axis=0), -1)

    def stored(self) -> dict[tuple[str, str, int], np.ndarray]:
        """The texels of each material, map and tile."""
        settings, found = self.settings, {}
        for job in by_material(list(self.jobs.values()), settings.storing, shares=True):
            filled = bake_jobs.named(settings, job, bake_jobs.ATLAS)
            for name, of_map in map_names.settings_by_map(filled).items():
                for tile in (1001, 1002) if settings.sampling.udim else (1001,):
                    found[job.material, name, tile] = read(of_map, tile)
        return {key: texels for key, texels in found.items() if texels is not None}


def rectangles(low, material):
    """Left, bottom, right and top of the faces of a low square that have a material, in its UV map."""
    names = [slot.material.name.split(".")[0] for slot in low.material_slots]
    uv = np.empty((len(low.data.loops), 2), np.float32)
    low.data.uv_layers[0].uv.foreach_get("vector", uv.ravel())
    for face in low.data.polygons:
        if names[face.material_index] == material:
            corners = uv[list(face.loop_indices)]
            yield np.array([*corners.min(axis=0), *corners.max(axis=0)])


def read(of_map, tile):
    """The texels of a map, in its file or image; None where there are none."""
    output = map_names.output_for(of_map)
    if output:
        path = Path(udim.fill(output, tile))
        return image_file.read(path) if path.exists() else None
    image = bpy.data.images.get(of_map.storing.image)
    if image is None:
        return None
    if not of_map.sampling.udim:
        return maps.pixels(image)
    found = shared_maps.stored(of_map, tile)
    return None if found is None else found.read()


def everything(world):
    """All texels and bytes that a refused bake must leave as they are."""
    images = {}
    for image in bpy.data.images:
        if image.source == "TILED":
            images[image.name] = list(map(repr, datablocks.tile_contents(image)))
        else:
            images[image.name] = maps.pixels(image).tobytes(), str(image.get(shared_maps.RECORD, ""))
    return images, {path: path.read_bytes() for path in sorted(world.folder.rglob("*")) if path.is_file()}


def build(folder, values):
    world = World(folder, dict(values))
    world.offsets = samples.offsets(world.settings.sampling.samples)
    for number, (name, place) in enumerate(PLACES.items()):
        column = float(world.settings.sampling.udim and name == "c")
        world.add(name, (place[0] + column, *place[1:]), number)
    bpy.context.view_layer.update()
    return world


def nothing(world):
    """Everything stays as it is, but for the high objects."""


def rename_low(world):
    world.jobs["a"].low.name = "limb"
    world.jobs["c"].low.name = "tail"


def rename_and_unwrap(world):
    rename_low(world)
    for name in "ac":
        scenes.move_uvs(world.jobs[name].low, (0.98, 0.98))


def swap_names(world):
    a, b = (world.jobs[name].low for name in "ab")
    a.name, b.name = "swap", "a_low"
    a.name = "b_low"


def take_the_name_of_another(world):
    """What is baked has the name of a part that was renamed."""
    world.jobs["a"].low.name = "limb"
    world.jobs["b"].low.name = "a_low"


def unwrap_another(world):
    """The others have new UVs, by which their texels stay."""
    for name in "ac":
        scenes.move_uvs(world.jobs[name].low, (0.9, 0.9), (0.02, 0.02))


def subdivide_another(world):
    for name in "ac":
        modifier = world.jobs[name].low.modifiers.new("more", "SUBSURF")
        modifier.subdivision_type, modifier.levels = "SIMPLE", 1


def activate_another_map(world):
    for name in "ac":
        layers = world.jobs[name].low.data.uv_layers
        layers.active = layers.new(name="second", do_init=True)


def rename_the_uv_maps(world):
    for name in "ac":
        world.jobs[name].low.data.uv_layers[0].name = "other"


def lose_the_uvs(world):
    layers = world.jobs["a"].low.data.uv_layers
    layers.remove(layers[0])


def lose_the_faces(world):
    world.jobs["c"].low.data.clear_geometry()


def lose_the_high(world):
    """It is no matter for the others: they are not baked."""
    job = world.jobs.pop("a")
    bpy.data.objects.remove(job.highs[0])
    world.kept_low = job.low


def move_to_another_scene(world):
    other = bpy.data.scenes.new("other")
    for name in "ac":
        low = world.jobs[name].low
        bpy.context.scene.collection.objects.unlink(low)
        other.collection.objects.link(low)


def hide(world):
    for name in "ac":
        world.jobs[name].low.hide_set(True)
        world.jobs[name].low.hide_render = True


def hide_in_a_collection(world):
    shelf = bpy.data.collections.new("Shelf")
    bpy.context.scene.collection.children.link(shelf)
    for name in "ac":
        low = world.jobs[name].low
        bpy.context.scene.collection.objects.unlink(low)
        shelf.objects.link(low)
    bpy.context.view_layer.layer_collection.children["Shelf"].exclude = True


def edit_another(world):
    bpy.context.view_layer.objects.active = world.jobs["a"].low
    bpy.ops.object.mode_set(mode="EDIT")


def remove_from_the_set(world):
    """The others are in the scene, but no bake knows of them."""
    world.others = {name: world.jobs.pop(name) for name in "ac"}


def delete_another(world):
    bpy.data.objects.remove(world.jobs.pop("a").low)


def add_a_part(world):
    world.add("d", (0.06, 0.57, 0.4, 0.06), 4)
    world.again = {"d"}


def join_by_material(world):
    """A part gets a second material, and texels where nobody has any."""
    job = world.jobs["c"]
    job.low.data.materials.append(bpy.data.materials["Wood"])
    job.low.data.polygons[0].material_index = 1
    world.again = {"c"}


def copy_the_mesh(world):
    """A copy of a part, also of the images that it was baked for, with other UVs."""
    low = world.jobs["a"].low
    copy = low.copy()
    copy.data = low.data.copy()
    bpy.context.collection.objects.link(copy)
    scenes.move_uvs(copy, (0.5, 0.5))


def keep_a_copy_and_unwrap(world):
    """The copy with the old UVs is no part: what is baked again is."""
    low = world.jobs["b"].low
    copy = low.copy()
    copy.data = low.data.copy()
    bpy.context.collection.objects.link(copy)
    scenes.move_uvs(low, (0.96, 0.96), (0.02, 0.0))


def reorder_slots(world):
    """The same faces have the same materials, by other numbers."""
    for job in world.jobs.values():
        mesh = job.low.data
        numbers = [face.material_index for face in mesh.polygons]
        own = list(mesh.materials)[::-1]
        mesh.materials.clear()
        for material in [bpy.data.materials.new("unused"), *own]:
            mesh.materials.append(material)
        for face, number in zip(mesh.polygons, numbers, strict=True):
            face.material_index = len(own) - number


def wear_no_more(world):
    """What another part no longer wears is no matter, and keeps no texels of it."""
    mesh = world.jobs["a"].low.data
    mesh.materials[0] = bpy.data.materials.new("Cloth")


def wear_no_more_and_unwrap(world):
    wear_no_more(world)
    scenes.move_uvs(world.jobs["a"].low, (0.9, 0.9))


def wear_no_more_in_another_file(world):
    """It may be another object of the same name."""
    in_another_file(world)
    wear_no_more_and_unwrap(world)


def wear_copies(world):
    """Others wear a copy of the material, which shows the same image."""
    for name in "ac":
        mesh = world.jobs[name].low.data
        mesh.materials[0] = mesh.materials[0].copy()


def rename_a_material(world):
    bpy.data.materials["Wood"].name = "Oak"


def paint(world):
    for image in bpy.data.images:
        image.pixels[0] = 0.25


def delete_images(world):
    bpy.data.batch_remove(list(bpy.data.images))


def rename_images(world):
    for image in bpy.data.images:
        image.name = f"my {image.name}"


def reload_images(world):
    for image in bpy.data.images:
        image.reload()


def pack_images(world):
    for image in bpy.data.images:
        image.pack()


def delete_files(world):
    for path in world.folder.glob("*.png"):
        path.unlink()


def put_another_size(world):
    for path in world.folder.glob("*.png"):
        image_file.write(np.zeros((8, 8, 4), np.float32), path, 8)


def reopen(world):
    """Save and open the file again."""
    names = list(world.jobs)
    bpy.ops.wm.save_as_mainfile(filepath=str(world.folder / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(world.folder / "scene.blend"))
    objects = bpy.data.objects
    world.jobs = {name: Job(objects[f"{name}_low"], [objects[f"{name}_high"]]) for name in names}


def in_another_file(world):
    """As a shell does: the files are there, and no image is."""
    reopen(world)
    delete_images(world)
    for job in world.jobs.values():
        job.low.property_unset("imprint")


def in_another_file_with_other_uvs(world):
    in_another_file(world)
    unwrap_another(world)


def unwrap_itself_in_another_file(world):
    """What is baked may have new UVs."""
    in_another_file(world)
    scenes.move_uvs(world.jobs["b"].low, (0.96, 0.96), (0.02, 0.0))


def in_another_file_with_other_bits(world):
    """As beveled objects have them with each evaluation."""
    in_another_file(world)
    for name in "ac":
        layer = world.jobs[name].low.data.uv_layers[0].uv
        uv = np.empty(2 * len(layer), np.float32)
        layer.foreach_get("vector", uv)
        layer.foreach_set("vector", np.nextafter(uv, np.float32(2.0)))


def in_another_file_without_others(world):
    in_another_file(world)
    for name in "ac":
        bpy.data.objects.remove(world.jobs.pop(name).low)


def undo(world):
    bpy.ops.ed.undo_push(message="baked")
    world.jobs["a"].low.location.y = 1.0
    bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    refound(world)


def undo_a_bake(world):
    """What the image holds then is what a bake keeps."""
    bpy.ops.ed.undo_push(message="baked")
    world.bake({"a"})
    bpy.ops.ed.undo_push(message="baked again")
    bpy.ops.ed.undo()
    refound(world)


def refound(world):
    objects = bpy.data.objects
    world.jobs = {name: Job(objects[f"{name}_low"], [objects[f"{name}_high"]]) for name in world.jobs}


def give_a_size(world):
    world.jobs = {name: job.but(sizes=(("Metal", 64),)) for name, job in world.jobs.items()}


@dataclass(frozen=True)
class Case:
    """One way of a partial bake.

    Attributes:
        first: Settings of both bakes, which differ from SAME.
        then: Those of the second one.
        change: What is done between them.
        refused: The sentence if it is refused; empty if it is baked.
    """

    first: dict = field(default_factory=dict)
    then: dict = field(default_factory=dict)
    change: Callable[[World], None] = nothing
    refused: str = ""


FILES, TILES = {"output": "{material}.png"}, {"udim": True, "output": "{material}.<UDIM>.png"}
CASES = {
    "8 bits in memory": Case(),
    "floats in memory": Case({"depth": 32}),
    "packed": Case({"storage": "PACK"}),
    "packed floats": Case({"storage": "PACK", "depth": 16}),
    "PNG": Case(FILES),
    "PNG of 16 bits": Case(FILES | {"depth": 16}),
    "PNG without alpha": Case(FILES | {"alpha": False}),
    "dithered": Case(FILES | {"dither": True}),
    "EXR of 16 bits": Case({"output": "{material}.exr", "depth": 16}),
    "EXR of 32 bits": Case({"output": "{material}.exr", "depth": 32, "maps": ("HEIGHT", "AO")}),
    "TIFF": Case({"output": "{material}.tif", "depth": 16}),
    "Targa": Case({"output": "{material}.tga"}),
    "packed channels": Case(FILES | {"maps": ("AO", "ROUGHNESS"), "pack": "UNREAL"}),
    "packed channels in memory": Case({"maps": ("AO",), "pack": "HDRP"}),
    "gray": Case(FILES | {"maps": ("AO",), "mask": True, "normal": False, "depth": 16}),
    "colors": Case(FILES | {"maps": ("BASE_COLOR",)}),
    "a fixed range": Case(FILES | {"maps": ("HEIGHT",), "value_range": 0.5}),
    "tiles": Case(TILES),
    "packed tiles": Case({"udim": True, "storage": "PACK"}),
    "packed tiles of floats": Case({"udim": True, "storage": "PACK", "depth": 16}),
    "the whole margin": Case({"margin": None}),
    "a margin of the nearest": Case({"margin_type": "EXTEND"}),
    "a wider margin": Case({"margin": 1}, {"margin": 8}),
    "a narrower margin": Case({"margin": 8}, {"margin": 1}),
    "fewer samples": Case({"samples": 16}, {"samples": 1}),
    "more samples": Case({}, {"samples": 16}),
    "a green channel down": Case({}, {"green": "-Y"}),
    "object space": Case({}, {"space": "OBJECT"}),
    "one map more": Case({}, {"maps": ("AO",)}),
    "one map less": Case({"maps": ("AO",)}, {"maps": ()}),
    "other packed channels": Case(FILES | {"maps": ("AO",), "pack": "UNREAL"}, {"pack": "HDRP"}),
    "another tile alone": Case(TILES, change=lambda world: world.again.update("c") or world.again.discard("b")),
    "a renamed low object": Case(change=rename_low),
    "a renamed low object in files": Case(FILES, change=rename_low),
    "renamed with other UVs": Case(change=rename_and_unwrap),
    "swapped names": Case(change=swap_names),
    "the name of another": Case(change=take_the_name_of_another),
    "other UVs of others": Case(change=unwrap_another),
    "a modifier of others": Case(change=subdivide_another),
    "another UV map is active": Case(change=activate_another_map),
    "renamed UV maps": Case(change=rename_the_uv_maps),
    "without UVs": Case(change=lose_the_uvs, refused="'a_low', whose texels cannot be told"),
    "without faces": Case(change=lose_the_faces, refused="'c_low', whose texels cannot be told"),
    "without a high object": Case(change=lose_the_high),
    "in another scene": Case(change=move_to_another_scene),
    "hidden": Case(change=hide),
    "hidden in a collection": Case(change=hide_in_a_collection),
    "in Edit Mode": Case(change=edit_another),
    "removed from the set": Case(change=remove_from_the_set),
    "removed from the set, in files": Case(FILES, change=remove_from_the_set),
    "deleted": Case(change=delete_another),
    "deleted, in files": Case(FILES, change=delete_another),
    "a part more": Case(change=add_a_part),
    "a part more in files": Case(FILES, change=add_a_part),
    "a part gets a material": Case(change=join_by_material),
    "a copy of a part": Case(change=copy_the_mesh),
    "a copy with the old UVs": Case(change=keep_a_copy_and_unwrap),
    "other slots": Case(change=reorder_slots),
    "worn no more": Case(change=wear_no_more),
    "worn no more, in files": Case(FILES, change=wear_no_more_and_unwrap),
    "worn no more, in another file": Case(
        FILES, change=wear_no_more_in_another_file, refused="'a_low', whose UVs are others in this file"
    ),
    "copies of materials": Case(change=wear_copies),
    "a renamed material": Case(change=rename_a_material),
    "painted": Case(change=paint),
    "painted, in files": Case(FILES, change=paint, refused="unsaved changes, also on"),
    "images deleted": Case(change=delete_images),
    "images of files deleted": Case(FILES, change=delete_images),
    "images renamed": Case(FILES, change=rename_images),
    "images reloaded": Case(FILES, change=reload_images),
    "files packed as well": Case(FILES, change=pack_images),
    "files deleted": Case(FILES, change=delete_files, refused="bake all of them together"),
    "files of another size": Case(FILES, change=put_another_size, refused="bake all of them together"),
    "saved and opened": Case(change=reopen),
    "packed, saved and opened": Case({"storage": "PACK"}, change=reopen),
    "files, saved and opened": Case(FILES, change=reopen),
    "tiles, saved and opened": Case({"udim": True, "storage": "PACK"}, change=reopen),
    "in another file": Case(FILES, change=in_another_file),
    "tiles in another file": Case(TILES, change=in_another_file),
    "Targa in another file": Case({"output": "{material}.tga"}, change=in_another_file),
    "other UVs in another file": Case(
        FILES, change=in_another_file_with_other_uvs, refused="'a_low', whose UVs are others in this file"
    ),
    "own UVs in another file": Case(FILES, change=unwrap_itself_in_another_file),
    "other bits of UVs in another file": Case(FILES, change=in_another_file_with_other_bits),
    "others are not in another file": Case(
        FILES, change=in_another_file_without_others, refused="'a_low', which is not in this file"
    ),
    "undone": Case(change=undo),
    "a bake undone": Case(change=undo_a_bake),
    "another size": Case({}, {"width": 64}, refused="as 32 x 32 texels"),
    "a size of one material": Case(change=give_a_size, refused="as 32 x 32 texels"),
    "another depth": Case(FILES, {"depth": 16}, refused="as 32 x 32 texels of 8 bits"),
    "another format": Case(FILES, {"output": "{material}.exr", "depth": 16}, refused="is not in the file"),
    "another folder": Case(FILES, {"output": "new/{material}.png"}, refused="is not in the file"),
    "files instead of memory": Case({}, FILES, refused="is not in the file"),
    "memory instead of files": Case(FILES, {"output": "", "storage": "MEMORY"}),
    "packed instead of memory": Case({}, {"storage": "PACK"}),
    "tiles instead of a picture": Case({}, {"udim": True, "storage": "PACK"}, refused="in another way"),
    "mip files": Case(FILES | {"mip_files": True}, refused="mip levels mix all objects"),
    "a measured range": Case({"maps": ("HEIGHT",)}, refused="scaled by the largest"),
    "numbers": Case({"maps": ("OBJECT_ID",)}, refused="numbered over all objects"),
}


@pytest.mark.parametrize("name", CASES)
def test_other_texels_stay(name, tmp_path):
    case = CASES[name]
    world = build(tmp_path, case.first)
    for number, job in enumerate(world.jobs.values()):
        scenes.material(f"color {number}", job.highs[0], Base_Color=(0.2 + 0.3 * number, 0.7, 0.1))
    world.bake()
    world.bend()
    for job in world.jobs.values():
        scenes.set_inputs(job.highs[0].data.materials[0], Base_Color=(0.9, 0.1, 0.8), Roughness=0.1)
    everyone = dict(world.jobs)
    world.values |= case.then
    case.change(world)
    before, all_before = world.stored(), everything(world)
    if case.refused:
        with pytest.raises(BakeError, match=case.refused):
            world.bake(world.again)
        assert everything(world) == all_before
        return
    world.bake(world.again)
    after = world.stored()
    world.jobs = everyone | world.jobs
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    kept = changed = 0
    for (material, of_map, tile), texels in before.items():
        owner = world.owners(material, tile)
        is_again = np.isin(owner, [number for number, part in enumerate(world.jobs) if part in world.again])
        is_others = (owner >= 0) & ~is_again
        kept += is_others.sum()
        changed += (after[material, of_map, tile] != texels).any(axis=-1)[is_again].sum()
        np.testing.assert_array_equal(
            after[material, of_map, tile][is_others], texels[is_others], f"{material} {of_map}"
        )
    assert not before or kept > 100
    assert not before or changed > 50


@pytest.mark.parametrize("is_renamed", [False, True])
def test_maps_of_earlier_versions_tell_their_parts(is_renamed, tmp_path, monkeypatch):
    """Their records have checksums of all bits."""
    world = build(tmp_path, FILES)
    with monkeypatch.context() as former:
        former.setattr(shared_maps, "checksum", shared_maps.former_checksum)
        world.bake()
    world.bend()
    (rename_low if is_renamed else in_another_file)(world)
    before = world.stored()
    world.bake(world.again)
    for (material, of_map, tile), texels in world.stored().items():
        is_others = np.isin(world.owners(material, tile), [0, 2])
        np.testing.assert_array_equal(texels[is_others], before[material, of_map, tile][is_others])
