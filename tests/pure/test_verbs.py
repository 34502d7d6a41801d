# SPDX-License-Identifier: GPL-3.0-or-later
"""The verbs of meshes do what the examples in their docstrings say, take nothing that is no mesh, and need no Blender."""

import dataclasses
import doctest
import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.mesh import verbs
from tests.pure.test_fitting import sphere

ROOT = Path(__file__).resolve().parents[2]
NAMES = {name: getattr(verbs, name) for name in verbs.__all__}
FUNCTIONS = [each for each in NAMES.values() if inspect.isfunction(each)]
OPTIONS = [each for name, each in NAMES.items() if name.endswith("Options")]


@pytest.mark.parametrize("verb", FUNCTIONS, ids=lambda verb: verb.__name__)
def test_the_example_of_a_verb_is_true(verb):
    points, triangles = sphere(16)
    values = NAMES | {"np": np, "points": points, "triangles": triangles}
    test = doctest.DocTestParser().get_doctest(verb.__doc__, values, verb.__name__, None, None)
    assert test.examples
    said = []
    doctest.DocTestRunner().run(test, out=said.append)
    assert not said, "".join(said)


@pytest.mark.parametrize("options", OPTIONS, ids=lambda options: options.__name__)
def test_each_option_has_a_line(options):
    told = re.findall(r"^    (\w+): ", inspect.cleandoc(options.__doc__), re.MULTILINE)
    assert told == [field.name for field in dataclasses.fields(options)]
    assert options.__dataclass_params__.frozen


POINTS, TRIANGLES = np.eye(3), np.array([[0, 1, 2]])
SURFACE = verbs.surface_samples(POINTS, TRIANGLES, 10)
CALLS = {
    "weld": verbs.weld,
    "cluster": lambda *mesh: verbs.cluster(*mesh, verbs.ClusterOptions(0.5)),
    "collapse": lambda *mesh: verbs.collapse(*mesh, verbs.CollapseOptions(1)),
    "partial_collapse": lambda *mesh: verbs.partial_collapse(*mesh, verbs.CollapseOptions(1)),
    "fit": lambda *mesh: verbs.fit(*mesh, SURFACE),
    "unfold": lambda *mesh: verbs.unfold(*mesh, SURFACE),
    "chart": verbs.chart,
    "surface_samples": lambda *mesh: verbs.surface_samples(*mesh, 10),
    "pack": lambda points, triangles: verbs.pack(points if np.ndim(points) < 2 else points[:, :2], triangles),
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize(
    ("points", "triangles", "words"),
    [
        ("abc", TRIANGLES, "points"),
        (np.zeros(3), TRIANGLES, "points"),
        (POINTS, TRIANGLES + 1, "from 1 to 3, of 3"),
        (POINTS, TRIANGLES - 1, "from -1 to 1"),
        (POINTS, TRIANGLES + 0.5, "whole numbers"),
        (POINTS, TRIANGLES[0], "whole numbers"),
        (POINTS * np.nan, TRIANGLES, "finite"),
        (POINTS[:, :1], TRIANGLES, "points"),
    ],
)
def test_what_is_no_mesh_is_refused_in_a_sentence(name, points, triangles, words):
    if name == "pack" and words == "finite":
        assert verbs.pack(points, triangles) is None  # as Blender unwraps faces without an area
        return
    with pytest.raises(BakeError, match=words):
        CALLS[name](points, triangles)


def test_lists_and_whole_numbers_are_points():
    points, triangles = verbs.weld([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    assert (
        points.dtype == np.float64
        and points.tolist() == [[0, 0, 0], [0, 1, 0], [1, 0, 0]]
        and triangles.tolist() == [[0, 2, 1]]
    )


def test_a_mesh_without_triangles_has_none_left():
    empty = np.zeros((0, 3)), np.zeros((0, 3), int)
    for name in ("weld", "cluster", "collapse", "unfold", "chart"):
        points, triangles = CALLS[name](*empty)
        assert not len(points) and not len(triangles)
    assert not len(CALLS["surface_samples"](*empty).points)
    with pytest.raises(BakeError, match="nothing to fit"):
        CALLS["fit"](*empty)


def test_charts_cover_the_surface_and_end_at_seams():
    points, triangles = sphere(12)
    labels, seams = verbs.chart(points, triangles, verbs.ChartOptions(stretch=1.0))
    assert labels.shape == (len(triangles),)
    assert np.array_equal(np.unique(labels), np.arange(labels.max() + 1))
    cut = {tuple(edge) for edge in np.sort(seams, axis=1).tolist()}
    owner = {}
    for triangle, label in zip(triangles.tolist(), labels.tolist(), strict=True):
        for k in range(3):
            edge = tuple(sorted((triangle[k], triangle[(k + 1) % 3])))
            assert edge in cut or owner.setdefault(edge, label) == label


def test_the_package_has_them_without_blender():
    code = (
        "import sys, importlib.util; sys.modules['bpy'] = None\n"
        f"spec = importlib.util.spec_from_file_location('imprint', r'{ROOT / '__init__.py'}',"
        f" submodule_search_locations=[r'{ROOT}'])\n"
        "imprint = importlib.util.module_from_spec(spec); sys.modules['imprint'] = imprint; spec.loader.exec_module(imprint)\n"
        "print(len(imprint.weld([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], imprint.WeldOptions(0.1))[1]))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "1\n"
