# SPDX-License-Identifier: GPL-3.0-or-later
"""The decoder that checks exported files, against the programs' rules as tests/support writes them down."""

import numpy as np
import pytest

from addon.core.declarations import bases
from addon.export import comparison
from tests.support import decoders


@pytest.mark.parametrize("basis", bases.BASES, ids=lambda basis: basis.name)
def test_each_basis_decodes_as_its_readers_do(basis):
    random = np.random.default_rng(7)
    normals = comparison.unit_vectors(random.normal(size=(500, 3, 3)) * 0.4 + [0.0, 0.0, 1.0])
    along = comparison.unit_vectors(np.cross(normals, random.normal(size=3)))
    signs = np.where(random.random(500) < 0.5, -1.0, 1.0)
    tangents = np.concatenate([along, np.broadcast_to(signs[:, None, None], (500, 3, 1))], axis=-1)
    weights = random.dirichlet(np.ones(3), 500)
    values = random.normal(size=(500, 3)) * 0.3 + [0.0, 0.0, 1.0]
    corners = (normals, tangents, decoders.bitangents(normals, tangents))
    interpolated = [np.einsum("nc,nck->nk", weights, part) for part in corners]
    expected = decoders.unit(decoders.decoded(values, basis.name, *interpolated))
    np.testing.assert_allclose(comparison.decoded(basis, values, weights, normals, tangents), expected, atol=1e-12)


def test_angles_are_exact_when_they_are_small():
    a = np.array([[0.0, 0.0, 1.0]])
    b = np.array([[np.sin(1e-6), 0.0, np.cos(1e-6)]])
    np.testing.assert_allclose(comparison.degrees_between(a, b), np.degrees(1e-6), rtol=1e-6)
