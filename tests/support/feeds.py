# SPDX-License-Identifier: GPL-3.0-or-later
"""An oracle for feeds: a numpy evaluation of them on a square, and Cycles' emission bake of the same material."""

import struct
import zlib

import bpy
import numpy as np

from addon.core.material_feeds import AVERAGE, LUMINANCE, LUMINANCE_WEIGHTS, AttributeFeed, Constant, Extension
from addon.scene.mesh_elements import attribute_by_corner, uv_by_corner
from addon.scene.textures import srgb_to_linear

BAKED = "baked"
"""The UV layer of the square that bakes use: the square's own coordinates, from 0 to 1."""


def square(material, uv=((0, 0), (1, 0), (1, 1), (0, 1)), layer="UVMap"):
    """A square of one face with a UV layer for images, which is rendered, and the layer BAKED."""
    data = bpy.data.meshes.new("square")
    data.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
    for name, coordinates in ((layer, uv), (BAKED, ((0, 0), (1, 0), (1, 1), (0, 1)))):
        data.uv_layers.new(name=name).uv.foreach_set("vector", np.array(coordinates, np.float32).ravel())
    data.uv_layers[layer].active_render = True
    obj = bpy.data.objects.new("square", data)
    bpy.context.collection.objects.link(obj)
    data.materials.append(material)
    return obj


def evaluate(feed, images, data, size) -> np.ndarray:
    """The value of a feed at the texels of a bake of a `square` with the mesh `data`, (size, size, 3) float64."""
    if isinstance(feed, Constant):
        return np.broadcast_to(np.array(feed.color[:3]), (size, size, 3))
    if isinstance(feed, AttributeFeed):
        values = _interpolated(data, attribute_by_corner(data, feed.name), size)
    else:
        uv = _interpolated(data, uv_by_corner(data, feed.uv_layer), size)
        values = _sampled(feed, images, uv @ np.array(feed.mapping)[:, :2].T + np.array(feed.mapping)[:, 2])
    limits = feed.limits
    if feed.channel is None:
        chosen = values[..., :3]
    elif feed.channel in (LUMINANCE, AVERAGE):
        values = values.clip(limits.least, limits.most)
        weights = np.array(LUMINANCE_WEIGHTS if feed.channel == LUMINANCE else (1 / 3, 1 / 3, 1 / 3))
        chosen = np.repeat(values[..., :3] @ weights[:, None], 3, axis=-1)
    else:
        chosen = np.repeat(values[..., feed.channel, None], 3, axis=-1)
    return chosen.clip(limits.low, limits.high) * feed.scale + feed.offset


def _interpolated(data, corners, size):
    """Values by corner (4, n) at the texels, (size, size, n), linear in each of the two triangles."""
    data.calc_loop_triangles()
    x, y = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size)
    points = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    found = np.full((size, size, corners.shape[1]), np.nan)
    for triangle in data.loop_triangles:
        a, b, c = points[list(triangle.loops)]
        weights = np.linalg.solve(np.array([b - a, c - a]).T, np.stack([x - a[0], y - a[1]]).reshape(2, -1))
        weights = np.stack([1 - weights.sum(axis=0), *weights])
        inside = (weights >= -1e-9).all(axis=0).reshape(size, size)
        values = (weights.T @ corners[list(triangle.loops)]).reshape(size, size, -1)
        found[inside] = values[inside]
    return found


def _sampled(feed, images, uv):
    """The pixels of a feed's image at coordinates (..., 2)."""
    if feed.tiles:
        values = np.zeros((*uv.shape[:-1], 4))
        for tile in feed.tiles:
            corner = np.array([(tile - 1001) % 10, (tile - 1001) // 10])
            inside = (np.floor(uv) == corner).all(axis=-1)
            values[inside] = _filtered(
                scene_linear(images.load(feed.image, tile)), uv[inside] - corner, Extension.EXTEND, feed.is_smooth
            )
        return values
    return _filtered(scene_linear(images.load(feed.image)), uv, feed.extension, feed.is_smooth)


def scene_linear(page) -> np.ndarray:
    """The values (H, W, 4) of ImagePixels with linear colors."""
    if not page.is_srgb:
        return page.values
    return np.concatenate([srgb_to_linear(page.values[..., :3]), page.values[..., 3:]], axis=-1)


def _filtered(page, uv, extension, is_smooth):
    height, width = page.shape[:2]
    at = uv * (width, height)
    if not is_smooth:
        return _fetched(page, np.floor(at).astype(int), extension)
    low = np.floor(at - 0.5).astype(int)
    share = at - 0.5 - low
    values = 0.0
    for right in (0, 1):
        for up in (0, 1):
            weight = np.where(right, share[..., 0], 1 - share[..., 0]) * np.where(up, share[..., 1], 1 - share[..., 1])
            values = values + weight[..., None] * _fetched(page, low + (right, up), extension)
    return values


def _fetched(page, at, extension):
    count = np.array([page.shape[1], page.shape[0]])
    inside = ((at >= 0) & (at < count)).all(axis=-1)
    match extension:
        case Extension.REPEAT:
            at = at % count
        case Extension.MIRROR:
            at = at % (2 * count)
            at = np.where(at < count, at, 2 * count - 1 - at)
    at = at.clip(0, count - 1)
    values = page[at[..., 1], at[..., 0]].astype(np.float64)
    return np.where(inside[..., None], values, 0.0) if extension == Extension.CLIP else values


def write_png(path, values) -> str:
    """Write stored values (H, W, 1 to 4) uint8 or uint16, row 0 at the bottom. Returns the path."""
    height, width, channels = values.shape
    rows = values[::-1].astype(values.dtype.newbyteorder(">")).reshape(height, -1).view(np.uint8)
    lines = np.zeros((height, 1 + rows.shape[1]), np.uint8)
    lines[:, 1:] = rows
    header = struct.pack(
        ">IIBBBBB", width, height, 8 * values.dtype.itemsize, {1: 0, 2: 4, 3: 2, 4: 6}[channels], 0, 0, 0
    )
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(lines.tobytes())), (b"IEND", b""))
    packed = (
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    )
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(packed))
    return str(path)


def cycles(obj, output, size) -> np.ndarray:
    """What Cycles bakes as emission where a node's output feeds an Emission shader, (size, size, 3)."""
    tree = output.id_data
    emission, both = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeAddShader")
    surface = tree.get_output_node("CYCLES").inputs["Surface"]
    # The material's own shader stays: Cycles shows images in another way if their alpha is used.
    shader = surface.links[0].from_socket
    tree.links.new(shader, both.inputs[1])
    # A muted node without a way through leaves a socket's own value, as in the default of the base color.
    emission.inputs["Color"].default_value = (0.8, 0.8, 0.8, 1.0)
    tree.links.new(output, emission.inputs["Color"])
    # Cycles bakes nothing for emission that it finds to be constant.
    white = bpy.data.images.new("white", 1, 1, float_buffer=True, is_data=True)
    white.pixels[:] = (1.0, 1.0, 1.0, 1.0)
    one = tree.nodes.new("ShaderNodeTexImage")
    one.image = white
    tree.links.new(one.outputs["Color"], emission.inputs["Strength"])
    tree.links.new(emission.outputs[0], both.inputs[0])
    tree.links.new(both.outputs[0], surface)
    image = bpy.data.images.new("oracle", size, size, alpha=True, float_buffer=True, is_data=True)
    target = tree.nodes.new("ShaderNodeTexImage")
    target.image = image
    target.select = True
    tree.nodes.active = target
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    layers = obj.data.uv_layers
    rendered = next(layer.name for layer in layers if layer.active_render)
    layers.active = layers[BAKED]
    layers[rendered].active_render = True
    bpy.ops.object.bake(type="EMIT", margin=0, use_clear=False, uv_layer=BAKED)
    pixels = np.empty(size * size * 4, np.float32)
    image.pixels.foreach_get(pixels)
    for node in (emission, both, one, target):
        tree.nodes.remove(node)
    tree.links.new(shader, surface)
    bpy.data.images.remove(image)
    bpy.data.images.remove(white)
    return pixels.reshape(size, size, 4)[..., :3]
