# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the nodes for ComfyUI by a caller that uses them as its executor does, with meshes and images as it has them."""

import importlib
import sys
import types

import numpy as np
import pytest

from addon.core.declarations.all_settings import DECLARED
from scripts.imprint import ROOT

FOLDER = ROOT / "scripts" / "comfyui"


class Tensor:
    """What the nodes use of torch.Tensor."""

    def __init__(self, values):
        self.values = values

    shape = property(lambda self: self.values.shape)

    def detach(self):
        return self

    cpu = detach

    def numpy(self):
        return self.values


@pytest.fixture
def nodes(monkeypatch):
    """The module of the nodes, as ComfyUI loads it: a package by its folder."""
    monkeypatch.setitem(sys.modules, "torch", types.SimpleNamespace(from_numpy=Tensor))
    spec = importlib.util.spec_from_file_location("comfy_imprint", FOLDER / "__init__.py")
    package = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "comfy_imprint", package)
    spec.loader.exec_module(package)
    yield sys.modules["comfy_imprint.nodes"]
    for name in [name for name in sys.modules if name.startswith("comfy_imprint")]:
        del sys.modules[name]


def run(nodes, name, **given):
    """Run a node as the executor does: check what is given, call the function for each item of lists, keep lists of outputs."""
    kind = nodes.NODE_CLASS_MAPPINGS[name]
    sockets = kind.INPUT_TYPES()
    known = sockets["required"] | sockets.get("optional", {})
    assert given.keys() <= known.keys()
    defaults = {each: value[1]["default"] for each, value in known.items() if len(value) > 1}
    given = defaults | given
    assert sockets["required"].keys() <= given.keys()
    for each, value in given.items():
        if known[each][0] == "INT":
            assert known[each][1]["min"] <= value <= known[each][1]["max"]
        elif isinstance(known[each][0], list):
            assert value in known[each][0]
    if hasattr(kind, "VALIDATE_INPUTS"):
        valid = kind.VALIDATE_INPUTS(**{each: given[each] for each in ("settings",) if each in given})
        if valid is not True:
            raise ValueError(valid)
    results = getattr(kind(), kind.FUNCTION)(**given)
    assert isinstance(results, tuple) and len(results) == len(kind.RETURN_TYPES)
    for value, of in zip(results, kind.RETURN_TYPES, strict=True):
        if of == "IMAGE":
            texels = value.numpy()
            assert texels.ndim == 4 and texels.shape[3] == 3 and texels.dtype == np.float32
            assert texels.min() >= 0.0 and texels.max() <= 1.0
        elif of == "STRING":
            assert isinstance(value, str)
    return results


def batch(points, faces, uvs=None):
    tensors = (None if each is None else Tensor(np.asarray(each)) for each in (points, faces, uvs))
    return types.SimpleNamespace(**dict(zip(("vertices", "faces", "uvs"), tensors, strict=True)))


SQUARE = np.float32([[[0, 0, 0], [1, 0, 0], [1, 0, -1], [0, 0, -1]]])
"""Up is Y: a square seen from above."""
FACES = np.array([[[0, 1, 2], [0, 2, 3]]])
UVS = np.float32([[[0, 1], [1, 1], [1, 0], [0, 0]]])
"""As glTF has them: v counts from the top."""


@pytest.fixture
def calls(nodes, monkeypatch):
    """What is asked for in place of processes. Each answer is the low mesh, and maps whose first row, the lowest, is bright."""
    made = []

    def call(name, meshes, arguments, is_stopped):
        made.append((name, meshes, arguments))
        mesh = meshes.get("low", meshes["high"])
        uv = mesh.get("uv", mesh["vertices"][:, :2])
        texels = np.zeros((4, 4, 4), np.float32)
        texels[0] = 1.0
        answer = {"mesh.vertices": mesh["vertices"], "mesh.triangles": mesh["triangles"]}
        answer["mesh.uv"] = uv[mesh["triangles"]]
        return {"warnings": ["A warning."]}, answer | {f"map.{each}": texels for each in arguments["maps"]}

    monkeypatch.setattr(sys.modules["comfy_imprint.process"], "call", call)
    return made


def test_a_mesh_and_its_maps_come_back_as_they_were(nodes, calls):
    low = batch(SQUARE, FACES, UVS)
    normal, mesh, told = run(nodes, "ImprintBakeNormal", low=low, high=batch(SQUARE + 0.1, FACES), size=64)
    name, given, arguments = calls[0]
    assert (name, arguments) == ("bake", {"maps": ["normal"], "size": 64, "samples": 4})
    assert given["low"]["vertices"].tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]  # Z is up
    assert given["low"]["uv"].tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert "uv" not in given["high"] and told == "A warning."
    assert normal.numpy()[0, -1].min() == 1.0 and normal.numpy()[0, :-1].max() == 0.0  # v = 0 is the lowest row
    corners = mesh.vertices.numpy()[0][mesh.faces.numpy()[0]]
    assert np.array_equal(corners, SQUARE[0][FACES[0]])
    assert np.array_equal(mesh.uvs.numpy()[0][mesh.faces.numpy()[0]], UVS[0][FACES[0]])
    assert mesh.normal_map is not None and mesh.normals is None


def test_normals_come_back_as_they_were(nodes):
    mesh = {"mesh.vertices": SQUARE[0], "mesh.triangles": FACES[0], "mesh.uv": UVS[0]}
    mesh_of = sys.modules["comfy_imprint.meshes"].mesh_of
    (normals,) = mesh_of([mesh | {"mesh.normals": np.float32([[0, 0, 1]] * 4)}]).normals.numpy()
    assert normals.tolist() == [[0, 1, 0]] * 4  # Y is up
    assert mesh_of([mesh]).normals is None


def test_a_bake_takes_all_samples_that_a_node_offers(nodes):
    for node in ("ImprintBakeNormal", "ImprintGameAsset"):
        offered, _ = nodes.NODE_CLASS_MAPPINGS[node].INPUT_TYPES()["required"]["samples"]
        assert offered == [item.value for item in DECLARED["samples"].items]


def test_batches_of_meshes(nodes, calls):
    low = batch(np.concatenate([SQUARE, SQUARE * 2]), np.concatenate([FACES] * 2), np.concatenate([UVS] * 2))
    low.vertex_counts, low.face_counts = Tensor(np.array([4, 3])), Tensor(np.array([2, 1]))
    images = run(nodes, "ImprintBakeMaps", low=low, high=batch(SQUARE, FACES))
    assert len(calls) == 2 and len(calls[1][1]["low"]["vertices"]) == 3 and len(calls[1][1]["low"]["triangles"]) == 1
    assert [len(each.numpy()) for each in images[:6]] == [2] * 6
    mesh = images[6]
    assert mesh.vertices.shape == (2, 4, 3) and mesh.vertex_counts.numpy().tolist() == [4, 3]
    assert mesh.face_counts.numpy().tolist() == [2, 1]


def test_an_asset_has_its_shade_in_the_packed_image(nodes, calls):
    mesh, *_ = run(nodes, "ImprintGameAsset", high=batch(SQUARE, FACES), triangles=12, settings='{"levels": 0}')
    assert calls[0][0] == "asset" and calls[0][2]["triangles"] == 12 and calls[0][2]["levels"] == 0
    assert mesh.occlusion_in_mr and mesh.metallic_roughness.numpy()[0, -1, 0].tolist() == [1.0, 1.0, 0.0]


@pytest.mark.parametrize("has_class", [False, True])
def test_meshes_are_of_the_class_that_this_comfyui_has(nodes, monkeypatch, has_class):
    """ComfyUI 0.3.64 has Types without MESH."""
    kind = type(
        "MESH", (), {"__init__": lambda self, vertices, faces: vars(self).update(vertices=vertices, faces=faces)}
    )
    latest = types.SimpleNamespace(Types=types.SimpleNamespace(**{"MESH": kind} if has_class else {}))
    monkeypatch.setitem(sys.modules, "comfy_api", types.ModuleType("comfy_api"))
    monkeypatch.setitem(sys.modules, "comfy_api.latest", latest)
    mesh_of = sys.modules["comfy_imprint.meshes"].mesh_of
    mesh = mesh_of([{"mesh.vertices": SQUARE[0], "mesh.triangles": FACES[0], "mesh.uv": UVS[0]}])
    assert isinstance(mesh, kind if has_class else types.SimpleNamespace)
    assert mesh.vertices.shape == (1, 4, 3) and mesh.faces.shape == (1, 2, 3)


def test_corners_with_other_uvs_are_other_vertices(nodes):
    found = sys.modules["comfy_imprint.meshes"].mesh_of(
        [{"mesh.vertices": SQUARE[0], "mesh.triangles": FACES[0], "mesh.uv": np.arange(12.0).reshape(2, 3, 2)}]
    )
    assert found.vertices.shape == (1, 6, 3)


WRONG = [
    ("settings", "samples=4", "not JSON"),
    ("settings", "[4]", "not an object"),
    ("settings", '{"size": 4}', "is an input of the node"),
    ("low", None, "is no mesh"),
    ("low", types.SimpleNamespace(vertices=Tensor(SQUARE[0]), faces=Tensor(FACES[0])), "no batch"),
    ("high", batch(np.zeros((0, 4, 3)), np.zeros((0, 2, 3))), "no batch"),
    ("low", batch(np.concatenate([SQUARE] * 3), np.concatenate([FACES] * 3)), "give as many, or one"),
]


@pytest.mark.parametrize(("socket", "value", "said"), WRONG)
def test_wrong_inputs_are_sentences(nodes, calls, socket, value, said):
    given = {"low": batch(SQUARE, FACES), "high": batch(np.concatenate([SQUARE] * 2), np.concatenate([FACES] * 2))}
    errors = (ValueError, sys.modules["comfy_imprint.process"].ImprintError)
    with pytest.raises(errors, match=said):
        run(nodes, "ImprintBakeNormal", **given | {socket: value})
    assert not calls


def test_a_python_that_is_missing_is_named(nodes, monkeypatch, tmp_path):
    process = sys.modules["comfy_imprint.process"]
    monkeypatch.setenv("IMPRINT_PYTHON", str(tmp_path / "python"))
    with pytest.raises(process.ImprintError, match="IMPRINT_PYTHON is"):
        process.python()
    monkeypatch.delenv("IMPRINT_PYTHON")
    monkeypatch.setattr(process, "HERE", tmp_path / "a" / "b")
    monkeypatch.setattr(process.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(process.ImprintError, match="pip install"):
        process.python()


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("import sys; sys.exit('no display')", "no display"),
        ("import os; os.abort()", "ended before"),
        ("import json, sys; open(sys.argv[1] + '/answer.json', 'w').write(json.dumps({'error': 'No GPU.'}))", "No GPU"),
    ],
)
def test_a_process_that_fails_is_a_sentence(nodes, monkeypatch, tmp_path, program, said):
    process = sys.modules["comfy_imprint.process"]
    script = tmp_path / "worker.py"
    script.write_text(program)
    monkeypatch.setenv("IMPRINT_PYTHON", sys.executable)
    monkeypatch.setattr(process, "WORKER", script)
    with pytest.raises(process.ImprintError, match=said):
        process.call("bake", {}, {})


def test_a_graph_that_is_stopped_ends_its_process(nodes, monkeypatch, tmp_path):
    process = sys.modules["comfy_imprint.process"]
    script, started, done = (tmp_path / name for name in ("worker.py", "started", "done"))
    script.write_text(f"import time\nopen({str(started)!r}, 'w')\ntime.sleep(3)\nopen({str(done)!r}, 'w')")
    monkeypatch.setenv("IMPRINT_PYTHON", sys.executable)
    monkeypatch.setattr(process, "WORKER", script)

    def is_stopped():
        if started.exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process.call("bake", {}, {}, is_stopped)
    assert not done.exists()


@pytest.mark.slow
def test_a_node_bakes_in_blender(nodes, monkeypatch):
    """A high square that is tilted: the normal is known."""
    monkeypatch.setenv("IMPRINT_PYTHON", sys.executable)
    high = SQUARE.copy()
    high[..., 1] = 0.1 * high[..., 0]
    normal, mesh, _ = run(nodes, "ImprintBakeNormal", low=batch(SQUARE, FACES, UVS), high=batch(high, FACES), size=32)
    wanted = 0.5 + 0.5 * np.array([-0.1, 0.0, 1.0]) / np.hypot(0.1, 1.0)
    assert np.abs(normal.numpy()[0] - wanted).max() < 2e-3
    assert mesh.uvs.shape == (1, 4, 2)
    process = sys.modules["comfy_imprint.process"]
    with pytest.raises(process.ImprintError, match="did you mean 'samples'|no setting"):
        run(nodes, "ImprintBakeNormal", low=batch(SQUARE, FACES), high=batch(high, FACES), settings='{"sample": 3}')
    *images, unwrapped, _ = run(nodes, "ImprintBakeMaps", low=batch(SQUARE, FACES), high=batch(SQUARE, FACES), size=64)
    assert unwrapped.uvs.shape == (1, 4, 2)
    values = dict(zip(nodes.MAPS, (each.numpy()[0] for each in images), strict=True))
    assert np.abs(values["ao"] - 1.0).max() < 1e-3 and np.abs(values["curvature"][24:40, 24:40] - 0.5).max() < 0.02
    assert np.abs(values["height"] - 0.5).max() < 1e-3
