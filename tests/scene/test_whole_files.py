# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the difference between whole files and files that end too early, with files that Blender writes."""

import struct
import zipfile

import bpy
import numpy as np
import pytest
from PIL import Image

from addon.core.file_structure.whole_files import CUT, EMPTY, MISSING, NO_IMAGE, POINTER, problem
from tests.support import dependency_kinds, scenes, zoo

PICTURES = {
    ".png": [{}, {"color_depth": "16"}],
    ".jpg": [{"file_format": "JPEG"}],
    ".tif": [{"file_format": "TIFF", "tiff_codec": codec} for codec in ("NONE", "DEFLATE", "LZW", "PACKBITS")],
    ".exr": [
        {"file_format": "OPEN_EXR", "exr_codec": codec, "color_depth": depth}
        for codec in ("NONE", "ZIP", "ZIPS", "PIZ", "RLE", "PXR24", "DWAA", "DWAB", "HTJ2K")
        for depth in ("16", "32")
    ],
    ".webp": [{"file_format": "WEBP"}],
    ".bmp": [{"file_format": "BMP"}],
    ".tga": [{"file_format": "TARGA_RAW"}],
}
"""Settings of renders by endings."""
CASES = [(ending, more) for ending, sets in PICTURES.items() for more in sets]
SHARES = (0.02, 0.3, 0.7, 0.98)


def saved(path, more):
    """Save an image of noise, and return what the file contains."""
    image = bpy.data.images.new("noise", 61, 300, float_buffer=True)
    image.pixels.foreach_set(np.random.default_rng(5).random(61 * 300 * 4).astype(np.float32))
    settings = bpy.context.scene.render.image_settings
    if more.get("exr_codec") == "HTJ2K" and bpy.app.version < (5, 1):
        pytest.skip("this Blender does not write it")
    settings.file_format = "PNG"
    for name, value in more.items():
        setattr(settings, name, value)
    image.save_render(str(path))
    bpy.data.images.remove(image)
    return path.read_bytes()


def check(path, content, shares=SHARES, **more):
    """The whole file has no problem, and each shorter one has."""
    assert problem(str(path), **more) == ""
    lengths = [*(int(share * len(content)) for share in shares)]
    lengths += [] if path.suffix == ".tga" else [len(content) - 1]  # readers need no footer
    for length in lengths:
        path.write_bytes(content[:length])
        assert problem(str(path), **more) == CUT, f"{length} of {len(content)} bytes"
    path.write_bytes(content)


DDS_KINDS = {
    "one level": (0, 0, 0, 1, 6),
    "all levels": (4, 0, 0, 1, 6 + 2 + 1 + 1),
    "a cube": (2, 0, 4, 1, 6 * (6 + 2)),
    "some sides of a cube": (2, 0x200 | 0x400 | 0x800, None, 1, 2 * (6 + 2)),
    "an array": (1, 0, 0, 3, 3 * 6),
}
"""Levels, capabilities, flags of DirectX 10 or None for its older header, pictures, and the blocks that follow."""


@pytest.mark.parametrize(("ending", "more"), CASES)
def test_an_image_that_ends_too_early_is_told_from_a_whole_one(ending, more, tmp_path):
    path = tmp_path / f"noise{ending}"
    content = saved(path, more)
    check(path, content, is_image=True)
    path.write_bytes(content + bytes(100))  # programs leave what they like after the end
    assert problem(str(path), is_image=True) == ""


def test_a_tiff_that_is_written_in_tiles_by_64_bits_and_by_mac_s_order(tmp_path):
    for order, mark in (("<", b"II+\0"), (">", b"MM\0+")):
        pixels = bytes(range(256)) * 4
        head = mark + struct.pack(order + "HHQ", 8, 0, 16) if order == ">" else mark + struct.pack("<HHQ", 8, 0, 16)
        entries = [(324, 16, 1, 16 + 8 + 40 + 8), (325, 16, 1, len(pixels))]
        table = struct.pack(order + "Q", 2) + b"".join(struct.pack(order + "HHQQ", *each) for each in entries)
        path = tmp_path / "big.tif"
        path.write_bytes(head + table + bytes(8) + pixels)
        check(path, path.read_bytes(), shares=(0.3, 0.7), is_image=True)


@pytest.mark.parametrize("tile_mode", [0, 1, 17, 2])
def test_an_exr_in_tiles_and_levels(tile_mode, tmp_path):
    """By hand, since Blender writes none: the counts of blocks are those of OpenEXR's own description."""
    counts = {0: 6, 1: 6 + 2 + 1 + 1 + 1, 17: 6 + 2 + 1 + 1 + 1 + 1, 2: None}
    width, height, side = 40, 30, 16
    levels = {0: [(40, 30)], 1: [(40, 30), (20, 15), (10, 7), (5, 3), (2, 1), (1, 1)]}
    levels[17] = [(40, 30), (20, 15), (10, 8), (5, 4), (3, 2), (2, 1), (1, 1)]
    levels[2] = [(u, v) for v in (30, 15, 7, 3, 1) for u in (40, 20, 10, 5, 2, 1)]
    count = sum(-(-u // side) * -(-v // side) for u, v in levels[tile_mode])
    assert tile_mode == 2 or count >= counts[tile_mode]

    def attribute(name, kind, value):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value

    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    head = struct.pack("<II", 20000630, 2 | 0x200) + attribute("compression", "compression", b"\0")
    head += attribute("dataWindow", "box2i", window)
    head += attribute("tiles", "tiledesc", struct.pack("<IIB", side, side, tile_mode)) + b"\0"
    block = struct.pack("<5i", 0, 0, 0, 0, 8) + bytes(8)
    start = len(head) + 8 * count
    table = struct.pack(f"<{count}Q", *(start + number * len(block) for number in range(count)))
    path = tmp_path / "tiles.exr"
    path.write_bytes(head + table + block * count)
    check(path, path.read_bytes(), is_image=True)


def test_an_exr_of_several_layers_that_was_never_finished(tmp_path):
    """A renderer that is killed leaves zeros in the table."""
    path = tmp_path / "noise.exr"
    content = saved(path, {"file_format": "OPEN_EXR", "exr_codec": "ZIP"})
    blocks = -(-300 // 16)
    start = next(
        at for at in range(len(content) - 8 * blocks) if struct.unpack_from("<Q", content, at)[0] == at + 8 * blocks
    )
    path.write_bytes(content[:start] + bytes(8 * blocks) + content[start + 8 * blocks :])
    assert problem(str(path), is_image=True) == CUT


@pytest.mark.parametrize("mode", ["RGBA", "RGB", "L", "DXT1", "DXT3", "DXT5", "BC2", "BC3", "BC5"])
def test_a_dds_that_pillow_writes(mode, tmp_path):
    """With and without blocks, of sides that fill no whole blocks."""
    path = tmp_path / "rock.dds"
    is_plain = mode in ("RGBA", "RGB", "L")
    picture = Image.new(mode if is_plain else "RGB" if mode == "BC5" else "RGBA", (37, 22), 3)
    picture.save(path, **({} if is_plain else {"pixel_format": mode}))
    check(path, path.read_bytes(), is_image=True)


@pytest.mark.parametrize("kind", DDS_KINDS)
def test_a_dds_of_several_pictures_and_levels(kind, tmp_path):
    """By hand: blocks of 8 bytes, 12 x 8 texels."""
    levels, more, misc, pictures, blocks = DDS_KINDS[kind]
    flags = 0x20000 if levels else 0
    head = struct.pack("<4sIIII8xI44x", b"DDS ", 124, flags | 0x1007, 8, 12, levels)
    name = b"DXT1" if misc is None else b"DX10"
    head += struct.pack("<II4s20xII12x", 32, 4, name, 0x1000, more)
    head += b"" if misc is None else struct.pack("<5I", 71, 3, misc, pictures, 0)
    path = tmp_path / "rock.dds"
    path.write_bytes(head + bytes(8 * blocks))
    check(path, path.read_bytes(), shares=(), is_image=True)


def test_what_is_no_image_is_named(tmp_path):
    path = tmp_path / "rock.png"
    assert problem(str(path)) == MISSING
    assert problem(str(tmp_path)) == MISSING
    path.touch()
    assert problem(str(path)) == EMPTY
    for text in (
        b"<!DOCTYPE html><html><head></head></html>" * 9,
        b"\0" * 400,
        b"x",
        b"404: Not Found",
    ):
        path.write_bytes(text)
        assert problem(str(path), is_image=True) == NO_IMAGE
        assert problem(str(path)) == ""
    for ending in (".png", ".tga", ".obj"):
        pointer = tmp_path / f"rock{ending}"
        pointer.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12345\n")
        assert problem(str(pointer), is_image=ending != ".obj") == POINTER


def test_a_small_thumbnail_in_a_jpeg_is_not_its_end(tmp_path):
    path = tmp_path / "noise.jpg"
    content = saved(path, {"file_format": "JPEG"})
    small = b"\xff\xe1" + struct.pack(">H", 2 + 500) + bytes(200) + b"\xff\xd8\xff\xd9" + bytes(296)
    path.write_bytes(content[:2] + small + content[2:-2])
    assert problem(str(path), is_image=True) == CUT
    path.write_bytes(content[:2] + small + content[2:])
    assert problem(str(path), is_image=True) == ""


@pytest.mark.parametrize(
    "name",
    [
        *("mesh_cache_mdd", "mesh_cache_pc2", "alembic_cache", "multires_external", "font_of_nodes", "volume_to_mesh"),
        *("cloth_cache", "dynamic_paint_cache", "particles_cache"),
    ],
)
def test_a_file_of_points_or_letters_that_ends_too_early(name, tmp_path):
    scenes.save(tmp_path / "scene.blend")
    kinds = {**dependency_kinds.KINDS, **dependency_kinds.PARTLY}
    path = kinds[name](zoo.plane("rock", 8), tmp_path)
    check(path, path.read_bytes())


def test_a_binary_usd_and_a_packed_one(tmp_path):
    zoo.plane("rock", 8)
    path = tmp_path / "rock.usdc"
    bpy.ops.wm.usd_export(filepath=str(path))
    check(path, path.read_bytes())
    packed = tmp_path / "rock.usdz"
    with zipfile.ZipFile(packed, "w") as archive:
        archive.write(path, "rock.usdc")
    content = packed.read_bytes()
    assert problem(str(packed)) == ""
    packed.write_bytes(content[:-40])
    assert problem(str(packed)) == CUT


def test_hostile_counts_end_soon(tmp_path):
    path = tmp_path / "rock.exr"
    content = saved(path, {"file_format": "OPEN_EXR", "exr_codec": "ZIP"})
    at = content.index(b"dataWindow")
    for number in range(at, at + 60):
        path.write_bytes(content[:number] + b"\x7f\xff\xff\x7f" + content[number + 4 :])
        assert problem(str(path), is_image=True) in ("", CUT)


TEXTS = {
    ".obj": (lambda path: bpy.ops.wm.obj_export(filepath=path), 0.65),
    ".usda": (lambda path: bpy.ops.wm.usd_export(filepath=path), 1.0),
    ".stl": (lambda path: bpy.ops.wm.stl_export(filepath=path, ascii_format=True), 0.9),
}
"""How to write files of text, and the least share of the places at which a cut shows."""


@pytest.mark.parametrize("ending", TEXTS)
def test_text_that_ends_within_what_it_says(ending, tmp_path):
    export, least = TEXTS[ending]
    zoo.plane("rock", 8, slope=0.3)
    path = tmp_path / f"rock{ending}"
    export(str(path))
    content = path.read_bytes()
    for whole in (content, content.rstrip(), content.replace(b"\n", b"\r\n"), content + b"\n\n"):
        path.write_bytes(whole)
        assert problem(str(path)) == ""
    lengths = np.random.default_rng(3).integers(len(content) // 5, len(content.rstrip()), 300)
    cut = 0
    for length in lengths:
        path.write_bytes(content[:length])
        cut += problem(str(path)) == CUT
    assert cut >= least * len(lengths)


@pytest.mark.parametrize(
    "text",
    [
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3",
        "v 0 0 0 1 1 1\nvt 0.5\nf -1 -2 -3",
        "v 1e-5 .5 -2.\nvn 0 0 1\nl 1 2",
        "# only a comment",
        "v 0 0 0\no name with spaces",
        "v 0 0 0\ng",
        "f 1//2 2//2 3//2\n\n",
        "",
    ],
)
def test_an_obj_may_end_without_a_new_line(text, tmp_path):
    path = tmp_path / "rock.obj"
    path.write_text(text)
    assert problem(str(path)) in ("", EMPTY)


@pytest.mark.parametrize(
    "last", ["f", "f 1 2", "f 1/1 2/2 3/", "f 1/1 2/2 3", "v 0 1", "v 0 0 -", "vn 0 0", "vt .", "use"]
)
def test_an_obj_that_ends_within_a_line(last, tmp_path):
    path = tmp_path / "rock.obj"
    path.write_text(f"v 0 0 0\nvt 0 0\nvn 0 0 1\n{last}")
    assert problem(str(path)) == CUT


def test_json_that_ends_too_early(tmp_path):
    path = tmp_path / "bake.json"
    whole = '{"version": 3, "items": {"a b": [1.5, true, null, {"c": "d"}]}}\n'
    path.write_text(whole)
    assert problem(str(path)) == ""
    for length in range(1, len(whole) - 1):
        path.write_text(whole[:length])
        assert problem(str(path)) == CUT
    path.write_text("# a file of settings\n" + whole)  # of a program that takes comments
    assert problem(str(path)) == ""


def test_brackets_in_texts_of_usd_count_not(tmp_path):
    path = tmp_path / "rock.usda"
    whole = (
        '#usda 1.0\n# {[(\n(\n doc = """a \\" {\n("""\n)\ndef "a{" (references = @b(.usda@) {\n string c = \'[\' }\n'
    )
    path.write_text(whole)
    assert problem(str(path)) == ""
    path.write_text(whole[:-3])
    assert problem(str(path)) == CUT


def test_a_binary_stl_with_a_title_that_text_begins_with(tmp_path):
    path = tmp_path / "rock.stl"
    whole = b"solid by a scanner".ljust(80) + struct.pack("<I", 2) + bytes(100)
    for more in (b"", b"colors"):
        path.write_bytes(whole + more)
        assert problem(str(path)) == ""
    path.write_bytes(whole[:-1])
    assert problem(str(path)) == CUT
