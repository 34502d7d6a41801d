# SPDX-License-Identifier: GPL-3.0-or-later
"""Twenty machine parts as CAD programs export them: planes and cylinders in thin triangles. Lengths are millimeters.

Parts are outlines with holes that are extruded, joined and cut by Blender's exact booleans.
"""

import bpy
import numpy as np
from mathutils import Matrix, Vector, geometry

from tests.support import zoo

SEGMENTS = 32
"""Of a circle."""


def circle(x, y, radius, segments=SEGMENTS):
    angles = 2.0 * np.pi * np.arange(segments) / segments
    return np.stack([x + radius * np.cos(angles), y + radius * np.sin(angles)], axis=1)


def rectangle(x, y, width, height):
    return np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)], float)


def slot(x, y, length, radius, segments=16):
    """A slot with round ends, along x, from its center."""
    half = np.pi * np.arange(segments + 1) / segments - np.pi / 2.0
    end = radius * np.stack([np.cos(half), np.sin(half)], axis=1) + (length / 2.0 - radius, 0.0)
    return np.concatenate([end, -end]) + (x, y)


def extruded(loops, low, high, axis="z"):
    """A solid from an outline and its holes, [(N, 2)], between two heights along an axis."""
    flat = [[Vector((*point, 0.0)) for point in loop] for loop in loops]
    faces = np.array(geometry.tessellate_polygon(flat))
    points = np.concatenate(loops)
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    is_down = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] < 0.0
    faces[is_down] = faces[is_down][:, ::-1]
    count, walls, first = len(points), [], 0
    for loop in loops:
        x, y = loop.T
        is_left = (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() > 0.0
        here = first + np.arange(len(loop))
        ahead = np.roll(here, -1)
        if is_left != (first == 0):  # the outline runs to the left, holes to the right
            here, ahead = ahead, here
        walls.append(np.stack([here, ahead, ahead + count, here, ahead + count, here + count], axis=1).reshape(-1, 3))
        first += len(loop)
    triangles = np.concatenate([faces[:, ::-1], faces + count, *walls])
    points = np.concatenate([np.column_stack([points, np.full(count, height)]) for height in (low, high)])
    turn = {"z": [0, 1, 2], "x": [2, 0, 1], "y": [1, 2, 0]}[axis]
    return zoo.build("part", points[:, turn].astype(np.float32), triangles, smooth=False)


def combined(first, others, how):
    """A solid joined with others ("UNION"), or cut by them ("DIFFERENCE")."""
    for other in others:
        modifier = first.modifiers.new("cut", "BOOLEAN")
        modifier.operation, modifier.solver, modifier.object = how, "EXACT", other
        bpy.context.view_layer.update()
        data = bpy.data.meshes.new_from_object(first.evaluated_get(bpy.context.evaluated_depsgraph_get()))
        first.modifiers.clear()
        first.data = data
        bpy.data.objects.remove(other)
    return first


def cut(first, *others):
    return combined(first, others, "DIFFERENCE")


def joined(first, *others):
    return combined(first, others, "UNION")


def holes(places, radius, low, high, axis="z", *, segments=SEGMENTS):
    return [extruded([circle(*place, radius, segments)], low, high, axis) for place in places]


def box(*corner_and_size):
    x, y, z, width, depth, height = corner_and_size
    return extruded([rectangle(x, y, width, depth)], z, z + height)


def gear_outline(teeth, radius, height):
    """Teeth as trapezes."""
    steps = np.arange(teeth)[:, None] + np.array([0.0, 0.28, 0.42, 0.58, 0.72])[None]
    angles = 2.0 * np.pi * steps.reshape(-1) / teeth
    out = radius + height * np.tile([0.0, 0.0, 1.0, 1.0, 0.0], teeth)
    return np.stack([out * np.cos(angles), out * np.sin(angles)], axis=1)


def moved(obj, matrix):
    obj.data.transform(matrix)
    return obj


def swapped(obj):
    """A solid with x and z exchanged, which is extruded along y: its profile is drawn in x and z."""
    obj.data.transform(Matrix(((0, 0, 1, 0), (0, 1, 0, 0), (1, 0, 0, 0), (0, 0, 0, 1))))
    obj.data.flip_normals()
    return obj


def plate():
    grid = [circle(x, y, 2.0) for x in np.arange(10, 91, 20) for y in np.arange(10, 71, 20)]
    return extruded([rectangle(0, 0, 100, 80), *grid], 0, 5)


def screw_box():
    body = box(0, 0, 0, 80, 60, 40)
    tops = [(8, 8), (72, 8), (72, 52), (8, 52)]
    body = cut(body, *holes(tops, 1.6, 20, 50), *holes(tops, 3.0, 37, 50))
    return cut(body, *holes([(15, 10), (45, 10), (30, 15)], 2.0, -1, 15, "x"))


def finger_outline(width, height, finger, depth):
    """A rectangle whose left and right sides have finger joints."""
    right = []
    for number in range(int(height / finger)):
        x = width - depth * (number % 2)
        right += [(x, number * finger), (x, (number + 1) * finger)]
    right = np.array(right, float)
    return np.concatenate([right, np.column_stack([width - right[::-1, 0], right[::-1, 1]])])


def finger_box(thick=3.0):
    walls = [circle(x, 30, 1.5, 16) for x in (20, 80, 100)]
    outline = finger_outline(120, 60, 5, thick)
    front = swapped(extruded([outline, *walls, rectangle(40, 15, 30, 25)[::-1]], 0, thick, "y"))
    back = front.copy()
    back.data = moved_data(front.data, Matrix.Translation((0, 80 - thick, 0)))
    bpy.context.scene.collection.objects.link(back)
    sides = [box(x, 0, 0, thick, 80, 60) for x in (0, 120 - thick)]
    slots = [(y, z) for y in (0, 80 - thick) for z in range(0, 60, 10)]
    sides = [cut(side, *[box(-1, y, z, 130, thick, 5) for y, z in slots]) for side in sides]
    floor = box(thick, thick, 0, 120 - 2 * thick, 80 - 2 * thick, 3)
    floor = cut(floor, *holes([(x, y) for x in (20, 60, 100) for y in (20, 60)], 2, -1, 4))
    return loose(front, back, *sides, floor)


def moved_data(data, matrix):
    data = data.copy()
    data.transform(matrix)
    return data


def loose(first, *others):
    """One object of solids that touch."""
    parts, count, faces = [], 0, []
    for obj in (first, *others):
        points, triangles = arrays(obj)
        parts.append(points)
        faces.append(triangles + count)
        count += len(points)
        bpy.data.objects.remove(obj)
    return zoo.build("part", np.concatenate(parts), np.concatenate(faces), smooth=False)


def arrays(obj):
    data = obj.data
    data.calc_loop_triangles()
    points, triangles = np.empty((len(data.vertices), 3), np.float32), np.empty((len(data.loop_triangles), 3), np.int32)
    data.vertices.foreach_get("co", points.reshape(-1))
    data.loop_triangles.foreach_get("vertices", triangles.reshape(-1))
    return points, triangles


def bracket():
    bend = np.pi / 2.0 * np.arange(13) / 12.0
    outside = np.stack([8 - 8 * np.sin(bend), 8 - 8 * np.cos(bend)], axis=1)
    inside = np.stack([8 - 4 * np.sin(bend), 8 - 4 * np.cos(bend)], axis=1)
    profile = np.concatenate([[(60, 0)], outside, [(0, 50), (4, 50)], inside[::-1], [(60, 4)]])
    body = extruded([profile], 0, 40, "y")
    body = swapped(body)
    body = cut(body, *holes([(20, 10), (20, 30), (45, 10), (45, 30)], 3, -1, 6))
    return cut(body, *holes([(10, 30), (30, 30)], 3, -1, 6, "x"))


def channel():
    body = cut(box(0, 0, 0, 120, 40, 30), box(-1, 4, 4, 122, 32, 40))
    body = cut(body, *holes([(x, 20) for x in range(15, 120, 15)], 3, -1, 5))
    return cut(body, *holes([(15, x) for x in range(15, 120, 15)], 2.5, -1, 50, "y"))


def gear():
    bore = np.concatenate([circle(0, 0, 8)[3:-2], [(9.5, -2.0), (9.5, 2.0)]])
    return extruded([gear_outline(40, 36, 5), bore], 0, 12)


def spoked_gear():
    body = extruded([gear_outline(60, 56, 4), circle(0, 0, 6)], 0, 8)
    windows = []
    for number in range(6):
        window = extruded([slot(28, 0, 26, 6)], 1 - 5, 20)
        windows.append(moved(window, Matrix.Rotation(number * np.pi / 3.0, 4, "Z")))
    rims = [extruded([circle(0, 0, 50, 64), circle(0, 0, 14, 48)], height, height + 10) for height in (6, -8)]
    return cut(body, *windows, *rims)


def housing():
    body = cut(box(0, 0, 0, 90, 60, 45), box(3, 3, 3, 84, 54, 60))
    corners = [(8, 8), (82, 8), (82, 52), (8, 52)]
    body = joined(body, *holes(corners, 4, 2, 40))
    body = cut(body, *holes(corners, 1.5, 25, 50), *holes([(30, 20), (30, 40)], 6, -1, 5, "x"))
    return cut(body, *[box(20 + 6 * number, -1, 15, 3, 6, 20) for number in range(9)])


def flange():
    body = extruded([circle(0, 0, 40, 64), circle(0, 0, 16, 48)], 0, 8)
    bolts = [(30 * np.cos(angle), 30 * np.sin(angle)) for angle in np.arange(8) * np.pi / 4.0]
    body = joined(body, extruded([circle(0, 0, 20, 48), circle(0, 0, 16, 48)], 4, 90))
    top = extruded([circle(0, 0, 40, 64), circle(0, 0, 16, 48)], 86, 94)
    return cut(joined(body, top), *holes(bolts, 3.5, -1, 100))


def tee():
    body = joined(extruded([circle(0, 0, 20, 48)], -60, 60, "x"), extruded([circle(0, 0, 14, 40)], 0, 50))
    body = joined(body, *[extruded([circle(0, 0, 28, 64)], at, at + 6, "x") for at in (-60, 54)])
    return cut(body, extruded([circle(0, 0, 17, 48)], -70, 70, "x"), extruded([circle(0, 0, 11, 40)], 0, 60))


def engraved():
    curve = bpy.data.curves.new("text", "FONT")
    curve.body, curve.size, curve.extrude, curve.resolution_u = "IMPRINT", 18.0, 1.0, 16
    text = bpy.data.objects.new("text", curve)
    bpy.context.scene.collection.objects.link(text)
    bpy.context.view_layer.update()
    data = bpy.data.meshes.new_from_object(text.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    bpy.data.objects.remove(text)
    data.transform(Matrix.Translation((8, 9, 5.4)))
    letters = bpy.data.objects.new("letters", data)
    bpy.context.scene.collection.objects.link(letters)
    return cut(box(0, 0, 0, 100, 32, 6), letters)


def grille():
    bars = [slot(50, 8 + 5 * number, 80, 1.5) for number in range(13)]
    corners = [circle(x, y, 1.5, 24) for x in (4, 96) for y in (4, 72)]
    return extruded([rectangle(0, 0, 100, 76), *bars, *corners], 0, 3)


def shaft():
    steps = [(0, 20, 10), (18, 60, 14), (58, 110, 12), (108, 130, 8)]
    body = extruded([circle(0, 0, steps[0][2], 48)], *steps[0][:2], "x")
    body = joined(body, *[extruded([circle(0, 0, radius, 48)], low, high, "x") for low, high, radius in steps[1:]])
    return cut(body, moved(extruded([slot(0, 0, 30, 3)], 10, 20), Matrix.Translation((85, 0, 0))))


def bolt():
    body = joined(extruded([circle(0, 0, 10, 6)], 0, 7), extruded([circle(0, 0, 5, 40)], 6, 50))
    rings = [extruded([circle(0, 0, 7, 40), circle(0, 0, 4.4, 40)], 15 + 2 * at, 16 + 2 * at) for at in range(16)]
    return cut(body, *rings)


def heat_sink():
    body = box(0, 0, 0, 60, 60, 6)
    fins = [box(1 + 4 * number, 0, 5, 1.5, 60, 25) for number in range(15)]
    return cut(joined(body, *fins), *holes([(28.75, 6), (28.75, 54)], 1.5, -1, 40))


def bearing_block():
    profile = np.concatenate(
        [
            [(-60, 0), (60, 0), (60, 12), (26, 12)],
            circle(0, 40, 26, 48)[46:48],
            circle(0, 40, 26, 48)[:25],
            [(-26, 12), (-60, 12)],
        ]
    )
    body = extruded([profile, circle(0, 40, 16, 48)], 0, 30, "y")
    body = swapped(body)
    return cut(body, *holes([(-45, 15), (45, 15)], 5, -1, 13), *holes([(-45, 15), (45, 15)], 8, 9, 13))


def beveled(obj, width, segments, angle=0.6):
    modifier = obj.modifiers.new("bevel", "BEVEL")
    modifier.width, modifier.segments, modifier.limit_method, modifier.angle_limit = width, segments, "ANGLE", angle
    bpy.context.view_layer.update()
    data = bpy.data.meshes.new_from_object(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    obj.modifiers.clear()
    obj.data = data
    return obj


def rounded_box():
    body = beveled(six_squares(100, 70, 40), 6, 8)
    return cut(body, *holes([(20, 20), (80, 20), (80, 50), (20, 50)], 3, 30, 50))


def six_squares(width, depth, height):
    """A box of six squares."""
    points = np.array([(width * i, depth * j, height * k) for k in (0, 1) for j in (0, 1) for i in (0, 1)])
    faces = np.array([(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)])
    return zoo.build("part", points.astype(np.float32), faces, smooth=False)


def gusset():
    body = joined(box(0, 0, 0, 80, 60, 5), box(0, 0, 0, 5, 60, 60))
    ribs = []
    for y in (10, 45):
        rib = extruded([np.array([(4.0, 4.0), (50.0, 4.0), (4.0, 45.0)])], y, y + 5, "y")
        ribs.append(swapped(rib))
    body = joined(body, *ribs)
    return cut(body, *holes([(60, 15), (60, 45), (25, 30)], 4, -1, 6), *holes([(30, 50)], 6, -1, 6, "x"))


def connector():
    body = cut(box(0, 0, 0, 70, 20, 14), box(4, 4, 6, 62, 12, 20))
    pins = [(8 + 6 * number, 7 + 6 * row) for number in range(10) for row in (0, 1)]
    return joined(body, *holes(pins, 1.0, 5, 13, segments=16))


def knob():
    angles = 2.0 * np.pi * np.arange(240) / 240
    out = 20.0 + 0.8 * np.abs(np.sin(20 * angles))
    outline = np.stack([out * np.cos(angles), out * np.sin(angles)], axis=1)
    body = joined(extruded([outline], 0, 14), extruded([circle(0, 0, 24, 64)], -3, 1))
    return cut(body, extruded([circle(0, 0, 3)], -4, 8), box(-1, 8, 13, 2, 10, 4))


PARTS = {
    each.__name__: each
    for each in (
        plate,
        screw_box,
        finger_box,
        bracket,
        channel,
        gear,
        spoked_gear,
        housing,
        flange,
        tee,
        engraved,
        grille,
        shaft,
        bolt,
        heat_sink,
        bearing_block,
        rounded_box,
        gusset,
        connector,
        knob,
    )
}
"""By name, what makes each."""
