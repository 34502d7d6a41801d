"""Materials as artists make them, and mixes of these, each with what its maps have to show."""

import random

import bpy
import numpy as np

from tests.support import exact_setups as nodes
from tests.support import maps
from tests.support.shader_nodes import add, principled

RED = (1.0, 0.0, 0.0, 1.0)


def put(material, **sources):
    """Connect outputs, or set values, to inputs of the Principled BSDF. Returns them by the names of the inputs."""
    by_input = {name.replace("_", " "): source for name, source in sources.items()}
    for name, source in by_input.items():
        socket = principled(material).inputs[name]
        if isinstance(source, bpy.types.NodeSocket):
            material.node_tree.links.new(source, socket)
        else:
            socket.default_value = source
    return by_input


def _surface(material, shader):
    material.node_tree.links.new(shader, material.node_tree.get_output_node("CYCLES").inputs["Surface"])


def _first(*arguments, **properties):
    """The first output of a new node."""
    return add(*arguments, **properties).outputs[0]


def _noise(material, *arguments):
    """The value of a noise."""
    return nodes.noise(material, *arguments).outputs[0]


def _tint(material):
    """The color of a noise."""
    return nodes.noise(material).outputs["Color"]


def _math(material, operation, *values):
    return _first(material, "Math", dict(enumerate(values)), operation=operation)


def _scaled(material, color, strength):
    return _first(material, "VectorMath", {"Vector": color, "Scale": strength}, operation="SCALE")


def _new_image(name, values, *, space="Non-Color"):
    """values: (H, W, 3)."""
    height, width = values.shape[:2]
    made = bpy.data.images.new(name, width, height, float_buffer=space == "Non-Color")
    made.colorspace_settings.name = space
    made.pixels.foreach_set(np.dstack([values, np.ones((height, width))]).astype(np.float32).ravel())
    made.pack()
    return made


# What varies little within a texel looks the same however it is averaged: Imprint takes the mean of images, Cycles a point.


def picture(seed, space="sRGB"):
    """An image of smooth colors."""
    turn = maps.texel_uv(256, 256) * 2.0 * np.pi + np.random.default_rng(seed).uniform(0.0, 6.0, 2)
    waves = np.stack([np.sin(turn[..., 0]), np.cos(turn[..., 1]), np.sin(turn.sum(axis=-1))], axis=-1)
    return _new_image(f"picture {seed}", 0.5 + 0.4 * waves, space=space)


def heights(material, seed=1):
    """A smooth image of heights."""
    u, v = np.moveaxis(maps.texel_uv(512, 512), -1, 0) * 2.0 * np.pi
    source = np.random.default_rng(seed)
    values = np.full((512, 512), 0.5)
    for _ in range(6):
        size, turn = source.uniform(0.03, 0.15), source.uniform(0.0, 6.0)
        values += size * np.sin(source.integers(-3, 4) * u + source.integers(1, 4) * v + turn)
    return _first(material, "TexImage", image=_new_image(f"heights {seed}", np.repeat(values[..., None], 3, axis=2)))


def directions(material, seed=1, vector=None):
    """A smooth normal map."""
    turn = maps.texel_uv(512, 512) * 2.0 * np.pi * np.random.default_rng(seed).integers(2, 6, 2)
    found = np.concatenate([0.3 * np.sin(turn), np.ones((512, 512, 1))], axis=-1)
    found = found / np.linalg.norm(found, axis=-1, keepdims=True) * 0.5 + 0.5
    return _first(
        material, "TexImage", {"Vector": vector} if vector else {}, image=_new_image(f"normals {seed}", found)
    )


def _second_uv(material):
    return _first(material, "UVMap", uv_map="second")


def _tiled(material):
    inputs = {"Vector": nodes.coordinate(material, "UV"), "Scale": (3.0, 2.0, 1.0), "Rotation": (0.0, 0.0, 0.5)}
    return _first(material, "TexImage", {"Vector": _first(material, "Mapping", inputs)}, image=picture(2))


def _cracks(material):
    return nodes.ramp(material, add(material, "TexVoronoi", feature="DISTANCE_TO_EDGE").outputs["Distance"], "LINEAR")


def _inverted_with_gamma(material):
    inverted = _first(material, "Invert", {"Color": nodes.picture(material)})
    return _first(material, "Gamma", {"Color": inverted, "Gamma": 2.2})


def _channels_exchanged(material):
    parts = add(material, "SeparateColor", {0: nodes.picture(material)}).outputs
    return _first(material, "CombineColor", dict(zip((2, 0, 1), parts, strict=True)))


def _snow_on_top(material):
    up = add(material, "SeparateXYZ", {0: add(material, "NewGeometry").outputs["Normal"]}).outputs[2]
    share = _math(material, "POWER", _math(material, "MAXIMUM", up, 0.0), 2.0)
    return nodes.mix(material, share, _tint(material), (0.9, 0.9, 0.95, 1.0))


def _with_back_faces(material):
    return nodes.mix(material, add(material, "NewGeometry").outputs["Backfacing"], nodes.picture(material), RED)


COLORS = {
    "image by another UV map": lambda m: _first(m, "TexImage", {"Vector": _second_uv(m)}, image=picture(1)),
    "tiled image": _tiled,
    "image from six sides": nodes.SETUPS["image from the sides"],
    "cubic image": nodes.SETUPS["cubic image"],
    "noise by generated coordinates": nodes.SETUPS["noise"],
    "noise by object coordinates": nodes.SETUPS["noise of object coordinates"],
    "ridged noise": nodes.SETUPS["ridged noise"],
    "voronoi": nodes.SETUPS["voronoi"],
    "cracks": _cracks,
    "wood": nodes.SETUPS["rings"],
    "bricks": nodes.SETUPS["bricks"],
    "checker": nodes.SETUPS["checker"],
    "magic": nodes.SETUPS["magic"],
    "gradient": nodes.SETUPS["gradient"],
    "pixels of white noise": nodes.SETUPS["white noise"],
    "image times vertex color": nodes.SETUPS["image times vertex color"],
    "ramp of noise": lambda m: nodes.ramp(m, _noise(m), "EASE"),
    "overlay": lambda m: nodes.mix(m, 0.7, _tint(m), nodes.picture(m), "OVERLAY"),
    "curves": nodes.SETUPS["bent curve"],
    "hue": nodes.SETUPS["hue of an image"],
    "inverted and with gamma": _inverted_with_gamma,
    "contrast": lambda m: _first(m, "BrightContrast", {"Color": _tint(m), "Contrast": 0.6}),
    "channels exchanged": _channels_exchanged,
    "snow on top": _snow_on_top,
    "back faces": _with_back_faces,
    "numbers of faces": nodes.SETUPS["number of faces"],
    "color of the object": nodes.SETUPS["color of the object"],
    "groups in groups": nodes.SETUPS["noise in groups"],
}
"""What makes the output that feeds the base color."""


def bump(material, height, below=None, **inputs):
    inputs = {"Distance": 0.08, "Height": height, **inputs}
    return _first(material, "Bump", inputs | ({"Normal": below} if below else {}))


def normal_map(material, **properties):
    return _first(material, "NormalMap", {"Color": directions(material)}, **properties)


def _by_another_uv_map(material):
    color = directions(material, vector=_second_uv(material))
    return _first(material, "NormalMap", {"Color": color}, uv_map="second")


def _for_directx(material):
    node = add(material, "NormalMap", {"Color": directions(material)})
    if hasattr(node, "convention"):  # since Blender 5.0
        node.convention = "DIRECTX"
    return node.outputs[0]


def _two_normal_maps(material):
    color = nodes.mix(material, _noise(material), directions(material, 1), directions(material, 2))
    return _first(material, "NormalMap", {"Color": color, "Strength": 1.5})


def _dents(material):
    cells = add(material, "TexVoronoi", feature="SMOOTH_F1").outputs["Distance"]
    return _first(material, "Bump", {"Distance": 0.1, "Height": cells}, invert=True)


def _two_bumps(material):
    return bump(material, _noise(material, nodes.coordinate(material, "Object")), bump(material, heights(material)))


def _on_normal_map(material):
    return bump(material, add(material, "TexWave", {"Scale": 2.0}).outputs["Fac"], normal_map(material))


def _in_group(material):
    """Bumps on a normal map in a group, with a scale from outside."""
    group = bpy.data.node_groups.new("leather", "ShaderNodeTree")
    group.interface.new_socket("Scale", in_out="INPUT", socket_type="NodeSocketFloat")
    group.interface.new_socket("Normal", in_out="OUTPUT", socket_type="NodeSocketVector")
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    cells = add(group, "TexVoronoi", {"Scale": start.outputs[0]}, feature="SMOOTH_F1")
    group.links.new(bump(group, cells.outputs["Distance"], normal_map(group)), end.inputs[0])
    node = add(material, "Group")
    node.node_tree = group
    node.inputs[0].default_value = 4.0
    return node.outputs[0]


def _from_arithmetic(material):
    """The normal of the surface, moved by a noise."""
    off = _first(material, "VectorMath", {0: _tint(material), 1: (0.4, 0.4, 0.4)}, operation="MULTIPLY")
    moved = {0: add(material, "NewGeometry").outputs["Normal"], 1: off}
    return _first(material, "VectorMath", {0: _first(material, "VectorMath", moved)}, operation="NORMALIZE")


NORMALS = {
    "normal map": normal_map,
    "normal map by another UV map": _by_another_uv_map,
    "normal map in object space": lambda m: normal_map(m, space="OBJECT"),
    "normal map for DirectX": _for_directx,
    "two normal maps mixed": _two_normal_maps,
    "bumps of an image": lambda m: bump(m, heights(m)),
    "bumps of noise": lambda m: bump(m, _noise(m)),
    "dents of voronoi": _dents,
    "two bumps": _two_bumps,
    "bumps on a normal map": _on_normal_map,
    "bumps in a group": _in_group,
    "normal from arithmetic": _from_arithmetic,
}
"""What makes the output that feeds the normal."""


def _shader(material, **inputs):
    """A Principled BSDF without highlights, whose normals Cycles would keep from pointing into the surface."""
    inputs = {name.replace("_", " "): value for name, value in inputs.items()}
    return _first(material, "BsdfPrincipled", {"Specular IOR Level": 0.0, **inputs})


def _mixed_shaders(material, factor, first, second):
    _surface(material, _first(material, "MixShader", {0: factor, 1: first, 2: second}))


def _rust_on_metal(material):
    mask, rust, paint = _noise(material), _tint(material), (0.1, 0.3, 0.7, 1.0)
    inputs = {"Factor_Float": mask, "A_Float": 0.9, "B_Float": 0.2}
    roughness = _first(material, "Mix", inputs, data_type="FLOAT")
    sides = (
        _shader(material, Base_Color=rust, Roughness=0.9),
        _shader(material, Base_Color=paint, Roughness=0.2, Metallic=1.0),
    )
    _mixed_shaders(material, mask, *sides)
    return {"Base Color": nodes.mix(material, mask, rust, paint), "Roughness": roughness, "Metallic": mask}


def _bumps_beside_none(material):
    _mixed_shaders(
        material, _noise(material), _shader(material, Normal=bump(material, heights(material))), _shader(material)
    )
    return {"Normal": None}


def _old_style(material):
    tint, metal, factor = _tint(material), (0.9, 0.8, 0.7, 1.0), 0.3
    diffuse = _first(material, "BsdfDiffuse", {"Color": tint})
    _mixed_shaders(material, factor, diffuse, _first(material, "BsdfGlossy", {"Color": metal, "Roughness": 0.25}))
    roughness = 1.0 + (0.25 - 1.0) * factor
    return {"Base Color": nodes.mix(material, factor, tint, metal), "Roughness": roughness, "Metallic": factor}


def _added(material):
    glow = _first(material, "Emission", {"Color": (1.0, 0.4, 0.1, 1.0), "Strength": 0.5})
    _surface(material, _first(material, "AddShader", {0: principled(material).outputs[0], 1: glow}))
    return put(material, Base_Color=_tint(material), Roughness=0.35)


def _emission_alone(material):
    tint, strength = _tint(material), _first(material, "TexVoronoi")
    _surface(material, _first(material, "Emission", {"Color": tint, "Strength": strength}))
    return {"Emission Color": _scaled(material, tint, strength)}


def _emission(material):
    tint, strength = nodes.picture(material), _noise(material)
    put(material, Emission_Color=tint, Emission_Strength=strength)
    return {"Emission Color": _scaled(material, tint, strength)}


def _transparent(material):
    mask = _first(material, "MapRange", {"Value": _noise(material), "From Min": 0.4, "From Max": 0.6})
    _mixed_shaders(material, mask, _first(material, "BsdfTransparent"), principled(material).outputs[0])
    return put(material, Base_Color=_tint(material)) | {"Alpha": mask}


def _packed(material):
    """Roughness and metallic in one image."""
    image = picture(3, space="Non-Color")
    parts = add(
        material, "SeparateColor", {0: _first(material, "TexImage", {"Vector": _second_uv(material)}, image=image)}
    )
    return put(material, Roughness=parts.outputs[1], Metallic=parts.outputs[2])


def _moss(material):
    """Green where bumps point up."""
    shape = bump(material, _noise(material))
    up = add(material, "SeparateXYZ", {0: shape}).outputs[2]
    color = nodes.mix(material, up, (0.3, 0.25, 0.2, 1.0), (0.1, 0.5, 0.1, 1.0))
    return put(material, Base_Color=color, Normal=shape) | {"Normal": None}


def _displaced(material):
    moved = _first(material, "Displacement", {"Height": _noise(material), "Scale": 0.1})
    material.node_tree.links.new(moved, material.node_tree.get_output_node("CYCLES").inputs["Displacement"])
    return {"Normal": None}


def _of_numbers(material):
    steps = nodes.SETUPS["smooth steps"](material)
    return put(
        material, Roughness=steps, Metallic=add(material, "TexWave").outputs["Fac"], Base_Color=(0.4, 0.3, 0.2, 1.0)
    )


SETUPS = {
    **{name: lambda m, make=make: put(m, Base_Color=make(m)) for name, make in COLORS.items()},
    **{name: lambda m, make=make: put(m, Normal=make(m)) | {"Normal": None} for name, make in NORMALS.items()},
    "numbers": _of_numbers,
    "packed image": _packed,
    "rust on metal": _rust_on_metal,
    "bumps of one of two shaders": _bumps_beside_none,
    "Diffuse and Glossy": _old_style,
    "Principled and Emission added": _added,
    "Emission alone": _emission_alone,
    "Emission by strength": _emission,
    "with transparency": _transparent,
    "moss on bumps": _moss,
    "displacement": _displaced,
}
"""By name: changes a material, and returns by input of the Principled BSDF what its map has to show, as an output or a value.
The output of a normal is that of a Diffuse BSDF; None is what Cycles bakes of the material itself."""
TOLD = {
    "pointiness": lambda m: add(m, "NewGeometry").outputs["Pointiness"],
    "fresnel": lambda m: _first(m, "Fresnel"),
    "layer weight": lambda m: add(m, "LayerWeight").outputs["Facing"],
    "ambient occlusion": lambda m: _first(m, "AmbientOcclusion"),
    "random of objects": lambda m: add(m, "ObjectInfo").outputs["Random"],
    "wireframe": lambda m: _first(m, "Wireframe"),
    "bevel": lambda m: _first(m, "Bevel"),
    "tangent": lambda m: _first(m, "Tangent"),
}
"""What is not known at a point of the surface, so that a bake has to name it."""


def mixed(seed):
    """As in SETUPS, a material made of several at random, in all its inputs."""
    source = random.Random(seed)
    colors = [name for name in COLORS if name not in {"checker", "bricks", "pixels of white noise", "numbers of faces"}]

    def make(material):
        def some():
            return COLORS[source.choice(colors)](material)

        def number():
            return _math(material, "ADD", some(), 0.0)

        blend = source.choice(("MIX", "MULTIPLY", "SCREEN", "OVERLAY", "SOFT_LIGHT", "DIFFERENCE"))
        factor = source.choice((_noise(material), source.uniform(0.2, 0.8)))
        tint, glow, strength = nodes.mix(material, factor, some(), some(), blend), some(), source.uniform(0.1, 0.6)
        normal = NORMALS[source.choice(list(NORMALS))](material)
        if source.random() < 0.5:
            cells = COLORS[source.choice(("ridged noise", "wood", "magic", "noise by object coordinates"))](material)
            normal = bump(material, _math(material, "ADD", cells, 0.0), normal, Strength=0.3)
        truth = put(material, Base_Color=tint, Roughness=number(), Metallic=number(), Alpha=number(), Normal=normal)
        put(material, Emission_Color=glow, Emission_Strength=strength)
        return truth | {"Emission Color": _scaled(material, glow, strength)}

    return make
