"""Plain words: docstrings open with their result, no text has a banned phrase, and the pages are short."""

import ast
import re
import subprocess
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MOST_WORDS_OF_A_FIRST_PAGE = 900
MOST_WORDS = 52_500  # of all written pages together; the aim is 45,000
GENERATED = re.compile(r"docs/(known_values\.md|benchmarks_by_name\.md|api\.md|cases/)")
QUESTION = re.compile(r"\W*(?:returns?\W+)?(?:what|whether|which|how|why)\b", re.IGNORECASE)
BANNED = re.compile(
    r"\bof (?:ours|yours)\b|\bhad missed\b|\b(?:it|one|that|which|they) (?:is|are) none\b|\b[Ww]hoever\b|\b[Ss]trangers?\b"
    r"|\b(?:is|are|was|were) (?:told|said)\b(?! to\b)"  # proper: elements that are said to converge
    r"|\bheld against\b(?! rigid\b)"  # proper: a point that is held against rigid motions
    r"|(?:^|[.:;*-]\s+)(?:Asked|Judged|Kept|Left|Meant|Said|Shown|Stated|Told) (?:is|are|was|were)\b"
)


def files(*patterns):
    """Return the tracked files that match the patterns, relative to the root."""
    found = subprocess.run(["git", "-C", str(ROOT), "ls-files", "-z", *patterns], capture_output=True, text=True)
    if found.returncode:
        pytest.skip("the files are not in a clone")
    return [name for name in found.stdout.split("\0") if (ROOT / name).is_file()]


def text_of(name):
    return (ROOT / name).read_text(encoding="utf-8")


@cache
def docstrings():
    """Return file, line and text of each docstring of the tracked Python files."""
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    nodes = [(name, node) for name in files("*.py") for node in ast.walk(ast.parse(text_of(name)))]
    with_text = [(name, node, ast.get_docstring(node, clean=False)) for name, node in nodes if isinstance(node, kinds)]
    return [(name, node.body[0].lineno, text) for name, node, text in with_text if text]


def banned(name, line, text):
    """Return place and phrase of each banned phrase in a text that starts at a line; line breaks count as spaces."""
    found = BANNED.finditer(re.sub(r"\s", " ", text))
    return [f"{name}:{line + text.count(chr(10), 0, hit.start())}: {hit[0].strip()}" for hit in found]


def pages():
    """Return the written pages of docs."""
    return [name for name in files("docs/*.md") if not GENERATED.match(name)]


def test_docstrings_open_with_their_result():
    found = [f"{name}:{line}: {text.splitlines()[0]}" for name, line, text in docstrings() if QUESTION.match(text)]
    assert not found, "\n".join(found)


def test_no_text_has_a_banned_phrase():
    prose = [*files("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "cases/*.toml"), *pages()]
    texts = [*docstrings(), *((name, 1, text_of(name)) for name in prose)]
    found = [hit for text in texts for hit in banned(*text)]
    assert not found, "\n".join(found)


def test_pages_are_short():
    counted = [name for name in pages() if not name.startswith(("docs/board/", "docs/papers/"))]  # figures, rows
    lengths = {name: len(text_of(name).split()) for name in ["README.md", *counted]}
    assert max(lengths["README.md"], lengths["docs/index.md"]) <= MOST_WORDS_OF_A_FIRST_PAGE
    assert sum(lengths.values()) - lengths["README.md"] < MOST_WORDS, lengths
    changes = text_of("CHANGELOG.md").splitlines()
    assert len(changes) <= 150
    assert not [line for line in changes if line.startswith(" ")]  # a line for each change


@pytest.mark.parametrize("text", ["A point held\nagainst zero.", "Done. Asked are\ntwo.", "if it is none"])
def test_banned_phrases_are_seen_across_lines(text):
    assert len(banned("page", 7, text)) == 1
