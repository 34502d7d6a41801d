# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that texts use plain words: no private vocabulary, American spelling, and names that say what things are.

Each rule is a regular expression with the words to use instead. Phrases and spellings apply to every text file; names apply
to Python code alone, not to its comments and strings. CONTRIBUTING.md has a short version of these lists.
"""

import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PATTERNS = (
    "*.md",
    "docs/**/*.md",
    "__init__.py",
    "addon/**/*.py",
    "shaders/**/*.glsl",
    "scripts/**/*.py",
    "tests/**/*.py",
)
PHRASES = {
    r"for want of": "missing",
    r"\b(is|are|was|were|be|been|being) told\b": "report, warn, message",
    r"\btold (of|by|apart|in|about)\b": "reported, distinguished",
    r"\btells? of\b": "reports, names",
    r"\b(some|no|any|every)body\b": "the user, the caller, no object, ...",
    r"\bwhoever\b": "the process that, the object that, ...",
    r"\b(a|the|each|any) person('s)?\b": "the user",
    r"\bat hand\b": "available, open, selected",
    r"\banew\b": "again, new",
    r"\bmend(s|ed|ing)?\b": "fix",
    r"\bhalf made\b": "incomplete",
    r"\bheld against\b": "compared with, tested against",
    r"\bknows? (of|no|nothing)\b": "uses, has, sees",
    r"\b(is|lies|are) nowhere\b": "has NaN in its transform",
    r"\bpressed (flat|into)\b": "flattened, has zero scale",
    r"\bturns? (its|their) backs?\b": "faces away",
    r"\blaid flat\b": "drawn in UV space",
    r"\bin good order\b": "cleanly",
    r"\bturn them round\b": "recalculate the normals",
    r"\bwhen the hand rests\b": "when editing pauses",
    r"\bholds a zero\b": "contains a NUL character",
    r"\bturned to fit\b": "rotated",
    r"\bfound to be suspicious\b": "warnings",
    r"\bmay be tiled\b": "works on tiling meshes",
    r"\bwithout limit\b": "unlimited",
    r"\bis no distance\b": "must be 0 or greater",
    r"\bis no single still picture\b": "is not a still image",
    r"\btwo looks at\b": "poll interval",
    r"\bgo(es)? into one place\b": "overwrite the same image",
    r"\b(the|a) door to\b": "entry point",
    r"\bthe truth about\b": "checks",
    r"\bthe story of\b": "the steps of",
    r"\bthe paper's (first|second) restriction\b": "overlapping UVs; the distance between the surfaces",
    r"\bthere whole or not at all\b": "atomic",
    r"\bas many at once as\b": "in threads",
    r"\bmask of misses\b": "Miss Mask",
    r"\bfacing only\b": "Ignore Backfaces",
    r"\bnothing is known to stand\b": "unknown placeholder",
    r"\bfor the eye\b": "on screen",
}
SPELLINGS = {
    r"colour": "color",
    r"centre|centring": "center",
    r"neighbour": "neighbor",
    r"behaviour": "behavior",
    r"favour": "favor",
    r"\bhonour": "honor",
    r"(normal|quant|raster|recogn|optim|organ|visual|general|real)is(e|ed|es|er|ing|ation)\b": "-ize",
    r"(initial|summar|minim|maxim|synchron|categor)is(e|ed|es|er|ing|ation)\b": "-ize",
    r"\banalyse": "analyze",
    r"catalogue": "catalog",
    r"\b(kilo|milli|centi)?metres?\b": "meter",
    r"\blicence": "license",
    r"\b(label|model|travel|cancel|level)l(ed|ing)\b": "one l",
    r"\bmould\b": "mold",
    r"\bgrey": "gray",
    r"\bjudgement": "judgment",
    r"\bwhilst\b|\bamongst\b": "while, among",
}
NAMES = {
    "Aim": "RayScene",
    "Shot": "RayCast",
    "Frame": "LocalSpace",
    "Finish": "PostProcess",
    "Kept": "a cache",
    "Work": "Task",
    "Step": "Progress",
    "relief": "height_position_ids",
    "subjects": "objects",
    "told": "reported, messages, ...",
    "tell": "report",
    "_tell": "_report",
    "say": "report, warn",
    "look": "probe",
    "looking": "probe",
    "glancing": "probe",
    "apart": "separation",
    "_apart": "_separation",
    "few": "shorten_list",
    "flaws": "issues",
}
API_WORDS = re.compile(r"CANCELLED|cancelled|(?<=[\"`])colours(?=[\"`])")
"""Spelled this way by Blender's API, and by a key of the report that stays."""


def files() -> list[str]:
    found = {path.relative_to(ROOT).as_posix() for pattern in PATTERNS for path in ROOT.glob(pattern)}
    return sorted(found - {Path(__file__).relative_to(ROOT).as_posix()})


def text_of(name: str) -> str:
    text = (ROOT / name).read_text(encoding="utf-8")
    if name == "CONTRIBUTING.md":  # its table quotes the words to avoid
        text = re.sub(r"^\|.*$", "", text, flags=re.MULTILINE)
    return API_WORDS.sub("", text)


def found_in(text: str, rules: dict[str, str]) -> list[str]:
    """Where the text breaks the rules, as "line: words (write ...)". Words may be on two lines of a comment."""
    return [
        f"{text.count(chr(10), 0, match.start()) + 1}: {' '.join(match[0].split())!r} (write: {better})"
        for rule, better in rules.items()
        for match in re.finditer(rule.replace(" ", r"[\s#/]+"), text, re.IGNORECASE)
    ]


def names_in(text: str) -> list[str]:
    """The names in Python code that NAMES forbids."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return [
        f"{token.start[0]}: the name {token.string!r} (write: {NAMES[token.string]})"
        for token in tokens
        if token.type == tokenize.NAME and token.string in NAMES
    ]


@pytest.mark.parametrize("name", files())
def test_texts_use_plain_words(name):
    text = text_of(name)
    found = found_in(text, PHRASES) + found_in(text, SPELLINGS)
    if name.endswith(".py"):
        found += names_in(text)
    assert not found, f"{name}:\n" + "\n".join(found)
