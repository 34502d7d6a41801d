# SPDX-License-Identifier: GPL-3.0-or-later
"""Rewrites shaders as compilers for real GPUs may.

Metal's compiler takes it that no number is NaN or infinite: then `a < b` is the same as `!(a >= b)`, and isnan is false. All
compilers but llvmpipe's round the sum of a product and a number once, and GPUs compute square roots by reciprocal ones.
"""

import re
from collections.abc import Iterator

# Comparisons

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


# Rounding


def rounded_otherwise(text: str) -> str:
    """The GLSL `text` with sums of products rounded once, and square roots that are off by one unit in the last place."""
    code = re.sub(r"//.*", "", text)
    return f"{_ROUNDING}#line 1\n{_with_calls(_TOKEN.finditer(code))}"


def _overloads() -> Iterator[str]:
    """The functions for a * b + c, for all types that shaders have there: a product of two floats is exact as a double."""
    for n in ("", 2, 3, 4):
        vector, double = (f"vec{n}", f"dvec{n}") if n else ("float", "double")
        mixed = ("vvv", "fvv", "vfv", "vvf", "vff", "fvf", "ffv") if n else ("vvv",)
        for kinds in mixed:
            given = ", ".join(f"{vector if k == 'v' else 'float'} {name}" for k, name in zip(kinds, "abc", strict=True))
            value = f"{vector}({double}(a) * {double}(b) + {double}(c))"
            yield f"{vector} rounded_once({given}) {{ return {value}; }}"
        for scalar, whole in ("int", f"ivec{n}"), ("uint", f"uvec{n}"):
            for kinds in ("vvv", "fvv", "vfv", "vvf", "vff", "fvf", "ffv") if n else ("fff",):
                given = ", ".join(
                    f"{whole if k == 'v' else scalar} {name}" for k, name in zip(kinds, "abc", strict=True)
                )
                yield f"{whole if n else scalar} rounded_once({given}) {{ return a * b + c; }}"
        if n in (3, 4):
            yield f"vec{n} rounded_once(mat{n} a, vec{n} b, vec{n} c) {{ return a * b + c; }}"


def _of_each(name: str) -> Iterator[str]:
    """A function of a float for each component of a vector."""
    for n in (2, 3, 4):
        yield f"vec{n} {name}(vec{n} x) {{ return vec{n}({', '.join(f'{name}(x.{c})' for c in 'xyzw'[:n])}); }}"


_ROUGH = "inversesqrt", "sqrt", "dot", "cross", "length", "distance", "normalize"
_ROUNDING = "\n".join(
    [
        *_overloads(),
        """\
float rough_inversesqrt(float x)
{
  uint bits = floatBitsToUint(inversesqrt(x));
  return uintBitsToFloat(bits == 0u ? 0u : (bits & 1u) == 0u ? bits - 1u : bits + 1u);
}
float rough_sqrt(float x) { return x * rough_inversesqrt(x); }
float rough_dot(vec2 a, vec2 b) { return rounded_once(a.y, b.y, a.x * b.x); }
float rough_dot(vec3 a, vec3 b) { return rounded_once(a.z, b.z, rough_dot(a.xy, b.xy)); }
float rough_dot(vec4 a, vec4 b) { return rounded_once(a.w, b.w, rough_dot(a.xyz, b.xyz)); }
vec3 rough_cross(vec3 a, vec3 b) { return rounded_once(a.yzx, b.zxy, -(a.zxy * b.yzx)); }""",
        *_of_each("rough_inversesqrt"),
        *_of_each("rough_sqrt"),
        *(
            f"float rough_length(vec{n} a) {{ return rough_sqrt(rough_dot(a, a)); }}\n"
            f"float rough_distance(vec{n} a, vec{n} b) {{ return rough_length(a - b); }}\n"
            f"vec{n} rough_normalize(vec{n} a) {{ return a * rough_inversesqrt(rough_dot(a, a)); }}"
            for n in (2, 3, 4)
        ),
        *(f"#define {name} rough_{name}" for name in _ROUGH),
        "",
    ]
)


_TOKEN = re.compile(
    r"(?P<directive>^[ \t]*#(?:[^\n]*\\\n)*[^\n]*)|(?P<constant>\bconst\b[^;,(){}]*=[^;]*;)"
    r"|(?:\s|\\\n)+|0x\w+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\w*|[A-Za-z_]\w*"
    r"|<<=|>>=|\+\+|--|[-+*/%&|^<>=!]=|<<|>>|&&|\|\||\^\^|.",
    re.MULTILINE,
)
"""Constants may call no functions, and stay as they are."""
_DEFINED = re.compile(r"(\s*#define\s+\w+(?:\([^)]*\))?)(.*)", re.DOTALL)
_BETWEEN = {",", ";", "{", "}", "?", ":", "return", "else", "=", "*=", "/=", "|=", "&=", "^="}
_BETWEEN |= {"==", "!=", "<", ">", "<=", ">=", "&&", "||", "^^", "|", "&", "^", "<<", ">>"}
"""What is between two sums, beside brackets."""
_VARIABLE = re.compile(r"[A-Za-z_][\w.]*(?:\[[^\[\]]*\])?(?:\.\w+)?\s*$")


def _with_calls(tokens: Iterator[re.Match], closing: str = "") -> str:
    """The text up to the bracket `closing`, with rounded_once for each sum of a product."""
    done, part, added = "", [], ""
    for found in tokens:
        token = found[0]
        if token == closing:
            break
        if token in ("(", "["):
            part.append(token + _with_calls(tokens, ")" if token == "(" else "]"))
        elif token in ("+=", "-="):
            done, part, added = done + "".join(part), [], token
        elif found["directive"] or found["constant"] or token in _BETWEEN:
            if defined := _DEFINED.fullmatch(token):
                token = defined[1] + _with_calls(_TOKEN.finditer(defined[2]))
            done, part, added = done + _sum(part, added, done) + token, [], ""
        else:
            part.append(token)
    return done + _sum(part, added, done) + closing


def _sum(part: list[str], added: str, before: str) -> str:
    """A sum with calls. added: "+=" or "-=" if it is added to the variable at the end of `before`."""
    (_, first), *others = _terms(part)
    total, product = "".join(first).strip(), _product(first)
    if added and product and not others and (variable := _VARIABLE.search(before)):
        return f"= {_call(added[0], product, variable[0].strip())}"
    for sign, term in others:
        text, other = "".join(term).strip(), _product(term)
        if other:
            total = _call(sign, other, total)
        elif product:
            total = _call("", product, f"-({text})" if sign == "-" else text)
        else:
            total = f"{total} {sign} {text}"
        product = None
    whole = "".join(part)
    spaces = whole[: len(whole) - len(whole.lstrip())], whole[len(whole.rstrip()) :]
    return added + (total.join(spaces) if total else whole)


def _terms(part: list[str]) -> list[tuple[str, list[str]]]:
    """The terms of a sum, each with its sign."""
    terms, last = [("", [])], ""
    for token in part:
        if token in ("+", "-") and last not in ("", "*", "/", "%", "+", "-"):
            terms.append((token, []))
        else:
            terms[-1][1].append(token)
        last = token if token.strip() else last
    return terms


def _product(term: list[str]) -> tuple[str, str] | None:
    """The two sides of a term that is a product, or None."""
    at = max((i for i, token in enumerate(term) if token in ("*", "/", "%")), default=None)
    return None if at is None or term[at] != "*" else ("".join(term[:at]).strip(), "".join(term[at + 1 :]).strip())


def _call(sign: str, product: tuple[str, str], rest: str) -> str:
    left, right = product
    return f"rounded_once({f'-({left})' if sign == '-' else left}, {right}, {rest})"
