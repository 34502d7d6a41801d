# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the layouts of packed images, the maps that they need, and the choice of at least one map."""

import pytest

from addon.core.declarations.choices import Pack
from addon.core.errors import BakeError
from addon.core.map_types import AO, METALLIC, ROUGHNESS, Channel
from addon.core.settings import Settings

AMBIENT, ROUGH, METAL = (Channel(kind.name) for kind in (AO, ROUGHNESS, METALLIC))
SMOOTH = Channel(ROUGHNESS.name, is_inverted=True)
BLACK, WHITE = Channel(constant=0.0), Channel(constant=1.0)
LAYOUTS = {
    Pack.GLTF: ("orm", AMBIENT, ROUGH, METAL, WHITE),
    Pack.UNREAL: ("orm", AMBIENT, ROUGH, METAL, WHITE),
    Pack.GODOT: ("orm", AMBIENT, ROUGH, METAL, WHITE),
    Pack.URP: ("metallic_smoothness", METAL, BLACK, BLACK, SMOOTH),
    Pack.HDRP: ("mask", METAL, AMBIENT, WHITE, SMOOTH),
}


@pytest.mark.parametrize("pack", LAYOUTS)
def test_the_channels_of_each_engine(pack):
    packing = Settings(pack=pack).map.packing
    assert (packing.suffix, *packing.channels) == LAYOUTS[pack]
    assert list(packing.by_name()) == ["red", "green", "blue", "alpha"]


def test_every_choice_but_none_has_a_layout():
    assert [pack for pack in Pack if Settings(pack=pack).map.packing is None] == [Pack.NONE]


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
    assert settings.without_other_maps().map.drawn_maps == ()
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
