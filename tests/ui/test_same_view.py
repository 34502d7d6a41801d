# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake, views, Deviation and Live read the objects in one way, also if renders see others than the viewport shows."""

import bpy
import numpy as np
import pytest

from addon.ui.bake_results import results
from addon.ui.live import live
from addon.ui.views import viewer
from tests.support import panel_layout, scenes, zoo
from tests.support.following import switch
from tests.support.panel import use
from tests.ui.test_view_mode import view

pytestmark = pytest.mark.usefixtures("gpu_context", "registered")

SIZE = 32
RIGHT = 0.5
"""Degrees at the 99th percentile between the map and the mesh that was baked: between texels, normals are mixed."""
WRONG = 3.0
"""Degrees of the mean between the map and the coarse mesh in the viewport."""
EXACT = 1e-6
"""Of stored values: the same arithmetic on the same mesh."""


def displaced(obj):
    texture = bpy.data.textures.new("clouds", "CLOUDS")
    texture.noise_scale = 0.8
    modifier = obj.modifiers.new("Displace", "DISPLACE")
    modifier.texture, modifier.strength, modifier.texture_coords = texture, 0.2, "LOCAL"


def subdivision(viewport=0, render=5):
    obj = zoo.plane("high", 2)
    modifier = obj.modifiers.new("Subdivision", "SUBSURF")
    modifier.subdivision_type, modifier.levels, modifier.render_levels = "SIMPLE", viewport, render
    displaced(obj)
    return obj


def simplify():
    render = bpy.context.scene.render
    render.use_simplify, render.simplify_subdivision = True, 0
    return subdivision(5, 5)


def decimate():
    obj = subdivision(5, 5)
    modifier = obj.modifiers.new("Decimate", "DECIMATE")
    modifier.ratio, modifier.show_render = 0.02, False
    return obj


def multires():
    obj = scenes.select(zoo.plane("high", 2))
    modifier = obj.modifiers.new("Multires", "MULTIRES")
    for _ in range(5):
        bpy.ops.object.multires_subdivide(modifier=modifier.name, mode="SIMPLE")
    detailed = scenes.link(obj.copy())
    detailed.data = obj.data.copy()
    displaced(detailed)
    scenes.select(obj, detailed)
    bpy.ops.object.multires_reshape(modifier=modifier.name)
    bpy.data.objects.remove(detailed)
    modifier.levels, modifier.render_levels = 1, 5
    return obj


@pytest.fixture
def panel():
    yield lambda low, high, **values: use(
        low, high, size=SIZE, method="CAST", measure=False, extrusion=0.3, max_distance=0.6, depth="32", **values
    )
    live.stop()
    viewer.off()


def baked():
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    return np.array(bpy.data.images["low_normal"].pixels[:]).reshape(SIZE, SIZE, 4)


@pytest.mark.parametrize("make", [subdivision, simplify, decimate, multires])
def test_views_and_deviation_have_what_the_bake_had(make, panel):
    low, high = zoo.plane("low"), make()
    panel(low, high)
    texels = baked()
    assert np.ptp(texels[..., 0]) > 0.2
    view().mode = "DEVIATION"  # of the map that was baked
    assert viewer.deviations.percentile_99 < RIGHT
    assert viewer.deviations.bare_mean > WRONG
    assert bpy.ops.imprint.view_refresh() == {"FINISHED"}  # draws a map of its own
    assert np.allclose(viewer.session.texels, texels, rtol=0.0, atol=EXACT)
    assert viewer.deviations.percentile_99 < RIGHT
    triangles = len(viewer.session.meshes.highs[0].triangles)
    view().mode = "OFF"
    view().mode = "SPLIT"  # draws the stored map, and the high mesh
    (shading,) = viewer.stored.values()
    assert len(shading.bake.meshes.highs[0].triangles) == triangles == 2 * 4 * 4**5


@pytest.mark.parametrize("make", [subdivision, simplify, decimate, multires])
def test_live_says_where_the_viewport_differs(make, panel):
    low, high = zoo.plane("low"), make()
    panel(low, high)
    texels = baked()
    switch(True)
    (sentence,) = live.session.differences
    triangles = len(live.session.meshes.highs[0].triangles)
    assert sentence.startswith(
        f"'high' has {triangles:,} triangles in the viewport, which Live follows, and 8,192 in renders"
    )
    assert np.abs(live.session.texels - texels).max() > 0.05
    switch(False)
    use(modifiers="VIEWPORT")
    texels = baked()
    switch(True)
    assert live.session.differences == []
    assert np.allclose(live.session.texels, texels, rtol=0.0, atol=EXACT)


def test_live_says_nothing_where_both_are_the_same(panel):
    low, high = zoo.plane("low"), subdivision(3, 3)
    panel(low, high)
    texels = baked()
    switch(True)
    assert live.session.differences == []
    assert np.allclose(live.session.texels, texels, rtol=0.0, atol=EXACT)


def test_live_says_that_places_differ_where_counts_are_the_same(panel):
    low, high = zoo.plane("low"), subdivision(3, 3)
    high.modifiers["Displace"].show_viewport = False
    panel(low, high)
    switch(True)
    (sentence,) = live.session.differences
    assert "512 triangles in the viewport" in sentence
    assert sentence in panel_layout.draw(width=2000).text
    assert bpy.ops.imprint.live() == {"FINISHED"}
    assert sentence in results.of(bpy.context, low).warnings
