"""A variant of the shader that casts rays, which writes what it did instead of the hits."""

import re
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from addon.passes import shader, target
from addon.passes.bake import cast

FILE = "bake/cast_comp.glsl"
COUNTS = ("nodes", "candidates", "queries", "low nodes")
"""What is counted for each texel: nodes of the high tree, hits that are asked for their owner, searches for the point on
the low mesh closest to a hit, and nodes of the low tree that these visit."""
_COUNTED = (
    "uvec4 x = floatBitsToUint(texel_at(nodes, texture_place(node * 3)));",
    "if (owner_has_hit(",
    "vec3 closest = below;",
    "uvec4 x = floatBitsToUint(texel_at(low_nodes, texture_place(node * 3)));",
)
"""How the lines begin before which each is counted."""
_WRITE = "imageStore(hits, texel, chosen);"


def _counting(text):
    for line, component in zip(_COUNTED, "xyzw", strict=True):
        text = _replaced(text, line, f"counted.{component} += 1u; {line}")
    return "uvec4 counted = uvec4(0u);\n" + _replaced(text, _WRITE, _WRITE.replace("chosen", "vec4(counted)"))


def _replaced(text, old, new):
    """`text` with `old`, with which exactly one line begins, replaced."""
    found = re.findall(rf"^ +{re.escape(old)}", text, re.MULTILINE)
    assert len(found) == 1, f"{len(found)} lines of {FILE} begin with {old!r}: count in another place"
    return text.replace(found[0], found[0].replace(old, new))


@contextmanager
def counted(monkeypatch):
    """In this block, cast.trace writes the counts of each texel in place of its hit."""
    source = shader.source
    with monkeypatch.context() as patch:
        # Blender reads textures of floats only.
        patch.setattr(cast, "TRACE", replace(cast.TRACE, images=(("RGBA32F", "FLOAT_2D", "hits", "WRITE"),)))
        patch.setattr(shader, "source", lambda name: _counting(source(name)) if name == FILE else source(name))
        shader.load.cache_clear()
        try:
            yield
        finally:
            shader.load.cache_clear()


def of_rays(ray_cast, drawn, monkeypatch):
    """The counts (H, W, 4) of the rays `drawn`, in the order of COUNTS."""
    into = target.Target(drawn.width, drawn.height, ("RGBA32F",))
    with counted(monkeypatch):
        ray_cast.trace(into, drawn)
    counts = np.empty((into.height, into.width, 4), np.float32)
    into.read(counts)
    return counts
