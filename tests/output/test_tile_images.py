# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests maps of several UDIM tiles, in files and packed, and that tiles without a bake do not change."""

import os
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.core import map_types
from addon.core.errors import BakeError
from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.jobs import Job, bake_jobs, bake_pair
from addon.output import map_names, outputs
from tests.support import maps, pictures, scenes, zoo
from tests.support.snapshot import difference, snapshot

SIZE = 32
TILES = (1001, 1002, 1003)
ROUNDING = 1e-6


def texels(tile, seed=0):
    """Noise that is different for each tile."""
    result = np.random.default_rng((seed, tile)).random((SIZE, SIZE, 4), dtype=np.float32)
    result[..., 3] = 1.0
    return result


def store(*tiles, seed=0, **settings):
    """Store tiles with the Writer. Returns the image."""
    settings = Settings(**{"width": SIZE, "height": SIZE, "udim": True, "image": "map", **settings})
    settings.check()
    outputs.check_storage("low", settings)
    with outputs.MapWriter("low", settings) as writer:
        for tile in tiles:
            writer.add(tile, texels(tile, seed))
        return writer.commit()


def numbers(image):
    return tuple(tile.number for tile in image.tiles)


def packed(image):
    """The packed bytes by tile."""
    return {part.tile_number: part.packed_file.data for part in image.packed_files}


def shown(image, folder):
    """The pixels in memory of each tile, by number. Image.pixels has only those of the first tile."""
    folder = Path(folder, "shown")
    folder.mkdir(exist_ok=True)
    copy = image.copy()
    try:
        assert all(tuple(tile.size) == (SIZE, SIZE) for tile in copy.tiles)  # which loads them
        copy.filepath_raw = str(folder / "tile.<UDIM>")
        copy.save()
    finally:
        bpy.data.images.remove(copy)
    return {tile: picture(folder / f"tile.{tile}") for tile in numbers(image)}


def picture(path):
    """The pixels of a file."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.is_data, image.alpha_mode = True, "CHANNEL_PACKED"
    try:
        return maps.pixels(image)
    finally:
        bpy.data.images.remove(image)


def unpacked(image, folder):
    """The pixels of each packed tile."""
    result = {}
    for tile, data in packed(image).items():
        path = Path(folder, f"unpacked.{tile}")
        path.write_bytes(data)
        result[tile] = picture(path)
        path.unlink()
    return result


def wide(name, waves):
    """A sheet over three tiles from left to right: 24 x 8 quads, or with waves, 192 x 64."""
    n = 64 if waves else 8

    def surface(u, v):
        return np.stack([6 * u - 3, 2 * v - 1, waves * 0.05 * np.sin(30 * u) * np.cos(9 * v)], axis=1)

    obj = zoo.sheet(name, surface, 3 * n, n)
    layer = obj.data.uv_layers[0].uv
    uv = np.empty(2 * len(layer), np.float32)
    layer.foreach_get("vector", uv)
    layer.foreach_set("vector", (uv.reshape(-1, 2) * (3, 1)).ravel())
    return obj


# Files


@pytest.mark.parametrize(("name", "depth"), [("map.png", 8), ("map.tif", 16), ("map.tga", 8), ("map.exr", 32)])
def test_each_tile_gets_a_file(name, depth, tmp_path):
    image = store(*TILES, storage="FILE", output=str(tmp_path / name), depth=depth)
    stem, ending = os.path.splitext(name)
    assert sorted(os.listdir(tmp_path)) == [f"{stem}.{tile}{ending}" for tile in TILES]
    for tile in TILES:
        np.testing.assert_allclose(picture(tmp_path / f"map.{tile}{ending}"), texels(tile), atol=0.5 / 255 + ROUNDING)
    assert (image.source, image.filepath) == ("TILED", str(tmp_path / f"map.<UDIM>{ending}"))
    assert numbers(image) == TILES
    assert image.colorspace_settings.is_data
    assert image.alpha_mode == "CHANNEL_PACKED"
    assert list(bpy.data.images) == [image]


@pytest.mark.parametrize(
    ("output", "map_files", "mask_files"),
    [
        ("map.png", "map.1002.png", "map_missed.1002.png"),
        ("map.<UDIM>.png", "map.1002.png", "map_missed.1002.png"),
        ("map_<UDIM>_v2.png", "map_1002_v2.png", "map_missed_1002_v2.png"),
        ("<UDIM>.png", "1002.png", "_missed1002.png"),
        ("a.b.png", "a.b.1002.png", "a.b_missed.1002.png"),
    ],
)
def test_the_number_replaces_the_placeholder(output, map_files, mask_files, tmp_path):
    store(1002, storage="FILE", output=str(tmp_path / output))
    settings = Settings(udim=True, image="map", storage="FILE", output=str(tmp_path / output))
    mask = map_names.beside(settings, map_types.MASK)
    store(1002, storage="FILE", output=mask.storing.output, image=mask.storing.image, depth=mask.storing.depth)
    assert sorted(os.listdir(tmp_path)) == sorted([map_files, mask_files])
    assert all(numbers(image) == (1002,) for image in bpy.data.images)


def test_a_path_relative_to_the_saved_scene(tmp_path):
    scenes.save(tmp_path / "scene.blend")
    image = store(*TILES, storage="FILE", output="//map.png")
    assert image.filepath == "//map.<UDIM>.png"
    assert (tmp_path / "map.1003.png").is_file()
    assert numbers(image) == TILES


def test_tiles_are_written_when_they_are_added(tmp_path):
    """So that memory does not grow with their number. No file is in place before all of them are complete."""
    settings = Settings(width=SIZE, height=SIZE, udim=True, storage="FILE", output=str(tmp_path / "map.png"))
    with outputs.MapWriter("low", settings) as writer:
        for count, tile in enumerate(TILES):
            assert len(list(tmp_path.glob("*.png"))) == count
            writer.add(tile, texels(tile))
        assert all(name.startswith(".imprint.") for name in os.listdir(tmp_path))
    assert os.listdir(tmp_path) == []
    assert not bpy.data.images


# Other tiles


def test_baking_one_tile_keeps_the_files_of_the_others(tmp_path):
    paths = {tile: tmp_path / f"map.{tile}.png" for tile in TILES}
    image = store(*TILES, storage="FILE", output=str(tmp_path / "map.png"))
    before = {tile: (path.read_bytes(), path.stat().st_mtime_ns, path.stat().st_ino) for tile, path in paths.items()}
    seen = shown(image, tmp_path)
    assert store(1002, seed=1, storage="FILE", output=str(tmp_path / "map.png")) == image
    after = {tile: (path.read_bytes(), path.stat().st_mtime_ns, path.stat().st_ino) for tile, path in paths.items()}
    assert [tile for tile in TILES if before[tile] != after[tile]] == [1002]
    now = shown(image, tmp_path)
    assert [tile for tile in TILES if not np.array_equal(seen[tile], now[tile])] == [1002]
    np.testing.assert_allclose(now[1002], texels(1002, seed=1), atol=2e-5)
    assert numbers(image) == TILES


@pytest.mark.parametrize("depth", [8, 16])
def test_baking_one_tile_keeps_the_packed_bytes_of_the_others(depth, tmp_path):
    image = store(*TILES, depth=depth)
    before, seen = packed(image), shown(image, tmp_path)
    assert store(1002, seed=1, depth=depth) == image
    after, now = packed(image), shown(image, tmp_path)
    assert list(after) == list(TILES)
    assert [tile for tile in TILES if before[tile] != after[tile]] == [1002]
    assert [tile for tile in TILES if not np.array_equal(seen[tile], now[tile])] == [1002]
    np.testing.assert_allclose(now[1002], texels(1002, seed=1), atol=0.5 / 255 + ROUNDING if depth == 8 else 0)


def test_a_new_tile_joins_the_others():
    image = store(1001, 1003)
    before = packed(image)
    store(1012)
    assert numbers(image) == (1001, 1003, 1012)
    assert packed(image) == {**before, 1012: packed(image)[1012]}


@pytest.mark.parametrize(("first", "then"), [("PACK", "FILE"), ("FILE", "PACK"), ("FILE", "ELSEWHERE")])
def test_other_tiles_are_copied_to_the_new_storage(first, then, tmp_path):
    """With the same bytes."""
    (tmp_path / "other").mkdir()
    places = {
        "PACK": {"storage": "PACK", "depth": 8},
        "FILE": {"storage": "FILE", "depth": 8, "output": str(tmp_path / "map.png")},
        "ELSEWHERE": {"storage": "FILE", "depth": 8, "output": str(tmp_path / "other" / "it.<UDIM>.png")},
    }

    def contents(where):
        if where == "PACK":
            return packed(image)
        path = places[where]["output"].replace(".<UDIM>", "")
        return {tile: Path(path).with_suffix(f".{tile}.png").read_bytes() for tile in numbers(image)}

    image = store(*TILES, **places[first])
    before = contents(first)
    assert store(1002, seed=1, **places[then]) == image
    after = contents(then)
    assert numbers(image) == tuple(after) == TILES
    assert [tile for tile in TILES if before[tile] != after[tile]] == [1002]
    assert (image.packed_file is not None) == (then == "PACK")
    if first == "FILE":
        assert contents(first) == before


def test_other_tiles_of_another_format_stop_the_bake(tmp_path):
    """They would become PNG files with the ending .exr."""
    image = store(*TILES, depth=8)
    before, bytes_before = snapshot(), packed(image)
    with pytest.raises(BakeError, match="Tile 1001 .* would be lost"):
        store(1002, storage="FILE", output=str(tmp_path / "map.exr"))
    assert os.listdir(tmp_path) == []
    assert difference(before, snapshot()) == {}
    assert packed(image) == bytes_before
    assert numbers(store(*TILES, storage="FILE", output=str(tmp_path / "map.exr"))) == TILES


def test_other_tiles_that_would_overwrite_different_files_stop_the_bake(tmp_path):
    store(*TILES, storage="FILE", depth=8, output=str(tmp_path / "map.png"))
    image = store(*TILES, seed=1, depth=8)
    before, files = packed(image), {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(BakeError, match="Tile 1001 .* would be lost"):
        store(1002, storage="FILE", depth=8, output=str(tmp_path / "map.png"))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == files
    assert packed(image) == before


@pytest.mark.parametrize(("storage", "udim"), [("PACK", True), ("FILE", True), ("PACK", False)])
def test_painted_tiles_are_not_lost(storage, udim, tmp_path):
    image = store(*TILES)
    image.pixels[0] = 0.25
    before = snapshot()
    with pytest.raises(BakeError, match="tiles with unsaved changes"):
        store(1002, storage=storage, udim=udim, output=str(tmp_path / "map.png"))
    assert difference(before, snapshot()) == {}
    image.pack()
    store(1002)
    assert unpacked(image, tmp_path)[1001][0, 0, 0] == 0.25


@pytest.mark.parametrize("storage", ["PACK", "FILE"])
def test_empty_tiles_are_kept(storage, tmp_path):
    """An artist may add tiles before baking them."""
    image = bpy.data.images.new("map", 8, 8, tiled=True)
    image.tiles.new(1005)
    assert store(1002, storage=storage, output=str(tmp_path / "map.png")) == image
    assert numbers(image) == (1001, 1002, 1005)
    store(1001, 1005, storage=storage, output=str(tmp_path / "map.png"))
    assert numbers(image) == (1001, 1002, 1005)


# Packed


@pytest.mark.parametrize(("depth", "ending"), [(8, "png"), (16, "exr"), (32, "exr")])
def test_packed_tiles_survive_saving(depth, ending, tmp_path):
    image = store(*TILES, depth=depth)
    assert image.filepath == f"//map.<UDIM>.{ending}"
    assert [part.filepath for part in image.packed_files] == [f"//map.{tile}.{ending}" for tile in TILES]
    image.use_fake_user = True
    scenes.save(tmp_path / "scene.blend")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    image = bpy.data.images["map"]
    assert (image.source, numbers(image)) == ("TILED", TILES)
    found = unpacked(image, tmp_path)
    for tile in TILES:
        np.testing.assert_allclose(found[tile], texels(tile), atol=0.5 / 255 + ROUNDING if depth == 8 else 0)
    np.testing.assert_array_equal(maps.pixels(image), found[1001])
    assert image.is_float == (depth > 8)


# From one tile to several and back


def test_one_image_can_change_storage_and_tiles(tmp_path):
    """And keeps its users."""
    kinds = [
        {"storage": "MEMORY", "udim": False, "depth": 8},
        {"storage": "PACK", "udim": True, "depth": 8},
        {"storage": "FILE", "udim": False, "output": str(tmp_path / "map.png")},
        {"storage": "FILE", "udim": True, "output": str(tmp_path / "map.png")},
        {"storage": "PACK", "udim": False, "depth": 32},
        {"storage": "FILE", "udim": True, "output": str(tmp_path / "map.exr")},
        {"storage": "MEMORY", "udim": False, "depth": 32},
        {"storage": "PACK", "udim": True, "depth": 32},
        {"storage": "PACK", "udim": False, "depth": 8},
    ]
    bpy.data.images.new("map", 8, 8)["note"] = "keep"
    node = bpy.data.materials.new("user").node_tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images["map"]
    for turn in range(3 * len(kinds)):
        kind = kinds[turn * 4 % len(kinds)] if turn > len(kinds) else kinds[turn % len(kinds)]
        tiles = TILES if kind["udim"] else (1001,)
        image = store(*tiles, seed=turn, **kind)
        assert image == node.image
        assert image["note"] == "keep"
        assert numbers(image) == tiles
        assert (image.source == "TILED") == kind["udim"]
        assert len(image.packed_files) == (len(tiles) if kind["storage"] == "PACK" else 0)
        assert not image.is_dirty or kind["storage"] == "MEMORY"
        np.testing.assert_allclose(maps.pixels(image), texels(1001, turn), atol=0.5 / 255 + ROUNDING)
        assert image.colorspace_settings.is_data
        assert len(bpy.data.images) == 1


# Wrong input


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"storage": "MEMORY"},
            "Blender cannot keep UDIM tiles in memory alone: store them in a file, or packed.",
        ),
        (
            {"storage": "FILE", "output": "map.<UDIM>.png", "udim": False},
            "'map.<UDIM>.png' contains <UDIM> but UDIM Tiles is off: enable it.",
        ),
    ],
)
def test_settings_that_cannot_be_stored_are_refused(settings, message):
    with pytest.raises(BakeError) as refused:
        Settings(**{"udim": True, **settings}).check()
    assert str(refused.value) == message


def test_a_file_in_place_of_a_folder(tmp_path):
    (tmp_path / "no").touch()
    settings = Settings(udim=True, storage="FILE", output=str(tmp_path / "no" / "map.png"))
    with pytest.raises(BakeError, match="could not be written|cannot be written"):
        outputs.check_storage("low", settings)


def test_a_full_disk_while_tiles_are_written(tmp_path):
    resource = pytest.importorskip("resource")
    store(*TILES, storage="FILE", output=str(tmp_path / "map.tga"), depth=8)
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    settings = Settings(width=SIZE, height=SIZE, udim=True, storage="FILE", output=str(tmp_path / "map.tga"), depth=8)
    before, limits = snapshot(), resource.getrlimit(resource.RLIMIT_FSIZE)
    with (
        pytest.raises(BakeError, match=r"map.100[12].tga' could not be written"),
        outputs.MapWriter("map", settings) as writer,
    ):
        writer.add(1001, texels(1001, seed=1))
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        try:
            writer.add(1002, texels(1002, seed=1))
            writer.commit()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == files
    assert difference(before, snapshot()) == {}


# Whole bakes


def bake(low, high, **settings):
    settings = {"method": "FLATTEN", "margin": 4, "udim": True, "material": False, "image": "map", **settings}
    return bake_pair(bpy.context, low, [high], Settings(width=SIZE, height=SIZE, **settings))


@pytest.mark.usefixtures("gpu_context")
def test_a_mesh_over_three_tiles_gets_three_files(tmp_path):
    low, high = wide("low", 0.0), wide("high", 1.0)
    report = bake(low, high, storage="FILE", output=str(tmp_path / "map.png"), mask=True, material=True)
    assert sorted(os.listdir(tmp_path)) == sorted(
        [*(f"map.{tile}.png" for tile in TILES), *(f"map_missed.{tile}.png" for tile in TILES)]
    )
    assert report.output == [str(tmp_path / f"{name}.{tile}.png") for name in ("map", "map_missed") for tile in TILES]
    assert report.tiles == list(TILES)
    assert set(report.loss) == {"median", "maximum"}
    assert numbers(bpy.data.images["map"]) == numbers(bpy.data.images["map_missed"]) == TILES
    for shift, tile in enumerate(TILES):
        # The tile is the same as a bake of its faces moved to tile 1001.
        for obj in (low, high):
            layer = obj.data.uv_layers[0].uv
            uv = np.empty(2 * len(layer), np.float32)
            layer.foreach_get("vector", uv)
            layer.foreach_set("vector", (uv.reshape(-1, 2) - (1 if shift else 0, 0)).astype(np.float32).ravel())
        alone = bake(low, high, udim=False, image="alone", storage="FILE", output=str(tmp_path / "alone.png"))
        assert alone.image == "alone"
        np.testing.assert_array_equal(
            pictures.read(tmp_path / f"map.{tile}.png"), pictures.read(tmp_path / "alone.png")
        )


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("storage", ["PACK", "FILE"])
def test_a_whole_bake_of_one_tile_keeps_the_others(storage, tmp_path):
    low, high = wide("low", 0.0), wide("high", 1.0)

    def contents():
        return packed(image) if storage == "PACK" else {t: (tmp_path / f"map.{t}.png").read_bytes() for t in TILES}

    bake(low, high, storage=storage, output=str(tmp_path / "map.png"))
    image = bpy.data.images["map"]
    before = contents()
    report = bake(low, wide("other", 2.0), storage=storage, output=str(tmp_path / "map.png"), tiles=(1002,))
    assert report.tiles == [1002]
    assert [tile for tile in TILES if before[tile] != contents()[tile]] == [1002]
    assert numbers(image) == TILES


@pytest.mark.usefixtures("gpu_context")
def test_the_last_tile(tmp_path):
    """2000, with u from 9 to 10 and v from 99 to 100."""
    low, high = zoo.plane("low"), zoo.plane("high", slope=0.5)
    for obj in (low, high):
        layer = obj.data.uv_layers[0].uv
        for corner in layer:
            corner.vector = corner.vector[0] + 9.0, corner.vector[1] + 99.0
    report = bake(low, high, space="OBJECT", storage="FILE", output=str(tmp_path / "map.png"), tiles=(2000,))
    assert report.tiles == [2000]
    assert report.coverage > 0.99
    assert report.checks["outside"]["count"] == 0
    assert numbers(bpy.data.images["map"]) == (2000,)
    normal = np.array([-0.5, 0.0, 1.0]) / np.hypot(0.5, 1.0)
    assert np.abs(picture(tmp_path / "map.2000.png")[16, 16, :3] - (normal * 0.5 + 0.5)).max() < 1e-4


@pytest.mark.usefixtures("gpu_context")
def test_a_tile_of_another_map_that_would_be_lost_stops_all_maps(tmp_path):
    low, high = wide("low", 0.0), wide("high", 1.0)
    height = store(1001, depth=8, image="map_height")  # a packed PNG, not an EXR
    (tmp_path / "map.1002.exr").write_bytes(b"an old picture")
    before, bytes_before = snapshot(), packed(height)
    with pytest.raises(BakeError, match="'map_height' would be lost"):
        bake(low, high, tiles=(1002,), maps=("HEIGHT",), storage="FILE", output=str(tmp_path / "map.exr"))
    assert difference(before, snapshot()) == {}
    assert packed(height) == bytes_before
    assert os.listdir(tmp_path) == ["map.1002.exr"]
    assert (tmp_path / "map.1002.exr").read_bytes() == b"an old picture"


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("names", [{"map.1003.png"}, {"map_missed.1001.png"}, {"map_height.1002.png"}])
def test_all_files_are_restored_if_one_cannot_be_replaced(tmp_path, names, monkeypatch):
    low, high = wide("low", 0.0), wide("high", 1.0)
    real = os.replace

    def fail(source, target):
        if Path(target).name in names:
            raise OSError(13, "Permission denied")
        real(source, target)

    for name in ("map.1001.png", "map_missed.1001.png"):
        (tmp_path / name).write_bytes(b"an old picture")
    before = snapshot(), {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(BakeError, match="could not be written: Permission denied"):
        bake(low, high, maps=("HEIGHT",), mask=True, storage="FILE", output=str(tmp_path / "map.png"))
    assert difference(before[0], snapshot()) == {}
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before[1]


@pytest.mark.usefixtures("gpu_context")
def test_a_stray_uv_does_not_bake_hundreds_of_tiles():
    low, high = zoo.plane("low", n=2), zoo.plane("high")
    low.data.uv_layers[0].uv[0].vector = 1e6, 1e6
    with pytest.raises(BakeError, match="'low' covers 1000 UDIM tiles"):
        bake(low, high, storage="PACK")
    assert bake(low, high, storage="PACK", tiles=(1001,)).tiles == [1001]


@pytest.mark.usefixtures("gpu_context")
def test_a_tile_beside_a_triangle_is_not_written(tmp_path):
    """The bounding box of a triangle may cover tiles that the triangle does not."""
    corners = np.array([[0.2, 0.2], [1.8, 0.3], [1.8, 1.8]])
    meshes = [
        zoo.build(name, np.pad(corners, ((0, 0), (0, 1))), [[0, 1, 2]], corners[None]) for name in ("low", "high")
    ]
    (tmp_path / "map.1011.png").write_bytes(b"another picture")
    report = bake(*meshes, storage="FILE", output=str(tmp_path / "map.png"), margin=0)
    assert report.tiles == [1001, 1002, 1012]
    assert (tmp_path / "map.1011.png").read_bytes() == b"another picture"


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("storage", ["PACK", "FILE"])
def test_a_stopped_bake_of_tiles_leaves_no_files(storage, tmp_path, monkeypatch):
    temporary, folder = tmp_path / "temporary", tmp_path / "maps"
    temporary.mkdir()
    folder.mkdir()
    monkeypatch.setattr(outputs.tempfile, "tempdir", str(temporary))
    low, high = wide("low", 0.0), wide("high", 1.0)
    settings = Settings(
        method="FLATTEN",
        width=SIZE,
        height=SIZE,
        udim=True,
        storage=storage,
        output=str(folder / "map.png"),
        image="map",
    )
    work = bake_jobs.work(bpy.context, [Job(low, [high])], settings, Pace(0.001))
    most = 0
    for _ in work:
        found = [name for _, _, names in os.walk(tmp_path) for name in names]
        most = max(most, len(found))
        if len(found) == 2:
            break
    assert most == 2
    work.close()
    assert [name for _, _, names in os.walk(tmp_path) for name in names] == []
    assert os.listdir(temporary) == []
    assert not bpy.data.images
