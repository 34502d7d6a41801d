# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the filter of system calls alone, without Landlock: on this processor by attacks, on both by running its program."""

import errno
import json
import os
import re
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from addon.cli.trust import system_calls
from scripts.imprint import ROOT

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a filter of Linux")

HEADERS = {
    "x86_64": Path("/usr/include/x86_64-linux-gnu/asm/unistd_64.h"),
    "aarch64": Path("/usr/include/asm-generic/unistd.h"),  # it has no numbers of its own
}
PROCESSORS = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
COLUMNS = {"x86_64": 0, "aarch64": 1}
TABLES = (system_calls.DENIED, system_calls.IGNORED, system_calls.OWN, system_calls.TO_ITSELF, system_calls.COMMANDS)
PROCESS = 4321
"""The process that is filtered."""
ALLOWED, REFUSED, IGNORED = 0x7FFF0000, 0x00050000 | errno.EPERM, 0x00050000
ATTACK = """
import ctypes, errno, json, os, sys
sys.path[:0] = sys.argv[1:3]
import sitecustomize
from addon.cli.trust import system_calls
attacks = sitecustomize.calls(int(sys.argv[3]))
if sys.argv[4] == "filtered":
    system_calls.forbid_privileges()
    system_calls.restrict()
said = {}
for name, call in attacks.items():
    try:
        sitecustomize._call(*call)
        said[name] = "done"
    except OSError as error:
        said[name] = errno.errorcode[error.errno]
own = (ctypes.c_ulong * 2)()
sitecustomize._call((302, 261), 0, 7, None, ctypes.byref(own))  # its own limits
os.sched_setaffinity(0, os.sched_getaffinity(0))
sitecustomize._call((234, 131), os.getpid(), os.getpid(), 0)
print(json.dumps(said))
"""


@pytest.fixture
def victim():
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    yield process
    process.kill()
    process.wait()


def attack(victim, word):
    """What the system says of each attack on a process. word: "filtered" or "free"."""
    words = [str(ROOT), str(ROOT / "tests/support/sabotage"), str(victim.pid), word]
    done = subprocess.run([sys.executable, "-S", "-c", ATTACK, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.skipif(not system_calls.is_known(), reason="another processor")
def test_a_process_with_the_filter_alone_can_do_nothing_to_others(victim):
    said = attack(victim, "filtered")
    assert set(said.values()) == {"EPERM"}
    assert victim.poll() is None
    assert os.getpriority(os.PRIO_PROCESS, victim.pid) == os.getpriority(os.PRIO_PROCESS, 0)


def answer(machine, name, *arguments):
    """What the filter says of a call, by running its program."""
    numbers = next(table[name] for table in TABLES if name in table) if isinstance(name, str) else (name, name)
    words = [each & (2**64 - 1) for each in (*arguments, 0, 0, 0, 0, 0, 0)[:6]]
    data = struct.pack("<IIQ6Q", numbers[COLUMNS[machine]], PROCESSORS[machine], 0, *words)
    code = system_calls.program(machine, PROCESS)
    lines = [struct.unpack_from("<HBBI", code, place) for place in range(0, len(code), 8)]
    assert len(lines) <= 4096  # the kernel takes no more
    place, value = 0, 0
    while True:
        kind, yes, no, number = lines[place]
        place += 1
        match kind:
            case 0x20:
                (value,) = struct.unpack_from("<I", data, number)
            case 0x06:
                return number
            case 0x15:
                place += yes if value == number else no
            case 0x35:
                place += yes if value >= number else no
            case 0x45:
                place += yes if value & number else no


OTHERS = {
    "prlimit64": (99,),
    "setpriority": (0, 99),
    "sched_setaffinity": (99,),
    "sched_setscheduler": (99,),
    "sched_setparam": (99,),
    "sched_setattr": (99,),
    "tgkill": (99, 99),
    "fcntl": (3, 8),
    "ioctl": (3, 0x8902),
}
ITSELF = {**dict.fromkeys(system_calls.OWN, (0,)), "tgkill": (PROCESS, 99), "fcntl": (3, 4), "ioctl": (3, 0x5413)}


@pytest.mark.parametrize("machine", PROCESSORS)
def test_on_each_processor_calls_that_are_about_others_are_refused(machine):
    assert OTHERS.keys() == ITSELF.keys() == {name for table in TABLES[2:] for name in table}
    for name, arguments in OTHERS.items():
        assert answer(machine, name, *arguments) == REFUSED, name
    for name, arguments in ITSELF.items():
        assert answer(machine, name, *arguments) == ALLOWED, name
    assert answer(machine, "setpriority", 1, 0) == REFUSED  # its group, in which its parent is
    assert answer(machine, "prlimit64", -1) == REFUSED
    assert answer(machine, "prlimit64", 1 << 32) == ALLOWED  # the kernel sees 0


@pytest.mark.parametrize("machine", PROCESSORS)
def test_on_each_processor_the_tables_hold(machine):
    for table, expected in ((system_calls.DENIED, REFUSED), (system_calls.IGNORED, IGNORED)):
        for name, numbers in table.items():
            if numbers[COLUMNS[machine]] is not None:
                assert answer(machine, name) == expected, name
    clone = {"x86_64": 56, "aarch64": 220}[machine]
    assert answer(machine, clone, 0x10000) == ALLOWED  # a thread
    assert answer(machine, clone, 17) == REFUSED
    assert answer(machine, 63) == ALLOWED


@pytest.mark.parametrize("machine", PROCESSORS)
def test_the_numbers_of_calls_are_those_of_the_kernel(machine):
    if not HEADERS[machine].exists():
        pytest.skip("no headers of the kernel")
    found = re.findall(r"#define __NR(?:3264)?_(\w+)\s+(\d+)", HEADERS[machine].read_text())
    known = {name: int(number) for name, number in found}
    for table in TABLES:
        for name, numbers in table.items():
            if name in known or max(known.values()) >= (numbers[COLUMNS[machine]] or 0):  # these headers are new enough
                assert numbers[COLUMNS[machine]] == known.get(name), name
