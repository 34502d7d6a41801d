"""Scenes with cut-outs: high cards whose alpha is clear around convex polygons, or the same polygons as faces, cut by hand."""

from dataclasses import dataclass

import numpy as np

from tests.support import scenes, zoo

SIDE = 128
"""Pixels of the images of alpha."""
SHARP = 0.25
"""How much alpha grows in a pixel, at the edges of polygons: interpolated linearly, it is a half on the edge itself."""


BODY, CARD = (0.02, 0.02, 0.4), (0.8, 0.1, 0.1)
"""The base colors of what is behind and before."""


@dataclass(frozen=True)
class Card:
    """A parallelogram: its first corner and its sides (3,). polygons: what is opaque, (N, 2) in UVs, counter-clockwise."""

    corner: tuple
    along_u: tuple
    along_v: tuple
    polygons: list

    def points(self, uv):
        return np.asarray(self.corner) + np.outer(uv[:, 0], self.along_u) + np.outer(uv[:, 1], self.along_v)


SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)


def alpha_of(polygons, size=SIDE):
    """An image (size, size) of alpha: 0.5 on the edges of convex polygons, in UVs from 0 to 1."""
    u, v = np.meshgrid(*[(np.arange(size) + 0.5) / size] * 2)
    inside = np.full((size, size), -np.inf)
    for polygon in polygons:
        edges = np.roll(polygon, -1, axis=0) - polygon
        normals = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
        distances = [n[0] * (u - p[0]) + n[1] * (v - p[1]) for n, p in zip(normals, polygon, strict=True)]
        inside = np.maximum(inside, np.min(distances, axis=0))
    return np.clip(0.5 + SHARP * size * inside, 0.0, 1.0).astype(np.float32)


def cards(name, made, *, by_hand, alpha=None, repeats=1):
    """An object of cards. by_hand: with what is opaque alone. alpha: the image of all cards, if not that of the first one's
    polygons. repeats: how often it is repeated along both sides."""
    points, faces, uvs = [], [], []
    for card in made:
        for polygon in card.polygons if by_hand else [SQUARE]:
            faces.append([sum(map(len, points)) + i for i in range(len(polygon))])
            points.append(card.points(polygon))
            uvs.append(polygon)
    obj = zoo.build(name, np.concatenate(points), faces, np.concatenate(uvs), smooth=False)
    material = scenes.material(f"{name} material", obj, Base_Color=CARD)
    if not by_hand:
        values = np.full((SIDE, SIDE, 3), 0.5)
        cut = alpha_of(made[0].polygons) if alpha is None else alpha
        image = scenes.image(f"{name} alpha", values, alpha=cut)
        node = scenes.texture(material, image)
        if repeats != 1:
            mapping = material.node_tree.nodes.new("ShaderNodeMapping")
            coordinates = material.node_tree.nodes.new("ShaderNodeUVMap")
            mapping.inputs["Scale"].default_value = (repeats, repeats, 1.0)
            material.node_tree.links.new(coordinates.outputs[0], mapping.inputs[0])
            material.node_tree.links.new(mapping.outputs[0], node.inputs[0])
        scenes.set_inputs(material, Alpha=node.outputs["Alpha"])
    return obj


def color_over(obj, alpha, **properties):
    """Give an object a material with an image of alpha (H, W). Returns the material."""
    image = scenes.image("alpha", np.full((*alpha.shape, 3), 0.5), alpha=alpha)
    material = scenes.material("card", obj, Base_Color=CARD)
    scenes.set_inputs(material, Alpha=scenes.texture(material, image, **properties).outputs["Alpha"])
    return material


def body(name="body"):
    """A wavy sheet below all cards."""
    obj = zoo.terrain(name, 24, height=0.04)
    scenes.material("skin", obj, Base_Color=BODY)
    return obj


def decal(*, by_hand):
    square = np.array([(0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75)])
    return [body(), cards("decal", [Card((-0.6, -0.6, 0.1), (1.2, 0, 0), (0, 1.2, 0), [square])], by_hand=by_hand)]


def leaves(*, by_hand):
    """Tilted leaf cards over each other."""
    leaf = np.array([(0.5, 0.05), (0.8, 0.35), (0.75, 0.6), (0.5, 0.95), (0.25, 0.6), (0.2, 0.35)])
    rng = np.random.default_rng(3)
    made = []
    for number in range(8):
        turn, size = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 0.9)
        along_u = size * np.array([np.cos(turn), np.sin(turn), 0.12 * rng.uniform(-1, 1)])
        along_v = size * np.array([-np.sin(turn), np.cos(turn), 0.12 * rng.uniform(-1, 1)])
        corner = np.array([*rng.uniform(-0.5, 0.5, 2), 0.16 + 0.05 * number]) - (along_u + along_v) / 2
        made.append(Card(corner, along_u, along_v, [leaf]))
    return [body(), cards("leaves", made, by_hand=by_hand)]


def fence(*, by_hand, repeats=4):
    """Bars of an image that is repeated."""
    low, high = 0.375, 0.625
    rows = [(low + i, high + i) for i in range(repeats)]
    between = [(0.0, low), *((high + i, low + i + 1) for i in range(repeats - 1)), (high + repeats - 1, float(repeats))]
    bars = [[(0, v0), (repeats, v0), (repeats, v1), (0, v1)] for v0, v1 in rows]
    bars += [[(u0, v0), (u1, v0), (u1, v1), (u0, v1)] for u0, u1 in rows for v0, v1 in between]
    polygons = [np.array(bar, float) / repeats for bar in bars]
    of_tile = [
        np.array([(-1, low), (2, low), (2, high), (-1, high)]),
        np.array([(low, -1), (high, -1), (high, 2), (low, 2)]),
    ]
    card = Card((-0.8, -0.8, 0.15), (1.6, 0, 0), (0, 1.6, 0), polygons)
    return [body(), cards("fence", [card], by_hand=by_hand, alpha=alpha_of(of_tile), repeats=repeats)]


def hair(*, by_hand):
    """Cards of thin strands in layers."""
    strands = [
        np.array([(x, 0.03), (x + 0.06, 0.03), (x + 0.04 + shift, 0.97), (x + 0.02 + shift, 0.97)])
        for x, shift in zip(np.linspace(0.05, 0.85, 8), np.linspace(-0.03, 0.05, 8), strict=True)
    ]
    rng = np.random.default_rng(5)
    made = [
        Card(
            (rng.uniform(-0.9, 0.1), rng.uniform(-0.9, 0.1), 0.1 + 0.03 * i), (0.8, 0, 0.02), (0.1, 0.8, 0.05), strands
        )
        for i in range(8)
    ]
    return [body(), cards("hair", made, by_hand=by_hand)]


SCENES = {each.__name__: each for each in (decal, leaves, fence, hair)}
