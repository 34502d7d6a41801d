"""Materials that Imprint does not follow itself, on one object with a material for each of its wedges."""

import bpy
import numpy as np

from tests.support.shader_nodes import add, image, principled

WEDGES_HIGH = 24
"""Faces from pole to pole."""


def noise(material, vector=None, **properties):
    return add(material, "TexNoise", {"Vector": vector} if vector else None, **properties)


def coordinate(material, name):
    return add(material, "TexCoord").outputs[name]


def color(node, name="Color"):
    return node.outputs[name]


def picture(material, seed=1, **properties):
    node = add(material, "TexImage", image=image(f"dots {seed}", (16, 16), seed=seed, space="Non-Color"), **properties)
    return node.outputs["Color"]


def ramp(material, value, interpolation):
    node = add(material, "ValToRGB", {0: value})
    ramp = node.color_ramp
    ramp.interpolation = interpolation
    ramp.elements[0].color, ramp.elements[1].color = (0.9, 0.1, 0.2, 1.0), (0.1, 0.6, 0.8, 1.0)
    ramp.elements.new(0.45).color = (0.2, 0.9, 0.1, 1.0)
    return node.outputs["Color"]


def mix(material, factor, first, second, blend="MIX"):
    inputs = {"Factor_Float": factor, "A_Color": first, "B_Color": second}
    node = add(material, "Mix", inputs, data_type="RGBA", blend_type=blend)
    return next(one for one in node.outputs if one.identifier == "Result_Color")


def in_group(material):
    """A noise in a group in a group, scaled by an input of both."""
    inner = bpy.data.node_groups.new("inner", "ShaderNodeTree")
    inner.interface.new_socket("Scale", in_out="INPUT", socket_type="NodeSocketFloat")
    inner.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    start, end = inner.nodes.new("NodeGroupInput"), inner.nodes.new("NodeGroupOutput")
    noise = add(inner, "TexNoise", {"Scale": start.outputs[0]})
    inner.links.new(noise.outputs["Color"], end.inputs[0])
    outer = bpy.data.node_groups.new("outer", "ShaderNodeTree")
    outer.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    held = outer.nodes.new("ShaderNodeGroup")
    held.node_tree = inner
    held.inputs[0].default_value = 3.0
    end = outer.nodes.new("NodeGroupOutput")
    outer.links.new(held.outputs[0], end.inputs[0])
    node = add(material, "Group")
    node.node_tree = outer
    return node.outputs[0]


def curve(material):
    node = add(material, "RGBCurve", {"Color": picture(material)})
    node.mapping.curves[3].points.new(0.4, 0.8)
    node.mapping.update()
    return node.outputs[0]


def muted(material):
    found, reroute = noise(material), material.node_tree.nodes.new("NodeReroute")
    material.node_tree.links.new(found.outputs["Color"], reroute.inputs[0])
    node = add(material, "Gamma", {"Color": reroute.outputs[0], "Gamma": 3.0})
    node.mute = True
    return node.outputs[0]


def steps(material):
    """White noise of whole numbers: the same at all points around."""
    scaled = add(material, "VectorMath", {0: coordinate(material, "UV"), 1: (9.0, 9.0, 9.0)}, operation="MULTIPLY")
    whole = add(material, "VectorMath", {0: scaled.outputs[0]}, operation="FLOOR")
    return add(material, "TexWhiteNoise", {"Vector": whole.outputs[0]}).outputs["Color"]


SETUPS = {
    "noise": lambda m: color(noise(m)),
    "noise of object coordinates": lambda m: color(noise(m, coordinate(m, "Object"))),
    "noise of UVs": lambda m: color(noise(m, coordinate(m, "UV"))),
    "noise of positions": lambda m: color(noise(m, add(m, "NewGeometry").outputs["Position"])),
    "noise in 4D": lambda m: color(noise(m, noise_dimensions="4D")),
    "ridged noise": lambda m: noise(m, noise_type="RIDGED_MULTIFRACTAL").outputs[0],
    "voronoi": lambda m: color(add(m, "TexVoronoi")),
    "distance to edges": lambda m: add(m, "TexVoronoi", feature="DISTANCE_TO_EDGE").outputs["Distance"],
    "smooth voronoi": lambda m: color(add(m, "TexVoronoi", feature="SMOOTH_F1")),
    "bands": lambda m: color(add(m, "TexWave")),
    "rings": lambda m: color(add(m, "TexWave", {"Distortion": 2.0}, wave_type="RINGS")),
    "magic": lambda m: color(add(m, "TexMagic")),
    "checker": lambda m: color(add(m, "TexChecker")),
    "bricks": lambda m: color(add(m, "TexBrick", {"Vector": coordinate(m, "UV")})),
    "gradient": lambda m: color(add(m, "TexGradient", {"Vector": coordinate(m, "Object")}, gradient_type="SPHERICAL")),
    "gabor": lambda m: add(m, "TexGabor").outputs[0],
    "white noise": steps,
    "bent ramp of an image": lambda m: ramp(m, picture(m), "EASE"),
    "ramp in steps": lambda m: ramp(m, noise(m).outputs[0], "CONSTANT"),
    "mix of noise and image": lambda m: mix(m, 0.4, color(noise(m)), picture(m)),
    "images mixed by noise": lambda m: mix(m, noise(m).outputs[0], picture(m, 1), picture(m, 2)),
    "image times vertex color": lambda m: mix(
        m, 1.0, picture(m), color(add(m, "VertexColor", layer_name="paint")), "MULTIPLY"
    ),
    "cubic image": lambda m: picture(m, interpolation="Cubic"),
    "image from the sides": lambda m: add(
        m, "TexImage", {"Vector": coordinate(m, "Generated")}, projection="BOX", image=image("sides", (16, 16), seed=5)
    ).outputs[0],
    "second UV map": lambda m: color(noise(m, add(m, "UVMap", uv_map="second").outputs[0])),
    "normal": lambda m: add(m, "NewGeometry").outputs["Normal"],
    "true normal": lambda m: add(m, "NewGeometry").outputs["True Normal"],
    "normal in object space": lambda m: coordinate(m, "Normal"),
    "generated": lambda m: coordinate(m, "Generated"),
    "object coordinates": lambda m: coordinate(m, "Object"),
    "color of the object": lambda m: mix(m, 0.5, add(m, "ObjectInfo").outputs["Color"], color(noise(m))),
    "property of the object": lambda m: add(m, "Attribute", attribute_type="OBJECT", attribute_name="wear").outputs[
        "Fac"
    ],
    "square of a vertex color": lambda m: add(
        m, "Math", {0: add(m, "VertexColor", layer_name="paint").outputs[0], 1: 2.0}, operation="POWER"
    ).outputs[0],
    "noise of an attribute": lambda m: noise(m, add(m, "Attribute", attribute_name="flow").outputs["Vector"]).outputs[
        0
    ],
    "number of faces": lambda m: ramp(m, add(m, "Attribute", attribute_name="number").outputs["Fac"], "LINEAR"),
    "bent curve": curve,
    "hue of an image": lambda m: add(m, "HueSaturation", {"Color": picture(m), "Hue": 0.3}).outputs[0],
    "turned noise": lambda m: color(
        noise(m, add(m, "Mapping", {"Vector": coordinate(m, "Object"), "Rotation": (0.4, 1.0, 2.0)}).outputs[0])
    ),
    "noise in groups": in_group,
    "smooth steps": lambda m: add(
        m,
        "MapRange",
        {"Value": noise(m).outputs[0], "From Min": 0.3, "From Max": 0.7},
        interpolation_type="SMOOTHSTEP",
    ).outputs[0],
    "temperature": lambda m: add(
        m,
        "Blackbody",
        {"Temperature": add(m, "Math", {0: noise(m).outputs[0], 1: 9000.0}, operation="MULTIPLY").outputs[0]},
    ).outputs[0],
    "muted": muted,
    "position in object space": lambda m: add(
        m,
        "VectorTransform",
        {"Vector": add(m, "NewGeometry").outputs["Position"]},
        vector_type="POINT",
        convert_from="WORLD",
        convert_to="OBJECT",
    ).outputs[0],
    "cross of coordinates": lambda m: add(
        m, "VectorMath", {0: coordinate(m, "Object"), 1: coordinate(m, "Generated")}, operation="CROSS_PRODUCT"
    ).outputs[0],
}
"""By name, what makes the output that feeds the base color of a material."""
FAST = (
    "noise",
    "noise of object coordinates",
    "bands",
    "bent ramp of an image",
    "images mixed by noise",
    "second UV map",
)
FAST += (
    "true normal",
    "normal in object space",
    "property of the object",
    "number of faces",
    "noise in groups",
    "generated",
)


def ball(names):
    """An object with a wedge for each set-up, and the outputs that feed its materials, by material."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=len(names), ring_count=WEDGES_HIGH)
    obj = bpy.context.object
    data = obj.data
    obj.location, obj.rotation_euler, obj.scale = (3.0, -1.0, 2.0), (0.3, 0.5, 0.1), (1.0, 1.3, 0.8)
    obj.color, obj["wear"] = (0.2, 0.5, 0.9, 1.0), 0.37
    data.shade_smooth()
    middles = np.array(
        [np.mean([data.uv_layers[0].uv[c].vector[0] for c in face.loop_indices]) for face in data.polygons]
    )
    data.polygons.foreach_set("material_index", np.clip(middles * len(names), 0, len(names) - 1).astype(np.int32))
    random = np.random.default_rng(3)
    second = data.uv_layers.new(name="second")
    uv = np.empty(2 * len(data.loops), np.float32)
    data.uv_layers[0].uv.foreach_get("vector", uv)
    second.uv.foreach_set("vector", (uv.reshape(-1, 2)[:, ::-1] * 2.0).ravel())
    paint = data.color_attributes.new("paint", "FLOAT_COLOR", "POINT")
    paint.data.foreach_set("color", random.uniform(0.2, 1.0, 4 * len(data.vertices)).astype(np.float32))
    flow = data.attributes.new("flow", "FLOAT_VECTOR", "POINT")
    flow.data.foreach_set("vector", random.uniform(-0.2, 0.2, 3 * len(data.vertices)).astype(np.float32))
    number = data.attributes.new("number", "FLOAT", "FACE")
    number.data.foreach_set("value", random.uniform(0.0, 1.0, len(data.polygons)).astype(np.float32))
    outputs = {}
    for name in names:
        material = bpy.data.materials.new(name)
        older = getattr(material, "node_tree", None)
        if older is None:
            material.use_nodes = True
        output = SETUPS[name](material)
        material.node_tree.links.new(output, principled(material).inputs["Base Color"])
        data.materials.append(material)
        outputs[material] = output
    bpy.context.view_layer.update()
    return obj, outputs


def wedges(count, size):
    """The number of the wedge of each texel (H, W), and -1 beside the borders between them and at the poles."""
    across = (np.arange(size[0]) + 0.5) / size[0] * count
    inner = np.abs(across % 1.0 - 0.5) < 0.5 - 1.5 * count / size[0]
    rows = np.abs((np.arange(size[1]) + 0.5) / size[1] - 0.5) < 0.5 - 2.0 / WEDGES_HIGH
    return np.where(inner[None] & rows[:, None], across.astype(int)[None], -1)
