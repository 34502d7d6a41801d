# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the names of the files of many bakes, which are made once for each kind of bake, are those that each bake writes.

The seed is in the test's name.
"""

import random
from dataclasses import replace

import pytest

from addon.cli.plan import map_files
from addon.cli.usage import arguments
from addon.core.names import file_names
from addon.output.files import planned_files

STARTS = "", "T_", "t_", "rock", "T_rock", "{low}", "T_{low}", "é", "a.b", ".", "a\nb"
ENDS = (
    "",
    "_N",
    "N",
    "_n",
    "_normal",
    ".Normal",
    "-NORMAL",
    " normal",
    "normal",
    "_ddn",
    "_normals",
    "_normal_N",
    "_N_normal",
)
NUMBERS = "", "", "", ".<UDIM>", "_<UDIM>", ".1001"
ENDINGS = ".png", ".exr", ".TIF", ".tga"
MORE = (
    ["--maps", "ao,height,base-color"],
    ["--no-normal", "--maps", "curvature"],
    ["--mask"],
    ["--pack", "unreal"],
    ["--udim"],
    ["--tiles", "1001,1003"],
    ["--mip-files"],
    ["--size", "32x8"],
    ["--samples", "4"],
)


@pytest.mark.parametrize("seed", range(8))
def test_the_files_of_a_bake_are_those_that_its_settings_name(seed):
    rng = random.Random(seed)
    names = set()
    for _ in range(150):
        name = "".join(map(rng.choice, (STARTS, ENDS, NUMBERS))) or "_N"
        output = f"/maps/{name}{rng.choice(ENDINGS)}"
        more = [word for words in rng.sample(MORE, rng.randrange(4)) for word in words]
        low = rng.choice(("rock", "T_rock", "a_N", "b_normal"))
        options = arguments.parse(["--low", low, "--output", output, *more])
        settings = replace(arguments.settings(options), output=file_names.fill(output, low))
        found = list(map_files.files(options, low))
        assert found == list(planned_files.files(settings)), (output, low, more)
        names.update(path for path, _ in found)
    assert len(names) > 200
