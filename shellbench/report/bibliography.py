"""The bibliography: sources by key, read from BibTeX."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

ENTRY = re.compile(r"@(\w+)\s*\{\s*([^,\s{}]+)\s*,", re.ASCII)
FIELD = re.compile(r"(\w+)\s*=\s*", re.ASCII)
ACCENTS = {'"': "\u0308", "'": "\u0301", "`": "\u0300", "^": "\u0302", "~": "\u0303", "c": "\u0327"}


@dataclass(frozen=True)
class Source:
    """One entry, its fields in plain words."""

    key: str
    kind: str
    fields: Mapping[str, str]

    @property
    def words(self) -> str:
        """The entry as one line: authors, title, where it appeared, year."""
        field = self.fields
        authors = ", ".join(name for name in re.split(r"\s+and\s+", field.get("author", "")) if name)
        where = field.get("journal") or field.get("booktitle") or field.get("publisher") or field.get("institution")
        numbers = " ".join(
            part for part in (field.get("volume"), f"({field['number']})" if "number" in field else None) if part
        )
        place = ", ".join(
            part for part in (where, numbers, field.get("pages"), field.get("note"), field.get("howpublished")) if part
        )
        year = f" ({field['year']})" if "year" in field else ""
        return ". ".join(part for part in (f"{authors}{year}".strip(), field.get("title"), place) if part) + "."

    @property
    def link(self) -> str | None:
        """Address of the source, from its DOI or URL; only http and https."""
        if doi := self.fields.get("doi"):
            return f"https://doi.org/{doi}"
        url = self.fields.get("url", "")
        return url if url.startswith(("http://", "https://")) else None


def read_bibliography(path: Path) -> dict[str, Source]:
    """Return the entries of a BibTeX file by key; none if there is no such file."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError:
        return {}
    return {source.key: source for source in _entries(text)}


def _entries(text: str) -> Iterator[Source]:
    for found in ENTRY.finditer(text):
        body = text[found.end() : _closing(text, found.end(), depth=1)]
        fields: dict[str, str] = {}
        position = 0
        while name := FIELD.search(body, position):
            value, position = _value(body, name.end())
            fields[name[1].lower()] = _plain(value)
        yield Source(found[2], found[1].lower(), fields)


def _value(body: str, start: int) -> tuple[str, int]:
    """Return a field's value, in braces, in quotes or bare, and where it ends."""
    if start < len(body) and body[start] == "{":
        end = _closing(body, start + 1, depth=1)
        return body[start + 1 : end], end + 1
    if start < len(body) and body[start] == '"':
        end = body.find('"', start + 1)
        end = len(body) if end < 0 else end
        return body[start + 1 : end], end + 1
    end = min((i for i in (body.find(",", start), body.find("\n", start)) if i >= 0), default=len(body))
    return body[start:end], end


def _closing(text: str, start: int, depth: int) -> int:
    """Return where the brace that is open at `start` closes; the end of the text if it never does."""
    for i in range(start, len(text)):
        depth += (text[i] == "{") - (text[i] == "}")
        if depth == 0:
            return i
    return len(text)


def _plain(value: str) -> str:
    """Return LaTeX as plain words: accents composed, braces and dashes resolved."""
    accented = re.sub(r"\\([\"'`^~c])\s*\{?\s*\\?(\w)\}?", lambda m: m[2] + ACCENTS[m[1]], value)
    words = accented.replace("---", "—").replace("--", "–").replace("\\&", "&").replace("~", " ")
    return " ".join(re.sub(r"[{}\\]", "", words).split())
