# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that a report is written once, at the end of a bake, and that no step of the bake reads it."""

import ast
import dataclasses
import functools
import json

import pytest

from addon.core import report
from addon.core.report import Report
from scripts.imprint import ROOT

PAST_BAKES = {
    "addon/jobs/job.py": "finds the objects of a past bake, to locate its issues",
    "addon/jobs/bake_jobs.py": "shows the frames that are done",
}
"""Modules below ui/ and cli/ that read a report, and why."""
BELOW = ("mesh", "passes", "engine", "audit", "scene", "output", "jobs")


@pytest.fixture
def done():
    return Report("CAST", "TANGENT", (16, 16), "lo", ["hi"])


def test_a_report_does_not_change(done):
    with pytest.raises(dataclasses.FrozenInstanceError):
        done.method = "FLATTEN"


def test_more_warnings_make_another_report(done):
    more = done.with_warnings(["first"]).with_warnings(["second"])
    assert (done.warnings, more.warnings) == ([], ["first", "second"])


def test_the_keys_of_a_report_start_with_their_version(done):
    data = json.loads(json.dumps(done.to_dict()))
    assert next(iter(data)) == "version"
    assert data["version"] == report.VERSION
    del data["readers"]  # the earlier name of a key
    assert Report(**data).to_dict() == done.to_dict() | {"size": [16, 16]}


def test_the_summary_has_the_width_of_a_blend(done):
    plain = dataclasses.replace(done, triangles={"high": 1, "low": 1})
    assert not any("hard edges" in line for line in plain.summary())
    blended = dataclasses.replace(plain, blend_width=0.125)
    assert "Directions blend within 0.125 of hard edges" in blended.summary()


@pytest.mark.parametrize(
    ("normal", "maps", "is_told"), [(True, ["ao"], True), (False, ["ao"], False), (False, ["ao", "bent_normal"], True)]
)
def test_the_summary_has_the_basis_of_maps_of_normals(done, normal, maps, is_told):
    baked = dataclasses.replace(
        done,
        settings={"basis": "MIKKTSPACE", "normal": normal},
        maps={name: {"image": name} for name in maps},
        triangles={"high": 1, "low": 1},
    )
    assert any(line.startswith("Basis: MikkTSpace") for line in baked.summary()) == is_told


def test_the_summary_has_the_rays_without_an_own_hit(done):
    rays = dataclasses.replace(
        done, triangles={"high": 1, "low": 1}, distances={"extrusion": 0.5, "max_distance": 1.0}, missed=0.01
    )
    for counts, expected in (
        ({}, ""),
        ({"not_owned": 0, "backs": 0}, ""),
        ({"not_owned": 4, "backs": 0}, ", 4.00% had no own hit"),
        ({"not_owned": 4, "backs": 1}, ", 4.00% had no own hit, 1.00% hit only backs"),
    ):
        report_of_counts = dataclasses.replace(rays, checks={"unsure": {"of": 100} | counts} if counts else {})
        assert f"Rays: extrusion 0.5 and max distance 1; 1.00% missed{expected}" in report_of_counts.summary()


@functools.cache
def modules():
    """The path and the syntax tree of each module below ui/ and cli/."""
    paths = [path for package in BELOW for path in sorted((ROOT / "addon" / package).rglob("*.py"))]
    return [(path.relative_to(ROOT).as_posix(), ast.parse(path.read_text(encoding="utf-8"))) for path in paths]


def imports_report(tree):
    return any(
        isinstance(node, ast.ImportFrom)
        and ((node.module or "").endswith("report") or any(alias.name == "report" for alias in node.names))
        for node in ast.walk(tree)
    )


def is_report(annotation):
    """Whether the annotation is Report, or a list of them, but not a task that returns one."""
    names = {node.id for node in ast.walk(annotation) if isinstance(node, ast.Name)} if annotation else set()
    return "Report" in names and "Task" not in names


def reads_of_reports(tree):
    """The attributes that functions read of arguments annotated as Report."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
            names = {argument.arg for argument in arguments if is_report(argument.annotation)} | {"report", "reports"}
            for node in ast.walk(function):
                value = node.value if isinstance(node, ast.Attribute) else None
                value = value.value if isinstance(value, ast.Subscript) else value
                if isinstance(value, ast.Name) and value.id in names:
                    yield f"{value.id}.{node.attr}"


def test_only_jobs_imports_reports():
    assert [path for path, tree in modules() if imports_report(tree) and not path.startswith("addon/jobs/")] == []


def test_no_step_of_a_bake_reads_a_report():
    lists = {"reports.append"}
    found = {path: set(reads_of_reports(tree)) - lists for path, tree in modules()}
    assert {path for path, reads in found.items() if reads} <= set(PAST_BAKES), found
