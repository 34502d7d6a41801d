# SPDX-License-Identifier: GPL-3.0-or-later
"""What a report and a page of results may replace: a map or a mesh may be there, whose path was given by mistake."""

import os

from ...core.errors import WrongPlace

READ = 1024
"""Bytes of the beginning of a file, which may have blanks."""
_BLANK = b" \t\r\n\0"
"""Bytes that are nothing. File systems leave zeros of a file that was written when the power failed."""


def check_report(path: str, title: str) -> None:
    """Raise WrongPlace if `path` is a file that is not JSON. title: of the report, for the message."""
    _check(path, title, (b"{", b"["), "JSON")


def check_page(path: str, title: str) -> None:
    """Raise WrongPlace if `path` is a file that is not HTML. title: of the page, for the message."""
    _check(path, title, (b"<!doctype html", b"<html"), "HTML")


def _check(path: str, title: str, starts: tuple[bytes, ...], kind: str) -> None:
    if not os.path.isfile(path):  # a pipe would wait for a writer
        return
    try:
        with open(path, "rb") as file:
            start = file.read(READ)
    except OSError:  # the bake reports it
        return
    start = start.removeprefix(b"\xef\xbb\xbf").lstrip(_BLANK).lower()
    if start and not start.startswith(starts):
        raise WrongPlace(
            f"{title[:1].upper()}{title[1:]} would overwrite {path!r}, which is not {kind}: choose another path for it."
        )
