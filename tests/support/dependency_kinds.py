# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways in which an object can depend on a file: each makes one, for an object that has to be different without it.

A kind is a function of an object and an empty folder. It gives the object, a square of 8 x 8 faces, the dependency, and returns
the file, which it has written.
"""

import shutil
import struct
from pathlib import Path

import bpy
import numpy as np

from tests.support import feeds, zoo

FONT = Path(bpy.utils.system_resource("DATAFILES"), "fonts", "Inter.woff2")
KINDS = {}
"""The kinds by their names."""
PARTLY = {}
"""Those of which the file is one of many, or may be missing."""


def kind(make):
    KINDS[make.__name__] = make
    return make


def partly(make):
    PARTLY[make.__name__] = make
    return make


def points_of(obj, shift=0.2):
    """The points of an object (N, 3), moved up by a wave."""
    points = np.empty((len(obj.data.vertices), 3), np.float32)
    obj.data.vertices.foreach_get("co", points.reshape(-1))
    points[:, 2] += shift * np.sin(7 * points[:, 0])
    return points


def picture(path, seed=0):
    """Write a PNG of random grays."""
    values = np.random.default_rng(seed).integers(0, 256, (16, 16, 1)).astype(np.uint8)
    feeds.write_png(path, np.repeat(values, 3, axis=2))
    return path


def image_of(path):
    return bpy.data.images.load(str(path))


def nodes_of(obj, name="nodes"):
    """A new modifier of geometry nodes that changes nothing yet: its tree, and the nodes of its input and output."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    tree.links.new(start.outputs[0], end.inputs[0])
    modifier = obj.modifiers.new(name, "NODES")
    modifier.node_group = tree
    return tree, start, end, modifier


def give(modifier, identifier, value):
    """Set an input of the nodes of a modifier."""
    if hasattr(modifier, "properties"):
        getattr(modifier.properties.inputs, identifier).value = value
    else:
        modifier[identifier] = value


def texture_of(path):
    texture = bpy.data.textures.new("rough", "IMAGE")
    texture.image = image_of(path)
    return texture


def saved_image(path, size=16, value=None, **values):
    """Write an image in a format of Blender. value: of all texels; None for noise. values: settings of renders."""
    image = bpy.data.images.new("noise", size, size)
    noise = np.random.default_rng(0).random((size * size, 4))
    image.pixels.foreach_set((noise if value is None else 0 * noise + value).astype(np.float32).reshape(-1))
    settings = bpy.context.scene.render.image_settings
    for name, chosen in values.items():
        setattr(settings, name, chosen)
    image.save_render(str(path))
    bpy.data.images.remove(image)
    settings.file_format = "PNG"
    return path


def linked_object(name, data):
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def displace(obj, texture):
    modifier = obj.modifiers.new("rough", "DISPLACE")
    modifier.texture, modifier.texture_coords, modifier.strength = texture, "UV", 0.2


# Caches of points


@kind
def mesh_cache_mdd(obj, folder):
    points, path = points_of(obj), folder / "moved.mdd"
    head = struct.pack(">II", 1, len(points)) + struct.pack(">f", 0.0)
    path.write_bytes(head + points.astype(">f4").tobytes())
    modifier = obj.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format, modifier.filepath = "MDD", str(path)
    return path


@kind
def mesh_cache_pc2(obj, folder):
    points, path = points_of(obj), folder / "moved.pc2"
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, len(points), 0.0, 1.0, 1)
    path.write_bytes(head + points.astype("<f4").tobytes())
    modifier = obj.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format, modifier.filepath = "PC2", str(path)
    return path


def _moved_copy(obj):
    copy = obj.copy()
    copy.data = obj.data.copy()
    copy.data.vertices.foreach_set("co", points_of(obj).reshape(-1))
    copy.name = "moved"
    bpy.context.scene.collection.objects.link(copy)
    return copy


def _exported(obj, folder, ending, operator, **more):
    """The file of a moved copy of an object, which is removed."""
    copy, path = _moved_copy(obj), folder / f"moved{ending}"
    bpy.context.view_layer.update()
    for each in bpy.context.view_layer.objects:
        each.select_set(each == copy)
    bpy.context.view_layer.objects.active = copy
    operator(filepath=str(path), **more)
    bpy.data.objects.remove(copy)
    assert path.stat().st_size > 1000
    return path


def _sequence_cache(obj, path):
    bpy.ops.cachefile.open(filepath=str(path))
    modifier = obj.modifiers.new("cache", "MESH_SEQUENCE_CACHE")
    modifier.cache_file = bpy.data.cache_files[path.name]
    bpy.context.view_layer.update()  # reads the paths
    modifier.object_path = max((each.path for each in modifier.cache_file.object_paths), key=len)


@kind
def alembic_cache(obj, folder):
    path = _exported(obj, folder, ".abc", bpy.ops.wm.alembic_export, selected=True, start=1, end=1)
    _sequence_cache(obj, path)
    return path


@kind
def usd_cache(obj, folder):
    path = _exported(obj, folder, ".usda", bpy.ops.wm.usd_export, selected_objects_only=True)
    _sequence_cache(obj, path)
    return path


@kind
def usd_cache_of_layers(obj, folder):
    path = _exported(obj, folder, ".usda", bpy.ops.wm.usd_export, selected_objects_only=True)
    path = path.rename(folder / "part.usda")
    root = folder / "root.usda"
    root.write_text('#usda 1.0\n(\n    subLayers = [@part.usda@]\n    upAxis = "Z"\n)\n')
    _sequence_cache(obj, root)
    return path


@kind
def multires_external(obj, folder):
    modifier = obj.modifiers.new("detail", "MULTIRES")
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.multires_subdivide(modifier=modifier.name)
    bpy.ops.object.multires_base_apply(modifier=modifier.name)
    path = folder / "detail.btx"
    bpy.ops.object.multires_external_save(modifier=modifier.name, filepath=str(path))
    return path


# Images in modifiers


@kind
def displace_image(obj, folder):
    path = picture(folder / "rough.png")
    displace(obj, texture_of(path))
    return path


def _of_format(ending, **values):
    def make(obj, folder):
        path = saved_image(folder / f"rough{ending}", **values)
        displace(obj, texture_of(path))
        return path

    make.__name__ = f"displace_image_{ending[1:]}"
    kind(make)


_of_format(".jpg", file_format="JPEG")
_of_format(".tif", file_format="TIFF")
_of_format(".exr", file_format="OPEN_EXR")
_of_format(".tga", file_format="TARGA_RAW")
_of_format(".webp", file_format="WEBP")
_of_format(".bmp", file_format="BMP")
_of_format(".hdr", file_format="HDR")
_of_format(".jp2", size=64, file_format="JPEG2000")


@kind
def displace_image_tga_packed(obj, folder):
    """With its rows compressed."""
    path = saved_image(folder / "rough.tga", file_format="TARGA")
    displace(obj, texture_of(path))
    return path


@kind
def displace_image_of_nodes(obj, folder):
    """By the nodes of a texture."""
    path = picture(folder / "rough.png")
    texture = bpy.data.textures.new("rough", "CLOUDS")
    texture.use_nodes = True
    tree = texture.node_tree
    node, out = tree.nodes.new("TextureNodeImage"), next(each for each in tree.nodes if each.type == "OUTPUT")
    node.image = image_of(path)
    tree.links.new(node.outputs[0], out.inputs[0])
    displace(obj, texture)
    return path


@partly
def displace_image_sequence(obj, folder):
    paths = [picture(folder / f"rough.{number:04}.png", number) for number in (1, 2, 3)]
    texture = texture_of(paths[0])
    texture.image.source = "SEQUENCE"
    texture.image_user.frame_duration, texture.image_user.use_auto_refresh = 3, True
    bpy.context.scene.frame_set(2)
    displace(obj, texture)
    return paths[1]


@partly
def displace_image_tiles(obj, folder):
    paths = [picture(folder / f"rough.{number}.png", number) for number in (1001, 1002)]
    texture = texture_of(paths[0])
    texture.image.source = "TILED"
    texture.image.filepath = str(folder / "rough.<UDIM>.png")
    texture.image.tiles.new(tile_number=1002)
    displace(obj, texture)
    return paths[0]


@kind
def displace_movie(obj, folder):
    scene, path = bpy.context.scene, folder / "rough.mp4"
    strips = scene.sequence_editor_create()
    strips = strips.strips if hasattr(strips, "strips") else strips.sequences
    length = {"length": 2} if bpy.app.version >= (5, 0) else {"frame_end": 3}
    strips.new_effect(name="color", type="COLOR", channel=1, frame_start=1, **length).color = (1.0, 0.5, 0.2)
    scene.frame_end = 2
    render = scene.render
    render.resolution_x = render.resolution_y = 32
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = "VIDEO"
    render.image_settings.file_format, render.ffmpeg.format = "FFMPEG", "MPEG4"
    render.filepath, render.use_file_extension = str(path), False
    bpy.ops.render.render(animation=True)
    scene.sequence_editor_clear()
    displace(obj, texture_of(path))
    obj.modifiers[0].mid_level = 0.0
    return path


@kind
def wave_image(obj, folder):
    path = picture(folder / "wave.png")
    modifier = obj.modifiers.new("wave", "WAVE")
    modifier.texture, modifier.texture_coords, modifier.time_offset = texture_of(path), "UV", -20.0
    return path


@kind
def weights_from_image(obj, folder):
    path = picture(folder / "mask.png")
    obj.vertex_groups.new(name="mask").add(range(len(obj.data.vertices)), 1.0, "ADD")
    modifier = obj.modifiers.new("edit", "VERTEX_WEIGHT_EDIT")
    modifier.vertex_group, modifier.mask_texture, modifier.mask_tex_mapping = "mask", texture_of(path), "UV"
    modifier.default_weight = 0.0
    modifier.falloff_type = "STEP"
    moved = obj.modifiers.new("move", "DISPLACE")
    moved.vertex_group, moved.strength = "mask", 0.2
    return path


@kind
def warp_image(obj, folder):
    path = picture(folder / "warp.png")
    ends = [bpy.data.objects.new(name, None) for name in ("from", "to")]
    ends[1].location.z = 0.3
    for end in ends:
        bpy.context.scene.collection.objects.link(end)
    modifier = obj.modifiers.new("warp", "WARP")
    modifier.object_from, modifier.object_to = ends
    modifier.texture, modifier.texture_coords = texture_of(path), "UV"
    return path


# Volumes


def written_volume(path):
    """The file of a volume of a cube."""
    volume = linked_object("volume", bpy.data.volumes.new("volume"))
    cube = zoo.cube("filled")
    volume.modifiers.new("fill", "MESH_TO_VOLUME").object = cube
    graph = bpy.context.evaluated_depsgraph_get()
    grids = volume.evaluated_get(graph).data.grids
    assert len(grids) and grids.save(filepath=str(path))
    bpy.data.objects.remove(volume)
    bpy.data.objects.remove(cube)
    return path


@kind
def volume_to_mesh(obj, folder):
    path = written_volume(folder / "cloud.vdb")
    data = bpy.data.volumes.new("cloud")
    data.filepath = str(path)
    obj.modifiers.new("mesh", "VOLUME_TO_MESH").object = linked_object("cloud", data)
    return path


@kind
def nodes_import_vdb(obj, folder):
    path = written_volume(folder / "cloud.vdb")
    tree, node, _ = _joined_import(obj, path, "VDB")
    mesh = tree.nodes.new("GeometryNodeVolumeToMesh")
    realized = node.outputs[0].links[0].to_socket
    tree.links.new(node.outputs[0], mesh.inputs[0])
    tree.links.new(mesh.outputs[0], realized)
    return path


# Nodes


def _joined_import(obj, path, ending):
    tree, start, end, modifier = nodes_of(obj)
    node = tree.nodes.new(f"GeometryNodeImport{ending}")
    both = tree.nodes.new("GeometryNodeJoinGeometry")
    tree.links.new(start.outputs[0], both.inputs[0])
    realized = tree.nodes.new("GeometryNodeRealizeInstances")
    tree.links.new(node.outputs[0], realized.inputs[0])
    tree.links.new(realized.outputs[0], both.inputs[0])
    tree.links.new(both.outputs[0], end.inputs[0])
    node.inputs[0].default_value = str(path)
    return tree, node, modifier


@kind
def nodes_import_obj(obj, folder):
    path = _exported(obj, folder, ".obj", bpy.ops.wm.obj_export, export_selected_objects=True)
    _joined_import(obj, path, "OBJ")
    return path


@kind
def nodes_import_stl(obj, folder):
    path = _exported(obj, folder, ".stl", bpy.ops.wm.stl_export, export_selected_objects=True)
    _joined_import(obj, path, "STL")
    return path


@kind
def nodes_import_ply(obj, folder):
    path = _exported(obj, folder, ".ply", bpy.ops.wm.ply_export, export_selected_objects=True)
    _joined_import(obj, path, "PLY")
    return path


@kind
def nodes_import_by_text_node(obj, folder):
    path = _exported(obj, folder, ".obj", bpy.ops.wm.obj_export, export_selected_objects=True)
    tree, node, _ = _joined_import(obj, "", "OBJ")
    text = tree.nodes.new("FunctionNodeInputString")
    text.string = str(path)
    tree.links.new(text.outputs[0], node.inputs[0])
    return path


@kind
def nodes_import_by_modifier(obj, folder):
    path = _exported(obj, folder, ".obj", bpy.ops.wm.obj_export, export_selected_objects=True)
    tree, node, modifier = _joined_import(obj, "", "OBJ")
    socket = tree.interface.new_socket("Path", in_out="INPUT", socket_type="NodeSocketString")
    start = next(each for each in tree.nodes if each.type == "GROUP_INPUT")
    tree.links.new(start.outputs["Path"], node.inputs[0])
    give(modifier, socket.identifier, str(path))
    return path


@kind
def nodes_import_in_group(obj, folder):
    """The path is given to a group that contains the node."""
    path = _exported(obj, folder, ".obj", bpy.ops.wm.obj_export, export_selected_objects=True)
    inner, node, _ = _joined_import(obj, "", "OBJ")
    obj.modifiers.clear()
    inner.interface.new_socket("Path", in_out="INPUT", socket_type="NodeSocketString")
    start = next(each for each in inner.nodes if each.type == "GROUP_INPUT")
    inner.links.new(start.outputs["Path"], node.inputs[0])
    tree, start, end, _ = nodes_of(obj, "outer")
    group = tree.nodes.new("GeometryNodeGroup")
    group.node_tree = inner
    tree.links.new(start.outputs[0], group.inputs[0])
    tree.links.new(group.outputs[0], end.inputs[0])
    group.inputs["Path"].default_value = str(path)
    return path


def _image_nodes(obj):
    tree, start, end, modifier = nodes_of(obj)
    texture, place = tree.nodes.new("GeometryNodeImageTexture"), tree.nodes.new("GeometryNodeSetPosition")
    position = tree.nodes.new("GeometryNodeInputPosition")
    tree.links.new(position.outputs[0], texture.inputs["Vector"])
    tree.links.new(start.outputs[0], place.inputs["Geometry"])
    tree.links.new(texture.outputs["Color"], place.inputs["Offset"])
    tree.links.new(place.outputs[0], end.inputs[0])
    return tree, texture, modifier


@kind
def nodes_image(obj, folder):
    path = picture(folder / "nodes.png")
    _image_nodes(obj)[1].inputs["Image"].default_value = image_of(path)
    return path


@kind
def nodes_image_by_modifier(obj, folder):
    path = picture(folder / "nodes.png")
    tree, texture, modifier = _image_nodes(obj)
    socket = tree.interface.new_socket("Image", in_out="INPUT", socket_type="NodeSocketImage")
    start = next(each for each in tree.nodes if each.type == "GROUP_INPUT")
    tree.links.new(start.outputs["Image"], texture.inputs["Image"])
    give(modifier, socket.identifier, image_of(path))
    obj.update_tag()
    return path


@kind
def nodes_import_csv(obj, folder):
    """Points at each row."""
    path = folder / "rows.csv"
    path.write_text("x,y\n" + "".join(f"{row}.5,{row}.25\n" for row in range(40)))
    tree, node, _ = _joined_import(obj, path, "CSV")
    cube = tree.nodes.new("GeometryNodeMeshCube")
    placed, realized = tree.nodes.new("GeometryNodeInstanceOnPoints"), node.outputs[0].links[0].to_socket
    tree.links.new(node.outputs[0], placed.inputs["Points"])
    tree.links.new(cube.outputs[0], placed.inputs["Instance"])
    tree.links.new(placed.outputs[0], realized)
    return path


@kind
def nodes_import_text(obj, folder):
    path = folder / "words.txt"
    path.write_text("ab " * 20)
    tree, node = _filled(obj, "GeometryNodeStringToCurves")
    text = tree.nodes.new("GeometryNodeImportText")
    text.inputs[0].default_value = str(path)
    tree.links.new(text.outputs[0], node.inputs["String"])
    return path


def _filled(obj, node_type):
    """Nodes that fill the curves of a new node and join them with the object: the tree and the node."""
    tree, start, end, _ = nodes_of(obj)
    node, fill = tree.nodes.new(node_type), tree.nodes.new("GeometryNodeFillCurve")
    both, realized = tree.nodes.new("GeometryNodeJoinGeometry"), tree.nodes.new("GeometryNodeRealizeInstances")
    out = next(socket for socket in node.outputs if socket.type == "GEOMETRY")
    for one, other in ((out, realized), (realized.outputs[0], fill), (fill.outputs[0], both), (start.outputs[0], both)):
        tree.links.new(one, other.inputs[0])
    tree.links.new(both.outputs[0], end.inputs[0])
    return tree, node


@kind
def font_of_text_object(obj, folder):
    path = folder / "text.woff2"
    shutil.copyfile(FONT, path)
    text = bpy.data.objects.new("text", bpy.data.curves.new("text", "FONT"))
    text.data.body, text.data.font = "ab", bpy.data.fonts.load(str(path))
    bpy.context.scene.collection.objects.link(text)
    _, node = _filled(obj, "GeometryNodeObjectInfo")
    node.inputs["Object"].default_value = text
    return path


@kind
def font_of_nodes(obj, folder):
    path = folder / "text.woff2"
    shutil.copyfile(FONT, path)
    _, node = _filled(obj, "GeometryNodeStringToCurves")
    node.inputs["String"].default_value = "ab"
    found = bpy.data.fonts.load(str(path))
    if "Font" in node.inputs:
        node.inputs["Font"].default_value = found
    else:
        node.font = found
    return path


# Other objects


def _other(path, name="other"):
    """Another object, moved by a cache of points at `path`, which this writes."""
    other = zoo.plane(name, 8)
    other.location.z = 0.3
    mesh_cache_mdd(other, path.parent)
    (path.parent / "moved.mdd").rename(path)
    other.modifiers[0].filepath = str(path)
    return other


@kind
def boolean_of_a_cached_object(obj, folder):
    other = _other(folder / "other.mdd")
    other.location.z = 0.0
    modifier = obj.modifiers.new("cut", "BOOLEAN")
    modifier.object, modifier.solver = other, "EXACT"
    return folder / "other.mdd"


@kind
def shrinkwrap_around_a_cached_object(obj, folder):
    obj.modifiers.new("wrap", "SHRINKWRAP").target = _other(folder / "other.mdd")
    return folder / "other.mdd"


@kind
def transfer_through_two_objects(obj, folder):
    """The file moves an object around which another one lies, around which the object lies."""
    between = zoo.plane("between", 8)
    between.location.z = 0.1
    between.modifiers.new("wrap", "SHRINKWRAP").target = _other(folder / "other.mdd")
    obj.modifiers.new("wrap", "SHRINKWRAP").target = between
    return folder / "other.mdd"


@kind
def nodes_object_info(obj, folder):
    tree, start, end, _ = nodes_of(obj)
    node, both = tree.nodes.new("GeometryNodeObjectInfo"), tree.nodes.new("GeometryNodeJoinGeometry")
    node.inputs["Object"].default_value = _other(folder / "other.mdd")
    tree.links.new(start.outputs[0], both.inputs[0])
    tree.links.new(node.outputs["Geometry"], both.inputs[0])
    tree.links.new(both.outputs[0], end.inputs[0])
    return folder / "other.mdd"


@kind
def nodes_collection_info(obj, folder):
    collection = bpy.data.collections.new("parts")
    collection.objects.link(_other(folder / "other.mdd"))
    tree, start, end, _ = nodes_of(obj)
    node, both = tree.nodes.new("GeometryNodeCollectionInfo"), tree.nodes.new("GeometryNodeJoinGeometry")
    realized = tree.nodes.new("GeometryNodeRealizeInstances")
    node.inputs["Collection"].default_value = collection
    tree.links.new(start.outputs[0], both.inputs[0])
    tree.links.new(node.outputs[0], realized.inputs[0])
    tree.links.new(realized.outputs[0], both.inputs[0])
    tree.links.new(both.outputs[0], end.inputs[0])
    return folder / "other.mdd"


@kind
def curve_with_a_linked_bevel(obj, folder):
    """A tube whose section is in a library."""
    section = bpy.data.curves.new("section", "CURVE")
    section.splines.new("POLY").points.add(2)
    for point, place in zip(section.splines[0].points, ((0, 0), (0.2, 0), (0, 0.2)), strict=True):
        point.co = *place, 0.0, 1.0
    path = library(folder / "lib.blend", linked_object("section", section))
    tube = bpy.data.curves.new("tube", "CURVE")
    tube.splines.new("POLY").points.add(1)
    tube.splines[0].points[1].co = 1.0, 0.0, 0.3, 1.0
    tube.bevel_mode, tube.bevel_object = "OBJECT", linked_object_of(path, "section")
    tree, start, end, _ = nodes_of(obj)
    node, both = tree.nodes.new("GeometryNodeObjectInfo"), tree.nodes.new("GeometryNodeJoinGeometry")
    node.inputs["Object"].default_value = linked_object("tube", tube)
    tree.links.new(node.outputs["Geometry"], both.inputs[0])
    tree.links.new(start.outputs[0], both.inputs[0])
    tree.links.new(both.outputs[0], end.inputs[0])
    return path


@kind
def driver_of_a_linked_place(obj, folder):
    """A driver reads where an object of a library is."""
    other = linked_object("placed", None)
    other.location.z = 0.25
    path = library(folder / "lib.blend", other)
    modifier = obj.modifiers.new("move", "DISPLACE")
    modifier.direction, modifier.mid_level = "Z", 0.0
    driver = modifier.driver_add("strength").driver
    driver.type = "SUM"
    variable = driver.variables.new()
    variable.targets[0].id, variable.targets[0].data_path = linked_object_of(path, "placed"), "location.z"
    return path


# Caches of simulations and nodes


def simulated(obj, cache, folder):
    """Store three frames of a simulation on the disk. Returns the file of the last one."""
    cache.use_disk_cache, cache.frame_end = True, 3
    with bpy.context.temp_override(point_cache=cache, active_object=obj, object=obj):
        bpy.ops.ptcache.bake(bake=True)
    bpy.context.scene.frame_set(3)
    return max(path for path in folder.glob("blendcache_*/*.bphys") if "_000003_" in path.name)


@partly
def cloth_cache(obj, folder):
    obj.modifiers.new("cloth", "CLOTH")
    return simulated(obj, obj.modifiers[0].point_cache, folder)


@partly
def dynamic_paint_cache(obj, folder):
    """A brush paints a wave into the object."""
    brush = zoo.cube("brush")
    brush.modifiers.new("paint", "DYNAMIC_PAINT").ui_type = "BRUSH"
    bpy.context.view_layer.objects.active = brush
    bpy.ops.dpaint.type_toggle(type="BRUSH")
    obj.modifiers.new("paint", "DYNAMIC_PAINT")
    bpy.context.view_layer.objects.active = obj
    bpy.ops.dpaint.type_toggle(type="CANVAS")
    surface = obj.modifiers[0].canvas_settings.canvas_surfaces[0]
    surface.surface_type, surface.frame_end = "DISPLACE", 3
    return simulated(obj, surface.point_cache, folder)


@partly
def particles_cache(obj, folder):
    """A cube for each particle."""
    cube = zoo.cube("cube")
    cube.scale = 0.1, 0.1, 0.1
    obj.modifiers.new("particles", "PARTICLE_SYSTEM")
    system = obj.particle_systems[0]
    settings = system.settings
    settings.count, settings.frame_end, settings.render_type, settings.instance_object = 9, 2.0, "OBJECT", cube
    settings.particle_size = 0.2
    return simulated(obj, system.point_cache, folder)


@partly
def nodes_bake(obj, folder):
    tree, start, end, modifier = nodes_of(obj)
    node, place = tree.nodes.new("GeometryNodeBake"), tree.nodes.new("GeometryNodeSetPosition")
    if not node.bake_items:
        node.bake_items.new("GEOMETRY", "Geometry")
    place.inputs["Offset"].default_value = 0.0, 0.0, 0.2
    tree.links.new(start.outputs[0], place.inputs[0])
    tree.links.new(place.outputs[0], node.inputs[0])
    tree.links.new(node.outputs[0], end.inputs[0])
    bpy.context.view_layer.update()
    modifier.bake_directory, modifier.bake_target = str(folder / "nodes"), "DISK"
    modifier.bakes[0].bake_mode = "STILL"
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.geometry_node_bake_single(
        session_uid=obj.session_uid, modifier_name=modifier.name, bake_id=modifier.bakes[0].bake_id
    )
    place.inputs["Offset"].default_value = 0.0, 0.0, 0.0
    return max((path for path in folder.glob("nodes/**/*") if path.is_file()), key=lambda path: path.stat().st_size)


# Libraries


def library(path, *blocks):
    """Write datablocks into a library, and remove them."""
    bpy.data.libraries.write(str(path), set(blocks))
    bpy.data.batch_remove(blocks)
    return path


def _linked(path, kind_, name):
    with bpy.data.libraries.load(str(path), link=True) as (there, here):
        assert name in getattr(there, kind_)
        setattr(here, kind_, [name])
    (found,) = getattr(here, kind_)
    return found


@kind
def linked_target(obj, folder):
    """An object of a library that the object lies around."""
    other = zoo.plane("mate", 8, slope=0.2)
    other.location.z = 0.3
    path = library(folder / "lib.blend", other)
    obj.modifiers.new("wrap", "SHRINKWRAP").target = linked_object_of(path, "mate")
    return path


def linked_object_of(path, name):
    other = _linked(path, "objects", name)
    bpy.context.scene.collection.objects.link(other)
    return other


@kind
def linked_mesh(obj, folder):
    other = zoo.plane("mate", 8, slope=0.2)
    data = other.data
    data.name = "data of library"
    bpy.data.objects.remove(other)
    path = library(folder / "lib.blend", data)
    obj.data = _linked(path, "meshes", "data of library")
    return path


def _move_between(tree, start, end):
    """Let nodes move what comes from `start` up, on its way to `end`."""
    place = tree.nodes.new("GeometryNodeSetPosition")
    place.inputs["Offset"].default_value = 0.0, 0.0, 0.2
    tree.links.new(start.outputs[0], place.inputs[0])
    tree.links.new(place.outputs[0], end.inputs[0])


@kind
def linked_nodes(obj, folder):
    tree, start, end, modifier = nodes_of(obj, "nodes of library")
    _move_between(tree, start, end)
    path = library(folder / "lib.blend", tree)
    modifier.node_group = _linked(path, "node_groups", "nodes of library")
    return path


@kind
def library_of_a_library(obj, folder):
    """The nodes of a library are in another one."""
    tree, start, end, modifier = nodes_of(obj, "inner")
    _move_between(tree, start, end)
    inner = library(folder / "inner.blend", tree)
    outer, start, end, more = nodes_of(obj, "outer")
    group = outer.nodes.new("GeometryNodeGroup")
    group.node_tree = _linked(inner, "node_groups", "inner")
    outer.links.new(start.outputs[0], group.inputs[0])
    outer.links.new(group.outputs[0], end.inputs[0])
    path = library(folder / "outer.blend", outer)
    obj.modifiers.remove(modifier)
    more.node_group = _linked(path, "node_groups", "outer")
    return inner


@kind
def library_override(obj, folder):
    path = linked_target(obj, folder)
    other = obj.modifiers[0].target
    override = other.override_create(remap_local_usages=True)
    override.location.z = 0.4
    assert obj.modifiers[0].target == override
    return path


@kind
def image_of_a_library(obj, folder):
    """A texture of a library, with an image at a path that begins at the library."""
    (folder / "tex").mkdir()
    path = picture(folder / "tex" / "rough.png")
    texture = texture_of(path)
    texture.name = "rough of library"
    texture.image.filepath = "//tex/rough.png"
    file = library(folder / "lib.blend", texture)
    displace(obj, _linked(file, "textures", "rough of library"))
    return path
