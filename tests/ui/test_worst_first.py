# SPDX-License-Identifier: GPL-3.0-or-later
"""The worst of what is wrong with a pair is the first sentence in the box below the button, and a right one has no sign."""

import json

import bpy
import numpy as np
import pytest

from addon.audit import severity
from addon.core.errors import UNWRAPS
from addon.core.sentences import LOOK, NOTE, WRONG
from addon.core.settings import Settings
from addon.jobs import fixes
from addon.ui import bake_panel, fix_buttons, results, results_panel, several
from addon.ui.findings import MOST_AT_ONCE, findings
from addon.ui.fix_buttons import ICONS, RIGHT, SIGNS, Told, grouped
from tests.scene.test_poses import pose
from tests.support import panel_layout, zoo
from tests.support.panel import refusal, select, use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SIZE = 64
PANEL = [bake_panel.IMPRINT_PT_bake]


def pair(low=None, high=None, **settings):
    """A pair of meshes that fit, in the slots of the panel."""
    low, high = low or zoo.plane("lo", 4), high or zoo.terrain("hi", 24, height=0.05)
    values = {"method": "CAST", "material": False, "mips": 0} | settings
    return low, high, use(low, high, size=SIZE, **values)


def triangulated(obj):
    obj.modifiers.new("Triangulate", "TRIANGULATE")
    return obj


def spread(obj, scale, shift=(0.0, 0.0), which=slice(None)):
    """Move UVs: those of the corners `which` become uv * scale + shift."""
    layer = obj.data.uv_layers[0].uv
    uv = np.empty(2 * len(layer), np.float32)
    layer.foreach_get("vector", uv)
    uv = uv.reshape(-1, 2)
    uv[which] = uv[which] * scale + shift
    layer.foreach_set("vector", uv.ravel())
    obj.data.update()
    return obj


def tiles(count=3):
    """Planes side by side, each on a UDIM tile of its own."""
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    points = np.concatenate([np.c_[corners + (number, 0), np.zeros(4)] for number in range(count)])
    faces = np.arange(4 * count).reshape(-1, 4)
    return zoo.build(
        "lo", points, faces, [corners * (0.9 - 0.1 * number) + (number + 0.05, 0.05) for number in range(count)]
    )


def stacked(*, is_same):
    """Two planes on the same UVs, or on UVs that cross each other."""
    low = spread(tiles(2), 1.0, (-1.0, 0.0), slice(4, 8))
    return spread(low, 9.0 / 8.0, (-0.05 / 8.0, -0.05 / 8.0), slice(4, 8)) if is_same else low


def fitted(low, high):
    """Bring a flat high object to where the low one is."""
    bpy.context.view_layer.update()
    least, most = several.boxes([low, high])
    size = (most[0] - least[0]) / (most[1] - least[1] + 1e-9)
    high.scale[0], high.scale[1] = size[:2]
    bpy.context.view_layer.update()
    least, _ = several.boxes([low, high])
    high.location[0], high.location[1] = (least[0] - least[1])[:2]
    bpy.context.view_layer.update()


def udim(**settings):
    low, high, panel = pair(tiles(), **settings)
    fitted(low, high)
    return low, high, panel


# Wrong before the bake


def cut_off():
    udim()
    return "4 of its triangles reach outside the UV tile 0 to 1"


def overlapping():
    low, high, _ = pair(stacked(is_same=False))
    fitted(low, high)
    return "belong to two or more of its triangles (overlapping UVs)"


def overlapping_with_n_gons():
    """N-gons may do harm in another program, and the overlap does."""
    low, other = zoo.disc("lo"), zoo.plane("more", 3)
    select(low, other)
    bpy.ops.object.join()
    pair(low, green="-Y")
    return "(overlapping UVs)"


def without_uvs():
    low, _, _ = pair()
    low.data.uv_layers.remove(low.data.uv_layers[0])
    return "'lo' has no UV layer"


def posed():
    low, high, panel = pair()
    pose(low)
    panel.low = low
    return "'lo' is posed by 'rig'"


def in_other_units():
    _, high, _ = pair(zoo.sphere("lo", 16), zoo.sphere("hi", 32))
    high.scale = (100.0, 100.0, 100.0)
    return "they seem to have different units"


def turned():
    low, high = zoo.sphere("lo", 16), zoo.sphere("hi", 32)
    for obj in (low, high):
        obj.scale = (1.0, 2.0, 0.5)
    pair(low, high)
    high.rotation_euler.x = np.pi / 2.0
    return "turned by 90 degrees"


def low_inside_out():
    low, high, _ = pair(zoo.sphere("lo", 16), zoo.sphere("hi", 32))
    low.data.flip_normals()
    return "point to the other side"


def high_inside_out():
    _, high, panel = pair(zoo.sphere("lo", 16), zoo.sphere("hi", 32))
    panel.keep_faces = True
    high.data.flip_normals()
    return "point to the other side"


def across_the_border():
    low, _, _ = pair()
    spread(low, 1.0, (0.4, 0.0))
    return "reach outside the UV tile"


def hard_edges():
    pair(zoo.terrain("lo", 4, waves=1, smooth=False), green="-Y")
    return "24 hard edges without a UV seam"


def another_layer():
    low, _, panel = pair(triangulated(zoo.plane("lo", 4)), green="-Y")
    low.data.uv_layers.new(name="Second")
    low.data.uv_layers.active = low.data.uv_layers["Second"]
    panel.uv_layer = zoo.LAYER
    return "but 'Second' is the active one"


def swapped():
    pair(zoo.plane("lo", 24), zoo.terrain("hi", 4, height=0.05))
    return "Are they swapped?"


def gone():
    _, high, _ = pair()
    bpy.data.objects.remove(high)
    return "'hi' is not in this file"


BEFORE = (
    *(cut_off, overlapping, without_uvs, posed, in_other_units, turned, low_inside_out, high_inside_out),
    *(across_the_border, hard_edges, another_layer, swapped, gone, overlapping_with_n_gons),
)

# Wrong after it


def holes():
    _, high, _ = pair()
    high.vertex_groups.new(name="some").add([one.index for one in high.data.vertices if one.co.x < 0.5], 1.0, "ADD")
    high.modifiers.new("Mask", "MASK").vertex_group = "some"
    return "of the rays from 'lo' hit nothing"


def too_short():
    pair(measure=False, extrusion=0.001, max_distance=0.002)
    return "hit nothing within the extrusion and the maximum distance"


def elsewhere():
    _, high, _ = pair()
    high.location.z = 0.5
    return "differ in place or size"


def flat():
    pair(high=zoo.plane("hi", 8))
    return "The map is flat"


def two_materials():
    low, high, _ = pair(stacked(is_same=True), maps={"MATERIAL_ID"})
    fitted(low, high)
    for number in range(2):
        low.data.materials.append(bpy.data.materials.new(f"m{number}"))
        low.data.polygons[number].material_index = number
        high.data.materials.append(bpy.data.materials[f"m{number}"])
    middle = np.median([face.center.x for face in high.data.polygons])
    for face in high.data.polygons:
        face.material_index = int(face.center.x > middle)
    return "belong to faces of different materials"


def too_short_with_n_gons():
    pair(zoo.disc("lo"), green="-Y", measure=False, extrusion=0.001, max_distance=0.002)
    return "hit nothing within"


AFTER = (holes, too_short, elsewhere, flat, two_materials, too_short_with_n_gons)


def first_sign():
    """The first sentence with a sign in the main panel."""
    drawn = panel_layout.draw(width=4000, panels=PANEL)
    signed = [text for text, icon in zip(drawn.labels, drawn.icons, strict=True) if icon in SIGNS[:2] and " " in text]
    return (signed or [""])[0], drawn


def look():
    while findings.look() is not None:
        pass


@pytest.mark.parametrize("make", BEFORE, ids=[make.__name__ for make in BEFORE])
def test_what_is_wrong_before_the_bake_is_named_first(make):
    expected = make()
    first_sign()
    look()
    assert expected in first_sign()[0]


@pytest.mark.parametrize("make", AFTER, ids=[make.__name__ for make in AFTER])
def test_what_the_bake_has_found_is_named_first(make):
    expected = make()
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    look()
    text, _ = first_sign()
    assert expected in text
    assert bpy.context.window_manager.imprint_warnings.startswith(text)


# Right


def plain():
    pair()


def for_unreal():
    pair(triangulated(zoo.plane("lo", 4)), green="-Y")


def on_udim_tiles():
    udim(udim=True, storage="PACK")


def mirrored_parts():
    low = zoo.mirrored("lo")
    pair(low, zoo.mirrored("hi", 16, slope=0.1))


def moved_copies():
    low = spread(stacked(is_same=True), 1.0, (1.0, 0.0), slice(4, 8))
    _, high, _ = pair(low, zoo.terrain("hi", 24, height=0.003))
    fitted(low, high)


def same_parts():
    low = stacked(is_same=True)
    _, high, _ = pair(low, zoo.terrain("hi", 24, height=0.003))
    fitted(low, high)


def bricks():
    """Bricks before a plane: their rays meet two surfaces."""
    back, brick = zoo.plane("hi", 4), zoo.terrain("brick", 12, height=0.02)
    back.location.z = -0.05
    brick.scale = (0.8, 0.8, 1.0)
    low, _, panel = pair(high=back)
    panel.highs.add().object = brick


def rough(obj, strength=0.05):
    """An object with a modifier that makes its surface rough."""
    displace = obj.modifiers.new("Displace", "DISPLACE")
    displace.texture, displace.strength = bpy.data.textures.new("noise", "CLOUDS"), strength
    displace.texture.noise_scale = 0.3
    return obj


def closed():
    pair(zoo.sphere("lo", 24), rough(zoo.ball("hi", 48)))


def by_uvs():
    low, high, _ = pair(method="FLATTEN")
    high.location.x = 9.0


def several_highs():
    _, _, panel = pair()
    panel.highs.add().object = zoo.terrain("more", 12, height=0.04)


def own_modifiers():
    low = rough(zoo.plane("lo", 16))
    use(low, size=SIZE, material=False, mips=0)
    select(low)


def own_materials():
    low = zoo.plane("lo", 4)
    low.data.materials.append(bpy.data.materials.new("paint"))
    use(low, size=SIZE, normal=False, maps={"POSITION"}, mips=0)
    select(low)


def in_the_same_pose():
    low, high, panel = pair()
    pose(low)
    high.parent = low.parent
    panel.rest_pose = True


def with_a_cage():
    cage = zoo.plane("hull", 4)
    cage.location.z = 0.3
    _, _, panel = pair()
    panel.cage = cage


def in_object_space():
    pair(zoo.terrain("lo", 4, waves=1, smooth=False), space="OBJECT")


def hard_at_seams():
    pair(zoo.cube("lo"), zoo.cube("hi"), normal=False, maps={"POSITION"})


def small():
    low, high, _ = pair()
    for obj in (low, high):
        obj.scale = (0.001, 0.001, 0.001)


def far_away():
    low, high, _ = pair()
    for obj in (low, high):
        obj.location = (500.0, 20.0, 3.0)


def hidden_high():
    _, high, _ = pair()
    high.hide_set(True)


def second_layer():
    low, _, panel = pair()
    low.data.uv_layers.new(name="Second")
    panel.uv_layer = "Second"


RIGHTS = (
    *(
        plain,
        for_unreal,
        on_udim_tiles,
        mirrored_parts,
        moved_copies,
        same_parts,
        bricks,
        closed,
        by_uvs,
        several_highs,
    ),
    *(own_modifiers, own_materials, in_the_same_pose, with_a_cage, in_object_space, hard_at_seams, small, far_away),
    *(hidden_high, second_layer),
)


@pytest.mark.parametrize("make", RIGHTS, ids=[make.__name__ for make in RIGHTS])
def test_a_right_one_has_no_sign(make):
    make()
    first_sign()
    look()
    assert first_sign()[0] == ""
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    look()
    assert first_sign()[0] == ""
    low = bpy.context.scene.imprint.low or bpy.context.active_object
    assert results_panel.sign(results.all_of(bpy.context, low)) == RIGHT
    assert findings.worst(bpy.context, low) is None
    drawn = panel_layout.draw(width=4000, panels=[results_panel.IMPRINT_PT_results])
    assert not {*SIGNS[:2]} & {*drawn.icons}


def test_there_are_twenty_of_each():
    assert len(BEFORE) + len(AFTER) == len(RIGHTS) == 20


def test_what_can_show_two_surfaces_is_a_note():
    """No measure tells which of them is meant, unlike where most rays meet backs alone."""
    check = {"count": 81, "of": 100, "backs": 0, "covered": 80, "beyond": 0}
    for reason, harm in (("covered", NOTE), ("beyond", NOTE), ("backs", WRONG), ("jumps", LOOK)):
        counts = check | {"covered": 0} | {reason: 80}
        note = severity.warning("unsure", counts, "lo", Settings(method="CAST"))
        assert (note.harm, note.kind, note.share) == (harm, "unsure", 0.81)
    assert Told.of(note).harm == LOOK


# The buttons


def buttons(drawn):
    return panel_layout.fixes(drawn)


def test_a_button_turns_udim_tiles_on():
    _, _, panel = udim(storage="MEMORY")
    text, drawn = first_sign()
    assert buttons(drawn) == ["UDIM"]
    assert bpy.ops.imprint.fix(kind="UDIM") == {"FINISHED"}
    assert (panel.udim, panel.storage) == (True, "PACK")
    assert first_sign()[0] == ""
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert results.of(bpy.context).tiles == [1001, 1002, 1003]


@pytest.mark.parametrize("wrap", [False, True])
def test_udim_is_offered_only_where_tiles_hold_what_is_cut_off(wrap):
    if wrap:
        udim(wrap="UV")
    else:
        across_the_border()
    text, drawn = first_sign()
    assert "reach outside" in text
    assert buttons(drawn) == []


def test_a_bake_says_it_too_and_what_is_fixed_is_gone_at_once():
    _, _, panel = udim()
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    (text,) = results.of(bpy.context).warnings
    assert text.endswith("cut off there; --udim bakes a map for each tile.") and text.kind == "outside"
    assert first_sign()[1].text.count("reach outside") == 1
    panel.udim = True
    assert first_sign()[0] == ""  # before another bake


def test_overlaps_have_a_button_that_unwraps():
    overlapping()
    text, drawn = first_sign()
    assert text.endswith(f"{UNWRAPS}.") and UNWRAPS in severity.OVERLAP
    assert buttons(drawn) == [fixes.UNWRAP]
    assert bpy.ops.imprint.unwrap() == {"FINISHED"}
    assert first_sign()[0] == ""


def test_a_large_mesh_is_looked_at_after_the_redraw():
    side = int(MOST_AT_ONCE**0.5)
    low, _, _ = pair(spread(zoo.plane("lo", side), 1.0, (0.4, 0.0)), zoo.terrain("hi", side + 9))
    assert len(low.data.loops) > MOST_AT_ONCE
    looks = findings.looks
    assert first_sign()[0] == "" and findings.looks == looks
    look()
    assert "reach outside" in first_sign()[0] and findings.looks == looks + 1
    spread(low, 1.0, (-0.4, 0.0))
    bpy.context.view_layer.update()
    first_sign()
    look()
    assert first_sign()[0] == ""


def test_a_plan_names_one_of_many_high_objects():
    low, _, panel = pair()
    for number in range(49):
        panel.highs.add().object = bpy.data.objects.new(f"brick_{number:03}", zoo.plane("one").data)
        bpy.context.scene.collection.objects.link(panel.highs[-1].object)
    assert "Casts rays from 'lo' to 'hi' and 49 more: " in panel_layout.draw(width=4000, panels=PANEL).text


def test_more_than_three_sentences_are_behind_a_fold():
    texts = [Told(f"Sentence {'x' * number}.", LOOK) for number in range(5)]
    layout = panel_layout.Layout()
    fix_buttons.draw_list(layout, panel_layout.context_of(4000), texts)
    assert layout.drawn.labels == [one.text for one in texts[:3]]
    bpy.context.window_manager.imprint_shows_all = True
    fix_buttons.draw_list(layout, panel_layout.context_of(4000), texts)
    assert layout.drawn.labels[3:] == [one.text for one in texts]
    bpy.context.window_manager.imprint_shows_all = False


# Several low objects


def lows_and_highs(*names):
    """Pairs by name, all selected; the low objects have n-gons or quads that differ elsewhere."""
    made = []
    for name in names:
        low, high = zoo.disc(f"{name}_low"), zoo.terrain(f"{name}_high", 12)
        made += [low, high]
    select(*made)
    use(size=32, method="CAST", material=False, green="-Y", mips=0)
    return made


def test_equal_sentences_are_one_with_a_button_for_all():
    lows = lows_and_highs("a", "b", "c")[::2]
    select(*lows)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    drawn = panel_layout.draw(width=4000, panels=[results_panel.IMPRINT_PT_results])
    assert drawn.text.count("n-gons") == 1
    (text,) = [text for text in drawn.labels if "n-gons" in text]
    assert text.startswith("In 3 low objects: 'a_low' has 1 n-gons")


def test_a_button_is_for_all_low_objects_of_its_sentence():
    lows = lows_and_highs("a", "b", "c")[::2]
    told = grouped((low.name, Told("n-gons", LOOK, fixes=("POLYGONS",))) for low in lows)
    layout = panel_layout.Layout()
    fix_buttons.draw_told(layout, panel_layout.context_of(4000), told[0])
    ((_, given),) = layout.drawn.given
    assert bpy.ops.imprint.fix(kind=given.kind, low=given.low, lows=given.lows) == {"FINISHED"}
    assert [low.modifiers[-1].type for low in lows] == ["TRIANGULATE"] * 3
    lows[1].modifiers.clear()
    assert bpy.ops.imprint.fix(kind=given.kind, lows=given.lows) == {"FINISHED"}  # those that have it are told
    assert len(lows[0].modifiers) == len(lows[1].modifiers) == 1
    assert "already has" in refusal(bpy.ops.imprint.fix, kind=given.kind, lows=given.lows)


def test_the_worst_group_is_first():
    found = [
        ("a", Told("'a' is odd.", LOOK)),
        ("b", Told("'b' is odd.", LOOK)),
        ("c", Told("'c' is wrong.", WRONG)),
        ("d", Told("5% of 'd' overlap.", WRONG, share=0.05)),
        ("e", Told("50% of 'e' overlap.", WRONG, share=0.5)),
        ("f", Told("'f' is odd.", NOTE)),
        ("", Told("Nothing is called 'f'.", WRONG)),
        ("", Told("Nothing is called 'g'.", WRONG)),
    ]
    assert [(told.text, told.lows) for told in grouped(found)] == [
        ("In 2 low objects: 50% of 'e' overlap.", ("d", "e")),
        ("In 2 low objects: Nothing is called 'f'.", ()),
        ("'c' is wrong.", ("c",)),
        ("In 2 low objects: 'a' is odd.", ("a", "b")),
        ("'f' is odd.", ("f",)),
    ]


@pytest.mark.parametrize("harm", [WRONG, LOOK, NOTE])
def test_the_sign_of_a_pair_is_that_of_the_worst(harm):
    assert bake_panel._sign("", [Told("It.", harm)]) == (ICONS[harm] if harm is not NOTE else RIGHT)
    assert bake_panel._sign("It cannot be baked.", []) == ICONS[WRONG]


def test_a_row_knows_the_worst_before_and_after_the_bake():
    low, _, panel = udim()
    panel.low = None
    panel.highs.clear()
    assert findings.worst(bpy.context, low) is None
    look()
    worst = findings.worst(bpy.context, low)
    assert (worst.harm, worst.kind, worst.fixes) == (WRONG, "outside", ("UDIM",))
    panel.udim = True
    findings.worst(bpy.context, low)
    look()
    assert findings.worst(bpy.context, low) is None


# What a name or a pair calls low


def chosen():
    return {
        one.low.name: sorted(high.name for high in one.highs)
        for one in bpy.context.scene.imprint.all_chosen(bpy.context)
    }


def test_low_objects_by_name_are_baked_each_with_its_pair():
    lows = lows_and_highs("a", "b", "c")[::2]  # all in one place
    select(*lows)
    bpy.context.scene.imprint.method = "FLATTEN"
    assert chosen() == {f"{name}_low": [f"{name}_high"] for name in "abc"}


def test_no_low_object_is_baked_as_a_high_one_onto_another():
    made = lows_and_highs("a", "b", "c")
    assert chosen() == {"a_low": ["a_high"]}
    drawn = panel_layout.draw(width=4000, panels=PANEL)
    assert "Left out, since a name or a pair calls them low: 'b_low', 'c_low'" in drawn.text
    assert "imprint.set_add" in [name for name, _ in drawn.buttons]
    sculpt = zoo.terrain("sculpt", 12)
    select(made[0], *made[1:], sculpt)
    assert chosen() == {"a_low": ["a_high", "sculpt"]}
    select(made[0], made[1])
    assert "Left out" not in panel_layout.draw(width=4000, panels=PANEL).text


def test_low_objects_of_pairs_are_left_out_too():
    made = {name: zoo.terrain(name, 8) for name in ("one", "one detail", "two", "two detail")}
    for name in ("one", "two"):
        made[name].imprint.put([made[f"{name} detail"]])
    use(size=32, method="CAST")
    select(made["one"], made["two"], made["two detail"])
    assert chosen() == {"one": ["one detail"]}
    level = zoo.plane("level", 2)
    select(level, made["one"])  # nothing calls it low: a level of detail is baked from another one
    assert chosen() == {"level": ["one"]}
    made["one"].imprint.put([made["two"]])
    select(made["one"], made["two"])  # it is a high object of this pair
    assert chosen() == {"one": ["two"]}
    assert "Left out" not in panel_layout.draw(width=4000, panels=PANEL).text


def test_a_set_is_made_of_all_with_one_press():
    lows_and_highs("a", "b", "c")
    assert bpy.ops.imprint.set_add() == {"FINISHED"}
    (one,) = bpy.context.scene.imprint_sets
    assert sorted(part.title for part in one.parts) == ["a_low", "b_low", "c_low"]


def test_a_report_of_an_earlier_version_shows_its_warnings_as_wrong():
    low, _, _ = pair()
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    values = json.loads(low.imprint.result)
    for one in values:
        del one["ratings"]
        one["warnings"] = ["Half of it is missing."]
    low.imprint.result = json.dumps(values)
    assert results_panel.sign(results.all_of(bpy.context, low)) == ICONS[WRONG]
