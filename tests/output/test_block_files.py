# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests maps in DDS, KTX2, WebP and JPEG files: what is stored, what other programs read, and what is refused."""

import bpy
import numpy as np
import pytest
from PIL import Image

from addon.blocks.formats import BC4, BC5, BC6H_SIGNED, BC7, Purpose
from addon.core.errors import BakeError
from addon.core.sentences import LOOK, NOTE
from addon.core.settings import Settings
from addon.jobs import Job, bake_all, bake_pair
from addon.output import containers, datablocks, image_file, map_names, outputs
from addon.passes import block_encoding
from tests.support import pictures, zoo
from tests.support.maps import pixels

SIZE = 32
WRITTEN = '[["rock & <stone>","UVMap",true,17]]'


@pytest.fixture
def calls(monkeypatch):
    """What the encoder was called with, while it returns blocks of zeros."""
    found = []

    def encoded(texels, block_format, purpose, weights=None):
        found.append((texels, block_format, purpose, weights))
        return np.zeros((texels.shape[0] // 4, texels.shape[1] // 4, block_format.size), np.uint8)

    monkeypatch.setattr(block_encoding, "encoded", encoded)
    return found


def some(size=(16, 12), seed=3):
    """Unit normals that point up, with some background."""
    generator = np.random.default_rng(seed)
    normals = generator.normal(size=(size[1], size[0], 3)) + (0.0, 0.0, 4.0)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    texels = np.ones((size[1], size[0], 4), np.float32)
    texels[..., :3] = 0.5 + 0.5 * normals
    texels[:3] = (0.5, 0.5, 1.0, 0.0)
    return texels


def settings_of(folder, name, *, size=(SIZE, SIZE), **values):
    width, height = size
    given = {"method": "FLATTEN", "margin": 0, "depth": 8, "storage": "FILE", "material": False}
    return Settings(output=str(folder / name), width=width, height=height, **given | values)


def bake(folder, name, **values):
    low, high = zoo.plane("low"), zoo.terrain("high")
    return bake_pair(bpy.context, low, [high], settings_of(folder, name, **values))


@pytest.mark.parametrize("ending", [".dds", ".ktx2"])
def test_each_map_has_the_format_that_fits_it(tmp_path, ending):
    maps = ("AO", "BASE_COLOR", "EMISSION", "HEIGHT", "POSITION", "OBJECT_ID", "BENT_NORMAL", "DISTANCE")
    settings = settings_of(tmp_path, f"m{ending}", maps=maps, mask=True, pack="GLTF")

    def formats(**values):
        changed = settings.mapped(**{name: values.pop(name) for name in ("space", "blue") if name in values})
        by_map = map_names.settings_by_map(changed.stored(**values))
        return {name: str(of_map.storing.compression) for name, of_map in by_map.items()}

    gray = dict.fromkeys(("MASK", "AO", "HEIGHT", "DISTANCE"), "BC4")
    colors = dict.fromkeys(("BASE_COLOR", "OBJECT_ID", "PACKED"), "BC7")
    floats = dict.fromkeys(("EMISSION", "POSITION"), "BC6H")
    usual = gray | colors | floats | {"NORMAL": "BC5", "BENT_NORMAL": "BC5"}
    assert formats() == usual
    for wrong in ({"space": "OBJECT"}, {"blue": "-Z"}):  # z may be below 0
        assert formats(**wrong) == usual | {"NORMAL": "BC7", "BENT_NORMAL": "BC7"}
    assert formats(compression="BC4") == formats(compression="BC5") == usual
    assert set(formats(compression="BC7").values()) == {"BC7"}
    assert formats(compression="BC6H") == dict.fromkeys(usual, "BC6H") | {"OBJECT_ID": "BC7", "PACKED": "BC7"}
    of_map = map_names.settings_by_map(settings)
    assert of_map["EMISSION"].storing.is_float and of_map["EMISSION"].storing.is_half
    assert not of_map["BASE_COLOR"].storing.is_float
    assert [name for name, one in of_map.items() if one.storing.has_alpha] == ["BASE_COLOR", "OBJECT_ID", "PACKED"]
    assert not map_names.settings_by_map(settings.stored(alpha=False))["PACKED"].storing.has_alpha


def test_files_of_blocks_have_their_levels_inside(tmp_path):
    settings = settings_of(tmp_path, "m.dds", maps=("AO", "OBJECT_ID"), size=(64, 16))
    files = [path for path, _ in map_names.planned_files(settings)]
    assert files == [str(tmp_path / name) for name in ("m.dds", "m_ao.dds", "m_object_id.dds")]
    assert settings.mip_sizes[-1] == (1, 1) and len(settings.mip_sizes) == 6
    assert len(map_names.levels_of(settings, "AO")) == 6 and not map_names.levels_of(settings, "OBJECT_ID")
    assert not map_names.level_files(settings.stored(mip_files=True), "AO")


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("ending", [".dds", ".ktx2"])
def test_a_bake_stores_all_levels(tmp_path, ending, monkeypatch):
    """Each level is that of the files of levels, to the loss of the format; the images show them."""
    exact = bake(tmp_path, "exact.exr", depth=32, mip_files=True, maps=("HEIGHT",))
    assert not [text for text in bake(tmp_path, f"m{ending}").warnings if "does not show" in text]
    monkeypatch.setattr(outputs, "_has_window", lambda: True)
    report = bake(tmp_path, f"m{ending}", maps=("HEIGHT",), value_range=0.5)
    assert report.mip_files.get("normal", []) == []
    for name, key, block_format in (("m", "normal", BC5), ("m_height", "height", BC4)):
        held = containers.read(tmp_path / f"{name}{ending}")
        assert (held.size, held.block_format, len(held.levels)) == ((SIZE, SIZE), block_format, 6)
        stem = name.replace("m", "exact", 1)
        wanted = [str(tmp_path / f"{stem}.exr"), *exact.mip_files[key]]
        for level, path in enumerate(wanted):
            texels, found = image_file.read(path), image_file.decoded(held, level)
            values = texels if key == "normal" else 0.5 + texels  # a range of 0.5 on both sides
            assert np.abs(found - values)[..., :3].max() < 0.02, (name, level)
    image = bpy.data.images[report.image]
    shown = np.abs(pixels(image)[..., :3] - image_file.read(tmp_path / f"m{ending}")[..., :3]).max()
    assert shown < 1.5 / 255
    assert bool(image.packed_file) == (ending == ".ktx2")
    notes = [text for text in report.warnings if "does not show KTX2 files" in text]
    assert len(notes) == (ending == ".ktx2") and all(text.harm is NOTE for text in notes)
    assert sorted(path.name for path in tmp_path.glob(f"*{ending}")) == [f"m{ending}", f"m_height{ending}"]


@pytest.mark.usefixtures("gpu_context")
def test_floats_keep_their_signs_and_need_no_range(tmp_path):
    """Positions of a plane from -1 to 1."""
    exact = bake(tmp_path, "exact.exr", depth=32, maps=("POSITION",), normal=False)
    report = bake(tmp_path, "m.dds", maps=("POSITION",), normal=False)
    (path,) = report.output
    held = containers.read(path)
    assert held.block_format is BC6H_SIGNED and len(held.levels) == 6
    texels, found = image_file.read(exact.output[0]), image_file.read(path)
    spread = 3 * 2.0 / SIZE  # from side to side of a block, whose colors lie on few lines
    assert texels[..., :2].min() < -0.9 and np.abs(found - texels)[..., :3].max() < spread
    assert report.maps["position"]["scale"] == 1.0
    assert np.abs(pixels(bpy.data.images[report.image]) - found)[..., :3].max() < 1e-3


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("alpha", [True, False])
def test_packed_channels_are_in_blocks_of_four(tmp_path, alpha):
    """Occlusion, roughness and metallic, which have no alpha of their own, and the mip levels of all."""
    report = bake(tmp_path, "m.dds", pack="GLTF", normal=False, alpha=alpha, rays=16, samples=1)
    exact = bake(tmp_path, "exact.png", depth=16, pack="GLTF", normal=False, rays=16, samples=1)
    held = containers.read(report.output[0])
    assert (held.block_format, held.is_srgb, held.has_alpha, len(held.levels)) == (BC7, False, alpha, 6)
    texels, found = image_file.read(exact.output[0]), image_file.read(report.output[0])
    assert np.abs(found - texels).max() < 0.05
    assert np.abs(pixels(bpy.data.images[report.image]) - found).max() < 0.51 / 255


@pytest.mark.usefixtures("gpu_context")
def test_a_file_of_blocks_that_others_share_is_not_changed_in_part(tmp_path):
    lows = [zoo.plane(name) for name in ("a", "b")]
    for low, shift in zip(lows, (0.0, 0.5), strict=True):
        uv = low.data.uv_layers[0].uv
        for item in uv:
            item.vector = (item.vector[0] * 0.4 + shift, item.vector[1])
    high, settings = zoo.terrain("high"), settings_of(tmp_path, "m.dds", method="CAST", image="all")
    bake_all(bpy.context, [Job(low, [high]) for low in lows], settings, share_image=True)
    before = (tmp_path / "m.dds").read_bytes()
    assert '"a"' in image_file.note_of(tmp_path / "m.dds") and '"b"' in image_file.note_of(tmp_path / "m.dds")
    with pytest.raises(BakeError, match="its format changes texels a little each time"):
        bake_pair(bpy.context, lows[0], [high], settings)
    assert (tmp_path / "m.dds").read_bytes() == before


def test_the_encoder_gets_rows_from_the_top_padding_and_weights(tmp_path, calls):
    texels, path = some((18, 11)), tmp_path / "m.ktx2"
    levels = [some((9, 5)), some((4, 2))]
    blocks = image_file.Blocks(BC7, Purpose.COLOR, levels)
    for has_alpha in (True, False):
        calls.clear()
        held = image_file.content(texels, path, 8, has_alpha=has_alpha, is_color=True, note=WRITTEN, blocks=blocks)
        held.write(path, iter(()))
        assert [call[0].shape for call in calls] == [(12, 20, 4), (8, 12, 4), (4, 4, 4)]
        first, block_format, purpose, weights = calls[0]
        assert (block_format, purpose) == (BC7, Purpose.COLOR) and first.flags.c_contiguous
        np.testing.assert_array_equal(first[:11, :18, :3], texels[::-1, :, :3])
        np.testing.assert_array_equal(first[11, :18, :3], texels[0, :, :3])
        np.testing.assert_array_equal(first[:11, 19, :3], texels[::-1, 17, :3])
        assert (first[:11, :18, 3] == (texels[::-1, :, 3] if has_alpha else 1.0)).all()
        assert ((weights[:11, :18] == 1.0) == (texels[::-1, :, 3] > 0)).all() and 0 < weights.min() < 0.1
        head = containers.head_of(path)
        assert (head.size, head.is_srgb, head.has_alpha, head.note) == ((18, 11), True, has_alpha, WRITTEN)
    calls.clear()
    image_file.content(texels, path, 8, blocks=image_file.Blocks(BC7, has_map_in_alpha=True))
    assert calls[0][3] is None


def test_a_floating_format_is_not_srgb(tmp_path, calls):
    from addon.blocks.formats import BC6H

    path = tmp_path / "m.dds"
    image_file.content(some(), path, 8, is_color=True, blocks=image_file.Blocks(BC6H)).write(path, iter(()))
    assert not containers.head_of(path).is_srgb
    assert str(image_file.format_of(path)) == "16 x 12 texels of 16-bit floats without alpha"


@pytest.mark.parametrize(("below", "compression"), [(0, "AUTO"), (3, "AUTO"), (3, "BC7")])
def test_normals_that_lose_their_sign_are_counted(tmp_path, calls, below, compression):
    from addon.core.map_types import NORMAL, WRITTEN, Labeled

    texels = some((16, 16))
    texels[8, :below, 2] = 0.2
    texels[0, 0, 2] = 0.1  # background
    states = np.where(texels[..., 3] > 0, WRITTEN, 0).astype(np.uint8)
    settings = settings_of(tmp_path, "m.dds", size=(16, 16), compression=compression, image="m")
    with outputs.Outputs(settings) as stored:
        half = {NORMAL.name: (texels[::2, ::2].copy(), states[::2, ::2])}
        levels = [half, *({NORMAL.name: (texels[:n, :n].copy(), states[:n, :n])} for n in (4, 2, 1))]
        stored.add(1001, {NORMAL.name: (texels, states)}, levels)
        found = stored.commit({Labeled.OBJECTS: ["hi"], Labeled.MATERIALS: []}, [])
    texts = [text for text in found.warnings if "z below 0" in text]
    assert len(texts) == (below > 0 and compression == "AUTO") and len(calls) == 6  # five levels, and the loss
    if texts:
        assert texts[0].startswith("3 texels of the normal map") and texts[0].harm is LOOK
        assert texts[0].endswith("--compression bc7 stores all three channels.")


@pytest.mark.parametrize(
    ("name", "values", "sentence"),
    [
        ("m.dds", {"size": (30, 32)}, "30 x 32 texels does not load in Direct3D, which takes multiples of 4"),
        ("m.dds", {"depth": 16}, "A .dds file stores 8 bits per channel, not 16"),
        ("m.ktx2", {"udim": True}, "Blender shows no UDIM tiles of .ktx2 files"),
        ("m.jpg", {"pack": "HDRP", "maps": ("METALLIC",)}, r"in its alpha, but \.jpg files have no alpha: .* \.png\.$"),
        ("m.webp", {"pack": "URP"}, r"in its alpha, but \.webp files lose colors where alpha is 0: .* \.png\.$"),
        ("m.webp", {"pack": "CUSTOM", "pack_red": "HEIGHT", "pack_alpha": "ZERO"}, "a number in its alpha, but"),
        (
            "m.webp",
            {"size": (16384, 16)},
            "side above 16,383, which WebP does not store: choose a smaller size, or a .png",
        ),
        ("m.webp", {"quality": 0}, "Quality: 0 is outside"),
        ("m.dds", {"compression": "BC1"}, "Compression: 'BC1'"),
    ],
)
def test_settings_that_files_do_not_take_are_refused(tmp_path, name, values, sentence):
    with pytest.raises(BakeError, match=sentence):
        settings_of(tmp_path, name, **values).check()


def test_packed_images_without_a_map_in_alpha_go_into_webp(tmp_path):
    settings_of(tmp_path, "m.webp", pack="UNREAL").check()


def test_other_sizes_are_taken(tmp_path):
    settings_of(tmp_path, "m.ktx2", size=(16384, 16)).check()
    settings_of(tmp_path, "m.jpg", size=(16384, 16)).check()
    settings_of(tmp_path, "m.webp", size=(16, 16383)).check()
    settings_of(tmp_path, "m.ktx2", size=(30, 21)).check()
    settings_of(tmp_path, "m.png", size=(30, 21), compression="BC7").check()


def test_floats_are_encoded_without_dither(tmp_path, calls):
    texels = some()
    with outputs.MapWriter("low", settings_of(tmp_path, "m.dds", size=(16, 12), dither=True)) as writer:
        writer.add(1001, texels)
    np.testing.assert_array_equal(calls[0][0][..., :3], texels[::-1, :, :3])


def test_nothing_is_left_of_files_that_are_not_stored(tmp_path, calls):
    path = tmp_path / "m.dds"
    path.write_bytes(b"an old picture")
    writer = outputs.MapWriter("low", settings_of(tmp_path, "m.dds", size=(16, 12)), levels=2)
    writer.add(1001, some())
    assert len(list(tmp_path.glob("*.dds"))) == 1 and not calls  # it waits for its level
    writer.add(1001, some((8, 6)), level=1)
    assert len(list(tmp_path.glob("*.dds"))) == 2 and len(calls) == 2 and writer.tiles == [1001]
    writer.discard()
    assert [one.name for one in tmp_path.iterdir()] == ["m.dds"] and path.read_bytes() == b"an old picture"


@pytest.mark.parametrize("has_alpha", [True, False])
@pytest.mark.parametrize("note", ["", WRITTEN])
def test_webp_without_losses(tmp_path, has_alpha, note):
    texels, path = some((41, 23)), tmp_path / "m.webp"
    image_file.content(texels, path, 8, has_alpha=has_alpha, note=note).write(path, iter(()))
    steps = np.floor(texels * 255 + 0.5)
    kept = texels[..., 3] > 0 if has_alpha else np.ones(texels.shape[:2], bool)
    with Image.open(path) as picture:
        assert picture.mode == ("RGBA" if has_alpha else "RGB")
        found = np.asarray(picture)[::-1]
        assert (WRITTEN.split(",")[1] in picture.info.get("xmp", b"").decode().replace("&quot;", '"')) == bool(note)
    np.testing.assert_array_equal(found[kept][:, :3], steps[kept][:, :3])
    np.testing.assert_array_equal(np.round(image_file.read(path)[kept] * 255)[:, :3], steps[kept][:, :3])
    if has_alpha:
        np.testing.assert_array_equal(found[..., 3], steps[..., 3])
    assert image_file.note_of(path) == note
    assert image_file.format_of(path).has_alpha == has_alpha
    image = datablocks.show("m", str(path))
    assert np.abs(pixels(image)[kept][:, :3] * 255 - steps[kept][:, :3]).max() < 0.01


@pytest.mark.parametrize("name", ["m.webp", "m.jpg", "m.jpeg"])
def test_quality(tmp_path, name):
    """Less of it makes smaller files of larger errors; JPEG stores all texels of all channels, and is gray if the map is."""
    texels, sizes, errors = some((64, 48)), [], []
    texels[..., :3] = 0.5 + 0.4 * np.sin(np.linspace(0, 12, 64 * 48 * 3)).reshape(48, 64, 3)
    for quality in (100, 90, 40):
        path = tmp_path / name
        image_file.content(texels, path, 8, has_alpha=False, note=WRITTEN, quality=quality).write(path, iter(()))
        found = image_file.read(path)
        assert image_file.note_of(path) == WRITTEN and not image_file.format_of(path).has_alpha
        sizes.append(path.stat().st_size)
        errors.append(np.abs(found - texels)[..., :3].mean())
    assert sizes == sorted(sizes, reverse=True) and errors == sorted(errors)
    assert errors[0] < 0.51 / 255 if name == "m.webp" else errors[0] < 2 / 255
    if name != "m.webp":
        with Image.open(path) as picture:
            assert [layer[1:3] for layer in picture.layer] == [(1, 1)] * 3
        image_file.content(texels, path, 8, is_gray=True).write(path, iter(()))
        with Image.open(path) as picture:
            assert picture.mode == "L"


@pytest.mark.parametrize("ending", [".webp", ".jpg"])
def test_normal_maps_keep_their_quality(tmp_path, ending):
    settings = settings_of(tmp_path, f"m{ending}", maps=("AO", "BENT_NORMAL"), quality=60)

    def qualities(**values):
        by_map = map_names.settings_by_map(settings.stored(**values))
        return {name: of_map.storing.quality for name, of_map in by_map.items()}

    assert qualities() == {"NORMAL": 100, "BENT_NORMAL": 100, "AO": 60}
    assert set(qualities(lossy_normals=True).values()) == {60}
    lossy = {name for name, one in map_names.settings_by_map(settings).items() if one.storing.is_lossy}
    assert lossy == ({"AO"} if ending == ".webp" else {"NORMAL", "AO", "BENT_NORMAL"})


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("name", ["m.webp", "m.jpg"])
def test_a_bake_into_pictures_of_the_web(tmp_path, name):
    report = bake(tmp_path, name, maps=("AO",), rays=16)
    assert [path.rsplit("/")[-1] for path in report.output] == [name, name.replace("m", "m_ao")]
    exact = bake(tmp_path, "exact.png")
    assert exact.output
    difference = np.abs(image_file.read(tmp_path / name) - image_file.read(tmp_path / "exact.png"))[..., :3]
    assert difference.max() < (1e-6 if name == "m.webp" else 6 / 255)
    assert pictures.read(tmp_path / "m_ao.jpg").shape[-1] == 1 if name == "m.jpg" else True
