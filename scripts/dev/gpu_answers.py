# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes addon/jobs/gpu_answers.npz: the meshes of the test of the GPU and what their maps should be.

It prints how far this GPU is from them.

    .venv/bin/python scripts/dev/gpu_answers.py [--check]

Nearly all answers are computed here, in double precision and without a shader: closed forms, or rays that test every triangle.
What depends on each single ray of a lattice, or on the rounds of adaptive samples, is drawn by Mesa's llvmpipe instead; a
coarse estimate, computed here as well, must agree with it. With --check, nothing is written. gpu_inputs.py has the meshes.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402, F401 - Blender's gpu module comes with it
import gpu  # noqa: E402

import addon  # noqa: E402
from addon.core.declarations import bases  # noqa: E402
from addon.core.map_types import MARGIN, WRITTEN  # noqa: E402
from addon.core.progress import finish  # noqa: E402
from addon.jobs import gpu_pairs  # noqa: E402
from addon.jobs.gpu_pairs import SIZE, Answer  # noqa: E402
from addon.passes import samples  # noqa: E402
from scripts.dev import gpu_inputs  # noqa: E402
from tests.support import oracle, raster  # noqa: E402

DRAWN = {"Adaptive samples": ("NORMAL",), "Rays from hits": ("AO", "BENT_NORMAL", "THICKNESS", "CURVATURE")}
"""The maps that llvmpipe draws, by pair."""
CENTERS = (np.arange(SIZE) + 0.5) / SIZE
INPUTS = gpu_inputs.arrays()


def meshes_of(name):
    """The meshes of some pairs, as the formulas make them."""
    return gpu_pairs.meshes_of(name, INPUTS)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def unit_or(vectors):
    """Unit vectors; those without a length stay."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


# Places on meshes


class Texels:
    """The triangle (SIZE, SIZE) of a mesh at the centers of texels, -1 for none, and the weights of its corners."""

    def __init__(self, mesh, shift=(0, 0)):
        """shift: of the texels from the first tile, as UVs."""
        self.mesh = mesh
        corners = mesh.uv[mesh.triangles].astype(np.float64) - shift
        place = np.stack(np.meshgrid(CENTERS, CENTERS), axis=-1).reshape(-1, 2)
        self.owner, self.weights = np.full(len(place), -1), np.zeros((len(place), 3))
        for number, (a, b, c) in enumerate(corners):
            matrix = np.array([b - a, c - a]).T
            if np.linalg.det(matrix) == 0.0:
                continue
            second, third = np.linalg.solve(matrix, (place - a).T)
            inside = (second >= 0.0) & (third >= 0.0) & (second + third <= 1.0)
            self.owner[inside] = number
            self.weights[inside] = np.stack([1.0 - second - third, second, third], axis=-1)[inside]
        self.owner, self.weights = self.owner.reshape(SIZE, SIZE), self.weights.reshape(SIZE, SIZE, 3)
        self.covered = self.owner >= 0

    def of(self, values):
        """Values by corner (C, n), interpolated: (SIZE, SIZE, n), 0 outside."""
        by_corner = np.asarray(values, np.float64)[self.mesh.triangles[self.owner]]
        return np.einsum("yxcn,yxc->yxn", by_corner, self.weights * self.covered[..., None])

    @property
    def points(self):
        return self.of(self.mesh.positions[self.mesh.vertices])


def corners_of(mesh):
    """The corners (T, 3, 3) of the triangles."""
    return mesh.positions[mesh.vertices[mesh.triangles]].astype(np.float64)


def in_basis(texels, normals, basis):
    """Normals (SIZE, SIZE, 3) in the tangent space of a basis, not of length one."""
    return np.linalg.solve(frames(texels, basis), np.where(texels.covered[..., None], normals, 1.0)[..., None])[..., 0]


def frames(texels, basis):
    """Tangent, bitangent and normal as columns (SIZE, SIZE, 3, 3); the unit matrix outside."""
    low = texels.mesh
    across = low.tangents[:, 3:] * np.cross(low.normals.astype(np.float64), low.tangents[:, :3])
    outside = ~texels.covered[..., None]
    normal, tangent, bitangent = (
        np.where(outside, axis, texels.of(values))
        for values, axis in zip((low.normals, low.tangents[:, :3], across), np.eye(3)[[2, 0, 1]], strict=True)
    )
    if basis.normalizes_normal:
        normal = unit(normal)
    if basis.normalizes_tangent:
        tangent = unit(tangent)
    if not basis.bitangent_of_vertices:
        sign = np.where(outside, 1.0, texels.of(low.tangents[:, 3:]))
        bitangent = sign * np.cross(normal, tangent)
    if basis.normalizes_bitangent:
        bitangent = unit(bitangent)
    return np.stack([tangent, bitangent, normal], axis=-1)


def hits(origins, directions, mesh, reach):
    """The triangle, the weights and the points of the nearest hits, all of which exist."""
    triangle, distance, weights, _ = oracle.first_hits(origins, directions, corners_of(mesh), reach)
    return triangle, weights, origins + np.where(triangle >= 0, distance, 0.0)[:, None] * directions


def smooth_normals(mesh, triangle, weights):
    return unit_or(np.einsum("pcn,pc->pn", mesh.normals[mesh.triangles[triangle]].astype(np.float64), weights))


# Answers


def stored(normals, covered):
    """Normals as maps have them."""
    return np.where(covered[..., None], 0.5 + 0.5 * unit(np.where(covered[..., None], normals, 1.0)), 0.0)


def answer(values, covered, is_compared=None):
    values = np.asarray(values, np.float64)
    values = values[..., None] if values.ndim == 2 else values
    return Answer(values, np.where(covered, WRITTEN, 0).astype(np.uint8), is_compared)


def flat_domes(basis):
    meshes = meshes_of("domes")
    low, high = Texels(meshes.low), Texels(meshes.highs[0])
    return {
        "NORMAL": answer(stored(in_basis(low, unit_or(high.of(high.mesh.normals)), basis), low.covered), low.covered)
    }


def cast_domes(basis):
    meshes = meshes_of("wide_domes")
    low = Texels(meshes.low)
    directions = unit_or(low.of(low.mesh.normals))[low.covered]
    origins = low.points[low.covered] + 0.4 * directions
    triangle, weights, _ = hits(origins, -directions, meshes.highs[0], 0.5)
    assert (triangle >= 0).all()
    normals = np.zeros((SIZE, SIZE, 3))
    normals[low.covered] = smooth_normals(meshes.highs[0], triangle, weights)
    return {"NORMAL": answer(stored(in_basis(low, normals, basis), low.covered), low.covered)}


def own_hits():
    """Rays are straight, and floor and roof have the UVs of what is above them."""
    high = Texels(meshes_of("layers").highs[0])
    return {"NORMAL": answer(stored(unit_or(high.of(high.mesh.normals)), high.covered), high.covered)}


def of_blocks():
    covered = Texels(meshes_of("blocks").low).covered
    return {"NORMAL": answer(stored(np.broadcast_to((0.0, 0.0, 1.0), (SIZE, SIZE, 3)), covered), covered)}


def of_points():
    meshes = meshes_of("tilted")
    low = Texels(meshes.low)
    points, covered = low.points, low.covered
    triangle, weights, found = hits(
        points[covered] + (0, 0, 2), np.broadcast_to((0.0, 0.0, -1.0), (covered.sum(), 3)), joined(meshes.highs), 4.0
    )
    assert (triangle >= 0).all()
    highs = joined(meshes.highs)
    normals, position, label = np.zeros((SIZE, SIZE, 3)), np.zeros((SIZE, SIZE, 3)), np.zeros((SIZE, SIZE, 2))
    normals[covered] = smooth_normals(highs, triangle, weights)
    position[covered], label[covered] = found, highs.labels[triangle]
    height = position[..., 2]
    vector = np.stack([np.zeros_like(height)] * 2 + [height], axis=-1)
    maps = {"POSITION": position, "HEIGHT": height, "DISPLACEMENT": vector, "DISTANCE": np.abs(height)}
    maps |= {"OBJECT_ID": label[..., 0], "MATERIAL_ID": label[..., 1]}
    maps["NORMAL"] = stored(normals, covered)
    made = {name: answer(values, covered) for name, values in maps.items()}
    return made | {"COVERAGE": answer(covered.astype(float), np.ones_like(covered))}


def of_means():
    """The means of the samples of a texel that the low mesh covers. The high one is level above it."""
    meshes = meshes_of("bumpy")
    height = float(meshes.highs[0].positions[0, 2])
    found = [Texels(meshes.low, np.array(offset) / SIZE) for offset in samples.offsets(4)]
    count = np.sum([each.covered for each in found], axis=0)
    covered = count > 0
    points = np.sum([each.points for each in found], axis=0) / np.maximum(count, 1)[..., None]
    points[..., 2] = np.where(covered, height, 0.0)
    made = {"POSITION": answer(points, covered), "HEIGHT": answer(points[..., 2], covered)}
    return made | {"COVERAGE": answer(count / len(found), np.ones_like(covered))}


def joined(meshes):
    """One mesh of two."""
    first, second = meshes
    corners, points = len(first.vertices), len(first.positions)
    return replace(
        first,
        positions=np.concatenate([first.positions, second.positions]),
        vertices=np.concatenate([first.vertices, points + second.vertices]),
        normals=np.concatenate([first.normals, second.normals]),
        triangles=np.concatenate([first.triangles, corners + second.triangles]),
        labels=np.concatenate([first.labels, second.labels]),
    )


def image_at(key, covered, uv):
    """The image (SIZE, SIZE, 4), 0 outside."""
    values = np.zeros((SIZE, SIZE, 4))
    values[covered] = raster.bilinear(gpu_inputs.image_of(key), uv[covered])
    return values


def of_materials():
    high = Texels(meshes_of("colored").highs[0])
    covered, x = high.covered, high.points[..., 0]
    first, second = gpu_inputs.LIMITS_OF_MATERIALS
    which = np.where(x < first, 0, np.where(x < second, 1, 2))
    image = image_at("color", covered, high.of(high.mesh.uv))
    paint = gpu_inputs.painted(high.points.reshape(-1, 3)).reshape(SIZE, SIZE, 4)
    constant = np.ones((SIZE, SIZE))
    maps = {
        "BASE_COLOR": np.choose(
            which[..., None], [image[..., :3], paint[..., :3], constant[..., None] * (0.8, 0.1, 0.3)]
        ),
        "ROUGHNESS": np.choose(which, [0.5 * image[..., 1] + 0.25, paint[..., 2], 0.7 * constant]),
        "METALLIC": np.choose(which, [0.0 * constant, paint[..., 0], constant]),
    }
    maps = {
        name: np.where(covered.reshape(covered.shape + (1,) * (values.ndim - 2)), values, 0.0)
        for name, values in maps.items()
    }
    rough, metal = maps["ROUGHNESS"], maps["METALLIC"]
    maps["packed"] = np.stack([rough, metal, np.where(covered, 1.0 - rough, 0.0), constant], axis=-1)
    return {name: answer(values, covered) for name, values in maps.items()}


def of_own_normals():
    high = Texels(meshes_of("bumpy").highs[0])
    covered, uv = high.covered, high.of(high.mesh.uv)
    normals = unit_or(2.0 * image_at("normals", covered, uv)[..., :3] - 1.0)
    # One pixel of the image to either side, by the same interpolation; x and y change by 2 where u and v change by the island.
    width = (gpu_inputs.WHOLE[2] - gpu_inputs.WHOLE[0]) / 2.0
    step = 0.5 / gpu_inputs.PIXELS
    slopes = [
        (image_at("bumps", covered, uv + way)[..., 0] - image_at("bumps", covered, uv - way)[..., 0])
        / (2.0 * step)
        * width
        for way in (np.array([step, 0.0]), np.array([0.0, step]))
    ]
    # Blinn's: on a plane along x and y, with the normal of the normal map.
    right, up = np.eye(3)[:2]
    gradient = slopes[0][..., None] * np.cross(up, normals) + slopes[1][..., None] * np.cross(normals, right)
    volume = normals[..., 2:]  # of right, up and the normal
    turned = unit_or(np.abs(volume) * normals - np.sign(volume) * gpu_pairs.DETAIL.distance * gradient)
    strength = gpu_pairs.DETAIL.strength
    return {"NORMAL": answer(stored(strength * turned + (1.0 - strength) * normals, covered), covered)}


def nearest(covered, reach):
    """For each texel the row and column of its nearest covered one, how many are as near, and whether it is in reach."""
    places = np.argwhere(covered)
    every = np.indices((SIZE, SIZE)).reshape(2, -1).T
    apart = every[:, None] - places
    square = (apart**2).sum(axis=-1)
    least = square.min(axis=1)
    chosen = places[square.argmin(axis=1)].reshape(SIZE, SIZE, 2)
    count = (square == least[:, None]).sum(axis=1).reshape(SIZE, SIZE)
    is_near = (np.abs(apart).max(axis=-1) <= reach).any(axis=1).reshape(SIZE, SIZE)
    return chosen[..., 0], chosen[..., 1], count, is_near


def extended():
    low = Texels(meshes_of("cut").low)
    covered = low.covered
    row, column, count, is_near = nearest(covered, 6)
    states = np.where(covered, WRITTEN, np.where(is_near, MARGIN, 0)).astype(np.uint8)
    values = gpu_inputs.painted(low.points[row, column].reshape(-1, 3)).reshape(SIZE, SIZE, 4)[..., :3]
    values = np.where((states > 0)[..., None], values, 0.0)
    # Of several that are as near, any is right.
    return {"BASE_COLOR": Answer(values, states, covered | (states == 0) | (count == 1))}


def across_seams():
    meshes = meshes_of("cut")
    low = Texels(meshes.low)
    covered = low.covered
    row, column, count, is_near = nearest(covered, 4)
    # Both islands have the same scale and direction: the surface goes on beyond a seam where the UVs do.
    texel = 2.0 * (1.0 + gpu_inputs.CUT) / 2.0 / 16.5
    place = low.points[row, column]
    right = np.arange(SIZE)[None, :] - column
    continues = (
        ~covered
        & (row == np.arange(SIZE)[:, None])
        & (np.sign(right) == np.where(place[..., 0] < gpu_inputs.CUT, 1, -1))
    )
    place = place + np.where(continues, right * texel, 0)[..., None] * (1.0, 0.0, 0.0)
    values = gpu_inputs.painted(place.reshape(-1, 3)).reshape(SIZE, SIZE, 4)[..., :3]
    states = np.where(covered, WRITTEN, np.where(is_near, MARGIN, 0)).astype(np.uint8)
    values = np.where((states > 0)[..., None], values, 0.0)
    # At the ends of the seam, the way to the nearest texel may cross it or not.
    inner = (place[..., 1] > -0.8) & (place[..., 1] < 0.8)
    return {"BASE_COLOR": Answer(values, states, covered | (states == 0) | ((count == 1) & inner))}


def of_tiles():
    maps = {}
    for tile, place in ((1002, (1, 0)), (1011, (0, 1))):
        high = Texels(meshes_of("tiled").highs[0], place)
        maps[f"NORMAL {tile}"] = answer(stored(unit_or(high.of(high.mesh.normals)), high.covered), high.covered)
    return maps


def degrees(a, b):
    chord = np.linalg.norm(unit_or(a) - unit_or(b), axis=-1)
    return np.degrees(2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0)))


def deviations():
    meshes = meshes_of("domes")
    low, high = Texels(meshes.low), Texels(meshes.highs[0])
    flat = frames(low, bases.MIKKTSPACE) @ (0.0, 0.0, 1.0)
    angles = np.sort(degrees(flat, high.of(high.mesh.normals))[low.covered])
    count = len(angles)
    chosen = [angles[int(np.ceil(share * count)) - 1] for share in (0.5, 0.95, 0.99)]
    return {"angles": answer(np.array([[*chosen, angles[-1]]]), np.ones((1, 4), bool))}


def engine_angles():
    low = Texels(meshes_of("domes").low)
    color = 2.0 * gpu_pairs.TILTED_COLOR[:3].astype(np.float64) - 1.0
    own, other = (frames(low, basis) @ color for basis in (bases.CYCLES, bases.NORMALIZED))
    return {"angles": answer(np.where(low.covered, degrees(own, other), -1.0), low.covered)}


# Estimates of what is drawn

SHARE_SEEN = 0.05
"""The most that 64 rays and 4 samples of a texel are off from many."""
FEWER_SAMPLES = 0.1
"""Degrees. The most by which a texel that adaptive samples leave out early is off from the mean of all 64."""


def check_estimates():
    """Compare what llvmpipe draws with estimates that share no code with it."""
    maps = finish(pair_named("Rays from hits").bake(stored=INPUTS))
    places = [(row, column) for row in range(6, SIZE - 4, 9) for column in range(6, SIZE - 4, 5)]
    seen = np.array([openness(place) for place in places])
    apart = np.abs(seen - [maps["AO"][0][place][0] for place in places])
    print(f"occlusion: {apart.max():.3f} from an estimate at {len(places)} texels")
    assert apart.max() < SHARE_SEEN
    found = finish(pair_named("Adaptive samples").bake(stored=INPUTS))["NORMAL"]
    covered = found[1] == WRITTEN
    apart = degrees(2.0 * found[0][..., :3] - 1.0, mean_of_tents())[covered]
    print(f"adaptive samples: {apart.max():.3f} degrees from the mean of all samples")
    assert apart.max() < FEWER_SAMPLES


def pair_named(name):
    return next(pair for pair in gpu_pairs.PAIRS if pair.name == name)


def openness(place, count=4096):
    """The share of the sky, by the cosine, that the surface sees on average below a texel."""
    meshes = meshes_of("blocks")
    corners = corners_of(meshes.highs[0])
    rng = np.random.default_rng(hash(place) % 2**32)
    texel = 2.0 / (SIZE * (gpu_inputs.WHOLE[2] - gpu_inputs.WHOLE[0]))
    start = np.array([(index + 0.5 - gpu_inputs.INSET) * texel - 1.0 for index in reversed(place)])
    start = start + texel * (rng.random((count, 2)) - 0.5)
    origins = np.column_stack([start, np.full(count, 2.0)])
    triangle, distance, _, _ = oracle.first_hits(
        origins, np.broadcast_to((0.0, 0.0, -1.0), origins.shape), corners, 4.0
    )
    assert (triangle >= 0).all()
    origins[:, 2] -= distance - 1e-6
    radius, angle = np.sqrt(rng.random(count)), 2.0 * np.pi * rng.random(count)
    up = np.sqrt(1.0 - radius**2)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), up], axis=-1)
    blocked, _, _, _ = oracle.first_hits(origins, directions, corners, 10.0)
    return np.mean(blocked < 0)


def mean_of_tents():
    """The mean of the normals (SIZE, SIZE, 3) at all samples of each texel."""
    meshes = meshes_of("tents")
    mesh, total = meshes.highs[0], 0.0
    texel = 2.0 / (SIZE * (gpu_inputs.WHOLE[2] - gpu_inputs.WHOLE[0]))
    centers = (np.arange(SIZE) + 0.5 - gpu_inputs.INSET) * texel - 1.0
    for x, y in samples.offsets(64):
        places = np.stack(np.meshgrid(centers + x * texel, centers + y * texel), axis=-1).reshape(-1, 2)
        origins = np.column_stack([places, np.full(len(places), 2.0)])
        down = np.broadcast_to((0.0, 0.0, -1.0), origins.shape)
        triangle, _, weights, _ = oracle.first_hits(origins, down, corners_of(mesh), 4.0)
        normals = smooth_normals(mesh, triangle, weights)
        normals[triangle < 0] = 0.0
        total = total + normals.reshape(SIZE, SIZE, 3)
    return unit_or(total)


COMPUTED = {
    **{f"Flatten, {basis.label}": (lambda basis=basis: flat_domes(basis)) for basis in bases.BASES},
    **{f"Cast, {basis.label}": (lambda basis=basis: cast_domes(basis)) for basis in bases.BASES},
    "Own hits under a roof": own_hits,
    "Rays from hits": of_blocks,
    "Points and labels": of_points,
    "Means of points": of_means,
    "Materials": of_materials,
    "Own normal and bump maps": of_own_normals,
    "Margin of the nearest": extended,
    "Margin across seams": across_seams,
    "UDIM tiles": of_tiles,
    "Deviation": deviations,
    "Angles of another engine": engine_angles,
}


def write(answers):
    """Store the meshes and the answers, by pair and map: these in 16 bits between the least and the largest value of each."""
    arrays = dict(INPUTS)
    for pair, maps in answers.items():
        for name, answer in maps.items():
            known = answer.values[answer.is_known]
            low, high = float(known.min(initial=0.0)), float(known.max(initial=0.0))
            scaled = (answer.values - low) / ((high - low) or 1.0) * gpu_pairs.STEPS
            scaled = np.where(answer.is_known[..., None], np.clip(np.round(scaled), 0, gpu_pairs.STEPS), 0)
            key = f"{pair}: {name}"
            # Channel after channel, and of each the changes along rows: smooth maps become small numbers.
            changes = np.diff(scaled.astype(np.uint16), axis=1, prepend=np.uint16(0))
            arrays[f"{key}/values"] = np.ascontiguousarray(np.moveaxis(changes, -1, 0))
            arrays[f"{key}/range"] = np.array([low, high])
            arrays[f"{key}/states"] = answer.states
            if answer.is_compared is not None:
                arrays[f"{key}/compared"] = np.packbits(answer.is_compared)
    np.savez_compressed(gpu_pairs.ANSWERS, **arrays)


def main():
    gpu.init()
    check_estimates()
    found = {}
    for pair in gpu_pairs.PAIRS:
        maps = finish(pair.bake(stored=INPUTS))
        own = COMPUTED[pair.name]() if pair.name in COMPUTED else {}
        for name in DRAWN.get(pair.name, ()):
            texels, states = maps[name]
            own[name] = Answer(texels[..., :3], states, None)
        for name in own:
            done = gpu_pairs.compare(pair, name, own[name], maps[name])
            print(f"{done.verdict.value:6} {done.text} [{done.worst:.3g}]")
        found[pair.name] = own
    addon.free()
    if "--check" not in sys.argv:
        write(found)
        print(f"{gpu_pairs.ANSWERS.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
