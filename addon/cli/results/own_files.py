# SPDX-License-Identifier: GPL-3.0-or-later
"""What a report and a page of results may replace: a map or a mesh may be there, whose path was given by mistake."""

import os

from ...core.errors import WrongPlace

READ = 1024
"""Bytes of the beginning of a file, which has comments and blanks."""


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
    if start and not start.removeprefix(b"\xef\xbb\xbf").lstrip().lower().startswith(starts):
        raise WrongPlace(
            f"{title[:1].upper()}{title[1:]} would overwrite {path!r}, which is not {kind}: choose another path for it."
        )
