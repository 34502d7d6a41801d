# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps of colors and numbers go on where rays miss: a missed texel has the value of the nearest one that was hit, and alpha 0.

A leaf lies over a card. What its map shows is its own place, so that each texel says from where it was taken.
"""

import bpy
import numpy as np
import pytest

from addon.core.map_types import FILLED, MARGIN, MISSED, WRITTEN
from addon.core.settings import Settings
from addon.engine import bands, margins
from addon.jobs import Job, bake_all
from addon.output import image_file
from addon.passes import margin_fill
from tests.engine.test_margins import cut, drawn, finished, marked, mesh_of, places, squares
from tests.support import maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 48
RAYS = {"method": "CAST", "extrusion": 0.5, "max_distance": 1.0, "size": SIDE}
FILLED_MAPS = (
    *("AO", "THICKNESS", "CURVATURE", "CONVEXITY", "CAVITY"),
    *("BASE_COLOR", "ROUGHNESS", "METALLIC", "EMISSION", "SPECULAR", "ATTRIBUTE"),
)
STAY = ("POSITION", "HEIGHT", "DISPLACEMENT", "DISTANCE", "OBJECT_ID", "MATERIAL_ID", "BENT_NORMAL", "ALPHA")


def leaf(name="leaf", *, roughness=0.25):
    """A disc of radius 0.6 whose attribute "place" is 0.5 + 0.25 (x, y), of a rough white material."""
    obj = zoo.disc(name, 24)
    for vertex in obj.data.vertices:
        vertex.co *= 0.6
    layer = obj.data.attributes.new("place", "FLOAT_COLOR", "POINT")
    colors = [(0.5 + 0.25 * vertex.co.x, 0.5 + 0.25 * vertex.co.y, 0.0, 1.0) for vertex in obj.data.vertices]
    layer.data.foreach_set("color", np.float32(colors).ravel())
    material = bpy.data.materials.new(name)
    material.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = roughness
    obj.data.materials.append(material)
    return obj


def nearest(is_hit):
    """The row and column (H, W) of a nearest texel that was hit, for each, and how far it is, by brute force."""
    rows, columns = np.indices(is_hit.shape)
    y, x = np.nonzero(is_hit)
    far = (rows[..., None] - y) ** 2 + (columns[..., None] - x) ** 2
    return far.min(axis=-1)


def place_of(texels):
    """The column and row of the texels whose attribute was taken."""
    return (texels[..., :2] - 0.5) * 4 * SIDE / 2 + (SIDE - 1) / 2


@pytest.mark.parametrize("margin", [6, None])
def test_a_miss_shows_the_nearest_place_of_the_leaf(margin):
    _, found = maps.bake_all_maps(
        zoo.plane("card"), leaf(), maps=["ATTRIBUTE"], attribute="place", margin=margin, **RAYS
    )
    texels = found["attribute"]
    is_hit = texels[..., 3] > 0.0
    assert 0.2 < is_hit.mean() < 0.4
    rows, columns = np.indices(is_hit.shape)
    x, y = np.moveaxis(place_of(texels), -1, 0)
    assert np.allclose([x[is_hit], y[is_hit]], [columns[is_hit], rows[is_hit]], atol=1e-3)
    squared = nearest(is_hit)
    is_filled = ~is_hit & (texels[..., :3] != 0.0).any(axis=-1)
    assert np.allclose(((x - columns) ** 2 + (y - rows) ** 2)[is_filled], squared[is_filled], atol=0.05)
    if margin is None:
        assert (is_filled | is_hit).all()
    else:  # as wide as a margin around the leaf would be
        assert is_filled[~is_hit & (squared <= margin**2)].all()
        assert not is_filled[squared > 2 * margin**2].any()


def test_maps_that_say_what_is_there_keep_their_holes():
    chosen = [*FILLED_MAPS, *STAY, "COVERAGE"]
    report, found = maps.bake_all_maps(
        zoo.plane("card"), leaf(), maps=chosen, attribute="place", margin=None, mask=True, rays=16, **RAYS
    )
    normal = maps.pixels(bpy.data.images["map"])
    holes = normal[..., 3] == 0.0
    assert report.missed == pytest.approx(holes.mean())
    white = maps.pixels(bpy.data.images["map_missed"])[..., 0] == 1.0
    assert np.array_equal(white, holes)
    assert (normal[holes] == np.float32((0.5, 0.5, 1.0, 0.0))).all()
    assert np.array_equal(found["coverage"][..., 0] == 0.0, holes)
    for name in map(str.lower, FILLED_MAPS + STAY):
        assert (found[name][holes][:, 3] == 0.0).all(), name
        written = found[name][~holes][:, :3]
        if name.upper() in STAY:
            assert len(np.unique(found[name][holes][:, :3], axis=0)) == 1, name
        else:
            assert (found[name][holes][:, :3] >= written.min(axis=0)).all(), name
            assert (found[name][holes][:, :3] <= written.max(axis=0)).all(), name
    assert (found["roughness"][..., 0] == np.float32(0.25)).all()
    assert (found["alpha"][holes][:, :3] == 0.0).all()
    assert (found["base_color"][holes][:, :3] > 0.5).all()


def test_a_file_keeps_the_color_and_its_smaller_levels_too(tmp_path):
    settings = Settings(
        width=SIDE, height=SIDE, maps=("ROUGHNESS",), output=str(tmp_path / "leaf.png"), storage="FILE", margin=None,
        method="CAST", extrusion=0.5, max_distance=1.0, mip_files=True, alpha=True, material=False,
    )  # fmt: skip
    bake_all(bpy.context, [Job(zoo.plane("card"), [leaf()])], settings)
    files = sorted(tmp_path.glob("leaf_roughness*.png"))
    assert len(files) == 6
    for path in files:
        assert np.allclose(image_file.read(path)[..., 0], 0.25, atol=1 / 255), path.name
    alpha = image_file.read(tmp_path / "leaf_roughness.png")[..., 3]
    assert 0.2 < alpha.mean() < 0.4
    for level in ("", "_mip1", "_mip2"):
        found, normal = (image_file.read(tmp_path / f"leaf{name}{level}.png")[..., 3] for name in ("_roughness", ""))
        assert np.array_equal(found, normal)
        assert not normal.all()


def test_a_packed_channel_that_is_inverted_is_filled_as_well():
    report, _ = maps.bake_all_maps(zoo.plane("card"), leaf(), maps=[], pack="URP", margin=6, **RAYS)
    (image,) = [found["image"] for found in report.maps.values() if "channels" in found]
    smoothness = maps.pixels(bpy.data.images[image])[..., 3]
    squared = nearest(maps.pixels(bpy.data.images["map"])[..., 3] > 0.0)
    assert np.allclose(smoothness[squared <= 36], 0.75)
    assert (smoothness[squared > 72] == 0.0).all()  # no value, as before


def test_a_map_of_two_objects_takes_no_color_of_the_other(tmp_path):
    """The right one is baked again alone. Misses at its border are nearer to texels of the left one, and take its own."""
    lows, highs = [], []
    for number, name in enumerate(("left", "right")):
        low = zoo.plane(f"{name} low")
        scenes.move_uvs(low, (0.5, 1.0), (0.5 * number, 0.0))
        high = leaf(name, roughness=0.25 + 0.5 * number)
        low.location.x = high.location.x = 4.0 * number
        lows.append(low), highs.append(high)
    high = highs[0]
    for vertex in high.data.vertices:
        vertex.co.x *= 2.0  # up to the border
    bpy.context.view_layer.update()
    jobs = [Job(low, [high]) for low, high in zip(lows, highs, strict=True)]
    settings = Settings(
        width=SIDE, height=SIDE, maps=("ROUGHNESS",), image="both", storage="MEMORY", margin=None, depth=32,
        method="CAST", extrusion=0.5, max_distance=1.0, material=False,
    )  # fmt: skip
    bake_all(bpy.context, jobs, settings, share_image=True)
    before = maps.pixels(bpy.data.images["both_roughness"])
    assert set(np.unique(before[..., 0])) == {np.float32(0.25), np.float32(0.75)}
    bake_all(bpy.context, jobs[1:], settings, share_image=True)
    after = maps.pixels(bpy.data.images["both_roughness"])
    assert np.array_equal(after[:, : SIDE // 2], before[:, : SIDE // 2])
    right = after[:, SIDE // 2 :]
    assert (right[..., :3] == np.float32(0.75)).all()
    assert np.array_equal(after[..., 3], before[..., 3])


def test_bands_continue_a_seam_past_a_filled_hole(monkeypatch):
    islands = cut(degrees=37.0)
    low, values = mesh_of(islands), drawn(islands, "TANGENT")
    hole = (np.abs(islands[1].point(places()).imag) < 0.4) & (values[..., 3] > 0.0) & (places().real > 100)
    values[hole] = (0, 0, 0, -1)
    options = {"name": "AO", "margin": 16, "margin_type": "ADJACENT_FACES"}
    whole, whole_state = finished(values, [low], **options)
    assert (whole_state[hole] == FILLED).any()
    monkeypatch.setattr(bands, "BAND_TEXELS", 30 * values.shape[1])
    monkeypatch.setattr(margin_fill, "FARTHEST_ACROSS", 26)
    texels, state = finished(values, [low], **options)
    assert np.array_equal(state, whole_state)
    off = np.abs(texels - whole).max(axis=-1) > 1e-5  # a position between two texels may be rounded either way
    assert np.count_nonzero(off) < 1e-3 * np.count_nonzero(state == MARGIN)


@pytest.mark.parametrize("margin", [20, None])
def test_misses_far_from_a_band_take_almost_the_nearest_texel(monkeypatch, margin):
    height, width = 160, 216
    alpha = np.random.default_rng(3).choice([0.0, 1.0, -1.0], (height, width), p=[0.5, 0.0005, 0.4995])
    values = marked(alpha)
    monkeypatch.setattr(bands, "BAND_TEXELS", 30 * width)
    for module in (bands, margins):
        monkeypatch.setattr(module, "REACH", 8)
    texels, state = finished(values, [], name="AO", margin=margin)
    taken, truth = squares(values, texels)
    assert np.array_equal(state == WRITTEN, alpha > 0.0)
    assert np.array_equal((state == MISSED) | (state == FILLED), alpha < 0.0)
    assert np.array_equal(texels[..., 3] > 0.0, (state == WRITTEN) | (state == MARGIN))
    if margin is None:
        assert (state[alpha < 0.0] == FILLED).all()
    filled = state == FILLED
    assert np.array_equal(taken[filled & (truth <= 64)], truth[filled & (truth <= 64)])
    slack = 2.0 * np.sqrt(2.0) * margins.COARSE
    assert (np.sqrt(taken[filled]) <= np.sqrt(truth[filled]) + slack).all()
    assert (np.sqrt(truth[filled]) <= (margin or np.inf) * np.sqrt(2.0) + slack).all()
