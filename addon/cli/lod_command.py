# SPDX-License-Identifier: GPL-3.0-or-later
"""The arguments of the command `lod`: a chain of levels of detail from one mesh, each with its map. Without Blender."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from ..core import levels, naming
from ..core.errors import BakeError
from . import arguments
from .arguments import WrongUsage

_OF_BAKES = ("jobs", "high", "cage", "pairs", "high_file", "cage_file", "frames", "high_up", "convert", "workers")
"""Options that a chain has no use for."""


def read(words: Sequence[str], program: str) -> argparse.Namespace:
    """The options of the bake that makes the chain: its `levels` are the texts of the limits. Raises WrongUsage."""
    own, rest = _parser(program).parse_known_args(words)
    options = arguments.parse(rest, program)
    defaults = vars(arguments.parse([]))
    wrong = next((name for name in _OF_BAKES if getattr(options, name) != defaults[name]), None)
    if wrong:
        raise WrongUsage(f"--{wrong.replace('_', '-')} is not for lod, which makes coarser meshes of one mesh")
    degrees = own.degrees if own.degrees is not None else "" if own.distance else levels.DEGREES
    options.levels = degrees, levels.PERCENT if own.distance is None else own.distance
    arguments.check(options)
    try:
        count = len(levels.limits(*options.levels))
    except BakeError as error:
        raise WrongUsage(str(error).rstrip(".")) from error
    if count > 1 and naming.LOW not in options.output:
        raise WrongUsage(f"each level has a map: put {naming.LOW} into --output")
    is_one_file = bool(options.export) and naming.LOW not in options.export
    if count > 1 and is_one_file and Path(options.export).suffix.lower() != ".glb":
        raise WrongUsage(f"only .glb has levels in one file: put {naming.LOW} into --export")
    return options


def _parser(program: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=program,
        usage="%(prog)s [FILE ...] --low NAME --output MAP [--degrees 1,2,4] [--distance 1] [option ...]\n"
        "       %(prog)s --low-file FILE --output MAP [--degrees 1,2,4] [--distance 1] [option ...]",
        description="Make levels of detail of one mesh: for each limit the coarsest mesh with the same UV layout that, with "
        "its map, stays within the limit on 99 % of the map's texels.",
        epilog="Other options are those of a bake, as --size, --basis, --save-blend, --report and --untrusted: see `bake "
        "--help`. --output has {low}, which stands for the level's name.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--degrees",
        default=None,
        metavar="1,2,4",
        help="The largest angles between the normals that each level shows with its map and those of the mesh (default: "
        "1,2,4, without --distance)",
    )
    parser.add_argument(
        "--distance",
        default=None,
        metavar="0.5,1,2",
        help="The largest distances of each level from the mesh, in percent of the longest side of its box; one for all "
        "levels, or one for each (default: 1)",
    )
    return parser
