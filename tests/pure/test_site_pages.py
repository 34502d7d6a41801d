# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the links of the manual as a site."""

import re

import pytest

from scripts.dev.site import pages
from scripts.imprint import ROOT
from tests.pure.test_docs import anchors

FILES = "https://example.org/blob/1"


@pytest.mark.parametrize(
    ("place", "text", "wanted"),
    [
        ("index.md", "[a](docs/maps.md#b)", "[a](maps.md#b)"),
        ("index.md", "![a](docs/images/b.jpg)", "![a](images/b.jpg)"),
        ("index.md", "[a](CONTRIBUTING.md)", "[a](contributing.md)"),
        ("maps.md", "[a](../README.md#install)", "[a](index.md#install)"),
        ("maps.md", "[a](farms.md) [b](#c)", "[a](farms.md) [b](#c)"),
        ("maps.md", "[a](https://example.org/x.md)", "[a](https://example.org/x.md)"),
        ("maps.md", "[a](../scripts/bake.py)", f"[a]({FILES}/scripts/bake.py)"),
        ("maps.md", "[a](extension/description.md)", f"[a]({FILES}/docs/extension/description.md)"),
        ("maps.md", "```md\n[a](../README.md)\n```", "```md\n[a](../README.md)\n```"),
    ],
)
def test_links_lead_to_the_places_of_their_targets(place, text, wanted):
    assert pages.relinked(text, place, FILES) == wanted


def test_without_an_address_links_to_other_files_are_words():
    assert pages.relinked("see [the script](../scripts/bake.py).", "maps.md", "") == "see the script."


def test_the_address_is_that_of_the_workflow(monkeypatch):
    for name in ("GITHUB_SERVER_URL", "GITHUB_REPOSITORY", "GITHUB_SHA"):
        monkeypatch.delenv(name, raising=False)
    assert pages.repository() == ""
    for name, value in (
        ("GITHUB_SERVER_URL", "https://example.org"),
        ("GITHUB_REPOSITORY", "some/one"),
        ("GITHUB_SHA", "1"),
    ):
        monkeypatch.setenv(name, value)
    assert pages.repository() == "https://example.org/some/one/blob/1"


def test_anchors_are_those_of_github():
    for page in (ROOT / "docs").glob("*.md"):
        headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
        assert anchors(page) <= {pages.slug(heading, "-") for heading in headings}


def test_each_page_is_in_the_menu():
    menu = (ROOT / "scripts" / "dev" / "site" / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    listed = re.findall(r"[\w-]+\.md", menu)
    assert sorted(listed) == sorted([*pages.OUTSIDE.values(), *(path.name for path in (ROOT / "docs").glob("*.md"))])
