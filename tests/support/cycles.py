"""Cycles as an oracle: it bakes the shading normals, colors and ambient occlusion of materials."""

import bpy
import numpy as np

from addon.core import udim
from addon.mesh.triangle_mesh import Mesh
from addon.passes import audit, mesh_upload
from addon.scene import mesh_reader
from tests.support import angles


def read(obj) -> Mesh:
    """The evaluated mesh of `obj`, with its active UVs."""
    with mesh_reader.evaluated(obj, bpy.context.evaluated_depsgraph_get()) as data:
        return mesh_reader.surface(data, data.uv_layers.active.name, obj.name, mesh_reader.matrix(obj))


def shared(obj, size) -> np.ndarray:
    """Which texels (H, W) bool several triangles of `obj` share: Cycles writes the last of them, Imprint that of the first
    part."""
    mesh = read(obj)
    return audit.counts(mesh_upload.upload(mesh.triangles, uv=mesh.uv), size, udim.uv_to_clip()) > 1


def world_normals(obj, size, **options) -> tuple[np.ndarray, np.ndarray]:
    """World-space unit normals (H, W, 3) of `bake_normals` and the mask (H, W) of what was written.

    Cycles' "object space" is M^-1 n, for an object with matrix M and the world normal n: the same as other people's
    under rotation, and something of its own under uneven scale. M takes it back to world space in any case.
    """
    texels, mask = bake_normals(obj, size, space="OBJECT", **options)
    normals = angles.decode(texels) @ np.array(obj.matrix_world)[:3, :3].T
    return normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12), mask


def bake_normals(obj, size, *, space, highs=(), extrusion=0.0, max_distance=0.0) -> tuple[np.ndarray, np.ndarray]:
    """Cycles' NORMAL bake of `obj`, one sample, as `bake` has it."""
    return bake(obj, size, "NORMAL", highs=highs, extrusion=extrusion, max_distance=max_distance, normal_space=space)


def bake_colors(obj, size, sockets, *, highs, extrusion=0.0, max_distance=0.0) -> tuple[np.ndarray, np.ndarray]:
    """What Cycles' EMIT bake shows of outputs that feed sockets of Principled BSDFs, as `bake` has it.

    sockets: by material, the output that is shown as emission.
    """
    surfaces = {}
    for material, output in sockets.items():
        tree = material.node_tree
        surface = tree.get_output_node("CYCLES").inputs["Surface"]
        emission = tree.nodes.new("ShaderNodeEmission")
        surfaces[material] = surface, surface.links[0].from_socket, emission
        tree.links.new(output, emission.inputs["Color"])
        tree.links.new(emission.outputs[0], surface)
    found = bake(obj, size, "EMIT", highs=highs, extrusion=extrusion, max_distance=max_distance)
    for material, (surface, shader, emission) in surfaces.items():
        material.node_tree.links.new(shader, surface)
        material.node_tree.nodes.remove(emission)
    return found


def bake(
    obj, size, kind, *, highs=(), extrusion=0.0, max_distance=0.0, samples=1, seed=0, **options
) -> tuple[np.ndarray, np.ndarray]:
    """Cycles' bake of `obj` onto its own active UV layer, without a margin.

    Returns texels (H, W, 4) float32, row 0 at v = 0, and the mask (H, W) of those that Cycles wrote. With `highs`,
    a selected-to-active bake. Every material of `obj` gets the target's image node for the time of the bake. options: of
    bpy.ops.object.bake.
    """
    width, height = size
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.seed = samples, seed
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    image = bpy.data.images.new("oracle", width, height, alpha=True, float_buffer=True, is_data=True)
    # Alpha 0 stays where the bake writes nothing.
    image.pixels.foreach_set(np.zeros(width * height * 4, np.float32))
    if not obj.data.materials:
        obj.data.materials.append(bpy.data.materials.new("oracle"))
    added = []
    for material in {slot.material for slot in obj.material_slots if slot.material}:
        tree = material.node_tree
        active = tree.nodes.active
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        node.select = True
        tree.nodes.active = node
        added.append((tree, node, active))
    bpy.ops.object.select_all(action="DESELECT")
    for other in (*highs, obj):
        other.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.bake(
        type=kind,
        margin=0,
        use_clear=False,
        use_selected_to_active=bool(highs),
        cage_extrusion=extrusion,
        max_ray_distance=max_distance,
        **options,
    )
    texels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(texels)
    for tree, node, active in added:
        tree.nodes.remove(node)
        tree.nodes.active = active
    bpy.data.images.remove(image)
    texels = texels.reshape(height, width, 4)
    return texels, texels[..., 3] > 0.5
