# SPDX-License-Identifier: GPL-3.0-or-later
"""Game assets of machine parts: planes and edges by closed forms, and what is round stays as it was."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from addon.core import asset_limits
from addon.core.asset_limits import Mending, Wanted
from addon.core.declarations.choices import Symmetry
from addon.core.naming import Suffixes
from addon.core.progress import Pace, Progress, Timings, finish
from addon.core.settings import Settings
from addon.core.simplify import Candidate, Limit
from addon.jobs import asset
from addon.jobs.job import Job
from addon.jobs.simplify import high_surface, plane_meshes, touching_solids
from addon.jobs.simplify.touching_solids import Solids
from addon.jobs.temporary import TEMPORARY
from addon.mesh import flush
from addon.mesh.closest import Surface
from addon.mesh.fitting import surface_samples
from addon.mesh.plane_collapse import Costs, collapse_on_planes
from addon.mesh.planes import planes
from addon.mesh.topology import EdgeTable
from addon.mesh.triangles import enclosed_volumes, face_areas, transformed
from addon.mesh.welding import weld
from addon.scene import mesh_reader
from tests.support import cad_parts, quick_assets, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")
STEP = Progress("Reading", 1.0)


@pytest.mark.slow
def test_a_plate_with_screw_holes_stays_a_plate(monkeypatch):
    """With triangles for a box alone: the holes are in its map, its sides exact, and its normals those of its faces."""
    quick_assets.quicken(monkeypatch)
    plate = cad_parts.plate()
    plate.name = "Plate_high"
    settings = Settings(width=128, height=128, samples=1, storage="MEMORY", margin=2)
    work = asset.work(bpy.context, Job(plate, [plate]), Wanted(triangles=12), settings, Pace(0.0), suffixes=Suffixes())
    (report,) = finish(work)
    low = bpy.data.objects[report.low]
    assert report.asset["keeps_planes"] and report.triangles["low"] == 12
    points = mesh_reader.points(low.data)
    assert np.unique(np.round(points, 4), axis=0).tolist() == [
        [x, y, z] for x in (0.0, 100.0) for y in (0.0, 80.0) for z in (0.0, 5.0)
    ]
    sharp = [edge for edge in low.data.edges if edge.use_edge_sharp]
    assert len(sharp) == 12
    mesh = mesh_reader.surface(low.data, low.data.uv_layers.active.name, low.name, np.eye(4))
    faces = np.repeat([face.normal for face in low.data.polygons], 3, axis=0)
    assert mesh.normals[mesh.triangles.reshape(-1)] == pytest.approx(faces, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("symmetry", "is_said"), [(Symmetry.X, True), (Symmetry.NONE, False)])
def test_symmetry_that_bends_planes_is_said(monkeypatch, symmetry, is_said):
    quick_assets.quicken(monkeypatch)
    plate, wanted = cad_parts.plate(), Wanted(triangles=60, mending=Mending(symmetry=symmetry))
    settings = Settings(width=64, height=64, samples=1, storage="MEMORY", margin=2)
    (report,) = finish(asset.work(bpy.context, Job(plate, [plate]), wanted, settings, Pace(0.0), suffixes=Suffixes()))
    assert any("set Symmetry to None" in text for text in report.warnings) == is_said != report.asset["keeps_planes"]


def sources_of(obj):
    points, triangles = weld(*cad_parts.arrays(obj))
    samples, timings = surface_samples(points, triangles, 1000), Timings(("decimate",))
    solids = Solids(points, triangles, flush.rounding(points))
    return finish(plane_meshes.sources_of((points, triangles), samples, timings, bias=1.0, solids=solids, step=STEP))


def united(*boxes):
    points, triangles = weld(*cad_parts.arrays(cad_parts.loose(*(cad_parts.box(*each) for each in boxes))))
    return points, triangles, finish_united(points, triangles)


def finish_united(points, triangles):
    return finish(touching_solids.united(Solids(points, triangles, flush.rounding(points)), STEP))


def temporary_meshes():
    return [each for each in bpy.data.meshes if each.name.startswith(TEMPORARY)]


CUBE, BESIDE, FLUSH, ON_TOP = (0, 0, 0, 2, 2, 2), (2, 0, 0, 2, 2, 1), (0, 2, 0, 2, 1, 2), (3, 0, 1, 1, 1, 1)
"""Boxes, as corner and size, that touch the first of them, or the second."""


@pytest.mark.parametrize(
    ("boxes", "volume", "area"),
    [([BESIDE], 12.0, 36.0), ([FLUSH], 12.0, 32.0), ([BESIDE, FLUSH, ON_TOP], 17.0, 48.0)],
)
def test_solids_that_touch_become_one(boxes, volume, area):
    """Its area lacks twice that of the faces between them."""
    before = len(temporary_meshes())
    _, _, one = united((0, 0, 0, 2, 2, 2), *boxes)
    points, triangles = one
    assert enclosed_volumes(points.astype(float), triangles).sum() / 6.0 == pytest.approx(volume)
    assert face_areas(points, triangles).sum() == pytest.approx(area)
    assert (EdgeTable.of(triangles).counts == 2).all()
    assert len(temporary_meshes()) == before


def test_solids_stay_as_they_are_that_are_apart_or_overlap_or_are_open():
    """A third of them touches one of the others, so that there is something to unite."""
    cube, away = (0, 0, 0, 2, 2, 2), (9, 0, 0, 1, 1, 1)
    assert united(cube, away)[2] is None
    assert united(cube, BESIDE, (0, 0, 1, 1, 1, 5))[2] is None
    points, triangles, one = united(cube, BESIDE)
    assert one is not None
    assert finish_united(points, triangles[1:]) is None
    turned_over = np.concatenate([triangles[:1, ::-1], triangles[1:]])
    assert finish_united(points, turned_over) is None


@pytest.mark.parametrize("other", [(9, 0, 0, 1, 1, 1), (0, 0, 1, 1, 1, 5), (2, 2, 2, 1, 1, 1)])
def test_no_step_is_made_for_solids_that_do_not_touch(other):
    """They are apart, cross, or have a corner in common."""
    points, triangles = cad_parts.arrays(cad_parts.loose(*(cad_parts.box(*each) for each in (CUBE, other))))
    solids = Solids(*weld(points, triangles), flush.rounding(points))
    assert not list(touching_solids.united(solids, STEP))


def turned(points):
    """Points in a space that is turned, scaled and moved, in single precision."""
    return transformed(points, np.array(PARENT, float)).astype(np.float32)


PARENT = Matrix.LocRotScale((3.3, -2.1, 1.7), Euler((0.4, 1.1, -0.7)), (1.37, 1.37, 1.37))


@pytest.mark.parametrize(("boxes", "volume", "area"), [([BESIDE], 12.0, 36.0), ([BESIDE, FLUSH, ON_TOP], 17.0, 48.0)])
def test_turned_solids_that_touch_become_one(boxes, volume, area):
    """What is not along an axis is flat, and in the same place, but for rounding."""
    points, triangles = cad_parts.arrays(cad_parts.loose(*(cad_parts.box(*each) for each in [CUBE, *boxes])))
    source = weld(turned(points), triangles)
    points, triangles = finish_united(*source)
    assert np.sqrt(Surface(*source).closest(points)[2]).max() < 1e-5
    assert enclosed_volumes(points.astype(float), triangles).sum() / 6.0 == pytest.approx(volume * 1.37**3, rel=1e-5)
    assert face_areas(points, triangles).sum() == pytest.approx(area * 1.37**2, rel=1e-5)
    assert (EdgeTable.of(triangles).counts == 2).all()


def test_solids_with_slanted_sides_become_one():
    """Their boxes cross."""
    outlines = np.array([(0, 0), (5, 0), (2, 3)], float), np.array([(7, 3), (2, 3), (5, 0)], float)
    prisms = cad_parts.loose(*(cad_parts.extruded([each], 0.0, 2.0) for each in outlines))
    points, triangles = cad_parts.arrays(prisms)
    points, triangles = finish_united(*weld(turned(points), triangles))
    assert enclosed_volumes(points.astype(float), triangles).sum() / 6.0 == pytest.approx(30.0 * 1.37**3, rel=1e-5)
    assert (EdgeTable.of(triangles).counts == 2).all() and len(triangles) == 12


def test_solids_whose_boxes_touch_alone_stay():
    """A spike that leans over a box, and ends beside it."""
    points, triangles, _ = united(CUBE)
    spike = np.array([(2.5, 1, 2), (0.5, 0.5, 4), (1.5, 0.5, 4), (1, 1.5, 4)], np.float32)
    faces = np.array([(0, 2, 1), (0, 3, 2), (0, 1, 3), (1, 2, 3)]) + len(points)
    assert finish_united(np.concatenate([points, spike]), np.concatenate([triangles, faces])) is None


def test_lines_between_triangles_are_no_gaps_in_what_is_united():
    """The Boolean drops triangles that are lines: of the box above, one that ends in the middle of an edge."""
    points, triangles, _ = united(CUBE, BESIDE)
    ends = [int(np.flatnonzero((points == (0.0, 0.0, z)).all(axis=1))[0]) for z in (0.0, 2.0)]
    row, k = np.argwhere((triangles == ends[0]) & (np.roll(triangles, -1, axis=1) == ends[1]))[0]
    low, high, third = np.roll(triangles[row], -k)
    parts = [(low, len(points), third), (len(points), high, third), (low, high, len(points))]
    points = np.concatenate([points, np.array([(0.0, 0.0, 1.0)], np.float32)])
    points, triangles = finish_united(points, np.concatenate([np.delete(triangles, row, axis=0), parts]))
    assert (EdgeTable.of(triangles).counts == 2).all()
    assert face_areas(points, triangles).sum() == pytest.approx(36.0)


def test_two_sheets_are_no_solid():
    """A card of two sides, which are the same triangles, beside boxes that touch."""
    points, triangles, _ = united(CUBE, BESIDE)
    card = np.array([(9, 9, 0), (9, 9, 1), (9, 8, 0)], np.float32)
    faces = np.array([(0, 1, 2), (0, 2, 1)]) + len(points)
    assert finish_united(np.concatenate([points, card]), np.concatenate([triangles, faces])) is None


def test_objects_that_touch_below_a_turned_parent_are_one_surface():
    """A table: its legs share no edge with its top."""
    parent = bpy.data.objects.new("parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.matrix_world = PARENT
    legs = [(x, y, 0, 1, 1, 7) for x in (0, 11) for y in (0, 7)]
    parts = [cad_parts.box(-0.5, -0.5, -0.5, 1, 1, 1) for _ in range(5)]
    for part, (x, y, z, *size) in zip(parts, [(0, 0, 7, 12, 8, 0.5), *legs], strict=True):
        part.parent, part.scale = parent, size
        part.location = np.add((x, y, z), np.divide(size, 2.0))
    bpy.context.view_layer.update()
    high = finish(high_surface.read(bpy.context, Job(parts[0], parts), Settings(), Timings(asset_limits.STAGES)))
    source = next(each for each in high.sources if each.keeps_planes)
    assert len(source.whole[1].triangles) == 60
    area = face_areas(source.whole[0].points, source.whole[0].triangles).sum()
    assert area == pytest.approx(324.0 * 1.37**2, rel=1e-5)


def test_solids_that_have_a_side_in_common_become_one(monkeypatch):
    """Two beams whose triangles between them are the same: joining vertices leaves one of each two."""
    monkeypatch.setattr(high_surface, "remeshed", lambda *_: None)  # it takes seconds
    boxes = cad_parts.loose(*(cad_parts.box(0, 0, z, 1, 1, 20) for z in (0, 20)))
    high = finish(high_surface.read(bpy.context, Job(boxes, [boxes]), Settings(), Timings(asset_limits.STAGES)))
    assert len(high.triangles) == 22
    source = next(each for each in high.sources if each.keeps_planes)
    assert (EdgeTable.of(source.whole[0].triangles).counts == 2).all()
    assert face_areas(source.whole[0].points, source.whole[0].triangles).sum() == pytest.approx(162.0)


def test_a_box_of_boards_is_made_as_one_solid():
    """The fingers of its boards lie in one plane with what they touch: they take no triangles."""
    source, *_ = sources_of(cad_parts.finger_box())
    (low,) = finish(source.make(600))
    made = Surface(mesh_reader.points(low.data), mesh_reader.corner_vertices(low.data).reshape(-1, 3))
    inside = np.array([(1.5, 1.5, 5.0 + 10.0 * number) for number in range(6)], np.float32)
    assert np.sqrt(made.closest(inside)[2]) == pytest.approx(1.5)  # from the outside: nothing is between
    of_it = Surface(source.whole[0].points, source.whole[0].triangles).closest(source.samples.points.astype(np.float32))
    assert np.sqrt(of_it[2]).max() < 1e-3 and len(source.samples.points) > 900


def test_solids_that_hide_much_of_one_another_become_one():
    """Where more is hidden, other low meshes are made without the triangles there: what is left of the solids is open."""
    box = cad_parts.finger_box(6.0)
    high = finish(high_surface.read(bpy.context, Job(box, [box]), Settings(), Timings(asset_limits.STAGES)))
    assert high.hidden_share > high_surface.MOST_HIDDEN
    source = next(each for each in high.sources if each.keeps_planes)
    assert len(source.whole[1].triangles) < 1000  # of 1,450 with boards


def test_the_inside_of_a_closed_crate_is_left_out():
    """Six boards: what is united has a shell inside, which nobody sees."""
    lids, sides = [(0, 0, z, 10, 10, 1) for z in (0, 9)], [(x, 0, 1, 1, 10, 8) for x in (0, 9)]
    ends = [(1, y, 1, 8, 1, 8) for y in (0, 9)]
    crate = cad_parts.loose(*(cad_parts.box(*board) for board in (*lids, *sides, *ends)))
    high = finish(high_surface.read(bpy.context, Job(crate, [crate]), Settings(), Timings(asset_limits.STAGES)))
    source = next(each for each in high.sources if each.keeps_planes)
    assert len(source.whole[1].triangles) == 12
    assert face_areas(source.whole[0].points, source.whole[0].triangles).sum() == pytest.approx(600.0)
    faces = source.whole[0].points[source.whole[0].triangles[source.samples.triangles]]
    away = np.linalg.norm(faces - source.samples.points[:, None], axis=2).min(axis=1)
    assert (away <= np.linalg.norm(np.ptp(faces, axis=1), axis=1)).all()  # each is in its triangle's box


def test_what_is_round_is_no_hard_surface():
    assert not sources_of(zoo.ball("ball", 32)) and not sources_of(zoo.terrain("hills", 32))
    assert [each.costs for each in sources_of(cad_parts.rounded_box())] == list(plane_meshes.COSTS)


def test_low_meshes_have_hard_edges_where_planes_meet():
    (low,) = finish(sources_of(cad_parts.gusset())[0].make(112))
    assert len(low.data.polygons) == 112
    faces = np.array([face.normal for face in low.data.polygons])
    across = {}
    for face in low.data.polygons:
        for key in face.edge_keys:
            across.setdefault(key, []).append(face.index)
    for edge in low.data.edges:
        one, other = across[tuple(sorted(edge.vertices))]
        if faces[one] @ faces[other] < np.cos(np.radians(61.0)):
            assert edge.use_edge_sharp


def test_a_keyway_in_a_round_side_is_closed():
    """Its floor and its walls are as large as strips of the cylinder."""
    (low,) = finish(sources_of(cad_parts.shaft())[0].make(160))
    points = mesh_reader.points(low.data)
    inner = points[(points[:, 0] > 61.0) & (points[:, 0] < 107.0)]
    assert not len(inner) or np.linalg.norm(inner[:, 1:], axis=1).min() > 11.0


def test_meshes_with_triangles_turned_over_are_told(monkeypatch):
    """Fit moves vertices: here one of a square's over its diagonal, so that one of its triangles shows its back."""
    points = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)])
    triangles, normals = np.array([(0, 1, 2), (0, 2, 3)]), np.tile((0.0, 0.0, 1.0), (2, 1))
    assert not plane_meshes.is_folded(points, triangles, normals)
    points[3] = 0.5, 0.5, 0.0
    assert not plane_meshes.is_folded(points, triangles, normals)  # no area
    points[3] = 0.6, 0.4, 0.0
    assert plane_meshes.is_folded(points, triangles, normals)
    assert plane_meshes.is_folded(points[:3], np.array([(2, 1, 0)]), normals[:1])
    source = sources_of(cad_parts.gusset())[1]
    (fitted,) = finish(source.make(112))
    assert not fitted.is_folded
    monkeypatch.setattr(plane_meshes, "is_folded", lambda *_: True)
    (folded,) = finish(source.make(112))
    assert cost_of(folded, 112) > 100.0
    # Nothing is moved that turns triangles over.
    of_high = set(map(tuple, source.whole[0].points.astype(np.float32).tolist()))
    assert set(map(tuple, mesh_reader.points(folded.data).tolist())) <= of_high
    assert not set(map(tuple, mesh_reader.points(fitted.data).tolist())) <= of_high


def cost_of(mesh, wanted):
    return asset._cost(Candidate(mesh, SimpleNamespace(bias=1.0), SimpleNamespace(cost=1.0), Limit()), wanted)


@pytest.mark.parametrize(("triangles", "cost"), [(50, 1.0), (102, 1.0), (204, 2.0)])
def test_more_triangles_than_were_wanted_cost(triangles, cost):
    assert cost_of(SimpleNamespace(triangles=triangles, is_folded=False), 100) == pytest.approx(cost)


@pytest.mark.parametrize(("fade", "corners"), [(2.0, 0), (np.inf, 8)])
def test_small_walls_that_are_stiff_take_the_triangles_of_windows(fade, corners):
    """Of a disk with teeth, whose walls are 0.1 % of it each, and a window: with few triangles, either stays."""
    disk = cad_parts.extruded([cad_parts.gear_outline(30, 40, 4), cad_parts.rectangle(-12, -6, 24, 12)[::-1]], 0, 3)
    points, triangles = weld(*cad_parts.arrays(disk))
    made = collapse_on_planes(points, triangles, planes(points, triangles), 160, Costs(fade=fade))
    assert len(made.triangles) == 160
    assert np.count_nonzero(np.linalg.norm(made.points[:, :2], axis=1) < 14.0) == corners


@pytest.mark.slow
def test_fins_that_are_too_many_keep_their_planes():
    """Of a heat sink with a tenth of its triangles, which are fewer than its fins take. All that stays lies in their planes."""
    sink = cad_parts.heat_sink()
    points, triangles = weld(*cad_parts.arrays(sink))
    (low,) = finish(sources_of(sink)[0].make(len(triangles) // 10))
    faces = np.array([face.normal for face in low.data.polygons])
    areas = np.array([face.area for face in low.data.polygons])
    is_along = np.abs(faces).max(axis=1) > 0.99999
    assert areas[~is_along].sum() < 0.05 * areas.sum()  # of the screw holes
