# SPDX-License-Identifier: GPL-3.0-or-later
"""What Cycles evaluates of the high meshes' materials, against its own emission bake of the same object."""

import subprocess
import sys

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.scene import cycles_values
from addon.scene.materials import exact_nodes
from addon.scene.materials.material_reading import read_materials
from addon.scene.textures import ImageTextures
from scripts.imprint import ROOT
from tests.support import cycles, exact_setups, maps, untrusted
from tests.support.shader_nodes import add, principled

pytestmark = pytest.mark.usefixtures("gpu_context")
MEAN = 1.0 / 255.0
"""The mean difference of a set-up. Those measured are below 0.3; where colors jump, a few texels differ."""
SIZE = (512, 128)


def compare(names, method, **settings):
    """The mean differences by set-up, and the report."""
    high, outputs = exact_setups.ball(names)
    low = high.copy()
    low.data = high.data.copy()
    low.data.materials.clear()
    bpy.context.collection.objects.link(low)
    report, found = maps.bake_all_maps(low, high, maps=("BASE_COLOR",), method=method, size=SIZE, **settings)
    bpy.data.objects.remove(low)  # rays of Cycles' bake do not meet it either
    truth, written = cycles.bake_colors(high, SIZE, outputs, highs=())
    apart = np.abs(found["base_color"][..., :3] - truth[..., :3]).mean(axis=-1)
    places = np.where(written, exact_setups.wedges(len(names), SIZE), -1)
    return {name: float(apart[places == number].mean()) for number, name in enumerate(names)}, report


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_some_setups_are_as_cycles_bakes_them(method):
    found, report = compare(exact_setups.FAST, method)
    assert {name: value for name, value in found.items() if not value < MEAN} == {}
    assert not [text for text in report.warnings if "left out" in text]
    assert set(report.materials) == set(exact_setups.FAST)
    assert all(ways == {"Base Color": "CYCLES"} for ways in report.materials.values())


@pytest.mark.slow
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_all_setups_are_as_cycles_bakes_them(method):
    found, report = compare(tuple(exact_setups.SETUPS), method)
    assert {name: value for name, value in found.items() if not value < MEAN} == {}
    assert not [text for text in report.warnings if "left out" in text]


NOT_AT_A_POINT = {
    "layer weight": ("LayerWeight", "Facing"),
    "fresnel": ("Fresnel", "Fac"),
    "camera": ("CameraData", "View Distance"),
    "light path": ("LightPath", "Is Camera Ray"),
    "occlusion": ("AmbientOcclusion", "Color"),
    "bevel": ("Bevel", "Normal"),
    "wireframe": ("Wireframe", "Fac"),
    "pointiness": ("NewGeometry", "Pointiness"),
    "island": ("NewGeometry", "Random Per Island"),
    "window": ("TexCoord", "Window"),
    "reflection": ("TexCoord", "Reflection"),
    "random object": ("ObjectInfo", "Random"),
    "tangent": ("Tangent", "Tangent"),
    "instancer": ("Attribute", "Color"),
}


@pytest.mark.parametrize("name", NOT_AT_A_POINT)
def test_what_is_not_known_at_a_point_is_named(name):
    """Also behind other nodes."""
    kind, output = NOT_AT_A_POINT[name]
    material = bpy.data.materials.new("Rust")
    node = add(material, kind)
    if name == "instancer":
        node.attribute_type, node.attribute_name = "INSTANCER", "wear"
    socket = next(one for one in node.outputs if one.name.startswith(output))
    behind = add(material, "TexNoise", {"Vector": socket})
    material.node_tree.links.new(behind.outputs["Color"], principled(material).inputs["Base Color"])
    (read,) = read_materials([material], ImageTextures(), {"Base Color"}, is_exact=True)
    assert "Base Color" not in read.feeds
    (note,) = read.notes["Base Color"]
    assert "is left out" in note
    assert node.name in note


def rusty(make):
    """A plane as low and high object, whose material `make` changes."""
    bpy.ops.mesh.primitive_plane_add()
    low = bpy.context.object
    high = low.copy()
    high.data = low.data.copy()
    bpy.context.collection.objects.link(high)
    material = bpy.data.materials.new("Rust")
    high.data.materials.append(material)
    make(material)
    return low, high


def noise(material):
    return add(material, "TexNoise", {"Vector": add(material, "TexCoord").outputs["UV"], "Scale": 4.0})


def feed(material, **outputs):
    for name, output in outputs.items():
        material.node_tree.links.new(output, principled(material).inputs[name.replace("_", " ")])


def of_all_inputs(material):
    found = noise(material)
    color, factor = found.outputs["Color"], found.outputs[0]
    feed(material, Base_Color=color, Roughness=color, Metallic=factor, Emission_Color=color, Alpha=factor)
    principled(material).inputs["Emission Strength"].default_value = 0.5


def test_all_inputs_come_from_one_bake():
    maps_of = ("BASE_COLOR", "ROUGHNESS", "METALLIC", "EMISSION", "ALPHA")
    report, found = maps.bake_all_maps(*rusty(of_all_inputs), maps=maps_of, size=32)
    color = found["base_color"][..., :3]
    luminance = color @ np.array([0.2126390, 0.7151687, 0.0721923], np.float32)
    assert color.std() > 0.03
    assert np.abs(found["roughness"][..., 0] - luminance).max() < 1e-3
    assert np.abs(found["emission"][..., :3] - 0.5 * color).max() < 1e-3
    assert np.abs(found["metallic"] - found["alpha"])[..., :3].max() < 1e-3
    assert set(report.materials["Rust"].values()) == {"CYCLES"}
    assert any(line.startswith("Baked by Cycles: ") for line in report.summary())


def in_groups(material):
    """The shader in a group, mixed with transparency by noise."""
    tree = bpy.data.node_groups.new("rust", "ShaderNodeTree")
    tree.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    shader, found = add(tree, "BsdfPrincipled"), add(tree, "TexNoise", {"Scale": 4.0})
    found_uv = add(tree, "TexCoord")
    tree.links.new(found_uv.outputs["UV"], found.inputs["Vector"])
    clear, mixed = add(tree, "BsdfTransparent"), add(tree, "MixShader", {0: found.outputs[0]})
    tree.links.new(found.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(clear.outputs[0], mixed.inputs[1])
    tree.links.new(shader.outputs[0], mixed.inputs[2])
    tree.links.new(mixed.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    group = add(material, "Group")
    group.node_tree = tree
    material.node_tree.links.new(group.outputs[0], material.node_tree.get_output_node("ALL").inputs["Surface"])


def test_shaders_in_groups_and_their_transparency():
    names = ("BASE_COLOR", "ALPHA")
    inside = maps.bake_all_maps(*rusty(in_groups), maps=names, size=32)[1]
    plain = maps.bake_all_maps(*rusty(of_all_inputs), maps=names, size=32)[1]
    for name, texels in inside.items():
        assert np.abs(texels - plain[name]).max() < 1e-5


def test_samples_are_averaged_and_tiles_have_their_own():
    low, high = rusty(lambda material: feed(material, Base_Color=noise(material).outputs["Color"]))
    pixel = {"maps": ("BASE_COLOR",), "method": "CAST"}
    whole = maps.bake_all_maps(low, high, **pixel, size=64)[1]["base_color"]
    mean = whole.reshape(32, 2, 32, 2, 4).mean(axis=(1, 3))
    four = maps.bake_all_maps(low, high, **pixel, size=32, samples=4)[1]["base_color"]
    one = maps.bake_all_maps(low, high, **pixel, size=32)[1]["base_color"]
    assert np.abs(four - mean).mean() < 0.5 * np.abs(one - mean).mean()
    for corner in low.data.uv_layers[0].uv:
        corner.vector.x *= 2.0
    found = maps.raw_maps(low, high, **pixel, size=64, udim=True)
    both = np.concatenate([found[tile]["BASE_COLOR"][..., :3] for tile in (1001, 1002)], axis=1)
    assert np.abs(both.reshape(64, 64, 2, 3).mean(axis=2) - whole[..., :3]).mean() < 2.0 / 255.0


def test_packed_images_and_texture_sets_have_them():
    low, high = rusty(of_all_inputs)
    metallic = maps.bake_all_maps(low, high, maps=("METALLIC",), size=32)[1]["metallic"][..., 0]
    assert metallic.std() > 0.03
    report, _ = maps.bake_all_maps(low, high, maps=("METALLIC",), size=32, pack="CUSTOM", pack_green="METALLIC")
    packed = bpy.data.images[report.maps["packed"]["image"]]
    assert np.abs(maps.pixels(packed)[..., 1] - metallic).max() < 1e-5
    low.data.materials.append(bpy.data.materials.new("First"))
    maps.bake_all_maps(low, high, maps=("METALLIC",), size=32, texture_sets=True)
    assert np.abs(maps.pixels(bpy.data.images["map_metallic"])[..., 0] - metallic).max() < 1e-5


def test_nothing_remains_and_nothing_changes(monkeypatch):
    low, high = rusty(of_all_inputs)
    kinds = [name for name in dir(bpy.data) if isinstance(getattr(bpy.data, name), bpy.types.bpy_prop_collection)]

    def blocks():
        return {name: [(each.name, each.users) for each in getattr(bpy.data, name)] for name in kinds}

    before = blocks()
    maps.raw_maps(low, high, maps=("ROUGHNESS",), size=16)
    assert blocks() == before

    def fail(*_):
        raise BakeError("deleted")

    monkeypatch.setattr(cycles_values, "emitting", fail)
    with pytest.raises(BakeError, match="deleted"):
        maps.raw_maps(low, high, maps=("ROUGHNESS",), size=16)
    assert blocks() == before
    assert bpy.context.scene.render.engine != "CYCLES"


def test_off_leaves_them_out():
    report, found = maps.bake_all_maps(*rusty(of_all_inputs), maps=("BASE_COLOR",), size=16, exact_materials="OFF")
    assert not found["base_color"][..., :3].any()
    assert report.materials == {"Rust": {"Base Color": "NONE"}}
    assert any("Base Color is left out" in text for text in report.warnings)


@pytest.mark.parametrize(
    "words", [[], ["--workers", "1"], pytest.param(["--untrusted"], marks=untrusted.needs_sandbox)], ids=str
)
def test_a_shell_that_starts_blender_without_cycles_loads_it(tmp_path, words):
    low, high = rusty(lambda material: feed(material, Base_Color=noise(material).outputs["Color"]))
    truth = maps.bake_all_maps(low, high, maps=("BASE_COLOR",), size=16)[1]["base_color"]
    low.name, high.name = "a_low", "a_high"
    (tmp_path / "in").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "in" / "a.blend"), copy=True)
    path = tmp_path / "out" / "a.exr"
    command = [sys.executable, ROOT / "scripts" / "bake.py", "--", tmp_path / "in" / "a.blend", "--low", "a_low"]
    command += ["--high", "a_high", "--maps", "base-color", "--size", "16", "--margin", "0", "--output", path, *words]
    command += ["--output-folder", path.parent] if words == ["--untrusted"] else []
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    texels = maps.pixels(bpy.data.images.load(str(path.with_name("a_base_color.exr"))))[..., :3]
    assert texels.std() > 0.03
    assert np.abs(texels - truth[..., :3]).max() < 1e-3


def test_a_look_in_a_shell_counts_cycles(tmp_path):
    low, high = rusty(lambda material: feed(material, Base_Color=noise(material).outputs["Color"]))
    low.name, high.name = "a_low", "a_high"
    path = tmp_path / "a.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    words = ["check", path, "--low", "a_low", "--high", "a_high", "--maps", "base-color"]
    command = [sys.executable, ROOT / "scripts" / "bake.py", "--", *words]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    assert "Baked by Cycles: Base Color of 'Rust'" in done.stdout


def test_without_cycles_the_inputs_are_named(monkeypatch):
    monkeypatch.setattr(exact_nodes, "has_cycles", lambda: False)
    report, _ = maps.bake_all_maps(*rusty(of_all_inputs), maps=("BASE_COLOR",), size=16)
    assert report.materials == {"Rust": {"Base Color": "NONE"}}
    assert any("Cycles cannot bake it either: Cycles is not enabled" in text for text in report.warnings)


def test_generated_coordinates_are_those_before_deformation():
    low, high = rusty(lambda material: feed(material, Base_Color=add(material, "TexNoise").outputs["Color"]))
    straight = maps.bake_all_maps(low, high, maps=("BASE_COLOR",), size=16)[1]["base_color"]
    high.modifiers.new("bend", "SIMPLE_DEFORM").deform_method = "TWIST"
    twisted = maps.bake_all_maps(low, high, maps=("BASE_COLOR",), size=16)[1]["base_color"]
    assert np.abs(straight - twisted).max() < 1e-4
    high.modifiers.new("finer", "SUBSURF").subdivision_type = "SIMPLE"
    report = maps.bake_all_maps(low, high, maps=("BASE_COLOR",), size=16)[0]
    assert any("the generated coordinates of 'Plane.001' are not known" in text for text in report.warnings)


def test_instances_have_values_that_do_not_differ_between_them():
    low, high = rusty(lambda material: feed(material, Base_Color=noise(material).outputs["Color"]))
    plain = maps.bake_all_maps(low, high, maps=("BASE_COLOR",), size=16, method="CAST")[1]["base_color"]
    collection = bpy.data.collections.new("parts")
    collection.objects.link(high)
    bpy.context.scene.collection.objects.unlink(high)
    empty = bpy.data.objects.new("instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    bpy.context.scene.collection.objects.link(empty)
    shown = maps.bake_all_maps(low, empty, maps=("BASE_COLOR",), size=16, method="CAST")[1]["base_color"]
    assert np.abs(shown - plain).max() < 1e-5
    material = high.data.materials[0]
    noise_node = principled(material).inputs["Base Color"].links[0].from_node
    material.node_tree.links.new(add(material, "TexCoord").outputs["Object"], noise_node.inputs["Vector"])
    report = maps.bake_all_maps(low, empty, maps=("BASE_COLOR",), size=16, method="CAST")[0]
    assert any("differs between the instances of 'instance'" in text for text in report.warnings)
