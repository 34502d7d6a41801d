# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what measures maps in engines, without engines: .glb files, drawn triangles, and the report."""

import json
import struct
import zlib

import numpy as np
import pytest

from addon.core.declarations import readers
from addon.core.file_structure.image_headers import image_size
from scripts.dev.in_engines import chromium, drawing, engine_report
from scripts.dev.in_engines.glb_file import Glb
from scripts.imprint import ROOT


def glb(*, tangents=True):
    """A file of one triangle, stretched along Y, turned by 90 degrees about X and moved, with a normal map."""
    arrays = {
        "POSITION": np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32),
        "NORMAL": np.array([(0, 0.6, 0.8)] * 3, np.float32),
        "TEXCOORD_0": np.array([(0.1, 0.9), (0.9, 0.9), (0.1, 0.1)], np.float32),
        "TANGENT": np.array([(0, 0.8, -0.6, -1)] * 3, np.float32),
        "indices": np.array([0, 1, 2], np.uint16),
    }
    if not tangents:
        del arrays["TANGENT"]
    views, accessors, binary = [], [], b""
    for values in arrays.values():
        binary += bytes(-len(binary) % 4)
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes})
        kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        number = 5123 if values.dtype == np.uint16 else 5126
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": number, "count": len(values), "type": kind},
        )
        binary += values.tobytes()
    places = {name: index for index, name in enumerate(arrays)}
    part = {"indices": places.pop("indices"), "attributes": places, "material": 0}
    turned = {"mesh": 0, "rotation": [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], "translation": [0, 0, 5], "scale": [1, 2, 1]}
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [turned],
        "meshes": [{"primitives": [part]}],
        "materials": [{"normalTexture": {"index": 0}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 0, "mimeType": "image/png"}],
        "accessors": accessors,
        "bufferViews": views,
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    parts = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return Glb(struct.pack("<III", 0x46546C67, 2, 12 + len(parts)) + parts)


# Files


def test_a_surface_is_in_world_space():
    surface = glb().surface()
    assert np.allclose(surface.position[0], [(0, 0, 5), (1, 0, 5), (0, 0, 7)])
    assert np.allclose(surface.normal, np.array((0, -0.8, 0.3)) / np.sqrt(0.73))
    assert np.allclose(surface.tangent, (*(np.array((0, 0.6, 1.6)) / np.sqrt(2.92)), -1))


def test_a_file_survives_reading_and_writing():
    file = glb()
    again = Glb(file.content())
    assert again.document == file.document
    assert again.binary.rstrip(b"\0") == file.binary.rstrip(b"\0")
    assert np.array_equal(again.surface().uv, file.surface().uv)
    assert struct.unpack_from("<I", file.content(), 8)[0] == len(file.content())


def test_an_image_is_replaced_and_nothing_else():
    file = glb()
    file.set_image(file.normal_texture(), b"other content")
    view = file.document["bufferViews"][file.document["images"][0]["bufferView"]]
    assert Glb(file.content()).binary[view["byteOffset"] :][: view["byteLength"]] == b"other content"
    assert np.array_equal(file.surface().uv, glb().surface().uv)


def test_copies_lack_what_they_are_named_for():
    assert "normalTexture" not in glb().without_normal_map().document["materials"][0]
    assert glb().without_tangents().surface().tangent is None
    material = glb().with_map_as_surface().document["materials"][0]
    assert "normalTexture" not in material
    assert material["pbrMetallicRoughness"]["metallicRoughnessTexture"] == {"index": 0}


def test_a_camera_has_the_matrix_of_its_view():
    file, view = glb(), drawing.look_at(np.array((1.0, 2.0, 3.0)), np.zeros(3))
    file.set_cameras([view], 30.0, 0.1, 10.0)
    node = file.document["nodes"][file.document["scenes"][0]["nodes"][-1]]
    assert np.allclose(np.array(node["matrix"]).reshape(4, 4).T[:3, 3], (1.0, 2.0, 3.0))
    assert file.document["cameras"][node["camera"]]["name"] == "view0"


def test_an_image_is_found_by_its_number():
    file = glb()
    file.set_image(0, b"content")
    assert file.image(0) == b"content"


def test_what_is_no_glb_is_refused():
    with pytest.raises(ValueError, match=r"not a \.glb file"):
        Glb(b"PK" + bytes(30))


def test_engines_are_declared_readers_and_have_a_page():
    assert set(chromium.ENGINES) <= set(readers.BY_NAME)
    pages = {path.stem for path in chromium.PAGES.glob("*.js")}
    assert set(chromium.ENGINES) | {"main", "float_canvas"} == pages


# Pixels


def test_a_triangle_covers_the_centers_inside_it():
    drawn = drawing.lay_out(np.array([[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]]), 4)
    assert np.array_equal(drawn.there, np.arange(4)[:, None] + np.arange(4) <= 3)
    assert np.allclose(drawn.weights[1, 2], (0.0, 0.625, 0.375))


def test_triangles_that_share_texels_are_counted():
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])
    assert drawing.lay_out(np.array([square, square[::-1]]), 8).count.max() == 2


def test_an_eye_sees_the_nearest_triangle_from_before():
    near = np.array([(-1.0, -1.0, 0.5), (1.0, -1.0, 0.5), (0.0, 1.0, 0.5)])
    points = np.stack([near - (0.0, 0.0, 1.0), near])
    clip = np.concatenate([points, np.ones((2, 3, 1))], axis=-1)
    lens = drawing.perspective(60.0, 0.1, 10.0) @ drawing.look_at(np.array((0.0, 0.0, 3.0)), np.zeros(3))
    assert set(np.unique(drawing.draw(clip @ lens.T, 16).triangle)) == {-1, 1}
    assert set(np.unique(drawing.draw(clip[::-1] @ lens.T, 16).triangle)) == {-1, 0}
    assert not drawing.draw(clip[:, ::-1] @ lens.T, 16).there.any()


def test_weights_are_those_of_the_point_in_perspective():
    eye = np.array((0.0, 0.0, 3.0))
    points = np.array([[(-1.0, -1.0, 1.0), (1.0, -1.0, -4.0), (0.0, 1.0, -1.0)]])
    lens = drawing.perspective(60.0, 0.1, 20.0) @ drawing.look_at(eye, np.zeros(3))
    drawn = drawing.draw(np.concatenate([points, np.ones((1, 3, 1))], axis=-1) @ lens.T, 16)
    rows, columns = np.nonzero(drawn.there)
    seen = (drawn.weights[rows, columns] @ points[0]) - eye
    place = np.stack([columns, rows], axis=-1) + 0.5
    assert np.allclose(seen[:, :2] / -seen[:, 2:] / np.tan(np.radians(30.0)), place / 8.0 - 1.0)


def test_a_mesh_is_seen_as_a_whole_from_each_direction():
    cube = np.array(np.meshgrid((-1, 1), (-1, 1), (-1, 1))).reshape(3, 8).T * (1.0, 2.0, 3.0) + (5.0, 0.0, 0.0)
    corners = np.array([(a, b, c) for a in cube for b in cube for c in cube if (a != b).any() and (b != c).any()])
    sights = drawing.look_around(corners, [(0.0, 0.0, 2.0), (1.0, 0.0, 0.0)], 64)
    for matrix, drawn, wide in zip(sights.matrices, sights.drawn, (1.0, 3.0), strict=True):
        seen = np.append(corners, np.ones((*corners.shape[:2], 1)), axis=-1) @ matrix.T
        assert -sights.far < seen[..., 2].min() < seen[..., 2].max() < -sights.near
        assert np.isclose(seen[..., 0].max(), wide)
        assert drawn.there.any()
        assert not (drawn.there[[0, -1]].any() or drawn.there[:, [0, -1]].any())


def test_the_footprint_is_the_four_texels_around_a_point():
    columns, rows = drawing.footprint(np.array([(0.3, 0.9), (0.01, 0.5)]), 8)
    assert sorted(set(columns[0])) == [1, 2]
    assert sorted(set(rows[0])) == [6, 7]
    assert sorted(set(columns[1])) == [0, 7]


def test_a_picture_has_its_size_and_first_row_at_the_top(tmp_path):
    colors = np.zeros((2, 3, 3), np.uint8)
    colors[1] = 255
    content = drawing.png_of(colors)
    (tmp_path / "a.png").write_bytes(content)
    with open(tmp_path / "a.png", "rb") as file:
        assert image_size(file) == (3, 2)
    length = struct.unpack_from(">I", content, 33)[0]
    rows = zlib.decompress(content[41 : 41 + length])
    assert rows == b"\0" + b"\xff" * 9 + b"\0" + bytes(9)


# The report


def row(**degrees):
    figures = {name: [0.1, 0.2, 3.0] for name in engine_report.LABELS}
    figures |= {name: [0.0, 0.1, value] for name, value in degrees.items()}
    return {"sample": "spot_1", "engine": "three", "label": "three.js", "basis": "NORMALIZED", "degrees": figures}


def test_a_run_fails_that_does_not_show_the_own_basis_best():
    assert engine_report.failures({"rows": [row(NORMALIZED=0.6)], "cases": []}) == []
    assert "off by 1.10 degrees" in engine_report.failures({"rows": [row(NORMALIZED=1.1)], "cases": []})[0]
    (text,) = engine_report.failures({"rows": [row(NORMALIZED=0.6, CYCLES=0.6)], "cases": []})
    assert text == "spot_1 in three.js: the map for Cycles is as good, 0.60 degrees"


RUN = {"chromium": "Chromium 1", "packages": {"three": "0.1"}, "map": 8, "view": 4}
CASE = {"case": "N-gons", "label": "three.js", "tangents": True, "normal": 0.25, "color": 0.003}
PAGE = "before\n<!-- engines -->\nold\n<!-- end -->\n<!-- made files -->\nolder\n<!-- end -->\nafter\n"


def test_the_tables_stand_between_their_comments():
    run = {**RUN, "rows": [row(NORMALIZED=0.6)], "cases": [CASE, CASE | {"label": "Babylon.js", "normal": 0.5}]}
    filled = engine_report.fill(PAGE, run)
    assert "| spot | three.js | 3.00 | 3.00 | 3.00 | **0.60** | 3.00 | 3.00 |" in filled
    assert "| File | three.js | Babylon.js |" in filled
    assert "| N-gons | 0.25 | 0.50 |" in filled
    assert "loaded: 2 of 2. Largest differences at the 99th percentile: of base colors 0.003" in filled
    assert "old" not in filled
    assert filled.startswith("before\n<!-- engines -->\n")
    assert filled.endswith("<!-- end -->\nafter\n")
    assert engine_report.fill(filled, run) == filled
    with pytest.raises(LookupError):
        engine_report.fill(PAGE.replace("made files", "other"), run)


def test_a_table_without_rows_stays():
    filled = engine_report.fill(PAGE, {**RUN, "rows": [], "cases": [CASE]})
    assert "old\n" in filled
    assert "older" not in filled


def test_the_page_of_a_run_has_both_tables_and_what_failed():
    run = {**RUN, "rows": [row(NORMALIZED=1.6) | {"compared": 1, "pixels": 2}], "decoded": {}, "cases": [CASE]}
    shown = engine_report.page(run, {("spot_1", "three"): ["a.png"]})
    assert "<td><b>1.60</b></td>" in shown
    assert "<td>N-gons</td><td>0.25</td>" in shown
    assert "off by 1.60 degrees" in shown
    assert '<img src="a.png">' in shown


def test_the_manual_has_places_for_the_tables():
    found = engine_report.PLACE.findall((ROOT / "docs" / "engines.md").read_text(encoding="utf-8"))
    assert [name for _, name, _ in found] == ["engines", "made files"]


# The browser


def test_the_server_gives_what_is_below_its_folders_alone(tmp_path):
    (tmp_path / "modules").mkdir()
    (tmp_path / "secret").write_text("x")
    (tmp_path / "modules" / "a.js").write_text("y")
    model = chromium.Model("m", b"glb")
    with chromium.Server(tmp_path / "modules", {"size": 1}, [model], lambda *_: None) as server:
        assert server.found("/npm/a.js") == (b"y", "text/javascript")
        assert server.found("/npm/../secret") is None
        assert server.found("/glb/m.glb")[0] == b"glb"
        assert b"importmap" in server.found("/")[0]
        assert server.found("/glb/other.glb") is None
        assert server.found("/other") is None


def test_the_server_keeps_what_the_page_posts(tmp_path):
    kept = []
    with chromium.Server(tmp_path, {"size": 1}, [], lambda *what: kept.append(what)) as server:
        server.take("/result/two%20words/1/color", np.float32([1, 2, 3, 4]).tobytes())
        server.take("/tangents/two%20words", b"[null, [1, 0, 0, -1]]")
        assert not server.ended.is_set()
        server.take("/failed", b"why")
        assert server.ended.is_set()
    ((name, view, output, pixels),) = kept
    assert (name, view, output, pixels.tolist()) == ("two words", 1, "color", [[[1.0, 2.0, 3.0, 4.0]]])
    assert server.tangents == {"two words": [None, [1, 0, 0, -1]]}
    assert server.failure == "why"


def test_an_installed_package_of_another_version_is_no_package(tmp_path):
    assert chromium.installed_version(tmp_path, "three") is None
    (tmp_path / "three").mkdir()
    (tmp_path / "three" / "package.json").write_text('{"version": "0.1.0"}')
    assert chromium.installed_version(tmp_path, "three") == "0.1.0"


def test_without_a_chromium_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setattr(chromium.shutil, "which", lambda _: None)
    with pytest.raises(chromium.NoEngine, match="apt-get install chromium"):
        chromium.find_chromium()
