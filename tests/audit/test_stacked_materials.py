# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces that share texels and have different materials: maps of materials show one of them, and a warning says so.

Three squares side by side: the second and the third have the same UVs, the right half of the map.
"""

import bpy
import numpy as np
import pytest

from addon.core.errors import Fix, in_window
from addon.core.settings import Settings
from addon.jobs import Job, bake_all
from tests.support import maps, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 32
START = "50.0% of the texels of 'tree' belong to faces of different materials ("
COLORS = {"bark": (0.2, 0.1, 0.0), "leaf": (0.0, 0.5, 0.0)}


def squares(name, materials=()):
    """Three squares in z = 0, from x = -3 to 3, of these materials."""
    points = [(x, y, 0.0) for x in (-3, -1, -1, 1, 1, 3) for y in (-1, 1)]
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * (0.5, 1.0)
    uv = [corner, corner + (0.5, 0.0), corner + (0.5, 0.0)]
    obj = zoo.build(name, points, [(4 * i, 4 * i + 2, 4 * i + 3, 4 * i + 1) for i in range(3)], uv)
    for number, material in enumerate(dict.fromkeys(materials)):
        obj.data.materials.append(material)
        for face, of_face in zip(obj.data.polygons, materials, strict=True):
            if of_face == material:
                face.material_index = number
    return obj


def material(name, *, roughness=0.5):
    made = bpy.data.materials.new(name)
    inputs = made.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*COLORS[name.split(".")[0]], 1.0)
    inputs["Roughness"].default_value = roughness
    return made


def warned(low, high, *, names=("BASE_COLOR",), **settings):
    """The warnings about shared texels, and the check."""
    report, _ = maps.bake_all_maps(low, high, maps=names, size=SIDE, **settings)
    told = [text for text in report.warnings if "share" in text or "belong to" in text]
    return told, report.checks["overlap"]


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
@pytest.mark.parametrize("space", ["TANGENT", "OBJECT"])
def test_two_materials_on_half_of_the_texels_are_told(method, space):
    bark, leaf = material("bark"), material("leaf")
    low, high = squares("tree"), squares("high", (bark, bark, leaf))
    (text,), check = warned(low, high, method=method, space=space)
    assert text == START + "'bark', 'leaf'), and the maps show one of them: Unwrap gives each face a place of its own."
    assert check["other_material"] == pytest.approx(0.5)
    assert check["materials"] == 2
    assert check["severity"] == "WRONG"


def test_texture_sets_cure_it_where_the_low_object_has_these_materials():
    pair = material("bark"), material("leaf")
    low, high = (squares(name, (pair[0], *pair)) for name in ("tree", "high"))
    (text,), _ = warned(low, high)
    assert text.startswith(START)
    assert in_window(text)[1] == Fix.TEXTURE_SETS.name
    settings = Settings(width=SIDE, height=SIDE, maps=("BASE_COLOR",), texture_sets=True, margin=0, material=False)
    reports = bake_all(bpy.context, [Job(low, [high])], settings)
    assert [report.checks["overlap"]["other_material"] for report in reports] == [0.0, 0.0]


def test_a_bake_of_an_object_onto_itself_tells_it():
    tree = squares("tree", (material("bark"), material("bark.001"), material("leaf")))
    (text,), _ = warned(tree, tree)
    assert text.startswith(START + "'bark.001', 'leaf')")


@pytest.mark.parametrize(
    ("names", "is_told"),
    [(("BASE_COLOR",), False), (("ROUGHNESS",), True), (("WIDENED_ROUGHNESS",), True), (("MATERIAL_ID",), True),
     (("AO", "OBJECT_ID"), False), ((), False)],
)  # fmt: skip
def test_materials_that_look_alike_on_the_maps_are_one(names, is_told):
    first, second = material("leaf"), material("leaf.001", roughness=0.9)
    low, high = squares("tree"), squares("high", (first, first, second))
    told, check = warned(low, high, names=names, rays=16)
    assert [text.startswith(START) for text in told] == [True] * is_told
    assert check["other_material"] == pytest.approx(0.5 * is_told)
    assert check["severity"] == ("WRONG" if is_told else "LOOK")


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_mirrored_halves_of_one_material_are_right_input(method):
    low, high = zoo.mirrored("low"), zoo.mirrored("high", 24)
    high.data.materials.append(material("leaf"))
    told, check = warned(low, high, names=("BASE_COLOR", "ROUGHNESS"), method=method)
    assert not told
    assert (check["other_material"], check["materials"]) == (0.0, 0)


def test_materials_side_by_side_are_right_input():
    low, high = squares("tree"), squares("high", (material("bark"), material("leaf"), material("leaf.001")))
    told, check = warned(low, high)
    assert not told
    assert check["stacked"] > 0


def test_faces_without_a_material_count_as_one():
    leaf = material("leaf")
    low, high = squares("tree"), squares("high", (leaf, leaf, None))
    (text,), _ = warned(low, high)
    assert text.startswith(START + "'leaf', 'none')")
