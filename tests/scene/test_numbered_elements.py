# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the numbers of faces and edges behind modifiers, and that nothing of them stays in the mesh."""

import bpy
import numpy as np
import pytest

from addon.scene import mesh_reader
from tests.support import zoo

OWN = ".imprint_face"
"""An attribute of the artist with the name that the numbers would take."""


def contents(data):
    """The names, types, domains and values of all attributes, and which one is active."""
    found = {}
    for layer in data.attributes:
        if layer.data_type == "INT":
            values = np.empty(len(layer.data), np.int32)
            layer.data.foreach_get("value", values)
            found[layer.name] = layer.data_type, layer.domain, values.tolist()
        else:
            found[layer.name] = layer.data_type, layer.domain
    return found, data.attributes.active_index


@pytest.mark.parametrize("domain", ["FACE", "EDGE"])
@pytest.mark.parametrize("own", [None, "FACE", "POINT"])
def test_numbers_go_through_modifiers_and_leave_nothing(domain, own):
    obj = zoo.plane("lo", 3)
    data = obj.data
    data.attributes.active_index = 0
    if own:
        layer = data.attributes.new(OWN, "INT", own)
        layer.data.foreach_set("value", np.arange(100, 100 + len(layer.data)))
    before = contents(data)
    obj.modifiers.new("array", "ARRAY").count = 2
    with (
        mesh_reader.numbered(obj, domain) as name,
        mesh_reader.evaluated(obj, bpy.context.evaluated_depsgraph_get()) as evaluated,
    ):
        found = mesh_reader.numbers(evaluated, name, domain)
    count = len(data.polygons if domain == "FACE" else data.edges)
    assert np.array_equal(np.sort(found), np.repeat(np.arange(count), 2))
    assert contents(data) == before


def test_nothing_stays_after_an_error():
    obj = zoo.plane("lo", 3)
    before = contents(obj.data)
    with pytest.raises(ZeroDivisionError), mesh_reader.numbered(obj):
        raise ZeroDivisionError
    assert contents(obj.data) == before
