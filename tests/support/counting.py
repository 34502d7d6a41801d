"""A variant of the shader that casts rays, which writes what it did instead of the hits."""

import re
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from addon.passes import cast, shader, target, unfinished
from addon.passes.shader import source as shader_source

FILES = "bake/cast_comp.glsl", "bake/cast_first_comp.glsl"
COUNTS = ("nodes", "candidates", "queries", "low nodes")
"""What is counted for each texel: nodes of the high tree, hits that are asked for their owner, searches for the point on
the low mesh closest to a hit, and nodes of the low tree that these visit."""
_COUNTED = (
    "uint mask = search_boxes(TREE_BOXES(nodes, node), grid_start, inverse, from, to);",
    "if (owner_has_hit(",
    "closest = below;",
    "uint mask = tree_closer(TREE_BOXES(low_nodes, node), grid_point, unit, best);",
)
"""How the lines begin before which each is counted. Where no owners are searched for, only the first one is there."""
_WRITES = "imageStore(hits, texel, chosen);", "imageStore(hits, texel, hit);"
_READS = "imageLoad(hits, texel).x != HIT_UNFINISHED"
"""In shaders that write counts, no ray is left unfinished."""


def _counting(file):
    text = shader_source(file)
    counted, write = (_COUNTED, _WRITES[0]) if file == FILES[0] else (_COUNTED[:1], _WRITES[1])
    for line, component in zip(counted, "xyzw", strict=False):
        text = _replaced(file, text, line, f"counted.{component} += 1u; {line}")
    assert text.count(_READS) == 1
    text = text.replace(_READS, "true")
    return "uvec4 counted = uvec4(0u);\n" + _replaced(file, text, write, "imageStore(hits, texel, vec4(counted));")


def _replaced(file, text, old, new):
    """`text` with `old`, with which exactly one line begins, replaced."""
    found = re.findall(rf"^ +{re.escape(old)}", text, re.MULTILINE)
    assert len(found) == 1, f"{len(found)} lines of {file} begin with {old!r}: count in another place"
    return text.replace(found[0], found[0].replace(old, new))


@contextmanager
def counted(monkeypatch):
    """In this block, cast.trace writes the counts of each texel in place of its hit."""
    with monkeypatch.context() as patch:
        for name in ("TRACE", "TRACE_FIRST"):
            # Blender reads textures of floats only.
            images = (("RGBA32F", "FLOAT_2D", "hits", "WRITE"), *unfinished.CARRIED)
            patch.setattr(cast, name, replace(getattr(cast, name), images=images))
        patch.setattr(shader, "source", lambda name: _counting(name) if name in FILES else shader_source(name))
        shader.load.cache_clear()
        try:
            yield
        finally:
            shader.load.cache_clear()


def of_rays(ray_cast, drawn, monkeypatch, *, has_packets):
    """The counts (H, W, 4) of the rays `drawn`, in the order of COUNTS. has_packets: whether rays pass the tree in packets
    before; what that visits is not counted."""
    into = target.Target(drawn.width, drawn.height, ("RGBA32F",))
    with counted(monkeypatch), monkeypatch.context() as patch:
        if not has_packets:
            patch.setattr(cast, "LEAST_PACKETS", drawn.width * drawn.height + 1)
        ray_cast.trace(into, drawn)
    counts = np.empty((into.height, into.width, 4), np.float32)
    into.read(counts)
    return counts
