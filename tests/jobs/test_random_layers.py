# SPDX-License-Identifier: GPL-3.0-or-later
"""Random surfaces that lie near each other, mostly broken: each bake ends in a map of finite numbers, or in one message.

The seed is in the test's name. For other seeds: IMPRINT_RANDOM=1000:5000 pytest tests/jobs/test_random_layers.py
"""

import pytest

from tests.support import layered_scenes, outcome, random_cases

pytestmark = pytest.mark.usefixtures("gpu_context")

outcomes = random_cases.counted(20, map=0.8)


@random_cases.seeds(200, fast=12)
def test_random_layers_end_in_a_map_or_an_error_message(seed, tmp_path, outcomes):
    result = outcome.of_bake(*layered_scenes.make(seed), tmp_path)
    outcomes["message" if isinstance(result, str) else "map"] += 1
    print(result if isinstance(result, str) else result.warnings)
