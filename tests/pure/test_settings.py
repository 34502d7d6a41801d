# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which settings are accepted, and the messages for the others."""

import dataclasses

import pytest

from addon.core import file_formats
from addon.core.declarations.map_settings import MAX_SIZE, MIN_SIZE
from addon.core.errors import BakeError
from addon.core.settings import Settings

GOOD = [
    {},
    {"width": MIN_SIZE, "height": MAX_SIZE},
    {"space": "OBJECT", "green": "-Y", "basis": "MIKKTSPACE", "modifiers": "VIEWPORT"},
    {"space": "WORLD", "margin": 0},
    {"margin": MAX_SIZE},
    *({"storage": storage, "depth": depth} for storage in ("PACK", "MEMORY") for depth in (8, 16, 32)),
    *(
        {"storage": "FILE", "output": f"m{end}", "depth": depth}
        for end, file_format in file_formats.BY_ENDING.items()
        for depth in file_format.depths
    ),
    {"storage": "FILE", "output": "//MAP.PNG"},
    {"storage": "PACK", "output": "notes.txt"},  # ignored
    {"udim": True, "tiles": (1001, 2000)},
    {"storage": "FILE", "output": "//100%/map.png"},
]
BAD = [
    *({side: size} for side in ("width", "height") for size in (-1, 0, MIN_SIZE - 1, MAX_SIZE + 1)),
    {"margin": -1},
    {"margin": MAX_SIZE + 1},
    {"udim": True, "tiles": (1000,)},
    {"udim": True, "tiles": (2001,)},
    {"method": "flatten"},
    {"space": ""},
    {"basis": "XNORMAL"},
    {"green": "+y"},
    {"modifiers": "NONE"},
    {"storage": "DISK"},
    {"depth": 0},
    {"depth": 24},
    {"storage": "FILE"},
    {"storage": "FILE", "output": "map"},
    {"storage": "FILE", "output": "map.tga"},
    {"storage": "FILE", "output": "map.png", "depth": 32},
    {"storage": "FILE", "output": "map.exr", "depth": 8},
    {"storage": "FILE", "output": "//100%/map.png", "udim": True},
]


@pytest.mark.parametrize("values", GOOD, ids=str)
def test_valid_settings_are_accepted_unchanged(values):
    settings = Settings(**values)
    settings.check()
    assert {name: settings.flat()[name] for name in values} == values


@pytest.mark.parametrize("values", BAD, ids=str)
def test_invalid_settings_are_named_in_the_message(values):
    with pytest.raises(BakeError) as refused:
        Settings(**values).check()
    message = str(refused.value)
    assert message.endswith(".")
    assert "\n" not in message
    assert "(" not in message  # no Python tuple
    # The message quotes the value, unless it is empty.
    invalid = {name: value for name, value in values.items() if name not in {"storage", "output", "udim"}}
    assert all(str(value).strip("(,)") in message for value in invalid.values())


def test_settings_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Settings().sampling.width = 32


@pytest.mark.parametrize(
    ("basis", "engine", "read"),
    [
        ("AUTO", "CYCLES", "CYCLES"),
        ("AUTO", "BLENDER_EEVEE", "MIKKTSPACE"),
        ("AUTO", "BLENDER_WORKBENCH", "MIKKTSPACE"),
        ("AUTO", "SOMEBODYS_OWN", "MIKKTSPACE"),
        ("CYCLES", "BLENDER_EEVEE", "CYCLES"),
        ("MIKKTSPACE", "CYCLES", "MIKKTSPACE"),
    ],
)
def test_the_automatic_basis_follows_the_render_engine(basis, engine, read):
    assert Settings(basis=basis).read_by(engine).map.basis == read
    assert Settings().map.basis == "AUTO"
