# SPDX-License-Identifier: GPL-3.0-or-later
"""The state of a part tells whether a bake would make other maps. The truth are the maps of a fresh bake."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core.declarations.all_settings import DECLARED
from addon.core.progress import Pace, finish
from addon.core.settings import Settings
from addon.jobs import Job, bake_jobs, part_state, state_pieces
from addon.jobs.live_session import Session
from addon.jobs.part_state import State, Status
from addon.scene import content_keys, render_view
from addon.ui import object_pairs
from scripts.bench import stale_signs
from tests.support import part_edits, zoo

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SAME = {"method": "CAST", "width": 16, "height": 16, "margin": 2, "material": False}


def pair():
    low, high = zoo.plane("brick_low", 2), zoo.terrain("brick_high", 12, height=0.2)
    bpy.context.view_layer.update()
    return Job(low, [high])


def bake(job, settings):
    """Bake, and keep what was read with the low object."""
    object_pairs.remember(bake_jobs.bake_all(bpy.context, [job], settings))


def found(job, settings):
    """What differs since the bake."""
    then = part_state.kept(job.low)
    return part_state.changes(then, finish(part_state.look(bpy.context, job, settings, then=then)))


def test_says_what_changed_in_words():
    job, settings = pair(), Settings(**SAME)
    assert part_state.kept(job.low) is None and part_state.status(None, None) is Status.NEVER
    bake(job, settings)
    assert found(job, settings) == []
    point = job.highs[0].data.vertices[40]
    before = tuple(point.co)
    point.co.z += 0.1
    assert found(job, settings) == ["the mesh of 'brick_high'"]
    point.co = before
    assert found(job, settings.sampled(samples=4)) == ["the setting Samples"]
    bpy.data.images.remove(bpy.data.images["brick_low_normal"])
    assert found(job, settings) == ["the image 'brick_low_normal' is gone"]


def test_states_of_maps_in_other_places_stay():
    def of(image, size, attribute="NONE"):
        settings = {"setting:width": size, "setting:vertex_domain": state_pieces.short(attribute)}
        return State(settings).with_images({image: f"map of {image}"})

    near, far = of("near", "32"), of("far", "16")
    both = State.of_json(far.after(near).to_json())
    assert both.images == {"near": "map of near", "far": "map of far"}
    for now in (near, far):
        assert part_state.changes(both, State(now.pieces).with_images(both.images)) == []
    smaller = of("near", "8").after(both)
    assert [each.pieces for each in smaller.earlier] == [far.pieces]
    assert not of("near", "32").with_images({"far": "another"}).after(both).earlier
    renamed = State({}).with_images({"renamed": "map of near"}).after(both)
    assert [each.pieces for each in renamed.earlier] == [far.pieces]
    points = of("far", "16", "POINT")
    assert points.after(near).earlier and not points.after(of("near", "32", "CORNER")).earlier
    assert not State({}).after(near).earlier and not near.after(State({"mesh:a": "1"})).earlier
    many = near
    for number in range(20):
        many = of(str(number), "1").after(many)
    assert len(many.earlier) == state_pieces.MOST - 1
    assert State.of_json("[]") is None and State.of_json("[1]") is None and State.of_json("1") is None


def test_renamed_is_not_changed():
    job, settings = pair(), Settings(**SAME)
    bake(job, settings)
    job.low.name, job.highs[0].name = "stone_low", "stone_high"
    bpy.data.images["brick_low_normal"].name = "stone"
    assert found(job, settings) == []
    other = State({"mesh:a": "1", "mesh:b": "2"})
    assert part_state.changes(other, State({"mesh:b": "1", "mesh:a": "2"})) == []
    assert part_state.changes(other, State({"mesh:a": "1", "mesh:c": "3"})) == ["the mesh of 'c'", "the mesh of 'b'"]


@pytest.mark.parametrize(
    "value",
    [{"compression": "BC7"}, {"quality": 50}, {"lossy_normals": True}, {"export_webp": True}, {"export_ktx2": True}],
)
def test_compressors_count_only_where_a_map_has_one(value):
    job, settings = pair(), Settings(**SAME)
    bake(job, settings)
    assert found(job, Settings(**SAME | value)) == []


@pytest.mark.parametrize("written", ["a key", "[1]", "3", '[["low", "", 0]]', 7, ""])
def test_a_property_that_another_program_has_written_is_no_bake(written):
    job, settings = pair(), Settings(**SAME)
    bake(job, settings)
    bpy.data.images["brick_low_normal"]["imprint_map"] = written
    assert found(job, settings)
    bake(job, settings)
    assert found(job, settings) == []


@pytest.mark.parametrize("count", [30, 70_000, 300_000])
def test_made_uvs_are_the_same_but_for_their_last_bits(count):
    rng = np.random.default_rng(3)
    uvs = rng.random((count, 2)).astype(np.float32)
    key = state_pieces.of_made_uvs(uvs)
    for way in (0.0, 2.0):
        turned = np.where(rng.random(uvs.shape) < 0.5, np.nextafter(uvs, np.float32(way)), uvs)
        assert state_pieces.are_same_uvs(key, state_pieces.of_made_uvs(turned))
    moved, swapped = uvs.copy(), uvs.copy()
    moved[count // 3, 1] += 1e-3
    swapped[[0, -1]] = swapped[[-1, 0]]
    for other in (moved, swapped, uvs[::-1], uvs[1:], None):
        assert not state_pieces.are_same_uvs(key, state_pieces.of_made_uvs(other))


def test_a_bevel_whose_uvs_turn_is_not_changed(monkeypatch):
    job, settings = pair(), Settings(**SAME | {"method": "AUTO"})  # which reads the UVs
    bevel = job.highs[0].modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments = 0.02, 3
    bake(job, settings)
    read, turned = part_state.read_meshes, []

    def with_last_bits(context, request):
        meshes = read(context, request)
        turned.append(np.nextafter(meshes.highs[0].uv, np.float32(2.0)))
        return replace(meshes, highs=[replace(meshes.highs[0], uv=turned[-1])])

    monkeypatch.setattr(part_state, "read_meshes", with_last_bits)
    assert found(job, settings) == [] and len(turned) == 1
    monkeypatch.undo()
    values = job.highs[0].data.uv_layers.active.data
    values[7].uv[0] += 0.01
    assert found(job, settings) == ["the mesh of 'brick_high'"]


def test_a_bevel_on_what_images_color_is_not_changed(tmp_path):
    part = part_edits.make("modifiers", tmp_path, 3)  # whose colors read another layer of UVs
    part.job.highs[0].modifiers.new("Second", "BEVEL")
    part.bake()
    assert [part.changes() for _ in range(12)] == [[]] * 12
    values = part.job.highs[0].data.uv_layers.active.data
    values[7].uv[0] += 0.01
    assert part.changes() == ["the mesh of 'brick_high'"]


@pytest.mark.parametrize("kind", part_edits.KINDS)
def test_signs_agree_with_fresh_bakes(kind, tmp_path):
    rng = np.random.default_rng(list(part_edits.KINDS).index(kind))
    part = part_edits.make(kind, tmp_path, 1)
    maps, judged = part.bake(), []
    edits = [edit for edit in part_edits.EDITS if edit != "setting"]
    while len(judged) < 6:
        one, maps = part_edits.judge(part, edits[rng.integers(len(edits))], rng, maps)
        judged += [one] if one is not None else []
    assert not [one for one in judged if one.is_missed]
    assert not [one for one in judged if one.is_alarm]


@pytest.mark.slow
def test_500_edits(tmp_path, empty_file):
    judged = list(stale_signs.run(500, 7, tmp_path))
    assert not [one for one in judged if one.is_missed]
    alarms, true = ([one for one in judged if one.is_alarm], [one for one in judged if not one.is_stale])
    assert len(alarms) <= 0.02 * len(true), alarms


MOVED = {"by the low object": ({}, True), "in the world": ({"space": "WORLD", "maps": ("POSITION",)}, False)}
"""Settings of maps, and whether they stay if all objects are moved by the same step."""


@pytest.mark.parametrize("how", MOVED)
def test_parts_that_move_as_one(how, tmp_path):
    values, is_same = MOVED[how]
    part = part_edits.make("shape keys", tmp_path, 1)
    for name, value in values.items():
        part.settings = part_edits.with_value(part.settings, name, value)
    before = part.bake()
    for role in (part_edits.LOW, part_edits.HIGH):
        part.object(role).location = (1.7, -3.1, 0.4)
    bpy.context.view_layer.update()
    changes = part.changes()
    assert (changes == []) == is_same == part_edits.is_same(before, part.bake())


def test_only_what_a_map_reads_counts_of_nodes(tmp_path):
    """Of a material that Cycles evaluates, too."""
    part = part_edits.make("noise", tmp_path, 1)
    tree = part.object(part_edits.HIGH).data.materials[0].node_tree
    part.bake()
    tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.1
    part_edits.write_texture(part.texture, 5)
    assert part.changes() == []
    tree.nodes["Color Ramp"].color_ramp.elements[1].position = 0.7
    assert part.changes() == ["the material 'bricks'"]


def test_a_shared_image_stays_true_when_others_are_baked():
    first, second = pair(), pair()
    for number, job in enumerate((first, second)):
        job.low.location.x = job.highs[0].location.x = 4.0 * number
        for each in job.low.data.uv_layers[0].uv:
            each.vector = each.vector * 0.4 + type(each.vector)((0.5 * number, 0.0))
    bpy.context.view_layer.update()
    jobs, settings = [first, second], Settings(**SAME)

    def signs():
        states = [part_state.kept(job.low) for job in jobs]
        looks = [
            finish(part_state.look(bpy.context, job, settings, then=then, jobs=jobs, share_image=True))
            for job, then in zip(jobs, states, strict=True)
        ]
        return [part_state.changes(then, now) for then, now in zip(states, looks, strict=True)]

    object_pairs.remember(bake_jobs.bake_all(bpy.context, jobs, settings, share_image=True))
    assert signs() == [[], []]
    second.highs[0].data.vertices[40].co.z += 0.3
    second.highs[0].data.update()
    assert signs() == [[], ["the mesh of 'brick_high.001'"]]
    only = {second.low.session_uid}
    object_pairs.remember(bake_jobs.bake_all(bpy.context, jobs, settings, share_image=True, only=only))
    assert signs() == [[], []]
    image = first.low.imprint.maps[0].image
    image.pixels[0] = 0.77
    assert signs() == [[f"the image {image.name!r} was edited"]] * 2


def test_maps_of_live_are_true():
    job, settings = pair(), Settings(**SAME)
    session = Session(bpy.context, job, settings, Pace())
    session.run(bpy.context)
    report = session.report(bpy.context, session.commit())
    object_pairs.remember([report])
    assert found(job, settings) == []
    job.highs[0].data.vertices[40].co.z += 0.1
    assert found(job, settings) == ["the mesh of 'brick_high'"]


@pytest.mark.parametrize("is_loaded", [False, True])
def test_a_texture_that_another_program_writes(is_loaded, tmp_path):
    """A bake shows the new file also where a viewport has loaded the old one."""
    part = part_edits.make("shape keys", tmp_path, 1)
    image = bpy.data.images[part.texture.name]
    before = part.bake()
    for seed, is_new in ((2, True), (2, False), (3, True)):
        assert not is_loaded or image.pixels[0] >= 0.0
        assert image.has_data == is_loaded
        part_edits.write_texture(part.texture, seed)
        assert part.changes() == (["the material 'bricks'"] if is_new else [])
        after = part.bake()
        assert part_edits.is_same(before, after) != is_new
        assert part.changes() == []
        before = after


def test_a_look_leaves_the_scene_alone_where_renders_see_the_same(monkeypatch, tmp_path):
    job, settings = pair(), Settings(**SAME)
    bake(job, settings)
    seen = []
    monkeypatch.setattr(render_view, "read", lambda *_: seen.append("render") or [])
    assert found(job, settings) == []
    job.highs[0].hide_set(True)  # as after a bake
    assert found(job, settings) == []
    assert not seen
    monkeypatch.undo()
    job.highs[0].modifiers.new("Subdivision", "SUBSURF").render_levels = 3
    assert found(job, settings) == ["the mesh of 'brick_high'"]
    bake(job, settings)
    assert found(job, settings) == []
    job.highs[0].modifiers[0].render_levels = 1
    assert found(job, settings) == ["the mesh of 'brick_high'"]
    job.highs[0].modifiers[0].render_levels, job.highs[0].modifiers[0].levels = 3, 3
    assert found(job, settings) == []


@pytest.mark.parametrize("is_float", [False, True])
def test_packed_files_are_hashed_where_blender_has_them(is_float, tmp_path):
    image = bpy.data.images.new("packed", 64, 64, alpha=True, float_buffer=is_float)
    image.pixels.foreach_set(np.random.default_rng(1).random(64 * 64 * 4, np.float32))
    image.pack()
    image.use_fake_user = True
    keys = []
    for _ in range(2):
        (file,) = (each.packed_file for each in bpy.data.images["packed"].packed_files)
        assert bytes(content_keys._memory_of(file)) == file.data
        keys.append(content_keys.of_packed(file))
        part_edits.open_again(tmp_path)
    assert keys[0] == keys[1]


@pytest.mark.parametrize("storage", ["PACK", "MEMORY", "FILE"])
def test_maps_stay_true_through_saving_and_tell_edits(storage, tmp_path):
    job, path = pair(), tmp_path / "brick.png"
    settings = Settings(**SAME, storage=storage, output=str(path) if storage == "FILE" else "")
    names = [obj.name for obj in (job.low, *job.highs)]
    bake(job, settings)
    assert found(job, settings) == []
    part_edits.open_again(tmp_path)
    job = Job(bpy.data.objects[names[0]], [bpy.data.objects[names[1]]])
    assert found(job, settings) == []
    image = job.low.imprint.maps[0].image
    if storage == "FILE":
        content = path.read_bytes()
        path.unlink()
        assert found(job, settings) == [f"the file of {image.name!r} is gone"]
        path.write_bytes(content)
        assert found(job, settings) == []
        path.write_bytes(content + b" ")
    else:
        image.pixels[0] = 0.25
        image.pack()
    assert found(job, settings) == [f"the image {image.name!r} was edited"]


def test_normals_of_its_own_that_are_the_same_change_no_low_object(tmp_path):
    part = part_edits.make("curve", tmp_path, 1)
    before = part.bake()
    part.object(part_edits.LOW).modifiers.new("Normals", "WEIGHTED_NORMAL")
    assert part.changes() == []
    assert part_edits.is_same(before, part.bake())


def test_what_moves_no_point_and_still_changes_a_map(monkeypatch):
    """Vertex normals, along which rays leave, also where those of corners stay."""
    job, settings = pair(), Settings(**SAME)
    bake(job, settings)
    read = part_state.read_meshes

    def turned(context, request):
        meshes = read(context, request)
        return replace(meshes, smooth_normals=np.nextafter(meshes.smooth_normals, np.float32(2.0)))

    monkeypatch.setattr(part_state, "read_meshes", turned)
    assert found(job, settings) == ["the mesh of 'brick_low'"]


def test_normals_of_their_own_count_of_what_may_be_turned_over(tmp_path):
    part = part_edits.make("shape keys", tmp_path, 1)
    part.bake()
    part.object(part_edits.HIGH).modifiers.new("Normals", "WEIGHTED_NORMAL")
    assert part.changes() == [f"the mesh of '{part_edits.HIGH}'"]


def test_uvs_count_to_the_bit_unless_modifiers_make_them_both_times():
    uvs = np.random.default_rng(3).random((30, 2)).astype(np.float32)
    turned = np.nextafter(uvs, np.float32(2.0))
    exact, made = state_pieces.of_uvs, state_pieces.of_made_uvs
    assert state_pieces.are_same_uvs(exact(uvs), made(uvs)) and state_pieces.are_same_uvs(made(uvs), exact(uvs))
    assert state_pieces.are_same_uvs(made(turned), made(uvs))
    for then, now in ((exact(turned), exact(uvs)), (exact(turned), made(uvs)), (made(turned), exact(uvs))):
        assert not state_pieces.are_same_uvs(then, now)


def test_colors_count_where_a_map_reads_them(tmp_path):
    part = part_edits.make("shape keys", tmp_path, 1)
    high = part.object(part_edits.HIGH)
    colors = high.data.color_attributes.new("paint", "BYTE_COLOR", "CORNER")
    part.bake()
    colors.data[0].color = (1.0, 0.0, 0.0, 1.0)
    assert part.changes() == []
    part.settings = part_edits.with_value(part.settings, "maps", ("ATTRIBUTE",))
    part.bake()
    high.data.color_attributes[0].data[1].color = (0.0, 1.0, 0.0, 1.0)
    high.data.update()
    assert part.changes() == [f"the mesh of '{part_edits.HIGH}'"]


@pytest.mark.parametrize("whose", ["OWN", "ALL", "SCENE"])
def test_what_shades_a_part_counts(whose):
    jobs, settings = [pair(), pair()], Settings(**SAME, occluders=whose, maps=("AO",), rays=16)
    for number, job in enumerate(jobs):
        job.low.location.x = job.highs[0].location.x = 2.1 * number
    bpy.context.view_layer.update()
    object_pairs.remember(bake_jobs.bake_all(bpy.context, jobs, settings))
    known = {}

    def changes(job):
        then = part_state.kept(job.low)
        look = part_state.look(bpy.context, job, settings, then=then, jobs=jobs, known=known)
        return part_state.changes(then, finish(look))

    assert [changes(job) for job in jobs] == [[], []]
    assert len(known) == (0 if whose == "OWN" else 2)
    jobs[1].highs[0].location.z += 0.5
    bpy.context.view_layer.update()
    known.clear()
    assert changes(jobs[0]) == ([] if whose == "OWN" else ["the objects that shade it"])
    assert changes(jobs[1]) == [f"the place of '{jobs[1].highs[0].name}'"]


def test_what_is_renamed_beside_a_change_is_not_named():
    then = State({"mesh:a": "1", "mesh:b": "2", "mesh:c": "3"})
    assert part_state.changes(then, State({"mesh:a": "9", "mesh:new": "2", "mesh:c": "3"})) == ["the mesh of 'a'"]


def test_object_colors_count_where_nodes_read_them(tmp_path):
    part = part_edits.make("noise", tmp_path, 1)
    high = part.object(part_edits.HIGH)
    tree = high.data.materials[0].node_tree
    info, noise = tree.nodes.new("ShaderNodeObjectInfo"), tree.nodes["Noise Texture"]
    part.bake()
    high.color = (0.5, 0.1, 0.2, 1.0)
    assert part.changes() == []
    tree.links.new(info.outputs["Color"], noise.inputs["Vector"])
    part.bake()
    high.color = (0.1, 0.1, 0.2, 1.0)
    assert part.changes() == [f"the mesh of '{part_edits.HIGH}'"]


@pytest.mark.parametrize("is_in_group", [False, True])
def test_the_pass_index_of_a_material_counts_where_nodes_read_it(is_in_group, tmp_path):
    part = part_edits.make("noise", tmp_path, 1)
    material = part.object(part_edits.HIGH).data.materials[0]
    tree, inner = material.node_tree, None
    if is_in_group:
        inner = bpy.data.node_groups.new("index", "ShaderNodeTree")
        inner.interface.new_socket("Index", in_out="OUTPUT", socket_type="NodeSocketFloat")
    info = (inner or tree).nodes.new("ShaderNodeObjectInfo")
    index = info.outputs["Material Index"]
    if inner is not None:
        inner.links.new(index, inner.nodes.new("NodeGroupOutput").inputs[0])
        group = tree.nodes.new("ShaderNodeGroup")
        group.node_tree = inner
        index = group.outputs[0]
    else:
        tree.links.new(info.outputs["Alpha"], tree.nodes["Noise Texture"].inputs["Detail"])
    part.bake()
    material.pass_index = 1  # which nothing reads yet
    assert part.changes() == []
    tree.links.new(index, tree.nodes["Noise Texture"].inputs["Scale"])
    before = part.bake()
    material.pass_index = 7
    assert part.changes() == ["the material 'bricks'"]
    assert not part_edits.is_same(before, part.bake())


def test_the_color_space_of_a_texture_counts(tmp_path):
    part = part_edits.make("shape keys", tmp_path, 1)
    part.bake()
    bpy.data.images[part.texture.name].colorspace_settings.name = "Linear Rec.709"
    assert part.changes() == ["the material 'bricks'"]


def test_what_feeds_a_node_counts(tmp_path):
    part = part_edits.make("noise", tmp_path, 1)
    part.bake()
    part.object(part_edits.HIGH).data.materials[0].node_tree.nodes["Noise Texture"].inputs["Scale"].default_value = 9.0
    assert part.changes() == ["the material 'bricks'"]


WITHOUT_MEANING = {
    "ray settings without a map that casts rays": {"rays": 32, "two_sided": True, "bias_angle": 5},
    "settings of other maps": {"id_by": "COLOR", "gradient_axis": "X", "pack_red": "HEIGHT"},
    "what is done with the maps": {"material": True, "single_user": True, "targets": ("unreal",), "limit": 1.0},
    "what only chooses what is read": {"modifiers": "VIEWPORT", "attribute": "paint", "occluders": "ALL"},
    "dithering of 16 bits": {"dither": True},
}


@pytest.mark.parametrize("what", WITHOUT_MEANING)
def test_settings_without_meaning_change_no_map(what):
    job, settings = pair(), Settings(**SAME)
    bake(job, settings)
    assert found(job, Settings(**settings.flat() | WITHOUT_MEANING[what])) == []


@pytest.mark.parametrize(
    "name, value", [("maps", ("HEIGHT",)), ("samples", 4), ("green", "-Y"), ("depth", 8), ("image", "N")]
)
def test_settings_that_decide(name, value):
    job, settings = pair(), Settings(**SAME)
    bake(job, settings)
    assert f"the setting {DECLARED[name].label}" in found(job, Settings(**settings.flat() | {name: value}))


@pytest.mark.parametrize("is_hard", [False, True])
@pytest.mark.parametrize("wrap", ["NONE", "U"])
def test_an_edge_radius_counts_if_an_edge_is_hard(wrap, is_hard):
    """Where tiles repeat, it counts always: edges may be hard between them."""
    job, settings = pair(), Settings(**SAME, wrap=wrap)
    data = job.highs[0].data
    data.polygons.foreach_set("use_smooth", np.full(len(data.polygons), not is_hard))
    bake(job, settings)
    rounded = Settings(**settings.flat() | {"edge_radius": 0.05})
    changes = found(job, rounded)
    assert changes == (["the setting Edge Radius"] if is_hard or wrap != "NONE" else [])


@pytest.mark.parametrize("maps", [(), ("AO",), ("BASE_COLOR", "METALLIC"), ("MATERIAL_ID", "ROUGHNESS")])
@pytest.mark.parametrize("slots", [0, 1])
def test_the_material_that_a_bake_makes_is_no_change(slots, maps):
    """An object without a material gets one with the maps, whose values the next bake reads: they are the same ones."""
    low = zoo.plane("door_low", 2)
    low.data.materials.clear()
    low.modifiers.new("Rounder", "SUBSURF").levels = 2
    if slots:
        low.data.materials.append(None)
    bpy.context.view_layer.update()
    job = Job(low, [low])
    settings = Settings(**SAME | {"material": True, "maps": maps, "method": "FLATTEN"})
    bake(job, settings)
    assert low.material_slots[0].material is not None
    texels = shown(low)
    assert found(job, settings) == []
    bake(job, settings)
    assert all(np.array_equal(texels[name], values) for name, values in shown(low).items())
    assert found(job, settings) == []


def shown(low):
    """The texels of the maps of an object."""
    images = [item.image for item in low.imprint.maps]
    return {image.name: np.array(image.pixels) for image in images}


def two_highs():
    """A low object with two high ones, which are alike but for their places, and their order: by their names."""
    low, highs = zoo.plane("brick_low", 2), [zoo.terrain(f"brick_high{number}", 8, height=0.1) for number in (1, 2)]
    for high, x in zip(highs, (-0.5, 0.5), strict=True):
        high.scale.x, high.location.x = 0.5, x
    bpy.context.view_layer.update()
    return low, highs


@pytest.mark.parametrize("maps", [("OBJECT_ID",), ("PART_ID",), ("AO",), ("MATERIAL_ID",)])
def test_the_order_of_high_objects_counts_where_it_gives_them_colors(maps):
    low, highs = two_highs()
    settings = Settings(**SAME | {"maps": maps})
    bake(Job(low, highs), settings)
    before = shown(low)
    assert found(Job(low, highs), settings) == []
    changed = found(Job(low, highs[::-1]), settings)
    bake(Job(low, highs[::-1]), settings)
    is_same = all(np.array_equal(before[name], values) for name, values in shown(low).items())
    assert is_same == (maps[0] not in {"OBJECT_ID", "PART_ID"})
    assert changed == ([] if is_same else ["the order of the high objects"])
    assert found(Job(low, highs[::-1]), settings) == []
    highs[0].data.vertices[40].co.z += 0.1
    assert found(Job(low, highs[::-1]), settings) == ["the mesh of 'brick_high1'"]
