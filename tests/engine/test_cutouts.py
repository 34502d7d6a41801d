# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests cut-outs: where the alpha of high materials is clear, maps show what is behind, and rays go on."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core import udim
from addon.core.material_feeds import Constant, Extension
from addon.core.progress import Timings
from addon.engine import cutouts as records
from addon.engine import tree_cache
from addon.mesh import cutouts
from addon.mesh.triangle_mesh import Alpha, Mesh
from addon.passes import high_in_uv, target
from addon.passes.cast import read_hits
from addon.scene import reading
from addon.scene.materials.material_reading import read_materials
from addon.scene.textures import ImageTextures
from tests.support import cut_scenes, maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 64
OTHER = 0.002
"""The largest share of texels that may differ from the same scene cut by hand: those that the edges of the cuts cross."""
LEVEL = 1.0 / 255.0
BODY, CARD = cut_scenes.BODY, cut_scenes.CARD
RAYS = 0.03
"""Ambient occlusion of 256 rays of a texel, from the closed form, and the plate's finite size."""
SEEN = {"method": "CAST", "extrusion": 0.3, "max_distance": 0.6}
"""Rays that start above all planes of these tests."""
HEIGHT = 0.2
"""Of the upper of two plates."""


# The same as cut by hand


@pytest.mark.parametrize("name", cut_scenes.SCENES)
def test_maps_are_those_of_the_scene_cut_by_hand(name):
    wanted = ("AO", "BENT_NORMAL", "THICKNESS", "HEIGHT", "BASE_COLOR", "MATERIAL_ID")
    made = {}
    for by_hand in (True, False):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        low, highs = zoo.plane("low"), cut_scenes.SCENES[name](by_hand=by_hand)
        report, made[by_hand] = maps.bake_all_maps(low, *highs, maps=wanted, method="CAST", size=SIDE)
        assert report.cut_outs == ([] if by_hand else [f"{name} material"])
    for key, expected in made[True].items():
        differs = (np.abs(made[False][key] - expected)[..., :3] > LEVEL).any(axis=-1)
        assert differs.mean() <= OTHER, key


def plates(radius=0.4, size=8.0, pixels=512):
    """A low plate, and high ones in its place and above: that one is larger, and has a round hole in its alpha."""
    low, below, above = zoo.plane("low"), zoo.plane("below"), zoo.plane("above")
    for vertex in above.data.vertices:
        vertex.co *= size / 2.0
        vertex.co.z = HEIGHT
    u, v = np.meshgrid(*[((np.arange(pixels) + 0.5) / pixels - 0.5) * size] * 2)
    alpha = np.clip(0.5 + 0.25 * (np.hypot(u, v) - radius) * pixels / size, 0.0, 1.0)
    cut_scenes.color_over(above, alpha)
    scenes.material("body", below, Base_Color=BODY)
    return low, below, above


def test_a_round_hole_has_the_height_and_the_occlusion_of_its_closed_form():
    low, below, above = plates()
    settings = {"method": "CAST", "extrusion": 0.4, "max_distance": 0.8, "two_sided": True, "rays": 256, "size": SIDE}
    _, made = maps.bake_all_maps(low, below, above, maps=("HEIGHT", "AO"), **settings)
    x, y = np.moveaxis(maps.texel_uv(SIDE, SIDE) * 2.0 - 1.0, -1, 0)
    far = np.hypot(x, y)
    is_in, is_out = far < 0.4 - 2.0 / SIDE, far > 0.4 + 2.0 / SIDE
    np.testing.assert_allclose(made["height"][is_in, 0], 0.0, atol=1e-5)
    np.testing.assert_allclose(made["height"][is_out, 0], HEIGHT, atol=1e-5)
    # Of a disc of radius r in the height h above a point, r^2 / (r^2 + h^2) is seen, weighted by the cosine.
    middle = made["ao"][SIDE // 2 - 1 : SIDE // 2 + 1, SIDE // 2 - 1 : SIDE // 2 + 1, 0].mean()
    assert abs(middle - 0.4**2 / (0.4**2 + HEIGHT**2)) < RAYS
    np.testing.assert_allclose(made["ao"][is_out, 0], 1.0, atol=1e-3)


# What is clear


def ramp():
    """Alpha that rises along u, so that its value at a place is known."""
    return np.tile((np.arange(256) + 0.5) / 256.0, (4, 1))


def math(material, operation, *sources):
    node = material.node_tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, source in zip(node.inputs, sources, strict=False):
        if isinstance(source, bpy.types.NodeSocket):
            material.node_tree.links.new(source, socket)
        else:
            socket.default_value = source
    return node.outputs[0]


def mixed(material, alpha, *, is_first):
    """Mix the shader with a Transparent BSDF by `alpha`. is_first: whether that is the first of both."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    mix, clear = nodes.new("ShaderNodeMixShader"), nodes.new("ShaderNodeBsdfTransparent")
    shader, output = nodes["Principled BSDF"], nodes["Material Output"]
    shaders = (clear, shader) if is_first else (shader, clear)
    links.new(alpha, mix.inputs[0])
    for place, one in enumerate(shaders, start=1):
        links.new(one.outputs[0], mix.inputs[place])
    links.new(mix.outputs[0], output.inputs["Surface"])


STATED = {
    "plain": (lambda m, a: scenes.set_inputs(m, Alpha=a), 0.5, False),
    "greater": (lambda m, a: scenes.set_inputs(m, Alpha=math(m, "GREATER_THAN", a, 0.8)), 0.8, False),
    "less": (lambda m, a: scenes.set_inputs(m, Alpha=math(m, "LESS_THAN", a, 0.3)), 0.3, True),
    "threshold first": (lambda m, a: scenes.set_inputs(m, Alpha=math(m, "GREATER_THAN", 0.3, a)), 0.3, True),
    "rounded": (lambda m, a: scenes.set_inputs(m, Alpha=math(m, "ROUND", a)), 0.5, False),
    "glTF": (
        lambda m, a: scenes.set_inputs(m, Alpha=math(m, "SUBTRACT", 1.0, math(m, "LESS_THAN", a, 0.7))),
        0.7,
        False,
    ),
    "mix, clear first": (lambda m, a: mixed(m, a, is_first=True), 0.5, False),
    "mix, clear last": (lambda m, a: mixed(m, a, is_first=False), 0.5, True),
    "mix by a step": (lambda m, a: mixed(m, math(m, "GREATER_THAN", a, 0.2), is_first=True), 0.2, False),
}
"""Nodes behind alpha: where they are clear along the ramp, and whether that is beyond the place."""


@pytest.mark.parametrize("name", STATED)
def test_the_threshold_is_that_which_nodes_state(name):
    link, place, is_beyond = STATED[name]
    low, body, card = scenes.planes("low", "body", "card", height=0.1)
    body.location.z = -0.1
    scenes.material("skin", body, Base_Color=BODY)
    material = cut_scenes.color_over(card, ramp(), extension="EXTEND")
    node = next(one for one in material.node_tree.nodes if one.type == "TEX_IMAGE")
    for each in list(material.node_tree.links):
        if each.from_node == node:
            material.node_tree.links.remove(each)
    link(material, node.outputs["Alpha"])
    _, made = maps.bake_all_maps(low, body, card, maps=("BASE_COLOR",), size=SIDE, **SEEN)
    u = maps.texel_uv(SIDE, SIDE)[..., 0]
    is_clear = made["base_color"][..., 2] > 0.3
    np.testing.assert_array_equal(is_clear, (u > place) == is_beyond)


def card_over_body(**inputs):
    """A low plane, a high one below it and one above it, whose material has these inputs."""
    low, body, card = scenes.planes("low", "body", "card", height=0.1)
    body.location.z = -0.1
    scenes.material("skin", body, Base_Color=BODY)
    return low, body, card, scenes.material("card", card, Base_Color=CARD, **inputs)


def color_of(low, *highs, **settings):
    """The report, and the base color."""
    values = {"size": 16, **SEEN, **settings}
    report, made = maps.bake_all_maps(low, *highs, maps=("BASE_COLOR",), **values)
    return report, made["base_color"][..., :3]


def test_an_attribute_is_clear_where_it_is_below_a_half():
    low, body, card, material = card_over_body()
    colors = card.data.color_attributes.new("fade", "FLOAT_COLOR", "CORNER")
    for corner, place in zip(colors.data, card.data.uv_layers[0].uv, strict=True):
        corner.color = (1.0, 1.0, 1.0, place.vector[0])
    node = material.node_tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = "fade"
    scenes.set_inputs(material, Alpha=node.outputs["Alpha"])
    _, color = color_of(low, body, card)
    np.testing.assert_array_equal(color[..., 2] > 0.3, maps.texel_uv(16, 16)[..., 0] < 0.5)


def test_an_alpha_of_0_shows_what_is_behind_and_is_told():
    low, body, card, _ = card_over_body(Alpha=0.0)
    report, color = color_of(low, body, card)
    np.testing.assert_allclose(color, np.broadcast_to(BODY, color.shape), atol=1e-6)
    assert [text for text in report.warnings if "alpha of 'card' is below its threshold everywhere" in text]


def test_what_nothing_is_behind_is_shown_as_it_is():
    low, _, card, _ = card_over_body(Alpha=0.0)
    report, color = color_of(low, card)
    np.testing.assert_allclose(color, np.broadcast_to(CARD, color.shape), atol=1e-6)
    assert (
        report.missed == 0.0
        and len([text for text in report.warnings if "is below its threshold everywhere" in text]) == 1
    )
    card.data.materials.clear()
    cut_scenes.color_over(card, ramp())
    _, color = color_of(low, card)
    np.testing.assert_allclose(color, np.broadcast_to(CARD, color.shape), atol=1e-6)


def test_objects_that_are_all_clear_are_all_solid():
    low, body, card, material = card_over_body(Alpha=0.0)
    body.data.materials[0] = material
    wanted = {"maps": ("HEIGHT", "AO"), "two_sided": True, "size": 16, **SEEN, "extrusion": 0.05}  # below the card
    made = [maps.bake_all_maps(low, body, card, cut_outs=cut_outs, **wanted)[1] for cut_outs in (False, True)]
    for name, expected in made[0].items():
        np.testing.assert_array_equal(made[1][name], expected)
    assert made[1]["ao"][..., 0].max() < 0.7


@pytest.mark.parametrize("hit", ["OWN", "OUTERMOST", "NEAREST"])
@pytest.mark.parametrize("facing", [False, True])
def test_each_rule_sees_through(hit, facing):
    low, body, card, _ = card_over_body()
    card.data.materials.clear()
    cut_scenes.color_over(card, ramp(), extension="EXTEND")
    _, color = color_of(low, body, card, hit=hit, facing_only=facing)
    is_left = maps.texel_uv(16, 16)[..., 0] < 0.5
    np.testing.assert_allclose(color[is_left], np.broadcast_to(BODY, color[is_left].shape), atol=1e-6)
    _, alone = color_of(low, card, hit=hit, facing_only=facing)
    np.testing.assert_allclose(alone, np.broadcast_to(CARD, alone.shape), atol=1e-6)


SOLID = {
    "alpha 1": {"Alpha": 1.0},
    "alpha between": {"Alpha": 0.3},
    "glass": {"Alpha": "image", "Transmission_Weight": 1.0},
    "no alpha channel": {"Alpha": "opaque"},
    "missing": {"Alpha": "missing"},
    "off": {"Alpha": "image"},
}


@pytest.mark.parametrize("name", SOLID)
def test_what_is_not_clear_costs_nothing(name):
    low, body, card, material = card_over_body()
    inputs = dict(SOLID[name])
    if isinstance(kind := inputs["Alpha"], str):
        shown = scenes.image(kind, np.full((4, 4), 0.5), alpha=np.zeros((4, 4)) if kind == "image" else None)
        if kind == "missing":
            shown = bpy.data.images.new("missing", 4, 4)
            shown.source, shown.filepath = "FILE", "/nowhere/missing.png"
        inputs["Alpha"] = scenes.texture(material, shown).outputs["Alpha"]
    scenes.set_inputs(material, **inputs)
    settings = scenes.settings("CAST", size=16, cut_outs=name != "off")
    meshes = reading.read(bpy.context, low, [body, card], None, settings)
    assert not any(map(cutouts.has_layer, meshes.highs))
    scene = tree_cache.trees.ray_scene_of(meshes.highs, Timings())
    assert scene.tables.cutouts is None
    report, color = color_of(low, body, card, cut_outs=name != "off")
    np.testing.assert_allclose(color, np.broadcast_to(CARD, color.shape), atol=1e-6)
    assert report.cut_outs == []
    assert bool([text for text in report.warnings if "solid" in text]) == (name == "missing")


def test_opaque_triangles_are_not_asked():
    """Only the two of eight cards with something clear."""
    low, body, card, _ = card_over_body()
    grid = zoo.plane("grid", 2)
    alpha = np.ones((8, 8))
    alpha[:3, :3] = 0.0
    cut_scenes.color_over(grid, alpha, interpolation="Linear", extension="EXTEND")
    settings = scenes.settings("CAST", size=16)
    (high,) = reading.read(bpy.context, low, [grid], None, settings).highs
    found = records.records_of([high], np.arange(8))
    assert len(found.corners) == 2 and np.count_nonzero(found.of_triangles) == 2


def test_an_alpha_that_nodes_make_of_uvs_is_evaluated_by_cycles():
    """The product of two images is clear where it is below a half."""
    low, body, card, material = card_over_body()
    image = image_of_ramp()
    first, second = (scenes.texture(material, image, extension="EXTEND").outputs["Alpha"] for _ in range(2))
    scenes.set_inputs(material, Alpha=math(material, "MULTIPLY", first, second))
    _, color = color_of(low, body, card, size=SIDE)
    np.testing.assert_array_equal(color[..., 2] > 0.3, maps.texel_uv(SIDE, SIDE)[..., 0] < 0.5**0.5)
    report, color = color_of(low, body, card, exact_materials="OFF")
    assert [text for text in report.warnings if "Cut-outs" in text and "two textures" in text]


def test_an_alpha_that_needs_more_than_uvs_is_solid_and_told():
    low, body, card, material = card_over_body()
    node = material.node_tree.nodes.new("ShaderNodeTexNoise")
    scenes.set_inputs(material, Alpha=node.outputs[0])
    report, color = color_of(low, body, card)
    np.testing.assert_allclose(color, np.broadcast_to(CARD, color.shape), atol=1e-6)
    assert [text for text in report.warnings if "Cut-outs: it is solid" in text]


# Flatten


def test_flatten_draws_what_is_clear_below_all_else():
    low, body, card, material = card_over_body()
    scenes.set_inputs(material, Alpha=scenes.texture(material, image_of_ramp(), extension="EXTEND").outputs["Alpha"])
    is_left = maps.texel_uv(16, 16)[..., 0] < 0.5
    for highs in ((body, card), (card, body)):
        _, color = color_of(low, *highs, method="FLATTEN")
        np.testing.assert_allclose(color[is_left], np.broadcast_to(BODY, color[is_left].shape), atol=1e-6)
    _, alone = color_of(low, card, method="FLATTEN")
    np.testing.assert_allclose(alone, np.broadcast_to(CARD, alone.shape), atol=1e-6)


def test_a_card_onto_itself_keeps_its_colors_and_its_alpha():
    """Files of leaves have colors under what is clear."""
    card = zoo.plane("card")
    cut_scenes.color_over(card, ramp(), extension="EXTEND")
    made = {}
    for cut_outs in (False, True):
        _, made[cut_outs] = maps.bake_all_maps(card, card, maps=("BASE_COLOR", "ALPHA"), size=16, cut_outs=cut_outs)
    for name, expected in made[False].items():
        np.testing.assert_array_equal(made[True][name], expected)


def image_of_ramp():
    return scenes.image("ramp", np.full((4, 256, 3), 0.5), alpha=ramp())


# Images


def shown(alpha, places):
    """The values of an image at places (N, 2) in pixels, in float64."""
    height, width = alpha.values.shape

    def pixel(x, y):
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        match alpha.extension:
            case Extension.REPEAT:
                x, y = x % width, y % height
            case Extension.MIRROR:
                x, y = (np.minimum(at % (2 * n), 2 * n - 1 - at % (2 * n)) for at, n in ((x, width), (y, height)))
        value = alpha.values[y.clip(0, height - 1), x.clip(0, width - 1)]
        return np.where(inside, value, alpha.outside) if alpha.extension == Extension.CLIP else value

    if not alpha.is_smooth:
        return pixel(*np.floor(places).astype(int).T)
    at = places - 0.5
    corner = np.floor(at).astype(int)
    (x, y), (u, v) = corner.T, (at - corner).T
    below = pixel(x, y) * (1 - u) + pixel(x + 1, y) * u
    above = pixel(x, y + 1) * (1 - u) + pixel(x + 1, y + 1) * u
    return below * (1 - v) + above * v


@pytest.mark.parametrize("is_smooth", [False, True])
@pytest.mark.parametrize("extension", list(Extension))
def test_images_are_read_as_blender_shows_them(extension, is_smooth):
    """A square that shows pixels far beyond the image, seen through at random."""
    rng = np.random.default_rng(7)
    alpha = Alpha(rng.uniform(-1.0, 1.0, (5, 7)).astype(np.float32), extension, -1.0, is_smooth, ())
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    high = Mesh.of_arrays("square", np.pad(corners, ((0, 0), (0, 1))), np.array([(0, 1, 2), (0, 2, 3)]), corners)
    low, size = np.array([-17.3, -13.1]), np.array([43.7, 31.9])
    layer = np.column_stack([low + high.uv * size, np.ones(len(high.uv))]).astype(np.float32)
    high = replace(high, layers={cutouts.KEY: layer}, alphas=(alpha,))
    scene = tree_cache.without_tree([high], Timings())
    side = 256
    hits = target.Target(side, side, ("RGBA32UI",))
    batch = high_in_uv.upload_for_hits(high.uv, np.arange(2))
    high_in_uv.draw_hits(hits, batch, 2, udim.uv_to_clip(), scene.tables.cutouts, has_clear=False)
    triangles, _ = read_hits(hits)
    values = shown(alpha, low + maps.texel_uv(side, side).reshape(-1, 2) * size)
    is_clear = triangles.reshape(-1) < 0
    is_sure = np.abs(values) > (0.02 if is_smooth else 0.0)
    if not is_smooth:  # rounding decides at the borders of pixels
        at = low + maps.texel_uv(side, side).reshape(-1, 2) * size
        is_sure = (np.abs(at - np.rint(at)) > 1e-3).all(axis=1)
    assert is_sure.mean() > 0.9
    np.testing.assert_array_equal(is_clear[is_sure], (values < 0.0)[is_sure])


def test_a_constant_of_no_shader_is_no_cut_out():
    (plain,) = read_materials([None], ImageTextures())
    assert plain.cutout is None
    material = bpy.data.materials.new("clear")
    scenes.set_inputs(material, Alpha=0.0)
    (clear,) = read_materials([material], ImageTextures())
    assert clear.cutout.feed == Constant((0.0, 0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("node", "output", "is_told"),
    [
        ("ShaderNodeFresnel", "Fac", False),
        ("ShaderNodeLayerWeight", "Facing", False),
        ("ShaderNodeNewGeometry", "Backfacing", False),
        ("ShaderNodeObjectInfo", "Random", True),
    ],
)
def test_what_is_clear_from_some_sides_is_solid_without_a_word(node, output, is_told):
    """A film, or faces without a back: the map is that of a solid material."""
    heights = []
    for is_mixed in (False, True):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        low, high = zoo.plane("low"), zoo.terrain("high", 16)
        tree = scenes.material("film", high).node_tree
        if is_mixed:
            mix, clear = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfTransparent")
            tree.links.new(tree.nodes.new(node).outputs[output], mix.inputs[0])
            tree.links.new(tree.nodes["Principled BSDF"].outputs[0], mix.inputs[1])
            tree.links.new(clear.outputs[0], mix.inputs[2])
            tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
        report, made = maps.bake_all_maps(low, high, maps=("HEIGHT",), method="CAST", size=SIDE)
        heights.append(made["height"])
    assert not report.cut_outs
    assert any("Cut-outs" in text for text in report.warnings) == is_told
    assert np.array_equal(*heights)
