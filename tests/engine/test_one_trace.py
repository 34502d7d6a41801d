# SPDX-License-Identifier: GPL-3.0-or-later
"""All maps of a bake come from one trace, one tree and one look at each image, and take a texture of the GPU each."""

from collections import Counter

import bpy
import numpy as np
import pytest

from addon.engine import coverage, sampling, tree_cache
from addon.passes import cast, surface_tables, target
from tests.support import scenes, zoo
from tests.support.maps import bake_all_maps

pytestmark = pytest.mark.usefixtures("gpu_context")

RAY_MAPS = ("AO", "BENT_NORMAL", "THICKNESS", "CURVATURE")
MAPS = (*RAY_MAPS, "POSITION", "HEIGHT", "BASE_COLOR", "ROUGHNESS")
SIZE = 64
TEXEL = 16
"""Bytes of a texel of RGBA32F or RGBA32UI."""


@pytest.fixture
def counts(monkeypatch):
    """How often rays are traced and pages are uploaded, and how many trees are built, in the bakes of a test."""
    found = Counter()
    trace, upload = cast.trace, surface_tables.upload_image

    def traced(*args, **options):
        found["traces"] += 1
        trace(*args, **options)

    def uploaded(*args, **options):
        found["pages"] += 1
        return upload(*args, **options)

    monkeypatch.setattr(cast, "trace", traced)
    monkeypatch.setattr(surface_tables, "upload_image", uploaded)
    return found


def pair():
    """A low plane, and a high terrain that shows an image and has a normal map."""
    low, high = zoo.plane("lo", 2), zoo.terrain("hi", 24)
    material = bpy.data.materials.new("painted")
    rng = np.random.default_rng(0)
    color = scenes.image("color", rng.uniform(0, 1, (32, 32, 3)))
    flat = scenes.image("flat", np.full((8, 8, 3), (0.55, 0.5, 0.95)), space="Non-Color")
    node = material.node_tree.nodes.new("ShaderNodeNormalMap")
    material.node_tree.links.new(scenes.texture(material, flat).outputs["Color"], node.inputs["Color"])
    shown = scenes.texture(material, color).outputs
    scenes.set_inputs(material, Base_Color=shown["Color"], Roughness=shown["Color"], Normal=node.outputs["Normal"])
    high.data.materials.append(material)
    return low, high


def bake(low, high, maps, counts=None, **settings):
    """What a bake of these maps does: traces, pages and new trees."""
    tree_cache.trees.free()
    built = tree_cache.trees.built
    if counts is not None:
        counts.clear()
    bake_all_maps(low, high, maps=maps, size=SIZE, rays=16, **settings)
    return {"trees": tree_cache.trees.built - built, **(counts or {})}


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_images_that_no_hit_shows_are_not_loaded(counts, method):
    """The first bake needs the color and the normal map, the second one only the color of another material."""
    settings = {"method": method, "extrusion": 0.2, "max_distance": 0.5}
    low, high = pair()
    other = bpy.data.materials.new("other")
    shown = scenes.texture(other, scenes.image("other", np.zeros((8, 8, 3))))
    scenes.set_inputs(other, Base_Color=shown.outputs["Color"])
    high.data.materials.append(other)
    assert bake(low, high, ("BASE_COLOR",), counts, **settings)["pages"] == 2
    for face in high.data.polygons:
        face.material_index = 1
    assert bake(low, high, ("BASE_COLOR",), counts, **settings)["pages"] == 1


def test_cast_traces_once_for_all_maps(counts):
    """Once for each sample; checks trace a few more rays, whatever the maps."""
    low, high = pair()
    found = {
        (bool(maps), samples): bake(
            low, high, maps, counts, method="CAST", samples=samples, extrusion=0.2, max_distance=0.5
        )
        for maps in ((), MAPS)
        for samples in (1, 4)
    }
    assert all(one["trees"] == 1 for one in found.values())
    assert {key: one["pages"] for key, one in found.items()} == {key: 1 + key[0] for key in found}
    traces = {key: one["traces"] for key, one in found.items()}
    assert traces[True, 1] == traces[False, 1]
    assert traces[True, 4] == traces[False, 4] == traces[False, 1] + 3


@pytest.mark.parametrize("maps", [("BASE_COLOR", "HEIGHT"), MAPS])
def test_flatten_traces_nothing_and_builds_a_tree_only_for_rays(counts, maps):
    found = bake(*pair(), maps, counts, samples=4)
    assert found == {"trees": int(set(maps) >= set(RAY_MAPS)), "pages": 2}


@pytest.mark.parametrize(("kept", "pages"), [(sampling.KEPT_BYTES, 2), (4 * sampling.HIT_BYTES * SIZE**2, 8)])
def test_an_image_is_loaded_once_for_each_group_of_samples(counts, monkeypatch, kept, pages):
    """16 samples in one group, or in four of four."""
    monkeypatch.setattr(sampling, "KEPT_BYTES", kept)
    assert bake(*pair(), ("BASE_COLOR", "ROUGHNESS"), counts, samples=16)["pages"] == pages


def held(maps, **settings):
    """Bytes of the GPU after a bake, in targets, as textures of the map's size."""
    target.common.free()
    coverage.known.clear()  # a bake of the same layout would count no triangles, in no target
    bake(*pair(), maps, **settings)
    return target.common.bytes / (TEXEL * SIZE**2)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_each_map_takes_a_texture_whatever_the_number_of_samples(monkeypatch, method):
    """Maps of one family share their sums; the hits, the points on both surfaces and the scratch textures come once."""
    monkeypatch.setattr(sampling, "KEPT_BYTES", 1)  # as with maps of 4096 texels a side
    four, many = (held(MAPS, method=method, samples=samples, detail_maps=False) for samples in (4, 64))
    assert four == many
    without = held((), method=method, samples=64, detail_maps=False)
    shared = 1 + 4 + 3  # hits; two points with labels; a sample, a mean and bent normals
    assert many - without <= len(MAPS) + shared
    for single in ("THICKNESS", "BASE_COLOR", "POSITION"):
        one = held((single,), method=method, samples=64, detail_maps=False)
        assert many - one <= len(MAPS) - 1 + shared


def test_groups_of_samples_stay_within_their_limit(monkeypatch):
    """Samples that wait for an image keep a hit and a normal each."""
    monkeypatch.setattr(sampling, "KEPT_BYTES", 1)
    alone = held(MAPS, samples=16)
    kept = 4 * sampling.HIT_BYTES * SIZE**2
    monkeypatch.setattr(sampling, "KEPT_BYTES", kept)
    assert 0 < held(MAPS, samples=16) - alone <= kept / (TEXEL * SIZE**2)
