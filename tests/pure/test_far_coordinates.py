# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests coordinates far from the origin: which files have them, and that copies near the origin lose nothing."""

import numpy as np
import pytest

from addon.core.file_structure import far_points

PLACE = np.array([512_345.0, 5_412_345.0, 312.0])
ROUNDING = 1e-6
"""Of numbers with twelve digits that are smaller than 1000, and of double precision at 5,000,000."""


def points(seed, count=500, place=PLACE):
    return np.random.default_rng(seed).uniform(-50.0, 50.0, (count, 3)) + place


def write_obj(path, values, line="v {} {} {}", head="", end="\n"):
    rows = [line.format(*(f"{value:.7f}" for value in row)) for row in values]
    path.write_bytes((head + end.join(rows) + f"{end}vt 0.5 0.25{end}f 1/1 2/1 3/1{end}").encode())


def points_of_obj(path):
    rows = [line.split() for line in path.read_text().splitlines() if line.split()[:1] == ["v"]]
    return np.array([[float(word) for word in row[1:4]] for row in rows])


LINES = {
    "plain": {},
    "colors": {"line": "v {} {} {} 0.25 0.5 1"},
    "indented": {"line": "  v\t{}  {} {}"},
    "windows": {"end": "\r\n"},
    "interleaved": {"line": "vn 0 0 1\nv {} {} {}"},
    "comments": {"line": "v {} {} {} # here", "head": "# v 1 2 3\no v\n"},
}


@pytest.mark.parametrize("form", LINES)
@pytest.mark.parametrize("seed", [1, 2])
def test_points_of_an_obj_are_moved_by_seed(tmp_path, form, seed):
    source, target = tmp_path / "scan.obj", tmp_path / "near.obj"
    values = points(seed)
    write_obj(source, values, **LINES[form])
    origin = far_points.far_origin(source)
    assert np.abs(origin - PLACE).max() < 10.0
    far_points.write_near(source, target, origin)
    assert np.abs(points_of_obj(target) + origin - values).max() < ROUNDING
    lines = [path.read_text().split("\n") for path in (source, target)]
    assert [[line.strip() for line in text if line.split()[:1] != ["v"]] for text in lines][0] == [
        line.strip() for line in lines[1] if line.split()[:1] != ["v"]
    ]
    if form == "colors":
        assert all(line.endswith(" 0.25 0.5 1") for line in lines[1] if line.startswith("v "))


def test_lines_keep_their_order_across_blocks(tmp_path, monkeypatch):
    """Faces may count back from the points before them."""
    monkeypatch.setattr(far_points, "CHUNK", 100)
    source, target = tmp_path / "scan.obj", tmp_path / "near.obj"
    rows = points(3, 300)
    source.write_text("".join(f"v {x:.3f} {y:.3f} {z:.3f}\nf -1 -2 -3\n" for x, y, z in rows) + "v 1 2")
    far_points.write_near(source, target, PLACE)
    kinds = [line[:2] for line in target.read_text().splitlines()]
    assert kinds == ["v ", "f "] * 300 + ["v "]
    assert target.read_text().endswith("v 1 2")  # no point: the importer decides
    found = np.array([line.split()[1:] for line in target.read_text().splitlines()[:-1:2]], float)
    assert np.abs(found + PLACE - np.round(rows, 3)).max() < ROUNDING


def write_ply(path, values, form, kind="double", more=True):
    properties = "".join(f"property {kind} {axis}\n" for axis in "xyz")
    properties += "property uchar red\nproperty int id\n" if more else ""
    head = f"ply\nformat {form} 1.0\ncomment by a test\nelement vertex {len(values)}\n{properties}"
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    ids = np.arange(len(values)) + 2_000_000_000
    if form == "ascii":
        rows = [
            " ".join(f"{value:.7f}" for value in row) + f" 7 {number}" for row, number in zip(values, ids, strict=True)
        ]
        path.write_bytes((head + "\n".join(rows) + "\n3 0 1 2\n").encode())
        return
    order = "<" if "little" in form else ">"
    real = order + ("f8" if kind == "double" else "f4")
    fields = [(axis, real) for axis in "xyz"] + ([("red", "u1"), ("id", order + "i4")] if more else [])
    table = np.zeros(len(values), fields)
    for axis, column in zip("xyz", values.T, strict=True):
        table[axis] = column
    if more:
        table["red"], table["id"] = 7, ids
    path.write_bytes(head.encode() + table.tobytes() + b"\3" + np.arange(3, dtype=order + "i4").tobytes())


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("seed", [4, 5])
def test_points_of_a_ply_are_moved_by_seed(tmp_path, monkeypatch, form, seed):
    monkeypatch.setattr(far_points, "CHUNK", 1000)
    source, target, expected = (tmp_path / f"{name}.ply" for name in ("scan", "near", "expected"))
    values = np.round(points(seed), 7)
    write_ply(source, values, form)
    origin = far_points.far_origin(source)
    assert np.abs(origin - PLACE).max() < 10.0
    far_points.write_near(source, target, origin)
    write_ply(expected, values - origin, form)
    if form != "ascii":
        assert target.read_bytes() == expected.read_bytes()
        return
    rows = [[line.split() for line in path.read_text().splitlines()] for path in (target, expected)]
    assert rows[0][:12] == rows[1][:12]
    assert rows[0][-1] == rows[1][-1]
    table, other = (np.array(each[12:-1], float) for each in rows)
    assert np.abs(table - other).max() < ROUNDING


def test_far_means_many_sizes_away(tmp_path):
    source = tmp_path / "scan.obj"
    for place, is_far in [((0, 0, 0), False), ((900, 0, 0), False), ((50_000, 0, 0), True), ((0, -1e6, 0), True)]:
        write_obj(source, points(6, place=np.array(place)))
        assert (far_points.far_origin(source) is not None) == is_far
    write_obj(source, points(7, place=np.array((20_000.0, 0, 0))) * 30.0)  # as large as it is far
    assert far_points.far_origin(source) is not None
    write_obj(source, points(7, place=np.array((1_000.0, 0, 0))) * 30.0)
    assert far_points.far_origin(source) is None


def test_the_origin_is_exact_in_single_precision(tmp_path):
    source = tmp_path / "scan.obj"
    write_obj(source, points(8, place=np.array([4e8 + 3, -7e9, 1.5])))
    origin = far_points.far_origin(source)
    assert np.array_equal(origin, origin.astype(np.float32).astype(np.float64))


def test_a_large_file_is_read_in_windows(tmp_path, monkeypatch):
    monkeypatch.setattr(far_points, "WINDOW", 500)
    source = tmp_path / "scan.obj"
    values = np.concatenate([points(9, 2000), points(9, 2000) + 40.0])
    write_obj(source, values)
    assert np.abs(far_points.far_origin(source) - (PLACE + 20.0)).max() < 15.0


def test_files_in_single_precision_and_other_files_are_not_moved(tmp_path):
    source = tmp_path / "scan.ply"
    write_ply(source, points(10), "binary_little_endian", kind="float")
    assert far_points.far_origin(source) is None
    for content in (
        b"",
        b"ply\n",
        b"ply\nformat ascii 1.0\nelement vertex 5\nproperty double x\nend_header\n1\n2\n",
        b"\0" * 999,
    ):
        source.write_bytes(content)
        assert far_points.far_origin(source) is None
        (tmp_path / "a.obj").write_bytes(content)
        assert far_points.far_origin(tmp_path / "a.obj") is None
    (tmp_path / "a.obj").write_text("v nan inf 1\nv 1e400 0 0\nv 1e300 0 0\nv a b c\nv 1\n")
    assert far_points.far_origin(tmp_path / "a.obj") is None
    assert far_points.far_origin(tmp_path / "a.stl") is None
