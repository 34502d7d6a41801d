# SPDX-License-Identifier: GPL-3.0-or-later
"""The tools of the Model Context Protocol server, as functions that need no protocol: each is a call of the command line.

Paths stay below one folder, and what a client gives wrong is answered by a sentence.
"""

import difflib
import json
import os
import subprocess
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import UNWRAP_FIRST
from ..core.file_formats import OPENED
from ..core.naming import did_you_mean, printable
from . import interruption, standard_streams, untrusted, worker_process
from .commands import ASSET
from .options import OPTIONS

SECONDS = 1800.0
"""The time limit of a call, unless the caller of the server sets another one."""
GRACE = 60.0
"""Seconds that a process may take beyond the limit, of which the bake itself knows."""
MOST_WORDS = 20_000
"""Characters of an answer: agents read all of it."""
LARGEST_PICTURE = 4 << 20
"""Bytes of a PNG file that is shown."""
NEAR = 5
"""Settings that are named in place of one that is not there."""
LARGEST_NUMBER = 1 << 53
"""Of a number that is given, without its sign."""
_PNG = b"\x89PNG\r\n\x1a\n"
_NOT_SETTINGS = {
    *("low", "high", "scene", "pairs", "set", "part", "pack-uvs", "frames", "convert", "image", "no-material"),
    *("one-material", "join", "single-user", "save-blend", "report", "texture-sets", "vertex-domain", "connect-maps"),
}
"""Options of a bake that are arguments of the tools, or have no use for them."""


class Refused(Exception):
    """What a client asks for cannot be done. The text is one sentence for it."""


@dataclass(frozen=True)
class Answer:
    """What a client gets.

    Attributes:
        text: Plain text or JSON.
        png: A picture, or nothing.
        is_error: Whether the call did not do what was asked for.
    """

    text: str
    png: bytes = b""
    is_error: bool = False


@dataclass(frozen=True)
class Place:
    """Where a server works.

    Attributes:
        root: The folder that all paths are in, absolute and without links.
        untrusted: Whether the files are those of other people, and are baked in a sandbox.
        seconds: The time limit of a call.
    """

    root: str
    untrusted: bool = False
    seconds: float = SECONDS

    @property
    def outputs(self) -> str:
        """The folder in which files are written."""
        return os.path.join(self.root, untrusted.OUTPUT) if self.untrusted else self.root

    def path(self, name: str, title: str, *, is_written: bool = False) -> str:
        """The absolute path of what a client names. Raises Refused for one that is elsewhere, after its links."""
        folder, does = (self.outputs, "writes into") if is_written else (self.root, "works in")
        path = os.path.realpath(os.path.join(self.root, name))
        if path == folder or not untrusted.is_below(path, folder):
            raise Refused(f"{title}: {name!r} is not in {folder!r}, the folder that this server {does}.")
        return path

    def read(self, name: str, title: str) -> str:
        """As `path`, of a file that is there."""
        path = self.path(name, title)
        if not os.path.isfile(path):
            raise Refused(f"{title}: there is no file {name!r} in {self.root!r}.")
        return path

    def check_beside(self, output: str) -> None:
        """Raise Refused if something in the folder of `output` leads out of this place: files that are written beside it
        would replace what a link there leads to."""
        folder = untrusted.fixed_folder(output)
        folders = [folder, _pictures(output), os.path.join(folder, "textures")]  # the last one of USD
        if folder != os.path.dirname(output):
            folders = [each for each, *_ in os.walk(folder)]
        for each in filter(os.path.isdir, folders):
            for name in os.listdir(each):
                if not untrusted.is_below(os.path.realpath(os.path.join(each, name)), self.outputs):
                    raise Refused(
                        f"{_shown(name)} in {each!r} is a link that leads out of {self.outputs!r}, the folder that this "
                        "server works in: choose a folder without such links for what is written."
                    )

    def sandbox(self) -> list[str]:
        """The options that a bake needs if its files are not trusted."""
        if not self.untrusted:
            return []
        return ["--untrusted", f"--input-folder={self.root}", f"--output-folder={self.outputs}"]


@dataclass(frozen=True)
class Tool:
    """A tool.

    Attributes:
        about: What it does, for the agent.
        properties: What it takes, as JSON Schema.
        required: Those that must be given.
        run: Does it.
    """

    about: str
    properties: Mapping[str, dict[str, Any]]
    required: tuple[str, ...]
    run: Callable[[Place, dict[str, Any]], Answer]

    @property
    def schema(self) -> dict[str, Any]:
        """The JSON Schema of the arguments."""
        known = {"type": "object", "properties": dict(self.properties), "required": list(self.required)}
        return {**known, "additionalProperties": False}


def call(place: Place, name: Any, arguments: Any) -> Answer:
    """Do what a client asks for, or say in a sentence why not."""
    try:
        tool = TOOLS.get(name) if isinstance(name, str) else None
        if tool is None:
            raise Refused(f"There is no tool {_shown(name)}: there are {', '.join(TOOLS)}.")
        return tool.run(place, _checked(tool, {} if arguments is None else arguments))
    except Refused as refused:
        return Answer(str(refused), is_error=True)


def _shown(value: Any) -> str:
    try:
        text = printable(repr(value))
    except ValueError:  # Python writes no integer of more than 4,300 digits
        text = "a number of thousands of digits"
    return text if len(text) <= 80 else f"{text[:77]}..."


_KINDS = {"string": str, "integer": int, "number": (int, float), "array": list, "object": dict}


def _checked(tool: Tool, arguments: Any) -> dict[str, Any]:
    """The arguments, if they are as the schema says. Raises Refused."""
    if not isinstance(arguments, Mapping):
        raise Refused(f"The arguments are {_shown(arguments)}, not an object.")
    for name, value in arguments.items():
        if name not in tool.properties:
            similar = did_you_mean([str(name)], tool.properties)
            hint = similar or f": there are {', '.join(tool.properties)}."
            raise Refused(f"There is no argument {_shown(name)}{hint}")
        kind = tool.properties[name]["type"]
        if not isinstance(value, _KINDS[kind]) or isinstance(value, bool):
            raise Refused(f"{name}: {_shown(value)} is no {kind}.")
        if isinstance(value, int | float):
            _check_number(name, value)
        for text in [name, value] if kind == "string" else value if kind == "array" else []:
            _check_text(name, text)
    for name in tool.required:
        if arguments.get(name) in (None, "", []):
            raise Refused(f"{name} is missing: {tool.properties[name]['description']}.")
    return dict(arguments)


def _check_number(name: str, value: float) -> None:
    """Raise Refused for a number that no setting can be. NaN is left to the command line."""
    if abs(value) > LARGEST_NUMBER:
        raise Refused(f"{name}: {_shown(value)} is too large.")


def _check_text(name: str, value: Any) -> None:
    """Raise Refused for what no argument of a process can be."""
    try:
        is_text = isinstance(value, str) and "\0" not in value and len(os.fsencode(value)) <= 4096
    except UnicodeError:
        is_text = False
    if not is_text:
        raise Refused(f"{name}: {_shown(value)} is not a text of at most 4,096 bytes.")


def _setting_words(options: Mapping[str, Any], known: Sequence[str]) -> list[str]:
    """The words of the command line for settings, by their names there, without dashes. Raises Refused."""
    words = []
    for name, value in options.items():
        key = str(name).strip("-").replace("_", "-")
        if key not in known:
            similar, near = did_you_mean([key], known), difflib.get_close_matches(key, known, NEAR, cutoff=0.0)
            hint = similar or f". Nearest are {', '.join(near)}."
            raise Refused(f"options: there is no setting {_shown(name)} here{hint}")
        values = value if isinstance(value, list) else [value]
        if value is None or value is False:
            continue
        option = _OPTIONS[key]
        if value is True and not option.may_be_flag:
            values = option.parsing.get("metavar") or "as its help says"
            raise Refused(f"options: {key} needs a value, {values}. {option.tooltip}.")
        if value is True:
            words.append(f"--{key}")
            continue
        if not values or not all(isinstance(each, str | int | float) for each in values):
            raise Refused(f"options: {key} of {_shown(value)} is neither a number, a text, a list of them nor true.")
        for each in values:
            if not isinstance(each, str):
                _check_number(f"options: {key}", each)
        text = ",".join(map(str, values))
        _check_text(f"options: {key}", text)
        words.append(f"--{key}={text}")
    return words


SETTINGS = tuple(
    name
    for group in OPTIONS.values()
    for name, option in group.items()
    if not option.is_path and name not in {*_NOT_SETTINGS, *(each for each in OPTIONS["convert map"])}
)
"""The settings that the tools take, as options of the command line without dashes."""
_OPTIONS = {name: option for group in OPTIONS.values() for name, option in group.items()} | ASSET.options
OF_ASSETS = (*SETTINGS, *(name for name in ASSET.options if name not in SETTINGS))


def _run(place: Place, words: Sequence[str]) -> tuple[int, str, str]:
    """Run the command line in a process. Returns the exit code, and what was printed to each stream. Raises Refused."""
    command = [*worker_process.command()[:-1], *words]
    environment = {name: value for name, value in os.environ.items() if name not in interruption.OF_LAUNCHER}
    try:
        done = subprocess.run(
            command,
            cwd=place.root,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=place.seconds + GRACE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise Refused(
            f"It took longer than {place.seconds:g} seconds, and was stopped: ask for smaller maps."
        ) from None
    except OSError as error:
        raise Refused(f"Imprint cannot be started: {error.strerror}.") from error
    said, told = (standard_streams.without_egl(text.decode(errors="replace")) for text in (done.stdout, done.stderr))
    if done.returncode < 0:
        told = f"{told}\nBlender crashed with signal {-done.returncode}.".strip()
    return done.returncode, said, told


def _inputs(place: Place, given: Mapping[str, Any], *, needs_low: bool = False) -> list[str]:
    """The files, and the objects in them, as words. needs_low: whether a .blend needs the name of a low mesh. Raises Refused,
    with the names there are."""
    words = []
    for title, option in (("files", ""), ("low_file", "--low-file="), ("high_files", "--high-file=")):
        names = given.get(title, [])
        for name in names if isinstance(names, list) else [names]:
            path = place.read(name, title)
            if Path(path).suffix.lower() not in OPENED:
                raise Refused(f"{title}: {Path(path).name!r} is no file of these: {', '.join(OPENED)}.")
            words.append(option + path)
    if not words:
        raise Refused("No file is named: give files, or low_file and high_files.")
    scenes = [name for name in given.get("files", ()) if ".blend" in Path(name).suffix.lower()]
    if needs_low and scenes and not given.get("low"):
        _, _, told = _run(place, ["check", *words, *place.sandbox()])
        raise Refused(f"low is missing in {scenes[0]!r}. {told.partition('imprint check: ')[2] or told}")
    named = [f"--low={given['low']}"] if given.get("low") else []
    return [*words, *named, *(f"--high={name}" for name in given.get("high", ()))]


def _check(place: Place, given: dict[str, Any]) -> Answer:
    words = [*_inputs(place, given), *_setting_words(given.get("options", {}), SETTINGS)]
    code, said, told = _run(place, ["check", *words, *place.sandbox()])
    return Answer(_cut(_cured("\n".join(filter(None, (said, told))))) or "Nothing was found.", is_error=code != 0)


def _bake(place: Place, given: dict[str, Any]) -> Answer:
    output = place.path(given["output"], "output", is_written=True)
    words = [f"--output={output}", *_maps(given), *_setting_words(given.get("options", {}), SETTINGS)]
    return _baked(place, [*_inputs(place, given, needs_low=True), *words], output)


def _asset(place: Place, given: dict[str, Any]) -> Answer:
    export = place.path(given["export"], "export", is_written=True)
    limits = [f"--{name}={given[name]}" for name in ("triangles", "degrees") if name in given]
    words = [f"--export={export}", *limits, *_maps(given), *_setting_words(given.get("options", {}), OF_ASSETS)]
    return _baked(place, ["asset", *_inputs(place, given), *words], export)


def _maps(given: Mapping[str, Any]) -> list[str]:
    """The maps and their size, as words."""
    names = [name for name in given.get("maps", ()) if name.lower() != "normal"]
    normal = [] if len(names) < len(given.get("maps", ("normal",))) else ["--no-normal"]
    size = [f"--size={given['size']}"] if "size" in given else []
    return [*([f"--maps={','.join(names)}"] if names else []), *normal, *size]


def _pictures(output: str) -> str:
    """The folder of the pictures that are kept of a bake."""
    return f"{os.path.splitext(output)[0]}.pictures"


def _baked(place: Place, words: list[str], output: str) -> Answer:
    """Bake, and say what came of it. The report and a picture are kept beside the output."""
    base = os.path.splitext(output)[0]
    report, pictures = (
        place.path(name, "output", is_written=True) for name in (f"{base}.report.json", _pictures(output))
    )
    place.check_beside(output)
    own = [f"--report={report}", f"--pictures={pictures}", f"--timeout={place.seconds:g}", *place.sandbox()]
    before = _state(report)
    code, _, told = _run(place, [*words, *own])
    result: dict[str, Any] = {"exit code": code, "messages": told.splitlines()}
    if _state(report) not in (None, before):  # else it is of an earlier call
        bakes = _json(report).get("bakes") or [{}]
        result |= _short(bakes[0]) | {"report": report}
        said = [*result.get("gate", ()), *(text for each in result["measured"] for text in each.get("warnings", ()))]
        result["messages"] = [line for line in result["messages"] if not line.endswith(tuple(said))]
    return Answer(_cut(_cured(json.dumps(result, indent=1))), is_error=code not in (0, 4))


def _cured(text: str) -> str:
    """A text for an agent, for which the cure is a tool."""
    return text.replace(UNWRAP_FIRST, "call asset with files, low and high: it makes UVs and the maps")


def _state(path: str) -> tuple[int, int] | None:
    """What another file at `path` differs in, as each write makes one; None if there is none."""
    if not os.path.isfile(path):
        return None
    status = os.stat(path)
    return status.st_ino, status.st_mtime_ns


def _short(bake: Mapping[str, Any]) -> dict[str, Any]:
    """What an agent has to know of a bake."""
    kept = {name: bake[name] for name in ("state", "error", "gate", "picture") if bake.get(name)}
    kept["files"] = [each["path"] for each in bake.get("files", ())]
    measured = ("triangles", "coverage", "missed", "overlap", "deviation", "targets")
    measured += ("appearance", "asset", "warnings", "notes")
    reports = [{name: each[name] for name in measured if each.get(name, {}) != {}} for each in bake.get("reports", ())]
    return kept | {"measured": reports}


def _report(place: Place, given: dict[str, Any]) -> Answer:
    files = [place.read(name, "reports") for name in given["reports"]]
    code, said, told = _run(place, ["report", "--merge=-", *files])
    try:
        value = json.loads(said)
    except ValueError:
        return Answer(_cut(told) or "These are no reports of Imprint.", is_error=True)
    if len(files) == 1:  # the call is that of the bake
        with suppress(ValueError):  # what a call has left that did not end
            value |= {key: each for key, each in _json(files[0]).items() if key in ("call", "host", "started")}
    for part in filter(None, given.get("key", "").split(".")):
        names = value if isinstance(value, dict) else dict(enumerate(value)) if isinstance(value, list) else {}
        step = int(part) if isinstance(value, list) and part.isdecimal() else part
        if step not in names:
            raise Refused(
                f"key: there is no {part!r} here: there are {', '.join(map(str, names)) or 'no further keys'}."
            )
        value = names[step]
    text = json.dumps(value, indent=1)
    if len(text) > MOST_WORDS:
        parts = list(value) if isinstance(value, dict) else range(len(value))
        raise Refused(f"key: this part is too long to read at once: name a key of it, {', '.join(map(str, parts))}.")
    return Answer(text, is_error=code not in (0, 1, 4))


def _picture(place: Place, given: dict[str, Any]) -> Answer:
    path = place.read(given["path"], "path")
    data = Path(path).read_bytes() if os.path.getsize(path) <= LARGEST_PICTURE else b""
    if not data:
        raise Refused(
            f"path: {given['path']!r} has more than {LARGEST_PICTURE >> 20} MiB: show the picture that its bake kept."
        )
    if not data.startswith(_PNG):
        raise Refused(f"path: {given['path']!r} is no PNG file: show the picture that its bake kept.")
    return Answer(path, png=data)


def _json(path: str) -> dict[str, Any]:
    value = json.loads(Path(path).read_bytes())
    return value if isinstance(value, dict) else {}


def _cut(text: str) -> str:
    return text if len(text) <= MOST_WORDS else f"{text[:MOST_WORDS]}\n(cut)"


def _text(description: str) -> dict[str, Any]:
    return {"type": "string", "description": description}


def _texts(description: str) -> dict[str, Any]:
    return {"type": "array", "items": {"type": "string"}, "description": description}


_OF_FILES = {
    "files": _texts("Paths of a .blend, or of mesh files that are loaded together, below the server's folder"),
    "low": _text("The name of the low mesh in files; asset makes UVs if it has none"),
    "high": _texts("The names of the high meshes in files"),
    "options": {
        "type": "object",
        "description": "Further settings by their names on the command line, as {'samples': 4, 'strict': 'missed<0.1%'}",
    },
}
_OF_BAKE = {
    **_OF_FILES,
    "low_file": _text("In place of files and low: the path of a mesh file with the low mesh alone"),
    "high_files": _texts("In place of files and high: the paths of mesh files with all high meshes"),
}
_OF_MAPS = {
    "maps": _texts(
        "Names of maps: normal, ao, curvature, height, base-color, roughness, metallic and others; else normal"
    ),
    "size": _text("The side of the maps in texels, as 2048; for assets also auto"),
}
TOOLS = {
    "check": Tool(
        "Say what high meshes are, with a low mesh or alone, and what a bake or asset will change of them. Writes nothing.",
        _OF_BAKE,
        (),
        _check,
    ),
    "bake": Tool(
        "Bake the detail of high meshes into maps of a low mesh. No cage and no distance is needed. Answers with files, "
        "measures and warnings; the whole report and a picture are kept beside the maps.",
        {
            **_OF_BAKE,
            **_OF_MAPS,
            "output": _text("The path of the normal map, as maps/rock.png; other maps stand beside it"),
        },
        ("output",),
        _bake,
    ),
    "asset": Tool(
        "Make a game asset of high meshes: a low mesh with UVs, its maps, and a file for an engine. Answers as bake does.",
        {
            **_OF_FILES,
            **_OF_MAPS,
            "export": _text("The path of the file, as out/statue.glb; maps stand beside it"),
            "triangles": {"type": "integer", "description": "How many triangles a new low mesh has; else at most 5000"},
            "degrees": {"type": "number", "description": "The shading error that 99 % of the pixels may have"},
        },
        ("files", "export"),
        _asset,
    ),
    "report": Tool(
        "Read reports that bakes have left, whole or a part.",
        {
            "reports": _texts("Paths of reports, as bake and asset name them"),
            "key": _text("The part to read, as bakes.0.reports.0.targets; else all"),
        },
        ("reports",),
        _report,
    ),
    "picture": Tool(
        "Show a PNG file: a map, or the picture that a bake kept, of its map, the low mesh with it, and its deviation, bright "
        "where the map is wrong by its own green.",
        {"path": _text("The path of the PNG file")},
        ("path",),
        _picture,
    ),
}
"""The tools by their names."""
