# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of the panel Rays, in its order."""

from .choices import Directions, Hit
from .kinds import Choice, Color, Distance, Item, ObjectSlot, Setting, Switch, Text

RAYS: dict[str, Setting] = {
    "hit": Choice(
        label="Hit",
        tooltip="Which of the high surfaces along a ray the map shows",
        default=Hit.OWN,
        items=(
            Item(
                Hit.OWN,
                "Own",
                "The outermost surface that belongs to the texel: the texel is at the closest point of the low mesh, or next "
                "to it. Rays pass through other layers",
            ),
            Item(Hit.OUTERMOST, "Outermost", "The first surface from outside"),
            Item(Hit.NEAREST, "Nearest", "The surface nearest to the low mesh, inside or outside"),
        ),
    ),
    "cage": ObjectSlot(label="Cage", tooltip="Mesh on which the rays start. It must have the topology of the low mesh"),
    "measure": Switch(
        label="Measure Distances",
        tooltip="Measure how far the high surface lies from the low one, instead of using the distances below",
        default=True,
        empties=True,
        option=None,
    ),
    "extrusion": Distance(
        label="Extrusion",
        tooltip="Distance outside the low mesh at which the rays start",
        empty="measured",
        switch="measure",
        may_be_zero=True,
        shown=0.05,
        usual_most=1.0,
    ),
    "max_distance": Distance(
        label="Max Distance",
        tooltip="Length of the rays, from where they start",
        empty="measured",
        switch="measure",
        shown=0.1,
        usual_most=2.0,
    ),
    "directions": Choice(
        label="Directions",
        tooltip="Normals of the low mesh that the rays follow",
        default=Directions.BLENDED,
        items=(
            Item(
                Directions.BLENDED,
                "Blended",
                "Smooth at hard edges, which leaves no gaps, and straight away from them, which skews nothing",
            ),
            Item(Directions.SMOOTH, "Smooth", "Smooth vertex normals. Hard edges leave no gaps"),
            Item(Directions.SPLIT, "Split", "The mesh's own normals, with hard edges and custom normals"),
        ),
    ),
    "offset_group": Text(
        label="Offset Group",
        tooltip="Vertex group of the low mesh that scales the extrusion: with a weight of 0 rays start on the surface, "
        "0.5 changes nothing, and with 1 they start twice as far out",
        empty="the same extrusion everywhere",
    ),
    "straight_group": Text(
        label="Straight Group",
        tooltip="Vertex group of the low mesh that turns the rays: with a weight of 0 they follow smooth normals, "
        "0.5 changes nothing, and with 1 they follow the mesh's own normals",
        empty="the chosen directions everywhere",
    ),
    "facing_only": Switch(
        label="Ignore Backfaces", tooltip="Let the rays pass through faces of the high mesh that point away from them"
    ),
    "missed": Color(
        label="Miss Color",
        tooltip="Color of texels whose ray hits nothing. Their alpha is 0",
        default=(0.5, 0.5, 1.0),
    ),
    "mask": Switch(label="Miss Mask", tooltip="Also make an image that is white where the rays hit nothing"),
}
