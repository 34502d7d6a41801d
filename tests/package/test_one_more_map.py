# SPDX-License-Identifier: GPL-3.0-or-later
"""Adds maps to a copy of the extension, in at most four files each, and bakes them: all of the rest stays as it is."""

import shutil
import subprocess
import sys

import pytest

from scripts.imprint import ROOT

COPIED = "__init__.py", "blender_manifest.toml", "pyproject.toml", "addon", "shaders", "scripts", "tests"
MOST_FILES = 4
"""Of the extension. What translators and tests add comes on top."""
MAP_TYPES, FAMILIES = "addon/core/map_types.py", "addon/engine/map_families.py"
AT_THE_END = "    GRADIENT,\n)\n"
"""Of OTHERS in the map types."""

# A map of a family that exists, with a setting: the position map's formula with another matrix.
STRIPES = {
    MAP_TYPES: {
        AT_THE_END: """    GRADIENT,
    MapType(
        "STRIPES",
        "Stripes",
        "Stripes along the Gradient Axis",
        Kind.VALUE,
        "stripes",
        index=9,
        settings={
            "stripe_count": WholeNumber(label="Stripe Count", tooltip="Number of stripes", default=4, least=1, most=64)
        },
    ),
)
""",
        "import Choice,": "import WholeNumber, Choice,",
    },
    FAMILIES: {
        "        if GRADIENT.name in names:": '        if {GRADIENT.name, "STRIPES"} & set(names):',
        "or (self.to_space, self.origin)\n": """or (self.to_space, self.origin)
            if name == "STRIPES":
                to_space, origin = (self.stripe_count * each for each in self.gradient)
""",
        "        self.gradient = None\n": """        self.gradient = None
        self.stripe_count = run.settings.map.stripe_count
""",
    },
    "shaders/bake/height_position_ids_frag.glsl": {
        "const int INDEX_GRADIENT = 8;\n": "const int INDEX_GRADIENT = 8;\nconst int INDEX_STRIPES = 9;\n",
        "  else if (map_index == INDEX_HEIGHT) {\n": """  else if (map_index == INDEX_STRIPES) {
    value = fract(mat3(to_space) * point + origin.xyz);
  }
  else if (map_index == INDEX_HEIGHT) {
""",
    },
}
BAKES_STRIPES = """
    settings = {"gradient_axis": "X", "stripe_count": 3, "pack": "CUSTOM", "pack_green": "STRIPES"}
    report, found = maps.bake_all_maps(*planes(), maps=["STRIPES"], size=SIDE, **settings)
    expected = np.mod(3.0 * maps.texel_uv(SIDE, SIDE)[..., 0], 1.0)
    assert np.abs(found["stripes"][..., 0] - expected).max() < 1e-5
    assert np.array_equal(found["packed"][..., 1], found["stripes"][..., 0])
    assert list(CHOICES)[-1] == "STRIPES"
    is_shown("STRIPES", "stripe_count", "--stripe-count")
"""

# A family of its own: a pass with its shader, what draws its maps, and a setting.
FACING = {
    MAP_TYPES: {
        AT_THE_END: """    GRADIENT,
    MapType(
        "FACING",
        "Facing",
        "How far the high surface points up",
        Kind.VALUE,
        "facing",
        family=Family.FACING,
        settings={"facing_power": WholeNumber(label="Facing Power", tooltip="Its power", default=1, least=1, most=9)},
    ),
)
""",
        "import Choice,": "import WholeNumber, Choice,",
        '    SLOPES = "': '    FACING = "the normals and their direction"\n    SLOPES = "',
    },
    "addon/passes/facing.py": """# SPDX-License-Identifier: GPL-3.0-or-later
\"\"\"How far normals point up.\"\"\"

from __future__ import annotations

from . import target
from .shader import Program

FACING = Program(
    vertex="lib/fullscreen_vert.glsl",
    fragment="bake/facing_frag.glsl",
    inputs=(("VEC2", "position"),),
    texels=(("RGBA32F", "FLOAT_2D", "normals"),),
    constants=(("FLOAT", "power"),),
    outputs=(("VEC4", "value_out"),),
)


def draw(into: target.Target, normals, power: float) -> None:
    target.fill(into, FACING, normals=normals, power=power)
""",
    "shaders/bake/facing_frag.glsl": """// Writes how far normals point up.
void main()
{
  vec4 normal = texel_at(normals, ivec2(gl_FragCoord.xy));
  value_out = vec4(vec3(pow(max(normal.z, 0.0), power)) * max(normal.a, 0.0), normal.a);
}
""",
    FAMILIES: {
        "from ..passes import cast,": "from ..passes import facing, cast,",
        "FLAT = 1e-6\n": """class FacingMaps(MapFamily):
    family = Family.FACING
    effort = 0.1

    def __init__(self, names: Sequence[str], inputs: FamilyInputs):
        self.means = [Mean(name) for name in names]
        self.power = float(inputs.run.settings.map.own(BY_NAME["FACING"])["facing_power"])

    def add(self, drawn: Sequence[Sample]) -> Task[None]:
        for sample in drawn:
            for mean in self.means:
                mean.add(sample, lambda into: facing.draw(into, sample.normals.texture, self.power))
        yield from ()

    def finished(self, band: Band, _known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        for mean in self.means:
            yield mean.name, mean.texture(band)


FLAT = 1e-6
""",
    },
}
BAKES_FACING = """
    for samples in (1, 4):
        settings = {"facing_power": 2, "samples": samples, "space": "WORLD"}
        report, found = maps.bake_all_maps(*planes(slope=1.0), maps=["FACING", "HEIGHT"], size=SIDE, **settings)
        assert np.abs(found["facing"][..., 0] - 0.5).max() < 1e-5
    is_shown("FACING", "facing_power", "--facing-power")
"""

TEST = """
import bpy
import numpy as np

from addon.cli import arguments
from addon.core.declarations.all_settings import DECLARED
from addon.core.settings import Settings
from tests.support import maps, scenes
from tests.support.panel import use
from tests.support.panel_layout import draw

SIDE = 32
CHOICES = DECLARED["pack_green"].values


def planes(slope=0.0):
    return scenes.planes("low", "high", height=0.1, slope=slope)


def is_shown(name, setting, option):
    low, high = (bpy.data.objects[each] for each in ("low", "high"))
    settings = use(low, high, size=16, method="CAST", material=False)
    assert setting not in draw().order
    setattr(settings, f"bakes_{{name.lower()}}", True)
    assert setting in draw().order
    assert settings.to_settings() == Settings.of_json(settings.to_settings().flat())
    words = ["--low", "low", "--maps", name.lower(), option, "7", "--output", "m.png"]
    given = arguments.settings(arguments.parse(words)).map
    assert given.maps == (name,) and getattr(given, setting) == 7


def test_it_is_baked_and_shown(registered, gpu_context):
{bakes}
"""


def changed(folder, files):
    """Change files of the copy in a folder."""
    for name, change in files.items():
        path = folder / name
        if isinstance(change, str):
            assert not path.exists()
            path.write_text(change, encoding="utf-8")
            continue
        text = path.read_text(encoding="utf-8")
        for old, new in change.items():
            assert text.count(old) == 1, (name, old)
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("files", "bakes"), [(STRIPES, BAKES_STRIPES), (FACING, BAKES_FACING)], ids=["of a family", "a family"]
)
def test_one_more_map_takes_at_most_four_files(tmp_path, files, bakes):
    assert len(files) <= MOST_FILES
    for name in COPIED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copyfile
        copy(ROOT / name, tmp_path / name)
    changed(tmp_path, files)
    (tmp_path / "tests" / "test_more.py").write_text(TEST.format(bakes=bakes), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "not manuals_tables"]
    more = "tests/test_more.py", "tests/pure/test_settings.py", "tests/pure/test_layers.py"
    done = subprocess.run([*command, *more], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
