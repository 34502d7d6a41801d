# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests files of scans: pages by any name, missing ones, coordinates far from the origin, vertex colors, and hints."""

import json
import os
import re
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.cli import baker, command, input_checks, run_report
from addon.cli.scene_files import SceneLoader
from addon.core.errors import BakeError
from addon.core.file_structure import far_points, mesh_references, obj_files, ply_files
from addon.core.file_structure.ply_files import Texture
from addon.core.preflight import EXACT_POINT, TEXTURE_PIXEL, TEXTURE_PIXEL_ON_GPU
from addon.core.settings import Settings
from addon.scene import imported_images
from addon.scene.importing import PLAIN, Space, import_file
from tests.support import angles, maps, random_cases, reports, scans
from tests.support.shader_nodes import add, principled

pytestmark = pytest.mark.usefixtures("gpu_context")


FAR = (512_345.0, 5_412_345.0, 312.0)
"""A place in meters as in maps of a country."""
SAME = 0.02
"""Degrees between normals of the same surface near the origin and far from it: the steps of six decimal digits."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, empty."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(capsys):
    """A function that runs a command. It returns the exit code and the text on standard error."""

    def run(*words):
        capsys.readouterr()
        code = command.run([str(word) for word in words])
        return code, capsys.readouterr().err

    return run


def pages_of(obj):
    """The image of each material slot: its file, and its color in the middle."""
    result = []
    for slot in obj.material_slots:
        (image,) = {node.image for node in slot.material.node_tree.nodes if node.type == "TEX_IMAGE"}
        result.append((Path(image.filepath).name, np.round(maps.pixels(image)[4, 4, :3], 2).tolist()))
    return result


# Pages

PROGRAMS = {
    "RealityCapture": ("scan.mtl", [f"scan_u{n}_v1_diffuse.png" for n in (1, 2, 3, 4)]),
    "Metashape": ("scan.mtl", [f"model{n}.png" for n in range(4)]),
    "Meshroom": ("texturedMesh.mtl", [f"texture_{1001 + n}.png" for n in range(4)]),
    "spaces": ("my scan.mtl", [f"my page {n}.png" for n in range(4)]),
}
SPELLINGS = {
    "as they are": lambda name: name,
    "another letter case": lambda name: name.upper(),
    "Windows": lambda name: f"C:\\Users\\me\\scans\\{name}",
    "another machine": lambda name: f"/home/me/scans/{name}",
    "a folder": lambda name: f".\\textures\\{name}",
    "quoted": lambda name: f'"{name}"',
}


@pytest.mark.parametrize(
    ("program", "spelling"), [*((each, "Windows") for each in PROGRAMS), *(("Metashape", each) for each in SPELLINGS)]
)
def test_pages_of_an_obj_are_found_by_any_spelling(folder, program, spelling):
    library, names = PROGRAMS[program]
    inner = folder / "textures" if spelling == "a folder" else folder
    inner.mkdir(exist_ok=True)
    for name, color in zip(names, scans.COLORS, strict=True):
        scans.texture(inner / name, color)
    materials = [f"material_{number}" for number in range(4)]
    said = {key: SPELLINGS[spelling](name) for key, name in zip(materials, names, strict=True)}
    scans.write_library(folder / library, said)
    spelled = library if spelling == "a folder" else SPELLINGS[spelling](library)
    scans.write_obj(folder / "scan.obj", scans.strips(4), materials=materials, library=spelled)
    (obj,) = import_file(folder / "scan.obj", PLAIN)
    assert scans.missing([obj]) == []
    found = dict(zip([slot.material.name for slot in obj.material_slots], pages_of(obj), strict=True))
    assert [found[key][0] for key in materials] == names
    for key, color in zip(materials, scans.COLORS, strict=True):
        assert np.abs(np.array(found[key][1]) - color).max() < 0.01


@pytest.mark.parametrize("ending", [".obj", ".glb", ".fbx"])
def test_no_page_is_in_memory_after_the_import(folder, ending):
    scans.texture(folder / "a.png", scans.COLORS[0])
    scans.write_library(folder / "scan.mtl", {"m": "a.png"})
    scans.write_obj(folder / "scan.obj", scans.strips(1), materials=["m"], library="scan.mtl")
    import_file(folder / "scan.obj", PLAIN)
    bpy.ops.export_scene.gltf(filepath=str(folder / "scan.glb"))
    bpy.ops.export_scene.fbx(filepath=str(folder / "scan.fbx"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    (obj,) = import_file(folder / f"scan{ending}", PLAIN)
    assert [image.has_data for image in bpy.data.images] == [False]
    assert np.abs(np.array(pages_of(obj)[0][1]) - scans.COLORS[0]).max() < 0.01


def test_pages_of_numbers_are_not_decoded_as_colors(folder):
    scans.texture(folder / "a.png", scans.COLORS[0])
    (folder / "scan.mtl").write_text("newmtl m\nmap_Kd a.png\nmap_Pr a.png\nmap_Bump a.png\n")
    scans.write_obj(folder / "scan.obj", scans.strips(1), materials=["m"], library="scan.mtl")
    (obj,) = import_file(folder / "scan.obj", PLAIN)
    nodes = obj.material_slots[0].material.node_tree.nodes
    links = {node.outputs[0].links[0].to_socket.name: node.image for node in nodes if node.type == "TEX_IMAGE"}
    is_data = {name: image.colorspace_settings.is_data for name, image in links.items()}
    assert is_data == {"Base Color": False, "Roughness": True, "Color": True}


@pytest.mark.parametrize("name", ["page_<UDIM>.png", "page_1001.png"])
def test_a_material_on_several_tiles_has_a_tiled_page(folder, name):
    for tile, color in zip((1001, 1002, 1011), scans.COLORS, strict=False):
        scans.texture(folder / f"page_{tile}.png", color)
    scans.write_library(folder / "scan.mtl", {"m": name})
    scans.write_obj(
        folder / "scan.obj",
        scans.strips(3),
        materials=["m"] * 3,
        library="scan.mtl",
        uv_offsets=[(0, 0), (1, 0), (0, 1)],
    )
    (obj,) = import_file(folder / "scan.obj", PLAIN)
    (image,) = bpy.data.images
    assert image.source == "TILED"
    assert [tile.number for tile in image.tiles] == [1001, 1002, 1011]
    assert scans.missing([obj]) == []
    (folder / "page_1002.png").unlink()
    assert [Path(path).name for path in scans.missing([obj])] == ["page_1002.png"]


def test_faces_on_tiles_without_a_page_are_told_where_tiles_can_be(folder):
    for tile, color in zip((1001, 1002), scans.COLORS, strict=False):
        scans.texture(folder / f"page_{tile}.png", color)
    scans.write_library(folder / "scan.mtl", {"m": "page_<UDIM>.png"})
    offsets = [(0, 0), (1, 0), (2, 0), (10, 0), (0, -1)]
    scans.write_obj(folder / "scan.obj", scans.strips(5), materials=["m"] * 5, library="scan.mtl", uv_offsets=offsets)
    objects = import_file(folder / "scan.obj", PLAIN)
    assert [Path(path).name for path in imported_images.missing_tiles(objects)] == ["page_1003.png"]


def test_a_material_for_each_tile_keeps_single_pages(folder):
    """As Meshroom writes them."""
    for number, tile in enumerate((1001, 1002)):
        scans.texture(folder / f"texture_{tile}.png", scans.COLORS[number])
    scans.write_library(folder / "scan.mtl", {f"m{tile}": f"texture_{tile}.png" for tile in (1001, 1002)})
    materials = ["m1001", "m1002"]
    scans.write_obj(
        folder / "scan.obj", scans.strips(2), materials=materials, library="scan.mtl", uv_offsets=[(0, 0), (1, 0)]
    )
    (obj,) = import_file(folder / "scan.obj", PLAIN)
    assert sorted(name for name, _ in pages_of(obj)) == ["texture_1001.png", "texture_1002.png"]


def test_a_page_with_options_of_another_program_keeps_its_path(folder):
    """Blender's importer takes an option that it does not know for a part of the name."""
    (folder / "o.mtl").write_text("newmtl m\nmap_Kd -colorspace sRGB -o 1 1 none.png\n")
    (folder / "o.obj").write_text("mtllib o.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n")
    import_file(folder / "o.obj", PLAIN)
    (image,) = bpy.data.images
    assert image.filepath == str(folder / "none.png")


def test_an_importer_that_fails_at_a_file_says_whose_fault_it_is(folder):
    mesh = {"primitives": [{"attributes": {"POSITION": 7}}]}
    nodes = {"scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
    (folder / "a.gltf").write_text(json.dumps({"asset": {"version": "2.0"}, "meshes": [mesh], **nodes}))
    with pytest.raises(BakeError) as refused:
        import_file(folder / "a.gltf", PLAIN)
    start = f"{str(folder / 'a.gltf')!r} could not be imported: it is damaged, or has something that Blender's importer does"
    assert re.fullmatch(re.escape(start) + r" not expect \(\w+Error: .*\)\.", str(refused.value))


@pytest.mark.parametrize("ending", [".gltf", ".fbx"])
def test_pages_of_other_formats_are_found_beside_the_file(folder, ending):
    (folder / "old").mkdir()
    scans.texture(folder / "old" / "A.png", scans.COLORS[0])
    scans.write_library(folder / "scan.mtl", {"m": "old/A.png"})
    scans.write_obj(folder / "scan.obj", scans.strips(1), materials=["m"], library="scan.mtl")
    import_file(folder / "scan.obj", PLAIN)
    if ending == ".fbx":
        bpy.ops.export_scene.fbx(filepath=str(folder / "scan.fbx"))
    else:
        bpy.ops.export_scene.gltf(filepath=str(folder / "scan.gltf"), export_format="GLTF_SEPARATE")
        (folder / "A.png").unlink()
    (folder / "old" / "A.png").rename(folder / "a.PNG")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    (obj,) = import_file(folder / f"scan{ending}", PLAIN)
    assert scans.missing([obj]) == []
    assert np.abs(np.array(pages_of(obj)[0][1]) - scans.COLORS[0]).max() < 0.01


# Missing pages

PAIR = ["--low-file", "low.obj", "--high-file", "scan.obj", "--size", "16", "--limit", "9", "--output", "m.png"]


@pytest.fixture
def incomplete(folder):
    """A low mesh, and a scan with four pages, of which two are missing."""
    scans.write_obj(folder / "low.obj", scans.strips(4))
    names = [f"page{number}.png" for number in range(4)]
    for name in names[:2]:
        scans.texture(folder / name, scans.COLORS[0])
    scans.write_library(folder / "scan.mtl", {f"m{number}": name for number, name in enumerate(names)})
    materials = [f"m{number}" for number in range(4)]
    scans.write_obj(folder / "scan.obj", scans.strips(4, height=0.1), materials=materials, library="scan.mtl")
    return folder


def test_missing_pages_are_an_error_if_a_map_shows_materials(incomplete, run, monkeypatch):
    monkeypatch.setattr("addon.cli.baker._baked", lambda *_: pytest.fail("it was baked"))
    code, err = run(*PAIR, "--maps", "ao,base-color")
    assert code == run_report.FAILED
    paths = ", ".join(repr(str(incomplete / f"page{number}.png")) for number in (2, 3))
    assert err == (
        f"imprint: 2 files of the high meshes' materials cannot be found: {paths}. Put them beside the mesh file, leave "
        "base-color out of the maps, or add --allow-missing-files.\n"
    )
    assert not (incomplete / "m.png").exists()


def test_a_packed_map_of_materials_needs_pages_too(incomplete, run):
    code, err = run(*PAIR, "--pack", "gltf")
    assert code == run_report.FAILED
    assert "leave roughness, metallic out of the maps" in err


def test_a_channel_of_smoothness_needs_the_pages_of_roughness(incomplete, run):
    channels = [word for color in ("red", "green", "blue") for word in (f"--pack-{color}", "one")]
    code, err = run(*PAIR, "--pack", "custom", *channels, "--pack-alpha", "smoothness")
    assert code == run_report.FAILED
    assert "leave roughness out of the maps" in err


def test_a_missing_library_is_named(incomplete, run):
    (incomplete / "scan.mtl").unlink()
    code, err = run(*PAIR, "--maps", "base-color")
    assert code == run_report.FAILED
    assert f"1 file of the high meshes' materials cannot be found: {str(incomplete / 'scan.mtl')!r}." in err


def test_missing_pages_do_not_matter_to_a_normal_map(incomplete, run):
    assert run(*PAIR) == (run_report.DONE, "")


# Far from the origin


def normals(folder, run, low, high, name):
    words = ["--size", "32", "--margin", "0", "--depth", "32", "--method", "cast", "--extrusion", "0.3"]
    words += ["--max-distance", "0.6", "--output", f"{name}.exr", "--report", f"{name}.json"]
    code, err = run("--low-file", low, "--high-file", high, *words)
    assert (code, err) == (run_report.DONE, "")
    image = bpy.data.images.load(str(folder / f"{name}.exr"))
    image.colorspace_settings.is_data = True
    return maps.pixels(image)


@pytest.mark.parametrize("ending", [".obj", ".ply"])
def test_a_scan_far_away_is_baked_as_one_at_the_origin(folder, run, ending):
    found = {}
    for name, place in (("near", (0.0, 0.0, 0.0)), ("far", FAR)):
        scans.write_obj(folder / f"{name}_low.obj", scans.strips(1, place), digits=7)
        points, uv, parts = scans.strips(1, place, height=0.1, n=60)
        scans.write_obj(folder / f"{name}_high.obj", (points, uv, parts), digits=7)
        scans.write_ply(folder / f"{name}_high.ply", points, np.concatenate(parts))
        found[name] = normals(folder, run, f"{name}_low.obj", f"{name}_high{ending}", name)
    assert (found["near"][..., 3] > 0).mean() > 0.98
    assert np.array_equal(found["near"][..., 3] > 0, found["far"][..., 3] > 0)
    both = found["near"][..., 3] > 0
    assert angles.degrees(angles.decode(found["near"]), angles.decode(found["far"]))[both].max() < SAME


def test_an_object_far_away_keeps_its_place(folder):
    points, uv, parts = scans.strips(1, FAR)
    scans.write_obj(folder / "scan.obj", (points, uv, parts))
    scans.write_ply(folder / "scan.ply", points, parts[0])
    for name in ("scan.obj", "scan.ply"):
        (obj,) = import_file(folder / name, PLAIN)
        coordinates = np.array([point.co for point in obj.data.vertices], np.float64)
        assert np.abs(coordinates).max() < 3.0
        turn = np.round(np.array(obj.matrix_world)[:3, :3])
        assert np.abs(coordinates @ turn.T + np.array(obj.location, np.float64) - points).max() < 1e-6


def test_coordinates_that_the_file_has_rounded_are_named(folder, run):
    scans.write_obj(folder / "low.obj", scans.strips(1, FAR))
    points, _, parts = scans.strips(1, FAR, height=0.1, n=20)
    scans.write_ply(folder / "scan.ply", points, parts[0], kind="float")
    code, err = run(*PAIR[:3], "scan.ply", *PAIR[4:], "--method", "cast", "--extrusion", "1", "--max-distance", "2")
    assert code == run_report.DONE
    assert "'scan' lies 5.41e+06 from its origin, where single precision rounds coordinates to 0.5." in err
    assert "'low' lies" not in err


def test_a_scan_can_be_moved_to_where_its_low_mesh_is(folder, run):
    scans.write_obj(folder / "low.obj", scans.strips(1))
    scans.write_obj(folder / "scan.obj", scans.strips(1, FAR, height=0.1, n=60))
    words = [*PAIR, "--method", "cast", "--report", "r.json"]
    code, err = run(*words)
    assert code == run_report.FAILED
    assert "do not overlap" in err
    assert "around (512345, 5.41234e+06, 312): they seem to be exported with different offsets. --origin" in err
    code, err = run(*words, "--origin", f"{FAR[0]},{FAR[2]},{-FAR[1]}")  # in the axes of the file
    assert (code, err) == (run_report.DONE, "")
    assert reports.one(folder / "r.json")["missed"] == 0.0


@pytest.mark.parametrize("value", ["1,2", "a,b,c", "1,2,inf", "-1,2,nan"])
def test_an_origin_is_three_numbers(run, value):
    code, err = run(*PAIR, "--origin", value)
    assert code == run_report.WRONG_USAGE
    assert "--origin" in err


# Units and axes


def test_other_units_explain_a_failed_bake(folder, run):
    scans.write_obj(folder / "low.obj", scans.strips(1))
    points, uv, parts = scans.strips(1, height=0.01, n=20)
    scans.write_obj(folder / "scan.obj", (points * 100.0 + [0.0, 0.0, 500.0], uv, parts))
    code, err = run(*PAIR, "--method", "cast")
    assert code == run_report.FAILED
    assert err.endswith("they seem to have different units. Export both with the same unit.\n")
    code, err = run(*PAIR, "--method", "flatten")
    assert code == run_report.DONE
    assert "units" not in err


SIDES = np.array([1.0, 0.5, 0.2])


def test_other_axes_explain_a_failed_bake_and_can_be_set(folder, run):
    points, uv, parts = scans.strips(1, height=1.0, n=20)
    scans.write_obj(folder / "low.obj", (points * SIDES, uv, parts))
    z_up = (points * SIDES)[:, [0, 2, 1]] * [1, -1, 1]
    scans.write_obj(folder / "scan.obj", (z_up, uv, parts))
    words = [*PAIR, "--method", "cast", "--report", "r.json", "--extrusion", "0.01", "--max-distance", "0.02"]
    _, err = run(*words)
    assert "turned by 90 degrees about X" in err
    assert "--high-up names the axis" in err
    code, err = run(*words, "--high-up", "z")
    assert code == run_report.DONE
    assert "turned" not in err
    assert reports.one(folder / "r.json")["missed"] == 0.0


def test_an_axis_is_for_a_high_file(folder, run):
    code, err = run(*PAIR[:2], "--output", "m.png", "--high-up", "z")
    assert (code, err) == (run_report.WRONG_USAGE, "imprint: --high-up is for --high-file. See --help.\n")
    code, err = run(*PAIR, "--high-up", "x")
    assert code == run_report.WRONG_USAGE
    assert "'x' is not one of y, z" in err


def test_a_far_scan_with_z_up_keeps_its_place(folder):
    points, uv, parts = scans.strips(1, FAR)
    scans.write_obj(folder / "scan.obj", (points[:, [0, 2, 1]] * [1, -1, 1], uv, parts))
    (obj,) = import_file(folder / "scan.obj", Space(up="Z"))
    coordinates = np.array([point.co for point in obj.data.vertices], np.float64)
    assert np.abs(coordinates + np.array(obj.location, np.float64) - points).max() < 1e-6


# Vertex colors


def test_vertex_colors_without_a_material_are_the_base_color(folder):
    points, _, parts = scans.strips(1)
    colors = np.random.default_rng(5).integers(0, 256, (len(points), 3), dtype=np.uint8)
    scans.write_ply(folder / "scan.ply", points, parts[0], colors=colors)
    (obj,) = import_file(folder / "scan.ply", PLAIN)
    (slot,) = obj.material_slots
    (link,) = [link for link in slot.material.node_tree.links if link.to_socket.name == "Base Color"]
    assert (link.from_node.type, link.from_node.layer_name) == (
        "VERTEX_COLOR",
        obj.data.color_attributes.active_color.name,
    )


def test_vertex_colors_do_not_replace_a_material(folder):
    points, uv, parts = scans.strips(1)
    scans.write_library(folder / "scan.mtl", {"m": "a.png"})
    scans.write_obj(folder / "scan.obj", (points, uv, parts), materials=["m"], library="scan.mtl")
    text = re.sub(r"^(v .*)$", r"\1 1 0 0", (folder / "scan.obj").read_text(), flags=re.MULTILINE)
    (folder / "scan.obj").write_text(text)
    (obj,) = import_file(folder / "scan.obj", PLAIN)
    assert obj.data.color_attributes.active_color is not None
    assert [slot.material.name for slot in obj.material_slots] == ["m"]


# Textured .ply


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_ply_with_uvs_by_face_shows_its_images(folder, form):
    points, uv, (quads,) = scans.strips(1)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    images = np.random.default_rng(6).integers(0, 2, len(faces))
    names = ["page 0.png", "page 1.png"]
    for name, color in zip(names, scans.COLORS, strict=False):
        scans.texture(folder / name, color)
    spelled = [f"C:\\me\\{name.upper()}" for name in names]
    scans.write_textured_ply(folder / "scan.ply", (points, faces, uv[faces]), images, spelled, form=form)
    (obj,) = import_file(folder / "scan.ply", PLAIN)
    assert [name for name, _ in pages_of(obj)] == names
    assert np.abs(np.array(pages_of(obj)[1][1]) - scans.COLORS[1]).max() < 0.01
    assert [polygon.material_index for polygon in obj.data.polygons] == images.tolist()
    found = np.array([entry.vector for entry in obj.data.uv_layers.active.uv])
    assert np.abs(found - uv[faces].reshape(-1, 2)).max() < 1e-6
    (folder / names[1]).unlink()
    assert scans.missing([obj]) == [str(folder / names[1])]


def test_a_ply_with_polygons_and_uvs_by_face_is_imported_without_them(folder):
    points, uv, (quads,) = scans.strips(1)
    faces = quads[:, :3]
    scans.write_textured_ply(folder / "scan.ply", (points, faces, uv[faces]), np.zeros(len(quads), int), ["a.png"])
    content = (folder / "scan.ply").read_bytes()
    (folder / "scan.ply").write_bytes(content.replace(b"texcoord", b"texxxxxx"))
    (obj,) = import_file(folder / "scan.ply", PLAIN)
    assert not obj.data.uv_layers
    assert not obj.material_slots


def test_uvs_by_face_are_left_out_where_the_faces_are_others(folder):
    points, uv, (quads,) = scans.strips(1)
    faces = quads[:, :3]
    scans.write_ply(folder / "scan.ply", points, faces)
    (obj,) = import_file(folder / "scan.ply", PLAIN)
    for corners in (faces[:, ::-1], faces[1:]):
        imported_images.show_texture(obj, Texture(["a.png"], uv[corners], corners, np.zeros(len(corners), int)), folder)
        assert not obj.data.uv_layers
        assert not obj.material_slots
    imported_images.show_texture(obj, Texture(["a.png"], uv[faces], faces, np.zeros(len(faces), int)), folder)
    assert len(obj.data.uv_layers) == len(obj.material_slots) == 1


# Memory


def test_the_report_has_the_memory_that_was_estimated(incomplete, run):
    assert run(*PAIR, "--report", "r.json") == (run_report.DONE, "")
    memory = reports.one(incomplete / "r.json")["memory"]
    assert set(memory) == {"needed", "on_gpu", "free"}
    assert 4e8 < memory["needed"] < 1e9
    assert memory["free"] > memory["needed"]


def test_a_lack_of_memory_is_said_before_the_bake(incomplete, run, monkeypatch, capsys):
    monkeypatch.setattr(input_checks, "free_bytes", lambda: 10**8)
    said = []
    monkeypatch.setattr("addon.cli.baker._baked", lambda *_: said.append(capsys.readouterr().err) or baker._Baked([]))
    run(*PAIR)
    assert said == ["imprint: low: The bake needs about 0.6 GB of memory, and 0.1 GB are free: close other programs.\n"]


def test_free_memory_is_part_of_the_machine():
    assert 10**8 < input_checks.free_bytes() <= os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def test_the_largest_page_counts_if_a_map_shows_it(incomplete):
    for name in ("page2.png", "page3.png"):
        scans.texture(incomplete / name, scans.COLORS[0], side=64)
    job = SceneLoader().job("low.obj", ["scan.obj"])
    pages = [input_checks.need_of(job, Settings(maps=maps)).texture for maps in ((), ("AO",), ("BASE_COLOR",))]
    assert pages == [0, 0, 64 * 64 * (TEXTURE_PIXEL + TEXTURE_PIXEL_ON_GPU)]
    assert not any(image.has_data for image in bpy.data.images)


def test_flatten_needs_no_tree_unless_more_than_the_normal_map_is_drawn(incomplete):
    job = SceneLoader().job("low.obj", ["scan.obj"])

    def tree(**settings):
        return input_checks.need_of(job, Settings(**settings)).tree

    assert tree(method="FLATTEN", detail_maps=False) == 0
    assert tree(method="FLATTEN", detail_maps=False, maps=("POSITION",)) > 0
    assert tree(method="FLATTEN", detail_maps=True) > 0
    assert tree(method="CAST") > 0


def test_cycles_needs_memory_for_materials_that_it_evaluates(incomplete):
    job = SceneLoader().job("low.obj", ["scan.obj"])
    material = job.highs[0].material_slots[0].material

    def exact(**settings):
        return input_checks.need_of(job, Settings(width=64, height=64, **settings)).exact

    assert exact(maps=("BASE_COLOR",)) == 0
    noise = add(material, "TexNoise")
    material.node_tree.links.new(noise.outputs["Color"], principled(material).inputs["Base Color"])
    assert exact(maps=("BASE_COLOR",)) == 64 * 64 * EXACT_POINT
    assert exact(maps=("BASE_COLOR",), exact_materials="OFF") == exact(maps=("ROUGHNESS",)) == exact() == 0


def test_modifiers_leave_the_size_of_a_mesh_open(incomplete):
    job = SceneLoader().job("low.obj", ["scan.obj"])
    job.highs[0].modifiers.new("Subdivision", "SUBSURF")
    assert input_checks.need_of(job, Settings()) is None


# Damaged files


@pytest.mark.parametrize("ending", [".obj", ".mtl"])  # Blender's importer of .ply crashes on some
@random_cases.seeds(12, fast=2)
def test_damaged_files_give_a_mesh_or_one_sentence_by_seed(folder, ending, seed):
    random = np.random.default_rng(seed)
    scans.texture(folder / "a.png", scans.COLORS[0])
    scans.write_library(folder / "scan.mtl", {"m0": "a.png", "m1": "b <UDIM>.png"})
    scans.write_obj(folder / "scan.obj", scans.strips(2, FAR), materials=["m0", "m1"], library="scan.mtl")
    scans.damage(folder / f"scan{ending}", random)
    try:
        meshes = import_file(folder / "scan.obj", PLAIN)
    except BakeError as error:
        assert str(error).endswith(".")
        assert "\n" not in str(error)
        return
    scans.missing(meshes)
    assert all(np.isfinite(np.array(obj.location)).all() for obj in meshes)


@pytest.mark.parametrize("name", ["scan.ply", "textured.ply"])
@random_cases.seeds(20, fast=2)
def test_damaged_ply_files_are_read_without_an_error_by_seed(folder, name, seed):
    random = np.random.default_rng(seed)
    points, uv, parts = scans.strips(1, FAR)
    faces = parts[0][:, :3]
    if name == "scan.ply":
        scans.write_ply(folder / name, points, faces)
    else:
        form = "ascii" if seed % 3 == 0 else "binary_big_endian"
        scans.write_textured_ply(
            folder / name, (points, faces, uv[faces]), np.zeros(len(faces), int), ["a.png"], form=form
        )
    scans.damage(folder / name, random)
    origin = far_points.far_origin(folder / name)
    if origin is not None:
        far_points.write_near(folder / name, folder / "near.ply", origin)
    found = ply_files.read_texture(folder / name)
    assert found is None or found.uv is None or found.uv.shape == (*found.corners.shape, 2)


# Scan colors


STEP = 1.5 / 255.0
"""An error of colors: pages and maps have 8 bits."""
SIDE = 32
WORDS = ["--size", SIDE, "--margin", "0", "--depth", "8", "--maps", "base-color", "--output", "m.png", "--limit", "9"]


@pytest.fixture
def home(tmp_path, monkeypatch):
    """The working folder, with a low mesh whose UVs fill the map."""
    monkeypatch.chdir(tmp_path)
    scans.write_obj(tmp_path / "low.obj", scans.strips(1))
    return tmp_path


@pytest.fixture
def colors(home, capsys):
    """A function that bakes files. It returns the base color map (SIDE, SIDE, 3), as stored, and the standard error."""

    def bake(high, *words, low="low.obj"):
        code = command.run([str(word) for word in ("--low-file", low, "--high-file", high, *WORDS, *words)])
        err = capsys.readouterr().err
        assert code == run_report.DONE, err
        image = bpy.data.images.load(str(home / "m_base_color.png"))
        image.colorspace_settings.is_data = True
        return maps.pixels(image)[..., :3], err

    return bake


def check_strips(found, expected):
    """Check the color in the middle of each strip along u."""
    width = SIDE // len(expected)
    for number, color in enumerate(expected):
        inside = found[4:-4, number * width + 2 : (number + 1) * width - 2]
        assert np.abs(inside - color).max() < STEP


@pytest.fixture
def paged(home):
    """A function that writes a scan with four pages, and returns its file's name."""

    def write(place=(0.0, 0.0, 0.0), missing=()):
        materials = [f"m{number}" for number in range(4)]
        for number, color in enumerate(scans.COLORS):
            if number not in missing:
                scans.texture(home / f"scan_u{number + 1}_v1_diffuse.png", color)
        said = {name: f"D:\\scans\\SCAN_u{number + 1}_v1_diffuse.png" for number, name in enumerate(materials)}
        scans.write_library(home / "scan.mtl", said)
        surface = scans.strips(4, place, height=0.02, n=16)
        scans.write_obj(home / "scan.obj", surface, materials=materials, library="scan.mtl")
        return "scan.obj"

    return write


@pytest.mark.parametrize("method", ["cast", "flatten"])
def test_each_page_shows_where_its_material_is(paged, colors, method):
    check_strips(colors(paged(), "--method", method)[0], scans.COLORS)


def test_a_far_scan_has_the_same_colors(home, paged, colors):
    scans.write_obj(home / "far.obj", scans.strips(1, FAR))
    check_strips(colors(paged(FAR), "--method", "cast", low="far.obj")[0], scans.COLORS)


def test_a_far_scan_of_several_objects(home, paged, colors):
    """As programs write them that cut large scans into parts."""
    scans.write_obj(home / "far.obj", scans.strips(1, FAR))
    scan = home / paged(FAR)
    scan.write_text(re.sub(r"^usemtl m(\d)", r"o part \1\nusemtl m\1", scan.read_text(), flags=re.MULTILINE))
    found, err = colors(scan, "--method", "cast", "--report", "r.json", low="far.obj")
    check_strips(found, scans.COLORS)
    assert err == ""
    assert reports.one(home / "r.json")["high"] == [f"part {number}" for number in range(4)]


def test_missing_pages_are_left_out_if_that_is_allowed(home, paged, colors):
    found, err = colors(paged(missing=[1]), "--method", "cast", "--allow-missing-files")
    (line,) = err.splitlines()
    assert line.startswith('imprint: warning: Material "m1": Base Color')
    assert str(home / "SCAN_u2_v1_diffuse.png") in line
    width = SIDE // 4
    for number in (0, 2, 3):
        inside = found[4:-4, number * width + 2 : (number + 1) * width - 2]
        assert np.abs(inside - scans.COLORS[number]).max() < STEP


def test_a_missing_library_is_named_once(home, paged, colors):
    name = paged()
    (home / "scan.mtl").unlink()
    _, err = colors(name, "--method", "cast", "--allow-missing-files")
    assert err == (
        f"imprint: warning: 1 file of the high meshes' materials cannot be found: {str(home / 'scan.mtl')!r}.\n"
    )


def test_embedded_images_of_a_glb(home, paged, colors):
    bpy.ops.wm.obj_import(filepath=str(home / paged()))
    for material in bpy.data.materials:
        for node in material.node_tree.nodes:
            if node.type == "TEX_IMAGE":
                number = int(node.image.filepath.split("_u")[1][0])
                node.image = bpy.data.images.load(str(home / f"scan_u{number}_v1_diffuse.png"))
    bpy.ops.export_scene.gltf(filepath=str(home / "scan.glb"))
    for page in home.glob("scan_u*"):
        page.unlink()
    check_strips(colors("scan.glb", "--method", "cast")[0], scans.COLORS)


def test_tiles_of_one_material(home, colors):
    for tile, color in zip((1001, 1002, 1011), scans.COLORS, strict=False):
        scans.texture(home / f"page_{tile}.png", color)
    scans.write_library(home / "scan.mtl", {"m": "page_1001.png"})
    offsets = [(0, 0), (1, 0), (0, 1)]
    surface = scans.strips(3, height=0.02, n=16)
    scans.write_obj(home / "scan.obj", surface, materials=["m"] * 3, library="scan.mtl", uv_offsets=offsets)
    found, _ = colors("scan.obj", "--method", "cast")
    for u, color in zip((4, 15, 26), scans.COLORS, strict=False):
        assert np.abs(found[4:-4, u] - color).max() < STEP


def test_vertex_colors_of_a_ply(home, colors):
    """They are stored as sRGB, and are linear in the file's coordinates where they do not differ."""
    points, _, parts = scans.strips(2, height=0.02, n=16)
    stored = np.array([230, 26, 51]), np.array([51, 204, 26])
    values = np.where(points[:, :1] < -0.1, *stored).astype(np.uint8)
    scans.write_ply(home / "scan.ply", points, np.concatenate(parts), colors=values)
    found, _ = colors("scan.ply", "--method", "cast", "--high-up", "z")
    assert np.abs(found[4:-4, 2:12] * 255.0 - stored[0]).max() < 255.0 * STEP
    assert np.abs(found[4:-4, 18:-2] * 255.0 - stored[1]).max() < 255.0 * STEP


def test_a_ply_with_an_image_and_uvs_by_face(home, colors):
    points, uv, parts = scans.strips(2, height=0.02, n=16)
    faces = np.concatenate([quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3) for quads in parts])
    images = np.repeat([0, 1], len(faces) // 2)
    for number in range(2):
        scans.texture(home / f"page{number}.png", scans.COLORS[number])
    scans.write_textured_ply(home / "scan.ply", (points, faces, uv[faces]), images, ["page0.png", "page1.png"])
    check_strips(colors("scan.ply", "--method", "cast")[0], scans.COLORS[:2])


# Obj materials


@pytest.fixture
def room(tmp_path):
    for name in ("a.png", "b c.png", "-odd.png", "s 1 2.png"):
        (tmp_path / name).write_bytes(b"page")
    return tmp_path


def read(room, library, head="mtllib m.mtl\n"):
    """The lines of the library that the importer gets, and the names of the images' files by placeholder."""
    (room / "m.mtl").write_bytes(library.encode() if isinstance(library, str) else library)
    (room / "scan.obj").write_text(head + "v 0 0 0\n")
    found = obj_files.read_materials(room / "scan.obj")
    files = {name: page.path.name if page.path else page.name for name, page in found.placeholders.items()}
    return found.content.decode(errors="surrogateescape").splitlines(), files


IMAGES = {
    "map_Kd a.png": ("map_Kd", "a.png"),
    "  map_Kd   b c.png": ("map_Kd", "b c.png"),
    "map_Kd\tA.PNG": ("map_Kd", "a.png"),
    "map_Bump -bm 0.5 b c.png": ("map_Bump -bm 0.5", "b c.png"),
    "map_Kd -s 1 2 3 -clamp on a.png": ("map_Kd -s 1 2 3", "a.png"),
    "map_Kd -colorspace sRGB -o 1 2 b c.png": ("map_Kd -o 1 2", "b c.png"),
    "map_Kd -blendu on -odd none.png": ("map_Kd", "none.png"),
    "map_Kd -s": ("map_Kd", "-s"),
    "refl -type sphere a.png": ("refl -type sphere", "a.png"),
    "map_Kd -o 0.5 a.png": ("map_Kd -o 0.5", "a.png"),
    "map_Kd -odd.png": ("map_Kd", "-odd.png"),
    'map_Kd "b c.png"': ("map_Kd", "b c.png"),
    "norm C:\\scans\\a.png": ("norm", "a.png"),
}


@pytest.mark.parametrize("line", IMAGES)
def test_the_image_of_a_line_is_found_after_its_options(room, line):
    (first, second, *_), files = read(room, f"newmtl x\n{line}\n")
    ((placeholder, name),) = files.items()
    assert first == "newmtl x"
    assert (second, name) == (f"{IMAGES[line][0]} {placeholder}", IMAGES[line][1])


@pytest.mark.parametrize("line", IMAGES)
def test_planning_knows_the_files_that_the_importer_gets(room, line):
    """But for other spellings, which are looked for when the file is imported."""
    _, files = read(room, f"newmtl x\n{line}\n")
    known = {path.name.lower() for path in mesh_references.of(str(room / "scan.obj"))}
    assert {"m.mtl", *(name.lower() for name in files.values())} <= known


def test_planning_reads_no_points(room):
    names = "mtllib m.mtl\n", "mtllib other.mtl\n"
    points = "v 1 2 3\n" * 100
    for head, expected in ((names[0] + points + names[1], ["m.mtl", "other.mtl"]), (points + names[1], [])):
        (room / "scan.obj").write_text(head)
        assert obj_files.libraries(room / "scan.obj", is_whole=False) == expected


@pytest.mark.parametrize("name", ["/", ".", "..", '""', "-clamp on ./"])
def test_a_line_that_names_no_image_is_left_out(room, name):
    assert read(room, f"newmtl x\nmap_Kd {name}\n") == (["newmtl x", ""], {})


def test_other_lines_stay_byte_by_byte(room):
    lines, files = read(room, b"\xef\xbb\xbfnewmtl na\xefve\r\nKd 0.5 0.5 0.5\r\n\r\n# map_Kd a.png\r\nmap_Kd\r\n")
    assert lines == ["newmtl na\udcefve", "Kd 0.5 0.5 0.5", "", "# map_Kd a.png", "map_Kd"]
    assert files == {}


def test_a_page_of_several_materials_has_one_placeholder_for_each_use(room):
    """An image that is used as a color and as numbers is decoded in two ways."""
    library = (
        "newmtl x\nmap_Kd a.png\nnewmtl y\nmap_kd A.png\nmap_Pr a.png\nnewmtl z\nmap_Kd none.png\nmap_Kd ./none.png\n"
    )
    (room / "m.mtl").write_text(library)
    (room / "scan.obj").write_text("mtllib m.mtl\n")
    pages = obj_files.read_materials(room / "scan.obj").placeholders.values()
    assert [(page.name, page.is_color, page.path is None) for page in pages][:2] == [
        ("a.png", True, False),
        ("a.png", False, False),
    ]
    assert {page.name for page in pages if page.path is None} == {"none.png", "./none.png"}


LIBRARIES = {
    "mtllib m.mtl\n": [],
    "# a comment about mtllib none.mtl\nmtllib M.MTL\n": [],
    "mtllib C:\\scans\\m.mtl\n": [],
    "mtllib m.mtl m.mtl\n": [],
    "mtllib none.mtl\nmtllib m.mtl\n": ["none.mtl"],
    "mtllib\n": [],
    "": [],
}


@pytest.mark.parametrize("head", LIBRARIES)
def test_missing_libraries_are_named(room, head):
    lines, _ = read(room, "newmtl x\n", head)
    assert obj_files.missing_libraries(room / "scan.obj") == LIBRARIES[head]
    assert lines == (["newmtl x"] if "m.mtl" in head.lower().replace("none.mtl", "") else [])


def test_a_library_with_the_name_of_the_obj_counts(room):
    """As in Blender's importer."""
    (room / "SCAN.mtl").write_text("newmtl own\n")
    assert read(room, "newmtl x\n", "mtllib none.mtl\n")[0] == ["newmtl own"]
    assert obj_files.missing_libraries(room / "scan.obj") == []
    (room / "scan.mtl").write_text("newmtl own\nmap_Kd own.png\n")
    assert room / "own.png" in mesh_references.of(str(room / "scan.obj"))


def test_a_library_is_found_far_into_a_large_file(room):
    head = "v 1 2 3\n" * 100_000
    assert read(room, "newmtl x\n", f"{head}mtllib m.mtl\n{head}")[0] == ["newmtl x"]


@random_cases.seeds(20, fast=2)
def test_random_libraries_never_fail_by_seed(room, seed):
    random = np.random.default_rng(seed)
    words = [
        "newmtl",
        "map_Kd",
        "norm",
        "-bm",
        "-s",
        "1",
        "a.png",
        "none.png",
        "\\",
        '"',
        "\t",
        "\0",
        "\r",
        "é",
        "<UDIM>",
    ]
    text = "".join(" \n"[int(random.integers(8) == 0)] + words[random.integers(len(words))] for _ in range(400))
    content, files = read(room, text.encode("latin1" if seed % 2 else "utf-8"))
    assert len([line for line in content if "imprint-image-" in line]) >= len(files)


@pytest.mark.skipif(not os.path.exists("/proc/self/mem"), reason="the files of Linux about processes")
def test_a_library_that_cannot_be_read_is_named_nevertheless(room):
    """So that planning can refuse it."""
    (room / "scan.obj").write_text("mtllib m.mtl\nmtllib /proc/self/mem\nv 0 0 0\n")
    (room / "m.mtl").write_text("newmtl x\nmap_Kd a.png\n")
    found = list(mesh_references.of(str(room / "scan.obj")))
    assert {Path("/proc/self/mem"), room / "a.png"} <= set(found)
