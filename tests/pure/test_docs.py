# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the manual: files that it names exist, links work, commands and job files are valid, tables match the code."""

import ast
import functools
import json
import re
import shlex
import tomllib

import pytest

from addon.cli import arguments, job_file, run_report
from addon.cli.commands import ASSET, BAKE, CHECK, COMMANDS, FARM, GPU, LOD, MCP, REPORT
from addon.core.declarations import targets
from scripts import imprint
from scripts.imprint import ROOT
from tests.pure.test_layers import MAY_IMPORT, WITHOUT
from tests.support.manual import PAGES, blocks, inline, names, prose, rows, section

TOP = {path.name for path in ROOT.iterdir()} - {"out", "dist", ".venv"}
"""Files and folders at the top of the repository, except those that commands create."""
MADE = ("out/", "dist/", "../")
"""The beginnings of paths that are not in the repository."""
OTHER_OPTIONS = {
    # Blender's
    *("--background", "--command", "--python", "--python-exit-code", "--factory-startup", "--gpu-backend"),
    *("--window-geometry", "--online-mode"),
    # pytest's, ruff's and git's
    *("--durations", "--fix", "--check", "--oneline"),
    # of the systems' tools
    *("--gpus", "--rm", "--array", "--no-install-recommends"),
    "--help",
}
SHELLS = {"", "sh", "bash", "console"}
"""The languages of blocks with commands."""


def ids(paths):
    return [path.relative_to(ROOT).as_posix() for path in paths]


# Links


def anchors(page):
    """The anchors of the headings of a page, as on GitHub."""
    headings = re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=ids([*PAGES, ROOT / "CHANGELOG.md"]))
def test_the_targets_of_links_exist(page):
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if re.match("https?:|mailto:", target):
            continue
        path, _, anchor = target.partition("#")
        place = (page.parent / path).resolve() if path else page
        if not place.exists() or (anchor and anchor not in anchors(place)):
            broken.append(target)
    assert broken == []


def test_each_page_of_the_manual_is_linked():
    linked = {
        (page.parent / target.partition("#")[0]).resolve()
        for page in PAGES
        for target in re.findall(r"\]\(([^)\s:]+)\)", prose(page))
    }
    pages = [page for page in PAGES if page.name != "README.md" and page.parent.name != "extension"]
    assert [page.name for page in pages if page.resolve() not in linked] == []


# Files


def is_there(name):
    """Whether a path in the repository exists. Paths of code may start below addon/ or shaders/, or be only a file's name."""
    bases = [ROOT, ROOT / "addon", ROOT / "shaders"] if "/" in name else [ROOT]
    if any(any(base.glob(name)) for base in bases):
        return True
    return "/" not in name and any(
        any((ROOT / top).rglob(name)) for top in ("addon", "shaders", "scripts", "tests", "docs")
    )


@pytest.mark.parametrize("page", PAGES, ids=ids(PAGES))
def test_named_files_exist(page):
    text = "\n".join([prose(page), *(block for language, block in blocks(page) if language in SHELLS | {"text"})])
    named = set(re.findall(r"(?<![\w./<{*-])[\w./*-]+\.(?:py|glsl|md)\b", text))
    for code in inline(page):
        top = code.split("/")[0].split("::")[0]
        if re.fullmatch(r"[\w./*-]+", code) and top in TOP:
            named.add(code.rstrip("/"))
    assert sorted(name for name in named if not name.startswith(MADE) and not is_there(name)) == []


# Commands


@functools.cache
def options_in(script):
    """The options in the source of a script."""
    tree = ast.parse(script.read_text(encoding="utf-8"))
    words = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str))
    return {word for word in words if re.fullmatch("--[a-z][a-z-]*", word)}


@functools.cache
def known_options():
    ours = {f"--{name}" for command in COMMANDS.values() for name in command.options}
    ours |= options_in(ROOT / "addon" / "cli" / "arguments.py")
    return ours | OTHER_OPTIONS | {name for script in (ROOT / "scripts").rglob("*.py") for name in options_in(script)}


def commands(page):
    """The commands of a page, as lists of words."""
    for language, text in blocks(page):
        if language in SHELLS:
            for line in text.replace("\\\n", " ").splitlines():
                words = shlex.split(line, comments=True)
                while words and (words[0] == "$" or re.fullmatch(r"\w+=.*", words[0])):
                    words = words[1:]
                if words:
                    yield words
    for code in inline(page):
        if re.match(r"(python3 |blender |\S*imprint\.py )", code):
            yield shlex.split(code)


def bake_arguments(words):
    """The arguments that a command passes to the bake, or None if it does not bake."""
    launcher = [
        number for number, word in enumerate(words) if word.endswith("scripts/imprint.py") or word == "imprint.py"
    ]
    if launcher:
        more = words[launcher[0] + 1 :]
        return more[1:] if more[:1] == ["bake"] else more if more and more[0] in COMMANDS else None
    if words[0] == "imprint":
        return words[2:] if words[1:2] == ["bake"] else words[1:]
    if "--command" in words:
        return words[words.index("--command") + 2 :]
    if "scripts/bake.py" in " ".join(words) and "--" in words:
        return words[words.index("--") + 1 :]
    return None


def check_command(words):
    """Raise or fail for a command that is not valid."""
    given = bake_arguments(words)
    if given is not None:
        named, more = (COMMANDS[given[0]], given[1:]) if given and given[0] in COMMANDS else (BAKE, given)
        if more in ([], ["--help"]):
            return
        if named in (FARM, REPORT, GPU, MCP):
            named.parser("imprint").parse_intermixed_args(more)
        elif named is not BAKE:
            {LOD: arguments.read_lod, ASSET: arguments.read_asset, CHECK: arguments.read_check}[named](more, "imprint")
        elif (options := arguments.parse(more)).jobs:
            arguments.split_jobs(more)
        else:
            arguments.check(options)
        return
    script = next((word for word in words if re.search(r"(^|/)\w+\.py$", word)), None)
    if script is not None and script.endswith("imprint.py"):
        options = imprint.parse(words[words.index(script) + 1 :])
        known = known_options()  # test and demo have their own parsers, which need Blender
        assert [word for word in options.rest if word.startswith("--") and word.partition("=")[0] not in known] == []
    elif script is not None and (ROOT / script).is_file():
        known = options_in(ROOT / script) | OTHER_OPTIONS
        assert [word for word in words if word.startswith("--") and word.partition("=")[0] not in known] == []


@pytest.mark.parametrize("page", PAGES, ids=ids(PAGES))
def test_commands_are_valid(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words in commands(page):
        try:
            check_command(words)
        except (arguments.WrongUsage, SystemExit) as error:
            pytest.fail(f"{shlex.join(words)}: {error}")


@pytest.mark.parametrize("page", PAGES, ids=ids(PAGES))
def test_named_options_exist(page):
    named = {option for code in inline(page) for option in re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", code)}
    assert sorted(named - known_options()) == []


@pytest.mark.parametrize("page", PAGES, ids=ids(PAGES))
def test_job_files_are_valid(page, tmp_path):
    for language, text in blocks(page):
        if language in {"toml", "json"} and "bake" in text.split("=")[0].split(":")[0] + text and "output" in text:
            path = tmp_path / f"jobs.{language}"
            path.write_text(text, encoding="utf-8")
            assert job_file.read(str(path))


@pytest.mark.parametrize("page", PAGES, ids=ids(PAGES))
def test_python_in_the_manual_is_valid(page):
    operators = set()
    for path in (ROOT / "addon").rglob("*.py"):
        operators |= set(re.findall(r'bl_idname = "imprint\.(\w+)"', path.read_text(encoding="utf-8")))
    for language, text in blocks(page):
        if language == "python":
            ast.parse(text)
        if language == "json":
            json.loads(text)
    called = set(re.findall(r"bpy\.ops\.imprint\.(\w+)", page.read_text(encoding="utf-8")))
    assert called - operators == set()


# Facts in the manual and in the code


def test_the_table_of_packages_has_the_permitted_imports():
    found = {}
    for cells in rows(section(ROOT / "docs" / "architecture.md", "## What may import what")):
        (package,) = names(cells[0])
        found["" if package == "addon/__init__.py" else package] = set(names(cells[1])), set(names(cells[2]))
    assert found == {package: (MAY_IMPORT[package], WITHOUT.get(package, set())) for package in MAY_IMPORT}


def test_the_index_names_modules():
    """Each word at the start of a line of the index is a module or a folder of the add-on, and each is there once."""
    index = section(ROOT / "docs" / "architecture.md", "## Where do I find ...")
    named = [
        name
        for line in re.findall(
            r"^ *(\w+(?:, \w+)*)/?(?:  |$)", "".join(re.findall(r"```text\n(.*?)```", index, re.DOTALL)), re.MULTILINE
        )
        for name in line.split(", ")
    ]
    there = {path.stem for path in (ROOT / "addon").rglob("*") if path.suffix == ".py" or path.is_dir()}
    assert [name for name in named if name not in there] == []
    assert len(named) > 100


def test_the_version_is_the_same_everywhere():
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    newest = re.search(r"^## (\d\S*)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert manifest == project == newest[1]
    zips = {
        name for page in PAGES for name in re.findall(r"imprint-(\d+\.\d+\.\d+)\.zip", page.read_text(encoding="utf-8"))
    }
    assert zips <= {manifest}


def test_the_table_of_exit_codes_has_those_of_the_command():
    codes = [getattr(run_report, name) for name in ("DONE", "FAILED", "WRONG_USAGE", "NO_MACHINE", "GATE")]
    cells = [line[0] for line in rows(section(ROOT / "docs" / "command-line.md", "## Exit codes"))]
    assert cells[:-1] == list(map(str, codes))
    assert {int(word) for word in cells[-1].split(", ")} == {128 + number for number in (1, 2, 15)}


def test_the_options_of_each_engine_do_the_same_as_the_setting():
    said = {}
    for cells in rows(section(ROOT / "docs" / "engines.md", "## Engines")):
        (options,) = names(cells[2])
        parsed = arguments.parse(["x.blend", "--low", "low", "--output", "map.png", *shlex.split(options)])
        said[cells[0]] = {name: str(getattr(parsed, name)) for name in targets.CHOICES[targets.OF_SCENE].values}
    wanted = {name: {key: str(value) for key, value in one.values.items()} for name, one in targets.CHOICES.items()}
    assert said == wanted


def test_each_picture_is_shown():
    folders = [ROOT / "docs" / "images", ROOT / "docs" / "extension"]
    pictures = {path for folder in folders for path in folder.iterdir() if path.suffix in {".jpg", ".png"}}
    linked = {
        (page.parent / target).resolve()
        for page in PAGES
        for target in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", prose(page))
    }
    assert pictures <= linked


BLENDERS = {
    *(
        "Add-ons",
        "Alpha Mode",
        "Armature",
        "Backend",
        "Blender File",
        "Channel Packed",
        "Color Space",
        "Delete",
        "Images",
        "Mesh",
    ),
    *("Non-Color", "Normals", "Recalculate Outside", "Set Weight", "Simplify", "System", "Weight Paint", "Weights"),
}
"""Names of Blender's own interface in the pages for artists."""
UNTRANSLATED = {
    *("Atlas", "Auto", "BC4", "BC5", "BC6H", "BC7", "Cycles", "Imprint", "Material", "MikkTSpace"),
    *("-Y", "8", "16", "32", "U", "V"),
}
EMPHASIS = {"Why", "What to do", "before", "with tangents", "Characters"}


@pytest.mark.parametrize("page", ["panels", "workflows", "quick-start", "troubleshooting", "maps", "engines"])
def test_bold_names_are_in_the_interface(page):
    """A label that was renamed cannot be found by who reads the page."""
    labels = set(
        re.findall(r'^msgid "(.*)"$', (ROOT / "addon" / "locale" / "es.po").read_text(encoding="utf-8"), re.MULTILINE)
    )
    bold = re.findall(r"\*\*([^*]+)\*\*", prose(ROOT / "docs" / f"{page}.md"))
    named = {part.rstrip(".:") for text in bold for part in re.split(" > ", " ".join(text.split()))}
    assert sorted(named - labels - BLENDERS - UNTRANSLATED - EMPHASIS) == []
