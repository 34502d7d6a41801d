# SPDX-License-Identifier: GPL-3.0-or-later
"""Sends a job to a Flamenco Manager, by its web interface."""

import base64
import http.client
import json
import platform
import re
import urllib.error
import urllib.parse
import urllib.request
from dataclasses import dataclass, field
from typing import Any

from .core.errors import BakeError

JOB_TYPE = "imprint-bake"
"""The manager's name for scripts/farm/flamenco/imprint_bake.js."""
_SECONDS = 30.0
"""How long the manager may take for an answer."""
_NOT_FOUND = 404


@dataclass(frozen=True)
class Job:
    """A job of the type JOB_TYPE.

    Attributes:
        settings: Those that differ from what the job type sets.
        name: In Flamenco's list.
        priority: Jobs with larger numbers come first.
    """

    name: str
    settings: dict[str, Any]
    priority: int = 50


@dataclass(frozen=True)
class _Manager:
    """A manager. Messages show it without a password."""

    address: str
    """Without a path, a user and a password."""
    headers: dict[str, str] = field(default_factory=dict, repr=False)

    def __str__(self) -> str:
        return self.address


def submit(url: str, job: Job) -> str:
    """Send a job to the manager at this address. Returns the address of the job's page. Raises BakeError."""
    manager = _manager(url)
    try:
        kind = _ask(manager, f"jobs/type/{JOB_TYPE}")
    except urllib.error.HTTPError as error:
        if error.code != _NOT_FOUND:
            raise _refusal(manager, error) from error
        raise BakeError(
            f"The Flamenco Manager at {manager} does not know the job type {JOB_TYPE!r}: copy imprint_bake.js into its "
            "folder 'scripts', and start it again"
        ) from error
    try:
        usual = {setting["key"]: setting["default"] for setting in kind["settings"] if "default" in setting}
        body = {
            "name": job.name,
            "type": JOB_TYPE,
            "type_etag": kind["etag"],
            "priority": job.priority,
            "submitter_platform": platform.system().lower(),
            "settings": {**usual, **job.settings},
            "metadata": {},
        }
        return f"{manager}/app/jobs/{_ask(manager, 'jobs', body)['id']}"
    except urllib.error.HTTPError as error:
        raise _refusal(manager, error) from error
    except (KeyError, TypeError) as error:
        raise _stranger(manager) from error


def _manager(url: str) -> _Manager:
    """The manager at an address, which may have a user and a password. Raises BakeError."""
    try:
        parts = urllib.parse.urlsplit(url if "://" in url else f"http://{url}")
        user, at, host = parts.netloc.rpartition("@")
        is_host = re.fullmatch(r"[!-~]+", host) and parts.hostname and parts.port != 0
        is_right = parts.scheme in ("http", "https") and is_host
    except ValueError:  # of the port, or of brackets
        is_right = False
    if not is_right:
        shown = re.sub(r"(?s)^(.*://)?.*@", lambda start: f"{start[1] or ''}***@", url)
        raise BakeError(f"{shown!r} is not the address of a Flamenco Manager, such as http://flamenco.local:8080")
    headers = {}
    if at:
        secret = urllib.parse.unquote_to_bytes(user if ":" in user else f"{user}:")
        headers["Authorization"] = f"Basic {base64.b64encode(secret).decode()}"
    return _Manager(f"{parts.scheme}://{host}", headers)


def _ask(manager: _Manager, path: str, body: dict | None = None) -> dict[str, Any]:
    """The manager's answer to a request, which is a POST if there is a body. Raises HTTPError, BakeError."""
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(f"{manager}/api/v3/{path}", data, {"Content-Type": "application/json"})
    for name, value in manager.headers.items():
        request.add_unredirected_header(name, value)  # what the manager leads to gets no password
    try:
        with urllib.request.urlopen(request, timeout=_SECONDS) as answer:
            answered = json.loads(answer.read())
    except urllib.error.HTTPError:
        raise
    except (OSError, http.client.HTTPException) as error:
        reason = getattr(error, "reason", None) or error
        raise BakeError(f"No Flamenco Manager answers at {manager}: {reason}") from error
    except ValueError as error:
        raise _stranger(manager) from error
    return answered


def _stranger(manager: _Manager) -> BakeError:
    return BakeError(f"The server at {manager} is not a Flamenco Manager")


def _refusal(manager: _Manager, error: urllib.error.HTTPError) -> BakeError:
    try:
        reason = json.loads(error.read())["message"]
    except (OSError, ValueError, KeyError, TypeError):
        reason = f"{error.code} {error.reason}"
    return BakeError(f"The Flamenco Manager at {manager} refuses the job: {reason}")
