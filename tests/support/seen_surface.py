"""A high surface seen from above by a grid of parallel rays, with what its materials need on the GPU."""

import gpu
import numpy as np

from addon.core.declarations.choices import Hit
from addon.core.material_feeds import ImagePixels
from addon.mesh import bvh
from addon.passes import cast, data_texture, samples, surface_tables, surface_values, target
from addon.passes.surface_values import ImageAtHits


def grid(nu, nv, height=None, tilt=None):
    """The triangles (T, 3, 3) of a grid over the square 0..1; `height` moves points up, a function of x and y."""
    u, v = np.meshgrid(np.linspace(0, 1, nu + 1), np.linspace(0, 1, nv + 1))
    z = np.zeros_like(u) if height is None else height(u, v)
    points = np.stack([u, v, z], axis=-1)
    if tilt is not None:
        points = points @ np.asarray(tilt, float).T
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    return np.stack([np.stack([a, b, c], 2), np.stack([a, c, d], 2)], 2).reshape(-1, 3, 3)


class SeenSurface:
    """Triangles (T, 3, 3) seen along -Z from a grid of texels over the square 0..1.

    uv (T, 3, 2), by default x and y; materials (T,), by default 1; normals (T, 3, 3), by default +Z. is_low (height, width):
    the texels that the low mesh covers, by default all.
    """

    def __init__(self, triangles, size, *, uv=None, materials=None, normals=None, is_low=None):
        self.width, self.height = size
        self.is_low = np.ones(size[::-1]) if is_low is None else is_low
        triangles = np.asarray(triangles, np.float32)
        count = len(triangles)
        self.triangles, self.uv = triangles, triangles[..., :2] if uv is None else np.asarray(uv, np.float32)
        self.materials = np.ones(count) if materials is None else np.asarray(materials)
        self.normals = np.broadcast_to(np.float32((0, 0, 1)), (count, 3, 3)) if normals is None else normals
        points, numbers = triangles.reshape(-1, 3), np.arange(count * 3).reshape(-1, 3)
        tree = bvh.build(points, numbers)
        self.corners = numbers[tree.order]
        self.tables = cast.upload(
            tree,
            points,
            self.corners,
            np.asarray(self.normals, np.float32).reshape(-1, 3),
            np.zeros(count, int),
        )
        ordered = self.materials[tree.order]
        self.uvs = surface_tables.upload_uvs(self.uv.reshape(-1, 2), self.corners, ordered)
        self.labels = data_texture.upload(np.stack([np.ones(count), ordered, np.zeros(count)], 1).astype(np.float32))
        self.sums = target.Target(self.width, self.height, ("RGBA32F",))
        self.probe()

    def probe(self, shift=(0.0, 0.0)):
        """Trace the rays, each from the center of its texel or, in texels, `shift` beside it."""
        x, y = np.meshgrid(
            (np.arange(self.width) + 0.5 + shift[0]) / self.width,
            (np.arange(self.height) + 0.5 + shift[1]) / self.height,
        )
        self.x, self.y = x.astype(np.float32), y.astype(np.float32)
        rays = target.Target(self.width, self.height, ("RGBA32F", "RGBA32F"))
        one, zero = np.ones_like(self.x), np.zeros_like(self.x)
        rays.textures = [
            texture(np.stack(texels, -1))
            for texels in ((self.x, self.y, zero, self.is_low), (zero, zero, one, one * 5))
        ]
        self.hits = target.Target(self.width, self.height, ("RGBA32UI",))
        cast.trace(self.hits, rays, self.tables, None, cast.Search(Hit.OUTERMOST, 10.0, 20.0, False))
        self.rays = rays
        self.drawn_normals = target.Target(self.width, self.height, ("RGBA32F",))
        self.draw_normals(self.drawn_normals, np.eye(3))

    def draw_normals(self, into, matrix):
        """Write the interpolated normals at the hits, transformed by `matrix` (3, 3)."""
        cast.look_up(into, self.hits, self.rays, self.tables, matrix)

    def begin(self, materials, *, is_first=True):
        """Start a map: count misses and constants."""
        surface_values.add_constants(
            self.sums, self.hits, self.drawn_normals.texture, labels=self.labels, materials=materials, is_first=is_first
        )

    def add(self, page, feed, materials, number=1, **options):
        """Add an image."""
        surface_values.add_image(self.sums, self.at_hits(page, feed, materials, number, **options))

    def at_hits(self, page, feed, materials, number=1, **options):
        """An image at the hits."""
        return ImageAtHits(self.hits, page, feed, number, self.tables, self.uvs, materials, **options)

    def shown(self, page, feed, **options):
        """The whole map (height, width, 4) of one image on all materials."""
        materials = surface_tables.upload_materials(np.ones(10))
        self.begin(materials)
        self.add(page, feed, materials, **options)
        return self.read()

    def read(self):
        """The sums (height, width, 4)."""
        return read(self.sums)

    def means(self):
        """The map that the sums make, as samples are averaged."""
        mean = target.Target(self.width, self.height, ("RGBA32F",))
        samples.average(mean, self.sums, is_direction=False)
        return read(mean)


def texture(values):
    """A texture (RGBA32F) of `values` (height, width, 4)."""
    values = np.ascontiguousarray(values, np.float32)
    data = gpu.types.Buffer("FLOAT", values.shape, values)
    return gpu.types.GPUTexture(values.shape[1::-1], format="RGBA32F", data=data)


def read(drawn):
    """The texels (height, width, 4) of a target."""
    texels = np.empty((drawn.height, drawn.width, 4), np.float32)
    drawn.read(texels)
    return texels


def page(values, **facts):
    """A page of `values` (h, w) or (h, w, 3 or 4); alpha is 1 if there is none."""
    values = np.asarray(values, np.float32)
    if values.ndim == 2:
        values = np.repeat(values[..., None], 3, axis=-1)
    if values.shape[-1] == 3:
        values = np.concatenate([values, np.ones_like(values[..., :1])], axis=-1)
    return surface_tables.upload_image(ImagePixels(np.ascontiguousarray(values), **facts))
