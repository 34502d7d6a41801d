# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the pixels of images: as Cycles shows them, from every place that Blender takes them from, without a trace."""

import struct

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.scene.textures import ImageTextures, UnreadableError, srgb_to_linear
from tests.support import feeds, scenes

TOLERANCE = 2 / 255
WIDTH, HEIGHT = 7, 5
SPACES = ["sRGB", "Non-Color", "Linear Rec.709", "Display P3", "ACEScg"]
ALPHAS = ["STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE"]


def stored(bits=8, seed=0, alpha="STRAIGHT", size=(WIDTH, HEIGHT), channels=4) -> np.ndarray:
    """Random stored values; alpha is at least a half, because Cycles rounds colors that are multiplied with alpha."""
    largest = 2**bits - 1
    values = np.random.default_rng(seed).integers(0, largest + 1, (size[1], size[0], channels)).astype(np.float64)
    if channels == 4:
        values[..., 3] = largest / 2 + values[..., 3] // 2
        if alpha == "PREMUL":
            values[..., :3] *= values[..., 3:] / largest
    return np.rint(values).clip(0, largest).astype(np.uint8 if bits == 8 else np.uint16)


def load(path, values, *, space="sRGB", alpha="STRAIGHT"):
    image = bpy.data.images.load(feeds.write_png(path, values))
    image.colorspace_settings.name = space
    image.alpha_mode = alpha
    return image


def pixels_of(image, tile=0, *, is_premultiplied=False) -> np.ndarray:
    images = ImageTextures()
    found = images.texture(image, is_premultiplied=is_premultiplied)
    loaded = images.load(found.key, tile)
    assert loaded.values.shape[1::-1] == images.size(found.key, tile)
    assert loaded.values.dtype == np.float32
    if loaded.is_byte:
        assert np.abs(loaded.values * 255 - np.rint(loaded.values * 255)).max() < 1e-4
    return feeds.scene_linear(loaded)


def test_colors_of_16_bits_are_multiplied_with_alpha_after_they_are_linear(tmp_path):
    values = stored(16)
    image = load(tmp_path / "image.png", values)
    shown = values / 65535
    expected = srgb_to_linear(shown[..., :3]) * shown[..., 3:]
    assert np.abs(pixels_of(image, is_premultiplied=True)[..., :3] - expected).max() < TOLERANCE


def write_tiff(path, values) -> str:
    """Write stored values (H, W, 4), row 0 at the bottom. The meaning of the fourth channel is left open. Returns the path."""
    height, width, channels = values.shape
    data, bits = values[::-1].tobytes(), 8 * values.dtype.itemsize
    short, long = 3, 4
    tags = (
        *((256, short, 1, width), (257, short, 1, height), (258, short, channels, 8), (259, short, 1, 1)),
        *((262, short, 1, 2), (273, long, 1, 16), (277, short, 1, channels), (278, short, 1, height)),
        *((279, long, 1, len(data)), (338, short, 1, 0)),
    )
    entries = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    directory = struct.pack("<H", len(tags)) + entries + struct.pack("<I", 0)
    each = struct.pack(f"<{channels}H", *[bits] * channels)
    path.write_bytes(b"II*\0" + struct.pack("<I", 16 + len(data)) + each + data + directory)
    return str(path)


@pytest.mark.parametrize("kind", ["gray and alpha", "open channel of 8 bits", "open channel of 16 bits"])
def test_alpha_of_rare_files_is_that_of_blenders_buffer(tmp_path, kind):
    """Cycles reads other values from some of them."""
    values = stored(16 if "16" in kind else 8, seed=7)
    if kind == "gray and alpha":
        values[..., :3] = values[..., :1]
        path = feeds.write_png(tmp_path / "image.png", values[..., [0, 3]])
    else:
        path = write_tiff(tmp_path / "image.tif", values)
    image = bpy.data.images.load(path)
    buffer = np.array(image.pixels[:]).reshape(HEIGHT, WIDTH, 4)
    assert (buffer[..., 3] < 0.9).any()
    colors, alpha = buffer[..., :3], buffer[..., 3:]
    straight = colors / alpha if image.is_float else srgb_to_linear(colors)
    multiplied = colors if image.is_float else srgb_to_linear(colors * alpha)
    for is_premultiplied, expected in ((False, straight), (True, multiplied)):
        found = pixels_of(image, is_premultiplied=is_premultiplied)
        assert np.abs(found - np.concatenate([expected, alpha], axis=-1)).max() < TOLERANCE


def in_cycles(image, *, uses_alpha) -> np.ndarray:
    """The image as Cycles bakes it, a texel for each pixel, of (size, size, 3) where it is larger than the image."""
    material = bpy.data.materials.new("M")
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image, node.interpolation = image, "Closest"
    if uses_alpha:
        tree.links.new(node.outputs["Alpha"], tree.nodes["Principled BSDF"].inputs["Alpha"])
    size = 35  # a multiple of both sides
    texels = feeds.cycles(feeds.square(material), node.outputs["Color"], size)
    return texels[size // HEIGHT // 2 :: size // HEIGHT, size // WIDTH // 2 :: size // WIDTH]


@pytest.mark.parametrize("uses_alpha", [True, False])
@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize(
    ("bits", "space"), [(8, "sRGB"), (8, "Non-Color"), (8, "Display P3"), (16, "sRGB"), (16, "Linear Rec.709")]
)
def test_pixels_are_those_of_cycles(tmp_path, bits, space, alpha, uses_alpha):
    if (bits, space, uses_alpha) == (16, "sRGB", False) and alpha in {"STRAIGHT", "PREMUL"}:
        return  # Cycles multiplies with alpha before it makes 16 bits linear; EEVEE does so afterwards
    image = load(tmp_path / "image.png", stored(bits, alpha=alpha), space=space, alpha=alpha)
    theirs = in_cycles(image, uses_alpha=uses_alpha)
    mine = pixels_of(image, is_premultiplied=not uses_alpha)
    # Cycles rounds 8 bits after the multiplication with alpha, and divides them by it afterwards.
    rounds = (bits, space, alpha, uses_alpha) == (8, "sRGB", "STRAIGHT", True)
    assert np.abs(mine[..., :3] - theirs).max() < TOLERANCE * (2 if rounds else 1)
    assert theirs.max() > 0.5


@pytest.mark.parametrize("space", SPACES)
def test_pixels_in_another_working_space(tmp_path, space):
    bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=False)
    image = load(tmp_path / "image.png", stored(channels=3), space=space)
    assert np.abs(pixels_of(image)[..., :3] - in_cycles(image, uses_alpha=False)).max() < TOLERANCE


@pytest.mark.parametrize(
    ("settings", "flags"),
    [
        ((8, "sRGB", "STRAIGHT", True), "srgb byte"),
        ((8, "sRGB", "STRAIGHT", False), "srgb byte weighs"),
        ((8, "sRGB", "CHANNEL_PACKED", False), "srgb byte"),
        ((8, "Non-Color", "STRAIGHT", False), "byte"),
        ((8, "Linear Rec.709", "STRAIGHT", False), "byte weighs"),
        ((8, "Linear Rec.709", "STRAIGHT", True), ""),
        ((8, "Display P3", "NONE", True), ""),
        ((16, "sRGB", "STRAIGHT", False), "weighs"),
        ((16, "Non-Color", "STRAIGHT", False), ""),
    ],
)
def test_textures_say_what_is_stored(tmp_path, settings, flags):
    """8 bits stay 8 bits on the GPU where they suffice, and alpha weighs straight colors."""
    bits, space, alpha, is_premultiplied = settings
    image = load(tmp_path / "image.png", stored(bits), space=space, alpha=alpha)
    images = ImageTextures()
    found = images.load(images.texture(image, is_premultiplied=is_premultiplied).key)
    said = {"srgb": found.is_srgb, "byte": found.is_byte, "weighs": found.weighs_alpha}
    assert " ".join(name for name, value in said.items() if value) == flags


def test_one_key_where_alpha_has_no_influence(tmp_path):
    """The texture is loaded once for the sockets that use alpha and for those that do not."""
    images = ImageTextures()
    for space, alpha, keys in (("sRGB", "STRAIGHT", 2), ("sRGB", "CHANNEL_PACKED", 1), ("Non-Color", "STRAIGHT", 1)):
        image = load(tmp_path / "image.png", stored(), space=space, alpha=alpha)
        assert len({images.texture(image, is_premultiplied=value).key for value in (True, False)}) == keys


def test_what_is_transparent_has_finite_colors(tmp_path):
    values = stored(16)
    values[..., 3] = 0
    assert np.isfinite(pixels_of(load(tmp_path / "image.png", values))).all()


@pytest.mark.parametrize("alpha", ["STRAIGHT", "CHANNEL_PACKED"])
def test_the_alpha_mode_of_packed_tiles(tmp_path, alpha):
    image = bpy.data.images.new("tiles", 1, 1, tiled=True)
    values = stored(seed=4)
    feeds.write_png(tmp_path / "tile.1001.png", values)
    image.source, image.filepath, image.alpha_mode = "TILED", str(tmp_path / "tile.<UDIM>.png"), alpha
    image.pixels[0]
    image.pack()
    single = load(tmp_path / "single.png", values, alpha=alpha)
    assert (pixels_of(image, 1001, is_premultiplied=True) == pixels_of(single, is_premultiplied=True)).all()


def test_an_image_without_transparency_has_nothing_to_weigh(tmp_path):
    images = ImageTextures()
    image = load(tmp_path / "image.png", stored(channels=3))
    assert not images.load(images.texture(image, is_premultiplied=False).key).weighs_alpha


def test_srgb_is_linear_by_the_exact_formula(tmp_path):
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=2)
    mine = pixels_of(load(tmp_path / "levels.png", levels))
    assert np.abs(mine[..., 0] - srgb_to_linear(np.arange(256).reshape(16, 16) / 255)).max() < 1e-6
    assert (mine[..., 3] == 1.0).all()


def test_data_and_linear_bytes_are_raw(tmp_path):
    values = stored()
    for space in ("Non-Color", "Linear Rec.709"):
        assert np.abs(pixels_of(load(tmp_path / "raw.png", values, space=space)) - values / 255).max() < 1e-6


def test_float_files(tmp_path):
    """OpenEXR files have values above one."""
    image = bpy.data.images.new("own", WIDTH, HEIGHT, alpha=True, float_buffer=True, is_data=True)
    values = np.random.default_rng(0).uniform(0, 4, (HEIGHT, WIDTH, 4)).astype(np.float32)
    image.pixels.foreach_set(values.ravel())
    image.filepath_raw, image.file_format = str(tmp_path / "own.exr"), "OPEN_EXR"
    image.save()
    loaded = bpy.data.images.load(image.filepath_raw)
    loaded.colorspace_settings.name = "Non-Color"
    assert np.abs(pixels_of(loaded) - values).max() < 0.002  # half floats


def tiled(tmp_path, names="tile.<UDIM>.png", tiles=(1001, 1002, 1011)):
    """An image of tiles of several sizes, and their stored values."""
    values = {tile: stored(seed=tile, size=(4 + place, 3), channels=3) for place, tile in enumerate(tiles)}
    for tile, pixels in values.items():
        column, row = (tile - 1001) % 10 + 1, (tile - 1001) // 10 + 1
        name = names.replace("<UDIM>", str(tile)).replace("<UVTILE>", f"u{column}_v{row}")
        feeds.write_png(tmp_path / name, pixels)
    image = bpy.data.images.new("tiles", 1, 1, tiled=True)
    image.source, image.filepath = "TILED", str(tmp_path / names)
    for tile in tiles[1:]:
        image.tiles.new(tile)
    image.colorspace_settings.name = "Non-Color"
    return image, values


@pytest.mark.parametrize("names", ["tile.<UDIM>.png", "tile_<UVTILE>.png"])
@pytest.mark.parametrize("is_packed", [True, False])
@pytest.mark.parametrize("is_loaded", [True, False])
def test_each_tile_has_its_own_pixels(tmp_path, names, is_packed, is_loaded):
    image, values = tiled(tmp_path, names)
    if is_packed:
        image.pack()
        for file in tmp_path.iterdir():
            file.unlink()
    if is_loaded:
        image.pixels[0]
    assert ImageTextures().texture(image, is_premultiplied=True).tiles == (1001, 1002, 1011)
    for tile, pixels in values.items():
        assert np.abs(pixels_of(image, tile)[..., :3] - pixels / 255).max() < 1e-6


def test_a_missing_tile_is_named(tmp_path):
    image, _ = tiled(tmp_path)
    (tmp_path / "tile.1002.png").unlink()
    found = ImageTextures().texture(image, is_premultiplied=True)
    assert found.tiles == (1001, 1011)
    (note,) = found.notes
    assert note == f'the image "tiles" has no pixels: {tmp_path / "tile.1002.png"} cannot be read'


def test_generated_and_packed_images(tmp_path):
    grid = bpy.data.images.new("grid", 32, 16)
    grid.generated_type = "UV_GRID"
    assert pixels_of(grid).shape == (16, 32, 4)
    assert not grid.has_data
    values = stored(channels=3)
    image = load(tmp_path / "packed.png", values, space="Non-Color")
    image.pack()
    image.buffers_free()
    (tmp_path / "packed.png").unlink()
    assert np.abs(pixels_of(image)[..., :3] - values / 255).max() < 1e-6


def test_unsaved_pixels_count():
    image = bpy.data.images.new("painted", 2, 2)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(np.full(16, 0.25, np.float32))
    assert image.is_dirty
    assert np.abs(pixels_of(image) - 0.25).max() < 0.003
    assert image.is_dirty
    assert image.has_data


def images_of_all_kinds(tmp_path):
    yield load(tmp_path / "plain.png", stored())
    loaded = load(tmp_path / "loaded.png", stored(16))
    loaded.pixels[0]
    yield loaded
    odd = load(tmp_path / "odd.png", stored(), space="Display P3")
    yield odd
    yield tiled(tmp_path)[0]
    yield bpy.data.images.new("generated", 4, 4)


def test_nothing_is_left_behind(tmp_path):
    images = list(images_of_all_kinds(tmp_path))

    def state():
        return [
            (i.name, i.has_data, i.is_dirty, i.source, i.filepath, i.alpha_mode, i.colorspace_settings.name, i.users)
            + ((len(i.tiles), i.tiles.active_index) if i.source == "TILED" else ())
            for i in bpy.data.images
        ]

    before = state()
    for image in images:
        found = ImageTextures().texture(image, is_premultiplied=True)
        for tile in found.tiles or (0,):
            pixels_of(image, tile)
        assert state() == before


@pytest.mark.parametrize("ending", ["png", "jpg", "tif"])
def test_the_size_comes_from_the_header(tmp_path, ending, monkeypatch):
    """No pixels are loaded for it."""
    image = bpy.data.images.new("own", 33, 17)
    image.filepath_raw = str(tmp_path / f"own.{ending}")
    image.file_format = {"png": "PNG", "jpg": "JPEG", "tif": "TIFF"}[ending]
    image.save()
    loaded = bpy.data.images.load(image.filepath_raw)
    monkeypatch.setattr("addon.scene.textures._loaded", None)
    images = ImageTextures()
    assert images.size(images.texture(loaded, is_premultiplied=True).key) == (33, 17)
    assert not loaded.has_data


def problem(image) -> str:
    with pytest.raises(UnreadableError) as caught:
        ImageTextures().texture(image, is_premultiplied=True)
    return str(caught.value)


def test_images_without_pixels_are_named(tmp_path):
    image = load(tmp_path / "gone.png", stored())
    (tmp_path / "gone.png").unlink()
    assert problem(image) == f'the image "gone.png" has no pixels: {tmp_path / "gone.png"} cannot be read'
    (tmp_path / "gone.png").write_bytes(b"")
    assert problem(image) == f'the image "gone.png" has no pixels: {tmp_path / "gone.png"} cannot be read'
    (tmp_path / "gone.png").write_bytes(b"no image at all, but longer than the headers of images")
    assert problem(image) == f'the image "gone.png" has no pixels: {tmp_path / "gone.png"} cannot be read'
    image.filepath = ""
    assert problem(image) == 'the image "gone.png" has no pixels'


@pytest.mark.parametrize(("source", "words"), [("MOVIE", "a movie"), ("SEQUENCE", "an image sequence")])
def test_moving_images_are_named(tmp_path, source, words):
    image = load(tmp_path / "moving.png", stored())
    image.source = source
    assert problem(image) == f'the image "moving.png" is {words}'


def test_an_image_of_a_library_is_found_beside_it(tmp_path):
    """Its path is relative to the library, and not to the open file."""
    for folder in ("library", "own"):
        (tmp_path / folder).mkdir()
    image = load(tmp_path / "library" / "page.png", stored())
    image.use_fake_user = True
    scenes.save(tmp_path / "library" / "library.blend")
    image.filepath = "//page.png"
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scenes.save(tmp_path / "own" / "own.blend")
    with bpy.data.libraries.load(str(tmp_path / "library" / "library.blend"), link=True) as (_, linked):
        linked.images = ["page.png"]
    assert bpy.data.images["page.png"].filepath == "//page.png"
    assert pixels_of(bpy.data.images["page.png"]).shape == (HEIGHT, WIDTH, 4)


def test_an_image_of_several_layers_is_named(tmp_path):
    names = [f"{layer}.{channel}" for layer in ("first", "second") for channel in "BGR"]
    (tmp_path / "layers.exr").write_bytes(open_exr(names))
    image = bpy.data.images.load(str(tmp_path / "layers.exr"))
    assert problem(image) == 'the image "layers.exr" is an image of several layers'


def open_exr(names) -> bytes:
    """A file of one black pixel with these channels of floats, in alphabetical order ("The OpenEXR File Layout")."""

    def attribute(name, kind, value):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(value)) + value

    box = attribute("dataWindow", "box2i", bytes(16)) + attribute("displayWindow", "box2i", bytes(16))
    channels = b"".join(name.encode() + b"\0" + struct.pack("<IB3xII", 2, 0, 1, 1) for name in names) + b"\0"
    header = b"\x76\x2f\x31\x01\x02\0\0\0" + attribute("channels", "chlist", channels) + box
    header += attribute("compression", "compression", b"\0") + attribute("lineOrder", "lineOrder", b"\0")
    header += attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    header += attribute("screenWindowCenter", "v2f", bytes(8)) + attribute(
        "screenWindowWidth", "float", struct.pack("<f", 1)
    )
    pixels = bytes(4 * len(names))
    return header + b"\0" + struct.pack("<Q", len(header) + 9) + struct.pack("<iI", 0, len(pixels)) + pixels


def test_a_file_that_breaks_later_is_an_error(tmp_path):
    image = load(tmp_path / "page.png", stored())
    images = ImageTextures()
    key = images.texture(image, is_premultiplied=True).key
    (tmp_path / "page.png").unlink()
    with pytest.raises(BakeError, match=r'the image "page.png" has no pixels: .*page.png cannot be read'):
        images.load(key)
    bpy.data.images.remove(image)
    with pytest.raises(BakeError, match="was removed during the bake"):
        images.load(key)


def test_an_image_may_be_renamed_meanwhile(tmp_path):
    image = load(tmp_path / "page.png", stored())
    images = ImageTextures()
    key = images.texture(image, is_premultiplied=True).key
    image.name = "other"
    assert images.name(key) == "other"
    assert images.load(key).values.shape == (HEIGHT, WIDTH, 4)


def test_pages_of_other_spaces_are_converted_in_parts(tmp_path, monkeypatch):
    image = load(tmp_path / "odd.png", stored(), space="Display P3")
    whole = pixels_of(image)
    monkeypatch.setattr("addon.scene.textures.PIXELS_AT_ONCE", 2 * WIDTH + 1)
    assert (pixels_of(image) == whole).all()
