# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks plain data against a JSON Schema, with the keywords that docs/report.schema.json has."""

import re
from collections.abc import Iterator
from typing import Any

ABOUT = {"$schema", "$defs", "title", "description"}
IS = {
    "object": lambda value: isinstance(value, dict),
    "array": lambda value: isinstance(value, list),
    "string": lambda value: isinstance(value, str),
    "boolean": lambda value: isinstance(value, bool),
    "null": lambda value: value is None,
    "number": lambda value: isinstance(value, int | float) and not isinstance(value, bool),
    "integer": lambda value: isinstance(value, int) and not isinstance(value, bool),
}


def errors(
    value: Any, schema: dict[str, Any], whole: dict[str, Any] | None = None, at: str = "report"
) -> Iterator[str]:
    """What is wrong with a value, with its place. whole: the schema that has the definitions."""
    whole = whole or schema
    for word, given in schema.items():
        if word not in ABOUT:
            yield from _KEYWORDS[word](value, given, schema, whole, at)


def _of_type(value, given, _schema, _whole, at):
    if not any(IS[name](value) for name in ([given] if isinstance(given, str) else given)):
        yield f"{at}: {value!r:.40} is no {given}"


def _any(value, given, _schema, whole, at):
    found = [list(errors(value, each, whole, at)) for each in given]
    if all(found):
        yield from min(found, key=len)


def _properties(value, given, _schema, whole, at):
    for name, each in given.items():
        if isinstance(value, dict) and name in value:
            yield from errors(value[name], each, whole, f"{at}.{name}")


def _required(value, given, _schema, _whole, at):
    if isinstance(value, dict):
        yield from (f"{at}: {name} is missing" for name in given if name not in value)


def _others(value, given, schema, whole, at):
    for name in set(value) - set(schema.get("properties", ())) if isinstance(value, dict) else ():
        yield from errors(value[name], given, whole, f"{at}.{name}")


def _items(value, given, _schema, whole, at):
    for number, each in enumerate(value if isinstance(value, list) else ()):
        yield from errors(each, given, whole, f"{at}[{number}]")


def _first_items(value, given, _schema, whole, at):
    for number, (each, schema) in enumerate(zip(value, given, strict=False)):
        yield from errors(each, schema, whole, f"{at}[{number}]")


def _check(test):
    """A keyword whose value says by itself whether a value fits."""

    def check(value, given, _schema, _whole, at):
        if not test(value, given):
            yield f"{at}: {value!r:.40} does not fit {given!r}"

    return check


_KEYWORDS = {
    "type": _of_type,
    "anyOf": _any,
    "properties": _properties,
    "required": _required,
    "additionalProperties": _others,
    "items": _items,
    "prefixItems": _first_items,
    "$ref": lambda value, given, _schema, whole, at: errors(value, whole["$defs"][given.split("/")[-1]], whole, at),
    "const": _check(lambda value, given: value == given),
    "enum": _check(lambda value, given: value in given),
    "pattern": _check(lambda value, given: not isinstance(value, str) or re.search(given, value)),
    "minimum": _check(lambda value, given: not IS["number"](value) or value >= given),
    "minItems": _check(lambda value, given: not isinstance(value, list) or len(value) >= given),
    "maxProperties": _check(lambda value, given: not isinstance(value, dict) or len(value) <= given),
    "maxItems": _check(lambda value, given: not isinstance(value, list) or len(value) <= given),
}
