"""The parts that page and paper share: cited sources, the making of each run, and the files of a report."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Environment, Record

BIBLIOGRAPHY = "bibliography.bib"
EXAM_SCORE = "exam_score.json"
MANIFEST = ".shellbench-report"
ENTRY = re.compile(r"@(\w+)\s*\{\s*([^,\s{}]+)\s*,", re.ASCII)
FIELD = re.compile(r"(\w+)\s*=\s*", re.ASCII)
ACCENTS = {'"': "\u0308", "'": "\u0301", "`": "\u0300", "^": "\u0302", "~": "\u0303", "c": "\u0327"}


def templates(**syntax: Any) -> jinja2.Environment:
    """Return the templates of the report, which know no name that they were not given; `syntax` is jinja2's."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("shellbench.report"),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        **syntax,
    )


def remove_older(out: Path) -> None:
    """Remove the files that an earlier report listed as its own; OSError if one can't be."""
    manifest = out / MANIFEST
    if not manifest.is_file():
        return
    root = out.resolve()
    for name in manifest.read_text(encoding="utf-8").splitlines():
        path = out / name
        if name and path.resolve().is_relative_to(root):
            path.unlink(missing_ok=True)
    manifest.unlink()


def list_own(out: Path, written: Iterable[Path]) -> None:
    """List the files that a report wrote, relative to its folder, so that the next one can remove them."""
    names = sorted({path.relative_to(out).as_posix() for path in written if path.is_file()})
    write(out / MANIFEST, "".join(f"{name}\n" for name in names))


def write(path: Path, text: str) -> None:
    """Write a file of text, alike on every system."""
    path.write_text(text, encoding="utf-8", newline="\n")


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
        body = text[found.end() : _closing_brace(text, found.end(), depth=1)]
        fields: dict[str, str] = {}
        position = 0
        while name := FIELD.search(body, position):
            value, position = _value(body, name.end())
            fields[name[1].lower()] = _plain(value)
        yield Source(found[2], found[1].lower(), fields)


def _value(body: str, start: int) -> tuple[str, int]:
    """Return a field's value, in braces, in quotes or bare, and where it ends."""
    if start < len(body) and body[start] == "{":
        end = _closing_brace(body, start + 1, depth=1)
        return body[start + 1 : end], end + 1
    if start < len(body) and body[start] == '"':
        end = body.find('"', start + 1)
        end = len(body) if end < 0 else end
        return body[start + 1 : end], end + 1
    end = min((i for i in (body.find(",", start), body.find("\n", start)) if i >= 0), default=len(body))
    return body[start:end], end


def _closing_brace(text: str, start: int, depth: int) -> int:
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


@dataclass(frozen=True)
class Making:
    """The making of one run: its record, command and environment.

    Attributes
    ----------
    environment
        Number of its environment in the report, from 1.
    """

    record: Record
    command: str
    environment: int


def command(record: Record, overrides: Mapping[str, Any]) -> str:
    """Return the command that makes the run again, for a shell."""
    identity = record.identity
    words = ["shellbench", "run", f"{record.case_name}.toml" if record.own_case else record.case_name]
    words += ["--solver", identity.solver]
    if identity.seed is not None:
        words += ["--seed", str(identity.seed)]
    for key, value in _flatten(overrides):
        words += ["--set", f"{identity.solver}.{key}={value if isinstance(value, str) else json.dumps(value)}"]
    if identity.device != "cpu":
        words += ["--device", identity.device]
    return shlex.join(words)


def _flatten(settings: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    flat: list[tuple[str, Any]] = []
    for key, value in settings.items():
        flat += _flatten(value, f"{prefix}{key}.") if isinstance(value, Mapping) else [(f"{prefix}{key}", value)]
    return flat


def makings(records: Mapping[str, Record], rows: Sequence[Row]) -> tuple[list[Making], list[str]]:
    """Return the making of each run of the rows, and a description of each environment with its exams."""
    environments: list[Environment] = []
    exams: dict[int, set[int]] = {}
    found: dict[str, Making] = {}
    for row in rows:
        record = records.get(row.run_id or "")
        if record is None or record.run_id in found:
            continue
        if record.environment not in environments:
            environments.append(record.environment)
        number = environments.index(record.environment) + 1
        exams.setdefault(number, set()).update(set() if record.exam is None else {record.exam})
        found[record.run_id] = Making(record=record, command=command(record, row.overrides), environment=number)
    return list(found.values()), [environment_words(one, exams[i]) for i, one in enumerate(environments, start=1)]


def exam_words() -> str:
    """Say how many mistakes made by rule the exam found; nothing if no score is kept.

    `references/exam_score.json` keeps it, by draw; see docs/verdict.md.
    """
    try:
        draws = json.loads((catalog.data_folder("references") / EXAM_SCORE).read_text(encoding="utf-8"))["draws"]
    except OSError:
        return ""
    unseen = [draw for draw in draws if draw["unseen"]]
    if not unseen:
        return ""
    newest = max(draw["seed"] for draw in unseen)
    mechanics = [draw["mechanics"] for draw in unseen]
    last = [draw["mechanics"] for draw in unseen if draw["seed"] == newest]
    return (
        "The exam itself was examined: of mistakes made by rule that change an answer, in draws that nobody had seen,"
        f" it finds {_found(mechanics)} in mechanics, of the newest draw {_found(last)} (seed {newest}),"
        f" and {_found(unseen)} in all statements."
    )


def _found(counts: Sequence[Mapping[str, int]]) -> str:
    """Say how many mutants are red, of those that are not equivalent."""
    return f"{sum(c['red'] for c in counts)} of {sum(c['drawn'] - c['equivalent'] for c in counts)}"


def environment_words(environment: Environment, exams: Collection[int]) -> str:
    """Say in one line where runs were made, and by which versions of the exam."""
    versions = ", ".join(f"{name} {version}" for name, version in sorted(environment.versions.items()))
    commit = f"commit {environment.git_sha[:12]}" if environment.git_sha else "commit unknown"
    state = " with uncommitted changes" if environment.git_dirty else ""
    parts = (
        environment.processor,
        f"{environment.cores} cores, {environment.threads} thread{'s' if environment.threads != 1 else ''} a solve",
        environment.gpu,
        environment.platform,
        f"Python {environment.python}",
        versions,
        commit + state,
        f"exam {', '.join(map(str, sorted(exams)))}" if exams else None,
    )
    return "; ".join(part for part in parts if part)
