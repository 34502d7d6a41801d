# SPDX-License-Identifier: GPL-3.0-or-later
"""Random surfaces that lie near each other, mostly broken: each bake ends in a map of finite numbers, or in one message.

The seed is in the test's name. For other seeds: IMPRINT_RANDOM=1000:5000 pytest tests/jobs/test_random_layers.py
"""

import os
from collections import Counter

import pytest

from tests.support import lanes, layered_scenes, outcome

pytestmark = pytest.mark.usefixtures("gpu_context")

FIRST, LAST = map(int, os.environ.get("IMPRINT_RANDOM", "0:200").split(":"))
FEW = 20
"""Cases of the fast lane."""
MAPS_AT_LEAST = 0.8
"""Share of the cases that must end in a map: otherwise, refusing everything would pass."""


@pytest.fixture(scope="module")
def outcomes():
    """The number of cases by outcome."""
    count = Counter()
    yield count
    print(count)
    if count.total() >= FEW:
        assert count["map"] >= MAPS_AT_LEAST * count.total(), count


@pytest.mark.parametrize("seed", lanes.slow_but(range(FIRST, FIRST + FEW), range(FIRST, LAST)))
def test_random_layers_end_in_a_map_or_an_error_message(seed, tmp_path, outcomes):
    result = outcome.of_bake(*layered_scenes.make(seed), tmp_path)
    outcomes["message" if isinstance(result, str) else "map"] += 1
    print(result if isinstance(result, str) else result.warnings)
