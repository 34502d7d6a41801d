# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests maps that are sampled onto attributes of the low mesh."""

import bpy
import numpy as np
import pytest

from addon.core.declarations.choices import VertexDomain
from addon.core.errors import BakeError
from addon.core.map_types import BY_NAME, NORMAL
from addon.core.settings import Settings
from addon.output import value_encoding, vertex_attributes
from addon.output.vertex_attributes import VertexMaps

SIZE = 64
TEXEL = 1.0 / SIZE
ROUNDING = 1e-6


def make_low(faces, uvs, layer="UVMap"):
    """A mesh with a vertex for each different corner of `faces`, and the UVs of each corner."""
    mesh = bpy.data.meshes.new("low")
    count = max(max(face) for face in faces) + 1
    mesh.from_pydata([(i, i % 3, i % 5) for i in range(count)], [], faces)
    mesh.uv_layers.new(name=layer).uv.foreach_set("vector", np.ravel(uvs))
    low = bpy.data.objects.new("low", mesh)
    bpy.context.collection.objects.link(low)
    bpy.context.view_layer.update()
    return low


def two_islands():
    """Two quads that share an edge in space and lie apart in UV space, aligned with texels."""
    left = [(0.0, 0.0), (0.25, 0.0), (0.25, 0.25), (0.0, 0.25)]
    right = [(0.5, 0.5), (0.75, 0.5), (0.75, 0.75), (0.5, 0.75)]
    return make_low([(0, 1, 2, 3), (1, 4, 5, 2)], [*left, *right])


def islands(*boxes):
    """Where texels (SIZE, SIZE) are in the boxes (u, v, width, height)."""
    where = np.zeros((SIZE, SIZE), bool)
    for u, v, width, height in boxes:
        rows, columns = (slice(round(a * SIZE), round((a + b) * SIZE)) for a, b in ((v, height), (u, width)))
        where[rows, columns] = True
    return where


BOXES = ((0.0, 0.0, 0.25, 0.25), (0.5, 0.5, 0.25, 0.25))


def ramps(where):
    """Texels whose values are u, v and 0.5, with alpha 0 and other values outside `where`."""
    texels = np.full((SIZE, SIZE, 4), 9.0, np.float32)
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE + TEXEL / 2
    texels[..., 0], texels[..., 1], texels[..., 2] = u, v, 0.5
    texels[~where] = 7.0
    texels[..., 3] = where
    return texels


def sample(low, tiles, domain="CORNER", *, layer="UVMap", is_own_base=False, slots=None, **settings):
    """Store maps by tile and name. Returns the names of attributes and the warnings."""
    names = {name for maps in tiles.values() for name in maps} - {NORMAL.name}
    chosen = {"normal": False, "maps": tuple(name for name in BY_NAME if name in names)}
    settings = Settings(width=SIZE, height=SIZE, vertex_domain=domain, **chosen | settings)
    vertices = VertexMaps(low, layer, settings, is_own_base=is_own_base, slots=slots)
    for tile, maps in tiles.items():
        vertices.add(tile, {name: (texels, (texels[..., 3] > 0).astype(np.uint8)) for name, texels in maps.items()})
    return vertices.store(low)


def values(low, name):
    """The type, the domain and the values of an attribute."""
    attribute = low.data.attributes[name]
    width = {"FLOAT": 1, "FLOAT_VECTOR": 3, "FLOAT_COLOR": 4}[attribute.data_type]
    found = np.empty(len(attribute.data) * width, np.float32)
    attribute.data.foreach_get(vertex_attributes.FIELDS[attribute.data_type], found)
    return attribute.data_type, attribute.domain, found.reshape(-1, width)


def corner_uvs(low):
    uv = np.empty(len(low.data.loops) * 2, np.float32)
    low.data.uv_layers[0].uv.foreach_get("vector", uv)
    return uv.reshape(-1, 2)


def test_corners_get_the_texels_inside_their_own_faces():
    low = two_islands()
    names, warnings = sample(low, {1001: {"BASE_COLOR": ramps(islands(*BOXES))}})
    assert (names, warnings) == ({"base_color": "base_color"}, [])
    kind, domain, found = values(low, "base_color")
    assert (kind, domain) == ("FLOAT_COLOR", "CORNER")
    assert np.abs(found[:, :2] - corner_uvs(low)).max() <= TEXEL
    assert (found[:, 2:] == (0.5, 1.0)).all()


def test_corners_of_touching_islands_do_not_get_the_texels_of_the_other():
    left = [(0.0, 0.0), (0.25, 0.0), (0.25, 0.25), (0.0, 0.25)]
    low = make_low([(0, 1, 2, 3), (1, 4, 5, 2)], [*left, *((u + 0.25, v) for u, v in left)])
    texels = ramps(np.ones((SIZE, SIZE), bool))
    texels[..., :3] = 1.0
    texels[:, SIZE // 4 :, :3] = 2.0
    texels[SIZE // 4 :, :, :3] = 3.0
    sample(low, {1001: {"AO": texels}})
    assert values(low, "ao")[2][:, 0].tolist() == [1.0] * 4 + [2.0] * 4


def test_vertices_get_the_mean_of_their_corners():
    low = two_islands()
    sample(low, {1001: {"BASE_COLOR": ramps(islands(*BOXES))}}, "CORNER")
    corners = values(low, "base_color")[2]
    sample(low, {1001: {"BASE_COLOR": ramps(islands(*BOXES))}}, "POINT")
    kind, domain, found = values(low, "base_color")
    assert (kind, domain, len(found)) == ("FLOAT_COLOR", "POINT", 6)
    of = [[0], [1, 4], [2, 7], [3], [5], [6]]
    np.testing.assert_allclose(found, [corners[indices].mean(axis=0) for indices in of], atol=ROUNDING)


def test_unknown_corners_are_left_out_of_means_and_reported():
    low = two_islands()
    where = islands(BOXES[0])
    _, (warning,) = sample(low, {1001: {"AO": ramps(where)}}, "POINT")
    assert "4 of 8 face corners" in warning
    kind, _, found = values(low, "ao")
    assert kind == "FLOAT"
    assert abs(found[1, 0] - 0.25) <= TEXEL  # of the left face alone
    assert (found[4:] == 0.0).all()


@pytest.mark.parametrize(("gap", "is_found"), [(1, True), (2, True), (5, False)])
def test_the_nearest_known_texel_is_taken(gap, is_found):
    low = two_islands()
    where = islands(*BOXES)
    where[:gap, :] = False  # the lowest rows of the left island
    _, warnings = sample(low, {1001: {"ROUGHNESS": ramps(where)}})
    assert (warnings == []) == is_found
    found = values(low, "roughness")[2][:2, 0]
    if is_found:
        assert np.abs(found - (0.0, 0.25)).max() <= TEXEL
    else:
        assert (found == 0.0).all()


def test_tiles_of_a_udim_bake():
    uv = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    low = make_low([(0, 1, 2, 3), (1, 4, 5, 2)], [*uv, *(uv + (1.0, 1.0))])
    whole = np.ones((SIZE, SIZE), bool)
    first, second = ramps(whole), ramps(whole)
    second[..., :2] += 2.0
    _, warnings = sample(low, {1001: {"AO": first}, 1012: {"AO": second}}, udim=True)
    assert warnings == []
    found = values(low, "ao")[2][:, 0]
    assert np.abs(found[:4] - uv[:, 0]).max() <= TEXEL
    assert np.abs(found[4:] - uv[:, 0] - 2.0).max() <= TEXEL


def test_without_udim_a_face_outside_shows_the_map_repeated():
    uv = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    low = make_low([(0, 1, 2, 3)], uv - (3.0, -2.0))
    sample(low, {1001: {"AO": ramps(np.ones((SIZE, SIZE), bool))}})
    assert np.abs(values(low, "ao")[2][:, 0] - uv[:, 0]).max() <= TEXEL


def test_normals_are_x_y_and_z_whatever_the_channels_are():
    low = two_islands()
    normal = np.array((0.6, 0.0, 0.8))
    texels = ramps(islands(*BOXES))
    texels[..., :3] = (np.array((normal[2], -normal[0], normal[1])) + 1.0) / 2.0  # blue, -red, green
    for domain in ("CORNER", "POINT"):
        names, _ = sample(low, {1001: {NORMAL.name: texels}}, domain, normal=True, red="+Z", green="-X", blue="+Y")
        assert names == {"normal": "normal"}
        kind, _, found = values(low, "normal")
        assert kind == "FLOAT_VECTOR"
        np.testing.assert_allclose(found, np.broadcast_to(normal, found.shape), atol=ROUNDING)


def test_the_mean_normal_of_a_vertex_is_a_unit_vector():
    low = two_islands()
    texels = ramps(islands(*BOXES))
    texels[:, : SIZE // 2, :3], texels[:, SIZE // 2 :, :3] = (1.0, 0.5, 0.5), (0.5, 1.0, 0.5)
    sample(low, {1001: {NORMAL.name: texels}}, "POINT", normal=True)
    np.testing.assert_allclose(values(low, "normal")[2][1], (0.5**0.5, 0.5**0.5, 0.0), atol=1e-4)


def test_labels_become_the_colors_of_the_image_and_are_not_averaged():
    low = two_islands()
    texels = ramps(islands(*BOXES))
    texels[:, : SIZE // 2, :3], texels[:, SIZE // 2 :, :3] = 3.0, 1.0
    sample(low, {1001: {"OBJECT_ID": texels}}, "POINT")
    kind, _, found = values(low, "object_id")
    assert kind == "FLOAT_COLOR"
    expected = [value_encoding.color(2)] * 4 + [value_encoding.color(0)] * 2
    np.testing.assert_allclose(found[:, :3], expected, atol=ROUNDING)


@pytest.mark.parametrize(
    ("name", "kind"), [("POSITION", "FLOAT_VECTOR"), ("DISPLACEMENT", "FLOAT_VECTOR"), ("HEIGHT", "FLOAT")]
)
def test_the_type_follows_from_the_map(name, kind):
    low = two_islands()
    before = np.array([vertex.co for vertex in low.data.vertices])
    names, _ = sample(low, {1001: {name: ramps(islands(*BOXES))}})
    assert values(low, names[name.lower()])[0] == kind
    assert names[name.lower()] == ("baked_position" if name == "POSITION" else name.lower())
    assert (np.array([vertex.co for vertex in low.data.vertices]) == before).all()


def test_a_uv_map_of_the_name_stays():
    low = two_islands()
    low.data.uv_layers.new(name="ao")
    names, _ = sample(low, {1001: {"AO": ramps(islands(*BOXES))}})
    assert names == {"ao": "baked_ao"}
    assert [layer.name for layer in low.data.uv_layers] == ["UVMap", "ao"]


def test_a_vertex_group_of_the_name_stays_and_a_second_bake_adds_nothing():
    low = two_islands()
    low.vertex_groups.new(name="ao")
    for _ in range(2):
        assert sample(low, {1001: {"AO": ramps(islands(*BOXES))}})[0] == {"ao": "baked_ao"}
    assert [each.name for each in low.data.attributes if "ao" in each.name] == ["baked_ao"]


def test_a_second_bake_fills_the_same_attribute():
    low = two_islands()
    maps = {1001: {"AO": ramps(islands(*BOXES))}}
    for domain in ("CORNER", "CORNER", "POINT", "CORNER"):
        assert sample(low, maps, domain) == ({"ao": "ao"}, [])
        assert values(low, "ao")[1] == domain
    assert [each.name for each in low.data.attributes if each.name.startswith("ao")] == ["ao"]


def test_drawn_maps_of_a_packed_image_get_attributes_too():
    low = two_islands()
    texels = ramps(islands(*BOXES))
    names, _ = sample(low, {1001: dict.fromkeys(("AO", "ROUGHNESS", "METALLIC"), texels)}, maps=(), pack="GLTF")
    assert list(names) == ["ao", "roughness", "metallic"]


def test_sampling_does_not_change_the_texels():
    low = two_islands()
    texels = ramps(islands(*BOXES))
    before = texels.copy()
    sample(low, {1001: {"AO": texels}})
    assert (texels == before).all()


def test_a_vertex_of_two_texture_sets_gets_the_mean_of_the_corners_of_one():
    low = two_islands()
    for name in ("First", "Second"):
        low.data.materials.append(bpy.data.materials.new(name))
    low.data.polygons[1].material_index = 1
    texels = ramps(np.ones((SIZE, SIZE), bool))
    _, warnings = sample(low, {1001: {"AO": texels}}, "POINT", slots=(0,))
    assert warnings == []
    found = values(low, "ao")[2][:, 0]
    assert np.abs(found[:4] - (0.0, 0.25, 0.25, 0.0)).max() <= TEXEL
    assert (found[4:] == 0.0).all()


# Meshes that cannot have them, or have them with a warning


def test_modifiers_that_change_the_topology_get_a_warning():
    low = two_islands()
    low.modifiers.new("Triangulate", "TRIANGULATE")
    bpy.context.view_layer.update()
    maps = {1001: {"AO": ramps(islands(*BOXES))}}
    _, (warning,) = sample(low, maps)
    assert '"low"' in warning
    assert "topology" in warning
    assert sample(low, maps, is_own_base=True)[1] == []


def test_a_shared_mesh_gets_a_warning():
    low = two_islands()
    bpy.data.objects.new("second", low.data)
    _, (warning,) = sample(low, {1001: {"AO": ramps(islands(*BOXES))}})
    assert "2 users" in warning


def test_a_mesh_that_changed_meanwhile_stays_as_it_is():
    low = two_islands()
    vertices = VertexMaps(low, "UVMap", Settings(vertex_domain=VertexDomain.CORNER))
    low.data = make_low([(0, 1, 2)], [(0, 0), (1, 0), (1, 1)]).data
    names, (warning,) = vertices.store(low)
    assert names == {}
    assert "changed" in warning


def test_a_uv_map_of_modifiers_is_refused():
    with pytest.raises(BakeError, match="comes from modifiers"):
        VertexMaps(two_islands(), "Missing", Settings())


def test_edit_mode_and_linked_meshes_are_refused(tmp_path):
    low = two_islands()
    vertex_attributes.check(low)
    bpy.context.view_layer.objects.active = low
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(BakeError, match="Edit Mode"):
        vertex_attributes.check(low)
    bpy.ops.object.mode_set(mode="OBJECT")
    path = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, data):
        data.meshes = ["low"]
    low = bpy.data.objects.new("low", bpy.data.meshes["low"])
    with pytest.raises(BakeError, match="linked from a library"):
        vertex_attributes.check(low)
