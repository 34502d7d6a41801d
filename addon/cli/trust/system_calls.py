# SPDX-License-Identifier: GPL-3.0-or-later
"""A filter of system calls on Linux, for what Landlock does not hold: processes, sockets, the memory and messages that a user's
programs share, names of files that change, and attributes of files."""

import ctypes
import os
import platform
import struct
import sys

_ARCHITECTURES = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}
"""The column of the tables below, and the number that the kernel has for the processor."""
DENIED: dict[str, tuple[int | None, int | None]] = {
    "socket": (41, 198),
    "socketpair": (53, 199),
    "connect": (42, 203),
    "bind": (49, 200),
    "fork": (57, None),
    "vfork": (58, None),
    "kill": (62, 129),
    "tkill": (200, 130),
    "rt_sigqueueinfo": (129, 138),
    "rt_tgsigqueueinfo": (297, 240),
    "pidfd_send_signal": (424, 424),
    "pidfd_open": (434, 434),
    "pidfd_getfd": (438, 438),
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "process_madvise": (440, 440),
    "process_mrelease": (448, 448),
    "kcmp": (312, 272),
    "get_robust_list": (274, 100),
    "ioprio_set": (251, 30),
    "migrate_pages": (256, 238),
    "move_pages": (279, 239),
    "shmget": (29, 194),
    "shmat": (30, 196),
    "shmctl": (31, 195),
    "shmdt": (67, 197),
    "semget": (64, 190),
    "semop": (65, 193),
    "semctl": (66, 191),
    "semtimedop": (220, 192),
    "msgget": (68, 186),
    "msgsnd": (69, 189),
    "msgrcv": (70, 188),
    "msgctl": (71, 187),
    "mq_open": (240, 180),
    "mq_unlink": (241, 181),
    "mq_timedsend": (242, 182),
    "mq_timedreceive": (243, 183),
    "mq_notify": (244, 184),
    "mq_getsetattr": (245, 185),
    "inotify_init": (253, None),
    "inotify_init1": (294, 26),
    "inotify_add_watch": (254, 27),
    "inotify_rm_watch": (255, 28),
    "fanotify_init": (300, 262),
    "fanotify_mark": (301, 263),
    "syslog": (103, 116),
    "mount": (165, 40),
    "umount2": (166, 39),
    "pivot_root": (155, 41),
    "chroot": (161, 51),
    "open_tree": (428, 428),
    "move_mount": (429, 429),
    "fsopen": (430, 430),
    "fsconfig": (431, 431),
    "fsmount": (432, 432),
    "fspick": (433, 433),
    "mount_setattr": (442, 442),
    "unshare": (272, 97),
    "setns": (308, 268),
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
    "io_uring_setup": (425, 425),
    "io_uring_enter": (426, 426),
    "io_uring_register": (427, 427),
    "init_module": (175, 105),
    "finit_module": (313, 273),
    "delete_module": (176, 106),
    "kexec_load": (246, 104),
    "kexec_file_load": (320, 294),
    "reboot": (169, 142),
    "swapon": (167, 224),
    "swapoff": (168, 225),
    "sethostname": (170, 161),
    "setdomainname": (171, 162),
    "settimeofday": (164, 170),
    "clock_settime": (227, 112),
    "adjtimex": (159, 171),
    "clock_adjtime": (305, 266),
    "acct": (163, 89),
    "quotactl": (179, 60),
    "name_to_handle_at": (303, 264),
    "open_by_handle_at": (304, 265),
    "iopl": (172, None),
    "ioperm": (173, None),
}
"""The calls that fail with EPERM: the numbers on x86_64 and aarch64."""
IGNORED: dict[str, tuple[int | None, int | None]] = {
    "chmod": (90, None),
    "fchmod": (91, 52),
    "fchmodat": (268, 53),
    "fchmodat2": (452, 452),
    "chown": (92, None),
    "fchown": (93, 55),
    "lchown": (94, None),
    "fchownat": (260, 54),
    "utime": (132, None),
    "utimes": (235, None),
    "futimesat": (261, None),
    "utimensat": (280, 88),
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "fsetxattr": (190, 7),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "fremovexattr": (199, 16),
    "setxattrat": (463, 463),
    "removexattrat": (466, 466),
}
"""The calls that do nothing and succeed: copies of files set attributes, which is no reason to fail."""
OWN: dict[str, tuple[int | None, int | None]] = {
    "prlimit64": (302, 261),
    "setpriority": (141, 140),
    "sched_setparam": (142, 118),
    "sched_setscheduler": (144, 119),
    "sched_setattr": (314, 274),
    "sched_setaffinity": (203, 122),
}
"""The calls whose first argument must be 0: the process or thread that calls. For setpriority it is the kind of its second
argument, which must be 0, too."""
TO_ITSELF: dict[str, tuple[int | None, int | None]] = {"tgkill": (234, 131)}
"""The call whose first argument must be the number of this process, as where it aborts."""
COMMANDS: dict[str, tuple[int | None, int | None]] = {"fcntl": (72, 25), "ioctl": (16, 29)}
"""The calls whose second argument is a command."""
_FORBIDDEN = {"fcntl": (8, 10, 15), "ioctl": (0x8901, 0x8902, 0x5412, 0x541C)}
"""The commands that fail: they make the kernel send a signal to another process, or type into its terminal."""
_CLONE, _CLONE3, _CLONE_THREAD = (56, 220), (435, 435), 0x10000
_X32 = 0x40000000
"""The first number of x86_64's calls with short pointers."""
_EPERM, _ENOSYS = 1, 38
_ALLOW, _KILL, _FAIL = 0x7FFF0000, 0x80000000, 0x00050000
_LOAD, _EQUAL, _AT_LEAST, _HAS_BITS, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_NUMBER_AT, _PROCESSOR_AT, _ARGUMENTS_AT = 0, 4, (16, 24)
"""Of an argument, the lower 32 bits: the kernel takes no more for processes and commands."""
_SET_SECCOMP, _FILTER, _SET_NO_NEW_PRIVILEGES = 22, 2, 38


def is_known() -> bool:
    """Whether there is a filter for this system and processor."""
    return sys.platform == "linux" and platform.machine() in _ARCHITECTURES


def forbid_privileges() -> None:
    """No program that this process starts gains privileges, as by a set-user-ID bit. Raises OSError."""
    _control(_SET_NO_NEW_PRIVILEGES, 1, None)


def restrict() -> None:
    """Filter the calls of this thread and its children from now on. Call `forbid_privileges` before. Raises OSError."""
    code = program()
    buffer = ctypes.create_string_buffer(code)

    class Program(ctypes.Structure):
        _fields_ = (("length", ctypes.c_ushort), ("code", ctypes.c_void_p))

    _control(_SET_SECCOMP, _FILTER, ctypes.byref(Program(len(code) // 8, ctypes.addressof(buffer))))


def program(machine: str = "", process: int = 0) -> bytes:
    """The filter, for the machine in the kernel that runs it. machine: the processor; this one if empty. process: the number of
    the process that is filtered; this one if 0."""
    column, processor = _ARCHITECTURES[machine or platform.machine()]
    lines = [(_LOAD, 0, 0, _PROCESSOR_AT), (_EQUAL, 1, 0, processor), (_RETURN, 0, 0, _KILL), (_LOAD, 0, 0, _NUMBER_AT)]
    if column == 0:
        lines += _if(_AT_LEAST, _X32, _FAIL | _EPERM)
    for table, answer in ((DENIED, _FAIL | _EPERM), (IGNORED, _FAIL)):
        for numbers in table.values():
            if numbers[column] is not None:
                lines += _if(_EQUAL, numbers[column], answer)
    for table in (OWN, TO_ITSELF, COMMANDS):
        for name, numbers in table.items():
            checks = _checks(name, process or os.getpid())
            lines += [(_EQUAL, 0, len(checks), numbers[column]), *checks]
    lines += _if(_EQUAL, _CLONE3[column], _FAIL | _ENOSYS)  # its flags cannot be seen; callers go on with clone
    lines += [(_EQUAL, 0, 3, _CLONE[column]), (_LOAD, 0, 0, _ARGUMENTS_AT[0])]
    lines += [(_HAS_BITS, 1, 0, _CLONE_THREAD), (_RETURN, 0, 0, _FAIL | _EPERM), (_RETURN, 0, 0, _ALLOW)]
    return b"".join(struct.pack("<HBBI", *line) for line in lines)


def _checks(name: str, process: int) -> list[tuple[int, int, int, int]]:
    """The end of the filter for a call that depends on its arguments."""
    lines = []
    if name in COMMANDS:
        lines.append((_LOAD, 0, 0, _ARGUMENTS_AT[1]))
        for command in _FORBIDDEN[name]:
            lines += _if(_EQUAL, command, _FAIL | _EPERM)
    else:
        for place in _ARGUMENTS_AT[: 2 if name == "setpriority" else 1]:
            lines += [(_LOAD, 0, 0, place), (_EQUAL, 1, 0, process if name in TO_ITSELF else 0)]
            lines.append((_RETURN, 0, 0, _FAIL | _EPERM))
    return [*lines, (_RETURN, 0, 0, _ALLOW)]


def _if(comparison: int, value: int, answer: int) -> list[tuple[int, int, int, int]]:
    return [(comparison, 0, 1, value), (_RETURN, 0, 0, answer)]


def _control(option: int, argument: int, more) -> None:
    words = (ctypes.c_ulong(argument), more or ctypes.c_ulong(0), ctypes.c_ulong(0), ctypes.c_ulong(0))
    if ctypes.CDLL(None, use_errno=True).prctl(option, *words) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
