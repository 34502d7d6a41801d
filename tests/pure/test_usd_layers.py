# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which files a USD file names, of text and of binary ones."""

import random

import pytest

from addon.core.file_structure import usd_layers
from tests.support import usd_files

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
