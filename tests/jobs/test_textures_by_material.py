# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests one image for each material, shared by all low objects that wear it."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.jobs import Job, bake_jobs
from addon.ui import bake_operators, object_pairs, results
from tests.support import maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SAME = {"method": "CAST", "width": 32, "height": 32, "margin": 2, "storage": "MEMORY", "texture_sets": True}


def square(name, place, materials, number=0, high=True):
    """A low square of 2 x 2 faces with UVs in `place`, (left, bottom, width, height), and a wavy high one: its job.

    materials: the first half of the faces has the first, the second half the last one.
    """
    low = zoo.plane(f"{name}_low", 2)
    left, bottom, width, height = place
    scenes.move_uvs(low, (width, height), (left, bottom))
    for material in materials:
        low.data.materials.append(material)
    half = len(low.data.polygons) // 2
    for face in low.data.polygons:
        face.material_index = 0 if face.index < half else len(materials) - 1
    wavy = zoo.terrain(f"{name}_high", 12, height=0.1 + 0.02 * number)
    low.location.x = wavy.location.x = 4.0 * number
    return Job(low, [wavy])


def grid(count, columns):
    """Places of so many squares of a grid, a texel apart from each other on a map of 32 texels."""
    side = 1.0 / columns
    return [
        (side * (number % columns) + 1 / 32, side * (number // columns) + 1 / 32, side - 2 / 32, side - 2 / 32)
        for number in range(count)
    ]


def nine(material, count=9):
    """Nine squares of one material side by side, or fewer."""
    jobs = [square(str(number), place, [material], number) for number, place in enumerate(grid(count, 3))]
    bpy.context.view_layer.update()
    return jobs


def bake(jobs, settings=None, *, share_image=True, **more):
    return bake_jobs.bake_all(bpy.context, jobs, settings or Settings(**SAME), share_image=share_image, **more)


def test_nine_low_objects_of_a_material_have_in_its_map_what_each_has_alone():
    jobs = nine(bpy.data.materials.new("Wood"))
    reports = bake(jobs)
    assert {report.image for report in reports} == {"Wood_normal"}
    shared = maps.pixels(bpy.data.images["Wood_normal"])
    is_own = np.zeros((32, 32), int)
    for job in jobs:
        bake([job], Settings(**SAME | {"margin": 0}, image="alone"), share_image=False)
        alone = maps.pixels(bpy.data.images["alone"])
        is_hit = alone[..., 3] > 0.0
        is_own += is_hit
        assert is_hit.sum() > 20
        assert np.array_equal(shared[is_hit], alone[is_hit])
    assert is_own.max() == 1


def prop():
    """14 parts that wear three materials, six of them two."""
    wood, metal, glass = map(bpy.data.materials.new, ("Wood", "Metal", "Glass"))
    worn = [[wood]] * 4 + [[metal]] * 3 + [[glass]] + [[wood, metal]] * 5 + [[glass, wood]]
    jobs = [
        square(str(number), place, own, number)
        for number, (place, own) in enumerate(zip(grid(14, 4), worn, strict=True))
    ]
    bpy.context.view_layer.update()
    return jobs


def test_a_prop_of_14_parts_and_3_materials_has_3_images_of_each_map():
    reports = bake(prop(), Settings(**SAME, maps=("AO", "BASE_COLOR"), connect_maps=True))
    assert len(reports) == 20
    wanted = {f"{name}_{of_map}" for name in ("Wood", "Metal", "Glass") for of_map in ("normal", "ao", "base_color")}
    assert {image.name for image in bpy.data.images} == wanted
    for name in ("Wood", "Metal", "Glass"):
        nodes = bpy.data.materials[name].node_tree.nodes
        shown = {node.image.name for node in nodes if node.bl_idname == "ShaderNodeTexImage"}
        assert f"{name}_normal" in shown
        assert all(other.startswith(name) for other in shown)


@pytest.mark.parametrize(
    ("image", "wanted"),
    [
        ("", "Wood_normal"),
        ("T_{low}_{material}_N", "T_Wood_N"),
        ("T_{name}_N", "T_Wood_N"),
        ("T_{low}_x_{material}_N", "T_crate_x_Wood_N"),
        ("T_{material}_N", "T_Wood_N"),
        ("fixed", "fixed"),
    ],
)
def test_names(image, wanted):
    job = square("a", (0, 0, 1, 1), [bpy.data.materials.new("Wood")])
    (report,) = bake([job], Settings(**SAME, image=image), shared_name="crate")
    assert report.image == wanted


def test_materials_need_names_of_their_own():
    job = square("a", (0, 0, 1, 1), [bpy.data.materials.new("Wood"), bpy.data.materials.new("Metal")])
    with pytest.raises(BakeError, match=r"\{material\} in the name of the image"):
        bake([job], Settings(**SAME, image="fixed"))
    assert not bpy.data.images


def test_one_material_is_another_way():
    job = square("a", (0, 0, 1, 1), [bpy.data.materials.new("Wood")])
    with pytest.raises(BakeError, match="one material has one: choose one"):
        bake([job], Settings(**SAME, one_material=True))


def test_a_material_has_its_own_size():
    """The largest of materials of one name; the others and an object's own size do not count."""
    wood, metal = map(bpy.data.materials.new, ("Wood", "Metal"))
    jobs = [square(str(number), place, [wood, metal], number) for number, place in enumerate(grid(2, 2))]
    jobs = [
        jobs[0].but(sizes=(("Wood", 64), ("Else", 16)), size=16),
        jobs[1].but(sizes=(("Wood", 16),), size=16),
    ]
    sizes = {report.image: {tuple(report.size)} for report in bake(jobs)}
    assert sizes == {"Wood_normal": {(64, 64)}, "Metal_normal": {(32, 32)}}
    own = {report.image: tuple(report.size) for report in bake(jobs, share_image=False)}
    assert own == {
        "0_low_Wood_normal": (64, 64), "0_low_Metal_normal": (16, 16),
        "1_low_Wood_normal": (16, 16), "1_low_Metal_normal": (16, 16),
    }  # fmt: skip


def test_only_some_are_baked():
    """As all at once; names of the others count, and one that would fail does not matter."""
    jobs = nine(bpy.data.materials.new("Wood"))
    reports = bake(jobs[:3], only={jobs[1].low.session_uid})
    assert [report.low for report in reports] == ["1_low"]
    bake(jobs, only={job.low.session_uid for job in jobs if job is not jobs[1]})
    apart = maps.pixels(bpy.data.images["Wood_normal"])
    bpy.data.images.remove(bpy.data.images["Wood_normal"])
    bake(jobs)
    assert np.array_equal(maps.pixels(bpy.data.images["Wood_normal"]), apart)
    jobs[0].low.data.uv_layers.remove(jobs[0].low.data.uv_layers[0])
    assert bake([jobs[0], jobs[1]], share_image=False, only=set()) == []
    assert [report.low for report in bake(jobs[:2], share_image=False, only={jobs[1].low.session_uid})] == ["1_low"]
    with pytest.raises(BakeError, match="would both fill"):
        bake(jobs[:2], Settings(**SAME, image="{material}"), share_image=False, only={jobs[1].low.session_uid})


def images_of(material):
    """The images that a material shows."""
    return {node.image.name for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeTexImage"}


@pytest.mark.parametrize("is_taken", [False, True])
def test_faces_without_a_material_share_a_new_one(is_taken):
    """It is called as the set, and its texture too, also in the next bake."""
    jobs = [square(str(number), place, [], number) for number, place in enumerate(grid(3, 2))]
    jobs[2].low.data.materials.append(bpy.data.materials.new("crate") if is_taken else None)
    bpy.context.view_layer.update()
    for _ in range(2):
        reports = bake(jobs, shared_name="crate")
        assert {report.image for report in reports} == {"crate_normal"}
        assert not [warning for report in reports for warning in report.warnings if "aterial" in warning]
        assert {slot.material.name for job in jobs for slot in job.low.material_slots} == {"crate"}
    assert len(bpy.data.materials) == 1
    assert images_of(bpy.data.materials[0]) == {"crate_normal"}


@pytest.mark.parametrize("single_user", [False, True])
def test_a_material_that_others_wear(single_user):
    """It is told as long as the map shows on others; with Single User all parts get one copy, and others keep theirs."""
    wood = bpy.data.materials.new("Wood")
    jobs = nine(wood, 3)
    outside = zoo.plane("outside")
    outside.data.materials.append(wood)
    reports = bake(jobs, Settings(**SAME, single_user=single_user))
    worn = {job.low.material_slots[0].material for job in jobs}
    assert len(worn) == 1
    told = [warning for report in reports for warning in report.warnings if "outside" in warning]
    if single_user:
        assert wood not in worn
        assert (len(told), images_of(wood), images_of(worn.pop())) == (1, set(), {"Wood_normal"})
        copy = jobs[0].low.material_slots[0].material
        assert {report.image for report in bake(jobs, Settings(**SAME, single_user=True))} == {"Wood_normal"}
        assert (jobs[0].low.material_slots[0].material, images_of(copy)) == (copy, {"Wood_normal"})
        wood.imprint_size, copy.imprint_size = "256", "512"
        assert set(object_pairs.with_own(jobs[0]).sizes) == {("Wood", 256)}
        another = zoo.plane("another")
        another.data.materials.append(copy)  # worn outside as well: the copy of a copy
        bake(jobs, Settings(**SAME, single_user=True))
        second = jobs[0].low.material_slots[0].material
        assert second != copy
        assert {report.image for report in bake(jobs)} == {"Wood_normal"}
        second.name = "Oak"  # the artist's
        assert {report.image for report in bake(jobs)} == {"Oak_normal"}
    else:
        assert worn == {wood}
        assert len(told) == 3
        bpy.data.objects.remove(outside)
        assert not [warning for report in bake(jobs) for warning in report.warnings if "is also on" in warning]


@pytest.mark.parametrize("rendered", [True, False])
def test_uv_maps_of_several_names(rendered):
    """A material names none of them if each is the one that its object renders; else a sentence tells."""
    jobs = nine(bpy.data.materials.new("Wood"), 2)
    first, second = (job.low.data.uv_layers for job in jobs)
    second[0].name = "Atlas"
    if not rendered:
        second.new(name="other", do_init=False).active_render = True
    reports = bake(jobs)
    told = [warning for report in reports for warning in report.warnings if "UV maps of several names" in warning]
    assert [warning.count("'1_low' active for rendering") for warning in told] == [1] * (0 if rendered else len(told))
    assert bool(told) != rendered
    nodes = bpy.data.materials["Wood"].node_tree.nodes
    assert not [node for node in nodes if node.bl_idname == "ShaderNodeUVMap"]
    assert [node.uv_map for node in nodes if node.bl_idname == "ShaderNodeNormalMap"] == [""]
    second[0].name = first[0].name
    bake(jobs[:1])
    (node,) = (node for node in nodes if node.bl_idname == "ShaderNodeNormalMap")
    assert node.uv_map == first[0].name


def test_a_part_that_cannot_be_drawn_keeps_its_texels_and_the_others_are_baked():
    jobs = nine(bpy.data.materials.new("Wood"))
    bake(jobs)
    before = maps.pixels(bpy.data.images["Wood_normal"])
    for job in jobs:
        job.highs[0].scale.z = -3.0
    jobs[4].highs[0].location.z = 100.0
    bpy.context.view_layer.update()
    far = [job.but(tracing=Settings(**SAME, extrusion=0.5, max_distance=1.0).tracing) for job in jobs]
    steps = list(bake_jobs.work(bpy.context, far, Settings(**SAME), Pace(), share_image=True, goes_on=True))
    assert [step.failure[0] for step in steps if step.failure] == ["4_low"]
    assert [step.report.low for step in steps if step.report] == [f"{number}_low" for number in range(9) if number != 4]
    is_changed = (maps.pixels(bpy.data.images["Wood_normal"]) != before).any(axis=-1)
    left, bottom, width, height = (round(32 * value) for value in grid(9, 3)[4])
    assert not is_changed[bottom : bottom + height, left : left + width].any()
    assert is_changed.mean() > 0.5
    with pytest.raises(BakeError):
        bake(far)


def test_textures_that_are_done_stay_if_the_button_is_canceled():
    """Their results are remembered; the other material has no image."""
    jobs = [square(name, place, [bpy.data.materials.new(name)]) for name, place in zip("ab", grid(2, 2), strict=True)]
    settings = bpy.context.scene.imprint
    settings.share_image = settings.texture_sets = True
    for name, value in SAME.items():
        setattr(settings, name, value)
    work = bake_operators.bake_several(bpy.context, jobs, settings.to_settings(), Pace())
    next(step for step in work if step.report is not None)
    work.close()
    assert {image.name for image in bpy.data.images} == {"a_normal"}
    assert results.all_of(bpy.context, jobs[0].low)
    assert not results.all_of(bpy.context, jobs[1].low)


def test_materials_of_one_name_are_one_texture(tmp_path):
    """As one of a library beside one of this file, which alone can show it."""
    path = str(tmp_path / "library.blend")
    wood = bpy.data.materials.new("Wood")
    bpy.data.libraries.write(path, {wood}, fake_user=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.materials = ["Wood"]
    linked = wanted.materials[0]
    jobs = [
        square(str(number), place, [each], number)
        for number, (place, each) in enumerate(zip(grid(2, 2), (wood, linked), strict=True))
    ]
    reports = bake(jobs)
    assert {report.image for report in reports} == {"Wood_normal"}
    assert images_of(wood) == {"Wood_normal"}
    told = [[warning for warning in report.warnings if "linked from a library" in warning] for report in reports]
    assert [len(each) for each in told] == [0, 1]
