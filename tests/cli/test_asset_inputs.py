# SPDX-License-Identifier: GPL-3.0-or-later
"""The command `asset`: how its files are shaded, and what it says of a low mesh that is there."""

import json
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from addon.cli import arguments, command, scene_jobs
from addon.cli.commands import WrongUsage
from addon.cli.scene_files import SceneLoader
from addon.core.asset_limits import HowMade, Wanted
from addon.core.settings import Settings
from addon.jobs import asset
from tests.support import quick_assets, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")
EXPORT = ["--size", "32", "--export", "out.glb"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with a file of a rock and its low mesh, and two files that do not say how they are shaded."""
    monkeypatch.chdir(tmp_path)
    quick_assets.quicken(monkeypatch)
    for name in ("first", "second"):
        zoo.ball(name, 4)
        bpy.ops.wm.ply_export(filepath=str(tmp_path / f"{name}.ply"))
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    zoo.ball("rock_low", 4)
    zoo.ball("rock_high", 8)
    zoo.ball("plain", 4)
    scenes.save(tmp_path / "rock.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return tmp_path


def opened(*words):
    """The job of an asset, what is said of it, and how its files are shaded."""
    _, options = arguments.read_asset([*words, *EXPORT], "imprint asset")
    loader = SceneLoader()
    (job,), notes = scene_jobs.opened(options, loader)
    return job, notes, loader.smooth([job], options.smooth_files, scene_jobs.made(options, [job]))


@pytest.mark.parametrize(
    ("more", "degrees"), [([], 40), (["--smooth-files", "60"], 60), (["--smooth-files", "0"], 0), (["--keep"], 0)]
)
def test_files_without_normals_are_smooth_as_in_a_bake(folder, more, degrees):
    job, _, smooth = opened("first.ply", *more)
    assert smooth == ({"first": degrees} if degrees else {})
    assert job.highs[0].data.polygons[0].use_smooth == bool(degrees)


def test_the_meshes_of_all_files_are_high_and_smooth(folder):
    job, _, smooth = opened("first.ply", "second.ply")
    assert sorted(high.name for high in job.highs) == ["first", "second"] == sorted(smooth)


def test_a_low_mesh_that_is_there_stays_flat(folder):
    _, _, smooth = opened("first.ply", "second.ply", "--low", "first")
    assert smooth == {"second": 40}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "is there already and has {}: it is baked"),
        (["--triangles", "30"], "is there already and has {}, not 30: it is baked as it is. Rename or remove it"),
        (
            ["--low", "rock_low", "--triangles", "30"],
            "is named as the low mesh and has {}, not 30: it is baked as it is. Re",
        ),
        (["--low", "plain", "--triangles", "30"], "not 30: it is baked as it is. Leave out --low to"),
        (["--low", "rock_low", "--triangles", "30", "--degrees", "9"], "not 30: it is baked as it is. Rename"),
        (["--low", "rock_low", "--triangles", "9999", "--degrees", "9"], ""),
        (["--low", "rock_low", "--quads"], "made. --quads changed nothing."),
        (["--low", "rock_low", "--crumbs", "3"], "made. --crumbs, --holes and --symmetry changed nothing."),
        (["--low", "rock_low"], ""),
    ],
)
def test_a_low_mesh_that_is_there_is_named(folder, words, said):
    job, notes, _ = opened("rock.blend", "--high", "rock_high", *words)
    count = f"{sum(len(face.vertices) - 2 for face in job.low.data.polygons)} triangles"
    assert job.low.name == (words[1] if "--low" in words else "rock_low")
    assert len(notes) == bool(said) and said.format(count) in "".join(notes)


@pytest.mark.parametrize("more", [["--triangles", "30"], ["--quads"], ["--symmetry", "x"], ["--holes", "5"]])
def test_a_mesh_that_is_kept_takes_no_options_of_making(more):
    with pytest.raises(WrongUsage, match=f"--keep keeps all triangles: leave out .*{more[0]}"):
        arguments.read_asset(["first.ply", "--keep", *more, *EXPORT], "imprint asset")


@pytest.mark.parametrize(
    ("unwrapped", "method"), [("new", "FLATTEN"), ("", "FLATTEN"), ("new", "CAST"), ("new", "AUTO")]
)
def test_a_method_that_new_uvs_cannot_have_is_named(unwrapped, method):
    low = asset.Low(SimpleNamespace(name="rock_low"), Wanted(), HowMade(is_made=True, unwrapped=unwrapped))
    said = asset._not_done(low, None, Settings(method=method))
    assert len(said) == (unwrapped == "new" and method == "FLATTEN") and all("rays were cast" in each for each in said)


@pytest.mark.parametrize("is_made", [True, False])
@pytest.mark.parametrize("limits", [{"degrees": 5.0}, {"distance": 0.01}])
def test_only_a_low_mesh_that_is_made_can_have_more_triangles(is_made, limits):
    report = SimpleNamespace(low="rock_low", appearance={"percentile_99": 9.0}, triangles={"low": 12})
    (sentence,) = asset._missed(report, asset.Low(None, Wanted(**limits), HowMade(is_made=is_made)), 0.1)
    assert (" or more triangles" in sentence) == is_made != ("give one with more triangles" in sentence)


def test_a_missed_limit_is_said_once(folder, capfd):
    words = ["asset", "rock.blend", "--low", "rock_low", "--distance", "0.0001%", *EXPORT, "--report", "r.json"]
    assert command.run(words) == 4
    (text,) = json.loads(Path("r.json").read_text())["bakes"][0]["gate"]
    assert capfd.readouterr().err.count(text) == 1
