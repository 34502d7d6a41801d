# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the estimate of a bake's memory against measured bakes, and its sentences."""

from functools import partial

import pytest

from addon.core.preflight import Amounts, Need, memory_sentence, texel_bytes
from addon.core.settings import Settings

MOST = 4 / 3
"""The largest estimate, as a share of what is needed. The smallest is what is needed."""
BAND = 4096 * 4096
BAND_OF_8192 = 2094 * 8192
"""With its halo."""
RAYS, ADAPTIVE, FLAT, WITH_COLORS = 110, 180, 68, 142
"""Bytes of a texel: of a normal map alone, by Cast, with adaptive samples, and by Flatten; and by Cast with base colors."""
BUDGET = 1536 * 2**20
"""Bytes of a band by Cast, which does not hold the whole map."""

MEASURED = {
    Amounts(505_000, 64 * 64, 64 * 64, RAYS): 695e6,
    Amounts(505_000, 1024 * 1024, 1024 * 1024, RAYS): 772e6,
    Amounts(2_005_000, 1024 * 1024, 1024 * 1024, RAYS): 1480e6,
    Amounts(505_000, BAND, BUDGET // RAYS, RAYS): 2409e6,
    Amounts(505_000, BAND, BUDGET // ADAPTIVE, ADAPTIVE): 2910e6,
    Amounts(505_000, 2048 * 2048, 2048 * 2048, WITH_COLORS, other_maps=1, texture_pixels=BAND): 1746e6,
    Amounts(505_000, 1024 * 1024, 1024 * 1024, WITH_COLORS, other_maps=1, texture_pixels=BAND): 1471e6,
    Amounts(505_000, BAND, BAND, FLAT, is_flat=True): 2170e6,
    Amounts(505_000, 4 * BAND, BAND_OF_8192, FLAT, is_flat=True): 4008e6,
    Amounts(30_002_048, 1024 * 1024, 1024 * 1024, FLAT, is_flat=True): 4260e6,
    Amounts(30_002_048, 4 * BAND, BAND_OF_8192, FLAT, is_flat=True): 7070e6,
    Amounts(100_002_048, 4 * BAND, BAND_OF_8192, FLAT, is_flat=True): 15640e6,
}
"""The largest resident size of processes by scripts/bench/scan_memory.py, with a GPU in software. The last three are of grids
in Blender, as the bench's part very_large builds them. One is of an OpenEXR file with 32 bits, which takes the most: the 4008
MB."""


def test_bytes_of_a_texel():
    for method, values, expected in (
        ("CAST", {}, RAYS),
        ("CAST", {"samples": 4}, ADAPTIVE),
        ("FLATTEN", {}, FLAT),
        ("CAST", {"maps": ("BASE_COLOR",)}, WITH_COLORS),
    ):
        assert texel_bytes(Settings(margin_type="EXTEND", **values), method, has_detail=False) == expected


def test_maps_of_materials_have_sums_and_those_of_points_only_with_several_samples():
    bytes_of = partial(texel_bytes, method="CAST", has_detail=False)
    roughness, both = (bytes_of(Settings(maps=maps)) for maps in (("ROUGHNESS",), ("ROUGHNESS", "BASE_COLOR")))
    assert both - roughness == 16
    for samples, sums in ((1, 0), (4, 16)):
        one, two = (bytes_of(Settings(samples=samples, maps=maps)) for maps in (("HEIGHT",), ("HEIGHT", "POSITION")))
        assert two - one == sums


@pytest.mark.parametrize("amounts", MEASURED, ids=str)
def test_the_estimate_is_what_was_measured_and_little_more(amounts):
    peak = Need.of(amounts).of_machine(is_software=True)
    assert 1.0 <= peak / MEASURED[amounts] <= MOST


def test_a_gpu_has_its_own_memory():
    need = Need.of(Amounts(2_000_000, BAND, BAND, 108))
    assert need.of_machine(is_software=False) < need.of_machine(is_software=True) == need.peak
    assert need.on_gpu == 2_000_000 * 112 + BAND * 108


def test_flatten_of_a_normal_map_has_no_tree_and_uploads_large_meshes_in_parts():
    small, large = (Need.of(Amounts(count, BAND, BAND, 70, is_flat=True)) for count in (2_000_000, 100_000_000))
    assert small.tree == large.tree == 0
    assert small.on_gpu == 2_000_000 * 60 + BAND * 70
    assert large.on_gpu == 250 * 10**6 + BAND * 70
    assert Need.of(Amounts(20_000_000, BAND, BAND, RAYS)).tree == 20_000_000 * 190


def test_large_meshes_take_less_for_each_triangle():
    small, large = (Need.of(Amounts(count, BAND, BAND, RAYS)) for count in (2**24 - 1, 2**24))
    assert small.meshes // (2**24 - 1) == 250 + 112
    assert large.meshes // 2**24 == 120 + 112


def test_a_page_counts_while_maps_are_drawn():
    small, large = (Need.of(Amounts(1000, side**2, side**2, RAYS, texture_pixels=4096 * 4096)) for side in (1024, 8192))
    assert small.texture == large.texture > 4096 * 4096 * 16
    assert small.peak == small.program + small.meshes + small.maps + small.texture
    assert large.peak == large.program + large.meshes + large.maps + large.storing


NEED = Need(program=10**8, meshes=10**9, tree=10**9, maps=2 * 10**9, storing=10**9, texture=0, on_gpu=2 * 10**9)


def test_the_sentence_has_what_is_needed_and_what_is_free():
    assert (
        memory_sentence(NEED, 9 * 10**9, is_software=True) == "The bake needs about 4.1 GB of memory; 9.0 GB are free."
    )
    assert memory_sentence(NEED, None, is_software=True) == "The bake needs about 4.1 GB of memory."
    assert memory_sentence(NEED, 9 * 10**9, is_software=False) == (
        "The bake needs about 2.1 GB of memory, and 2.0 GB on the GPU; 9.0 GB are free."
    )


LACKS = {
    "close other programs": Need(6 * 10**9, 10**9, 0, 10**9, 0, 10**9, 0),
    "choose a smaller map": NEED,
    "simplify the high mesh": Need(0, 6 * 10**9, 0, 10**9, 0, 10**9, 0),
    "reduce the largest image": Need(0, 10**9, 0, 10**9, 0, 6 * 10**9, 0),
}


@pytest.mark.parametrize("words", LACKS)
def test_a_lack_of_memory_names_the_largest_part(words):
    text = memory_sentence(LACKS[words], 10**9, is_software=True)
    assert f"and 1.0 GB are free: {words}" in text
    assert text.endswith(".")


def test_a_lack_of_the_machines_memory_does_not_name_the_gpus():
    text = memory_sentence(NEED, 10**9, is_software=False)
    assert text.startswith("The bake needs about 2.1 GB of memory, and 1.0 GB are free: ")
