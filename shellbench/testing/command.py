"""What `shellbench check-solver` prints, and what it ends with."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.status import Status as Spinner
from rich.text import Text

from shellbench.bench.catalog import find_case
from shellbench.bench.identity import parse_setting
from shellbench.bench.registry import find_solver
from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.testing.examination import Status
from shellbench.testing.suite import CheckOptions, Line, examine

COLOURS: dict[Status, str] = {"passed": "green", "failed": "red", "not applicable": "dim", "not shown": "yellow"}
LONGEST_STATUS = 14  # characters
GOOD, BAD = 0, 1


def _shell(text: str) -> Case:
    case = find_case(text)
    if not isinstance(case, Case):
        raise InputError(f"case '{case.name}' is of kind '{case.kind}', and the checks are made with shells")
    return case


def check_solver(
    name: str,
    cases: Sequence[str] = (),
    settings: Sequence[str] = (),
    refine: str | None = None,
    seconds: float = 600.0,
    as_json: bool = False,
    console: Console | None = None,
) -> int:
    """Examine a solver, print what was found, and return the exit code: 0 if no check failed, else 1.

    Raises
    ------
    InputError
        If the solver, a case or a setting is unknown, or an extra is missing.
    """
    entry = find_solver(name)
    options = CheckOptions(
        tuple(map(_shell, cases)), given_settings(name, settings), given_refinements(refine), seconds
    )
    out = console or Console(highlight=False, soft_wrap=True)
    lines: list[Line] = []
    if as_json:
        lines = list(examine(entry, options))
        out.out(json.dumps({"solver": name, "checks": [as_data(line) for line in lines]}, indent=2), highlight=False)
    elif out.is_terminal:
        with out.status(name) as spinner:
            lines = [_shown(out, line) for line in examine(entry, options, lambda word: _turn(spinner, name, word))]
    else:
        lines = [_shown(out, line) for line in examine(entry, options)]
    if not as_json:
        out.out(summary(name, lines))
    return BAD if any(line.verdict.status == "failed" for line in lines) else GOOD


def _turn(spinner: Spinner, name: str, word: str) -> None:
    spinner.update(f"{name}: {word}")


def _shown(out: Console, line: Line) -> Line:
    verdict = line.verdict
    where = f" ({line.case})" if line.case else ""
    text = Text.assemble(
        (f"{verdict.status:<{LONGEST_STATUS}} ", COLOURS[verdict.status]),
        f"{line.check}{where}: {verdict.words}",
    )
    out.print(text, soft_wrap=True)
    return line


def summary(name: str, lines: Sequence[Line]) -> str:
    """Return one line with the number of checks by outcome."""
    found = [line.verdict.status for line in lines]
    return f"{name}: " + ", ".join(f"{found.count(status)} {status}" for status in COLOURS if status in found)


def as_data(line: Line) -> dict[str, Any]:
    """Return a line as JSON data."""
    return {"check": line.check, "case": line.case, "status": line.verdict.status, "words": line.verdict.words}


def given_settings(name: str, texts: Sequence[str]) -> dict[str, Any]:
    """Read ``SOLVER.KEY=VALUE`` of the one solver that is examined."""
    given = {}
    for text in texts:
        solver, key, value = parse_setting(text)
        if solver != name:
            raise InputError(f"--set {text}: the solver that is checked is '{name}'")
        given[key] = value
    return given


def given_refinements(text: str | None) -> tuple[dict[str, Any], ...]:
    """Read ``KEY=VALUE;VALUE;VALUE``, from coarse to fine, each value in TOML."""
    if text is None:
        return ()
    key, equals, values = text.partition("=")
    parts = [part for part in values.split(";") if part.strip()]
    if not equals or not key.strip() or len(parts) < 3:
        raise InputError(f"--refine: found {text!r}, but expected KEY=VALUE;VALUE;VALUE, from coarse to fine")
    return tuple({key.strip(): parse_setting(f"x.y={part.strip()}")[2]} for part in parts)
