# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests --untrusted against job files, folders and mesh files that name other files: each is refused in one sentence before
Blender starts, and nothing changes."""

import gzip
import json
import os
import random
import struct
from pathlib import Path

import pytest

from addon.cli import command, run_report, untrusted
from addon.cli.job_file import KEYS
from addon.core.file_structure import blend_files
from tests.support import random_cases, trees

pytestmark = pytest.mark.skipif(os.name == "nt", reason="links and pipes of POSIX")

MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
WRITES = {"output": ".png", "export": ".glb", "save-blend": ".blend", "report": ".json"}
READS = {"file": ".obj", "low-file": ".obj", "high-file": ".obj", "cage-file": ".obj", "convert": ".png"}
PLACES_TO_WRITE = [
    "../map",
    "map",
    "{root}/outside/map",
    "out/../map",
    "out/../../outside/map",
    "out/link/map",
    "out/deep/../../../outside/map",
    "out/link/../map",
    "link/map",
    "out/victim",
    "~/map",
    "//host/share/map",
    "\\\\host\\share\\map",
    "C:\\map",
    "C:/map",
    "/dev/shm/map",
    "/proc/self/map",
    "/map",
    "out/%2e%2e/../../map",
    "%2e%2e/map",
    "out/{low}/../../map",
    "out/../{low}",
    "out/\x1b[31m/../../map",
    "out/a\nb/../../map",
    "out /map",
    "out./map",
    "Out/map",
    "ｏｕｔ/map",
    "out\u202e/map",
    "outside/map",
    "out-of/map",
]
PLACES_TO_READ = [
    "../outside/secret",
    "{root}/outside/secret",
    "link/secret",
    "secret",
    "pipe",
    "folder",
    "out/link/secret",
    "out/../../outside/secret",
    "//{root}/outside/secret",
    "./././../outside/secret",
    "link/../outside/secret",
    "chain",
]


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A folder with job/, in which the files of others are, and outside/. job/out is the output folder."""
    for name in ("outside", "job/out/deep", "job/folder.obj", "job/folder.png"):
        (tmp_path / name).mkdir(parents=True)
    for ending in (".obj", ".png"):
        (tmp_path / f"outside/secret{ending}").write_text(MESH)
        (tmp_path / f"job/secret{ending}").symlink_to(f"../outside/secret{ending}")
        (tmp_path / f"job/chain{ending}").symlink_to(f"secret{ending}")
        os.mkfifo(tmp_path / f"job/pipe{ending}")
    for ending in WRITES.values():
        (tmp_path / f"outside/victim{ending}").write_text("precious")
        (tmp_path / f"job/out/victim{ending}").symlink_to(f"../../outside/victim{ending}")
    for name in ("low", "high"):
        (tmp_path / f"job/{name}.obj").write_text(MESH)
    (tmp_path / "job/link").symlink_to("../outside")
    (tmp_path / "job/out/link").symlink_to("../../outside")
    monkeypatch.chdir(tmp_path / "outside")
    return tmp_path


MESHES = {"low-file": "low.obj", "high-file": "high.obj"}
OTHERS = {"file": {"low": "a"}, "convert": {"low-file": "low.obj"}}
"""The other keys of a set with a key; MESHES if it is not here."""


def outside_of(root):
    return trees.snapshot(root, root / "job/out")


def attack(root, key, value, *words, capfd):
    """Bake a set with a key. Returns the exit code and what was said, after comparing all that is on the disk."""
    values = {"output": "out/map.png", **OTHERS.get(key, MESHES), key: value}
    (root / "job/j.json").write_text(json.dumps({"bake": [values]}))
    before = outside_of(root)
    code = command.run(["--jobs", str(root / "job/j.json"), "--untrusted", *words], may_start_processes=True)
    assert outside_of(root) == before
    return code, capfd.readouterr().err.splitlines()


def is_of_other_systems(line):
    return "is a path of Windows" in line or "has ~ or a variable" in line


@pytest.mark.parametrize(
    ("key", "place"),
    [
        *(("output", place) for place in PLACES_TO_WRITE),
        *((key, place) for key in WRITES for place in PLACES_TO_WRITE[:5]),
    ],
)
def test_no_file_is_written_elsewhere(root, key, place, capfd):
    path = place.replace("{root}", str(root)) + WRITES[key]
    code, said = attack(root, key, path, capfd=capfd)
    assert code == run_report.WRONG_USAGE
    (line,) = said
    assert "the only folder that --untrusted writes to" in line or is_of_other_systems(line)


def test_no_link_of_the_output_folder_is_written_to(root, capfd):
    """Its process could lead it to the map of another bake."""
    (root / "job/out/other.png").write_text("precious")
    (root / "job/out/map.png").symlink_to("other.png")
    code, (line,) = attack(root, "output", "out/map.png", capfd=capfd)
    assert code == run_report.WRONG_USAGE
    assert "is a link, which --untrusted does not follow" in line
    assert (root / "job/out/other.png").read_text() == "precious"


@pytest.mark.parametrize(
    ("key", "place"),
    [
        *(("low-file", place) for place in PLACES_TO_READ),
        *((key, place) for key in READS for place in PLACES_TO_READ[:4]),
    ],
)
def test_no_file_is_read_elsewhere(root, key, place, capfd):
    path = place.replace("{root}", str(root)) + READS[key]
    code, said = attack(root, key, path, capfd=capfd)
    assert code == run_report.WRONG_USAGE
    (line,) = said
    assert "the only folder that --untrusted reads" in line or "is not a file." in line


def test_each_key_with_a_path_is_tried():
    assert {key for key, option in KEYS.items() if option.is_path} == {*WRITES, *READS, "pairs"}


@pytest.mark.parametrize("place", ["../outside", "{root}/outside", "link", "/etc", "/", "..", "~/x", "/proc/self/fd"])
def test_no_folder_is_read_elsewhere(root, place, capfd):
    (root / "job/j.json").write_text(
        json.dumps({"bake": [{"pairs": place.replace("{root}", str(root)), "output": "out/{low}.png"}]})
    )
    before = outside_of(root)
    code = command.run(["--jobs", str(root / "job/j.json"), "--untrusted"], may_start_processes=True)
    (line,) = capfd.readouterr().err.splitlines()
    assert outside_of(root) == before
    assert code == run_report.WRONG_USAGE
    assert "the only folder that --untrusted reads" in line or is_of_other_systems(line)


LIBRARIES = {
    "outside": "../outside/evil.mtl",
    "absolute": "/etc/passwd",
    "link": "link/evil.mtl",
    "device": "/dev/zero",
    "pipe": "pipe.obj",
    "own memory": "/proc/self/mem",
}


@pytest.mark.parametrize("library", LIBRARIES.values(), ids=LIBRARIES)
def test_no_library_of_materials_is_read_elsewhere(root, library, capfd):
    (root / "job/high.obj").write_text(f"mtllib {library}\n{MESH}")
    code, (line,) = attack(root, "size", 16, capfd=capfd)
    assert code == run_report.WRONG_USAGE
    assert "what 'high.obj' refers to" in line.lower()


@pytest.mark.parametrize(
    "line",
    [
        *(
            f"{word} ../outside/secret.png"
            for word in ("map_Bump -bm 2", "bump", "disp", "decal", "refl", "norm", "map_Ke")
        ),
        *("map_Kd /etc/secret.png", "map_Kd -s 1 1 1 link/secret.png", "map_Kd pipe.png", "map_Kd /dev/zero"),
    ],
)
def test_no_texture_is_read_elsewhere(root, line, capfd):
    (root / "job/high.obj").write_text(f"mtllib own.mtl\n{MESH}")
    (root / "job/own.mtl").write_text(f"newmtl a\n{line}\n")
    code, (line,) = attack(root, "size", 16, capfd=capfd)
    assert code == run_report.WRONG_USAGE
    assert "what 'high.obj' refers to" in line.lower()


@pytest.mark.parametrize(
    "uri",
    [
        "../outside/secret.png",
        "/etc/passwd",
        "%2e%2e/outside/secret.png",
        "link/secret.png",
        "/%65tc/passwd",
        "pipe.png",
    ],
)
@pytest.mark.parametrize(("ending", "key"), [(".gltf", "buffers"), (".glb", "images")])
def test_no_part_of_a_gltf_is_read_elsewhere(root, ending, key, uri, capfd):
    content = json.dumps({"asset": {"version": "2.0"}, key: [{"uri": uri, "byteLength": 4}]}).encode()
    if ending == ".glb":
        content = struct.pack("<4sIIII", b"glTF", 2, 20 + len(content), len(content), 0x4E4F534A) + content
    (root / f"job/high{ending}").write_bytes(content)
    code, (line,) = attack(root, "high-file", f"high{ending}", capfd=capfd)
    assert code == run_report.WRONG_USAGE
    assert f"what 'high{ending}' refers to" in line.lower()


def blend(*blocks, size=None):
    """A .blend of Blender 4 with blocks of a code and a content. size: what each says of its size."""
    parts = [struct.pack("<4siQii", code, len(data) if size is None else size, 0, 0, 1) + data for code, data in blocks]
    return b"BLENDER-v405" + b"".join(parts) + struct.pack("<4siQii", b"ENDB", 0, 0, 0, 0)


@pytest.mark.parametrize("library", ["//../outside/lib.blend", "/etc/lib.blend", "//link/lib.blend"])
@pytest.mark.parametrize("pack", [bytes, gzip.compress], ids=["plain", "compressed"])
def test_no_library_of_a_blend_is_read_elsewhere(root, pack, library, capfd):
    (root / "job/s.blend").write_bytes(pack(blend((b"LI", library.encode() + b"\0"))))
    code, (line,) = attack(root, "file", "s.blend", capfd=capfd)
    assert code == run_report.WRONG_USAGE
    assert "A linked library of" in line


@pytest.mark.parametrize("size", [-1, -24, -(2**31), 2**31 - 1])
def test_a_wrong_size_in_a_blend_stops_nothing(root, size, capfd):
    (root / "job/s.blend").write_bytes(blend((b"LI", b"x"), (b"OB", b"y"), size=size))
    code, said = attack(root, "file", "s.blend", "--check", capfd=capfd)
    assert code == run_report.FAILED
    assert said == [f"imprint: a: {str(root / 'job/s.blend')!r} is not a complete .blend file."]


def test_a_blend_that_unpacks_to_very_much_is_not_unpacked(root, monkeypatch, capfd):
    monkeypatch.setattr(blend_files, "MOST_COMPRESSED", 4)
    (root / "job/s.blend").write_bytes(gzip.compress(blend((b"DATA", bytes(1 << 23)))))
    code, said = attack(root, "file", "s.blend", "--check", capfd=capfd)
    assert code == run_report.FAILED and len(said) == 1


def test_a_file_that_would_be_read_for_days_is_refused(root, capfd):
    """It takes no place on the disk."""
    with (root / "job/holes.obj").open("wb") as file:
        file.truncate(1 << 43)
    (root / "job/j.json").write_text(
        json.dumps({"bake": [{**MESHES, "high-file": "holes.obj", "output": "out/m.png"}]})
    )
    words = ["--jobs", str(root / "job/j.json"), "--untrusted", "--resume", "--records", str(root / "records")]
    assert command.run(words, may_start_processes=True) == run_report.WRONG_USAGE
    (line,) = capfd.readouterr().err.splitlines()
    assert "has more than 32 GiB, the most that --untrusted reads" in line


def test_the_job_file_must_be_a_file_of_usual_size(root, capfd):
    with (root / "job/large.json").open("wb") as file:
        file.truncate(untrusted.LARGEST_JOB_FILE + 1)
    for name, words in (
        ("large.json", "has more than 64 MiB"),
        ("pipe.json", "is not a file"),
        ("folder.obj", "is not a file"),
    ):
        if name.startswith("pipe"):
            os.mkfifo(root / "job" / name)
        assert command.run(["--jobs", str(root / "job" / name), "--untrusted"]) == run_report.WRONG_USAGE
        (line,) = capfd.readouterr().err.splitlines()
        assert words in line


def test_a_job_file_cannot_ask_for_more(root, capfd):
    """Rights, folders and limits are no keys of sets."""
    for key in (
        "untrusted",
        "input-folder",
        "output-folder",
        "timeout",
        "max-memory",
        "log",
        "workers",
        "resume",
        "sheet",
        "records",
    ):
        code, (line,) = attack(root, key, "/", capfd=capfd)
        assert code == run_report.WRONG_USAGE
        assert f"unknown key '{key}'" in line


def test_too_many_frames_are_refused(root, capfd):
    values = {**MESHES, "output": "out/m.png", "frames": "1-100000"}
    (root / "job/j.json").write_text(json.dumps({"bake": [values] * 11}))
    assert command.run(["--jobs", str(root / "job/j.json"), "--untrusted"]) == run_report.WRONG_USAGE
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("imprint: 1,100,000 maps are more than 1,000,000")


LINKS = {
    "output folder": ("out2", []),
    "usual output folder": ("out", []),
    "report": ("r.json", ["--report", "r.json"]),
    "lines of the report": ("r.json.lines", ["--report", "r.json"]),
    "folder of the report": ("reports", ["--report", "reports/r.json"]),
    "logs": ("logs", ["--log", "logs"]),
    "page": ("s.html", ["--sheet", "s.html"]),
    "pictures": ("pictures", ["--pictures", "pictures"]),
    "records": ("records", ["--resume", "--records", "records"]),
}


@pytest.mark.parametrize(("name", "words"), LINKS.values(), ids=LINKS)
def test_links_among_the_files_do_not_move_what_the_caller_names(root, monkeypatch, name, words, capfd):
    monkeypatch.chdir(root / "job")
    if name == "out":
        (root / "job/out").rename(root / "job/before")
    if name == "out2":
        words = ["--output-folder", name]
    (root / "job" / name).symlink_to(root / "outside" / ("victim.json" if ".json" in name or ".html" in name else ""))
    code, (line,) = attack(root, "size", 16, *words, capfd=capfd)
    assert code == run_report.WRONG_USAGE
    assert "is a link out of" in line


def test_a_name_cannot_write_to_the_terminal(root, capfd):
    name = "a\x1b]0;title\x07\nSaved: '/etc/passwd'\u202e\x9b2J"
    (root / "job/s.blend").write_bytes(blend((b"OB", bytes(8))))
    values = {"file": "s.blend", "low": name, "output": "../m.png"}
    (root / "job/j.json").write_text(json.dumps({"bake": [values, values]}))
    assert command.run(["--jobs", str(root / "job/j.json"), "--untrusted"]) == run_report.WRONG_USAGE
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 2
    assert all("(a?]0;title??Saved: '/etc/passwd'??2J)" in line and line.isprintable() for line in lines)


@pytest.mark.parametrize("place", ["job", "job/out", "job/new/er", "outside/back", "logs", "logs/of"])
def test_records_are_not_where_untrusted_files_can_be(root, place, capfd):
    (root / "outside/back").symlink_to(root / "job")
    words = ["--resume", "--records", str(root / place), "--log", str(root / "logs")]
    code, (line,) = attack(root, "size", 16, *words, capfd=capfd)
    assert code == run_report.WRONG_USAGE
    assert "where untrusted files can be" in line


PARTS = [
    "..",
    ".",
    "",
    "out",
    "link",
    "deep",
    "outside",
    "~",
    "%2e%2e",
    "{low}",
    "<UDIM>",
    "###",
    "C:",
    "\\",
    " ",
    "é",
    "a\n",
    "\x1b",
]


@random_cases.seeds(100, fast=2)
def test_random_paths(root, seed, capfd):
    """What is accepted lies in the folders, by what the system says of the path; nothing is changed either way."""
    rng = random.Random(seed)
    key, ending = rng.choice([*WRITES.items(), *READS.items()])
    parts = [rng.choice(PARTS) for _ in range(rng.randint(1, 6))]
    path = rng.choice(["", "", "/", "//", f"{root}/"]) + "/".join(
        [*parts, rng.choice(["map", "low", "secret", "victim"])]
    )
    code, said = attack(root, key, path + ending, "--check", capfd=capfd)
    real = Path(os.path.realpath(root / "job" / (path + ending)))
    folder = root / "job" / ("out" if key in WRITES else "")
    if code == run_report.DONE:
        assert real.is_relative_to(folder)
    else:
        assert len(said) >= 1
        assert all(line.startswith("imprint: ") for line in said)
    if not real.is_relative_to(folder):
        words = "--untrusted", "is a folder", "UDIM"
        assert any(is_of_other_systems(line) or any(word in line for word in words) for line in said)


def test_the_input_folder_may_be_another_one(root, capfd):
    """The caller may allow what a job file may not."""
    for key, words in {
        "low-file": ["--input-folder", str(root)],
        "output": ["--output-folder", str(root / "outside")],
    }.items():
        path = "../outside/secret.obj" if key == "low-file" else "../outside/m.png"
        (root / "job/j.json").write_text(json.dumps({"bake": [{**MESHES, "output": "out/m.png", key: path}]}))
        call = ["--jobs", str(root / "job/j.json"), "--untrusted", "--check"]
        assert command.run(call) == run_report.WRONG_USAGE
        assert command.run([*call, *words]) == run_report.DONE
    assert command.run([*call, "--input-folder", str(root / "none")]) == run_report.WRONG_USAGE
    assert "There is no folder" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("--low-file a.obj --output m.png --untrusted --workers 0", "--untrusted needs a process for the bakes"),
        ("--low-file a.obj --output m.png --timeout 9 --workers 0", "--timeout needs a process for the bakes"),
        ("--low-file a.obj --output m.png --input-folder x", "are for --untrusted"),
        ("--low a --output m.png --untrusted", "the open file has been opened already"),
        ("--low-file a.obj --output m.png --untrusted --resume", "--resume needs --records DIR with --untrusted"),
        ("--low-file a.obj --output m.png --untrusted --force", "--force needs --records DIR with --untrusted"),
        ("--low-file a.obj --output m.png --records x", "--records is for --resume and --force"),
    ],
)
def test_options_that_contradict_each_other(words, error, capfd):
    assert command.run(words.split()) == run_report.WRONG_USAGE
    assert error in capfd.readouterr().err
