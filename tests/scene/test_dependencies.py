# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the files that objects are made from are found, and no others."""

import re

import bpy
import numpy as np
import pytest

import addon
from addon.core.errors import BakeError, Incomplete
from addon.core.settings import Settings
from addon.scene import complaints, dependencies, reading
from tests.support import dependency_kinds, scenes, zoo


def shape(obj):
    """The points of an evaluated object, as bytes."""
    bpy.context.view_layer.update()
    data = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.empty((len(data.vertices), 3), np.float32)
    data.vertices.foreach_get("co", points.reshape(-1))
    return points.tobytes()


@pytest.mark.parametrize("name", dependency_kinds.KINDS)
def test_a_file_is_found_from_the_object_that_depends_on_it(name, tmp_path):
    obj, other = zoo.plane("rock", 8), zoo.plane("other", 8)
    before = shape(obj)
    path = dependency_kinds.KINDS[name](obj, tmp_path)
    found = {each.path: each for each in dependencies.of([obj], [obj])}
    assert str(path) in found
    assert found[str(path)].is_needed
    assert not any(each.is_needed for each in dependencies.of([other], [other]))
    assert not dependencies.not_followed([obj])
    assert shape(obj) != before  # the object does depend on it


def test_images_that_only_materials_show_are_those_of_the_objects_that_are_shown(tmp_path):
    obj, path = zoo.plane("rock"), dependency_kinds.picture(tmp_path / "skin.png")
    material = bpy.data.materials.new("skin")
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.load(str(path))
    obj.data.materials.append(material)
    assert not dependencies.of([obj])
    (found,) = dependencies.of([obj], [obj])
    assert (found.path, found.is_surface, found.is_own_map) == (str(path), True, False)
    node.image.pack()
    assert not dependencies.of([obj], [obj])


@pytest.mark.usefixtures("registered")
def test_what_imprint_keeps_with_a_low_object_is_no_part_of_its_mesh(tmp_path):
    """Its high objects, its cage and its maps, also where the add-on is not enabled: but what a modifier uses is."""
    low, high, cage = zoo.plane("low", 8), zoo.plane("high", 8), zoo.plane("cage", 8)
    high_path = str(dependency_kinds.mesh_cache_mdd(high, tmp_path))
    cage_path = str(dependency_kinds.mesh_cache_pc2(cage, tmp_path))
    image = bpy.data.images.load(str(dependency_kinds.picture(tmp_path / "low.png")))
    low.imprint.highs.add().object, low.imprint.cage, low.imprint.maps.add().image = high, cage, image
    assert not dependencies.of([low])
    assert {each.path for each in dependencies.of([low, high])} == {high_path}
    scenes.save(tmp_path / "scene.blend")
    addon.unregister()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
        assert not dependencies.of([bpy.data.objects["low"]])
    finally:
        addon.register()
    low, cage = bpy.data.objects["low"], bpy.data.objects["cage"]
    low.modifiers.new("wrap", "SHRINKWRAP").target = bpy.data.objects["high"]
    assert {each.path for each in dependencies.of([low])} == {high_path}
    low.constraints.new("COPY_LOCATION").target = cage
    assert {each.path for each in dependencies.of([low])} == {high_path, cage_path}


def test_a_path_that_nodes_compute_is_named(tmp_path):
    obj = zoo.plane("rock", 8)
    dependency_kinds.nodes_import_obj(obj, tmp_path)
    tree = obj.modifiers[0].node_group
    node = next(each for each in tree.nodes if each.bl_idname == "GeometryNodeImportOBJ")
    joined = tree.nodes.new("GeometryNodeStringJoin")
    tree.links.new(joined.outputs[0], node.inputs[0])
    assert dependencies.not_followed([obj]) == [
        f"the node {node.name!r} of {tree.name!r} computes the path of its file"
    ]


def modified(kind, **values):
    """A square with one modifier, and the object that it can use."""
    obj, other = zoo.plane("rock", 8), zoo.plane("target", 4)
    modifier = obj.modifiers.new("detail", kind)
    for name, value in values.items():
        setattr(modifier, name, other if value == "target" else value)
    return obj, modifier


def read(obj, **more):
    low = zoo.plane("low", 8)
    return reading.read(bpy.context, low, [obj], None, Settings(method="CAST"), **more)


BROKEN = {
    "an array that is too large": ("ARRAY", {"count": 2**31 - 1}, "amount of copies is too high"),
    "a boolean without an object": ("BOOLEAN", {}, "It has no object"),
    "a boolean of open meshes": ("BOOLEAN", {"object": "target", "solver": "MANIFOLD"}, "non-manifold geometry"),
    "a surface deform without a target": ("SURFACE_DEFORM", {}, "It has no object"),
    "a surface deform that is not bound": ("SURFACE_DEFORM", {"target": "target"}, "It is not bound"),
    "a mesh deform that is not bound": ("MESH_DEFORM", {"object": "target"}, "It is not bound"),
    "geometry nodes without nodes": ("NODES", {}, "It has no nodes"),
    "a smoothing that is not bound": ("CORRECTIVE_SMOOTH", {"rest_source": "BIND"}, "Bind data required"),
    "a Laplacian deform that is not bound": ("LAPLACIANDEFORM", {}, "It is not bound"),
    "a transfer from nothing": ("DATA_TRANSFER", {}, "It has no object"),
    "a shrinkwrap around nothing": ("SHRINKWRAP", {}, "It has no target"),
    "a hook without an object": ("HOOK", {}, "It has no object"),
    "a lattice without an object": ("LATTICE", {}, "It has no object"),
    "a curve without an object": ("CURVE", {}, "It has no object"),
    "an armature without an object": ("ARMATURE", {}, "It has no object"),
    "a warp without objects": ("WARP", {}, "It has no objects"),
    "a mesh cache without a file": ("MESH_CACHE", {}, "It has no file"),
    "a sequence cache without a file": ("MESH_SEQUENCE_CACHE", {}, "It has no cache file"),
    "a remesh in too small steps": ("REMESH", {"mode": "VOXEL", "voxel_size": 1e-9}, "too small to be solved"),
}


def what_it_lacks(obj):
    """The sentences about an object that is read: with its mesh, or in an error if nothing is left of that, as from 5.3 on."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    if evaluated.data.polygons:
        return read(obj).lacks
    with pytest.raises(BakeError) as error:
        read(obj)
    start, *sentences = re.split(r"(?<=\.) (?=Blender leaves)", str(error.value))
    assert start == "'rock' has no faces."
    return sentences


@pytest.mark.parametrize("name", BROKEN)
def test_a_modifier_that_blender_leaves_out_is_named_once(name, capfd):
    kind, values, why = BROKEN[name]
    obj, modifier = modified(kind, **values)
    bpy.context.view_layer.update()  # as in a window, Blender has said it before
    capfd.readouterr()
    (sentence,) = what_it_lacks(obj)
    assert sentence.startswith("Blender leaves out the modifier 'detail' of 'rock'. ")
    assert why in sentence
    assert "WARN" not in "".join(capfd.readouterr())
    with pytest.raises(Incomplete, match="leaves out the modifier"):
        read(obj, must_be_whole=True)
    modifier.show_render = modifier.show_viewport = False
    assert not read(obj).lacks


def test_the_operand_of_a_boolean_counts_and_objects_beside_it_do_not():
    obj, _ = modified("BOOLEAN", object="target")
    zoo.plane("beside", 4).modifiers.new("other", "BOOLEAN")
    assert not read(obj).lacks
    bpy.data.objects["target"].modifiers.new("inner", "BOOLEAN")
    (sentence,) = read(obj).lacks
    assert "'inner' of 'target'" in sentence


@pytest.mark.slow
def test_modifiers_that_work_are_not_named():
    obj = zoo.plane("rock", 8)
    for kind in ("SUBSURF", "SOLIDIFY", "BEVEL", "DECIMATE", "DISPLACE", "TRIANGULATE", "WEIGHTED_NORMAL", "MIRROR"):
        obj.modifiers.new(kind, kind)
    obj.modifiers.new("copies", "ARRAY").count = 3
    boolean = obj.modifiers.new("cut", "BOOLEAN")
    boolean.object = zoo.cube("target")
    assert not read(obj, must_be_whole=True).lacks


IN_FOLDERS = ["cloth_cache", "dynamic_paint_cache", "particles_cache"]
OF_FRAMES = [*IN_FOLDERS, "displace_image_sequence"]


@pytest.mark.parametrize("name", OF_FRAMES)
@pytest.mark.parametrize("is_cut", [False, True])
def test_the_file_of_the_frame_that_is_shown_is_named_once(name, is_cut, tmp_path):
    scenes.save(tmp_path / "scene.blend")
    obj = zoo.plane("rock", 8)
    path = dependency_kinds.PARTLY[name](obj, tmp_path)
    found = {each.path for each in dependencies.of([obj])}
    assert (str(path.parent) in found) == (name in IN_FOLDERS)
    assert str(path) in found
    assert complaints.of_files([obj], for_render=True) == []
    if is_cut:
        path.write_bytes(path.read_bytes()[:-9])
    else:
        path.unlink()
    (sentence,) = complaints.of_files([obj], for_render=True)
    assert repr(str(path)) in sentence
    assert ("ends too early" if is_cut else "cannot be found") in sentence


def test_the_folder_of_a_cache_has_whole_files(tmp_path):
    folder = tmp_path / "fluid"
    (folder / "data").mkdir(parents=True)
    path = dependency_kinds.written_volume(folder / "data" / "fluid_0001.vdb")
    cache = [dependencies.Dependency(str(folder), "the cache")]
    assert dependencies.lacking(cache) == []
    path.write_bytes(path.read_bytes()[:-9])
    assert dependencies.lacking(cache) == [dependencies.Lacking(str(path), "the cache", "ends too early")]
    path.unlink()
    assert dependencies.lacking(cache) == [dependencies.Lacking(str(folder), "the cache", "is empty")]


def test_frames_of_a_sequence_begin_again_and_stay_at_their_ends(tmp_path):
    obj = zoo.plane("rock", 8)
    dependency_kinds.PARTLY["displace_image_sequence"](obj, tmp_path)
    user = obj.modifiers[0].texture.image_user
    user.frame_start, user.frame_duration, user.frame_offset = 11, 2, 1

    def needed():
        return [each.path[-8:-4] for each in dependencies.of([obj]) if each.is_needed]

    for is_cyclic, frames in ((False, {10: None, 11: 2, 12: 3, 13: 3}), (True, {10: 3, 11: 2, 12: 3, 13: 2})):
        user.use_cyclic = is_cyclic
        for frame, number in frames.items():  # as Blender displaces the mesh
            bpy.context.scene.frame_set(frame)
            assert needed() == ([f"{number:04}"] if number else [])


@pytest.mark.parametrize("ending", [".hdr", ".jp2", ".tga"])
def test_an_image_that_blender_cannot_read_is_named(ending, tmp_path):
    """Its format does not say how long it is."""
    kinds = {".hdr": "displace_image_hdr", ".jp2": "displace_image_jp2", ".tga": "displace_image_tga_packed"}
    obj = zoo.plane("rock", 8)
    path = dependency_kinds.KINDS[kinds[ending]](obj, tmp_path)
    assert not read(obj, must_be_whole=True).lacks
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    obj.modifiers[0].texture.image.reload()
    (sentence,) = read(obj).lacks
    assert sentence == f"{str(path)!r}, the image {path.name!r}, cannot be read: restore it, or remove what uses it."
    with pytest.raises(Incomplete, match="cannot be read"):
        read(obj, must_be_whole=True)
    obj.modifiers[0].texture.image.filepath = ""
    assert not read(obj).lacks


@pytest.mark.parametrize(
    ("name", "is_cut"), [(name, number % 2 == 0) for number, name in enumerate(dependency_kinds.KINDS)]
)
def test_a_file_that_is_missing_or_empty_is_named_once(name, is_cut, tmp_path):
    obj = zoo.plane("rock", 8)
    path = dependency_kinds.KINDS[name](obj, tmp_path)
    assert not read(obj, must_be_whole=True).lacks
    if is_cut:
        path.write_bytes(b"")
    else:
        path.unlink()
    (sentence,) = complaints.of_files([obj], for_render=True)
    assert repr(str(path)) in sentence
    assert ("is empty" if is_cut else "cannot be found") in sentence
    with pytest.raises(Incomplete):  # before Blender evaluates the object: an empty Alembic file ends it
        read(obj, must_be_whole=True)
    if not is_cut:
        try:
            said = " ".join(read(obj).lacks)
        except BakeError as error:  # without the file, it may have no faces
            said = str(error).removeprefix("'rock' has no faces. ")
        assert said == sentence
