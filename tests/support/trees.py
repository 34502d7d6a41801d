# SPDX-License-Identifier: GPL-3.0-or-later
"""What is on a disk, to be compared before and after."""

import hashlib
import os
import stat
from pathlib import Path


def snapshot(root: Path, *without: Path) -> dict[str, tuple]:
    """All below `root`, but not `without` and what is below these: kinds, rights, times, contents and targets of links."""
    found = {}
    for folder, folders, names in os.walk(root):
        folders[:] = [name for name in folders if Path(folder, name) not in without]
        for name in (*folders, *names):
            path = Path(folder, name)
            facts = path.lstat()
            content = os.readlink(path) if path.is_symlink() else ""
            if stat.S_ISREG(facts.st_mode):
                content = hashlib.sha256(path.read_bytes()).hexdigest()
            found[str(path.relative_to(root))] = (
                facts.st_mode,
                facts.st_nlink,
                facts.st_mtime_ns,
                facts.st_size,
                content,
            )
    return found
