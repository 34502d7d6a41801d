# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which settings are accepted, and the messages for the others."""

import argparse
import dataclasses
import re
from dataclasses import fields

import pytest

from addon.cli import option_types
from addon.cli.job_file import KEYS
from addon.cli.options import FILES, OBJECTS, OPTIONS
from addon.core import file_formats, map_types
from addon.core.declarations import bases
from addon.core.declarations.all_settings import DECLARED
from addon.core.declarations.choices import Pack
from addon.core.declarations.map_settings import CONVERT, MAX_SIZE, MIN_SIZE
from addon.core.errors import BakeError
from addon.core.map_types import AO, METALLIC, ROUGHNESS, Channel, Family, Kind
from addon.core.settings import PARTS, Settings
from addon.output import map_names
from addon.passes import lit
from scripts.dev import tables
from scripts.imprint import ROOT

GOOD = [
    {},
    {"width": MIN_SIZE, "height": MAX_SIZE},
    {"space": "OBJECT", "green": "-Y", "basis": "MIKKTSPACE", "modifiers": "VIEWPORT"},
    {"space": "WORLD", "margin": 0},
    {"margin": MAX_SIZE},
    *({"storage": storage, "depth": depth} for storage in ("PACK", "MEMORY") for depth in (8, 16, 32)),
    *(
        {"storage": "FILE", "output": f"m{end}", "depth": depth}
        for end, file_format in file_formats.BY_ENDING.items()
        for depth in file_format.depths
    ),
    {"storage": "FILE", "output": "//MAP.PNG"},
    {"storage": "PACK", "output": "notes.txt"},  # ignored
    {"udim": True, "tiles": (1001, 2000)},
    {"storage": "FILE", "output": "//100%/map.png"},
]
BAD = [
    *({side: size} for side in ("width", "height") for size in (-1, 0, MIN_SIZE - 1, MAX_SIZE + 1)),
    {"margin": -1},
    {"margin": MAX_SIZE + 1},
    {"udim": True, "tiles": (1000,)},
    {"udim": True, "tiles": (2001,)},
    {"method": "flatten"},
    {"space": ""},
    {"basis": "XNORMAL"},
    {"green": "+y"},
    {"modifiers": "NONE"},
    {"storage": "DISK"},
    {"depth": 0},
    {"depth": 24},
    {"storage": "FILE"},
    {"storage": "FILE", "output": "map"},
    {"storage": "FILE", "output": "map.tga"},
    {"storage": "FILE", "output": "map.png", "depth": 32},
    {"storage": "FILE", "output": "map.exr", "depth": 8},
    {"storage": "FILE", "output": "//100%/map.png", "udim": True},
]


@pytest.mark.parametrize("values", GOOD, ids=str)
def test_valid_settings_are_accepted_unchanged(values):
    settings = Settings(**values)
    settings.check()
    assert {name: settings.flat()[name] for name in values} == values


@pytest.mark.parametrize("values", BAD, ids=str)
def test_invalid_settings_are_named_in_the_message(values):
    with pytest.raises(BakeError) as refused:
        Settings(**values).check()
    message = str(refused.value)
    assert message.endswith(".")
    assert "\n" not in message
    assert "(" not in message  # no Python tuple
    # The message quotes the value, unless it is empty.
    invalid = {name: value for name, value in values.items() if name not in {"storage", "output", "udim"}}
    assert all(str(value).strip("(,)") in message for value in invalid.values())


def test_settings_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Settings().sampling.width = 32


@pytest.mark.parametrize(
    ("basis", "engine", "read"),
    [
        ("AUTO", "CYCLES", "CYCLES"),
        ("AUTO", "BLENDER_EEVEE", "MIKKTSPACE"),
        ("AUTO", "BLENDER_WORKBENCH", "MIKKTSPACE"),
        ("AUTO", "SOMEBODYS_OWN", "MIKKTSPACE"),
        ("CYCLES", "BLENDER_EEVEE", "CYCLES"),
        ("MIKKTSPACE", "CYCLES", "MIKKTSPACE"),
    ],
)
def test_the_automatic_basis_follows_the_render_engine(basis, engine, read):
    assert Settings(basis=basis).read_by(engine).map.basis == read
    assert Settings().map.basis == "AUTO"


# Declarations


OPTIONAL = {name: setting for name, setting in DECLARED.items() if setting.option}
FIELDS = {field.name: field for kind in PARTS.values() for field in fields(kind)}


def plain(text):
    """Text without line breaks and Markdown."""
    return re.sub(r"\s+", " ", text.replace("`", "").replace("\\|", "|"))


def test_the_manuals_tables_are_up_to_date():
    """To update them, run `python3 scripts/dev/tables.py`."""
    assert [page.name for page in tables.outdated()] == []


@pytest.mark.parametrize("name", FIELDS)
def test_each_field_of_the_settings_is_declared(name):
    assert FIELDS[name].default == DECLARED[name].default


def test_each_declaration_is_a_field_or_used_only_by_the_panel():
    """Only the panel uses its switches and slots, settings with another option or none in a bake."""
    more = {name for name, setting in DECLARED.items() if name not in FIELDS and setting.option}
    assert more == {"low", "highs", "cage", "size", "export", *CONVERT}
    assert {name for name in FIELDS if not DECLARED[name].option} == {"width", "height", "storage", "low_suffix"}


@pytest.mark.parametrize("name", [name for name, setting in DECLARED.items() if setting.switch])
def test_a_switch_decides_whether_a_number_is_none(name):
    switch = DECLARED[DECLARED[name].switch]
    assert (switch.default == switch.empties) == (DECLARED[name].default is None)


def test_each_option_comes_from_a_declaration_or_is_in_the_list_of_others():
    made = {setting.option.word or name.replace("_", "-") for name, setting in OPTIONAL.items()}
    words = {word for group in OPTIONS.values() for word in group}
    assert words - made == (set(OBJECTS) | set(FILES)) - {"low", "high", "cage"}
    assert made <= words
    assert set(KEYS) == words | {"file"}


WRONG = {
    "method": "flatten",
    "samples": 3,
    "maps": ("HEIGTH",),
    "width": 15,
    "margin": -1,
    "extrusion": -0.5,
    "max_distance": 0.0,
    "limit": float("nan"),
    "missed": (0.5, 0.5, 1.5),
}


@pytest.mark.parametrize("name", WRONG)
def test_the_message_about_a_value_outside_the_limits_has_the_label(name):
    with pytest.raises(BakeError, match=f"^{DECLARED[name].label}: "):
        Settings(**{name: WRONG[name]}).check()


def test_extrusion_may_be_zero():
    Settings(extrusion=0.0).check()


@pytest.mark.parametrize(
    ("method", "samples", "expected"),
    [("FLATTEN", 64, False), ("CAST", 2, False), ("CAST", 4, True), ("AUTO", 4, True)],
)
def test_samples_are_adaptive_from_a_number_on_that_depends_on_the_method(method, samples, expected):
    assert Settings(samples=samples).sampling.are_adaptive(method) is expected
    assert not Settings(samples=samples, adaptive=False).sampling.are_adaptive(method)


# Bases


FLAGS = ("bitangent_of_vertices", "normalizes_tangent", "normalizes_bitangent", "normalizes_normal")


def constants(library, prefix):
    """The numbers in a library of shaders whose names have this prefix, by the rest of their names."""
    source = (ROOT / "shaders" / "lib" / f"{library}.glsl").read_text(encoding="utf-8")
    return {name: int(number) for name, number in re.findall(rf"const int {prefix}_(\w+) = (\d+);", source)}


def test_the_shader_has_the_declared_kinds_of_maps():
    assert constants("decode_lib", "DECODE") == {
        "WORLD": lit.WORLD,
        "OBJECT": lit.OBJECT,
        "TANGENT": lit.TANGENT,
        "REBUILT_Z": lit.REBUILT_Z,
    }


@pytest.mark.parametrize("name", FLAGS)
def test_the_shader_has_the_declared_flags_of_bases(name):
    one = bases.Basis("X", "", "", **{name: True})
    assert constants("basis_lib", "BASIS")[name.upper()] == one.flags
    assert set(constants("basis_lib", "BASIS")) == {flag.upper() for flag in FLAGS}


def test_files_of_blender_keep_their_basis():
    """They hold the place in the list."""
    assert DECLARED["basis"].values[:3] == (bases.AUTO, "CYCLES", "MIKKTSPACE")


def test_earlier_names_of_a_basis_are_read_as_its_name():
    read = option_types.one_of(DECLARED["basis"])
    assert [read(word) for word in ("blender", "BLENDER", "cycles", "mikktspace-vertex", "mikktspacevertex")] == [
        "CYCLES",
        "CYCLES",
        "CYCLES",
        "MIKKTSPACE_VERTEX",
        "MIKKTSPACE_VERTEX",
    ]
    with pytest.raises(argparse.ArgumentTypeError, match="mikktspace-vertex, normalized$"):
        read("blend")


def test_a_message_about_an_option_ends_without_a_full_stop():
    """Since argparse and the readers of job files put it into a sentence."""
    with pytest.raises(argparse.ArgumentTypeError, match="such as 1001, 1003$"):
        option_types.tiles("all")


# Map types


def test_the_shader_has_the_declared_indices_of_maps():
    source = (ROOT / "shaders" / "bake" / "height_position_ids_frag.glsl").read_text(encoding="utf-8")
    found = {name: int(number) for name, number in re.findall(r"const int INDEX_(\w+) = (\d+);", source)}
    assert found == {map_type.name: map_type.index for map_type in map_types.OTHERS if map_type.family is Family.POINTS}


@pytest.mark.parametrize("map_type", map_types.OTHERS, ids=lambda map_type: map_type.name)
def test_only_label_maps_have_labels_and_they_are_not_deep(map_type):
    assert (map_type.kind is Kind.LABEL) == (map_type.labeled is not None)
    assert not (map_type.kind is Kind.LABEL and map_type.is_deep)


# Packing


AMBIENT, ROUGH, METAL = (Channel(kind.name) for kind in (AO, ROUGHNESS, METALLIC))
SMOOTH = Channel(ROUGHNESS.name, is_inverted=True)
BLACK, WHITE = Channel(constant=0.0), Channel(constant=1.0)


def test_a_layout_of_ones_own():
    settings = Settings(
        pack=Pack.CUSTOM, pack_red="HEIGHT", pack_green="ONE", pack_blue="SMOOTHNESS", pack_alpha="HEIGHT"
    )
    packing = settings.map.packing
    assert (packing.suffix, *packing.channels) == ("packed", Channel("HEIGHT"), WHITE, SMOOTH, Channel("HEIGHT"))
    assert packing.maps == ("HEIGHT", ROUGHNESS.name)


def test_maps_that_are_packed_are_drawn_and_not_stored_alone():
    settings = Settings(maps=("HEIGHT", "ROUGHNESS"), pack=Pack.HDRP)
    assert settings.map.drawn_maps == ("HEIGHT", "AO", "ROUGHNESS", "METALLIC")
    assert settings.map.maps == ("HEIGHT", "ROUGHNESS")
    assert Settings(maps=("HEIGHT",)).map.drawn_maps == ("HEIGHT",)


@pytest.mark.parametrize("chosen", [{"normal": True}, {"maps": ("HEIGHT",)}, {"pack": Pack.GLTF}])
def test_one_map_is_enough(chosen):
    Settings(**{"normal": False} | chosen).check()


@pytest.mark.parametrize("mask", [False, True])
def test_at_least_one_map_must_be_chosen(mask):
    with pytest.raises(BakeError, match="No map is chosen: choose the normal map"):
        Settings(normal=False, mask=mask).check()


def test_a_packed_image_must_hold_a_map():
    settings = Settings(pack=Pack.CUSTOM, pack_red="ONE", pack_green="ZERO", pack_blue="ZERO", pack_alpha="ONE")
    with pytest.raises(BakeError, match="The packed image would hold no map"):
        settings.check()


@pytest.mark.parametrize("pack", [pack for pack in Pack if pack not in (Pack.NONE, Pack.CUSTOM)])
def test_presets_take_the_widened_roughness_if_it_is_chosen(pack):
    plain, widened = (Settings(pack=pack, maps=maps).map.packing for maps in ((), ("WIDENED_ROUGHNESS",)))
    assert "ROUGHNESS" in plain.maps
    assert widened.maps == tuple(name.replace("ROUGHNESS", "WIDENED_ROUGHNESS") for name in plain.maps)
    for before, after in zip(plain.channels, widened.channels, strict=True):
        assert (before.is_inverted, before.constant) == (after.is_inverted, after.constant)


def test_a_layout_of_one_s_own_holds_what_it_names():
    settings = Settings(pack=Pack.CUSTOM, pack_green="ROUGHNESS", maps=("WIDENED_ROUGHNESS",))
    assert settings.map.packing.channels[1].map == "ROUGHNESS"


# Settings of a part of a bake

ALL = {"normal": False, "mask": True, "maps": ("AO",), "pack": Pack.CUSTOM, "pack_red": "HEIGHT", "connect_maps": True}


def test_settings_without_other_maps_are_of_the_normal_map_alone():
    settings = Settings(**ALL).without_other_maps()
    assert list(map_names.stored_maps(settings.map)) == ["NORMAL"] and settings.map.drawn_maps == ()


def test_settings_without_materials_change_nothing_of_the_low_object():
    settings = Settings(**ALL, material=True, vertex_domain="CORNER").without_materials()
    assert not settings.changes_materials and settings.storing.vertex_domain == "NONE"
    assert settings.map == Settings(**ALL).map


@pytest.mark.parametrize(
    ("size", "most", "found"), [((100, 30), 50, (50, 15)), ((64, 8), 64, (64, 8)), ((9, 1), 3, (3, 1))]
)
def test_settings_of_at_most_some_texels_keep_the_proportions(size, most, found):
    assert Settings(width=size[0], height=size[1]).of_at_most(most).sampling.size == found
