# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes docs/report.schema.json, the JSON Schema of the report, from the dataclasses of the report. Needs no Blender.

.venv/bin/python scripts/dev/report_schema.py [--check]
"""

import argparse
import ast
import inspect
import json
import sys
import types
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints, is_typeddict

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.cli import run_report  # noqa: E402
from addon.cli.run_report import Entry, FileNote, ThisCall  # noqa: E402
from addon.core.asset_limits import HowMade  # noqa: E402
from addon.core.levels import ChainReport, Level  # noqa: E402
from addon.core.report import Report  # noqa: E402
from addon.core.stored_normals import ConversionReport  # noqa: E402

PATH = ROOT / "docs" / "report.schema.json"
LEFT_OUT = {
    Report: {"refs", "picture", "state"},
    Entry: run_report.NOT_REPORTED,
    ChainReport: {"seconds", "warnings"},
    Level: {"bake"},
}
"""Fields that are not in the report."""
SPECIAL = {
    FileNote: {"sha256": {"type": ["string", "null"], "pattern": "^[0-9a-f]{64}$"}},
    Level: {"limit": {"type": "object", "additionalProperties": {"type": "number"}}},
    ThisCall: {"call": {"type": "array", "items": {"type": "string"}}},
}
"""What the annotations do not say."""


def of_type(kind: Any) -> dict[str, Any]:
    """The schema of an annotation."""
    origin, given = get_origin(kind), get_args(kind)
    if isinstance(kind, types.UnionType):
        return {"anyOf": [of_type(each) for each in given]}
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return {"type": "string", "enum": list(map(str, kind))}
    if is_typeddict(kind) or is_dataclass(kind):
        return of_class(kind)
    if origin in (list, Sequence) or kind is list:
        return {"type": "array", "items": of_type(given[0])} if given else {"type": "array"}
    if origin is tuple:
        items = [of_type(each) for each in given]
        return {"type": "array", "prefixItems": items, "minItems": len(items), "maxItems": len(items)}
    if origin is dict or kind is dict:
        return {"type": "object", "additionalProperties": of_type(given[1])} if given else {"type": "object"}
    names = {str: "string", bool: "boolean", int: "integer", float: "number", types.NoneType: "null"}
    return {"type": names[kind]} if kind in names else {}


def of_class(kind: type) -> dict[str, Any]:
    """The schema of a class with annotations, with the texts behind its fields. Keys that are not in it are allowed."""
    classes = kind.mro()[:-1] if is_dataclass(kind) else [kind]
    texts = {name: text for each in reversed(classes) for name, text in _texts(each).items()}
    hints, special = get_type_hints(kind), SPECIAL.get(kind, {})
    named = getattr(kind, "KEYS", [each.name for each in fields(kind)] if is_dataclass(kind) else hints)
    names = [name for name in named if name not in LEFT_OUT.get(kind, ())]
    properties = {name: {**_described(texts.get(name)), **special.get(name, of_type(hints[name]))} for name in names}
    return {"type": "object", "properties": properties, "required": names}


def _described(text: str | None) -> dict[str, str]:
    return {"description": " ".join(text.split())} if text else {}


def _texts(kind: type) -> dict[str, str]:
    """The texts behind the fields of a dataclass, by their names."""
    (body,) = ast.parse(inspect.cleandoc("\n" + inspect.getsource(kind))).body
    pairs = zip(body.body, body.body[1:], strict=False)
    return {
        field.target.id: text.value.value
        for field, text in pairs
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }


SPECIAL[Entry] = {
    "chain": {"anyOf": [of_class(ChainReport), {"type": "object", "maxProperties": 0}]},
    "reports": {"type": "array", "items": {"anyOf": [{"$ref": "#/$defs/bake"}, {"$ref": "#/$defs/conversion"}]}},
}


SPECIAL[Report] = {"asset": {"type": "object", "properties": of_class(HowMade)["properties"]}}


def schema() -> dict[str, Any]:
    """The schema of the report."""
    head = {
        "imprint_report": {
            "const": run_report.VERSION,
            "description": "The version of this shape. It goes up if a key goes or changes its meaning, not for new keys.",
        },
        "imprint": {"type": "string", "description": "The version of Imprint."},
        "blender": {"type": "string", "description": "The version of Blender."},
        "code": {
            "type": "string",
            "description": "A hash of the code, which changes where the version does not; empty if it is not known.",
            "pattern": "^([0-9a-f]{64})?$",
        },
        **of_class(ThisCall)["properties"],
        "planned": {
            "type": "integer",
            "minimum": 0,
            "description": "How many bakes the job file or folder has, also those of other parts.",
        },
        "shard": {
            "type": ["string", "null"],
            "description": "The part of the bakes that was done, as 1/4; null for all.",
            "pattern": "^[0-9]+/[0-9]+$",
        },
        "only": {
            "type": ["object", "null"],
            "description": "The patterns of --only, and the numbers of the bakes that match; null for all.",
            "properties": {
                "patterns": {"type": "array", "items": {"type": "string"}},
                "bakes": {"type": "string", "pattern": "^[0-9]+(-[0-9]+)?(, [0-9]+(-[0-9]+)?)*$"},
            },
            "required": ["patterns", "bakes"],
        },
        "bakes": {
            "type": "array",
            "description": "Those that are done or failed, or of which something was done.",
            "items": {"$ref": "#/$defs/entry"},
        },
        "summary": {
            "description": "How many bakes have each state, and the seconds of all.",
            "type": "object",
            "properties": {
                **{str(state): {"type": "integer", "minimum": 0} for state in run_report.State},
                "seconds": {"type": "number"},
            },
            "required": [*map(str, run_report.State), "seconds"],
        },
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "The report of Imprint",
        "type": "object",
        "properties": head,
        "required": list(head),
        "$defs": {
            "entry": of_class(Entry),
            "bake": of_class(Report),
            "conversion": of_class(ConversionReport),
        },
    }


def text() -> str:
    """The content of the file."""
    return json.dumps(schema(), indent=2) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing, and end with 1 if the file differs")
    if not parser.parse_args().check:
        PATH.write_text(text(), encoding="utf-8", newline="\n")
    return int(not PATH.is_file() or PATH.read_text(encoding="utf-8") != text())


if __name__ == "__main__":
    sys.exit(main())
