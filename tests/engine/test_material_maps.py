# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole bakes of what the high meshes' materials show, compared with the closed form of the picture on them."""

import bpy
import numpy as np
import pytest

from addon.engine import bands
from tests.support import layouts, scenes, zoo
from tests.support.feeds import write_png
from tests.support.layouts import Layout
from tests.support.maps import bake_all_maps, raw_maps

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 96
LOW = Layout(degrees=24.0, scale=0.34)
PAINT = Layout(degrees=-37.0, is_mirrored=True, scale=0.31, center=(0.47, 0.55))
FIELDS, DARK, BRIGHT = 10, 0.2, 0.8
METHODS = ("FLATTEN", "CAST")
WITHIN = 0.5
"""Texels from a border of fields within which a texel may show either field."""
EXACT = 1e-3
"""How far a color may be off, scene-linear, away from borders: coordinates are float32, pages of bytes have 8 bits."""


def pair(material, *, low=LOW, paint=PAINT, n=1):
    """A low square, and a high one that has the low layout too, for Flatten, and a layer for images that is rendered."""
    high = layouts.square("hi", {zoo.LAYER: low, layouts.PAINT: paint}, n=n, z=0.01)
    if material is not None:
        high.data.materials.append(material)
    return layouts.square("lo", {zoo.LAYER: low}), high


def checkered(name="checker", socket="Base_Color", *, dark=DARK, bright=BRIGHT, **properties):
    found = bpy.data.materials.new(name)
    shown = scenes.image(name, layouts.checker(FIELDS, 24, dark=dark, bright=bright))
    scenes.set_inputs(found, **{socket: scenes.texture(found, shown, **properties).outputs["Color"]})
    return found


def assert_shows_checker(texels, *, low=LOW, paint=PAINT, dark=DARK, bright=BRIGHT, size=SIZE):
    """Each texel shows the field at its center, unless a border is within half a texel."""
    points, inside = low.texels(size)
    is_bright, to_border = layouts.fields_at(paint.uv(points), FIELDS)
    to_border *= size * low.scale / (FIELDS * paint.scale)  # texels
    middle = 0.5 * (layouts.linear(dark) + layouts.linear(bright))
    inner = inside & (to_border > WITHIN)
    assert inner.mean() > 0.25
    assert ((texels[..., 0] > middle) == is_bright)[inner].all()
    expected = np.where(is_bright, layouts.linear(bright), layouts.linear(dark))[..., None]
    clear = inside & (to_border > 1.0)
    assert clear.mean() > 0.2
    assert np.abs(texels[..., :3] - expected)[clear].max() < EXACT
    assert (texels[..., 3] == 1.0)[inside].all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("samples", [1, 4, 16])
def test_a_checker_comes_back_to_half_a_texel(method, samples):
    _, maps = bake_all_maps(*pair(checkered()), maps=["BASE_COLOR"], size=SIZE, method=method, samples=samples)
    assert_shows_checker(maps["base_color"])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("samples", [1, 4])
def test_several_materials_each_show_their_own(method, samples):
    """Four quads with an image, a constant, no material, and a material without a shader."""
    low, high = pair(checkered(), n=2)
    plain = scenes.material("plain", Base_Color=(0.1, 0.2, 0.3, 1.0))
    bare = bpy.data.materials.new("bare")
    bare.node_tree.nodes.clear()
    for material in (plain, None, bare):
        high.data.materials.append(material)
    high.data.polygons.foreach_set("material_index", np.arange(4))
    report, maps = bake_all_maps(low, high, maps=["BASE_COLOR"], size=SIZE, method=method, samples=samples)
    texels = maps["base_color"]
    points, inside = LOW.texels(SIZE)
    clear = inside & (np.abs(points).min(axis=-1) > 1.5 / (SIZE * LOW.scale))
    right, up = points[..., 0] > 0, points[..., 1] > 0
    assert np.abs(texels[clear & right & ~up, :3] - (0.1, 0.2, 0.3)).max() < EXACT
    assert (texels[clear & right & ~up, 3] == 1.0).all()
    checkers = texels[clear & ~right & ~up, 0]
    assert (
        (np.abs(checkers - layouts.linear(DARK)) < EXACT) | (np.abs(checkers - layouts.linear(BRIGHT)) < EXACT)
    ).mean() > 0.6
    assert np.abs(texels[clear & ~right & up, :3] - 0.8).max() < EXACT  # as Blender shows it
    assert (texels[clear & right & up, 3] == 0.0).all()  # not known
    messages = " ".join(report.warnings)
    assert "bare" in messages, messages


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("is_packed", [False, True])
def test_tiles_of_a_high_mesh(method, is_packed, tmp_path):
    """Each of two UDIM tiles has its own checker; the layout reaches over both."""
    paint = Layout(degrees=12.0, scale=0.4, center=(1.0, 0.5))
    dark = {1001: 0.0, 1002: 0.4}
    for tile, value in dark.items():
        stored = np.round(layouts.checker(FIELDS, 24, dark=value, bright=value + 0.4) * 255).astype(np.uint8)
        write_png(tmp_path / f"tile.{tile}.png", np.repeat(stored[..., None], 3, axis=-1))
    shown = bpy.data.images.load(str(tmp_path / "tile.1001.png"))
    shown.source, shown.filepath = "TILED", str(tmp_path / "tile.<UDIM>.png")
    shown.tiles.new(1002)
    if is_packed:
        shown.pack()
    material = bpy.data.materials.new("tiled")
    scenes.set_inputs(material, Base_Color=scenes.texture(material, shown).outputs["Color"])
    _, maps = bake_all_maps(*pair(material, paint=paint), maps=["BASE_COLOR"], size=SIZE, method=method)
    texels = maps["base_color"]
    points, inside = LOW.texels(SIZE)
    uv = paint.uv(points)
    is_bright, to_border = layouts.fields_at(uv - np.floor(uv), FIELDS)
    clear = inside & (to_border * SIZE * LOW.scale / (FIELDS * paint.scale) > 1.0)
    stored = np.where(uv[..., 0] < 1.0, dark[1001], dark[1002]) + 0.4 * is_bright
    expected = layouts.linear(np.round(stored * 255) / 255)
    for tile in (uv[..., 0] < 1.0, uv[..., 0] > 1.0):
        assert (clear & tile).mean() > 0.1
        assert np.abs(texels[..., 0] - expected)[clear & tile].max() < EXACT


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
@pytest.mark.parametrize("samples", [1, 4])
def test_vertex_colors_come_back(method, domain, samples):
    """A color that is linear on the surface, as the attribute of the settings, as the active one, and in the material."""
    low, high = pair(bpy.data.materials.new("painted"), n=4)
    data = high.data
    attribute = data.color_attributes.new("Scanned", "FLOAT_COLOR", domain)
    numbers = np.arange(len(data.vertices)) if domain == "POINT" else [loop.vertex_index for loop in data.loops]
    places = np.array([data.vertices[number].co for number in numbers])
    colors = np.c_[places[:, :2] * 0.4 + 0.5, places.sum(axis=1) * 0.2 + 0.5, np.ones(len(places))]
    attribute.data.foreach_set("color", colors.astype(np.float32).ravel())
    node = data.materials[0].node_tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = "Scanned"
    scenes.set_inputs(data.materials[0], Base_Color=node.outputs["Color"])
    points, inside = LOW.texels(SIZE)
    expected = np.concatenate([points * 0.4 + 0.5, points.sum(axis=-1, keepdims=True) * 0.2 + 0.5], axis=-1)
    for name in ("", "Scanned"):
        _, maps = bake_all_maps(
            low, high, maps=["BASE_COLOR", "ATTRIBUTE"], size=SIZE, method=method, samples=samples, attribute=name
        )
        for texels in maps["base_color"], maps["attribute"]:
            assert np.abs(texels[..., :3] - expected)[inside].max() < EXACT
            assert (texels[inside, 3] == 1.0).all()


@pytest.mark.parametrize("has_slot", [False, True])
def test_vertex_colors_without_a_material_are_the_base_color(has_slot):
    low, high = pair(None)
    if has_slot:
        high.data.materials.append(None)
    colors = high.data.color_attributes.new("Col", "FLOAT_COLOR", "CORNER")
    colors.data.foreach_set("color", np.tile((0.1, 0.6, 0.3, 1.0), len(high.data.loops)))
    maps = raw_maps(low, high, maps=("BASE_COLOR", "ROUGHNESS"))[1001]
    inside = maps["BASE_COLOR"][..., 3] > 0.0
    assert inside.any()
    assert np.allclose(maps["BASE_COLOR"][inside][:, :3], (0.1, 0.6, 0.3), rtol=0, atol=EXACT)
    assert np.allclose(maps["ROUGHNESS"][inside][:, 0], 0.5, rtol=0, atol=EXACT)


@pytest.mark.parametrize("method", METHODS)
def test_the_channels_of_a_gltf_material(method):
    """Occlusion, roughness and metallic in one image, alpha in the base color, and emission with a strength."""
    material = bpy.data.materials.new("imported")
    tree = material.node_tree
    low, high = pair(material)
    u, v = np.meshgrid((np.arange(64) + 0.5) / 64, (np.arange(64) + 0.5) / 64)
    packed = scenes.texture(material, scenes.image("orm", np.stack([0 * u, u, v], axis=-1), space="Non-Color"))
    split = tree.nodes.new("ShaderNodeSeparateColor")
    tree.links.new(packed.outputs["Color"], split.inputs["Color"])
    color = scenes.texture(material, scenes.image("color", np.stack([u, v, 1 - u], axis=-1), alpha=0.3 + 0.5 * v))
    glow = scenes.texture(material, scenes.image("glow", np.stack([v, u, u], axis=-1)))
    scenes.set_inputs(
        material,
        Roughness=split.outputs["Green"],
        Metallic=split.outputs["Blue"],
        Base_Color=color.outputs["Color"],
        Alpha=color.outputs["Alpha"],
        Emission_Color=glow.outputs["Color"],
        Emission_Strength=3.0,
        Transmission_Weight=0.25,
    )
    names = ["BASE_COLOR", "ROUGHNESS", "METALLIC", "EMISSION", "ALPHA", "TRANSMISSION", "COAT"]
    report, maps = bake_all_maps(low, high, maps=names, size=SIZE, method=method)
    points, inside = LOW.texels(SIZE)
    u, v = np.moveaxis(PAINT.uv(points), -1, 0)
    linear = layouts.linear
    expected = {
        "roughness": np.stack([u, u, u]),
        "metallic": np.stack([v, v, v]),
        "base_color": linear(np.stack([u, v, 1 - u])),
        "alpha": np.stack([0.3 + 0.5 * v] * 3),
        "emission": 3.0 * linear(np.stack([v, u, u])),
        "transmission": np.full((3, *u.shape), 0.25),
        "coat": np.zeros((3, *u.shape)),
    }
    inside &= (np.minimum(u, v) > 0.02) & (np.maximum(u, v) < 0.98)
    for name, values in expected.items():
        error = np.abs(np.moveaxis(maps[name][..., :3], -1, 0) - values)[:, inside]
        assert error.max() < (3.0 if name == "emission" else 1.0) * 2 / 255, name
        assert (maps[name][inside, 3] == 1.0).all(), name


@pytest.mark.parametrize("storage", ["MEMORY", "PACK", "FILE"])
def test_integers_store_colors_as_srgb_and_numbers_as_they_are(storage, tmp_path):
    material = checkered()
    scenes.set_inputs(material, Roughness=0.3)
    report, maps = bake_all_maps(
        *pair(material),
        maps=["BASE_COLOR", "ROUGHNESS"],
        size=SIZE,
        depth=8,
        storage=storage,
        output=str(tmp_path / "map.png"),
    )
    image = bpy.data.images[report.maps["base_color"]["image"]]
    assert image.colorspace_settings.name == "sRGB"
    assert bpy.data.images[report.maps["roughness"]["image"]].colorspace_settings.is_data
    points, inside = LOW.texels(SIZE)
    is_bright, to_border = layouts.fields_at(PAINT.uv(points), FIELDS)
    clear = inside & (to_border * SIZE * LOW.scale / (FIELDS * PAINT.scale) > 1.0)
    expected = np.where(is_bright, BRIGHT, DARK)
    assert np.abs(maps["base_color"][..., 0] - expected)[clear].max() < 0.51 / 255
    assert np.abs(maps["roughness"][..., 0] - 0.3)[inside].max() < 0.51 / 255


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_values_of_attributes_that_are_not_finite_do_not_spread(wrong):
    low, high = pair(None, n=8)
    attribute = high.data.attributes.new("worn", "FLOAT", "POINT")
    attribute.data.foreach_set("value", np.full(len(attribute.data), 0.25, np.float32))
    attribute.data[40].value = wrong
    _, maps = bake_all_maps(low, high, maps=["ATTRIBUTE"], attribute="worn", size=SIZE, samples=4, margin=None)
    assert np.isfinite(maps["attribute"]).all()
    assert np.median(maps["attribute"][..., 0]) == 0.25


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
def test_nan_in_a_color_attribute_changes_its_faces_alone_and_is_named(method, domain):
    low, high = pair(None, n=8)
    attribute = high.data.color_attributes.new("paint", "FLOAT_COLOR", domain)
    values = np.full((len(attribute.data), 4), 0.25, np.float32)
    values[7] = np.nan
    attribute.data.foreach_set("color", values.ravel())
    options = {"maps": ["BASE_COLOR", "ATTRIBUTE"], "attribute": "paint", "size": SIZE, "method": method}
    report, maps = bake_all_maps(low, high, **options)
    _, inside = LOW.texels(SIZE)
    for texels in maps.values():
        assert (np.abs(texels[inside, :3] - 0.25).max(axis=-1) < 1 / 255).mean() > 0.92
    named = [warning for warning in report.warnings if "finite" in warning]
    count = len([loop for loop in high.data.loops if loop.vertex_index == 7]) if domain == "POINT" else 1
    text = f"of 'hi' is not finite at {count} face corners: NaN counts as 0 there, infinity as 65,504."
    assert named == [f"The attribute 'paint' {text}"]
    attribute.data.foreach_set("color", np.full(values.size, 0.25, np.float32))
    report, _ = bake_all_maps(low, high, **options)
    assert not any("finite" in warning for warning in report.warnings)


@pytest.mark.parametrize("name", ["worn", ""])
def test_a_missing_attribute_is_named(name):
    low, high = pair(None)
    other = layouts.square("plain", {zoo.LAYER: LOW}, z=-0.01)
    high.data.attributes.new(name or "worn", "BYTE_COLOR", "POINT")
    report, _ = bake_all_maps(low, high, other, maps=["ATTRIBUTE"], attribute=name, size=16)
    wanted = "attribute 'worn'" if name else "color attribute"
    assert f"The attribute map is black where the high mesh has no {wanted}: 'plain'." in report.warnings
    report, _ = bake_all_maps(low, high, other, maps=["BASE_COLOR"], attribute=name, size=16)
    assert not any("attribute" in warning for warning in report.warnings)


@pytest.mark.parametrize("method", METHODS)
def test_bands_have_no_seams(method, monkeypatch):
    low, high = pair(checkered())
    _, whole = bake_all_maps(low, high, maps=["BASE_COLOR"], size=SIZE, method=method, samples=4, margin=5)
    monkeypatch.setattr(bands, "BAND_TEXELS", 20 * SIZE)
    _, parts = bake_all_maps(low, high, maps=["BASE_COLOR"], size=SIZE, method=method, samples=4, margin=5)
    _, inside = LOW.texels(SIZE)
    assert np.abs(parts["base_color"] - whole["base_color"])[inside].max() < EXACT


@pytest.mark.parametrize("method", METHODS)
def test_tiles_of_the_low_mesh_have_no_seams(method):
    wide = Layout(degrees=24.0, scale=0.34, center=(1.0, 0.5))
    tiles = raw_maps(
        *pair(checkered(), low=wide), maps=["BASE_COLOR"], size=SIZE, method=method, udim=True, storage="PACK"
    )
    both = np.concatenate([tiles[1001]["BASE_COLOR"], tiles[1002]["BASE_COLOR"]], axis=1)
    assert_shows_checker(both[:, SIZE // 2 : -SIZE // 2])
