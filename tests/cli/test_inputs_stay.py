# SPDX-License-Identifier: GPL-3.0-or-later
"""A bake that would write over anything that it or another bake of the call reads is refused before the first write."""

import json
import os
import shutil
from pathlib import Path

import bpy
import pytest

from addon.cli import command, run_report
from tests.support import zoo

pytestmark = [
    pytest.mark.usefixtures("gpu_context"),
    pytest.mark.skipif(os.name == "nt", reason="links of POSIX"),
]

COLOR = ["--maps", "base-color", "--no-normal"]
"""Writes rock_base_color.png where rock.png is named."""
CASES = {}
"""By its name, what makes the files of a case in the working folder and returns the arguments."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def case(make):
    CASES[make.__name__.replace("_", " ")] = make
    return make


def save(path, value=0.25):
    """A file of an image."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    image = bpy.data.images.new("saved", 4, 4)
    image.pixels.foreach_set([value] * 64)
    image.filepath_raw, image.file_format = os.path.abspath(path), "PNG"
    image.save()
    bpy.data.images.remove(image)
    return path


def image_of(path, *, source="FILE"):
    """An image of the scene that names a file."""
    image = bpy.data.images.new(os.path.basename(path), 4, 4)
    image.source = source
    image.filepath = path if path.startswith("//") else os.path.abspath(path)
    return image


def show(obj, image):
    """Give an object a material of its own that shows an image as its Base Color. Returns the material."""
    material = bpy.data.materials.new(f"{obj.name} material")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = image
    shader = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    material.node_tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    obj.data.materials.append(material)
    return material


def pair(name="rock"):
    return zoo.plane(f"{name}_low"), zoo.plane(f"{name}_high", n=2, slope=0.1)


def stored(path="s.blend"):
    bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath(path), check_existing=False, relative_remap=False)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return path


def textured(path="tex/rock_base_color.png", at=None, **options):
    """A scene whose high object shows the file at `path`. at: how the scene names it."""
    _, high = pair()
    save(path)
    show(high, image_of(at or path, **options))
    return stored()


def bake(output, *more, scene="s.blend", name="rock"):
    words = [
        scene,
        "--low",
        f"{name}_low",
        "--high",
        f"{name}_high",
        "--output",
        output,
        "--size",
        "16",
        "--limit",
        "9",
    ]
    return [*words, "--no-material", *more]


def files_of(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


# Textures of the high object


@case
def a_texture(folder):
    textured()
    return bake("tex/rock.png", *COLOR)


@case
def a_relative_texture(folder):
    textured(at="//tex/rock_base_color.png")
    return bake(str(folder / "tex" / "rock.png"), *COLOR)


@case
def a_path_with_two_dots(folder):
    textured(at="//out/../tex/rock_base_color.png")
    return bake("out/../tex/rock.png", *COLOR)


@case
def letters_of_another_case(folder):
    textured("tex/ROCK_Base_Color.PNG")
    return bake("tex/rock.png", *COLOR)


@case
def a_link_to_the_texture(folder):
    textured()
    (folder / "out").mkdir()
    (folder / "out/rock_base_color.png").symlink_to("../tex/rock_base_color.png")
    return bake("out/rock.png", *COLOR)


@case
def a_texture_that_is_a_link(folder):
    save("out/rock_base_color.png")
    (folder / "tex").mkdir()
    (folder / "tex/skin.png").symlink_to("../out/rock_base_color.png")
    _, high = pair()
    show(high, image_of("tex/skin.png"))
    stored()
    return bake("out/rock.png", *COLOR)


@case
def a_hard_link(folder):
    textured()
    (folder / "out").mkdir()
    os.link("tex/rock_base_color.png", "out/rock_base_color.png")
    return bake("out/rock.png", *COLOR)


@case
def a_folder_that_is_a_link(folder):
    textured()
    (folder / "out").symlink_to("tex")
    return bake("out/rock.png", *COLOR)


@case
def a_texture_in_groups(folder):
    _, high = pair()
    inner, outer = (bpy.data.node_groups.new(name, "ShaderNodeTree") for name in ("inner", "outer"))
    inner.nodes.new("ShaderNodeTexImage").image = image_of(save("tex/rock_base_color.png"))
    outer.nodes.new("ShaderNodeGroup").node_tree = inner
    material = show(high, None)
    material.node_tree.nodes.new("ShaderNodeGroup").node_tree = outer
    stored()
    return bake("tex/rock.png", *COLOR)


@case
def tiles_over_tiles(folder):
    save("tex/rock_base_color.1001.png")
    textured("tex/rock_base_color.1002.png", "tex/rock_base_color.<UDIM>.png", source="TILED")
    return bake("tex/rock.<UDIM>.png", *COLOR)


@case
def a_map_over_a_tile(folder):
    save("tex/rock_1001.png")
    textured("tex/rock_1002.png", "tex/rock_<UDIM>.png", source="TILED")
    return bake("tex/rock_1001.png")


@case
def tiles_over_a_texture(folder):
    textured("tex/rock_1001.png")
    return bake("tex/rock_<UDIM>.png")


@case
def a_frame_of_a_sequence(folder):
    save("tex/rock_0002.png")
    textured("tex/rock_0001.png", source="SEQUENCE")
    return bake("tex/rock_####.png", "--frames", "2-3")


@case
def the_texture_of_a_normal_map(folder):
    _, high = pair()
    material = show(high, None)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture, turn = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeNormalMap")
    texture.image = image_of(save("tex/rock.png"))
    links.new(texture.outputs["Color"], turn.inputs["Color"])
    links.new(turn.outputs["Normal"], next(node for node in nodes if node.type == "BSDF_PRINCIPLED").inputs["Normal"])
    stored()
    return bake("tex/rock.png")


@case
def a_texture_that_this_map_does_not_show(folder):
    textured()
    return bake("tex/rock_base_color.png")


@case
def a_texture_of_a_shared_material(folder):
    low, high = pair()
    low.data.materials.append(show(high, image_of(save("tex/rock_base_color.png"))))
    stored()
    return bake("tex/rock.png", *COLOR)


@case
def a_map_of_an_earlier_bake_that_the_high_object_shows(folder):
    _, high = pair()
    image = image_of(save("tex/rock_base_color.png"))
    image["imprint_high"] = "sculpt"
    show(high, image)
    stored()
    return bake("tex/rock.png", *COLOR)


@case
def a_texture_of_a_library(folder):
    (folder / "lib").mkdir()
    _, high = pair("far")
    save("lib/rock_base_color.png")
    show(high, image_of("//rock_base_color.png"))
    stored("lib/lib.blend")
    pair()
    with bpy.data.libraries.load(str(folder / "lib/lib.blend"), link=True) as (_, linked):
        linked.objects = ["far_high"]
    bpy.context.scene.collection.objects.link(linked.objects[0])
    stored()
    return [*bake("lib/rock.png", *COLOR), "--high", "far_high"]


# Other files of the scene


@case
def an_image_that_shapes_the_high_object(folder):
    _, high = pair()
    texture = bpy.data.textures.new("shape", "IMAGE")
    texture.image = image_of(save("tex/rock.png"))
    high.modifiers.new("Displace", "DISPLACE").texture = texture
    stored()
    return bake("tex/rock.png")


@case
def an_image_of_geometry_nodes(folder):
    _, high = pair()
    tree = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    tree.nodes.new("GeometryNodeImageTexture").inputs["Image"].default_value = image_of(save("tex/rock.png"))
    high.modifiers.new("Nodes", "NODES").node_group = tree
    stored()
    return bake("tex/rock.png")


@case
def a_cache(folder):
    _, high = pair()
    (folder / "high.mdd").write_bytes(bytes(64))
    modifier = high.modifiers.new("Cache", "MESH_CACHE")
    modifier.cache_format, modifier.filepath = "MDD", str(folder / "high.mdd")
    stored()
    (folder / "rock.png").symlink_to("high.mdd")
    return bake("rock.png")


@case
def a_font(folder):
    found = next(Path(bpy.utils.system_resource("DATAFILES", path="fonts")).glob("*.woff2"))
    shutil.copyfile(found, folder / "font.woff2")
    pair()
    curve = bpy.data.curves.new("text", "FONT")
    curve.body, curve.extrude, curve.font = "A", 0.1, bpy.data.fonts.load(str(folder / "font.woff2"))
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("text", curve))
    stored()
    os.link("font.woff2", "rock.png")
    return [*bake("rock.png"), "--high", "text"]


@case
def a_linked_library(folder):
    zoo.plane("far_high")
    stored("lib.blend")
    pair()
    with bpy.data.libraries.load(str(folder / "lib.blend"), link=True) as (_, linked):
        linked.objects = ["far_high"]
    bpy.context.scene.collection.objects.link(linked.objects[0])
    stored()
    return [*bake("rock.png", "--save-blend", "lib.blend"), "--high", "far_high"]


@case
def the_scene_by_a_link(folder):
    textured()
    (folder / "rock.png").symlink_to("s.blend")
    return bake("rock.png")


@case
def the_texture_of_the_cage(folder):
    pair()
    cage = zoo.plane("rock_cage")
    texture = bpy.data.textures.new("shape", "IMAGE")
    texture.image = image_of(save("tex/rock.png"))
    cage.modifiers.new("Displace", "DISPLACE").texture = texture
    stored()
    return bake("tex/rock.png", "--cage", "rock_cage", "--method", "cast")


# What else a bake writes


@case
def a_report(folder):
    textured()
    (folder / "r.json").symlink_to("tex/rock_base_color.png")
    return bake("rock.png", "--report", "r.json")


@case
def a_page(folder):
    textured()
    os.link("tex/rock_base_color.png", "s.html")
    return bake("rock.png", "--sheet", "s.html")


@case
def the_report_of_all(folder):
    textured()
    (folder / "r.json").symlink_to("tex/rock_base_color.png")
    return [*job_file(scene_set("rock.png")), "--report", "r.json"]


@case
def a_saved_scene(folder):
    textured()
    os.link("tex/rock_base_color.png", "out.blend")
    return bake("rock.png", "--save-blend", "out.blend")


@case
def a_file_for_an_engine(folder):
    textured()
    os.link("tex/rock_base_color.png", "rock.glb")
    return bake("rock.png", "--export", "rock.glb")


@case
def a_texture_beside_a_file_for_an_engine(folder):
    textured("out/textures/rock_rock_low_normal.png")
    return bake("rock.png", "--export", "out/rock.usda")


@case
def a_mip_level(folder):
    textured("tex/rock_mip2.png")
    return bake("tex/rock.png", "--mip-files")


@case
def a_packed_map(folder):
    textured("tex/rock_orm.png")
    return bake("tex/rock.png", "--pack", "gltf")


@case
def a_texture_set(folder):
    low, high = pair()
    for name in ("bark", "leaf"):
        low.data.materials.append(bpy.data.materials.new(name))
    show(high, image_of(save("tex/rock_bark.png")))
    stored()
    return bake("tex/rock_{material}.png", "--texture-sets")


@case
def a_mask(folder):
    textured("tex/rock_missed.png")
    return bake("tex/rock.png", "--mask")


@case
def a_level_of_detail(folder):
    (high,) = [zoo.terrain("rock", n=8)]
    save("tex/rock_LOD1.png")
    show(high, image_of("tex/rock_LOD1.png"))
    stored()
    return ["lod", "s.blend", "--low", "rock", "--degrees", "20", "--output", "tex/{low}.png", "--size", "16"]


@case
def a_record(folder):
    textured()
    os.link("tex/rock_base_color.png", "rock.png.imprint.json")
    return bake("rock.png", "--resume")


@case
def a_bake_that_can_go_on(folder):
    textured()
    return bake("tex/rock.png", *COLOR, "--resume")


@case
def an_untrusted_file(folder):
    textured()
    return bake("tex/rock.png", *COLOR, "--untrusted", "--input-folder", ".", "--output-folder", "tex")


@case
def all_pairs(folder):
    textured()
    pair_words = ["s.blend", "--pairs", "--output", "tex/rock.png", "--size", "16", "--limit", "9", *COLOR]
    return [*pair_words, "--no-material"]


@case
def a_converted_map(folder):
    textured("tex/rock_1001.png")
    save("tex/rock_1002.png")
    words = ["s.blend", "--low", "rock_low", "--convert", "tex/rock_<UDIM>.png", "--output", "tex/rock_1001.png"]
    return [*words, "--space", "object", "--no-material"]


# Mesh files


def written(name, texture=None):
    """An .obj with a material that shows a file."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    obj = zoo.plane(name, n=2, slope=0.1)
    if texture:
        show(obj, image_of(save(texture)))
    bpy.ops.wm.obj_export(filepath=os.path.abspath(f"{name}.obj"), path_mode="RELATIVE")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return f"{name}.obj"


def of_files(output, *more):
    words = ["--low-file", "low.obj", "--high-file", "high.obj", "--output", output, "--size", "16", "--limit", "9"]
    return [*words, *more]


@case
def the_texture_of_a_mesh_file(folder):
    written("low"), written("high", "tex/rock_base_color.png")
    return of_files("tex/rock.png", *COLOR)


@case
def the_materials_of_a_mesh_file(folder):
    written("low"), written("high", "tex/skin.png")
    (folder / "rock.png").symlink_to("high.mtl")
    return of_files("rock.png")


@case
def a_mesh_file(folder):
    written("low"), written("high")
    os.link("high.obj", "rock.glb")
    return of_files("rock.png", "--export", "rock.glb")


# Other bakes of the call


def job_file(*sets, name="jobs.json"):
    common = {"size": 16, "limit": 9, "no-material": True}
    Path(name).write_text(json.dumps({"bake": [common | each for each in sets]}))
    return ["--jobs", name]


def scene_set(output, *, scene="s.blend", name="rock", **more):
    return {"file": scene, "low": f"{name}_low", "high": f"{name}_high", "output": output, **more}


@case
def the_job_file(folder):
    textured()
    words = job_file(scene_set("rock.png"))
    (folder / "rock.png").symlink_to("jobs.json")
    return words


@case
def the_texture_of_the_mesh_file_of_a_later_set(folder):
    written("low"), written("high", "tex/rock.png")
    first = {"low-file": "low.obj", "high-file": "low.obj", "output": "tex/rock.png"}
    return job_file(first, {"low-file": "low.obj", "high-file": "high.obj", "output": "out/b.png"})


@case
def the_texture_of_the_scene_of_a_later_set(folder):
    textured("tex/tree.png")
    os.rename("s.blend", "rock.blend")
    pair("tree")
    stored()
    return job_file(scene_set("tex/tree.png", name="tree"), scene_set("out/rock.png", scene="rock.blend"))


@case
def the_texture_of_the_library_of_a_later_set(folder):
    a_texture_of_a_library(folder)
    os.rename("s.blend", "rock.blend")
    pair("tree")
    stored()
    later = scene_set("out/rock.png", scene="rock.blend") | {"high": "far_high"}
    return job_file(scene_set("lib/rock_base_color.png", name="tree"), later)


@case
def the_texture_of_a_later_set_of_the_same_scene(folder):
    pair("tree")
    textured("tex/tree.png")
    return job_file(scene_set("tex/tree.png", name="tree"), scene_set("out/rock.png"))


@case
def the_texture_of_an_earlier_set_of_the_same_scene(folder):
    pair("tree")
    textured("tex/tree.png")
    return job_file(scene_set("tex/rock.png"), scene_set("tex/tree.png", name="tree"))


@case
def the_report_of_a_set(folder):
    textured()
    (folder / "r.json").symlink_to("tex/rock_base_color.png")
    return job_file(scene_set("rock.png", report="r.json"))


OTHERS = {"the texture of an earlier set of the same scene"}
"""Cases in which another bake of the call harms nothing, and is done."""


@pytest.mark.parametrize("name", CASES)
def test_what_a_bake_reads_is_not_overwritten(folder, capsys, name):
    words = CASES[name](folder)
    before = files_of(folder)
    assert command.run(words) in {run_report.FAILED, run_report.WRONG_USAGE}
    after = files_of(folder)
    assert {path: after.get(path) for path in before} == before
    assert name in OTHERS or set(after) == set(before)
    assert "would overwrite" in capsys.readouterr().err


def test_so_many_ways_are_held():
    assert len(CASES) >= 40


RIGHT = {
    "a map of an earlier bake of the low object": ["tex/low.png"],
    "a packed texture, whose file is not read": ["tex/packed.png"],
    "a texture of the low object alone": ["tex/own.png"],
    "a texture of another object": ["tex/other.png"],
}


@pytest.mark.parametrize("name", RIGHT)
def test_what_no_bake_reads_may_be_replaced(folder, name):
    low, high = pair()
    own = image_of(save("tex/low.png"))
    own["imprint_high"] = "rock_high"
    low.data.materials.append(show(high, own))
    show(low, image_of(save("tex/own.png")))
    packed = image_of(save("tex/packed.png"))
    packed.pack()
    show(high, packed)
    show(zoo.plane("other"), image_of(save("tex/other.png")))
    stored()
    assert command.run(bake(*RIGHT[name])) == 0


def test_sets_of_a_scene_that_names_their_maps_are_baked_again(folder):
    for name in ("rock", "tree"):
        low, _ = pair(name)
        show(low, image_of(save(f"tex/{name}.png")))
    stored()
    words = job_file(*(scene_set(f"tex/{name}.png", name=name) for name in ("rock", "tree")))
    assert command.run(words) == 0
    assert command.run(words) == 0
