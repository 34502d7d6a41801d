# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which tags may become releases, and what their notes hold."""

import pytest

from scripts.dev import release

CHANGELOG = """# Changelog

## Unreleased

## 1.2.0 - 2026-01-02

### Added

- A map, see [the manual](docs/maps.md#a-map) and [a page](https://example.org/).

## 1.1.0 - 2025-01-02

- Older.
"""


@pytest.fixture
def checkout(tmp_path):
    (tmp_path / "blender_manifest.toml").write_text('schema_version = "1.0.0"\nid = "imprint"\nversion = "1.2.0"\n')
    (tmp_path / "pyproject.toml").write_text('[project]\nversion = "1.2.0"\n')
    (tmp_path / "CITATION.cff").write_text("cff-version: 1.2.0\nversion: 1.2.0\ndate-released: 2026-01-02\n")
    (tmp_path / "CHANGELOG.md").write_text(CHANGELOG)
    return tmp_path


def change(path, old, new):
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))


def test_a_tag_of_the_version_may_become_a_release(checkout):
    assert list(release.problems("v1.2.0", checkout)) == []


def test_another_version_may_not(checkout):
    named = [line.split()[0] for line in release.problems("v1.1.0", checkout)]
    assert named == ["blender_manifest.toml", "pyproject.toml", "CITATION.cff", "CHANGELOG.md"]


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("blender_manifest.toml", '\nversion = "1.2.0"', '\nversion = "1.2.1"'),
        ("pyproject.toml", "1.2.0", "1.3.0"),
        ("CITATION.cff", "\nversion: 1.2.0", ""),
        ("CITATION.cff", "2026-01-02", "2026-01-03"),
        ("CHANGELOG.md", "## 1.2.0 - 2026-01-02", "## 1.2.0"),
        ("CHANGELOG.md", "## Unreleased\n", "## Unreleased\n\n- New.\n"),
    ],
)
def test_each_difference_is_named(checkout, name, old, new):
    change(checkout / name, old, new)
    (problem,) = release.problems("v1.2.0", checkout)
    assert name in problem.replace("date in CITATION.cff", "CITATION.cff")


def test_a_release_is_prepared(checkout):
    (checkout / "README.md").write_text("Get `imprint-1.2.0.zip`.")
    change(checkout / "CHANGELOG.md", "## Unreleased\n", "## Unreleased\n\n- New.\n")
    release.prepare("v1.3.0", "2026-03-04", checkout)
    assert list(release.problems("v1.3.0", checkout)) == []
    assert release.notes("v1.3.0", checkout) == "- New.\n"
    assert (checkout / "README.md").read_text() == "Get `imprint-1.3.0.zip`."
    assert (checkout / "blender_manifest.toml").read_text().startswith('schema_version = "1.0.0"\n')


def test_notes_are_the_section_without_links_to_files(checkout):
    assert release.notes("v1.2.0", checkout) == (
        "### Added\n\n- A map, see the manual and [a page](https://example.org/).\n"
    )


def test_the_files_of_this_checkout_agree():
    """Between releases, the changelog alone may have more."""
    version = next(heading for heading in release.sections() if heading != "Unreleased").split()[0]
    assert set(release.problems(f"v{version}")) <= {"CHANGELOG.md has entries that are unreleased."}
