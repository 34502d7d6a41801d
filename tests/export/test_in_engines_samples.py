# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what bakes and compares the meshes of scripts/dev/engines.py, without engines: in closed form."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core.declarations import bases
from scripts.dev.in_engines import chromium, comparing, drawing, made_cases, samples, wavy_sheet
from scripts.dev.in_engines.comparing import BARE, NO_TANGENTS, OBJECT
from scripts.dev.in_engines.glb_file import Surface
from scripts.dev.in_engines.samples import Sample
from tests.support import zoo

SIZE = 32
FILTERED = 1e-6
"""Degrees that single precision costs here."""
EIGHT_BITS = 0.35
"""Degrees that 8 bits cost at the 99th percentile."""
PLACES = np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]], np.float64)
LEAN = np.array((0.6, 0.0, 0.8))


def square(*, baked=None, signs=(1.0, 1.0), normal_matrix=None):
    """The square 0..1 towards +Z, as large as its UVs, with maps of one normal that leans along u."""
    position = np.concatenate([PLACES, np.zeros((2, 3, 1))], axis=-1)
    tangent = np.tile((1.0, 0.0, 0.0, 1.0), (2, 3, 1))
    tangent[..., 3] = np.array(signs)[:, None]
    normal = np.tile((0.0, 0.0, 1.0), (2, 3, 1))
    surface = Surface(position, normal, tangent, PLACES * (1, -1) + (0, 1))
    texels = np.tile(LEAN, (SIZE, SIZE, 1))
    return Sample(
        "square",
        {},
        surface,
        np.eye(3) if normal_matrix is None else normal_matrix,
        drawing.lay_out(PLACES, SIZE),
        np.ones((SIZE, SIZE), bool) if baked is None else baked,
        texels,
        {name: texels.copy() for name in bases.BY_NAME},
    )


# Samples


def test_a_flat_map_decodes_to_the_object_space_map():
    found = square().decoded_degrees()
    assert found.keys() == bases.BY_NAME.keys()
    assert max(found.values()) < FILTERED


def test_a_map_that_leans_otherwise_is_off_by_the_angle_where_it_is_baked():
    turned = np.array((np.sin(0.1), 0.0, np.cos(0.1)))
    sample = square()
    sample.maps["CYCLES"] = np.tile((0.0, 0.0, 1.0), (SIZE, SIZE, 1))
    found = replace(sample, object_map=np.tile(turned, (SIZE, SIZE, 1))).decoded_degrees()
    assert found["CYCLES"] == pytest.approx(np.degrees(0.1))
    baked = np.zeros((SIZE, SIZE), bool)
    baked[3, 4] = True
    sample.maps["CYCLES"][3, 4] = LEAN
    assert replace(sample, baked=baked).decoded_degrees()["CYCLES"] < FILTERED


def test_an_object_space_map_is_turned_into_world_space():
    quarter = np.array([(0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)])
    angle = np.degrees(np.arccos(LEAN @ (quarter @ LEAN)))
    assert square(normal_matrix=quarter).decoded_degrees()["NORMALIZED"] == pytest.approx(angle)


def test_uvs_point_up_and_maps_become_vectors():
    assert samples.with_v_up(np.array([(0.25, 0.25)])).tolist() == [[0.25, 0.75]]
    texels = np.float32([[(1.0, 0.5, 0.5, 1.0), (0.5, 0.5, 0.0, 0.0)]])
    assert samples.normals(texels).tolist() == [[[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]]


def test_a_sample_of_a_scene_is_what_a_baker_knows_of_it(gpu_context, tmp_path):
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=0.75)
    for obj in (low, high):
        obj.location, obj.scale = (1.0, 2.0, 3.0), (4.0, 4.0, 4.0)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "slope_1_2.blend"))
    sample = samples.make(tmp_path / "slope_1_2.blend", SIZE)
    assert sample.name == "slope_1_2"
    assert sample.files.keys() == sample.maps.keys() == bases.BY_NAME.keys()
    np.testing.assert_allclose(sample.surface.position.reshape(-1, 3).mean(axis=0), (1.0, 3.0, -2.0), atol=0.5)
    np.testing.assert_allclose(sample.object_map[SIZE // 2, SIZE // 2], (-0.6, 0.8, 0.0), atol=1e-6)  # Y is up
    np.testing.assert_allclose(sample.maps["CYCLES"][SIZE // 2, SIZE // 2], (-0.6, 0.0, 0.8), atol=1e-6)
    np.testing.assert_allclose(sample.normal_matrix, np.diag((0.25, 0.25, 0.25)), atol=1e-6)
    assert np.count_nonzero(~sample.baked) == SIZE  # both triangles have the texels on the diagonal
    assert max(sample.decoded_degrees().values()) < 1e-3
    assert not any("doubleSided" in one for glb in sample.files.values() for one in glb.document["materials"])
    setting = comparing.set_up(sample, SIZE)
    models = {model.name: model for model in comparing.models(sample, setting, "three")}
    assert models.keys() == {*bases.BY_NAME, BARE, OBJECT, NO_TANGENTS}
    assert [name for name, model in models.items() if model.kind == "object"] == [OBJECT]


# Comparing


def test_an_eye_sees_the_normals_of_the_mesh_from_before():
    before, behind = comparing.set_up(square(), SIZE).views
    assert before.drawn.there.any()
    assert not behind.drawn.there.any()
    assert (before.normals[before.drawn.there] == (0.0, 0.0, 1.0)).all()
    assert not before.normals[~before.drawn.there].any()


@pytest.mark.parametrize(("signs", "share"), [((1.0, 1.0), 1.0), ((1.0, -1.0), 0.9)])
def test_pixels_away_from_seams_have_four_texels_of_their_own_sign(signs, share):
    sample = square(signs=signs)
    drawn = drawing.look_around(sample.surface.position, [(0.0, 0.0, 1.0)], 4 * SIZE).drawn[0]
    away = comparing.away_from_seams(sample, drawn)
    points = np.einsum("...cx,...c->...x", sample.surface.position[drawn.triangle], drawn.weights)
    inside = drawn.there & (np.abs(points[..., :2] - 0.5).max(axis=-1) < 0.5 - 1.0 / SIZE)
    assert away.sum() <= drawn.there.sum()
    if share == 1.0:
        assert away[inside].all()
        return
    from_diagonal = np.abs(points[..., 0] - points[..., 1])
    assert away[inside & (from_diagonal > 2.0 / SIZE)].all()
    assert not away[inside & (from_diagonal < 0.1 / SIZE)].any()


def test_a_texel_that_is_not_baked_takes_its_neighbors_along():
    baked = np.ones((SIZE, SIZE), bool)
    baked[10, 20] = False
    sample = square(baked=baked)
    drawn = drawing.look_around(sample.surface.position, [(0.0, 0.0, 1.0)], 4 * SIZE).drawn[0]
    points = np.einsum("...cx,...c->...x", sample.surface.position[drawn.triangle], drawn.weights)[..., :2] * SIZE
    inside = drawn.there & (np.abs(points - SIZE / 2.0).max(axis=-1) < SIZE / 2.0 - 1.0)
    near = np.abs(points - (20.5, 10.5)).max(axis=-1) < 1.0
    assert np.array_equal(comparing.away_from_seams(sample, drawn)[inside], ~near[inside])


def test_figures_are_angles_to_the_object_space_map_of_the_same_engine():
    setting = comparing.set_up(square(baked=np.arange(SIZE)[:, None] + np.zeros(SIZE) > 10), SIZE)
    found = {}
    for index, view in enumerate(setting.views):
        for number, name in enumerate((OBJECT, *bases.BY_NAME, NO_TANGENTS, BARE)):
            turn = np.radians(number)
            shown = np.where(view.drawn.there[..., None], (np.sin(turn), 0.0, np.cos(turn)), 0.0)
            found[name, index] = shown.astype(np.float32)
    found["CYCLES", 0][~setting.views[0].away] = (0.0, 1.0, 0.0)  # not compared
    figures = comparing.figures(found, setting)
    for number, name in enumerate((*bases.BY_NAME, NO_TANGENTS, BARE), 1):
        np.testing.assert_allclose(figures["degrees"][name], [number] * 3, atol=1e-3)
    np.testing.assert_allclose(figures["bare_to_file"], [len(bases.BY_NAME) + 2] * 3, atol=1e-3)
    assert figures["pixels"] == setting.views[0].drawn.there.sum()
    assert figures["compared"] == setting.views[0].away.sum()


def test_pictures_become_normals_and_object_space_is_turned_for_engines_without(monkeypatch):
    quarter = np.array([(0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)])
    sample = square(normal_matrix=quarter)
    setting = comparing.set_up(sample, SIZE)
    pixels = np.zeros((SIZE, SIZE, 4), np.float32)
    pixels[4, 5] = (1.0, 0.5, 0.5, 1.0)

    def render(_modules, _engine, models, *, views, size, keep):
        assert (models, views, size) == ([], 2, SIZE)
        keep("CYCLES", 0, chromium.NORMAL, pixels)
        keep(OBJECT, 0, chromium.NORMAL, pixels)

    monkeypatch.setattr(comparing, "models", lambda *_: [])
    monkeypatch.setattr(chromium, "render", render)
    for engine, wanted in (("three", (1.0, 0.0, 0.0)), ("khronos", (0.0, 1.0, 0.0))):
        found = comparing.run(sample, setting, None, engine, SIZE)
        assert found["CYCLES", 0][4, 5].tolist() == [1.0, 0.0, 0.0]
        np.testing.assert_allclose(found[OBJECT, 0][4, 5], wanted, atol=1e-7)
        assert np.count_nonzero(found[OBJECT, 0].any(axis=-1)) == 1


# Made files


def test_made_files_hold_what_they_are_named_for(gpu_context):
    cases = {case.name: case for case in made_cases.make_all("MIKKTSPACE")}
    documents = {name: case.glb.document for name, case in cases.items()}
    surfaces = {name: case.glb.surface() for name, case in cases.items()}
    assert all(map(wavy_sheet.follow_their_uv, surfaces.values()))
    parts = {name: len(document["meshes"][0]["primitives"]) for name, document in documents.items()}
    assert parts == dict.fromkeys(cases, 1) | dict.fromkeys(
        ("Two materials", "Texture sets with ORM", "Two UDIM tiles"), 2
    )
    images = {name: len(document["images"]) for name, document in documents.items()}
    assert images == dict.fromkeys(cases, 2) | {"Texture sets with ORM": 6, "Two UDIM tiles": 4}
    assert "TEXCOORD_1" in documents["Second UV layer"]["meshes"][0]["primitives"][0]["attributes"]
    assert set(surfaces["Mirrored halves"].tangent[..., 3].ravel()) == {1.0, -1.0}
    assert len(cases["Texture sets with ORM"].surfaces) == 2
    for name, case in cases.items():
        assert np.ptp(surfaces[name].position[..., :2], axis=(0, 1)) == pytest.approx(2.0)
        assert (chromium.SURFACE in case.outputs) is bool(case.surfaces)


def test_the_made_n_gons_are_hexagons():
    low = zoo.sheet(
        "low", lambda u, v: np.stack([2 * u - 1, 0 * u, 2 * v - 1], axis=1), made_cases.COLUMNS, made_cases.ROWS
    )
    made_cases._n_gons(low, None)
    counts = np.bincount([len(face.vertices) for face in low.data.polygons])
    assert dict(enumerate(counts.tolist())) == {0: 0, 1: 0, 2: 0, 3: 0, 4: 18, 5: 0, 6: 6}
