# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that libraries are found in .blend files of all formats: block heads of 4.x and 5.x, 32 and 64 bits, either order."""

import io
import random
import struct
import zipfile
from pathlib import Path

import pytest

from addon.core.file_structure import blend_files, usd_archives, usd_layers
from addon.core.file_structure.image_files import image_size
from addon.core.file_structure.whole_files import CUT, problem
from tests.support import usd_files

LIBRARY = b"lib.blend\0" + b"//parts/lib.blend\0" + bytes(8)
HEADS = {
    b"BLENDER-v279": "<4siQii",
    b"BLENDER_v249": "<4siIii",
    b"BLENDER-V263": ">4siQii",
    b"BLENDER_V263": ">4siIii",
    b"BLENDER-v405": "<4siQii",
    b"BLENDER17-01v0500": "<4siQqq",
}
"""The start of a file, and the layout of its block heads: code, size, old address, type, count; from 5.0 on code, type, old
address, size, count."""


def block(start, code, content):
    size = len(content)
    # Other values than the size are so large that they would lead out of the file.
    values = (77777, 88888, size, 99999) if "q" in HEADS[start] else (size, 88888, 77777, 99999)
    return struct.pack(HEADS[start], code, *values) + content


@pytest.mark.parametrize("start", HEADS)
def test_libraries_are_found_between_other_blocks(tmp_path, start):
    path = tmp_path / "scene.blend"
    decoy = b"//not/a/library.blend\0"
    path.write_bytes(
        start
        + block(start, b"REND", decoy)
        + block(start, b"LI\0\0", LIBRARY)
        + block(start, b"LIB\0", decoy)
        + block(start, b"LI\0\0", LIBRARY.replace(b"parts", b"other"))
        + block(start, b"ENDB", b"")
        + block(start, b"LI\0\0", decoy)
    )
    assert blend_files.libraries(path) == [tmp_path / "parts/lib.blend", tmp_path / "other/lib.blend"]


@pytest.mark.parametrize(
    "start", [b"", b"BLENDER", b"BLENDER+v405", b"BLENDER17-01", b"BLENDER18-01v0600", b"PK\3\4 and so on"]
)
def test_other_files_have_none(tmp_path, start):
    path = tmp_path / "scene.blend"
    path.write_bytes(start + block(b"BLENDER-v405", b"LI\0\0", LIBRARY))
    assert blend_files.libraries(path) == []


@pytest.mark.parametrize("start", HEADS)
def test_a_file_that_breaks_off_has_none(tmp_path, start):
    path = tmp_path / "scene.blend"
    path.write_bytes(start + block(start, b"LI\0\0", LIBRARY)[: -len(LIBRARY)])
    assert blend_files.libraries(path) == []


# Usd layers


TEXT = """#usda 1.0
(
    subLayers = [@./a.usda@, @../b.usdc@]
)
def "x" (
    references = @c d.usd:SDF_FORMAT_ARGS:scale=2@</root>
    payload = @@@e@f.usdz[inner.usda]@@@
)
{
    asset inputs:file = @tex/skin.<UDIM>.png@
}
"""


@pytest.fixture
def root(tmp_path):
    (tmp_path / "in").mkdir()
    return tmp_path / "in"


def write(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return str(path)


def test_a_file_of_text(root):
    found = usd_layers.named(write(root / "root.usda", TEXT))
    places = [root / "a.usda", root.parent / "b.usdc", root / "c d.usd", root / "e@f.usdz"]
    assert set(found.layers) == set(map(str, places))
    assert found.assets == (str(root / "tex" / "skin.<UDIM>.png"),)
    assert (found.unknown, found.has_variants) == ("", False)


def test_paths_in_comments_and_texts_are_none(root):
    text = '#usda 1.0\n# as in @a.usda@\n(\n doc = """see @b.usda@, [{"""\n subLayers = [@c.usda@, @d.usda@]\n)\n'
    text += 'def "a" { string b = "@e.usda@" \n int[] c = [1, 2] \n asset[] d = [@f.usda@] }'
    found = usd_layers.named(write(root / "root.usda", text))
    assert found.layers == tuple(str(root / f"{name}.usda") for name in "cdf")


@pytest.mark.parametrize("text", [usd_files.SUBLAYER, usd_files.REFERENCE])
@pytest.mark.parametrize("name", ["root.usdc", "root.usd"])
def test_a_binary_file(root, text, name):
    found = usd_layers.named(write(root / name, usd_files.binary(text)))
    assert found == usd_layers.Named((str(root / "part.usda"),))


def test_layers_of_layers_and_circles(root):
    path = write(root / "root.usda", "#usda 1.0\n(subLayers = [@inner/middle.usdc@])")
    (root / "inner").mkdir()
    write(root / "inner" / "middle.usdc", usd_files.binary(usd_files.SUBLAYER))
    write(root / "inner" / "part.usda", "#usda 1.0\n(subLayers = [@../root.usda@, @middle.usdc@, @last.usda@])")
    names = ["inner/middle.usdc", "inner/part.usda", "inner/last.usda"]
    assert set(usd_layers.named(path).layers) == {str(root / name) for name in names}


def test_a_layer_that_changes_is_read_again(root):
    path = write(root / "root.usda", "#usda 1.0\n(subLayers = [@a.usda@])")
    assert usd_layers.named(path).layers == (str(root / "a.usda"),)
    write(root / "root.usda", "#usda 1.0\n(subLayers = [@b.usda@])")
    assert usd_layers.named(path).layers == (str(root / "b.usda"),)


@pytest.mark.parametrize(
    "content",
    [
        usd_files.binary(usd_files.CLIPS),
        '#usda 1.0\ndef "a" ( clips = { dictionary default = { string templateAssetPath = "./clip.##.usd" } } ) {}',
        '#usda 1.0\n(subLayers = [@`"${SHOT}.usda"`@])',
        "#usda 1.0\n(subLayers = [@omniverse://server/a.usd@])",
    ],
)
def test_names_that_cannot_be_followed_are_said(root, content):
    path = write(root / "root.usd", content)
    assert usd_layers.named(path).unknown == f"{path!r} names files in a way that cannot be followed"


def test_variants_may_be_missing(root):
    path = write(root / "root.usda", '#usda 1.0\ndef "a" (prepend variantSets = "v") { variantSet "v" = { "o" { } } }')
    assert usd_layers.named(path).has_variants


def test_what_is_no_usd_file_names_nothing(root):
    for name, content in (("a.obj", TEXT), ("empty.usda", ""), ("words.usdc", "PXR-USDC and no more")):
        assert usd_layers.named(write(root / name, content)) == usd_layers.Named()
    assert usd_layers.named(str(root / "none.usda")) == usd_layers.Named()


def test_damaged_files_end_soon(root):
    whole, chance = usd_files.binary(usd_files.REFERENCE), random.Random(4)
    for number in range(300):
        content = bytearray(whole)
        for _ in range(chance.randrange(1, 6)):
            content[chance.randrange(8, len(whole))] = chance.choice((0, 1, 127, 255))
        usd_layers.named(write(root / f"{number}.usdc", bytes(content[: chance.randrange(9, len(whole) + 1)])))


# Archives of USD


def archive(path, *members, packing=zipfile.ZIP_STORED):
    """A .usdz with these files: pairs of a name and its content."""
    with zipfile.ZipFile(path, "w", packing) as file:
        for name, content in members:
            file.writestr(name, content)
    return str(path)


LAYERED = "#usda 1.0\n(\nsubLayers = [@./{}@]\n)\n"


def test_what_an_archive_contains_is_not_named(root):
    inner = Path(archive(root / "inner.usdz", ("deep.usdc", usd_files.binary(usd_files.SUBLAYER)), ("part.usda", "")))
    text = TEXT.replace("../b.usdc", "/former/b.usdc").replace("e@f.usdz", "inner.usdz")
    names = ["a.usda", "in/b.usdc", "c d.usd", "tex/skin.<UDIM>.png"]
    members = [("root.usda", text), ("inner.usdz", inner.read_bytes())]
    members += [(name.replace("<UDIM>", "1001"), "") for name in names]
    whole = archive(root / "whole.usdz", *members)
    assert usd_layers.named(whole) == usd_layers.Named()
    assert problem(whole) == ""
    lacks = archive(root / "lacks.usdz", *members[:2])
    paths = {f"{lacks}[a.usda]", "/former/b.usdc", f"{lacks}[c d.usd]"}
    assert set(usd_layers.named(lacks).layers) == paths
    assert usd_layers.named(lacks).assets == (f"{lacks}[{names[3]}]",)


def test_names_in_an_archive_start_at_the_file_that_has_them(root):
    layer = LAYERED.replace("./{}", "../parts/b.usda")
    path = archive(root / "a.usdz", ("top/a.usda", layer), ("parts/b.usda", LAYERED.format("c.usda")))
    assert usd_layers.named(path).layers == (f"{path}[parts/c.usda]",)


def test_files_outside_an_archive_are_named(root):
    """USD opens them."""
    path = archive(root / "a.usdz", ("a.usda", LAYERED.replace("./{}", str(root / "b.usda"))))
    write(root / "b.usda", LAYERED.format("c.usda"))
    assert usd_layers.named(path).layers == (str(root / "b.usda"), str(root / "c.usda"))


def test_archives_are_read_from_head_to_head(root):
    """As USD does, which ignores the list at the end."""
    path = Path(archive(root / "a.usdz", ("a.usda", LAYERED.format("one.usda")), ("two.usda", "")))
    assert usd_layers.named(str(path)).layers == (f"{path}[one.usda]",)
    path.write_bytes(path.read_bytes().replace(b"two.usda", b"one.usda", 1))  # in its head alone
    assert usd_layers.named(str(path)).layers == ()


@pytest.mark.parametrize(
    "name", ["../a.usda", "/a.usda", "b/../../a.usda", "c:a.usda", "b\\a.usda", "./a.usda", "b//a.usda"]
)
def test_archives_with_names_that_lead_out_of_them_are_refused(root, name):
    with zipfile.ZipFile(root / "a.usdz", "w") as file:
        file.writestr("a.usda", "")
        file.writestr("_" * len(name), "")
    content = (root / "a.usdz").read_bytes().replace(b"_" * len(name), name.encode())
    assert "leads out of the archive" in problem(write(root / "a.usdz", content))


def test_archives_that_usd_does_not_read_are_refused(root):
    packed = archive(root / "packed.usdz", ("a.usda", TEXT * 9), packing=zipfile.ZIP_DEFLATED)
    many = archive(root / "many.usdz", *((f"{number}.usda", "") for number in range(usd_archives.MOST_FILES + 1)))
    nested = archive(root / "nested.usdz", ("a.usda", ""), ("b.usdz", Path(packed).read_bytes()))
    hidden, sized = (root / name for name in ("hidden.usdz", "sized.usdz"))
    plain = Path(archive(root / "plain.usdz", ("a.usda", TEXT))).read_bytes()
    write(hidden, plain[:6] + b"\x01" + plain[7:])
    write(sized, plain[:22] + b"\x07" + plain[23:])
    twice = archive(root / "twice.usdz", ("a.usda", ""), ("b.usda", ""))
    write(Path(twice), Path(twice).read_bytes().replace(b"b.usda", b"a.usda"))
    image = archive(root / "image.usdz", ("a.png", ""), ("a.usda", ""))
    for path, words in {
        **dict.fromkeys((packed, str(hidden), str(sized)), "compressed or encrypted"),
        many: "more than 10,000 files",
        nested: "compressed",
        twice: "is taken",
        image: "whose first file is",
        write(root / "text.usdz", TEXT): "is no archive",
    }.items():
        assert words in problem(path)
        assert usd_layers.named(path) == usd_layers.Named()


def test_an_archive_that_is_cut_anywhere_is_found(root):
    path = Path(archive(root / "a.usdz", ("a.usda", TEXT), ("b.usdz", usd_files.binary(usd_files.CLIPS))))
    path = Path(archive(root / "b.usdz", ("a.usda", TEXT), ("a.usdz", path.read_bytes().replace(b"b.usdz", b"b.usdc"))))
    content = path.read_bytes()
    assert problem(str(path)) == ""
    for size in range(4, len(content), 7):
        assert problem(write(path, content[:size])) == CUT, size


# Image headers


PNG = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 300, 200)


def segment(marker, body=b""):
    return struct.pack(">BBH", 0xFF, marker, 2 + len(body)) + body


FRAME = struct.pack(">BHHB", 8, 200, 300, 3)
TABLES = segment(0xE0, b"JFIF") + segment(0xC4, b"tables") + segment(0xDB, b"\xff\xc0" * 9)


@pytest.mark.parametrize("frame", [0xC0, 0xC2, 0xCF])
def test_jpeg(frame):
    """The Huffman tables have a marker among those of frames."""
    assert image_size(io.BytesIO(b"\xff\xd8" + TABLES + b"\xff\xff" + segment(frame, FRAME))) == (300, 200)


def test_png():
    assert image_size(io.BytesIO(PNG)) == (300, 200)


@pytest.mark.parametrize("order", ["<", ">"])
def test_tiff(order):
    mark = b"II*\0" if order == "<" else b"MM\0*"
    entries = [(256, 3, 1, 300), (257, 4, 1, 200)]
    body = b"".join(
        struct.pack(order + "HHI", *entry[:3]) + struct.pack(order + ("H2x" if entry[1] == 3 else "I"), entry[3])
        for entry in entries
    )
    assert image_size(io.BytesIO(mark + struct.pack(order + "IH", 8, 2) + body + bytes(4))) == (300, 200)


@pytest.mark.parametrize("length", range(len(PNG)))
def test_files_that_end_early_are_not_known(length):
    assert image_size(io.BytesIO(PNG[:length])) is None


def test_other_files_are_not_known():
    jpeg = b"\xff\xd8" + TABLES + segment(0xC0, FRAME)
    for end in range(3, len(jpeg) - 1):
        assert image_size(io.BytesIO(jpeg[:end])) is None
    assert image_size(io.BytesIO(b"\xff\xd8\xff\xe0\0\x02no marker")) is None
    assert image_size(io.BytesIO(b"BM and more bytes than a header has")) is None


def test_random_bytes_raise_nothing_seed_7():

    source = random.Random(7)
    for start in (b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"\x89PNG\r\n\x1a\n", b""):
        for _ in range(300):
            image_size(io.BytesIO(start + source.randbytes(source.randrange(60))))
