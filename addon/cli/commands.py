# SPDX-License-Identifier: GPL-3.0-or-later
"""The commands of the command line, as one table: the options that each takes, and which of those of a bake it has no use for.

A command that bakes takes the options of a bake beside its own. `arguments` reads both.
"""

import argparse
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from ..core.asset_limits import A_METER, AUTO, CRUMBS, HOLES, TRIANGLES
from ..core.declarations.choices import Symmetry
from ..core.naming import did_you_mean
from . import option_types
from .options import FILE, JOBS, OPTIONS, RUN_OPTIONS, RUN_TITLE, CommandOption
from .run_report import GATE, NO_MACHINE, STDOUT


class WrongUsage(Exception):
    """The arguments are unknown or contradict each other. The text is for the user, without a full stop."""


class Parser(argparse.ArgumentParser):
    """A parser that raises WrongUsage, and ends no process."""

    known: Collection[str] = ()
    """Options without their dashes that an unknown one may stand for."""

    def error(self, message: str):
        unknown = re.match("unrecognized arguments: --([^ =]+)", message)
        similar = did_you_mean([unknown[1]], self.known) if unknown else ""  # dashes do not count as similar
        raise WrongUsage(message + similar.replace("'", "'--", 1))


@dataclass(frozen=True, eq=False)
class Command:
    """A command, and what it takes."""

    name: str
    """The first word of a call; empty for a bake."""
    description: str
    """What it does, for its --help."""
    groups: Mapping[str, Mapping[str, CommandOption]]
    """Its own options without their dashes, by the titles of their groups in --help; those below an empty title have none."""
    usage: str | None = None
    """How it is called, where argparse cannot tell."""
    epilog: str | None = None
    """What --help ends with."""
    positional: str = ""
    """The one of its options that stands without a name."""
    refused: tuple[str, ...] = ()
    """Options of a bake and of a run that it has no use for, by the names of their values."""
    refusal: str = ""
    """What is said of those that are given, for which {} stands. Without a full stop."""
    ignored: tuple[str, ...] = ()
    """As `refused`, but job files may have them."""

    @property
    def options(self) -> dict[str, CommandOption]:
        """All its own options that have names."""
        every = {name: option for group in self.groups.values() for name, option in group.items()}
        return {name: option for name, option in every.items() if name != self.positional}

    def parser(self, program: str, *, known: Collection[str] = (), has_help: bool = True) -> Parser:
        """The parser of its own options. It raises WrongUsage. known: as in Parser."""
        result = Parser(
            prog=program,
            usage=self.usage,
            description=self.description,
            epilog=self.epilog,
            allow_abbrev=False,
            add_help=has_help,
        )
        result.known = known
        for title, options in self.groups.items():
            group = result.add_argument_group(title) if title else result
            for name, option in options.items():
                group.add_argument(name if name == self.positional else f"--{name}", **option.arguments)
        return result


OF_RAYS = ("method", "hit", "extrusion", "max_distance", "directions", "facing_only", "offset_group", "straight_group")
"""Options without an effect where no ray is cast."""

BAKE = Command(
    "",
    "Bake the detail of high-poly meshes into maps of a low-poly mesh.",
    {
        title: {"file": FILE, "jobs": JOBS, **options} if title == "what to bake" else options
        for title, options in (*OPTIONS.items(), (RUN_TITLE, RUN_OPTIONS))
    },
    "%(prog)s [FILE ...] --low NAME [--high NAME ...] --output MAP [option ...]\n"
    "       %(prog)s MESH ... --output MAP [option ...]\n"
    "       %(prog)s [FILE ...] --pairs [DIR] --output MAP [option ...]\n"
    "       %(prog)s FILE.blend --set NAME [option ...]\n"
    "       %(prog)s --low-file FILE --high-file FILE ... --output MAP [option ...]\n"
    "       %(prog)s [FILE ...] --low NAME --convert MAP --output MAP [option ...]\n"
    "       %(prog)s --jobs FILE [--report REPORT.json] [option ...]",
    positional="file",
)
RUN = Command("", "", {"": {"jobs": JOBS, "report": OPTIONS["output"]["report"], **RUN_OPTIONS}})
"""The options of the run of a job file; others override all its sets."""
CONVERT = Command(
    "",
    "",
    {},
    refused=(
        *("high_file", "cage", "cage_file", "pairs", "pack_uvs", "frames", "normal", "maps", "pack", "texture_sets"),
        *("vertex_domain", "connect_maps", "one_material", "mask", "targets"),
    ),
    refusal="--convert converts one normal map: leave out {}",
    ignored=("size", "samples", "adaptive", *OF_RAYS),
)
"""A bake with --convert, which no word of its own begins."""
LOD = Command(
    "lod",
    "Make levels of detail of one mesh: for each limit the coarsest mesh with the same UV layout that, with its map, stays "
    "within the limit on 99 % of the map's texels.",
    {
        "": {
            "degrees": CommandOption(
                "The largest angles between the normals that each level shows with its map and those of the mesh",
                {"metavar": "1,2,4"},
                "1,2,4, without --distance",
            ),
            "distance": CommandOption(
                "The largest distances of each level from the mesh, in percent of the longest side of its box; one for all "
                "levels, or one for each",
                {"metavar": "0.5,1,2"},
                "1",
            ),
            "triangles": CommandOption(
                "In place of limits, how many triangles each level has, or its share of those of the mesh",
                {"metavar": "50%,25%,500"},
            ),
        }
    },
    "%(prog)s [FILE ...] --low NAME --output MAP [--degrees 1,2,4] [--distance 1] [option ...]\n"
    "       %(prog)s --low-file FILE --output MAP [--degrees 1,2,4] [--distance 1] [option ...]\n"
    "       %(prog)s ... --output MAP --triangles 50%%,25%%,500 [option ...]",
    "Other options are those of a bake, as --size, --basis, --save-blend, --report and --untrusted: see `bake --help`. "
    "--output has {low}, which stands for the level's name.",
    refused=(
        *(
            "jobs",
            "set",
            "part",
            "high",
            "cage",
            "pairs",
            "high_file",
            "cage_file",
            "frames",
            "high_up",
            "convert",
            "workers",
        ),
        "one_material",
        *OF_RAYS,
    ),
    refusal="{} is not for lod, which makes coarser meshes of one mesh",
)
ASSET = Command(
    "asset",
    "Make a game asset of high meshes: a low mesh with a UV map, its maps, and a file for an engine.",
    {
        "": {
            "triangles": CommandOption(
                f"How many triangles the low mesh has (default: at most {TRIANGLES}); with --degrees or --distance, the "
                "most",
                {"metavar": "N"},
            ),
            "degrees": CommandOption(
                "The shading error that 99 % of the pixels may have, seen from all sides: the fewest triangles within it are "
                "searched",
                {"metavar": "DEGREES"},
            ),
            "distance": CommandOption(
                "How far 99 % of the surfaces may be apart, in percent of the longest side of the box: the fewest triangles "
                "within it are searched",
                {"metavar": "PERCENT"},
            ),
            "levels": CommandOption(
                "How many levels of detail follow, each with half the triangles of the one before it, or twice its limits",
                {"type": int, "default": 0, "metavar": "N"},
            ),
            "own-textures": CommandOption(
                "Give each level a UV map and textures of its own, in place of those of the low mesh",
                {"action": "store_true"},
            ),
            "stack-mirrored": CommandOption(
                "Unwrap mirrored halves and equal parts onto the same place of the UV map",
                {"action": "store_true"},
            ),
            "density-group": CommandOption(
                "Vertex group whose mean weight on a UV island scales its texel density: 0 halves it, 0.5 changes nothing, 1 "
                "doubles it",
                {"default": "", "metavar": "NAME"},
            ),
            "crumbs": CommandOption(
                "Leave out parts below this share of the largest one, and floating ones below 6 times it; 0 keeps all",
                {"default": str(CRUMBS), "metavar": "PERCENT"},
                str(CRUMBS),
            ),
            "holes": CommandOption(
                "Fill holes below this share of the largest part, and ragged ones below 6 times it; 0 keeps all",
                {"default": str(HOLES), "metavar": "PERCENT"},
                str(HOLES),
            ),
            "symmetry": CommandOption(
                "Make the low mesh equal to its mirror image along an axis of the world; auto if the high mesh does",
                {"choices": [each.value.lower() for each in Symmetry], "default": "auto"},
                "auto",
            ),
            "quads": CommandOption("Make the low mesh of quads, by QuadriFlow", {"action": "store_true"}),
            "keep": CommandOption(
                "Give the mesh itself UVs and maps, with all its triangles, and make no low mesh",
                {"action": "store_true"},
            ),
            "size": CommandOption(
                f"Of the maps: {AUTO} for texels as small as the high meshes' triangles, 512{A_METER} for at "
                "least 512 texels a meter, or as for `bake`",
                {"metavar": "auto"},
            ),
        }
    },
    "%(prog)s FILE ... [--high NAME ...] --export out.glb [--triangles 5000] [--degrees 2]\n"
    "                  [--distance 0.5] [--levels 2] [option ...]\n"
    "       %(prog)s FILE ... --low NAME [--high NAME ...] --export out.glb [option ...]",
    "Without --high, all visible meshes of the files are high. A low mesh that is there, and its UV map, are kept. "
    "Without --output, maps go beside the file of --export. Other options are those of a bake, as --maps, --basis, "
    "--save-blend, --report and --strict: see `bake --help`.",
    refused=(
        "jobs",
        "set",
        "part",
        "cage",
        "pairs",
        "low_file",
        "high_file",
        "cage_file",
        "frames",
        "high_up",
        "convert",
        "workers",
    ),
    refusal="{} is not for asset, which makes the low mesh of its FILEs",
)
CHECK = Command(
    "check",
    "",
    {},
    refused=("jobs", "convert", "set"),
    refusal="check looks at the high meshes of one bake: give a FILE with --low and --high, or mesh files",
)
"""A look at the high meshes of a bake. It has the --help of a bake."""
FARM = Command(
    "farm",
    "Send a job file to a render farm. All its machines must see the file and what it names.",
    {
        "": {
            "jobs": CommandOption("job file, .toml or .json", {"type": option_types.path, "metavar": "JOBS"}),
            "flamenco": CommandOption(
                "Address of the Flamenco Manager, as http://flamenco.local:8080",
                {"type": option_types.text, "required": True, "metavar": "URL"},
            ),
            "shards": CommandOption("Number of parts, each a task", {"type": option_types.count, "metavar": "N"}, "16"),
            "force": CommandOption("Bake again what is already done", {"action": "store_true"}),
            "untrusted": CommandOption(
                "Bake files of other people, as bake --untrusted does on each machine; needs --records DIR in --options",
                {"action": "store_true"},
            ),
            "options": CommandOption(
                "Further options for all bakes, as one text, with absolute paths",
                {"type": option_types.text, "metavar": "TEXT"},
                "none",
            ),
            "reports": CommandOption(
                "Folder for reports and logs",
                {"type": option_types.path, "metavar": "DIR"},
                "beside the job file, with -reports after its name",
            ),
            "command": CommandOption(
                "What starts Imprint on the machines of the farm",
                {"type": option_types.text, "metavar": "TEXT"},
                "Blender with the extension",
            ),
            "name": CommandOption(
                "Name of the job", {"type": option_types.text, "metavar": "TEXT"}, "that of the job file"
            ),
            "priority": CommandOption(
                "Priority of the job", {"type": option_types.count, "default": 50, "metavar": "N"}, "50"
            ),
        }
    },
    positional="jobs",
    # The tasks of a farm have these already.
    refused=("jobs", "shard", "resume", "changed", "force", "report", "log", "list", "check"),
    refusal="--options: leave out {}, which the tasks of a farm have already",
)
REPORT = Command(
    "report",
    "Put the reports of the parts of a job file together, say which bakes are missing, and end with the exit code that one "
    "call for all bakes would have had.",
    {
        "": {
            "reports": CommandOption("", {"nargs": "+", "type": option_types.path, "metavar": "IN.json"}),
            "merge": CommandOption(
                f"Write one report of all bakes; {STDOUT} stands for standard output",
                {"type": option_types.path, "metavar": "OUT.json"},
                "none",
            ),
            "sheet": CommandOption(
                "Write a page for a browser, with a row for each bake, and its picture if --pictures kept it",
                {"type": option_types.page, "metavar": "OUT.html"},
                "none",
            ),
        }
    },
    "%(prog)s [--merge OUT.json] [--sheet OUT.html] IN.json ...",
    positional="reports",
)
GPU = Command(
    "gpu",
    "Test the GPU: what it is, whether its driver does what Imprint relies on, whether small bakes of all kinds are right, and "
    f"how fast it is. Ends with 0 if all is right, {GATE} if not, {NO_MACHINE} without a GPU.",
    {
        "": {
            "report": CommandOption(
                f"Write what was found as JSON; {STDOUT} stands for standard output",
                {"type": option_types.path, "metavar": "OUT.json"},
                "none",
            ),
            "row": CommandOption("Print the row for the table in docs/platforms.md", {"action": "store_true"}),
        }
    },
)
MCP = Command(
    "mcp",
    "Serve agents by the Model Context Protocol over the standard streams: the tools check, bake, asset, report and picture.",
    {
        "": {
            "root": CommandOption(
                "Folder that all files are in which are read and written",
                {"type": option_types.path, "required": True, "metavar": "DIR"},
            ),
            "untrusted": CommandOption(
                "Bake files of other people, as bake --untrusted does, into the folder out of the root",
                {"action": "store_true"},
            ),
            "timeout": CommandOption(
                "End a call that takes longer",
                {"type": option_types.seconds, "metavar": "SECONDS"},
                "1800",
            ),
        }
    },
)
COMMANDS = {each.name: each for each in (BAKE, LOD, ASSET, CHECK, FARM, REPORT, GPU, MCP)}
"""By the first word of a call."""
