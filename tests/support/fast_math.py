# SPDX-License-Identifier: GPL-3.0-or-later
"""Rewrites shaders as a compiler with fast math may.

Metal's compiler takes it that no number is NaN or infinite: then `a < b` is the same as `!(a >= b)`, and isnan is false.
"""

import re

_OPPOSITE = {"<": ">=", "<=": ">", ">": "<=", ">=": "<"}
_COMPARISON = re.compile(r" (<=?|>=?) ")
_END = re.compile(r"[,;?]| : | =[-+*/]? | [-+*/]= |&&|\|\|| nruter\b")
_OPENING, _CLOSING = "([{", ")]}"
_HEAD = "#define isnan(x) false\n#define isinf(x) false\n#line 1\n"


def turned(text: str) -> str:
    """The GLSL `text` with each comparison as the negation of its opposite. It means the same unless a number is NaN.

    The text has spaces around comparisons, and no line break within one.
    """
    return _HEAD + "\n".join(line if line.lstrip().startswith("#") else _turned_line(line) for line in text.split("\n"))


def _turned_line(line: str) -> str:
    code, slashes, comment = line.partition("//")
    at = 0
    while found := _COMPARISON.search(code, at):
        start = found.start() - _length(code[: found.start()][::-1], _CLOSING, _OPENING)
        start += len(code[start:]) - len(code[start:].lstrip())
        end = found.end() + len(code[found.end() :][: _length(code[found.end() :], _OPENING, _CLOSING)].rstrip())
        left, right = code[start : found.start()], code[found.end() : end]
        at = start + len(f"!({left} >= ")
        code = f"{code[:start]}!({left} {_OPPOSITE[found[1]]} {right}){code[end:]}"
    return code + slashes + comment


def _length(text: str, opening: str, closing: str) -> int:
    """How many characters at the beginning of `text` belong to one side of a comparison. The left side is read backwards."""
    depth = 0
    for i, letter in enumerate(text):
        depth += (letter in opening) - (letter in closing)
        if depth < 0 or (depth == 0 and _END.match(text, i)):
            return i
    return len(text)
