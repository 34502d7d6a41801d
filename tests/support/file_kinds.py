# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways in which a bake can depend on a file beside its scene: mesh files, what they refer to, and the images of materials.

A kind is a function of an empty folder, which writes all files that the bake needs, and returns the one that it depends on, and
the options of the bake.
"""

import zipfile

import bpy

from tests.support import dependency_kinds, usd_files, zoo

KINDS = {}
"""The kinds by their names."""
BASE_COLOR = {"maps": ["base-color"]}


def kind(make):
    KINDS[make.__name__] = make
    return make


def written(path, *, image=None, slope=0.2, **more):
    """The mesh file of a bumpy square, whose material shows an image."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    obj = zoo.plane(path.stem, 8, slope=slope)
    if image is not None:
        material = bpy.data.materials.new("skin")
        tree = material.node_tree
        node, shader = tree.nodes.new("ShaderNodeTexImage"), tree.nodes["Principled BSDF"]
        node.image = bpy.data.images.load(str(image))
        tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
        obj.data.materials.append(material)
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.context.view_layer.update()
    _EXPORTERS[path.suffix](str(path), **more)
    return path


_EXPORTERS = {
    ".obj": lambda path, **more: bpy.ops.wm.obj_export(filepath=path, path_mode="RELATIVE", **more),
    ".ply": lambda path, **more: bpy.ops.wm.ply_export(filepath=path, **more),
    ".stl": lambda path, **more: bpy.ops.wm.stl_export(filepath=path, **more),
    ".gltf": lambda path, **more: bpy.ops.export_scene.gltf(filepath=path, export_format="GLTF_SEPARATE", **more),
    ".glb": lambda path, **more: bpy.ops.export_scene.gltf(filepath=path, **more),
    ".fbx": lambda path, **more: bpy.ops.export_scene.fbx(filepath=path, **more),
    **{
        ending: lambda path, **more: bpy.ops.wm.usd_export(filepath=path, **more)
        for ending in (".usd", ".usda", ".usdc")
    },
    ".blend": lambda path, **more: bpy.data.libraries.write(path, set(bpy.context.selected_objects), **more),
}


def meshes(folder, high, **more):
    """The options of a bake of a new low mesh from the file `high`."""
    low = folder / "low.obj"
    if not low.exists():
        written(low, slope=0.0, export_materials=False)
    return {"low-file": str(low), "high-file": [str(high)], **more}


def _of_format(ending, **more):
    def make(folder):
        path = written(folder / f"high{ending}", **more)
        return path, meshes(folder, path)

    make.__name__ = f"high_{ending[1:]}" + ("_of_text" if more else "")
    kind(make)


for _ending in _EXPORTERS:
    _of_format(_ending)
_of_format(".ply", ascii_format=True)
_of_format(".stl", ascii_format=True)


@kind
def low_file(folder):
    high = written(folder / "high.ply")
    options = meshes(folder, high)
    return folder / "low.obj", options


@kind
def cage_file(folder):
    high = written(folder / "high.ply")
    cage = written(folder / "cage.obj", slope=0.0, export_materials=False)
    return cage, meshes(folder, high, **{"cage-file": str(cage)})


@kind
def file_to_open(folder):
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    zoo.plane("low", 8), zoo.plane("high", 8, slope=0.2)
    path = folder / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path, {"file": str(path), "low": "low", "high": ["high"]}


@kind
def map_to_convert(folder):
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    path = dependency_kinds.saved_image(folder / "old.png", value=(0.5, 0.5, 1.0, 1.0))
    options = meshes(folder, "")
    del options["high-file"]
    return path, {**options, "convert": str(path), "space": "object", "size": 16}


# Materials of mesh files


@kind
def obj_materials(folder):
    """An .mtl."""
    path = written(folder / "high.obj", image=dependency_kinds.picture(folder / "skin.png"))
    return path.with_suffix(".mtl"), meshes(folder, path, **BASE_COLOR)


def _image_of(ending, **more):
    def make(folder):
        image = dependency_kinds.picture(folder / "skin.png")
        path = written(folder / f"high{ending}", image=image, **more)
        if ending == ".gltf":
            (image,) = [each for each in folder.glob("*.png") if each.read_bytes() != b""][-1:]
        return image, meshes(folder, path, **BASE_COLOR)

    make.__name__ = f"image_of_{ending[1:]}"
    kind(make)


_image_of(".obj")
_image_of(".gltf")
_image_of(".fbx", path_mode="RELATIVE")
_image_of(".usda", export_textures_mode="PRESERVE", relative_paths=True)
_image_of(".blend", path_remap="RELATIVE")


@kind
def image_of_ply(folder):
    path, image = written(folder / "high.ply", ascii_format=True), dependency_kinds.picture(folder / "skin.png")
    path.write_text(path.read_text().replace("element vertex", "comment TextureFile skin.png\nelement vertex", 1))
    return image, meshes(folder, path, **BASE_COLOR)


@kind
def tile_of_obj(folder):
    for tile in (1002, 1001):
        image = dependency_kinds.picture(folder / f"skin.{tile}.png", tile)
    path = written(folder / "high.obj", image=image)
    library = path.with_suffix(".mtl")
    library.write_text(library.read_text().replace("skin.1001", "skin.<UDIM>"))
    return image, meshes(folder, path, **BASE_COLOR)


@kind
def points_of_gltf(folder):
    """A .bin."""
    path = written(folder / "high.gltf")
    return path.with_suffix(".bin"), meshes(folder, path)


@kind
def image_in_fbx(folder):
    path = written(
        folder / "high.fbx",
        image=dependency_kinds.picture(folder / "skin.png"),
        path_mode="COPY",
        embed_textures=True,
    )
    (folder / "skin.png").unlink()
    return path, meshes(folder, path, **BASE_COLOR)


# Layers of USD


def _layered(name, text, part=".usda", root="root.usda"):
    """A file that refers to part.usda in some way. text: of the file."""

    def make(folder):
        path = written(folder / f"part{part}")
        high = folder / root
        if isinstance(text, bytes):
            high.write_bytes(text)
        else:
            high.write_text("#usda 1.0\n" + text)
        return path, meshes(folder, high)

    make.__name__ = name
    kind(make)


_layered("usd_sublayer", '(\n    subLayers = [@./part.usda@]\n    upAxis = "Z"\n)\n')
_layered("usd_reference", '(upAxis = "Z")\ndef "a" (references = @part.usda@</root>) {\n}\n')
_layered("usd_payload_of_binary", '(upAxis = "Z")\ndef "a" (payload = @part.usdc@</root>) {\n}\n', ".usdc")
_layered("usd_long_path", '(upAxis = "Z")\ndef "a" (references = @@@part.usda@@@</root>) {\n}\n')
_layered(
    "usd_variant",
    '(upAxis = "Z")\ndef "a" (\n variantSets = "v"\n variants = { string v = "one" }\n) {\n variantSet "v" = {\n'
    '  "one" (references = @part.usda@</root>) { }\n  "two" (references = @none.usda@</root>) { }\n }\n}\n',
)
_layered("binary_usd_sublayer", usd_files.binary(usd_files.SUBLAYER), root="root.usdc")
_layered("binary_usd_reference", usd_files.binary(usd_files.REFERENCE), root="root.usd")


@kind
def usd_layer_of_a_layer(folder):
    path = written(folder / "part.usda")
    (folder / "inner").mkdir()
    (folder / "inner" / "middle.usdc").write_bytes(usd_files.binary(usd_files.SUBLAYER))
    path = path.rename(folder / "inner" / "part.usda")
    high = folder / "root.usda"
    high.write_text('#usda 1.0\n(upAxis = "Z")\ndef "a" (references = @inner/middle.usdc@</root>) {\n}\n')
    return path, meshes(folder, high)


@kind
def usd_archive(folder):
    part = written(folder / "part.usdc")
    path, high = folder / "part.usdz", folder / "root.usda"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(part, "part.usdc")
    part.unlink()
    high.write_text('#usda 1.0\n(upAxis = "Z")\ndef "a" (references = @part.usdz@</root>) {\n}\n')
    return path, meshes(folder, high)


@kind
def usd_archive_itself(folder):
    path = folder / "high.usdz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(written(folder / "part.usdc"), "part.usdc")
    (folder / "part.usdc").unlink()
    return path, meshes(folder, path)


# Scenes


def _scene(name, make_high, **options):
    """A .blend that make_high(high, folder) has changed."""

    def make(folder):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        blend = str(folder / "scene.blend")
        bpy.ops.wm.save_as_mainfile(filepath=blend)
        low, high = zoo.plane("low", 8), zoo.plane("high", 8)
        path = make_high(high, folder)
        bpy.ops.wm.save_as_mainfile(filepath=blend)
        return path, {"file": blend, "low": low.name, "high": [high.name], **options}

    make.__name__ = name
    kind(make)


for _name, _make in {**dependency_kinds.KINDS, **dependency_kinds.PARTLY}.items():
    _scene(_name, _make)


def _shown(image_of):
    def make(high, folder):
        path, image = image_of(folder)
        material = bpy.data.materials.new("skin")
        tree = material.node_tree
        node, shader = tree.nodes.new("ShaderNodeTexImage"), tree.nodes["Principled BSDF"]
        node.image = image
        tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
        high.data.materials.append(material)
        return path

    return make


def _shown_in(ending, **values):
    def image_of(folder):
        path = dependency_kinds.saved_image(folder / f"skin{ending}", **values)
        return path, bpy.data.images.load(str(path))

    _scene(f"material_image_{ending[1:]}", _shown(image_of), **BASE_COLOR)


_shown_in(".png", file_format="PNG")
_shown_in(".jpg", file_format="JPEG")
_shown_in(".tif", file_format="TIFF")
_shown_in(".exr", file_format="OPEN_EXR")
_shown_in(".tga", file_format="TARGA_RAW")
_shown_in(".webp", file_format="WEBP")


@_shown
def _tiles(folder):
    paths = [dependency_kinds.picture(folder / f"skin.{number}.png", number) for number in (1001, 1002)]
    image = bpy.data.images.load(str(paths[0]))
    image.source = "TILED"
    image.filepath = str(folder / "skin.<UDIM>.png")
    image.tiles.new(tile_number=1002)
    return paths[0], image


_scene("material_tile", _tiles, **BASE_COLOR)


@_shown
def _sequence(folder):
    paths = [dependency_kinds.picture(folder / f"skin.{number:04}.png", number) for number in (1, 2)]
    image = bpy.data.images.load(str(paths[0]))
    image.source = "SEQUENCE"
    return paths[0], image


_scene("material_sequence", _sequence, **BASE_COLOR)


def _linked_material(high, folder):
    """The material of a library, whose image is at a path that begins at the library."""
    (folder / "tex").mkdir()
    path = dependency_kinds.picture(folder / "tex" / "skin.png")
    _shown(lambda _: (path, bpy.data.images.load(str(path))))(high, folder)
    material = high.data.materials[0]
    material.node_tree.nodes["Image Texture"].image.filepath = "//tex/skin.png"
    library = folder / "lib.blend"
    bpy.data.libraries.write(str(library), {material})
    high.data.materials.clear()
    bpy.data.materials.remove(material)
    with bpy.data.libraries.load(str(library), link=True) as (there, here):
        here.materials = there.materials[:]
    high.data.materials.append(here.materials[0])
    return path


_scene("image_of_a_linked_material", _linked_material, **BASE_COLOR)


def _library_of_material(high, folder):
    _linked_material(high, folder)
    return folder / "lib.blend"


_scene("library_of_a_material", _library_of_material, **BASE_COLOR)


def _linked_pair(folder, name):
    """A scene with a low and a high object, of which that of this name is linked. Returns its library and the bake."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    blend = str(folder / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    pair = {"low": zoo.plane("low", 8), "high": zoo.plane("high", 8, slope=0.2)}
    path = dependency_kinds.library(folder / "lib.blend", pair[name])
    dependency_kinds.linked_object_of(path, name)
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    return path, {"file": blend, "low": "low", "high": ["high"]}


@kind
def linked_high(folder):
    return _linked_pair(folder, "high")


@kind
def linked_low(folder):
    path, bake = _linked_pair(folder, "low")
    return path, {**bake, "no-material": True}


@kind
def cache_of_a_second_file(folder):
    """That of a .blend whose objects are appended."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    high = zoo.plane("high", 8)
    path = dependency_kinds.mesh_cache_mdd(high, folder)
    bpy.data.libraries.write(str(folder / "high.blend"), {high})
    return path, meshes(folder, folder / "high.blend")
