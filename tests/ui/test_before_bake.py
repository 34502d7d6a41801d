# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel says before a bake for another program, and the buttons that fix it."""

import re

import bpy
import numpy as np
import pytest

from addon.cli.arguments import parser
from addon.core.errors import Fix, in_window
from addon.core.settings import Settings
from addon.jobs import bake_jobs, fixes, pair_checks
from addon.ui import bake_panel
from addon.ui.bake_results import results
from addon.ui.callbacks import events
from addon.ui.findings import findings
from addon.ui.fix_buttons import FIXES
from addon.ui.properties import Chosen
from tests.support import panel_layout, zoo
from tests.support.panel import use
from tests.support.panel_layout import draw

pytestmark = pytest.mark.usefixtures("registered")


def set_up(low, *, green="-Y"):
    """`low` in the slot with a high object, for a program that is not Blender."""
    return use(low, zoo.terrain("high", 12), size=32, green=green)


def found(low, **settings):
    bpy.context.view_layer.update()
    given = Settings(**{"green": "-Y"} | settings)
    return {one.kind: one for one in pair_checks.viewport_findings(bpy.context, low, given, is_own_base=False)}


def fix(kind):
    assert bpy.ops.imprint.fix(kind=kind) == {"FINISHED"}


def with_second_layer(low):
    low.data.uv_layers.new(name="Second")
    low.data.uv_layers.active = low.data.uv_layers["Second"]
    bpy.context.scene.imprint.uv_layer = zoo.LAYER


def curved():
    return zoo.terrain("lo", 4, waves=1)


def faceted():
    return zoo.terrain("lo", 4, waves=1, smooth=False)


def own_normals():
    normals = np.random.default_rng(7).normal(size=(16, 4, 3)) * 0.2 + (0, 0, 1)
    return zoo.terrain("lo", 4, normals=normals / np.linalg.norm(normals, axis=2, keepdims=True))


# What is found


def test_quads_whose_diagonal_matters_are_found():
    assert found(curved())["POLYGONS"].values["count"] == 16
    assert found(zoo.plane("flat", 4)) == {}
    assert found(zoo.cube("cube")) == {}
    bent = zoo.plane("bent", 1)
    bent.data.uv_layers[0].uv[2].vector = (0.7, 1.0)
    assert set(found(bent)) == {"POLYGONS"}


def test_quads_whose_normals_do_not_continue_evenly_are_found():
    normals = np.zeros((1, 4, 3)) + (0, 0, 1)
    assert found(zoo.plane("even", 1, normals=normals)) == {}
    normals[0, 2] = (0.6, 0, 0.8)
    assert set(found(zoo.plane("uneven", 1, normals=normals))) == {"POLYGONS"}


def test_n_gons_are_always_found():
    assert "no tangents" in found(zoo.disc())["POLYGONS"].sentence


def test_hard_edges_inside_islands_are_found():
    assert found(faceted())["HARD_EDGES"].values["count"] == 24
    assert "HARD_EDGES" not in found(zoo.cube("cube"))


def test_mirrored_copies_are_found_and_harmless():
    low = zoo.mirrored()
    assert not found(low)["MIRRORED"].harms
    assert found(low)["MIRRORED"].values["count"] == 128
    assert "MIRRORED" not in found(low, udim=True)
    for polygon in low.data.polygons[:64]:  # without their twins, nothing is read twice
        for corner in polygon.loop_indices:
            low.data.uv_layers[0].uv[corner].vector.x += 3.0
    assert "MIRRORED" not in found(low)


@pytest.mark.parametrize(
    ("settings", "asks"),
    [
        ({}, False),
        ({"green": "-Y"}, True),
        ({"green": "-Y", "space": "OBJECT"}, False),
        ({"green": "-Y", "normal": False, "maps": ("AO",)}, False),
        ({"basis": "CYCLES", "storage": "FILE"}, False),
        ({"basis": "MIKKTSPACE"}, False),
        ({"basis": "MIKKTSPACE", "storage": "FILE"}, True),
        ({"basis": "AUTO", "storage": "FILE"}, False),
        ({"basis": "MIKKTSPACE_VERTEX"}, True),
        ({"basis": "NORMALIZED"}, True),
        ({"targets": ("cycles", "eevee")}, False),
        ({"targets": ("cycles", "unreal")}, True),
        ({"targets": ("unreal",), "space": "WORLD"}, False),
    ],
)
def test_only_maps_for_other_programs_are_asked_about(settings, asks):
    assert pair_checks.is_for_others(Settings(**settings), is_exported=False) is asks
    in_tangent_space = settings.get("space", "TANGENT") == "TANGENT" and settings.get("normal", True)
    assert pair_checks.is_for_others(Settings(**settings), is_exported=True) is in_tangent_space


# The panel


def test_the_panel_says_what_is_found_with_a_button_each():
    set_up(faceted())
    drawn = panel_layout.draw(width=2000)
    assert "'lo' has 16 quads" in drawn.text
    assert "'lo' has 24 hard edges" in drawn.text
    assert [name for name, _ in drawn.buttons].count("imprint.fix") == 2


def test_the_panel_says_nothing_where_blender_reads_the_map():
    settings = set_up(faceted(), green="+Y")
    assert "imprint.fix" not in [name for name, _ in panel_layout.draw().buttons]
    settings.export = "//out.glb"  # Imprint's file has the triangles and tangents of the bake
    drawn = panel_layout.draw(width=2000)
    assert "hard edges" in drawn.text
    assert "quads" not in drawn.text


def test_a_mesh_is_looked_at_once_until_it_changes():
    low = curved()
    settings = set_up(low)
    panel_layout.draw()
    before = findings.looks
    for _ in range(5):
        panel_layout.draw()
    settings.samples = "4"
    bpy.data.objects["high"].data.update_tag()
    low.location.x += 0.1
    bpy.context.view_layer.update()
    panel_layout.draw()
    assert findings.looks == before
    low.data.polygons.foreach_set("use_smooth", np.zeros(16, bool))
    low.data.update_tag()
    assert "24 hard edges" in panel_layout.draw(width=2000).text
    assert findings.looks == before + 1
    for what in ("undo_post", "redo_post", "end"):
        events.tell(what)
        panel_layout.draw()
    assert findings.looks == before + 4
    low.modifiers.new("Triangulate", "TRIANGULATE")
    assert "quads" not in panel_layout.draw(width=2000).text


# The fixes


@pytest.mark.parametrize("make", [curved, zoo.disc, zoo.sphere])
def test_triangulated_faces_are_as_blender_draws_them(make):
    low = make()
    set_up(low)
    low.data.calc_loop_triangles()
    drawn = {frozenset(triangle.vertices) for triangle in low.data.loop_triangles}
    fix("POLYGONS")
    assert "POLYGONS" not in found(low)
    data = low.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert {frozenset(polygon.vertices) for polygon in data.polygons} == drawn


def test_the_layer_of_the_map_becomes_the_active_one():
    low = zoo.plane("lo", 2)
    set_up(low)
    with_second_layer(low)
    assert set(found(low, uv_layer=zoo.LAYER)) == {"LAYER"}
    assert found(low) == {}  # without a name, the map is for the active one
    fix("LAYER")
    assert low.data.uv_layers.active.name == zoo.LAYER
    assert found(low, uv_layer=zoo.LAYER) == {}


@pytest.mark.parametrize("make", [faceted, own_normals])
def test_edges_inside_islands_become_smooth(make):
    low = make()
    set_up(low)
    fix("HARD_EDGES")
    assert "HARD_EDGES" not in found(low)


def test_hard_edges_at_borders_of_islands_and_other_normals_stay():
    points = np.array([(x, y, z) for x, z in ((0, 0), (1, 0), (2, 1), (3, 1)) for y in (0, 1)])
    faces = [(2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1) for i in range(3)]
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    uv = [(corners + (0, 0)) * (0.3, 1), (corners + (1, 0)) * (0.3, 1), (corners * (0.3, 1) + (0.65, 0))]
    low = zoo.build("lo", points, faces, uv, smooth=False)
    set_up(low)
    low.data.update()
    before = np.array([tuple(one.vector) for one in low.data.corner_normals])
    assert found(low)["HARD_EDGES"].values["count"] == 1
    fix("HARD_EDGES")
    after = np.array([tuple(one.vector) for one in low.data.corner_normals])
    np.testing.assert_allclose(after[[0, 3, 5, 6, 8, 9, 10, 11]], before[[0, 3, 5, 6, 8, 9, 10, 11]], atol=1e-6)
    np.testing.assert_allclose(after[1], after[4], atol=1e-6)


def test_mirrored_copies_read_the_same_texels_after_they_are_moved():
    low = zoo.mirrored()
    set_up(low)
    before = np.array([tuple(corner.vector) for corner in low.data.uv_layers[0].uv])
    fix("MIRRORED")
    after = np.array([tuple(corner.vector) for corner in low.data.uv_layers[0].uv])
    np.testing.assert_array_equal(after[:256], before[:256])
    np.testing.assert_allclose(after[256:], before[256:] + (1, 0), atol=1e-6)
    assert "MIRRORED" not in found(low)


def test_a_mirror_modifier_moves_its_own_copies():
    low = zoo.plane("lo", 2)
    for vertex in low.data.vertices:
        vertex.co.x += 1.0
    low.modifiers.new("Mirror", "MIRROR")
    set_up(low)
    assert found(low)["MIRRORED"].values["count"] == 8
    fix("MIRRORED")
    assert "MIRRORED" not in found(low)


@pytest.mark.parametrize(
    ("make", "kind"),
    [(curved, "POLYGONS"), (faceted, "HARD_EDGES"), (own_normals, "HARD_EDGES"), (zoo.mirrored, "MIRRORED")],
)
def test_undo_takes_a_fix_back(make, kind):
    low = make()
    name = low.name
    set_up(low)
    bpy.ops.ed.undo_push(message="before")
    assert kind in found(low)
    bpy.ops.imprint.fix("EXEC_DEFAULT", True, kind=kind)
    assert kind not in found(bpy.data.objects[name])
    bpy.ops.ed.undo()
    assert kind in found(bpy.data.objects[name])


def test_the_panel_follows_undo():
    set_up(curved())
    bpy.ops.ed.undo_push(message="before")
    panel_layout.draw()
    before = findings.looks
    bpy.ops.imprint.fix("EXEC_DEFAULT", True, kind="POLYGONS")
    assert "quads" not in panel_layout.draw(width=2000).text
    bpy.ops.ed.undo()
    assert "quads" in panel_layout.draw(width=2000).text
    assert findings.looks == before + 2


def test_a_fix_that_is_not_possible_says_why():
    low = faceted()
    set_up(low)
    bpy.context.view_layer.objects.active = low
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="is not in Object Mode"):
        fix("HARD_EDGES")


# Bakes


def test_a_bake_warns_before_it_draws_and_in_its_report(gpu_context):
    low, high = faceted(), zoo.terrain("high", 12)
    given = Settings(green="-Y", width=32, height=32, method="FLATTEN", material=False)
    steps, warned = [], []

    def note(step):
        steps.append(step.what)
        warned.extend((len(steps), warning) for warning in step.warnings)

    (report,) = bake_jobs.bake_all(bpy.context, [bake_jobs.Job(low, [high])], given, on_progress=note)
    said = [warning for _, warning in warned]
    assert [warning.split(".")[0] for warning in said] == [
        "'lo' has 24 hard edges without a UV seam",  # it is wrong; the others may be
        "'lo' has 16 quads that look different if another program divides them along the other diagonal",
    ]
    assert warned[-1][0] < len(steps)
    assert [report.warnings.count(warning) for warning in said] == [1, 1]
    (report,) = bake_jobs.bake_all(bpy.context, [bake_jobs.Job(low, [high])], Settings(width=32, height=32))
    assert not any("quads" in warning for warning in report.warnings)


def test_the_button_warns_as_the_panel_does(gpu_context):
    settings = set_up(faceted())
    settings.method = "FLATTEN"
    for export, has_quads in (("", True), ("//out.glb", False)):
        settings.export = export
        bpy.ops.imprint.bake()
        (report,) = results.all_of(bpy.context, settings.low)
        assert any("quads" in warning for warning in report.warnings) is has_quads


# Fixes


def set_up_fixes(low, *highs, **values):
    """`low` in the slot with high objects, and a small map."""
    settings = use(low, *highs, size=64, **values)
    bpy.context.view_layer.update()
    return settings


def flipped(obj):
    obj.data.flip_normals()
    return obj


def drawn_fixes():
    """The text of the main panel, and the kinds of its buttons."""
    drawn = panel_layout.draw(width=3000)
    return drawn.text, panel_layout.fixes(drawn)


def test_a_low_object_without_uvs_has_a_button_that_unwraps_it():
    low, high = zoo.terrain("lo", 4, waves=1), zoo.terrain("high", 12)
    low.data.uv_layers.remove(low.data.uv_layers[0])
    set_up_fixes(low, high)
    text, kinds = drawn_fixes()
    assert "'lo' has no UV layer: unwrap it first." in text
    assert kinds == [fixes.UNWRAP]
    assert bpy.ops.imprint.unwrap() == {"FINISHED"}
    assert len(low.data.uv_layers) == 1
    assert drawn_fixes()[1] == []


def test_a_high_object_without_uvs_has_no_such_button():
    low, high = zoo.terrain("lo", 4, waves=1), zoo.terrain("high", 12)
    high.data.uv_layers.remove(high.data.uv_layers[0])
    set_up_fixes(low, high, method="FLATTEN")
    text, kinds = drawn_fixes()
    assert "'high' has no UV layer" in text
    assert fixes.UNWRAP not in kinds


# Options and buttons


@pytest.mark.parametrize("kind", Fix.__members__)
def test_each_fix_is_an_option_of_the_shell_and_a_button(kind):
    fix, settings = Fix[kind], bpy.context.scene.imprint
    words = re.findall(r"--([a-z-]+)", fix.in_shell)
    known = set(re.findall(r"^ +(?:-\w, )?--([a-z-]+)", parser("imprint").format_help(), re.MULTILINE))
    assert words
    assert set(words) <= known
    assert kind in FIXES
    assert settings.bl_rna.properties[fix.setting]
    assert in_window(Fix[kind].after("Something is wrong.")) == ("Something is wrong.", kind)


@pytest.mark.parametrize("kind", Fix.__members__)
def test_a_button_sets_its_setting(kind):
    fix = Fix[kind]
    others = {
        "method": "FLATTEN",
        "hit": "OUTERMOST",
        "measure": False,
        "depth": "16",
        "samples": "1",
        "material": True,
        "compression": "AUTO",
    }
    settings = set_up_fixes(zoo.plane("lo"), zoo.terrain("hi", 8))
    setattr(settings, fix.setting, others.get(fix.setting, False))
    assert bpy.ops.imprint.fix(kind=kind) == {"FINISHED"}
    assert getattr(settings, fix.setting) == fix.new_value


def test_a_warning_of_a_bake_is_a_sentence_and_a_button(gpu_context):
    low, high = zoo.plane("lo"), zoo.terrain("hi", 24)
    settings = set_up_fixes(low, high, method="CAST", measure=False, extrusion=0.01, max_distance=0.02, material=False)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    (warning,) = results.of(bpy.context, low).warnings
    assert "--extrusion" in warning
    text, kinds = drawn_fixes()
    assert "hit nothing within the extrusion" in text
    assert "--" not in text
    assert kinds == [Fix.MEASURE.name] * 2  # in the box below the button, and in the report
    bpy.ops.imprint.fix(kind=kinds[0])
    assert settings.chosen(bpy.context, low).rays.measure
    assert not settings.measure  # that of other low objects
    bpy.ops.imprint.bake()
    assert results.of(bpy.context, low).warnings == []


def test_a_linked_low_object_is_named_before_the_bake_with_a_button(tmp_path, gpu_context):
    path = str(tmp_path / "lo.blend")
    bpy.data.libraries.write(path, {zoo.plane("lo")})
    bpy.data.objects.remove(bpy.data.objects["lo"])
    with bpy.data.libraries.load(path, link=True) as (_, loaded):
        loaded.objects = ["lo"]
    bpy.context.scene.collection.objects.link(loaded.objects[0])
    low, high = loaded.objects[0], zoo.terrain("hi", 8)
    settings = set_up_fixes(low, high)
    problem = bake_panel.bake_problem(bpy.context, Chosen(settings, low, [high]))
    assert problem.endswith("make it local first; --no-material leaves them as they are.")
    text, kinds = drawn_fixes()
    assert "make it local first." in text
    assert "--" not in text
    assert kinds == [Fix.NO_MATERIAL.name]
    with pytest.raises(RuntimeError, match=r"make it local first\.\n?$"):
        bpy.ops.imprint.bake()
    bpy.ops.imprint.fix(kind=Fix.NO_MATERIAL.name)
    assert not settings.material
    assert bake_panel.bake_problem(bpy.context, Chosen(settings, low, [high])) == ""
    settings.connect_maps = True  # the same is checked for other maps
    # Without the setting Material it would be an error, too.
    assert bake_panel.bake_problem(bpy.context, Chosen(settings, low, [high])).endswith("make it local first.")
    settings.connect_maps, settings.one_material = False, True
    assert "cannot get one material" in bake_panel.bake_problem(bpy.context, Chosen(settings, low, [high]))


# Flipped meshes


PAIRS = {
    "planes": lambda: (zoo.plane("lo"), zoo.terrain("hi", 24)),
    "cubes": lambda: (zoo.cube("lo"), zoo.cube("hi")),
    "balls with normals of their own": lambda: (zoo.sphere("lo", 6), zoo.sphere("hi", 24)),
    "side by side": lambda: beside(zoo.cube("lo"), zoo.cube("hi")),
    "mirrored objects": lambda: mirrored(zoo.plane("lo"), zoo.terrain("hi", 24)),
    "one of them mirrored": lambda: (zoo.plane("lo"), mirrored(zoo.terrain("hi", 24))[0]),
    "an object without faces": lambda: (zoo.plane("lo"), zoo.build("hi", [(0, 0, 0)], np.empty((0, 3), int))),
}


def beside(low, high):
    high.location.x = 5.0
    return low, high


def mirrored(*objects):
    for obj in objects:
        obj.scale.x = -1.0
    return objects


@pytest.mark.parametrize("name", PAIRS)
def test_faces_to_the_same_side_are_no_finding(name):
    low, high = PAIRS[name]()
    set_up_fixes(low, high)
    assert "FLIPPED" not in drawn_fixes()[1]


@pytest.mark.parametrize("name", [name for name in PAIRS if "without" not in name])
def test_a_flipped_low_object_is_found_before_the_bake_and_fixed_by_a_button(name):
    low, high = PAIRS[name]()
    set_up_fixes(flipped(low), high)
    text, kinds = drawn_fixes()
    assert "The faces of 'lo' point to the other side than those of 'hi'" in text
    assert kinds == ["FLIPPED"]
    normals = np.array([polygon.normal[:] for polygon in low.data.polygons])
    corners = np.array([corner.vector[:] for corner in low.data.corner_normals])
    assert bpy.ops.imprint.fix(kind="FLIPPED") == {"FINISHED"}
    np.testing.assert_allclose([polygon.normal[:] for polygon in low.data.polygons], -normals, atol=1e-6)
    after = np.array([corner.vector[:] for corner in low.data.corner_normals])
    assert np.sort(after, axis=0) + np.sort(corners, axis=0)[::-1] == pytest.approx(0.0, abs=1e-5)
    bpy.context.view_layer.update()
    assert drawn_fixes()[1] == []


def test_a_flipped_closed_high_object_is_the_one_that_is_flipped():
    low, high = zoo.cube("lo"), flipped(zoo.cube("hi"))
    set_up_fixes(low, high)
    assert drawn_fixes()[1] == []  # the bake turns them over
    bpy.context.scene.imprint.keep_faces = True
    assert "The faces of 'hi' point to the other side than those of 'lo'" in drawn_fixes()[0]
    before = [polygon.normal[:] for polygon in low.data.polygons]
    bpy.ops.imprint.fix(kind="FLIPPED")
    assert [polygon.normal[:] for polygon in low.data.polygons] == before
    bpy.context.view_layer.update()
    assert drawn_fixes()[1] == []
    with pytest.raises(RuntimeError, match="point to the same sides"):
        bpy.ops.imprint.fix(kind="FLIPPED")


def test_the_panel_looks_again_when_an_object_turns():
    low, high = zoo.plane("lo"), zoo.terrain("hi", 12)
    set_up_fixes(low, high)
    assert drawn_fixes()[1] == []
    low.rotation_euler.y = np.pi
    bpy.context.view_layer.update()
    assert drawn_fixes()[1] == ["FLIPPED"]
    low.rotation_euler.y = 0.0
    high.data.flip_normals()
    high.data.update()
    bpy.context.view_layer.update()
    assert drawn_fixes()[1] == ["FLIPPED"]


def test_materials_that_cannot_be_followed_are_named_before_the_bake():
    low, high = zoo.plane("lo"), zoo.plane("hi", 2)
    material = bpy.data.materials.new("rust")
    high.data.materials.append(material)
    settings = use(low, high, size=16, method="CAST", maps={"BASE_COLOR"})
    text = 'Material "rust": Base Color is left out'
    assert text not in draw().text
    tree = material.node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    shader = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")
    tree.links.new(noise.outputs["Color"], shader.inputs["Base Color"])
    assert text not in draw().text  # Cycles evaluates it
    settings.exact_materials = "OFF"
    assert text in draw().text
    settings.maps = {"ROUGHNESS"}
    assert text not in draw().text
    settings.maps = {"BASE_COLOR"}
    assert text in draw().text
    tree.nodes.remove(noise)
    assert text not in draw().text


def test_sheets_with_two_sides_are_no_finding():
    up, down = zoo.plane("lo", 4), flipped(zoo.plane("down", 4))
    with bpy.context.temp_override(active_object=up, selected_editable_objects=[up, down]):
        bpy.ops.object.join()
    set_up_fixes(up, zoo.terrain("hi", 12))
    assert drawn_fixes()[1] == []


def test_a_shell_says_it_before_the_bake(gpu_context):
    steps = []
    low, high = flipped(zoo.plane("lo")), zoo.terrain("hi", 24)
    settings = set_up_fixes(low, high, material=False).to_settings()
    (report,) = bake_jobs.bake_all(bpy.context, [bake_jobs.Job(low, [high])], settings, on_progress=steps.append)
    early = [warning for step in steps for warning in step.warnings]
    assert early == report.warnings
    assert len(early) == 1
