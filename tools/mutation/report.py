"""Scores of draws of mutants, and the survivors that a person has yet to judge."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from scipy.stats import beta

from tools.mutation.targets import MECHANICS, ROOT

SCORE = ROOT / "references" / "exam_score.json"

Entry = Mapping[str, Any]


class Score(NamedTuple):
    """Numbers of mutants: drawn, red, equivalent to the code by a person's verdict, and holes of the exam."""

    drawn: int
    red: int
    equivalent: int = 0
    holes: int = 0


def score(results: Sequence[Entry], kinds: Collection[str] = ()) -> Score:
    """Count mutants of some kinds, or all; a survivor is a hole until a person finds it equivalent."""
    counted = [entry for entry in results if not kinds or entry["kind"] in kinds]
    red = sum(bool(entry["red"]) for entry in counted)
    return Score(len(counted), red, 0, len(counted) - red)


def interval(red: int, judged: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the bounds of the share of red mutants among all, from a draw (Clopper and Pearson 1934)."""
    tail = (1 - confidence) / 2
    low = float(beta.ppf(tail, red, judged - red + 1)) if red else 0.0
    high = float(beta.ppf(1 - tail, red + 1, judged - red)) if red < judged else 1.0
    return low, high


def words(run: Entry) -> str:
    """Return the score of a draw in words, and a line for each survivor: its place and its change."""
    whole, mechanics = (score(run["results"], kinds) for kinds in ((), (MECHANICS,)))
    low, high = interval(mechanics.red, mechanics.drawn) if mechanics.drawn else (0.0, 1.0)
    head = (
        f"{run['target']}, seed {run['seed']}: {whole.red} of {whole.drawn} red; of mechanics {mechanics.red} of"
        f" {mechanics.drawn}, {100 * low:.0f} to {100 * high:.0f} % of all mutants with 95 % confidence"
    )
    green = sorted((e for e in run["results"] if not e["red"]), key=lambda e: (e["module"], e["line"]))
    lines = [f"  {e['module']}:{e['line']}, {e['rule']}, {e['kind']}: {e['old']} -> {e['new']}" for e in green]
    return "\n".join([head, *lines])


def add(run: Entry, path: Path = SCORE) -> None:
    """Put the score of an unseen draw into the file that the report reads, a line a draw.

    An existing draw stays, because its score can be unseen only once. A survivor that proves to be equivalent is moved
    from `holes` to `equivalent` there, with the reason in the commit.
    """
    draws = json.loads(path.read_text(encoding="utf-8"))["draws"] if path.is_file() else []
    name = {"target": run["target"], "seed": run["seed"]}
    if any(draw | name == draw for draw in draws):
        return
    mechanics = score(run["results"], (MECHANICS,))._asdict()
    draws.append({**name, "unseen": True, **score(run["results"])._asdict(), "mechanics": mechanics})
    lines = ",\n".join(json.dumps(draw) for draw in draws)
    path.write_text(f'{{"schema_version": 2, "draws": [\n{lines}\n]}}\n', encoding="utf-8")
