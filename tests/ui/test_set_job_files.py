# SPDX-License-Identifier: GPL-3.0-or-later
"""Sets to a job file and back: the same sets, and the same maps to the bit, also from a shell."""

import json
import tomllib

import bpy
import numpy as np
import pytest

from addon.cli import command, job_file
from addon.ui import job_files, object_pairs, sets, sets_panel
from tests.support import maps, panel_layout, zoo
from tests.support.panel import refusal, select, use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def props(tmp_path):
    """A saved file with a set of pairs by hand, by name and by modifiers, and one of pairs by name."""
    for number, name in enumerate(("a_low", "b_low", "c_low")):
        low = zoo.plane(name)
        low.location.x = 3.0 * number
        for loop in low.data.uv_layers[0].uv:
            loop.vector = (0.05 + 0.2 * loop.vector[0] + 0.3 * number, loop.vector[1] * 0.2)
    for name, x in (("sculpt", 0.0), ("bolt", 0.0), ("b_high", 3.0)):
        zoo.plane(name, slope=0.2 + 0.1 * x).location.x = x
    bpy.data.objects["c_low"].modifiers.new("Rounded", "SUBSURF")
    a, b = bpy.data.objects["a_low"], bpy.data.objects["b_low"]
    a.imprint.put([bpy.data.objects["sculpt"], bpy.data.objects["bolt"]])
    b.imprint_distance = 0.5
    use(size=32, method="CAST", storage="FILE", output="//maps/{low}_normal.png", samples="1", maps={"POSITION"})
    one = bpy.context.scene.imprint_sets.add()
    one.name = "Prop, “first”"
    for low in (a, b, bpy.data.objects["c_low"]):
        one.parts.add().object = low
    bpy.context.scene.imprint.bakes = "SETS"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "prop.blend"))
    return bpy.context.scene.imprint_sets[0]


def files(folder):
    """The texels of all maps in a folder, which are removed."""
    found = {}
    for path in sorted(folder.glob("**/*.png")):
        image = bpy.data.images.load(str(path))
        found[path.name] = maps.pixels(image)
        bpy.data.images.remove(image)
        path.unlink()
    return found


def bake(tmp_path):
    for image in [image for image in bpy.data.images if image.size[0]]:
        bpy.data.images.remove(image)
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    return files(tmp_path / "maps")


def there_and_back(path, *materials):
    """Write the sets, and take them into an empty list."""
    assert bpy.ops.imprint.sets_to_job_file(filepath=str(path)) == {"FINISHED"}
    bpy.context.scene.imprint_sets.clear()
    for obj in bpy.data.objects:  # in an empty file, too
        obj.property_unset("imprint")
        obj.property_unset("imprint_distance")
    for material in materials:
        material.imprint_size = "0"
    assert bpy.ops.imprint.sets_from_job_file(filepath=str(path)) == {"FINISHED"}


@pytest.mark.parametrize("textures", ["PART", "MATERIAL", "ONE"])
@pytest.mark.parametrize("ending", ["toml", "json"])
@pytest.mark.parametrize("engine", ["", "Unreal Engine"])
def test_the_same_sets_and_maps(props, tmp_path, textures, ending, engine):
    props.textures = textures
    material = bpy.data.materials.new("Old “Wood”.001")
    material.imprint_size = "256"
    for part in props.parts:
        part.object.data.materials.append(material)
    if engine:
        props.own.engine = engine
    before, settings, jobs = bake(tmp_path), props.settings, sets.resolve(bpy.context, props).jobs
    there_and_back(tmp_path / "jobs" / f"all.{ending}", material)
    one = sets.active(bpy.context)
    assert (one.name, one.textures) == ("Prop, “first”", textures)
    assert [(job.low, job.highs, job.distance) for job in sets.resolve(bpy.context, one).jobs] == [
        (job.low, job.highs, job.distance) for job in jobs
    ]
    assert one.settings.sampling == settings.sampling
    after = bake(tmp_path)
    assert after.keys() == before.keys()
    for name, texels in before.items():
        np.testing.assert_array_equal(after[name], texels, err_msg=name)


def test_a_shell_understands_what_is_written(props, tmp_path):
    for ending in ("toml", "json"):
        path = tmp_path / f"all.{ending}"
        assert bpy.ops.imprint.sets_to_job_file(filepath=str(path)) == {"FINISHED"}
        (options,) = job_file.read(str(path))
        assert options.name == "Prop, “first”"
        assert options.low == ["a_low", "b_low", "c_low"]
        assert options.output == str(tmp_path / "maps" / "{low}_normal.png")
    assert tomllib.loads((tmp_path / "all.toml").read_text("utf-8")) == json.loads(
        (tmp_path / "all.json").read_text("utf-8")
    )


@pytest.mark.parametrize("textures", ["PART", "MATERIAL", "ONE"])
@pytest.mark.parametrize("engine", ["", "Unreal Engine"])
def test_a_shell_writes_the_files_of_the_window(props, tmp_path, textures, engine):
    props.textures = textures
    if engine:
        props.own.engine = engine
    materials = [bpy.data.materials.new(name) for name in ("Wood", "Steel")]
    for number, part in enumerate(props.parts):
        part.object.data.materials.append(materials[number == 1])
    bpy.ops.wm.save_mainfile()
    assert bpy.ops.imprint.sets_to_job_file(filepath=str(tmp_path / "all.toml")) == {"FINISHED"}
    before = bake(tmp_path)
    assert command.run(["--jobs", str(tmp_path / "all.toml"), "--quiet"]) == 0
    after = files(tmp_path / "maps")
    assert after.keys() == before.keys()
    for name, texels in before.items():
        np.testing.assert_array_equal(after[name], texels, err_msg=name)


@pytest.mark.parametrize("ending", ["toml", "json"])
def test_names_with_any_character(props, tmp_path, ending):
    name = "tab\t quote\" back\\slash \x7f ünï 'a' \U0001f9f1"
    props.name = name
    there_and_back(tmp_path / f"all.{ending}")
    assert sets.active(bpy.context).name == props.name == name


def test_a_part_onto_itself_stays_one(props, tmp_path):
    """Although a name, or its pair, would give it high objects."""
    for name in ("a_low", "b_low"):
        low = bpy.data.objects[name]
        object_pairs.remember_objects(low, [low], None, props.settings.flat(), {})
    low.imprint_is_baked, low.imprint_size = False, "512"
    cage = zoo.plane("c_hull")
    c = bpy.data.objects["c_low"]
    object_pairs.remember_objects(c, [bpy.data.objects["bolt"]], cage, props.settings.flat(), {})
    there_and_back(tmp_path / "all.toml")
    made = sets.resolve(bpy.context, sets.active(bpy.context))
    assert [(job.highs, job.cage, job.size) for job in made.jobs] == [
        ([bpy.data.objects["a_low"]], None, 0),
        ([low], None, 512),
        ([bpy.data.objects["bolt"]], cage, 0),
    ]
    assert made.off == {low.session_uid}
    bpy.data.objects["a_low"].imprint.put([bpy.data.objects["sculpt"]])
    bpy.data.objects["a_low"].imprint.is_own = False
    assert bpy.ops.imprint.sets_from_job_file(filepath=str(tmp_path / "all.toml")) == {"FINISHED"}
    assert sets.resolve(bpy.context, sets.active(bpy.context)).jobs[0].highs == [bpy.data.objects["a_low"]]


def test_paths_start_at_the_job_file(props, tmp_path):
    assert bpy.ops.imprint.sets_to_job_file(filepath=str(tmp_path / "jobs" / "all.toml")) == {"FINISHED"}
    (table,) = job_files.read(tmp_path / "jobs" / "all.toml")
    assert (table["file"], table["output"]) == (["../prop.blend"], "../maps/{low}_normal.png")


@pytest.mark.parametrize("scene_has", ["", "//scene.glb"])
@pytest.mark.parametrize("export", ["", "//meshes/{low}.glb"])
def test_the_mesh_file_of_a_set_stays(props, tmp_path, scene_has, export):
    props.own.export = export
    bpy.context.scene.imprint.export = scene_has
    path = tmp_path / "jobs" / "all.toml"
    there_and_back(path)
    assert sets.active(bpy.context).own.whole.export == export
    (table,) = job_files.read(path)
    assert table.get("export", "") == export.replace("//", "../")


def test_a_set_that_stores_in_the_blend_gets_files(props, tmp_path):
    props.own.storage, props.own.depth = "PACK", "32"
    assert bpy.ops.imprint.sets_to_job_file(filepath=str(tmp_path / "all.toml")) == {"FINISHED"}
    (options,) = job_file.read(str(tmp_path / "all.toml"))
    assert options.output == str(tmp_path / "{low}_normal.exr")


def test_sets_that_are_off_stay_out(props, tmp_path):
    assert bpy.ops.imprint.set_duplicate() == {"FINISHED"}
    first, second = bpy.context.scene.imprint_sets
    second.is_on = False
    assert bpy.ops.imprint.sets_to_job_file(filepath=str(tmp_path / "all.toml")) == {"FINISHED"}
    assert [table["name"] for table in job_files.read(tmp_path / "all.toml")] == [first.name]


def test_by_hand_written_sets(props, tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(
        """
        [defaults]
        file = "prop.blend"
        size = "64x32"
        samples = 2

        [[bake]]
        low = "b_low"
        output = "b.<UDIM>.png"
        samples = 4
        targets = ["unreal"]

        [[bake]]
        name = "Hands"
        low = ["a_low"]
        high = ["bolt"]
        output = "a.exr"
        extrusion = 0.25
        max-distance = 1
        ignore_backfaces = true

        [[bake]]
        pairs = true
        output = "{name}.png"
        maps = ["ao", "base-color"]
        """
    )
    path.write_text(path.read_text().replace("ignore_backfaces", "facing_only"))
    bpy.context.scene.imprint_sets.clear()
    use(measure=False)
    assert bpy.ops.imprint.sets_from_job_file(filepath=str(path)) == {"FINISHED"}
    use(measure=True)  # what a job file says of a number is not the scene's to switch off
    by_name, hands, pairs = bpy.context.scene.imprint_sets
    assert (by_name.name, hands.name, pairs.source) == ("b", "Hands", "NAMES")
    assert [one.settings.sampling.size for one in (by_name, hands, pairs)] == [(64, 32)] * 3
    assert [high.name for high in sets.resolve(bpy.context, by_name).jobs[0].highs] == ["b_high"]
    assert object_pairs.of(bpy.data.objects["b_low"]) is None or not bpy.data.objects["b_low"].imprint.is_kept
    assert [high.name for high in sets.resolve(bpy.context, hands).jobs[0].highs] == ["bolt"]
    tracing = hands.settings.tracing
    assert (tracing.extrusion, tracing.max_distance, tracing.facing_only) == (0.25, 1.0, True)
    assert hands.settings.storing.output == "//a.exr"
    assert (by_name.settings.sampling.samples, hands.settings.sampling.samples) == (4, 2)
    assert (by_name.settings.sampling.udim, hands.settings.sampling.udim) == (True, False)
    assert by_name.settings.map.targets == ("unreal",)
    hands.back("measure")
    assert hands.settings.tracing.extrusion is None
    assert pairs.settings.map.maps == ("AO", "BASE_COLOR")
    assert hands.settings.map.maps == ()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("x", "is no job file"),
        (
            "[[bake]]\nlow = 'a_low'\nfile = 'other.blend'\noutput = 'a.png'",
            "of the file 'other.blend', which is not open",
        ),
        ("[[bake]]\nlow = 'a_low'\nscene = 'Other'\noutput = 'a.png'", "of the scene 'Other'"),
        ("[[bake]]\nlow = 'nobody'\noutput = 'a.png'", "no object called 'nobody'"),
        ("[[bake]]\nlow = 'a_low'\noutput = 'a.png'\nframes = '1-3'", "A set has no 'frames'"),
        ("[[bake]]\nlow = 'a_low'\noutput = 'a.png'\nsamples = 'many'", "'many'"),
        ("[[bake]]\nlow = 'a_low'\noutput = 'a.png'\nsize = 'big'", "'big' is not a size"),
        ("[[bake]]\noutput = 'a.png'", "names no low object"),
        ("[[bake]]\nlow = 'a_low'", "No file is set"),
        ("bake = 3", "is no job file"),
        ("[[bake]]\noutput = 'a.png'\npart = [{low = 'a_low', size = 300}]", "cannot have 300 texels"),
        (
            "[[bake]]\noutput = '{low}_{material}.png'\nlow = ['a_low', 'b_low']\ntexture-sets = true",
            "of each part and each material",
        ),
    ],
)
def test_wrong_job_files(props, tmp_path, text, sentence):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    before = len(bpy.context.scene.imprint_sets)
    assert sentence in refusal(bpy.ops.imprint.sets_from_job_file, filepath=str(path))
    assert len(bpy.context.scene.imprint_sets) == before


def test_a_wrong_set_leaves_the_others(props, tmp_path):
    path = tmp_path / "half.toml"
    path.write_text("[[bake]]\nlow = 'nobody'\noutput = 'a.png'\n[[bake]]\nlow = 'a_low'\noutput = 'a.png'\n")
    assert bpy.ops.imprint.sets_from_job_file(filepath=str(path)) == {"FINISHED"}
    assert [one.name for one in bpy.context.scene.imprint_sets] == ["Prop, “first”", "a"]


def test_an_unsaved_file_and_no_sets(tmp_path):
    path = str(tmp_path / "all.toml")
    assert refusal(bpy.ops.imprint.sets_to_job_file, filepath=path) == "The job file names the .blend: save it first."
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "empty.blend"))
    assert refusal(bpy.ops.imprint.sets_to_job_file, filepath=path).startswith("No set is on")
    select(zoo.plane("lonely"))


def test_the_menu_of_sets_has_both_ways():
    drawn = [name for name, _ in panel_layout.draw(panels=[sets_panel.IMPRINT_MT_sets]).given]
    assert {"imprint.sets_to_job_file", "imprint.sets_from_job_file"} <= {*drawn}
