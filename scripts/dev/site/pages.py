# SPDX-License-Identifier: GPL-3.0-or-later
"""The hook of MkDocs: pages outside docs/ become pages of the site, and links lead where the site has their targets.

In the repository, links are relative to the file that they are in, and anchors are GitHub's. Both stay as they are there.
"""

import os
import posixpath
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
OUTSIDE = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Pages at the top of the repository, and their places in the site."""
LINK = re.compile(r"(!?)\[([^\[\]]*)\]\(([^)\s]+)\)")


def repository() -> str:
    """The address of the repository's files where they can be looked at, in a workflow of GitHub, or ""."""
    names = ("GITHUB_SERVER_URL", "GITHUB_REPOSITORY", "GITHUB_SHA")
    server, name, commit = (os.environ.get(each, "") for each in names)
    return f"{server}/{name}/blob/{commit}" if server and name and commit else ""


def place_of(path: str) -> str | None:
    """The place in the site of a file of the repository, or None if it has none."""
    if path in OUTSIDE:
        return OUTSIDE[path]
    return path.removeprefix("docs/") if path.startswith("docs/") and not path.startswith("docs/extension/") else None


def source_of(place: str) -> str:
    """The path in the repository of a page of the site."""
    return next((path for path, other in OUTSIDE.items() if other == place), f"docs/{place}")


def relinked(text: str, place: str, files: str) -> str:
    """A page's text with links for its place in the site.

    files: the address of the repository's files. Without it, links to files that the site lacks become plain words.
    """
    source = source_of(place)

    def replaced(match: re.Match) -> str:
        mark, words, target = match.groups()
        if re.match(r"[a-z]+:|#", target):
            return match[0]
        path, _, anchor = target.partition("#")
        wanted = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        there = place_of(wanted)
        ending = f"#{anchor}" if anchor else ""
        if there is not None:
            return f"{mark}[{words}]({posixpath.relpath(there, posixpath.dirname(place) or '.')}{ending})"
        return f"{mark}[{words}]({files}/{wanted}{ending})" if files else words

    fenced = re.split(r"(^ *```.*?^ *```)", text, flags=re.MULTILINE | re.DOTALL)
    return "".join(part if number % 2 else LINK.sub(replaced, part) for number, part in enumerate(fenced))


def slug(text: str, separator: str) -> str:
    """The anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", separator)


# Called by MkDocs


def on_config(config):
    config.mdx_configs["toc"]["slugify"] = slug
    if repository():
        config.repo_url = "{GITHUB_SERVER_URL}/{GITHUB_REPOSITORY}".format_map(os.environ)
    return config


def on_files(files, config):
    from mkdocs.structure.files import File

    for path, place in OUTSIDE.items():
        files.append(File.generated(config, place, abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown, page, config, files):
    return relinked(markdown, page.file.src_uri, repository())
