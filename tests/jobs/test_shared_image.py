# SPDX-License-Identifier: GPL-3.0-or-later
"""A bake of some of the low objects in a map keeps all texels of the others to the bit, with their margins, or is refused.

The truth is the map of a bake of all of them at once, after the same change.
"""

import os
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.blocks.formats import BC4
from addon.core.errors import BakeError
from addon.core.progress import Pace, finish
from addon.core.settings import Settings
from addon.core.stored_normals import StoredNormals
from addon.jobs import Job, bake_jobs, convert, sequence, shared_image
from addon.jobs.live_session import Session
from addon.output import datablocks, image_file, map_names, shared_maps
from tests.support import maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

PLACES = {"a": (0.02, 0.05, 0.45, 0.55), "b": (0.5, 0.05, 0.45, 0.4), "c": (0.05, 0.66, 0.8, 0.3)}
"""Left, bottom, width and height of the UVs of each. Their margins meet."""
SAME = {"method": "CAST", "width": 32, "height": 32, "margin": 8, "material": False}


def pairs(names="abc", places=PLACES, **shift):
    """A low square and a wavy high one for each name, apart from each other. Returns their jobs by name."""
    jobs = {}
    for number, name in enumerate(names):
        left, bottom, width, height = places[name]
        low = zoo.plane(f"{name}_low", 2)
        scenes.move_uvs(low, (width, height), (left, bottom))
        high = zoo.terrain(f"{name}_high", 12, height=0.1 + 0.05 * number)
        low.location.x = high.location.x = 4.0 * number
        jobs[name] = Job(low, [high])
    bpy.context.view_layer.update()
    return jobs


def bend(job, factor=-2.0):
    """Change the high object of a job, so that its map differs everywhere."""
    mesh = job.highs[0].data
    points = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", points.ravel())
    points[:, 2] *= factor
    mesh.vertices.foreach_set("co", points.ravel())
    mesh.update()


def bake(jobs, settings, *, share_image=True):
    return bake_jobs.bake_all(bpy.context, list(jobs), settings, share_image=share_image)


def stored(settings, of_map, image):
    """The stored texels of a map, of all tiles, one above the other."""
    if settings.storing.storage == "FILE":
        files = sorted(Path(settings.storing.output).parent.glob(f"*{Path(settings.storing.output).suffix}"))
        return np.concatenate([image_file.read(path) for path in files])
    if settings.sampling.udim:
        return np.concatenate([shared_maps.stored(of_map, tile).read() for tile in (1001, 1002)])
    return maps.pixels(image)


def texels_of(name):
    """Where the UVs of a low object of `pairs` are in a map, (32, 32) bool."""
    uv = maps.texel_uv(32, 32)
    left, bottom, width, height = PLACES[name]
    return ((uv > (left, bottom)) & (uv < (left + width, bottom + height))).all(axis=-1)


def all_maps(settings):
    """The texels of all images of a bake with one image, by name."""
    filled = bake_jobs.for_low(settings, "atlas")
    found = map_names.settings_by_map(filled)
    return {name: stored(of_map, of_map, bpy.data.images[of_map.storing.image]) for name, of_map in found.items()}


def settings_in(folder, **values):
    """Settings of one image for all. output: the name of a file in that folder."""
    if "output" in values:
        values |= {"output": str(Path(folder, values["output"])), "storage": "FILE"}
    return Settings(**SAME | {"storage": "MEMORY", "depth": 8} | values)


WAYS = {
    "8 bits in memory": {},
    "floats in memory": {"depth": 32},
    "packed": {"storage": "PACK", "depth": 8},
    "packed floats": {"storage": "PACK", "depth": 16},
    "dithered": {"output": "m.png", "dither": True},
    "PNG of 16 bits": {"output": "m.png", "depth": 16},
    "PNG without alpha": {"output": "m.png", "alpha": False},
    "EXR of 16 bits": {"output": "m.exr", "depth": 16},
    "EXR of 32 bits": {"output": "m.exr", "depth": 32, "maps": ("HEIGHT", "AO")},
    "TIFF": {"output": "m.tif", "depth": 16},
    "Targa": {"output": "m.tga"},
    "all gray": {"output": "m.png", "depth": 16, "maps": ("AO",), "mask": True, "normal": False},
    "packed channels": {"output": "m.png", "maps": ("AO",), "pack": "GLTF"},
    "packed channels in memory": {"maps": ("AO",), "pack": "HDRP"},
    "colors": {"output": "m.png", "maps": ("BASE_COLOR",)},
    "a fixed range": {"output": "m.png", "maps": ("HEIGHT",), "value_range": 0.5},
    "the whole margin": {"margin": None},
    "a margin of the nearest": {"margin_type": "EXTEND", "output": "m.png"},
    "samples": {"samples": 4, "output": "m.png"},
    "object space": {"space": "OBJECT", "output": "m.png"},
    "not square": {"width": 48, "output": "m.png"},
    "a green channel down": {"green": "-Y", "output": "m.png"},
    "tiles": {"udim": True, "output": "m.<UDIM>.png"},
    "packed tiles": {"udim": True, "storage": "PACK", "depth": 8},
    "packed tiles of floats": {"udim": True, "storage": "PACK", "depth": 16},
}


@pytest.mark.parametrize("values", [{}, {"output": "m.png"}, {"udim": True, "output": "m.<UDIM>.png"}])
def test_a_bake_whose_texels_all_belong_to_others_is_refused(values, tmp_path):
    settings = settings_in(tmp_path, **values)
    bake(pairs("ab").values(), settings)
    before = all_maps(settings)
    with pytest.raises(BakeError, match="'d_low' and 'a_low', 'b_low', .* have the same texels"):
        bake(pairs("d", {"d": PLACES["b"]}).values(), settings)
    assert all(np.array_equal(texels, before[name]) for name, texels in all_maps(settings).items())


@pytest.mark.parametrize("way", WAYS)
def test_what_is_not_baked_stays_to_the_bit(way, tmp_path):
    """Bake all, change one, bake that one: as all of them baked at once, of which only those texels differ."""
    settings = settings_in(tmp_path, **WAYS[way])
    places = PLACES | ({"c": (1.05, 0.1, 0.8, 0.3), "b": (0.9, 0.5, 0.5, 0.4)} if settings.sampling.udim else {})
    jobs = pairs(places=places)
    if way == "colors":
        for number, job in enumerate(jobs.values()):
            scenes.material(f"color {number}", job.highs[0], Base_Color=(0.2 + 0.3 * number, 0.7, 0.1))
    bake(jobs.values(), settings)
    before = all_maps(settings)
    bend(jobs["b"])
    if way == "colors":
        scenes.set_inputs(jobs["b"].highs[0].data.materials[0], Base_Color=(0.9, 0.0, 0.3))
    reports = bake([jobs["b"]], settings)
    partial = all_maps(settings)
    bake(jobs.values(), settings)
    whole = all_maps(settings)
    assert [report.low for report in reports] == ["b_low"]
    for name in whole:
        assert np.array_equal(partial[name], whole[name]), name
    name = next(iter(whole))
    changed = (partial[name] != before[name]).any(axis=-1).mean() * (2 if settings.sampling.udim else 1)
    assert way == "all gray" or 0.1 < changed < 0.6


def test_a_narrower_margin_leaves_what_it_does_not_reach(tmp_path):
    """The wider margin of others, and of what is baked again, is no background."""
    settings = settings_in(tmp_path, output="m.png")
    jobs = pairs()
    bake(jobs.values(), settings)
    before = all_maps(settings)["NORMAL"]
    narrow = settings_in(tmp_path, output="m.png", margin=1)
    bake([jobs["b"]], narrow)
    assert np.array_equal(all_maps(narrow)["NORMAL"], before)


def test_a_part_that_was_never_there_joins(tmp_path):
    """One after the other, in any order, gives what all at once give."""
    settings = settings_in(tmp_path, output="m.png")
    jobs = pairs()
    for name in "cab":
        bake([jobs[name]], settings)
    apart = all_maps(settings)
    os.remove(settings.storing.output)
    bake(jobs.values(), settings)
    assert all(np.array_equal(apart[name], whole) for name, whole in all_maps(settings).items())


def lose_the_high_by_a_typo(jobs):
    jobs["a"].highs[0].name = "a_hihg"


def hide_in_a_collection(jobs):
    shelf = bpy.data.collections.new("Shelf")
    bpy.context.scene.collection.children.link(shelf)
    for obj in (jobs["a"].low, jobs["a"].highs[0]):
        bpy.context.scene.collection.objects.unlink(obj)
        shelf.objects.link(obj)
    bpy.context.view_layer.layer_collection.children["Shelf"].exclude = True


def rename(jobs):
    jobs["a"].low.name = "limb"


def move_to_another_scene(jobs):
    other = bpy.data.scenes.new("other")
    bpy.context.scene.collection.objects.unlink(jobs["a"].low)
    other.collection.objects.link(jobs["a"].low)


def switch_off(jobs):
    jobs["a"].low.imprint_is_baked = False


LOSSES = [lose_the_high_by_a_typo, hide_in_a_collection, rename, move_to_another_scene, switch_off]


@pytest.mark.parametrize("lose", LOSSES, ids=lambda lose: lose.__name__)
def test_pairs_by_name_keep_what_is_left_out(lose):
    """By the button, for which a pair is missing in some way."""
    panel = bpy.context.scene.imprint
    panel.share_image, panel.method = True, "CAST"
    panel.width = panel.height = 32
    jobs = pairs("ab")
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    name = jobs["b"].low.material_slots and bpy.data.images["atlas_normal"].name
    before = maps.pixels(bpy.data.images[name or "atlas_normal"])
    lose(jobs)
    bpy.context.view_layer.update()
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    assert np.array_equal(maps.pixels(bpy.data.images["atlas_normal"]), before)


def test_other_maps_the_second_time():
    """The map that is new has one object; the one that was there keeps both; and then the new one gets the other, too."""
    jobs = pairs("ab")
    bake(jobs.values(), settings_in(""))
    both = settings_in("", maps=("AO",))
    before = all_maps(settings_in(""))["NORMAL"]
    bake([jobs["a"]], both)
    assert np.array_equal(all_maps(both)["NORMAL"], before)
    bake([jobs["b"]], both)
    one_by_one = all_maps(both)
    bake(jobs.values(), both)
    assert all(np.array_equal(one_by_one[name], whole) for name, whole in all_maps(both).items())


@pytest.mark.parametrize("where", ["image", "file"])
def test_a_bake_of_one_pair_into_the_map_of_several(where, tmp_path):
    """Without One Image, with the name of that image or file: also where no image tells who is in the file."""
    settings = settings_in(tmp_path, **({"output": "m.png"} if where == "file" else {"image": "atlas_normal"}))
    jobs = pairs("ab")
    bake(jobs.values(), settings)
    before = all_maps(settings)["NORMAL"]
    if where == "file":
        bpy.data.images.remove(bpy.data.images["atlas_normal"])
    bake([jobs["b"]], settings, share_image=False)
    after = image_file.read(settings.storing.output) if where == "file" else all_maps(settings)["NORMAL"]
    assert np.array_equal(after, before)


def refused(jobs, settings, match, *, share_image=True):
    """Whether a bake is refused, and changes no image and no file."""
    files = {path: path.read_bytes() for path in Path(settings.storing.output or "/nowhere/m.png").parent.glob("*")}
    images = {image.name: maps.pixels(image) for image in bpy.data.images}
    with pytest.raises(BakeError, match=match):
        bake(jobs, settings, share_image=share_image)
    assert {path: path.read_bytes() for path in files} == files
    assert all(np.array_equal(maps.pixels(bpy.data.images[name]), texels) for name, texels in images.items())


TILED = {"udim": True}
TILED_FILES = TILED | {"output": "m.<UDIM>.png"}
REFUSALS = {
    "another size": ({}, {"width": 64}, "as 32 x 32 texels of 8 bits, and this bake would make it 64 x 32"),
    "another depth": ({"output": "m.png"}, {"depth": 16}, "m.png' also has the map of 'a_low', as .* 8 bits"),
    "no alpha": ({"output": "m.png"}, {"alpha": False}, "without alpha"),
    "floats": ({}, {"depth": 32}, "32-bit floats"),
    "a file instead of an image": ({}, {"output": "m.png"}, "The map of 'a_low' in the image 'atlas_normal' is not in"),
    "a file instead of a packed image": ({"storage": "PACK"}, {"output": "m.png"}, "'a_low' in the image .* is not in"),
    "another file": (
        {"output": "m.png"},
        {"output": "n.png"},
        "The map of 'a_low' in the image 'atlas_normal' is not in",
    ),
    "files instead of packed tiles": (TILED | {"storage": "PACK"}, TILED_FILES, "'a_low' in the image .* is not in"),
    "other files of tiles": (TILED_FILES, TILED | {"output": "n.<UDIM>.png"}, "'a_low' in the image .* is not in"),
    "tiles instead of a picture": ({"output": "m.png"}, TILED_FILES, "'a_low' in the image .* is not in"),
    "packed tiles instead of a picture": ({}, TILED | {"storage": "PACK"}, "'a_low' in another way than this bake"),
    "a picture instead of tiles": (
        TILED_FILES,
        {"udim": False, "output": "m.png"},
        "'a_low' in the image .* is not in",
    ),
    "a picture instead of packed tiles": (
        TILED | {"storage": "PACK"},
        {"udim": False, "storage": "MEMORY"},
        "another way",
    ),
    "mip files": ({"output": "m.png", "mip_files": True}, {}, "its mip levels mix all objects"),
    "a measured range": ({"maps": ("HEIGHT",)}, {}, "its values are scaled by the largest"),
    "a packed range": ({"normal": False, "maps": ("HEIGHT",)}, {}, "height.* its values are scaled"),
    "numbers": ({"maps": ("OBJECT_ID",)}, {}, "numbered over all objects"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_what_cannot_stay_is_refused(case, tmp_path):
    first, then, match = REFUSALS[case]
    jobs = pairs("ab")
    bake(jobs.values(), settings_in(tmp_path, **first))
    refused([jobs["b"]], settings_in(tmp_path, **first | then), match)
    bake(jobs.values(), settings_in(tmp_path, **first | then))


@pytest.mark.parametrize("values", [{"storage": "PACK"}, {"storage": "MEMORY"}, {"storage": "PACK", "udim": True}])
def test_an_older_file_does_not_replace_what_was_baked_into_the_image_since(values, tmp_path):
    """Also a map that was packed when the .blend was saved: its source is FILE then."""
    name = "m.<UDIM>.png" if values.get("udim") else "m.png"
    jobs, file_settings = pairs("ab"), settings_in(tmp_path, output=name, udim=bool(values.get("udim")))
    bake(jobs.values(), file_settings)
    bend(jobs["a"])
    bake(jobs.values(), settings_in(tmp_path, **values))
    datablocks.pack_unpacked()
    refused([jobs["b"]], file_settings, "The map of 'a_low' in the image 'atlas_normal' is not in")
    bake(jobs.values(), file_settings)
    bake([jobs["b"]], file_settings)


@pytest.mark.parametrize("values", [{"output": "m.png"}, {"udim": True, "output": "m.<UDIM>.png"}])
def test_a_file_that_is_packed_as_well_counts_while_both_are_equal(values, tmp_path):
    """As with Blender's Automatically Pack Resources."""
    jobs, settings = pairs("ab"), settings_in(tmp_path, **values)
    bake(jobs.values(), settings)
    before = all_maps(settings)["NORMAL"]
    bpy.data.images["atlas_normal"].pack()
    bake([jobs["b"]], settings)
    assert np.array_equal(all_maps(settings)["NORMAL"], before)
    bpy.data.images["atlas_normal"].pack()
    (path,) = tmp_path.iterdir()
    image_file.write(np.zeros((32, 32, 4), np.float32), path, 8)
    refused([jobs["b"]], settings, "The map of 'a_low' in the image 'atlas_normal' is not in")


def test_tiles_of_others_alone_go_along_to_new_files(tmp_path):
    places = {"a": PLACES["a"], "b": (1.1, 0.1, 0.8, 0.8)}
    jobs, settings = pairs("ab", places), settings_in(tmp_path, udim=True, storage="PACK", depth=8)
    bake(jobs.values(), settings)
    before = all_maps(settings)["NORMAL"]
    bake([jobs["a"]], settings_in(tmp_path, **TILED_FILES))
    assert np.array_equal(all_maps(settings_in(tmp_path, **TILED_FILES))["NORMAL"], before)


def test_a_file_with_others_counts_where_the_image_has_none(tmp_path):
    """The image has only what is baked again: the file is the place of the others."""
    settings = settings_in(tmp_path, output="m.png", image="both")
    jobs = pairs("ab")
    bake(jobs.values(), settings)
    before = image_file.read(settings.storing.output)
    bpy.data.images.remove(bpy.data.images["both"])
    bake([jobs["b"]], settings_in(tmp_path, image="both"), share_image=False)
    bake([jobs["b"]], settings, share_image=False)
    assert np.array_equal(image_file.read(settings.storing.output), before)


def test_live_and_conversions_do_not_replace_it():
    jobs = pairs("ab")
    settings = settings_in("", image="both")
    bake(jobs.values(), settings)
    job = jobs["a"]
    with pytest.raises(BakeError, match="'b_low', which Live would replace"):
        Session(bpy.context, job, settings, Pace())
    single = settings_in("", image="single")
    bake([job], single)
    conversion = convert.Conversion(job.low, bpy.data.images["single"], StoredNormals())
    with pytest.raises(BakeError, match="'b_low', which the converted map"):
        convert.convert(bpy.context, conversion, settings_in("", image="both", space="OBJECT"))


def test_an_object_has_a_layout_in_each_map_of_its_own():
    """Two maps with the same object, baked by different UV maps: each keeps the texels of its own."""
    jobs = pairs("ab")
    bake(jobs.values(), settings_in(""))
    mesh = jobs["a"].low.data
    second = mesh.uv_layers.new(name="second")
    second.uv[0].vector.x += 0.01
    mesh.uv_layers.active = second
    bake(jobs.values(), settings_in("", normal=False, maps=("AO",), uv_layer=""))
    kept = shared_image.kept(
        bpy.context, [jobs["b"]], bake_jobs.for_low(settings_in("", maps=("AO",)), "atlas"), is_shared=True
    )
    assert {name: [part.uv_layer for part in parts] for name, parts in kept.parts.items()} == {
        "NORMAL": ["UVMap"],
        "AO": ["second"],
    }
    assert len(kept.lows) == 2


def lose_the_uvs(jobs):
    jobs["a"].low.data.uv_layers.remove(jobs["a"].low.data.uv_layers[0])


def lose_the_faces(jobs):
    jobs["a"].low.data.clear_geometry()


@pytest.mark.parametrize("lose", [lose_the_uvs, lose_the_faces], ids=lambda lose: lose.__name__)
def test_an_object_without_uvs_blocks_only_the_map_it_is_in(lose):
    """A sentence names it and what to do. Where it has a map in the image no more, it is no matter."""
    settings = settings_in("")
    jobs = pairs("abc")
    bake(jobs.values(), settings)
    lose(jobs)
    bpy.context.view_layer.update()
    refused([jobs["b"]], settings, r"also has the map of 'a_low', .*\('a_low' has no .*\): mend or delete that object")
    image = bpy.data.images["atlas_normal"]
    parts = [part for part in shared_maps.parts_of_image(image.name) if part.name != "a_low"]
    shared_maps.note(image, parts)
    jobs["c"].low.name = "limb"
    before = all_maps(settings)["NORMAL"]
    bake([jobs["b"]], settings)
    inside = texels_of("c")
    assert np.array_equal(all_maps(settings)["NORMAL"][inside], before[inside])


def test_a_sequence_does_not_replace_it(tmp_path):
    """It is asked before the first frame. When it may, the image is that of one object."""
    jobs = pairs("ab")
    bake(jobs.values(), settings_in(tmp_path, image="both", output="m.png"))
    frames = settings_in(tmp_path / "frames", image="both", output="m_####.png", depth=16)
    with pytest.raises(BakeError, match="'b_low', which the sequence would"):
        finish(sequence.work_on_frames(bpy.context, jobs["a"], frames, [1, 2], Pace()))
    assert bpy.data.images["both"].source == "FILE"
    assert not (tmp_path / "frames").exists()
    bpy.data.objects.remove(jobs["b"].low)
    finish(sequence.work_on_frames(bpy.context, jobs["a"], frames, [1, 2], Pace()))
    assert bpy.data.images["both"].source == "SEQUENCE"
    assert not shared_maps.parts_of_image("both")


def delete(path):
    path.unlink()


def put_another_size(path):
    image_file.write(np.zeros((8, 8, 4), np.float32), path, 8)


@pytest.mark.parametrize("values", [{"output": "m.png"}, {"udim": True, "output": "m.<UDIM>.png"}])
@pytest.mark.parametrize("change", [delete, put_another_size], ids=lambda change: change.__name__)
def test_a_file_that_changes_during_the_bake_is_not_replaced(change, values, tmp_path):
    """Between the check and the last step."""
    settings = settings_in(tmp_path, **values)
    jobs = pairs("ab")
    bake(jobs.values(), settings)
    (path,) = tmp_path.iterdir()
    steps = bake_jobs.work(bpy.context, [jobs["b"]], settings, Pace(), share_image=True)
    next(step for step in steps if step.what == "Storing")
    change(path)
    after = path.read_bytes() if path.exists() else None
    with pytest.raises(BakeError, match="also has the map of other objects"):
        finish(steps)
    assert (path.read_bytes() if path.exists() else None) == after
    assert set(tmp_path.iterdir()) <= {path}


def test_an_image_that_is_deleted_during_the_bake_is_missed():
    settings, jobs = settings_in(""), pairs("ab")
    bake(jobs.values(), settings)
    steps = bake_jobs.work(bpy.context, [jobs["b"]], settings, Pace(), share_image=True)
    next(step for step in steps if step.what == "Storing")
    bpy.data.images.remove(bpy.data.images["atlas_normal"])
    with pytest.raises(BakeError, match="'atlas_normal' was deleted or changed"):
        finish(steps)


def test_a_tile_without_others_may_have_another_size(tmp_path):
    places = {"a": PLACES["a"], "b": (1.1, 0.1, 0.8, 0.8)}
    jobs, settings = pairs("ab", places), settings_in(tmp_path, **TILED_FILES)
    bake(jobs.values(), settings)
    before = (tmp_path / "m.1002.png").read_bytes()
    put_another_size(tmp_path / "m.1001.png")
    bake([jobs["a"]], settings)
    assert image_file.format_of(tmp_path / "m.1001.png").size == (32, 32)
    assert (tmp_path / "m.1002.png").read_bytes() == before


def test_parts_of_another_scene_are_not_replaced(tmp_path):
    settings = settings_in(tmp_path, output="m.png")
    bake(pairs("a").values(), settings)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    jobs = pairs("b")
    refused(jobs.values(), settings, "has the map of 'a_low', which is not in this file")
    refused(jobs.values(), settings, "which is not in this file", share_image=False)
    os.remove(settings.storing.output)
    bake(jobs.values(), settings)


def test_an_object_that_was_renamed_is_no_other(tmp_path):
    """All are baked, so nothing is lost: the UVs tell who it is."""
    settings = settings_in(tmp_path, output="m.png")
    jobs = pairs("ab")
    bake(jobs.values(), settings)
    bpy.data.images.remove(bpy.data.images["atlas_normal"])
    jobs["a"].low.name = "limb"
    bake(jobs.values(), settings)
    assert {part.name for part in shared_maps.parts_of_files(bake_jobs.for_low(settings, "atlas"))} == {"limb", "b_low"}


def test_paint_that_was_not_saved_is_not_lost(tmp_path):
    settings = settings_in(tmp_path, output="m.png")
    jobs = pairs("ab")
    bake(jobs.values(), settings)
    bpy.data.images["atlas_normal"].pixels[0] = 0.25
    with pytest.raises(BakeError, match="unsaved changes, also on 'a_low'"):
        bake([jobs["b"]], settings)


def test_the_deleted_are_forgotten():
    jobs = pairs("ab")
    settings = settings_in("")
    bake(jobs.values(), settings)
    bpy.data.objects.remove(jobs["a"].low)
    bake([jobs["b"]], settings)
    both = all_maps(settings)["NORMAL"]
    bpy.data.images.remove(bpy.data.images["atlas_normal"])
    bake([jobs["b"]], settings)
    assert np.array_equal(all_maps(settings)["NORMAL"], both)


def test_uvs_that_overlap_others_are_told_and_take_nothing():
    jobs = pairs("ab")
    settings = settings_in("")
    bake(jobs.values(), settings)
    before = all_maps(settings)["NORMAL"]
    scenes.move_uvs(jobs["b"].low, (1.0, 1.0), (-0.05, 0.0))
    (report,) = bake([jobs["b"]], settings)
    assert any("overlap texels of other objects in the same image, which stay" in text for text in report.warnings)
    inside = texels_of("a")
    assert np.array_equal(all_maps(settings)["NORMAL"][inside], before[inside])


@pytest.mark.parametrize("share_image", [True, False])
def test_others_on_the_same_texels_are_refused(share_image):
    """As another set of pairs with the same name for the image: neither replaces the other."""
    settings = settings_in("", image="both")
    bake(pairs("ab").values(), settings)
    others = pairs("ab")
    refused(
        others.values() if share_image else [others["a"]], settings, "have the same texels", share_image=share_image
    )


def test_a_map_of_one_object_has_no_record(tmp_path):
    """Its files are as they always were."""
    settings = settings_in(tmp_path, output="{low}.png")
    jobs = pairs("ab")
    bake(jobs.values(), settings, share_image=False)
    assert not any(b"tEXt" in path.read_bytes() for path in tmp_path.glob("*.png"))
    assert not any(shared_maps.RECORD in image for image in bpy.data.images)
    bake([jobs["a"]], settings, share_image=False)


def note_in(path, note):
    """What is read back of a note in a file of a few texels."""
    texels, depth = np.zeros((4, 4, 4), np.float32), 16 if path.suffix == ".exr" else 8
    image = image_file.content(texels, path, depth, note=note, blocks=image_file.Blocks(BC4))
    image.write(path, (part() for part in image.parts))
    return image_file.note_of(path)


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("ending", ["png", "exr", "tif", "tga", "dds", "ktx2", "webp", "jpg"])
def test_records_are_read_back(ending, tmp_path):
    """Names may be anything; of many in a Targa file, only checksums have room."""
    parts = [shared_maps.Part(f'{number} "ü\\\n[', "UV\0Map", number == 1, number * 2**20) for number in range(9)]
    path = tmp_path / f"m.{ending}"
    for some in (parts[:2], parts):
        found = shared_maps._from_text(note_in(path, shared_maps.to_text(some, path)))
        is_short = ending == "tga"
        assert [part.layout for part in found] == [part.layout for part in some]
        assert found == some or is_short
    assert not shared_maps._from_text("[[1,2],{}," + "[" * 5000)


def test_each_length_of_a_record_has_room_in_a_targa_file(tmp_path):
    """Its comment has four lines; a line can end in a blank."""
    path = tmp_path / "m.tga"
    for length in range(1, shared_maps.LONGEST_IN_TARGA - 25):
        parts = [shared_maps.Part(("ab " * 200)[length % 3 :][:length], "", False, 1)]
        assert shared_maps._from_text(note_in(path, shared_maps.to_text(parts, path))) == parts, length
    most = [shared_maps.Part(str(number), "", False, 2**32 - 1 - number) for number in range(shared_maps.MOST_IN_TARGA)]
    found = shared_maps._from_text(note_in(path, shared_maps.to_text(most, path)))
    assert [part.layout for part in found] == [part.layout for part in most]


def test_more_than_a_targa_file_can_note_are_refused(tmp_path, monkeypatch):
    """Before the bake: otherwise a later one of some would not know whose texels to keep."""
    monkeypatch.setattr(shared_maps, "MOST_IN_TARGA", 1)
    jobs = pairs("ab")
    refused(jobs.values(), settings_in(tmp_path, output="m.tga"), "shared by 2 low objects, .* Targa .* another format")
    assert not list(tmp_path.iterdir())
    bake(jobs.values(), settings_in(tmp_path, output="m.png"))
    bake([jobs["a"]], settings_in(tmp_path, output="m.tga", image="alone"))


@pytest.mark.skipif(not os.path.exists("/proc/self/mem"), reason="needs a file that root cannot read either")
@pytest.mark.parametrize("ending", ["png", "exr", "tif", "tga"])
def test_a_file_that_cannot_be_read_is_no_file_without_record(ending, tmp_path):
    settings = settings_in(tmp_path, output=f"m.{ending}", depth=16 if ending == "exr" else 8)
    os.symlink("/proc/self/mem", settings.storing.output)
    with pytest.raises(BakeError, match=rf"m.{ending}' could not be read: Input/output error."):
        shared_maps.parts_of_files(settings)


@pytest.mark.parametrize("is_kept", [False, True])
@pytest.mark.parametrize("margin", [0, 2, 8])
def test_colors_go_on_where_rays_miss_beside_another_object(margin, is_kept):
    """The right half of `a` misses, and the texels of `b` follow at once: they are nearer, and another color."""
    jobs = pairs("ab", {"a": (0.0, 0.0, 0.5, 1.0), "b": (0.5, 0.0, 0.5, 1.0)})
    for name, color in (("a", (1.0, 0.0, 0.0, 1.0)), ("b", (0.0, 1.0, 0.0, 1.0))):
        material = bpy.data.materials.new(name)
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = color
        jobs[name].highs[0].data.materials.append(material)
    high = jobs["a"].highs[0]
    high.scale.x, high.location.x = 0.5, -0.5
    bpy.context.view_layer.update()
    settings = scenes.settings(**SAME | {"margin": margin}, maps=("BASE_COLOR",), image="all", depth=32)
    bake(jobs.values(), settings)
    if is_kept:
        bake([jobs["a"]], settings)
    color = maps.pixels(bpy.data.images["all_base_color"])
    is_missed = color[:, :16, 3] == 0.0
    assert 0.3 < is_missed.mean() < 0.6
    np.testing.assert_allclose(color[:, 16:, :3], np.broadcast_to((0.0, 1.0, 0.0), (32, 16, 3)), atol=1e-6)
    reached = np.arange(16) < 8 + margin
    found = color[:, :16, :3][:, reached]
    np.testing.assert_allclose(found, np.broadcast_to((1.0, 0.0, 0.0), found.shape), atol=1e-6)
    assert (color[:, :16, :3][:, ~reached] != (0.0, 1.0, 0.0)).any(axis=-1).all()
