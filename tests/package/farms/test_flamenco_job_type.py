# SPDX-License-Identifier: GPL-3.0-or-later
"""The job type of Flamenco, compiled by Node.js: its tasks call the command line as it is."""

import json
import shutil
import subprocess

import pytest

from addon import flamenco
from addon.cli import arguments, farm_command
from tests.package.farms.farm_words import FARM, JOBS, check_first, check_merge, check_shard

RUN_JOB_TYPE = """
const nodePath = require("path").posix;
const path = {...nodePath, stem: name => nodePath.parse(name).name};
const author = {
    Task: (name, type) => ({name, type, commands: [], needs: [],
        addCommand(command) { this.commands.push(command); }, addDependency(task) { this.needs.push(task.name); }}),
    Command: (name, parameters) => ({name, ...parameters}),
};
const print = () => {};
const tasks = [];
SCRIPT
const unknown = Object.keys(SETTINGS).filter(key => !JOB_TYPE.settings.some(each => each.key === key));
if (unknown.length) throw new Error(`no settings: ${unknown}`);
const usual = Object.fromEntries(JOB_TYPE.settings.filter(each => "default" in each).map(each => [each.key, each.default]));
compileJob({settings: {...usual, ...SETTINGS}, addTask: task => tasks.push(task)});
console.log(JSON.stringify(tasks));
"""


def compiled(**settings):
    """The tasks of the job type, as Flamenco Manager would make them."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("Node.js is not installed")
    script = (FARM / "flamenco" / "imprint_bake.js").read_text(encoding="utf-8")
    program = RUN_JOB_TYPE.replace("SETTINGS", json.dumps(settings)).replace("SCRIPT", script)
    done = subprocess.run([node, "-"], input=program, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def words_of(task):
    """The command of a task, as a worker starts it."""
    (given,) = task["commands"]
    assert (task["type"], given["name"]) == ("blender", "blender-render")
    assert given["exe"] and given["blendfile"], "a worker refuses a task without"
    return [given["exe"], *given["argsBefore"], given["blendfile"], *given["args"]]


def test_flamenco_checks_then_bakes_then_merges():
    check, *bakes, merge = compiled(jobs=JOBS, shards=3)
    blender = ["{blender}", "--background", "--command", "imprint"]
    assert words_of(check)[:4] == blender
    check_first(words_of(check)[4:])
    for number, task in enumerate(bakes, 1):
        assert task["needs"] == ["check"]
        assert words_of(task)[:4] == blender
        check_shard(words_of(task)[4:], number, 3)
    assert merge["needs"] == [task["name"] for task in bakes]
    check_merge(words_of(merge)[4:], 3)


def test_flamenco_compiles_what_farm_sends(tmp_path, monkeypatch):
    jobs = tmp_path / "a job.toml"
    jobs.write_text('[[bake]]\nlow-file = "low.obj"\nhigh-file = "high.obj"\noutput = "out/map.png"\n')
    sent = []
    monkeypatch.setattr(flamenco, "submit", lambda _url, job: sent.append(job.settings))
    checkout, options = '"/a b/python" "/c d/imprint.py" bake', '--size 64 --output-folder "/a b" --records /records'
    words = [
        "--flamenco",
        "farm",
        "--shards",
        "1",
        "--force",
        "--reports",
        "/out",
        "--untrusted",
        "--command",
        checkout,
    ]
    assert farm_command.run([str(jobs), *words, "--options", options], "imprint") == 0
    check, bake, merge = map(words_of, compiled(**sent[0]))
    for task in (check, bake):
        assert task[:3] == ["/a b/python", "/c d/imprint.py", "bake"]
        run, rest = arguments.split_jobs(task[3:])
        assert (run.untrusted, run.output_folder, run.records) == (True, "/a b", "/records")
        assert (run.check, run.force, arguments.parse(rest).size) == (task is check, True, (64, 64))
    check_shard(bake[3:], 1, 1, jobs=str(jobs), reports="/out", is_forced=True, size=(64, 64))
    check_merge(merge[3:], 1, "/out")
