# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports a character with a skin and two shape keys, poses it in three.js, and compares it with the posed high mesh.

    .venv/bin/python scripts/dev/characters.py [--npm DIR] [FILE.blend ...]

Needs Chromium and npm, as engines.py does. Each FILE.blend holds two objects that share UVs, "hi" and "lo"; without files, spot
of ../shared/assets. Both get the same two bones and shape keys, as functions of the place. The map is baked in the rest pose,
which the .glb has. The script then turns a joint, sets the weights of the shape keys, or both, and three.js draws the file: at
each pixel, the normal is compared with that of the high mesh at the same UV, posed as engines pose it.

Engines turn normals by the mixed rotations of the bones. Blender makes them anew from the posed faces, which differs where
weights change: the lines "as in Blender" compare with those.

Ends with 1 if a pose adds more than 0.5 degrees to the rest pose, in the median or at the 99th percentile.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402  it has gpu
import gpu  # noqa: E402
from mathutils import Quaternion  # noqa: E402

import addon  # noqa: E402
from addon.core.declarations import targets  # noqa: E402
from scripts.dev.in_engines import chromium, comparing, drawing, samples  # noqa: E402
from scripts.dev.in_engines.glb_file import Glb, node_matrix, unit  # noqa: E402
from tests.support import angles, scenes  # noqa: E402

FILES = ("spot_1696_536",)
PAIRS = ROOT / ".." / "shared" / "assets" / "pairs"
BONES = "root", "tip"
KEYS = {"wide": 0.7, "bent": 0.5}
"""The shape keys, and their values in the pose."""
TURN = Quaternion((0.0, 0.0, 1.0), np.radians(25.0)) @ Quaternion((1.0, 0.0, 0.0), np.radians(20.0))
"""Of the upper bone in the pose, in its own axes."""
MORE = 0.5
"""Degrees that the pose may add."""
TO_GLTF = np.eye(4)
TO_GLTF[:3, :3] = samples.TO_GLTF


@dataclass(frozen=True)
class Rig:
    """The armature of both meshes, and where it is: the lowest point (3,) of the meshes and their size."""

    armature: bpy.types.Object
    lowest: np.ndarray
    size: np.ndarray


def make_rig(objects: Sequence[bpy.types.Object]) -> Rig:
    """Two bones, one above the other, through the middle of the objects, with smooth weights and shape keys for these."""
    points = np.concatenate([world_points(obj) for obj in objects])
    lowest, size = points.min(axis=0), np.ptp(points, axis=0)
    armature = scenes.link(bpy.data.objects.new("rig", bpy.data.armatures.new("rig")))
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    middle = lowest + 0.5 * size
    for number, name in enumerate(BONES):
        bone = armature.data.edit_bones.new(name)
        bone.head, bone.tail = (
            (*middle[:2], lowest[2] + share * size[2]) for share in (0.5 * number, 0.5 * number + 0.5)
        )
        bone.parent = armature.data.edit_bones.get(BONES[0]) if number else None
    bpy.ops.object.mode_set(mode="OBJECT")
    rig = Rig(armature, lowest, size)
    for obj in objects:
        deform(obj, rig)
    return rig


def upper_weights(points: np.ndarray, rig: Rig) -> np.ndarray:
    """How much of the upper bone there is at points (N, 3)."""
    share = np.clip(((points[:, 2] - rig.lowest[2]) / rig.size[2] - 0.2) / 0.6, 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def deform(obj: bpy.types.Object, rig: Rig) -> None:
    """Give an object the weights and the shape keys, as functions of the place."""
    places, upper = (world_points(obj) - rig.lowest) / rig.size, upper_weights(world_points(obj), rig)
    for name, weights in zip(BONES, (1.0 - upper, upper), strict=True):
        scenes.weigh(obj, name, weights)
    obj.modifiers.new("Armature", "ARMATURE").object = rig.armature
    to_own = np.linalg.inv(np.array(obj.matrix_world)[:3, :3])
    own = points_of(obj.data)
    obj.shape_key_add(name="Basis")
    wave = np.sin(np.pi * places)
    moved = {
        "wide": np.stack([0.2 * (places[:, 0] - 0.5) * wave[:, 2], *2 * [0.0 * wave[:, 0]]], axis=1),
        "bent": np.stack([0.0 * wave[:, 0], 0.1 * wave[:, 2], 0.08 * wave[:, 0]], axis=1),
    }
    for name, offset in moved.items():
        key = obj.shape_key_add(name=name)
        key.points.foreach_set("co", (own + offset * rig.size @ to_own.T).astype(np.float32).ravel())
        key.value = 0.0


@dataclass(frozen=True)
class Pose:
    """Whether the upper bone is turned, and whether the shape keys have their values."""

    turns: bool
    bends: bool

    @property
    def keys(self) -> dict[str, float]:
        return {name: value * self.bends for name, value in KEYS.items()}


REST = Pose(False, False)
POSES = {"joint": Pose(True, False), "keys": Pose(False, True), "both": Pose(True, True)}


def put(rig: Rig, objects: Sequence[bpy.types.Object], pose: Pose) -> None:
    """Put the bones and the shape keys into a pose."""
    bone = rig.armature.pose.bones[BONES[1]]
    bone.rotation_mode = "QUATERNION"
    bone.rotation_quaternion = TURN if pose.turns else Quaternion()
    for obj in objects:
        for name, value in pose.keys.items():
            obj.data.shape_keys.key_blocks[name].value = value
    bpy.context.view_layer.update()


def points_of(mesh: bpy.types.Mesh) -> np.ndarray:
    points = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", points.reshape(-1))
    return points.astype(np.float64)


def world_points(obj: bpy.types.Object) -> np.ndarray:
    matrix = np.array(obj.matrix_world)
    return points_of(obj.data) @ matrix[:3, :3].T + matrix[:3, 3]


def corner_normals(obj: bpy.types.Object) -> np.ndarray:
    """The normals (L, 3) of the face corners as the object is now, in the world, in the axes of glTF."""
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    normals = np.array([corner.vector for corner in mesh.corner_normals])
    return unit(normals @ np.linalg.inv(np.array(obj.matrix_world)[:3, :3])) @ samples.TO_GLTF.T


def engine_normals(rig: Rig, high: bpy.types.Object, pose: Pose) -> np.ndarray:
    """As corner_normals in a pose, but as engines pose a mesh: what shape keys change is added up, and bones turn the sum by
    their rotations, mixed by the weights."""
    put(rig, [high], REST)
    rest, keys = corner_normals(high), high.data.shape_keys.key_blocks
    found = rest.copy()
    for name, value in pose.keys.items():
        keys[name].value = 1.0
        bpy.context.view_layer.update()
        found += value * (corner_normals(high) - rest)
        keys[name].value = 0.0
    put(rig, [high], pose)
    vertices = np.array([loop.vertex_index for loop in high.data.loops])
    upper = upper_weights(world_points(high), rig)[vertices, None]
    lower, tip = (unit(found) @ joint_deltas(rig)[name][:3, :3].T for name in BONES)
    return unit((1.0 - upper) * lower + upper * tip)


def laid_out_normals(high: bpy.types.Object, normals: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Normals of the face corners as a map (size, size, 3) by the UVs, and where there are some."""
    mesh = high.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    corners = np.array([triangle.loops for triangle in mesh.loop_triangles])
    uv = np.array([corner.vector for corner in mesh.uv_layers.active.uv])
    laid_out = drawing.lay_out(uv[corners], size)
    there, found = laid_out.there, np.zeros((size, size, 3))
    found[there] = unit(np.einsum("ncx,nc->nx", normals[corners[laid_out.triangle[there]]], laid_out.weights[there]))
    return found, there


def joint_deltas(rig: Rig) -> dict[str, np.ndarray]:
    """How far each bone is from its rest, as a matrix (4, 4) of the world in the axes of glTF."""
    world, found = np.array(rig.armature.matrix_world), {}
    for bone in rig.armature.pose.bones:
        moved = world @ np.array(bone.matrix) @ np.linalg.inv(world @ np.array(bone.bone.matrix_local))
        found[bone.name] = TO_GLTF @ moved @ np.linalg.inv(TO_GLTF)
    return found


def posed(glb: Glb, deltas: dict[str, np.ndarray], weights: dict[str, float]) -> Glb:
    """A copy of a file whose joints and shape keys are in a pose."""
    found = glb.copy()
    nodes = found.document["nodes"]

    def move(index: int, parent_rest: np.ndarray, parent: np.ndarray) -> None:
        node = nodes[index]
        rest = parent_rest @ node_matrix(node)
        now = deltas[node["name"]] @ rest if node.get("name") in deltas else parent @ node_matrix(node)
        if node.get("name") in deltas:
            for key in ("translation", "rotation", "scale"):
                node.pop(key, None)
            node["matrix"] = (np.linalg.inv(parent) @ now).T.ravel().tolist()
        for child in node.get("children", ()):
            move(child, rest, now)

    for root in found.roots():
        move(root, np.eye(4), np.eye(4))
    for mesh in found.document["meshes"]:
        mesh["weights"] = [weights[name] for name in mesh["extras"]["targetNames"]]
    return found


def deformed(glb: Glb) -> np.ndarray:
    """The corners (T, 3, 3) of the only mesh of a file, by the specification: first the shape keys, then the skin."""
    (node,) = (one for one in glb.document["nodes"] if "mesh" in one)
    (mesh,) = glb.document["meshes"]
    (part,) = mesh["primitives"]
    points = glb.accessor(part["attributes"]["POSITION"])
    for weight, target in zip(mesh.get("weights", ()), part["targets"], strict=False):
        points = points + weight * glb.accessor(target["POSITION"])
    skin, world = glb.document["skins"][node["skin"]], world_matrices(glb)
    inverse = matrices(glb, skin["inverseBindMatrices"])
    joints = np.stack([world[index] @ bind for index, bind in zip(skin["joints"], inverse, strict=True)])
    numbers, shares = (glb.accessor(part["attributes"][name]) for name in ("JOINTS_0", "WEIGHTS_0"))
    blended = np.einsum("vj,vjab->vab", shares, joints[numbers.astype(int)])
    points = np.einsum("vab,vb->va", blended, np.c_[points, np.ones(len(points))])[:, :3]
    return points[glb.accessor(part["indices"]).reshape(-1, 3)]


def world_matrices(glb: Glb) -> dict[int, np.ndarray]:
    """The matrix (4, 4) of each node, to the world."""
    found: dict[int, np.ndarray] = {}

    def walk(index: int, parent: np.ndarray) -> None:
        node = glb.document["nodes"][index]
        found[index] = parent @ node_matrix(node)
        for child in node.get("children", ()):
            walk(child, found[index])

    for root in glb.roots():
        walk(root, np.eye(4))
    return found


def matrices(glb: Glb, index: int) -> np.ndarray:
    """An accessor of matrices, (N, 4, 4)."""
    about = glb.document["accessors"][index]
    view = glb.document["bufferViews"][about["bufferView"]]
    start = view.get("byteOffset", 0) + about.get("byteOffset", 0)
    values = np.frombuffer(glb.binary, "<f4", 16 * about["count"], start)
    return values.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)


def measure(file: Path, modules: Path, texels: int, pixels: int) -> dict[str, np.ndarray]:
    """The degrees of all pixels away from seams: at rest and posed, each with the map and without."""
    bpy.ops.wm.open_mainfile(filepath=str(file))
    low, high = bpy.data.objects["lo"], bpy.data.objects["hi"]
    rig = make_rig([low, high])
    covered = samples.bake(low, high, texels, "OBJECT", margin=0)[0][..., 3] > 0.5
    glb = samples.export(samples.bake(low, high, texels, "TANGENT", targets.BY_NAME["three"].basis.name)[1])
    files, truths = {}, {}
    for name, pose in {"rest": REST, **POSES}.items():
        put(rig, [low, high], pose)
        files[name] = posed(glb, joint_deltas(rig), pose.keys)
        truths[name, "Blender"] = laid_out_normals(high, corner_normals(high), texels)
        truths[name, "engines"] = laid_out_normals(high, engine_normals(rig, high, pose), texels)
    surface = glb.surface()
    laid_out = drawing.lay_out(samples.with_v_up(surface.uv), texels)
    sample = samples.Sample(
        file.stem, files, surface, np.eye(3), laid_out, covered & (laid_out.count == 1), np.zeros((texels, texels, 3))
    )
    sights = {name: drawing.look_around(deformed(one), comparing.DIRECTIONS, pixels) for name, one in files.items()}
    models = []
    for name, one in files.items():
        sight = sights[name]
        one.set_cameras(sight.matrices, drawing.ANGLE, sight.near, sight.far)
        models.append(chromium.Model(name, one.content()))
    shown: dict[tuple[str, int], np.ndarray] = {}

    def keep(name: str, view: int, _output: str, values: np.ndarray) -> None:
        normals = unit(values[..., :3].astype(np.float64) * 2.0 - 1.0)
        shown[name, view] = np.where(values[..., 3:] > 0.5, normals, 0.0)

    chromium.render(modules, "three", models, views=len(comparing.DIRECTIONS), size=pixels, keep=keep)
    found: dict[str, list[np.ndarray]] = {}
    for (name, way), (truth, is_true) in truths.items():
        for view, drawn in enumerate(sights[name].drawn):
            normals = shown[name, view]
            is_there = comparing.away_from_seams(sample, drawn) & normals.any(axis=-1)
            uv = np.einsum("ncx,nc->nx", sample.uv[drawn.triangle[is_there]], drawn.weights[is_there])
            expected, is_known = sampled(truth, is_true, uv)
            degrees = angles.degrees(normals[is_there][is_known], expected[is_known])
            found.setdefault(f"{name}, high as in {way}", []).append(degrees)
    return {name: np.concatenate(parts) for name, parts in found.items()}


def sampled(truth: np.ndarray, is_true: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normals between four texels at uv (N, 2), and where all four are known."""
    columns, rows = drawing.footprint(uv, len(truth))
    x, y = (uv * len(truth) - 0.5 - np.floor(uv * len(truth) - 0.5)).T
    shares = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=1)
    return unit(np.einsum("nf,nfx->nx", shares, truth[rows, columns])), is_true[rows, columns].all(axis=1)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.blend")
    parser.add_argument("--map", type=int, default=1024, metavar="TEXELS")
    parser.add_argument("--view", type=int, default=1024, metavar="PIXELS")
    parser.add_argument("--npm", type=Path, metavar="DIR")
    given = parser.parse_args()
    gpu.init()
    is_far = False
    try:
        with tempfile.TemporaryDirectory() as temporary:
            modules = chromium.install(given.npm or Path(temporary))
            for file in given.files or [PAIRS / f"{name}.blend" for name in FILES]:
                found = measure(file, modules, given.map, given.view)
                print(f"{file.stem}, degrees to the high mesh in three.js (median, 95, 99 percent, pixels):")
                shares = {name: np.percentile(values, (50, 95, 99)) for name, values in found.items()}
                for name, values in shares.items():
                    print(f"  {name:28} {values[0]:6.2f} {values[1]:6.2f} {values[2]:6.2f} {len(found[name]):9,}")
                for name in POSES:
                    more = shares[f"{name}, high as in engines"] - shares["rest, high as in engines"]
                    is_far |= bool((more > MORE)[[0, 2]].any())
    except chromium.NoEngine as error:
        sys.exit(f"characters.py: {error}")
    finally:
        addon.free()
    return int(is_far)


if __name__ == "__main__":
    sys.exit(main())
