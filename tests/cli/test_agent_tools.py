# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the tools of the Model Context Protocol server: their words, their folder, and sentences for nonsense."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import anyio
import pytest
from mcp.client import Client

from addon.cli import agent_tools, arguments, command, mcp_command
from addon.cli.agent_tools import TOOLS, Place
from addon.cli.commands import ASSET
from addon.core.declarations.all_settings import DECLARED
from addon.core.errors import UNWRAP_FIRST
from addon.output import atomic_file
from scripts.agent import tasks

MESHES = {"files": ["a.obj", "b.ply"]}


@pytest.fixture
def place(tmp_path):
    """A folder with a few files, and a link that leads out of it."""
    root = tmp_path / "root"
    root.mkdir()
    for name in ("a.obj", "b.ply", "c.txt", "r.json"):
        (root / name).write_text("")
    (root / "map.png").write_bytes(b"\x89PNG\r\n\x1a\n...")
    (tmp_path / "secret.obj").write_text("")
    (root / "link.obj").symlink_to(tmp_path / "secret.obj")
    (root / "away").symlink_to(tmp_path)
    return Place(str(root))


@pytest.fixture
def ran(monkeypatch):
    """The words of processes, which do nothing."""
    words = []

    def run(place, each):
        words.append(list(each))
        return 0, "{}", ""

    monkeypatch.setattr(agent_tools, "_run", run)
    return words


def test_a_bake_is_a_call_of_the_command_line(place, ran):
    given = {"low_file": "a.obj", "high_files": ["b.ply"], "output": "out/x.png", "maps": ["normal", "ao", "height"]}
    answer = agent_tools.call(
        place, "bake", given | {"size": "64", "options": {"samples": 4, "no-alpha": True, "udim": False}}
    )
    assert not answer.is_error
    (words,) = ran
    options = arguments.parse(words, "imprint")
    root = Path(place.root)
    assert [options.low_file, options.high_file] == [str(root / "a.obj"), [str(root / "b.ply")]]
    assert (options.output, options.size, options.samples) == (str(root / "out" / "x.png"), (64, 64), 4)
    assert options.normal and set(options.maps) == {"AO", "HEIGHT"} and not options.alpha and not options.udim
    assert options.report == str(root / "out" / "x.report.json") and not options.untrusted


def test_maps_without_a_normal_map(place, ran):
    agent_tools.call(place, "bake", {**MESHES, "output": "out/x.png", "maps": ["ao"]})
    assert "--no-normal" in ran[0] and "--maps=ao" in ran[0]


def test_an_asset_is_a_call_of_the_command_line(place, ran):
    agent_tools.call(
        place, "asset", {"files": ["b.ply"], "export": "out/x.glb", "triangles": 500, "options": {"levels": 2}}
    )
    (words,) = ran
    assert words[0] == ASSET.name
    _, options = arguments.read_asset(words[1:], "imprint")
    assert (options.asset.triangles, options.asset.levels, options.export) == (
        500,
        2,
        str(Path(place.root, "out", "x.glb")),
    )


def test_untrusted_files_are_baked_in_the_sandbox(place, ran):
    place = Place(place.root, untrusted=True)
    assert agent_tools.call(place, "bake", {**MESHES, "output": "x.png"}).is_error
    assert ran == []
    agent_tools.call(place, "bake", {**MESHES, "output": "out/x.png"})
    agent_tools.call(place, "check", {**MESHES, "low": "a"})
    _, checked = arguments.read_check(ran[1][1:], "imprint check")
    for options in (arguments.parse(ran[0], "imprint"), checked):
        assert options.untrusted
        assert (options.input_folder, options.output_folder) == (place.root, os.path.join(place.root, "out"))


@pytest.mark.parametrize(
    ("link", "output"),
    [
        ("out/x_ao.png", "out/x.png"),
        ("out/x.report.json.lines", "out/x.png"),
        ("out/x.pictures/1.png", "out/x.png"),
        ("out/textures/x_map.png", "out/x.png"),
        ("out/box/x.png", "out/{low}/x.png"),
        ("out/box", "out/{low}/x.png"),
    ],
)
def test_links_beside_an_output_lead_nowhere_else(place, ran, link, output):
    path = Path(place.root, link)
    path.parent.mkdir(parents=True)
    path.symlink_to(Path(place.root, "map.png"))
    assert not agent_tools.call(place, "bake", {**MESHES, "output": output}).is_error
    path.unlink()
    path.symlink_to(Path(place.root).parent / "new")
    ran.clear()
    for tool, given in (
        ("bake", {**MESHES, "output": output}),
        ("asset", {"files": ["b.ply"], "export": output.replace("png", "usdc")}),
    ):
        answer = agent_tools.call(place, tool, given)
        assert ran == [] and answer.is_error and "leads out of" in answer.text
    assert not agent_tools.call(place, "bake", {**MESHES, "output": "else/x.png"}).is_error


def test_the_report_of_an_earlier_bake_is_not_this_ones(place, monkeypatch):
    report, written = Path(place.root, "out", "x.report.json"), []

    def run(*_):
        for state in written:
            with atomic_file.replacing(report) as partial:
                partial.write_text(json.dumps({"bakes": [{"state": state}]}))
        return 2, "", "Nothing was baked."

    monkeypatch.setattr(agent_tools, "_run", run)
    states = []
    for written[:] in (["done"], [], ["failed"]):
        answer = agent_tools.call(place, "bake", {**MESHES, "output": "out/x.png"})
        states.append(json.loads(answer.text).get("state"))
    assert states == ["done", None, "failed"]


def test_a_look_needs_no_low_mesh(place, ran):
    agent_tools.call(place, "check", {"high_files": ["b.ply"]})
    _, options = arguments.read_check(ran[0][1:], "imprint check")
    assert (options.file, options.high_file, options.asset is None) == ([str(Path(place.root, "b.ply"))], [], False)


def test_a_missing_low_mesh_is_answered_with_the_names(place, monkeypatch):
    Path(place.root, "a.blend").write_text("")
    monkeypatch.setattr(agent_tools, "_run", lambda *_: (1, "", "imprint check: Meshes of the file: 'x'."))
    answer = agent_tools.call(place, "bake", {"files": ["a.blend"], "output": "out/x.png"})
    assert answer.is_error and answer.text == "low is missing in 'a.blend'. Meshes of the file: 'x'."


def test_a_cure_is_a_tool(place, monkeypatch):
    said = f"imprint check: {UNWRAP_FIRST}."
    monkeypatch.setattr(agent_tools, "_run", lambda *_: (1, "", said))
    for tool, more in (("check", {}), ("bake", {"output": "out/x.png"})):
        text = agent_tools.call(place, tool, {"low_file": "a.obj", **more}).text
        assert "call asset with files, low and high" in text and UNWRAP_FIRST not in text


def test_what_is_said_elsewhere_is_no_message(place, monkeypatch):
    bake = {"state": "gate", "gate": ["Over."], "reports": [{"warnings": ["Look."], "notes": ["Green."], "tiles": [1]}]}

    def run(*_):
        Path(place.root, "out").mkdir()
        Path(place.root, "out", "x.report.json").write_text(json.dumps({"bakes": [bake]}))
        return 4, "", "imprint: warning: Look.\nimprint: Over.\nimprint: Else."

    monkeypatch.setattr(agent_tools, "_run", run)
    answer = agent_tools.call(place, "bake", {**MESHES, "output": "out/x.png"})
    result = json.loads(answer.text)
    assert result["messages"] == ["imprint: Else."] and result["gate"] == ["Over."] and not answer.is_error
    assert result["measured"] == [{"warnings": ["Look."], "notes": ["Green."]}]


def test_settings_that_are_wrong_are_answered_with_what_there_is(place, ran):
    def said(**options):
        return agent_tools.call(place, "bake", BAKE | {"options": options}).text

    assert said(pack=True).startswith("options: pack needs a value, none|gltf|unreal")
    assert said(sample=4) == "options: there is no setting 'sample' here, did you mean 'samples'?"
    assert re.search(r"Nearest are [\w-]+(, [\w-]+){4}\.$", said(triangulate=True))
    assert not ran


def test_a_place_for_what_is_written_is_named(place):
    place = Place(place.root, untrusted=True)
    assert "'x.png' is not in" in (text := agent_tools.call(place, "bake", {**MESHES, "output": "x.png"}).text)
    assert text.endswith("out', the folder that this server writes into.")


def test_harmless_lines_are_left_out(place, monkeypatch):
    done = subprocess.CompletedProcess([], 0, b"EGL Error (1): bad\nkept\n", b"EGL Error (1): bad\n")
    monkeypatch.setattr(agent_tools.subprocess, "run", lambda *_, **__: done)
    assert agent_tools.call(place, "check", {**MESHES}).text == "kept"


BAKE = {**MESHES, "output": "out/x.png"}
HUGE = 10**5000
NONSENSE = [
    *((name, arguments) for name in TOOLS for arguments in (None, [], 3, "x", {"nonsense": 1}, {3: 4})),
    *((name, {}) for name in (None, 3, "", "rm", ["bake"], {}, "__class__")),
    *(
        ("bake", BAKE | {"output": each})
        for each in ("", 3, None, "../x.png", "/x.png", "a\0b", "away/x.png", ".", "\ud800")
    ),
    *(("bake", BAKE | {"files": each}) for each in ([], "a.obj", [3], ["no.obj"], ["link.obj"], ["../secret.obj"])),
    *(("bake", BAKE | {"files": each}) for each in (["c.txt"], [["a.obj"]], ["x" * 9999], [{}], ["away/secret.obj"])),
    *(
        ("bake", BAKE | {"options": {each: "x"}})
        for each in ("save-blend", "report", "jobs", "log", "convert", "output", "")
    ),
    *(
        ("bake", BAKE | {"options": {each: "x"}})
        for each in ("untrusted", "records", "high-file", "export", "part", "file")
    ),
    *(("bake", BAKE | {"options": {"samples": each}}) for each in ({}, [[]], [], [{}], "a\0b", "\ud800")),
    *(("bake", BAKE | {"options": each}) for each in ([], "samples=4", 3, True)),
    *(
        ("asset", {"files": ["b.ply"], "export": "out/x.glb", "triangles": each})
        for each in ("5", True, None, [5], 1.5)
    ),
    *(("asset", {"files": ["b.ply"], "export": "out/x.glb", each: -HUGE}) for each in ("triangles", "degrees", "size")),
    *(("bake", BAKE | {"options": {"samples": each}}) for each in (HUGE, [1, HUGE], [[HUGE]])),
    ("bake", {"output": HUGE}),
    ("bake", [HUGE]),
    (HUGE, {}),
    *(("report", {"reports": each}) for each in (["no.json"], "r.json", [None], ["away/secret.obj"])),
    *(("report", {"reports": ["r.json"], "key": each}) for each in ("a", "0", "....x", 3)),
    *(("picture", {"path": each}) for each in ("c.txt", "no.png", "../secret.obj", "link.obj", ".", 3, "a\0")),
]


@pytest.mark.parametrize(("name", "given"), NONSENSE, ids=range(len(NONSENSE)))
def test_nonsense_gets_a_sentence_and_starts_nothing(place, ran, name, given):
    before = sorted(Path(place.root).rglob("*"))
    answer = agent_tools.call(place, name, given)
    assert answer.is_error and not answer.png
    assert len(answer.text) < 2000 and answer.text.count("\n") == 0 and answer.text.rstrip("?.") != answer.text
    assert all(words[0] == "report" for words in ran)
    assert sorted(Path(place.root).rglob("*")) == before


def test_a_picture_is_the_file(place):
    answer = agent_tools.call(place, "picture", {"path": "map.png"})
    assert not answer.is_error and answer.png == Path(place.root, "map.png").read_bytes()


def test_a_part_of_a_report(place, monkeypatch):
    value = {"bakes": [{"state": "done", "reports": ["x" * 30_000]}]}
    monkeypatch.setattr(agent_tools, "_run", lambda *_: (0, json.dumps(value), ""))
    assert json.loads(agent_tools.call(place, "report", {"reports": ["r.json"], "key": "bakes.0.state"}).text) == "done"
    whole = agent_tools.call(place, "report", {"reports": ["r.json"]})
    assert whole.is_error and "bakes" in whole.text and len(whole.text) < 200
    missing = agent_tools.call(place, "report", {"reports": ["r.json"], "key": "bakes.1"})
    assert missing.is_error and "'1'" in missing.text


def test_the_call_of_a_report_is_that_of_the_bake(place, monkeypatch):
    Path(place.root, "r.json").write_text(json.dumps({"call": ["bake"], "started": "then", "host": "there"}))
    monkeypatch.setattr(agent_tools, "_run", lambda *_: (0, json.dumps({"call": ["report"], "bakes": []}), ""))
    value = json.loads(agent_tools.call(place, "report", {"reports": ["r.json"]}).text)
    assert value == {"call": ["bake"], "started": "then", "host": "there", "bakes": []}


def test_settings_name_no_file():
    assert {"samples", "targets", "max-distance", "strict", "levels"} <= {*agent_tools.OF_ASSETS}
    assert not {"output", "export", "report", "save-blend", "jobs", "file", "low-file", "convert"} & {
        *agent_tools.OF_ASSETS
    }


def test_a_missing_kit_is_a_sentence_with_its_cure(tmp_path, monkeypatch, capsys):
    for name in ("anyio", "mcp", "mcp.server", "mcp_types"):
        monkeypatch.setitem(sys.modules, name, None)
    assert command.run(["mcp", "--root", str(tmp_path)]) == 1
    assert "-m pip install 'mcp>=2,<3'" in capsys.readouterr().err
    assert command.run(["mcp", "--root", str(tmp_path / "no")]) == 2
    assert "There is no folder" in capsys.readouterr().err
    assert command.run(["mcp"]) == 2


AGENT = Path(mcp_command.__file__).parents[2] / "scripts" / "agent"


def test_the_skill_names_tools_and_settings_that_are_there():
    text = (AGENT / "SKILL.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(\w[\w-]*)`", text))
    assert {*TOOLS} <= named
    arguments = {name for tool in TOOLS.values() for name in tool.properties}
    measured = {"warnings", "missed", "overlap", "targets", "messages", "deviation", "notes", "appearance", "checks"}
    measured |= {"wrong", "backs", "distance", "worst_view", "percentile_99"}
    values, packs = {"unreal", "unity", "godot", "three"}, {item.value.lower() for item in DECLARED["pack"].items}
    assert named - {*TOOLS} - arguments - {*agent_tools.OF_ASSETS} - measured - values - packs == set()
    assert values <= {item.value.lower() for item in DECLARED["targets"].items}
    for task in tasks.TASKS:
        assert task["task"].endswith((".", "?")) and {name for name, _ in task["calls"]} <= {*TOOLS}


@pytest.mark.parametrize("words", [["--help"], ["folder", "--paly"], []])
def test_wrong_arguments_of_the_tasks_make_no_folder(tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["tasks.py", *words])
    with pytest.raises(SystemExit):
        tasks.main()
    assert not [*tmp_path.iterdir()] and "usage:" in "".join(capsys.readouterr())


@pytest.mark.slow
def test_a_client_of_the_kit_does_the_tasks(tmp_path):
    """Over the standard streams of a process. Assets take long: `scripts/agent/tasks.py FOLDER --play` does all ten."""
    tasks.make_files(tmp_path)
    chosen = [task for task in tasks.TASKS if "asset" not in {name for name, _ in task["calls"]}]

    async def talk():
        return [(task["task"], left) async for task, left in tasks.played(tmp_path, chosen)]

    assert anyio.run(talk) == [(task["task"], []) for task in chosen]


def test_the_server_names_the_tools():
    async def talk():
        async with Client(mcp_command.server(Place("/"))) as client:
            listed = await client.list_tools()
            refused = await client.call_tool("bake", {"output": 3})
            return listed.tools, refused

    listed, refused = anyio.run(talk)
    assert [(tool.name, tool.input_schema) for tool in listed] == [(name, each.schema) for name, each in TOOLS.items()]
    assert refused.is_error and refused.content[0].text == "output: 3 is no string."
