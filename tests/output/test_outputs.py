# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the images of maps of all kinds: colors, packed channels, and bakes without a normal map."""

import weakref

import bpy
import numpy as np
import pytest
from PIL import Image

from addon.core.map_types import BY_NAME, NORMAL, WRITTEN, Labeled
from addon.core.settings import Settings
from addon.output import datablocks, value_encoding
from addon.output.materials import connect_maps_of_report
from addon.output.outputs import Outputs
from tests.support import scenes
from tests.support.maps import pixels

WIDTH, HEIGHT = 24, 16
LABELS = {Labeled.OBJECTS: ["hi"], Labeled.MATERIALS: []}
STEP_8, STEP_16, STEP_HALF = 0.51 / 255, 0.51 / 65535, 2**-11
"""A bit over half a step of integers, and of 16-bit floats up to 4."""
CURVE = 2e-6
"""The error of single precision in the curve of sRGB."""


def values(seed, top=1.0):
    """Noise (HEIGHT, WIDTH, 4) from 0 to `top` with alpha 1, and a column of background."""
    texels = np.random.default_rng(seed).random((HEIGHT, WIDTH, 4), dtype=np.float32) * np.float32(top)
    texels[..., 3] = 1.0
    texels[:, -1] = 0.0
    return texels


def gray(seed):
    texels = values(seed)
    texels[..., 1] = texels[..., 2] = texels[..., 0]
    return texels


def store(drawn, **settings):
    """Store maps by name; a normal map is added. Returns what Outputs.commit does."""
    settings = Settings(**{"width": WIDTH, "height": HEIGHT, "image": "map"} | settings)
    settings.check()
    state = np.full((HEIGHT, WIDTH), WRITTEN, np.uint8)
    with Outputs(settings) as outputs:
        outputs.add(1001, {name: (texels.copy(), state) for name, texels in {NORMAL.name: values(0), **drawn}.items()})
        return outputs.commit(LABELS, [])


def of_tiles(folder, **settings):
    """The settings of a bake of UDIM tiles into files."""
    output = str(folder / "m.<UDIM>.png")
    return Settings(width=WIDTH, height=HEIGHT, image="map", udim=True, storage="FILE", output=output, **settings)


def linear(stored):
    """sRGB decoded, in double precision."""
    stored = np.asarray(stored, np.float64)
    return np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)


def read(path):
    """The values of a file (HEIGHT, WIDTH, 4) by Blender, as they are stored, row 0 at v = 0."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.is_data = True
    image.alpha_mode = "CHANNEL_PACKED"
    return pixels(image)


# Colors


@pytest.mark.parametrize("name", ["BASE_COLOR", "ATTRIBUTE"])
@pytest.mark.parametrize(("ending", "depth", "step"), [("png", 8, STEP_8), ("png", 16, STEP_16), ("tif", 16, STEP_16)])
def test_colors_in_integers_are_srgb_1(tmp_path, name, ending, depth, step):
    colors = values(1)
    stored = store({name: colors}, maps=(name,), storage="FILE", output=str(tmp_path / f"m.{ending}"), depth=depth)
    image = bpy.data.images[stored.maps[name.lower()]["image"]]
    assert (image.colorspace_settings.name, image.alpha_mode) == ("sRGB", "CHANNEL_PACKED")
    assert stored.maps[name.lower()]["color_space"] == "sRGB"
    expected = value_encoding.to_srgb(colors[..., :3])
    np.testing.assert_allclose(linear(expected), colors[..., :3], atol=CURVE)
    found = read(tmp_path / f"m_{BY_NAME[name].suffix}.{ending}")
    np.testing.assert_allclose(found[..., :3], expected, atol=step)
    assert (found[..., 3] == colors[..., 3]).all()
    assert bpy.data.images["map"].colorspace_settings.name == "Non-Color"


def test_pillow_reads_srgb_colors_2(tmp_path):
    colors = values(2)
    store({"BASE_COLOR": colors}, maps=("BASE_COLOR",), storage="FILE", output=str(tmp_path / "m.png"), depth=8)
    with Image.open(tmp_path / "m_base_color.png") as file:
        found = np.asarray(file)[::-1] / 255
    np.testing.assert_allclose(linear(found[..., :3]), colors[..., :3], atol=2.3 * STEP_8)  # the curve's steepest slope


@pytest.mark.parametrize(("depth", "step"), [(16, STEP_HALF), (32, CURVE)])
def test_colors_in_floats_stay_linear_3(tmp_path, depth, step):
    colors = values(3, top=4.0)
    stored = store(
        {"EMISSION": colors}, maps=("EMISSION",), storage="FILE", output=str(tmp_path / "m.exr"), depth=depth
    )
    how = stored.maps["emission"]
    assert (how["scale"], how["color_space"]) == (1.0, "Linear Rec.709")
    image = bpy.data.images[how["image"]]
    assert image.colorspace_settings.name == "Linear Rec.709"
    np.testing.assert_allclose(pixels(image)[..., :3], colors[..., :3], atol=2 * step)


def test_png_files_of_colors_alone_say_that_they_are_srgb(tmp_path):
    maps = {"BASE_COLOR": values(3), "AO": gray(5)}
    store(maps, maps=tuple(maps), storage="FILE", output=str(tmp_path / "m.png"), depth=8)
    declares = {path.stem: b"sRGB" in path.read_bytes()[:100] for path in tmp_path.iterdir()}
    assert declares == {"m": False, "m_ao": False, "m_base_color": True}


@pytest.mark.parametrize(("top", "depth"), [(70_000.0, 16), (70_000.0, 32), (60_000.0, 16)])
def test_colors_that_16_bit_floats_do_not_hold_are_named(tmp_path, top, depth):
    colors = values(3, top=top)
    output = str(tmp_path / "m.exr")
    stored = store({"EMISSION": colors}, maps=("EMISSION",), storage="FILE", output=output, depth=depth)
    warning = "16-bit floats cut off values beyond 65,504 of the emission map; --depth 32 keeps them."
    assert stored.warnings == ([warning] if (top, depth) == (70_000.0, 16) else [])


def test_each_map_that_16_bit_floats_do_not_hold_is_named(tmp_path):
    bright = {name: values(3, top=70_000.0) for name in ("EMISSION", "BASE_COLOR", "METALLIC")}
    bright["METALLIC"] /= 2.0
    (warning,) = store(bright, maps=tuple(bright), storage="FILE", output=str(tmp_path / "m.exr"), depth=16).warnings
    assert warning.startswith("16-bit floats cut off values beyond 65,504 of the base color map, emission map; ")


def test_each_map_knows_its_high_objects():
    store({"BASE_COLOR": values(3), "AO": gray(5)}, maps=("BASE_COLOR", "AO"))
    for name in ("map", "map_base_color", "map_ao"):
        assert datablocks.origin(name) == LABELS[Labeled.OBJECTS]


@pytest.mark.parametrize("with_value", [0, 1])
def test_a_map_is_empty_if_all_its_tiles_are(tmp_path, with_value):
    settings = of_tiles(tmp_path, maps=("BASE_COLOR", "METALLIC"))
    state = np.full((HEIGHT, WIDTH), WRITTEN, np.uint8)
    none = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    with Outputs(settings) as outputs:
        for number, tile in enumerate((1001, 1002)):
            color = values(3) if number == with_value else none.copy()
            drawn = {NORMAL.name: values(0), "BASE_COLOR": color, "METALLIC": none.copy()}
            outputs.add(tile, {name: (texels, state) for name, texels in drawn.items()})
        stored = outputs.commit(LABELS, [])
    assert [name for name, how in stored.maps.items() if how.get("empty")] == ["metallic"]


@pytest.mark.parametrize("storage", ["PACK", "MEMORY"])
@pytest.mark.parametrize(
    ("name", "depth", "space"),
    [
        ("BASE_COLOR", 8, "sRGB"),
        ("BASE_COLOR", 16, "sRGB"),
        ("BASE_COLOR", 32, "Linear Rec.709"),
        ("ATTRIBUTE", 16, "Linear Rec.709"),
    ],
)
def test_colors_in_images_inside_blender_4(storage, name, depth, space):
    colors = values(4)
    stored = store({name: colors}, maps=(name,), storage=storage, depth=depth)
    image = bpy.data.images[stored.maps[name.lower()]["image"]]
    assert image.colorspace_settings.name == stored.maps[name.lower()]["color_space"] == space
    expected = value_encoding.to_srgb(colors[..., :3]) if space == "sRGB" else colors[..., :3]
    np.testing.assert_allclose(pixels(image)[..., :3], expected, atol=STEP_8 if space == "sRGB" else CURVE)


def test_an_image_of_data_becomes_one_of_colors_and_back_5():
    texels = gray(5)
    image = store({"COVERAGE": texels}, normal=False, maps=("COVERAGE",), depth=8).image
    for name, space in (("BASE_COLOR", "sRGB"), ("COVERAGE", "Non-Color")):
        image.name = f"map_{name.lower()}"
        assert store({name: texels}, normal=False, maps=(name,), depth=8).image == image
        assert image.colorspace_settings.name == space
        expected = value_encoding.to_srgb(texels[..., :3]) if name == "BASE_COLOR" else texels[..., :3]
        np.testing.assert_allclose(pixels(image)[..., :3], expected, atol=STEP_8)


def test_lights_too_bright_for_integers_are_scaled_6():
    bright, dark = values(6, top=5.0), values(6, top=0.5)
    for colors in (bright, dark):
        how = store({"EMISSION": colors}, maps=("EMISSION",), depth=8).maps["emission"]
        assert how["scale"] == pytest.approx(max(1.0, colors[..., :3].max()))
        found = linear(pixels(bpy.data.images[how["image"]])[..., :3]) * how["scale"]
        np.testing.assert_allclose(found, colors[..., :3], atol=2.3 * STEP_8 * how["scale"])


def test_colors_of_another_working_space_are_converted_7(monkeypatch):
    """A working space whose red is Rec.709's green, and so on."""
    from addon.output import datablocks

    class Turned:
        def __init__(self, color):
            self.color = np.asarray(color)

        def from_scene_linear_to_rec709_linear(self):
            return np.roll(self.color, 1)

    monkeypatch.setattr(datablocks, "Color", Turned)
    colors = values(7)
    image = bpy.data.images[store({"BASE_COLOR": colors}, maps=("BASE_COLOR",), depth=32).maps["base_color"]["image"]]
    np.testing.assert_allclose(pixels(image)[..., :3], np.roll(colors[..., :3], 1, axis=-1), atol=CURVE)


# Bent normals


def test_the_range_of_heights_is_that_of_all_tiles():
    tiles = np.ones((2, 2, 2, 4), np.float32)
    tiles[0, ..., :3], tiles[1, ..., :3] = 0.25, -2.0
    storing = Settings(storage="FILE", output="m.png", depth=16).storing
    for maps in (tiles, tiles[::-1]):
        assert value_encoding.encoding(BY_NAME["HEIGHT"], maps, (), storing) == {"midlevel": 0.5, "scale": 4.0}


def test_bent_normals_are_stored_as_they_were_drawn_8():
    normals = values(8)
    normals[:, -1] = (0.5, 0.5, 1.0, 0.0)
    stored = store({"BENT_NORMAL": normals}, maps=("BENT_NORMAL",), depth=32)
    assert stored.maps["bent_normal"] == {"image": "map_bent_normal", "midlevel": 0.5, "scale": 2.0}
    assert (pixels(bpy.data.images["map_bent_normal"]) == normals).all()


# Packed images

SOURCES = {"AO": 11, "ROUGHNESS": 12, "METALLIC": 13}
"""Seeds."""
SUFFIXES = {"GLTF": "orm", "URP": "metallic_smoothness", "HDRP": "mask"}


def packed(**settings):
    maps = {name: gray(seed) for name, seed in SOURCES.items()}
    return {name: texels[..., 0] for name, texels in maps.items()}, store(maps, **settings)


@pytest.mark.parametrize("pack", SUFFIXES)
@pytest.mark.parametrize(
    ("ending", "depth", "step"),
    [("png", 8, STEP_8), ("png", 16, STEP_16), ("tif", 16, STEP_16), ("tga", 8, STEP_8), ("exr", 32, 0.0)],
)
def test_channels_in_files_11_12_13(tmp_path, pack, ending, depth, step):
    suffix = SUFFIXES[pack]
    sources, stored = packed(pack=pack, storage="FILE", output=str(tmp_path / f"m.{ending}"), depth=depth)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([f"m.{ending}", f"m_{suffix}.{ending}"])
    assert stored.paths == [str(tmp_path / f"m.{ending}"), str(tmp_path / f"m_{suffix}.{ending}")]
    known = np.ones((HEIGHT, WIDTH), bool)
    known[:, -1] = False
    smooth, ones = np.where(known, 1 - sources["ROUGHNESS"], 0), np.ones((HEIGHT, WIDTH))
    ao, rough, metal = sources.values()
    expected = {
        "GLTF": (ao, rough, metal, ones),
        "URP": (metal, 0 * ones, 0 * ones, smooth),
        "HDRP": (metal, ao, ones, smooth),
    }[pack]
    image = bpy.data.images[f"map_{suffix}"]
    assert (image.colorspace_settings.name, image.alpha_mode) == ("Non-Color", "CHANNEL_PACKED")
    for found in (pixels(image), read(tmp_path / f"m_{suffix}.{ending}")):
        np.testing.assert_allclose(found, np.stack(expected, axis=-1), atol=step)


@pytest.mark.parametrize(("depth", "step"), [(8, STEP_8), (16, 0.0)])
def test_channels_in_packed_images_stay_after_saving_11_12_13(tmp_path, depth, step):
    sources, _ = packed(pack="HDRP", depth=depth)
    before = pixels(bpy.data.images["map_mask"])
    bpy.data.images["map_mask"].use_fake_user = True
    path = str(tmp_path / "scene.blend")
    scenes.save(path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert (pixels(bpy.data.images["map_mask"]) == before).all()
    np.testing.assert_allclose(before[:, :-1, 3], 1 - sources["ROUGHNESS"][:, :-1], atol=step)


def test_the_report_has_the_channels():
    _, stored = packed(pack="HDRP")
    unit = {"midlevel": 0.0, "scale": 1.0}
    assert stored.maps == {
        "packed": {
            "image": "map_mask",
            "channels": {
                "red": {"map": "metallic", **unit},
                "green": {"map": "ao", **unit},
                "blue": {"constant": 1.0},
                "alpha": {"map": "roughness", "inverted": True, **unit},
            },
        }
    }


def test_a_packed_map_may_have_its_own_image_too():
    sources, stored = packed(pack="GLTF", maps=("ROUGHNESS",), depth=32)
    assert set(stored.maps) == {"roughness", "packed"}
    assert (pixels(bpy.data.images["map_roughness"])[..., 0] == sources["ROUGHNESS"]).all()
    assert (pixels(bpy.data.images["map_orm"])[..., 1] == sources["ROUGHNESS"]).all()


def test_heights_are_scaled_before_they_are_packed_14():
    heights = gray(14) - np.float32((0.5, 0.5, 0.5, 0))
    custom = {"pack": "CUSTOM", "pack_red": "HEIGHT", "pack_green": "ZERO", "pack_blue": "ZERO", "pack_alpha": "ONE"}
    how = store({"HEIGHT": heights}, depth=8, **custom).maps["packed"]["channels"]["red"]
    found = pixels(bpy.data.images["map_packed"])[..., 0]
    np.testing.assert_allclose(
        (found[:, :-1] - how["midlevel"]) * how["scale"], heights[:, :-1, 0], atol=STEP_8 * how["scale"]
    )


def test_alpha_that_holds_a_map_is_dithered_as_a_color():
    level = np.full((HEIGHT, WIDTH, 4), 100.25 / 255, np.float32)
    level[..., 3] = 1.0
    maps = dict.fromkeys(SOURCES, level)
    store(maps, pack="URP", depth=8, dither=True)
    alpha = pixels(bpy.data.images["map_metallic_smoothness"])[..., 3] * 255
    assert len(np.unique(alpha.round())) == 2
    assert abs(alpha.mean() - (255 - 100.25)) < 0.05


def test_colors_are_dithered_also_where_such_an_alpha_is_0():
    level = np.full((HEIGHT, WIDTH, 4), 100.25 / 255, np.float32)
    level[..., 3] = 1.0
    rough = np.ones_like(level)
    store({"METALLIC": level, "ROUGHNESS": rough, "AO": level}, pack="URP", depth=8, dither=True)
    found = pixels(bpy.data.images["map_metallic_smoothness"])
    assert (found[..., 3] == 0.0).all()
    assert abs(found[..., 0].mean() * 255 - 100.25) < 0.05


# Without a normal map


@pytest.mark.parametrize(
    ("settings", "first"),
    [
        ({"maps": ("HEIGHT", "DISTANCE")}, "map_height"),
        ({"maps": ("HEIGHT", "DISTANCE"), "mask": True}, "map_height"),
        ({"pack": "GLTF"}, "map_orm"),
    ],
)
def test_without_a_normal_map_the_first_other_map_is_the_result(tmp_path, settings, first):
    maps = {name: gray(15) for name in ("HEIGHT", "DISTANCE", *SOURCES)}
    stored = store(maps, normal=False, storage="FILE", output=str(tmp_path / "m.png"), **settings)
    assert stored.image.name == first
    assert stored.tiles == [1001]
    assert stored.loss == {}
    assert "map" not in bpy.data.images
    assert not (tmp_path / "m.png").exists()
    assert first.replace("map", "m") + ".png" in {path.name for path in tmp_path.iterdir()}


# Into materials, as the report has them


def material_of(stored):
    low = bpy.data.objects.new("Low", bpy.data.meshes.new("Low"))
    low.data.uv_layers.new(name="Layout")
    scenes.material("Skin", low)
    warnings = connect_maps_of_report(low, stored.maps, "Layout", space="TANGENT", single_user=False)
    return warnings, low.active_material.node_tree.nodes["Principled BSDF"]


def shown(socket):
    """The image at an input and the nodes in between."""
    kinds = []
    while socket.is_linked:
        node = socket.links[0].from_node
        kinds.append((node.bl_idname.removeprefix("ShaderNode"), socket.links[0].from_socket.name))
        if node.bl_idname == "ShaderNodeTexImage":
            return node.image.name, kinds
        socket = node.inputs[1] if node.bl_idname == "ShaderNodeMath" else node.inputs[0]
    return None, kinds


def test_packed_maps_are_preferred_to_separate_ones():
    _, stored = packed(pack="URP", maps=("ROUGHNESS",))
    warnings, principled = material_of(stored)
    assert warnings == []
    smoothness = [("Math", "Value"), ("TexImage", "Alpha")]
    assert shown(principled.inputs["Roughness"]) == ("map_metallic_smoothness", smoothness)
    metal = [("SeparateColor", "Red"), ("TexImage", "Color")]
    assert shown(principled.inputs["Metallic"]) == ("map_metallic_smoothness", metal)


def test_an_image_that_is_gone_is_named():
    _, stored = packed(pack="GLTF", maps=("ROUGHNESS",))
    bpy.data.images.remove(bpy.data.images["map_orm"])
    warnings, principled = material_of(stored)
    assert len(warnings) == 1
    assert "'map_orm'" in warnings[0]
    assert shown(principled.inputs["Roughness"])[0] == "map_roughness"


def test_maps_that_no_input_takes_change_no_material():
    stored = store({"CURVATURE": gray(16)}, maps=("CURVATURE",))
    low = bpy.data.objects.new("Low", bpy.data.meshes.new("Low"))
    assert connect_maps_of_report(low, stored.maps, "", space="TANGENT", single_user=False) == []
    assert len(low.material_slots) == 0


# UDIM tiles


@pytest.mark.parametrize(
    ("storage", "depth", "space"),
    [("FILE", 8, "sRGB"), ("FILE", 16, "sRGB"), ("PACK", 8, "sRGB"), ("PACK", 32, "Linear Rec.709")],
)
def test_tiles_of_colors_and_of_packed_images_21(tmp_path, storage, depth, space):
    output = str(tmp_path / "m.<UDIM>.png") if storage == "FILE" else ""
    settings = Settings(
        width=WIDTH,
        height=HEIGHT,
        image="map",
        udim=True,
        storage=storage,
        output=output,
        depth=depth,
        maps=("BASE_COLOR",),
        pack="URP",
    )
    settings.check()
    state = np.full((HEIGHT, WIDTH), WRITTEN, np.uint8)
    tiles = {}
    with Outputs(settings) as outputs:
        for tile in (1001, 1002):
            drawn = {NORMAL.name: values(0), "BASE_COLOR": values(21 + tile)}
            drawn |= {name: gray(seed + tile) for name, seed in SOURCES.items()}
            tiles[tile] = {name: texels.copy() for name, texels in drawn.items()}
            outputs.add(tile, {name: (texels, state) for name, texels in drawn.items()})
        stored = outputs.commit(LABELS, [])
    colors = bpy.data.images[stored.maps["base_color"]["image"]]
    mask = bpy.data.images[stored.maps["packed"]["image"]]
    assert (colors.colorspace_settings.name, mask.colorspace_settings.name) == (space, "Non-Color")
    for image in (colors, mask):
        assert (image.source, image.alpha_mode) == ("TILED", "CHANNEL_PACKED")
        assert [tile.number for tile in image.tiles] == [1001, 1002]
    if storage == "FILE":
        for tile, maps in tiles.items():
            found = read(tmp_path / f"m_base_color.{tile}.png")[..., :3]
            np.testing.assert_allclose(
                found, value_encoding.to_srgb(maps["BASE_COLOR"][..., :3]), atol=STEP_8 if depth == 8 else STEP_16
            )
            alpha = read(tmp_path / f"m_metallic_smoothness.{tile}.png")[:, :-1, 3]
            np.testing.assert_allclose(alpha, 1 - maps["ROUGHNESS"][:, :-1, 0], atol=STEP_8 if depth == 8 else STEP_16)
    else:
        first = tiles[1001]["BASE_COLOR"][..., :3]
        expected = value_encoding.to_srgb(first) if depth == 8 else first
        np.testing.assert_allclose(pixels(colors)[..., :3], expected, atol=STEP_8 if depth == 8 else CURVE)


def test_tiles_in_files_do_not_stay_in_memory_unless_their_range_counts(tmp_path):
    settings = of_tiles(tmp_path, maps=("HEIGHT", "AO", "BASE_COLOR", "OBJECT_ID"), pack="GLTF")
    state = np.full((HEIGHT, WIDTH), WRITTEN, np.uint8)
    with Outputs(settings) as outputs:
        for tile in (1001, 1002):
            drawn = {name: gray(tile) for name in (NORMAL.name, *settings.map.drawn_maps)}
            kept = {name: weakref.ref(texels) for name, texels in drawn.items()}
            outputs.add(tile, {name: (texels, state) for name, texels in drawn.items()})
            del drawn
            assert [name for name, texels in kept.items() if texels() is not None] == ["HEIGHT"]
        stored = outputs.commit(LABELS, [])
    assert set(stored.maps) == {"height", "ao", "base_color", "object_id", "packed"}
    assert list(stored.maps["object_id"]["colours"]) == ["hi"]
    assert len(stored.paths) == 12


@pytest.mark.parametrize(
    ("name", "values", "wanted"),
    [
        ("HEIGHT", (-0.25, 0.0, 0.5), (0.25, 0.5, 1.0)),
        ("DISTANCE", (0.0, 0.25, 0.5), (0.0, 0.5, 1.0)),
        ("POSITION", (-0.5, 0.0, 0.25), (0.0, 0.5, 0.75)),
    ],
)
def test_a_range_that_is_set_is_the_same_for_all_bakes(name, values, wanted):
    storing = Settings(value_range=0.5, depth=8).storing
    for factor in (1.0, 0.5):
        texels = np.ones((1, 3, 4), np.float32)
        texels[0, :, :3] = factor * np.array(values, np.float32)[:, None]
        how = value_encoding.encoding(BY_NAME[name], [texels], (), storing)
        value_encoding.encode((texels, np.full((1, 3), WRITTEN, np.uint8)), how)
        middle = 0.0 if name == "DISTANCE" else 0.5
        assert texels[0, :, 0] == pytest.approx(middle + factor * (np.array(wanted) - middle), abs=1e-6)


def test_a_range_leaves_colors_and_shares_alone():
    texels = np.full((1, 1, 4), 0.25, np.float32)
    for name in ("AO", "BASE_COLOR"):
        both = [
            value_encoding.encoding(BY_NAME[name], [texels], (), Settings(value_range=size, depth=8).storing)
            for size in (None, 0.5)
        ]
        assert both[0] == both[1]
