# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes settings from options."""

import argparse
import os
from dataclasses import fields

from ...core import file_formats, udim
from ...core.conversion.stored_normals import StoredNormals
from ...core.declarations.choices import Storage
from ...core.errors import BakeError
from ...core.settings import PART_OF, Settings


def settings(options: argparse.Namespace) -> Settings:
    """The settings of the bake. The map goes to a file, of the format's usual depth if no depth is given."""
    given = vars(options)
    values = {name: given[name] for name in PART_OF if name in given}
    values["width"], values["height"] = options.size
    values["storage"], values["output"] = Storage.FILE, os.path.abspath(options.output)
    values["udim"] = options.udim or bool(options.tiles) or udim.TOKEN in options.output
    if options.depth is None:
        values["depth"] = file_formats.usual_depth(options.output)
    return Settings(**values)


def stored_normals(options: argparse.Namespace) -> StoredNormals:
    """What the map to convert means."""
    return StoredNormals(**{field.name: vars(options)[field.name] for field in fields(StoredNormals)})


def fault(options: argparse.Namespace) -> str:
    """What is wrong with the settings, without a full stop, or ""."""
    try:
        settings(options).check()
        stored_normals(options).check()
    except BakeError as error:
        return str(error).rstrip(".")
    return ""
