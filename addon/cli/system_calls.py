# SPDX-License-Identifier: GPL-3.0-or-later
"""The system calls that the sandbox of untrusted files refuses, as a seccomp filter for bubblewrap.

Each reaches what read-only folders do not hold back: sockets in the file system and those of virtual machines, namespaces in
which a process has rights, keyrings, memory that belongs to no process, and programs in the kernel. Drivers and libraries do
without them.
"""

import errno
import platform
import struct
from collections.abc import Iterator

_NUMBERS = {
    "x86_64": {
        "socket": 41, "clone": 56, "shmget": 29, "unshare": 272, "setns": 308, "clone3": 435, "add_key": 248,
        "request_key": 249, "keyctl": 250, "mq_open": 240, "perf_event_open": 298, "bpf": 321, "userfaultfd": 323,
        "io_uring_setup": 425,
    },
    "aarch64": {
        "socket": 198, "clone": 220, "shmget": 194, "unshare": 97, "setns": 268, "clone3": 435, "add_key": 217,
        "request_key": 218, "keyctl": 219, "mq_open": 180, "perf_event_open": 241, "bpf": 280, "userfaultfd": 282,
        "io_uring_setup": 425,
    },
}  # fmt: skip
"""The calls' numbers, by what `platform.machine` returns."""
_KINDS = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
"""The kernel's names for the kinds of calls that these machines make; each also has one for 32 bits."""
_ABSENT = {"clone3": errno.ENOSYS, "io_uring_setup": errno.ENOSYS}
"""The errors of calls for which libraries have another way. Others are refused with EPERM."""
_OTHER_CALLS = 0x40000000
"""Calls of programs with pointers of 32 bits begin here on x86_64."""
_NAMESPACES = 0x7E020080
"""The flags of clone that make namespaces."""
_KIND, _NUMBER, _FLAGS = 4, 0, 16
"""Where the kernel puts the kind of a call, its number, and the lower half of its first argument."""
_LOAD, _RETURN, _IF_EQUAL, _IF_LEAST, _IF_ANY_BIT = 0x20, 0x06, 0x15, 0x35, 0x45
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000


def known() -> bool:
    """Whether this machine has a filter."""
    return platform.machine() in _NUMBERS


def program(machine: str = "") -> bytes:
    """The filter, as bwrap's option --seccomp reads it. machine: as `platform.machine` returns it, for another one."""
    return b"".join(_steps(machine or platform.machine()))


def _steps(machine: str) -> Iterator[bytes]:
    numbers = dict(_NUMBERS[machine])
    clone = numbers.pop("clone")
    yield _step(_LOAD, _KIND)
    yield _step(_IF_EQUAL, _KINDS[machine], 1, 0)
    yield _refuse(errno.ENOSYS)
    yield _step(_LOAD, _NUMBER)
    yield _step(_IF_LEAST, _OTHER_CALLS, 0, 1)
    yield _refuse(errno.ENOSYS)
    for name, number in numbers.items():
        yield _step(_IF_EQUAL, number, 0, 1)
        yield _refuse(_ABSENT.get(name, errno.EPERM))
    yield _step(_IF_EQUAL, clone, 0, 3)
    yield _step(_LOAD, _FLAGS)
    yield _step(_IF_ANY_BIT, _NAMESPACES, 0, 1)
    yield _refuse(errno.EPERM)
    yield _step(_RETURN, _ALLOW)


def _refuse(error: int) -> bytes:
    return _step(_RETURN, _REFUSE | error)


def _step(code: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
    """A step of the filter, which goes on so many steps after the next one."""
    return struct.pack("=HBBI", code, if_true, if_false, value)
