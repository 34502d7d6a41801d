# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that an image which is there and gives no pixels is the error of one that is missing, whoever reads it."""

import os
import struct
import zipfile

import bpy
import numpy as np
import pytest

from addon.cli import command, run_report, sheet
from addon.core.errors import BakeError
from addon.output import png_writer
from addon.scene import dependencies, textures
from tests.support import reports, scenes, zoo

SIZE = 32
FORMATS = {
    "packed TGA": ("TARGA", ".tga"),
    "plain TGA": ("TARGA_RAW", ".tga"),
    "Radiance": ("HDR", ".hdr"),
    "JPEG 2000": ("JPEG2000", ".jp2"),
    "DPX": ("DPX", ".dpx"),
    "Cineon": ("CINEON", ".cin"),
    "SGI": ("IRIS", ".rgb"),
    "WebP": ("WEBP", ".webp"),
    "PNG": ("PNG", ".png"),
    "JPEG": ("JPEG", ".jpg"),
}


@pytest.fixture
def folder(tmp_path, monkeypatch, gpu_context):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def values():
    rng = np.random.default_rng(4)
    found = np.ones((SIZE, SIZE, 4), np.float32)
    found[..., :3] = np.repeat(rng.random((SIZE, SIZE // 2, 3)), 2, axis=1)  # in pairs, so that packing helps
    return found


def psd(path):
    """A Photoshop file of three channels, each row of which is packed."""
    rows = [
        b"".join(bytes([255, value]) for value in row[::2])
        for channel in np.moveaxis((values()[..., :3] * 255).astype(np.uint8), 2, 0)
        for row in channel
    ]
    head = b"8BPS" + struct.pack(">H6xHIIHH12xH", 1, 3, SIZE, SIZE, 8, 3, 1)
    path.write_bytes(head + b"".join(struct.pack(">H", len(row)) for row in rows) + b"".join(rows))


def written(folder, kind):
    """An image of this kind, on the disk."""
    if kind == "Photoshop":
        psd(folder / "a.psd")
        return folder / "a.psd"
    name, ending = FORMATS[kind]
    image = bpy.data.images.new("written", SIZE, SIZE, float_buffer=True)
    image.pixels.foreach_set(values().ravel())
    how = bpy.context.scene.render.image_settings
    how.file_format, how.color_mode = name, "RGB"
    if name == "JPEG2000":
        how.jpeg2k_codec = "JP2"
    image.save_render(str(folder / f"a{ending}"))
    bpy.data.images.remove(image)
    return folder / f"a{ending}"


def cut(path):
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3])


OF_ANOTHER_KIND = {
    "a text as Radiance": (".hdr", b"#?RADIANCE\nhello" * 9),
    "a head of a TGA alone": (".tga", struct.pack("<BBB9xHHBB", 0, 0, 10, SIZE, SIZE, 24, 0) + b"x" * 30),
    "zeros as Photoshop": (".psd", b"8BPS" + bytes(200)),
    "a text as PNG": (".png", b"<html>" * 40),
}


def shown(folder, path, *, is_packed=False):
    """Save a scene whose high mesh shows an image. Returns the exit code of a bake of its base color."""
    zoo.plane("lo")
    high = zoo.plane("hi", slope=0.1)
    image = bpy.data.images.load(str(path))
    if is_packed:
        image.pack()
    scenes.show(high, image)
    scenes.save(folder / "s.blend")
    words = ["s.blend", "--low", "lo", "--high", "hi", "--size", "16", "--limit", "9", "--method", "flatten"]
    return command.run([*words, "--maps", "base-color", "--output", "m.png"])


@pytest.mark.parametrize("kind", [*FORMATS, "Photoshop"])
def test_a_texture_that_is_cut_off_is_an_error(folder, kind, capsys):
    path = written(folder, kind)
    assert shown(folder, path) == run_report.DONE  # an image that is right is left alone
    assert "warning" not in capsys.readouterr().err
    cut(path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert shown(folder, path) == run_report.FAILED
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("imprint")]
    assert f"of the high meshes' materials cannot be read: {str(path)!r}" in line and "Restore" in line


@pytest.mark.parametrize(("ending", "content"), OF_ANOTHER_KIND.values(), ids=OF_ANOTHER_KIND)
def test_a_texture_of_another_kind_is_an_error(folder, ending, content, capsys):
    (folder / f"a{ending}").write_bytes(content)
    assert shown(folder, folder / f"a{ending}") == run_report.FAILED
    assert "of the high meshes' materials cannot be read" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["packed TGA", "Radiance"])
def test_a_packed_texture_that_is_cut_off_is_an_error(folder, kind, capsys):
    """As in a .blend, and in .glb files, whose images Blender packs."""
    path = written(folder, kind)
    assert shown(folder, path, is_packed=True) == run_report.DONE
    capsys.readouterr()
    cut(path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert shown(folder, path, is_packed=True) == run_report.FAILED
    assert "the packed image 'a" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["packed TGA", "JPEG 2000", "PNG"])
def test_a_displacement_that_is_cut_off_is_an_error(folder, kind):
    path = written(folder, kind)
    obj = zoo.plane("hi")
    texture = bpy.data.textures.new("bumps", "IMAGE")
    texture.image = bpy.data.images.load(str(path))
    obj.modifiers.new("Displace", "DISPLACE").texture = texture
    assert dependencies.lacking(dependencies.of([obj])) == []
    cut(path)
    assert [each.path for each in dependencies.lacking(dependencies.of([obj]))] == [str(path)]


@pytest.mark.parametrize("kind", ["packed TGA", "PNG", "WebP"])
def test_a_map_to_convert_that_is_cut_off_is_an_error(folder, kind):
    path = written(folder, kind)
    cut(path)
    image = bpy.data.images.load(str(path))
    with pytest.raises(BakeError, match="No normal map can be read|has no pixels"):
        textures.read_stored(image, textures.stored_tiles(image)[0])


def test_a_jpeg_that_lacks_its_last_rows_is_no_map_to_convert(folder):
    """Blender fills them with gray."""
    path = written(folder, "JPEG")
    path.write_bytes(path.read_bytes()[:-60])
    image = bpy.data.images.load(str(path))
    with pytest.raises(BakeError, match="is not whole: .* ends too early"):
        textures.read_stored(image, 0)


def test_a_picture_that_is_cut_off_is_not_shown(folder):
    content = png_writer.small(np.zeros((4, 4, 3), np.uint8))
    (folder / "p.png").write_bytes(content)
    assert sheet.read_picture(str(folder / "p.png")) == content
    cut(folder / "p.png")
    assert sheet.read_picture(str(folder / "p.png")) == b""


@pytest.mark.parametrize("lacks", [False, True])
def test_images_in_an_archive_of_usd_are_those_of_its_file(folder, lacks, capsys):
    path = written(folder, "PNG")
    zoo.plane("lo")
    bpy.ops.wm.obj_export(filepath="low.obj")
    bpy.data.objects.remove(bpy.data.objects["lo"])
    scenes.show(zoo.plane("hi", slope=0.1), bpy.data.images.load(str(path)))
    bpy.ops.wm.usd_export(filepath="high.usda")
    bpy.ops.wm.usd_export(filepath="high.usdz")
    if lacks:
        with zipfile.ZipFile("high.usdz") as archive:
            layer = archive.infolist()[0]
            content = archive.read(layer)
        with zipfile.ZipFile("high.usdz", "w") as archive:
            archive.writestr(layer.filename, content)
    found = []
    for high in ("high.usda", "high.usdz"):
        words = ["--low-file", "low.obj", "--high-file", high, "--maps", "base-color", "--output", f"{high}.png"]
        words += ["--resume", "--report", "r.json", "--size", "16", "--limit", "9", "--depth", "8"]
        found.append(command.run(words))
    out = capsys.readouterr().err
    if lacks:
        assert found == [run_report.DONE, run_report.FAILED]
        assert f"cannot be found: '{folder / 'high.usdz'}[textures/a.png]'." in out
    else:
        assert found == [run_report.DONE] * 2, out
        (entry,) = reports.bakes(folder / "r.json")
        assert {os.path.basename(each["path"]) for each in entry["inputs"]} == {"low.obj", "low.mtl", "high.usdz"}
        first, second = (next(folder.glob(f"high.{ending}*olor*.png")) for ending in ("usda", "usdz"))
        assert first.read_bytes() == second.read_bytes()
