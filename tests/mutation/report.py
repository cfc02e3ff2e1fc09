"""What came of the mutants: the score by target, module and rule, the survivors with a person's verdict, and a page.

python -m tests.mutation.report        write docs/mutation.md and references/exam_score.json from reports/mutation.json again
"""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from tests.mutation.draw import all_mutants
from tests.mutation.exam import CONFIDENT, CRASH, DECLINED, FAILED, TIME, VALUE
from tests.mutation.targets import KINDS, LEFT_OUT, MECHANICS, ROOT, STATEMENT, TARGETS

RESULT = ROOT / "reports" / "mutation.json"
SCORE = ROOT / "references" / "exam_score.json"
EXCUSED = Path(__file__).with_name("excused.toml")
PAGE = ROOT / "docs" / "mutation.md"
VERDICTS = ("equivalent", "hole", "gone")
WHY_RED = (VALUE, CONFIDENT, FAILED, DECLINED, CRASH, TIME)
KEPT_OF_RED = 60  # characters of the red row that are kept
LAST_BEFORE_KINDS = 6  # seed
SHOWN = 150  # characters of a change on the page

Entry = Mapping[str, Any]
Key = tuple[str, str, str, str]


class Excuse(NamedTuple):
    """What a person says of a survivor."""

    verdict: str
    reason: str


class Score(NamedTuple):
    """How many of some mutants are red, and what the others are."""

    drawn: int
    red: int
    equivalent: int
    holes: int
    gone: int = 0

    @property
    def share(self) -> float | None:
        """The red ones among those that are neither equivalent nor gone; None if there are none of these."""
        judged = self.drawn - self.equivalent - self.gone
        return self.red / judged if judged else None


def excuses(path: Path = EXCUSED) -> dict[Key, Excuse]:
    """Return the verdicts of people on survivors.

    Raises
    ------
    ValueError
        If one is neither of `VERDICTS`, gives no reason, or stands there twice.
    """
    found: dict[Key, Excuse] = {}
    for number, entry in enumerate(tomllib.loads(path.read_text(encoding="utf-8")).get("survivors", ())):
        key = (entry["module"], entry["rule"], entry["statement"], entry["becomes"])
        if entry["verdict"] not in VERDICTS or not entry["reason"].strip():
            raise ValueError(
                f"{path.name}: survivor {number}: found {entry['verdict']!r}, allowed with a reason: {VERDICTS}"
            )
        if key in found:
            raise ValueError(f"{path.name}: survivor {number} stands there twice: {key}")
        found[key] = Excuse(entry["verdict"], " ".join(entry["reason"].split()))
    return found


def key_of(entry: Entry) -> Key:
    """Return what an excuse of a survivor is keyed by."""
    return entry["module"], entry["rule"], entry["statement"], entry["becomes"]


def kept(run: Entry) -> dict[str, Any]:
    """Return a run as it is committed: the statements of survivors only."""
    results = []
    for entry in run["results"]:
        short = {
            name: value for name, value in entry.items() if name not in {"statement", "becomes", "seconds", "cases"}
        }
        if entry["red"]:
            results.append(short | {"red": entry["red"][:KEPT_OF_RED]})
        else:
            results.append(short | {"statement": entry["statement"], "becomes": entry["becomes"]})
    return {**run, "results": results}


def add(runs: Iterable[Entry], path: Path = RESULT) -> list[Entry]:
    """Put runs into the committed file, in place of those of the same target and seed; return all."""
    by_name = {(run["target"], run["seed"]): run for run in [*read_runs(path), *map(kept, runs)]}
    every = [by_name[name] for name in sorted(by_name)]
    lines = ",\n".join(_compact(run) for run in every)
    path.write_text(f'{{"schema_version": 1, "runs": [\n{lines}\n]}}\n', encoding="utf-8")
    return every


def read_runs(path: Path = RESULT) -> list[Entry]:
    """Return the runs of the committed file, none if it is not there."""
    return json.loads(path.read_text(encoding="utf-8"))["runs"] if path.is_file() else []


def _compact(run: Entry) -> str:
    """Return a run as JSON with one line a mutant."""
    head = json.dumps({name: value for name, value in run.items() if name != "results"})[:-1]
    return head + ', "results": [\n' + ",\n".join(map(json.dumps, run["results"])) + "\n]}"


def score(results: Sequence[Entry], said: Mapping[Key, Excuse]) -> Score:
    """Count the red ones, and the survivors by their verdicts."""
    green = Counter(verdict(entry, said) for entry in results if not entry["red"])
    return Score(len(results), len(results) - green.total(), *(green[each] for each in VERDICTS))


def verdict(entry: Entry, said: Mapping[Key, Excuse]) -> str:
    """Return what a survivor is: a hole unless a person says otherwise."""
    return said[key_of(entry)].verdict if key_of(entry) in said else "hole"


def unseen(run: Entry, said: Mapping[Key, Excuse]) -> Score:
    """Count as the draw stood before anybody had looked at it: mutants that are `closed` were green, and none was gone."""
    now = score(run["results"], said)
    closed = sum(entry.get("closed", False) for entry in run["results"])
    return now._replace(red=now.red - closed, holes=now.holes + closed + now.gone, gone=0)


def summary(runs: Sequence[Entry], said: Mapping[Key, Excuse]) -> Iterator[tuple[str, Score]]:
    """Yield the score of each run: target and seed."""
    for run in runs:
        yield f"{run['target']}, seed {run['seed']}", score(run["results"], said)


def scores(runs: Sequence[Entry], said: Mapping[Key, Excuse]) -> str:
    """Return the score of each run as JSON, a line each, before anything was closed: the report's page says it."""
    lines = []
    for run in runs:
        figures = unseen(run, said)._asdict()
        del figures["gone"]  # holes of an unseen score
        lines.append(json.dumps({"target": run["target"], "seed": run["seed"], **figures}))
    return '{"schema_version": 1, "draws": [\n' + ",\n".join(lines) + "\n]}\n"


def page(runs: Sequence[Entry], said: Mapping[Key, Excuse]) -> str:
    """Return the page."""
    every = [entry for run in runs for entry in run["results"]]
    green = {entry["name"]: entry for entry in every if not entry["red"]}.values()
    return "\n".join(
        [
            PREFACE,
            "## The score\n",
            *_table("draw", summary(runs, said)),
            *_unseen(runs, said),
            "\n## Mechanics and statements\n",
            BY_KIND,
            *_by_kind(runs, said),
            "",
            *_kinds(),
            "\nScores are shares of the mutants that are neither equivalent nor gone.",
            "\nA score is the share of red mutants among those that are neither equivalent nor gone. A survivor without a verdict counts as a hole."
            " Below is said [what each draw was asked](#what-each-draw-was-asked).\n",
            "## Why mutants are red\n",
            *_why_red(runs),
            "\n## By module\n",
            *_table("module", _grouped(every, said, lambda entry: entry["module"].removeprefix("shellbench."))),
            "\n## By rule\n",
            *_table("rule", _grouped(every, said, lambda entry: entry["rule"])),
            "\n## Holes\n",
            "No case that they were asked tells these mutants from the code as it is, and they are not equivalent. A longer exam may.\n",
            *_survivors([e for e in green if verdict(e, said) == "hole"], said),
            "\n## Equivalent mutants\n",
            "These answer as the code does, for the reason given.\n",
            *_survivors([e for e in green if verdict(e, said) == "equivalent"], said),
            "\n## Gone\n",
            "What these statements compute was deleted. Unseen scores count them as holes, others not at all."
            " A statement that moved, was written in other words, or is run by no case any more stays a hole.\n",
            *_survivors([e for e in green if verdict(e, said) == "gone"], said),
            "\n## Not reached by the exam\n",
            "No case that is asked runs these statements: no mutants of them are drawn, and the score says nothing of them.\n",
            *_not_reached(runs),
            "\n## What each draw was asked",
            *_limits(runs),
            "",
        ]
    )


def of_kinds(run: Entry, kinds: Collection[str]) -> dict[str, Any]:
    """Return a run with those of its mutants alone that stand in functions of some kinds."""
    return {**run, "results": [entry for entry in run["results"] if entry["kind"] in kinds]}


def _by_kind(runs: Sequence[Entry], said: Mapping[Key, Excuse]) -> Iterator[str]:
    """Yield the scores of draws by what mutants change, unseen where that is known."""
    for known, what in ((False, "Seen"), (True, "Unseen")):
        chosen = [run for run in runs if bool(run.get("unseen")) is known]
        if not chosen:
            continue
        yield f"\n**{what}**:\n"
        yield "| draw | all statements | mechanics | statements of uncertainty | left out by the rules |"
        yield "|---|--:|--:|--:|--:|"
        count = unseen if known else lambda run, said: score(run["results"], said)
        columns = (None, (MECHANICS,), (STATEMENT,), LEFT_OUT)
        rows = [[count(run if kinds is None else of_kinds(run, kinds), said) for kinds in columns] for run in chosen]
        names = [f"{run['target']}, seed {run['seed']}" for run in chosen]
        groups = {f"seed{'s' if len(part) > 1 else ''} {', '.join(map(str, part))}": part for part in _parts(chosen)}
        for name, row in zip(names, rows, strict=True):
            yield f"| {name} | {' | '.join(map(_share, row))} |"
        for name, seeds in groups.items():
            own = [row for run, row in zip(chosen, rows, strict=True) if run["seed"] in seeds]
            yield f"| all of {name} | {' | '.join(_share(_sum(column)) for column in zip(*own, strict=True))} |"


def _parts(runs: Sequence[Entry]) -> list[list[int]]:
    """Return the seeds of runs: those drawn before the rules were applied by function, and those after."""
    seeds = sorted({run["seed"] for run in runs})
    parts = [[s for s in seeds if s <= LAST_BEFORE_KINDS], [s for s in seeds if s > LAST_BEFORE_KINDS]]
    return [part for part in parts if part]


def _sum(scores: Iterable[Score]) -> Score:
    return Score(*map(sum, zip(*scores, strict=True)))


def _share(s: Score) -> str:
    """Say a score and of how many mutants it is."""
    return "" if s.share is None else f"{100 * s.share:.0f} % of {s.drawn - s.equivalent - s.gone}"


def _kinds() -> Iterator[str]:
    """Yield what each kind of function is, and why."""
    yield "| module | functions | what they are | why |"
    yield "|---|---|---|---|"
    for modules, functions, kind, why in KINDS:
        named = ", ".join(f"`{name}`" for name in modules.split("|"))
        yield f"| {named} | {'all' if functions == '.*' else _code(functions)} | {kind} | {why} |"


def _code(pattern: str) -> str:
    return f"`{pattern}`".replace("|", "\\|")


def _table(what: str, scores: Iterable[tuple[str, Score]]) -> Iterator[str]:
    yield f"| {what} | mutants | red | equivalent | holes | gone | score |"
    yield "|---|--:|--:|--:|--:|--:|--:|"
    for name, s in scores:
        share = "" if s.share is None else f"{100 * s.share:.0f} %"
        yield f"| {name} | {s.drawn} | {s.red} | {s.equivalent} | {s.holes} | {s.gone} | {share} |"


def _unseen(runs: Sequence[Entry], said: Mapping[Key, Excuse]) -> Iterator[str]:
    """Yield the scores that draws had before anybody had looked at them, where these are known."""
    first = [(f"{run['target']}, seed {run['seed']}", unseen(run, said)) for run in runs if run.get("unseen")]
    if first:
        yield "\n**Unseen**, before anybody had looked at these draws:\n"
        yield from _table("draw", [*first, ("all of them", _sum(s for _, s in first))])


def _limits(runs: Sequence[Entry]) -> Iterator[str]:
    """Yield what an exam was made of, where it was not all that there is."""
    yield ""
    for run in runs:
        ends = (
            ""
            if run["patience"] is None
            else f", of which a mutant is asked at least as many as take {run['patience']:g} s"
        )
        names = sorted({case.partition(" ")[2] for case in run["cases"]})
        asked = ", ".join(f"`{name}`" for name in names if "@" not in name)
        variants = sum("@" in name for name in names)
        yield f"- {run['target']}, seed {run['seed']}: {len(run['cases'])} cases{ends}: {asked}, and {variants} variants."
        if earlier := sum(entry.get("earlier", False) for entry in run["results"]):
            yield f"  {earlier} of the red ones were red in an earlier exam, and were not asked again."
        if again := run.get("again"):
            yield (
                "  Some of what they left green was put named cases of today's exam alone (`--case`):"
                f" {', '.join(f'`{name}`' for name in again)}."
            )


def _grouped(entries: Sequence[Entry], said: Mapping[Key, Excuse], by: Any) -> Iterator[tuple[str, Score]]:
    groups: dict[str, list[Entry]] = {}
    for entry in entries:
        groups.setdefault(by(entry), []).append(entry)
    for name in sorted(groups):
        yield name, score(groups[name], said)


def _why_red(runs: Sequence[Entry]) -> Iterator[str]:
    yield f"| draw | {' | '.join(WHY_RED)} | by the first case |"
    yield "|---" + "|--:" * (len(WHY_RED) + 1) + "|"
    for run in runs:
        red = [entry for entry in run["results"] if entry["red"]]
        count = Counter(next((why for why in WHY_RED if entry["red"].startswith(why)), CRASH) for entry in red)
        figures = " | ".join(str(count[why]) for why in WHY_RED)
        yield f"| {run['target']}, seed {run['seed']} | {figures} | {sum(e['asked'] == 1 for e in red)} |"


def _survivors(entries: Sequence[Entry], said: Mapping[Key, Excuse]) -> Iterator[str]:
    if not entries:
        yield "None."
    for entry in sorted(entries, key=lambda e: (e["module"], e["line"])):
        place = f"`{entry['module'].removeprefix('shellbench.').replace('.', '/')}.py:{entry['line']}`"
        reason = said[key_of(entry)].reason if key_of(entry) in said else "no verdict yet"
        asked = (
            f"green in {entry['asked']} case{'s' if entry['asked'] > 1 else ''}"
            if entry["asked"]
            else "not asked again"
        )
        yield f"- {place}, {entry['rule']}, {asked}: {reason}\n"
        yield "    ```diff"
        yield f"    - {_short(entry['old'])}"
        yield f"    + {_short(entry['new'])}"
        yield "    ```"


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= SHOWN else line[: SHOWN - 1] + "…"


def _not_reached(runs: Sequence[Entry]) -> Iterator[str]:
    yield "| target | mutants by all rules | reached | lines that no case runs |"
    yield "|---|--:|--:|---|"
    for target, run in {run["target"]: run for run in runs}.items():
        lines = "; ".join(
            f"{module.rpartition('.')[2]} {', '.join(ranges)}" for module, ranges in sorted(run["not_reached"].items())
        )
        yield f"| {target} | {run['mutants']} | {run['reached']} | {lines} |"


def stale_excuses(said: Mapping[Key, Excuse], runs: Sequence[Entry] = ()) -> list[Key]:
    """Return the excuses of which the code makes no such mutant any more, and which no kept draw needs."""
    needed = {key_of(entry) for run in runs for entry in run["results"] if not entry["red"]}
    left = [key for key in said if key not in needed]
    modules = {module for target in TARGETS.values() for module in target.modules()} & {key[0] for key in left}
    made = {mutant.key for mutant in all_mutants(modules)}
    return [key for key in left if key not in made]


def still_made(said: Mapping[Key, Excuse]) -> set[Key]:
    """Return the mutants that are said to be gone, and that the code still makes."""
    gone = {key for key, excuse in said.items() if excuse.verdict == "gone"}
    return gone & {mutant.key for mutant in all_mutants({key[0] for key in gone})}


PREFACE = """# The exam examined

<!-- Written by tests/mutation/report.py from reports/mutation.json and tests/mutation/excused.toml. Change those, and run it. -->

Does the exam find mistakes? Mutants of our own solvers and of the question, made by rule, go through the gate that a stranger faces.
A mutant whose runs are all green is equivalent to the code, or it shows a hole in the exam.

```bash
python -m nox -s mutation -- --seed 1 --count 300
python -m nox -s mutation -- --seed 2 --count 100 --solver fem
```

**Rules** change one expression: flip a sign; double or halve a number or a term; exchange times and divided by; exchange two indices,
or leave a transpose away; leave a term out; exchange two arguments; miss by one; exchange min and max, or less and at most.

**Targets** are `fem`, the part of `ndf` that `ndf-ritz` uses, and the question, which both solvers share. Left out by rule are settings,
files, checks, messages, progress, training, the choice of meshes, steps and trial functions, and solving equations;
`tests/mutation/targets.py` says it in full. Nothing gates `cst-hinge`: no exam examines it.

**Exam.** A mutant is put the cases that run its statement, cheap ones first, until a row of the accuracy gate is red. A crash, a
refusal, and about ten times the usual time are red too. The lock is not asked: it notices a change of the question, whatever is answered.
Cases are those of the suites `obstacle_course`, `verification`, `variants`, `shapes`, `nonlinear` and `cloth` that take less than the
seconds given by `--longest`, or of these the ones that `--case` names. From seed 5 on the exam is more of what the gate of our solvers
is: figures whose error is more than five times what is stated of it are red ([calibration](verdict.md#gates)), and cases of the suites
`modes`, `buckling`, `resultants` and `contact` are asked too. A stranger faces these suites by `gate --suite`, and calibration is shown to
it. `check-solver` grades by the first five suites alone.

**The draw** is by a seed, spread over modules and rules. Holes are closed on seeds that have been seen: all that stand below. What the exam
found of a draw before that is its unseen score, which stays. Seed 3 was cut by the time there was, after the same first mutants of each target
that a longer draw begins with: 10, and 30 more by a later exam, before a hole of any of these was closed. Seed 4 was put
to few and short cases, without variants: its score is that of a smaller exam
(`fem` 24 cases where seed 3 had 52, `ndf-ritz` 8 for 27, the question 16 for 59). Its draw was continued with the same cases on later code, after
11 mutants of `fem`, of which that code draws 10 again, and 8 of the question. Seed 5 was
asked on a busy machine as far as it went: ten mutants of `fem` and of `ndf-ritz`, and twelve of the question, so that a mutant is eight to ten
points of a score. Seed 6 was put to short cases on a machine that was busier still, as far as it went: ten mutants of `ndf-ritz`, and six of
`fem`, put to the cases of seed 5 and `contact_bar`. Seed 7 was drawn after the rules had been [applied by function](#mechanics-and-statements), and
put to 24 cases by `fem` and 16 by `ndf-ritz` on a busy machine, as far as it went. Survivors were asked all of these that run their statement,
up to 240 s, where earlier draws had 40 s. Four were then put dear cases of the same exam, chosen by a person who had read them: `sprung_motion` and
`contact_plate` told of one each, `narrow_peak`, `held_corner` and `twisted_parallelogram` of none. Without these the score is two mutants less.
Two statements of `quantities` stand in `displacement_quantities` by now, and their mutants were
asked there. A statement was deleted because nothing could tell of it: its mutant is [gone](#gone). Reasons why
a mutant is equivalent were read twice, the second time to break them: that made holes of some, in the first three seeds, and of none in the fourth.

**Tangents.** A mutant of a tangent would be equivalent if nothing but the way to the same zero of the residual depended on it. No
survivor of this kind is: `fem` tells limit points and branches by the tangent's inertia and its solutions, and ends an iteration by the work of
a step; `ndf-ritz` makes uncertainties and the stability of a state of it. They stay holes.
"""


BY_KIND = """The rules name modules: seeds 1 to 6 were drawn of all statements of those that are left. But many of these modules hold functions that
the same words leave out: `fem.mesh` chooses lines beside its basis functions, `ndf.signs` refuses. So `tests/mutation/targets.py` applies the
rules function by function, by what a function is. **That was written when seeds 1 to 6 had been read, holes and all, and before seed 7 was
drawn**: of seeds 1 to 6 the column of mechanics is hindsight, of seed 7 it is a forecast. Draws are of all statements as before, and all scores
stand side by side. Statements of how sure an answer is are part of the answer, but no mechanics: they have a column of their own.
"""


def write(runs: Sequence[Entry], said: Mapping[Key, Excuse]) -> None:
    """Write the page, and the score that the report's page says."""
    PAGE.write_text(page(runs, said), encoding="utf-8")
    SCORE.write_text(scores(runs, said), encoding="utf-8")


if __name__ == "__main__":
    write(read_runs(), excuses())
