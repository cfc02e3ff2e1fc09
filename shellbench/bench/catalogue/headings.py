"""Kind and suites of each case, kept between processes: reading all files of cases takes half a second."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from pathlib import Path

from shellbench.bench.plugins.kinds import kind_name
from shellbench.disk import is_settled, look_up, read_cache, write_cache
from shellbench.errors import InputError
from shellbench.protocol.schema import read_toml

KEPT = "cases.json"
Heading = tuple[str, tuple[str, ...]]
"""The kind of problem that a case's file names, and its suites."""


def read_heading(path: Path) -> Heading:
    """Read kind and suites; the rest of the file is not checked."""
    data = read_toml(path)
    return kind_name(data), tuple(map(str, data.get("suites", ())))


def headings(files: Iterable[Path]) -> dict[Path, Heading]:
    """Return the headings of the files that can be read, from the user's cache where files look as they did."""
    kept = read_cache(KEPT)
    known = kept if isinstance(kept, dict) else {}
    found: dict[Path, Heading] = {}
    news = False
    for path in files:
        look = look_up(path)
        match known.get(str(path)):
            case [list(seen), str(kind), list(suites)] if tuple(seen) == look:
                found[path] = kind, tuple(map(str, suites))
                continue
        with contextlib.suppress(InputError):
            found[path] = read_heading(path)
            if look is not None and is_settled(look):
                known[str(path)] = [look, *found[path]]
                news = True
    if news:
        write_cache(KEPT, {path: value for path, value in known.items() if Path(path).exists()})
    return found
