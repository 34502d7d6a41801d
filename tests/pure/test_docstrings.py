# SPDX-License-Identifier: GPL-3.0-or-later
"""What docstrings and comments name is there: `name`, module.name, Class.member, a file, and the fields of a class."""

import ast
import functools
import re
from collections import defaultdict

from addon.cli.options import RUN_OPTIONS
from addon.core.declarations.all_settings import DECLARED
from scripts.imprint import ROOT

FOREIGN = re.compile(r"(\w+/)*(io_scene_\w+/[\w/]+|gpu_shader_\w+)\.\w+")
"""Files of Blender."""


@functools.cache
def texts():
    """The texts of files by their paths."""
    paths = [
        path
        for folder, kind in (("addon", "py"), ("scripts", "py"), ("shaders", "glsl"))
        for path in sorted((ROOT / folder).rglob(f"*.{kind}"))
    ]
    return {path.relative_to(ROOT): path.read_text(encoding="utf-8") for path in paths}


@functools.cache
def code(path):
    """A file without its docstrings and comments."""
    return re.sub(r'"""(?s:.*?)"""|(#|//) .*', " ", texts()[path])


@functools.cache
def words(path):
    """All words of a file's code, but for those of sentences."""
    text = code(path)
    return set(re.findall(r"[A-Za-z_]\w*", re.sub(r'"[^"\n]* [^"\n]*"', " ", text)))


@functools.cache
def classes():
    """The classes of the add-on with their docstring by name: several may have one name."""
    found = defaultdict(list)
    for path, text in texts().items():
        if path.parts[0] == "addon":
            found_here = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ClassDef)]
            for node in found_here:
                found[node.name].append((path, node))
    return found


def members(node):
    """The names in a class, and in those of the add-on that it is derived from."""
    own = set(re.findall(r"[A-Za-z_]\w*", ast.unparse(ast.Module([n for n in node.body if not is_text(n)], []))))
    bases = [each for base in node.bases for _, each in classes().get(ast.unparse(base).split(".")[-1], ())]
    return own.union(*map(members, bases))


def is_text(node):
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def said():
    """Docstrings and comments with their files."""
    for path, text in texts().items():
        if path.parts[0] != "scripts":
            for found in re.findall(r'"""((?s:.*?))"""|(?:#|//) (.*)', text):
                yield path, re.sub(r"https?://\S+", "", "".join(found))


def test_names_are_there():
    known = set().union(*map(words, texts()))
    modules = defaultdict(set)
    for path in texts():
        if path.parts[0] == "addon":
            modules[path.stem] |= words(path)
    files = {
        path.name
        for folder in ("addon", "scripts", "shaders", "docs", "tests")
        for path in (ROOT / folder).rglob("*.*")
    }
    files |= {path.name for path in ROOT.glob("*.*")}
    wrong = []
    for path, text in said():
        wrong += [
            (path.name, name)
            for name in re.findall(r"`([A-Za-z_](?:[\w.]*\w)?)(?:\(\))?`", text)
            if name not in files and name.split(".")[-1] not in known
        ]
        wrong += [
            (path.name, f"{a}.{b}")
            for a, b in re.findall(r"(?<![\w/.])([a-z_]+)\.([A-Za-z_]\w+)\b", text)
            if a in modules
            and b not in modules[a] | {"py", "glsl", "md", "schema", "npz"}
            and not re.search(rf"\b{a}: ", code(path))
        ]
        wrong += [
            (path.name, f"{a}.{b}")
            for a, b in re.findall(r"\b([A-Z]\w+)\.([a-z_]\w+)\b", text)
            if a in classes() and not any(b in members(node) for _, node in classes()[a])
        ]
        wrong += [
            (path.name, name)
            for name in re.findall(r"\b[\w/-]+\.(?:py|glsl|md)\b", text)
            if name.split("/")[-1] not in files and not FOREIGN.fullmatch(name)
        ]
    assert wrong == [], wrong


def attributes(node):
    """The names in the lines below "Attributes:" in the docstring of a class."""
    _, _, lines = (ast.get_docstring(node) or "").partition("\nAttributes:\n")
    heads = re.findall(r"^    (\S[^:]*):", lines, re.MULTILINE)
    return [name for head in heads for name in re.findall(r"[a-z_]\w*", re.sub(r"\([^)]*\)( \w+)?| \w*\d+$", "", head))]


def fields(node):
    """The fields of a class and of those that it is derived from."""
    own = {each.target.id for each in node.body if isinstance(each, ast.AnnAssign)}
    bases = [each for base in node.bases for _, each in classes().get(ast.unparse(base).split(".")[-1], ())]
    return own.union(*map(fields, bases))


def run_on(node):
    """The fields of a class that its docstring explains within a paragraph, as `name: what it is`."""
    text, _, _ = (ast.get_docstring(node) or "").partition("\nAttributes:\n")
    said = re.findall(r"(?:^|[.;] )([a-z_]\w*)(?:, [a-z_]\w*)*(?: \([^)]*\))?(?: \w+)?: ", " ".join(text.split()))
    return sorted(fields(node).intersection(said))


def dataclasses():
    """The dataclasses of the add-on with their files."""
    for found in classes().values():
        for path, node in found:
            if any("dataclass" in ast.unparse(each) for each in node.decorator_list):
                yield path, node


def test_documented_fields_are_there():
    wrong = [
        (path.name, node.name, name)
        for path, node in dataclasses()
        for name in attributes(node)
        if name not in fields(node)
    ]
    assert wrong == [], wrong


def test_each_documented_field_has_a_line():
    """Below "Attributes:", or in a text behind the field: nobody finds a field in the middle of a paragraph."""
    wrong = [(path.name, node.name, names) for path, node in dataclasses() if (names := run_on(node))]
    assert wrong == [], wrong


def is_plain(node, field):
    """Whether a field needs no line: its class names it, or its type or the declaration of the setting says what it is."""
    name, kinds = field.target.id, set(re.findall(r"\w+", ast.unparse(field.annotation)))
    is_named = re.search(rf"\b{name}\b", ast.get_docstring(node) or "")
    return name.startswith("_") or is_named or kinds & {*classes(), "ClassVar"} or name in {**DECLARED, **RUN_OPTIONS}


def test_each_field_says_what_it_is():
    """None of the fields of a public dataclass is left to guess."""
    wrong = [
        (path.name, node.name, field.target.id)
        for path, node in dataclasses()
        for field, behind in zip(node.body, [*node.body[1:], None], strict=True)
        if not node.name.startswith("_") and isinstance(field, ast.AnnAssign)
        if not (behind is not None and is_text(behind)) and not is_plain(node, field)
    ]
    assert wrong == [], wrong
