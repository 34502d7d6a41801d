# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the names, paths and depths of the maps beside the normal map."""

import pytest

from addon.core import naming
from addon.core.declarations.targets import CHOICES, TARGETS
from addon.core.map_types import BY_NAME
from addon.core.settings import Settings, StorageSettings
from addon.output import map_names
from addon.output.map_names import settings_by_map


def beside(name, **settings):
    settings = {"image": "rock_normal", "storage": "FILE", "output": "maps/rock.png", "depth": 16, **settings}
    return map_names.beside(Settings(**settings), BY_NAME[name])


@pytest.mark.parametrize(
    ("name", "expected"),
    {
        "AO": "rock_ambient_occlusion",
        "BENT_NORMAL": "rock_bent_normals_base",
        "CURVATURE": "rock_curvature",
        "HEIGHT": "rock_height_base",
        "MATERIAL_ID": "rock_id",
        "ALPHA": "rock_opacity_base",
        "POSITION": "rock_position",
        "THICKNESS": "rock_thickness",
        "ROUGHNESS": "rock_roughness",
    }.items(),
)
def test_substance_painter_finds_its_mesh_maps_by_their_names(name, expected):
    """As its manual lists them: helpx.adobe.com/substance-3d-painter, Mesh Map."""
    assert beside(name, image="rock_normal_base").storing.image == expected
    tiles = beside(name, storage="FILE", output="rock_normal_base.<UDIM>.png").storing.output
    assert tiles == f"{expected}.<UDIM>.png"
    assert CHOICES["Substance 3D"].names.format(name="rock") == "rock_normal_base"


def test_a_map_is_named_by_its_suffix():
    found = beside("HEIGHT")
    assert (found.storing.image, found.storing.output.replace("\\", "/")) == ("rock_height", "maps/rock_height.png")


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        ("rock_normal.png", "rock_height.png"),
        ("Rock.Normal.png", "Rock_height.png"),
        ("normal.png", "normal_height.png"),
        ("rock_ddn.tif", "rock_height.tif"),
        ("T_rock_N.png", "T_rock_H.png"),
        ("Wall_N.png", "Wall_N_height.png"),
        ("T_rock_n.png", "T_rock_n_height.png"),
        ("T_rockN.png", "T_rockN_height.png"),
    ],
)
def test_the_suffix_takes_the_place_of_normal(output, expected):
    assert beside("HEIGHT", output=output).storing.output == expected


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        ("a.<UDIM>.exr", "a_height.<UDIM>.exr"),
        ("a_<UDIM>.png", "a_height_<UDIM>.png"),
        ("a_normal_<UDIM>_1.png", "a_height_<UDIM>_1.png"),
        ("T_a_N.<UDIM>.png", "T_a_H.<UDIM>.png"),
    ],
)
def test_the_number_of_the_tile_stays_at_the_end(output, expected):
    assert beside("HEIGHT", output=output, udim=True).storing.output == expected


@pytest.mark.parametrize(
    ("name", "image"), [("BASE_COLOR", "T_rock_BC"), ("AO", "T_rock_AO"), ("THICKNESS", "T_rock_thickness")]
)
def test_names_of_unreal_have_short_suffixes_where_there_are_usual_ones(name, image):
    assert beside(name, image="T_rock_N").storing.image == image


def test_the_packed_image_of_unreal_has_its_short_suffix():
    settings = Settings(image="T_rock_N", pack="UNREAL")
    assert map_names.beside(settings, settings.map.packing.map_type).storing.image == "T_rock_ORM"


def test_short_suffixes_are_distinct():
    short = [one.short_suffix for one in BY_NAME.values() if one.short_suffix]
    assert len({*short, "N"}) == len(short) + 1


@pytest.mark.parametrize("names", dict.fromkeys(target.names for target in TARGETS))
def test_the_suffix_takes_the_place_of_the_ending_of_each_preset(names):
    name = naming.fill_low(names, "rock")
    assert beside("THICKNESS", image=name).storing.image == f"{name.removesuffix('_base').rpartition('_')[0]}_thickness"


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("", ""),
        ("rock.png", "new.png"),
        ("//maps/rock.v2.png", "//maps/new.png"),
        ("//../out.v2/rock.exr", "//../out.v2/new.exr"),
        ("C:\\maps\\rock.tif", "C:\\maps\\new.tif"),
        ("/maps/rock", "/maps/new"),
        ("/maps/", "/maps/"),
        ("rock_normal.<UDIM>.exr", "new.<UDIM>.exr"),
        ("{low}_<UDIM>_2.png", "new_<UDIM>_2.png"),
    ],
)
def test_a_path_is_renamed_in_its_folder_with_its_tile_and_its_ending(path, expected):
    assert naming.renamed(path, "new") == expected


def test_without_a_file_there_is_no_path():
    assert beside("HEIGHT", storage="PACK", output="").storing.output == ""


@pytest.mark.parametrize(
    ("name", "depth", "dither"), [("HEIGHT", 16, True), ("OBJECT_ID", 8, False), ("MASK", 8, False)]
)
def test_only_deep_maps_have_the_depth_of_the_settings_and_are_dithered(name, depth, dither):
    found = beside(name, dither=True)
    assert (found.storing.depth, found.storing.dither) == (depth, dither)


@pytest.mark.parametrize(
    ("name", "storage", "depth", "expected"),
    [
        ("BASE_COLOR", "PACK", 16, 8),
        ("EMISSION", "MEMORY", 16, 8),
        ("BASE_COLOR", "PACK", 8, 8),
        ("BASE_COLOR", "PACK", 32, 32),
        ("BASE_COLOR", "FILE", 16, 16),
        ("ATTRIBUTE", "PACK", 16, 16),
        ("ROUGHNESS", "PACK", 16, 16),
    ],
)
def test_colors_of_materials_have_8_bits_inside_blender_unless_they_are_exact(name, storage, depth, expected):
    output = "a.png" if storage == "FILE" else ""
    assert beside(name, storage=storage, output=output, depth=depth).storing.depth == expected


@pytest.mark.parametrize("name", ["POSITION", "HEIGHT", "DISPLACEMENT", "DISTANCE", "ATTRIBUTE"])
def test_numbers_of_any_size_have_32_bits_in_files_of_floats(name):
    assert beside(name, output="a.exr", depth=16).storing.depth == 32
    assert beside(name, output="a.png", depth=16).storing.depth == 16
    assert beside("AO", output="a.exr", depth=16).storing.depth == 16
    pack = {"pack": "CUSTOM", "pack_red": "AO", "pack_green": "HEIGHT", "storage": "FILE", "output": "a.exr"}
    assert settings_by_map(Settings(**pack))["PACKED"].storing.depth == 32
    assert settings_by_map(Settings(**pack | {"pack_green": "ZERO"}))["PACKED"].storing.depth == 16


def test_labels_take_the_lowest_depth_of_their_format():
    assert beside("OBJECT_ID", output="a.exr", depth=32).storing.depth == 16


# File names


@pytest.mark.parametrize(
    ("name", "written"),
    [
        *((name, name) for name in ("Möbel", "岩", "صخرة", "rock.001", "a b  c", "it's", ".hidden", "a#1", "con2")),
        *(("a/b", "a_b"), ("C:\\x", "C__x"), ('say "so"', "say _so_"), ("<UDIM>", "_UDIM_"), ("tab\there", "tab_here")),
        *(("..", "__"), ("ends. .", "ends___"), ("CON", "CON_"), ("nul.png", "nul_.png"), ("com1", "com1_")),
        *(("\udcff", "_"), ("100%", "100_")),
    ],
)
def test_only_characters_that_file_systems_refuse_are_replaced(name, written):
    assert naming.file_name(name) == written
    assert naming.fill("a/{low}/{low}.png", name) == f"a/{written}/{written}.png"


@pytest.mark.parametrize(
    ("low", "name"),
    [
        ("crate_low", "crate"),
        ("Crate_LP", "Crate"),
        ("crate-low poly", "crate"),
        ("pipe_low.001", "pipe.001"),
        ("pipe_low_2", "pipe_2"),
        ("crate", "crate"),
        ("crate_high", "crate_high"),
        ("slow", "slow"),
    ],
)
def test_a_name_without_its_suffix_fills_paths_and_images(low, name):
    assert naming.fill("maps/T_{name}_N.png", low) == f"maps/T_{name}_N.png"
    assert map_names.name_for(low, Settings(image="{name}_{low}").storing) == f"{name}_{low}"
    Settings(image="{name}").check()


def test_a_chosen_ending_is_left_out_of_the_name():
    assert naming.fill("//{name}_N.png", "crate_game", low_suffix="_game") == "//crate_N.png"
    assert naming.fill("//{name}_N.png", "crate_game_2", low_suffix="_GAME") == "//crate_2_N.png"
    assert naming.fill("//{name}_N.png", "crate_game") == "//crate_game_N.png"
    assert map_names.name_for("crate.lp", StorageSettings(image="T_{name}", low_suffix=".lp")) == "T_crate"
    assert map_names.name_for("crate_low", StorageSettings(image="T_{name}")) == "T_crate"


def test_names_without_suffixes_tell_low_objects_apart():
    assert naming.has_low("{name}.png")
    assert not naming.has_low("{material}.png")
    assert naming.of_texture_sets("T_{name}_N") == "T_{name}_{material}_N"
    assert naming.of_one_texture("T_{name}_{material}_N") == "T_{name}_N"
