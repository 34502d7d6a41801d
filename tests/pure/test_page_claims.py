# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that each sentence of the README's first screen and of the store's text has a proof: page_claims.toml names tests
that are there, or sections of the manual with what was measured."""

import ast
import functools
import re
import tomllib
from pathlib import Path

import pytest

from scripts.imprint import ROOT
from tests.pure.test_docs import anchors
from tests.support.manual import FENCED, section

TABLE = Path(__file__).with_name("page_claims.toml")
CLAIMS = tomllib.loads(TABLE.read_text(encoding="utf-8"))
ENDS = {"README.md": "\n## Install\n", "docs/extension/description.md": None}
"""Where the sentences of a page end that are looked at."""


def sentences(text):
    """The sentences of a page as plain words: without code, pictures, tables, headings, marks and links."""
    text = re.sub(FENCED, "\n\n", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"!\[[^\]]*\]\([^)]+\)", "", text)
    text = re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", text)
    text = re.sub(r"^(?:#|\|).*$", "\n", text, flags=re.MULTILINE)
    text = re.sub(r"^- ", "\n\n", text, flags=re.MULTILINE)
    text = re.sub(r"[*`]", "", text)
    paragraphs = (" ".join(each.split()) for each in re.split(r"\n\s*\n", text))
    return [one for each in paragraphs if each for one in re.split(r"(?<=[.!?]) +(?=[A-Z])", each)]


def claimed(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    end = ENDS[page]
    return sentences(text[: text.index(end)] if end else text)


@functools.cache
def named_tests(path):
    """The names of the tests of a file."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")}


def is_proof(proof, sentence):
    """Whether a proof is there. A section with measurements has each number of the sentence."""
    path, _, test = proof.partition("::")
    if test:
        return (ROOT / path).is_file() and test in named_tests(path)
    path, _, anchor = proof.partition("#")
    page = ROOT / path
    if not (page.is_file() and anchor in anchors(page)):
        return False
    (heading,) = (
        line
        for line in re.findall(r"^#+ .+$", page.read_text(encoding="utf-8"), re.MULTILINE)
        if re.sub(r"[^\w\- ]", "", line.lstrip("# ").lower()).replace(" ", "-") == anchor
    )
    measured = set(re.findall(r"\d[\d,.]*\d|\d+", section(page, heading).replace(",", "").replace("_", " ")))
    return set(re.findall(r"\d+", sentence.replace(",", ""))) <= measured


def test_sentences_are_found():
    text = """# Head\n\nOne [link](to.md) of `code`: 4.5 LTS. *Two* lines\nof one? Three\n\n- An item. It\n  goes on.\n- Last
![A picture. No sentence.](x.jpg)\n\n| a cell. | No. |\n\n```sh\nno. Command.\n```\n"""
    found = ["One link of code: 4.5 LTS.", "Two lines of one?", "Three", "An item.", "It goes on.", "Last"]
    assert sentences(text) == found


@pytest.mark.parametrize("page", ENDS)
def test_each_sentence_has_a_proof_and_each_proof_a_sentence(page):
    assert claimed(page) == list(CLAIMS[page])


@pytest.mark.parametrize("page", ENDS)
def test_proofs_are_there(page):
    lacking = [
        (sentence, proof)
        for sentence, proofs in CLAIMS[page].items()
        for proof in proofs or [""]
        if not is_proof(proof, sentence)
    ]
    assert lacking == []


def test_what_is_no_proof():
    assert is_proof("docs/benchmarks.md#on-a-gpu", "It takes 375 ms.")
    assert not is_proof("docs/benchmarks.md#on-a-gpu", "It takes 376 ms.")
    assert not is_proof("docs/benchmarks.md#nowhere", "It is fast.")
    assert is_proof("tests/pure/test_page_claims.py::test_what_is_no_proof", "It is fast.")
    assert not is_proof("tests/pure/test_page_claims.py::test_that_is_gone", "It is fast.")
    assert not is_proof("tests/pure/test_gone.py::test_what_is_no_proof", "It is fast.")
    assert not is_proof("", "It is fast.")
