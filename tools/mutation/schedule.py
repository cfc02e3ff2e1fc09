"""Schedule of mutants: each mutant runs in its own process, on the cheapest cases first, and its result is stored at once.

1. The unchanged code solves every case, one process a case, which gives its lines and its time. Cases that take too
   long are not part of this exam. These results are stored until the code changes.
2. A seed draws from the mutants whose statement runs in some case and is of a requested kind.
3. A mutant is solved on the cases that run its statement until one is red. Cheap cases come first, and variants of the
   same case come last. `patience` may end this early.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import multiprocessing
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from itertools import accumulate
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import psutil

from tools.mutation.draw import Mutant, all_mutants, draw
from tools.mutation.exam import CRASH, TIME, Answered, Question, examine
from tools.mutation.targets import ROOT, TARGETS, Target, file_of

SUITES = ("obstacle_course", "verification", "variants", "shapes", "nonlinear", "cloth")
SUITES += ("modes", "buckling", "resultants", "contact")
LIBRARIES = ("numpy", "scipy.sparse.linalg", "scipy.interpolate", "scipy.optimize", "scipy.special", "skfem", "torch")
LIBRARIES += ("pydantic", "safetensors.numpy", "psutil", "threadpoolctl")
LONGER = 5.0  # times as long as the code as it is while its lines are noted, which takes twice as long: else red
LEAST_LIMIT = 20.0  # s, of the processor, for caches and imports
IDLE = 20.0  # times as long by the clock as by the processor: a process that waits for ever
LOOK = 1.0  # s between two looks at what a process has taken
IMPORTS = 40.0  # s that the start of a process may take

Say = Callable[[str], None]


@dataclass(frozen=True)
class Reach:
    """Reach of a question with the unchanged code: seconds, and lines that run by module."""

    question: Question
    seconds: float
    lines: Mapping[str, frozenset[int]]

    def runs(self, mutant: Mutant) -> bool:
        """Return True if the statement of a mutant runs."""
        first, last = mutant.lines
        return any(first <= line <= last for line in self.lines.get(mutant.module, ()))


def examined(
    target: Target,
    seed: int,
    count: int,
    kinds: Collection[str],
    folder: Path,
    longest: float,
    patience: float,
    only: Collection[str],
    processes: int,
    say: Say,
) -> dict[str, Any]:
    """Draw mutants of a target, judge each by the exam, and return the results.

    Results are appended to a file in `folder`, one line a mutant. Existing results are kept, unless they stayed green in
    a shorter exam.

    Parameters
    ----------
    kinds
        Kinds of code of the drawn mutants: see `targets.KINDS`.
    longest
        Seconds of the longest case.
    patience
        Seconds of the unchanged code for all cases of one mutant.
    only
        Cases to solve, for one solver as `solver:case`; if empty, all that are not too long.
    """
    everything = all_mutants(target.modules())
    exam = [reach for solver in target.solvers for reach in reaches(solver, folder, longest, only, processes, say)]
    exam = _in_order(exam)
    reached = [mutant for mutant in everything if any(reach.runs(mutant) for reach in exam)]
    offered = [mutant for mutant in reached if mutant.kind in kinds]
    drawn = draw(offered, seed, count)
    say(
        f"{target.name}: {len(reached)} of {len(everything)} mutants reached by {len(exam)} cases, {len(offered)} offered"
    )
    path = folder / f"{target.name}-{seed}.jsonl"
    known = {entry["name"]: entry for entry in _lines(path)}
    exams = {mutant.name: _within([r for r in exam if r.runs(mutant)], patience) for mutant in drawn}
    known = {name: e for name, e in known.items() if e["red"] or _asked_all(e, exams.get(name, ()))}
    waiting = [mutant for mutant in drawn if mutant.name not in known]
    done = len(drawn) - len(waiting)
    with ThreadPoolExecutor(processes) as pool, path.open("a", encoding="utf-8") as file:
        for entry in pool.map(lambda mutant: _result(mutant, exams[mutant.name]), waiting):
            known[entry["name"]] = entry
            file.write(json.dumps(entry) + "\n")
            file.flush()
            done += 1
            say(f"{done}/{len(drawn)} {_told(entry)}")
    names = {mutant.name for mutant in reached}
    return {
        "target": target.name,
        "seed": seed,
        "kinds": list(kinds),
        "longest": longest,
        "patience": patience if math.isfinite(patience) else None,
        "cases": [f"{r.question.solver} {r.question.case}" for r in exam],
        "mutants": len(everything),
        "reached": len(reached),
        "not_reached": _not_reached([mutant for mutant in everything if mutant.name not in names]),
        "results": [known[mutant.name] for mutant in drawn],
    }


def reaches(solver: str, folder: Path, longest: float, only: Collection[str], processes: int, say: Say) -> list[Reach]:
    """Return the reach of the unchanged code in each case that it solves in green within about `longest` seconds."""
    modules = sorted({name for target in TARGETS.values() if solver in target.solvers for name in target.modules()})
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"reach-{solver}-{_digest(modules)}.jsonl"
    now = {case: _digest_of_case(case) for case in _cases(solver, longest, only)}
    known = {e["case"]: e for e in _lines(path) if now.get(e["case"]) == e["digest"]}
    waiting = [case for case in now if case not in known]

    def asked(case: str) -> dict[str, Any]:
        question = Question(solver, case)
        # Noting lines, and a busy machine, may take some times as long.
        answers, why = _answers(None, [question], modules, lambda _: 3 * longest + LEAST_LIMIT)
        entry = {"case": case, "digest": now[case]}
        if not answers:
            return entry | {"red": why, "seconds": 0.0, "lines": {}}
        (answer,) = answers
        return entry | {"red": answer.red, "seconds": answer.seconds, "lines": answer.reached}

    with ThreadPoolExecutor(processes) as pool, path.open("a", encoding="utf-8") as file:
        for entry in pool.map(asked, waiting):
            known[entry["case"]] = entry
            file.write(json.dumps(entry) + "\n")
            file.flush()
            say(f"{solver} {entry['case']}: {entry['red'] or 'green'}, {entry['seconds']:.1f} s")
    return [
        Reach(
            Question(solver, entry["case"]),
            entry["seconds"],
            {module: frozenset(lines) for module, lines in entry["lines"].items()},
        )
        for entry in known.values()
        if not entry["red"]
    ]


def _cases(solver: str, longest: float, only: Collection[str]) -> list[str]:
    """Return the cases of the suites that gate a solver, without those that are known to take longer."""
    # The baseline's machine knows what a case takes; of a variant, what its case takes.
    from shellbench.bench.catalogue import catalog

    costs = json.loads((ROOT / "reports" / "baseline.json").read_text(encoding="utf-8"))["costs"]
    seconds = {cost["case"]: cost["seconds"] for cost in costs if cost["solver"] == solver}
    # What all of a case's figures are open findings of examines nobody.
    held = {
        case
        for case, figures in catalog.tolerances().get(solver, {}).items()
        if not all(allowed.open_finding for allowed in figures.values())
    }
    found = [
        case
        for suite in SUITES
        for case in catalog.cases_of(suite)
        if any(run.solver == solver and not run.settings for run in catalog.find_suite(suite).runs_for(case.name))
    ]
    names = {case.name: seconds.get(case.base, 0.0) for case in found if case.base in held}
    if only:
        asked = [name for name in names if {name, f"{solver}:{name}"} & set(only)]
        return sorted(asked, key=lambda name: (names[name], name))
    return sorted((name for name, cost in names.items() if cost <= longest), key=lambda name: (names[name], name))


def _in_order(exam: Sequence[Reach]) -> list[Reach]:
    """Return cheap questions first; further variants of the same case count as more expensive."""
    ways: Counter[tuple[str, str]] = Counter()
    dear: dict[Question, float] = {}
    for reach in sorted(exam, key=lambda r: ("@" in r.question.case, r.seconds)):
        case = reach.question.solver, reach.question.case.partition("@")[0]
        ways[case] += 1
        dear[reach.question] = reach.seconds * ways[case]
    return sorted(exam, key=lambda reach: dear[reach.question])


def _within(exam: Sequence[Reach], patience: float) -> list[Reach]:
    """Return the first questions of an exam up to a total time, at least one."""
    ends = list(accumulate(reach.seconds for reach in exam))
    return [reach for reach, end in zip(exam, ends, strict=True) if end <= max(patience, ends[0])]


def _asked_all(entry: Mapping[str, Any], exam: Sequence[Reach]) -> bool:
    return {f"{r.question.solver} {r.question.case}" for r in exam} <= set(entry["cases"])


def _result(mutant: Mutant, exam: Sequence[Reach]) -> dict[str, Any]:
    seconds = {reach.question: reach.seconds for reach in exam}
    questions = [reach.question for reach in exam]
    answers, why = _answers(mutant, questions, (), lambda q: max(LEAST_LIMIT, LONGER * seconds[q]))
    red = answers[-1].red if answers and answers[-1].red else why
    asked = [f"{answer.question.solver} {answer.question.case}" for answer in answers]
    if why and len(answers) < len(exam):
        question = exam[len(answers)].question
        asked.append(f"{question.solver} {question.case}")
    entry = {"name": mutant.name, **{k: v for k, v in asdict(mutant).items() if k not in {"place", "lines", "number"}}}
    return entry | {
        "red": red,
        "by": asked[-1] if red and asked else "",
        "asked": len(asked),
        "cases": asked,
        "seconds": round(sum(answer.seconds for answer in answers), 1),
    }


def _answers(
    mutant: Mutant | None, questions: Sequence[Question], modules: Sequence[str], limit: Callable[[Question], float]
) -> tuple[list[Answered], str]:
    """Judge in a process of its own; return its results, and the reason if it did not end by itself."""
    if not questions:
        return [], ""
    context = _context()
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=examine, args=(mutant, questions, modules, there), daemon=True)
    process.start()
    there.close()
    answers: list[Answered] = []
    why = ""
    try:
        while len(answers) < len(questions) and not (answers and answers[-1].red):
            allowed = limit(questions[len(answers)]) + (0.0 if answers else IMPORTS)
            if not _waited(here, process.pid, allowed):
                why = f"{TIME}: more than {allowed:.0f} s"
                break
            answers.append(here.recv())
    except EOFError:
        process.join(IMPORTS)
        why = f"{CRASH}: exit {process.exitcode}"
    finally:
        here.close()
        if process.is_alive():
            process.kill()
        process.join()
    return answers, why


def _waited(answers: Connection, pid: int, allowed: float) -> bool:
    """Wait for an answer up to a limit of the process's processor time; return True if there is one."""
    # A process that waits for nothing takes none: the clock ends that, much later.
    process, start, begin = None, 0.0, time.monotonic()
    with contextlib.suppress(psutil.NoSuchProcess):  # it has ended: its last words may be there
        process = psutil.Process(pid)
        start = sum(process.cpu_times()[:2])
        while not answers.poll(LOOK):
            taken = sum(process.cpu_times()[:2]) - start
            if taken > allowed or time.monotonic() - begin > IDLE * allowed:
                return False
        return True
    return answers.poll(IMPORTS)


def _context() -> Any:
    """Return a context whose processes start with slow imports done, and without shellbench."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(LIBRARIES))
    return context


def _lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the entries of a file of JSON lines; the last one may have been cut off."""
    if path.is_file():
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                yield json.loads(line)
            except json.JSONDecodeError:
                continue


def _digest(modules: Sequence[str]) -> str:
    """Return a digest of the modules' source."""
    return hashlib.sha256(b"\n".join(file_of(module).read_bytes() for module in modules)).hexdigest()[:8]


def _digest_of_case(name: str) -> str:
    """Return a digest of the file of a case, which is that of its variants too."""
    path = ROOT / "cases" / f"{name.partition('@')[0]}.toml"
    return hashlib.sha256(path.read_bytes()).hexdigest()[:8]


def _not_reached(mutants: Sequence[Mutant]) -> dict[str, list[str]]:
    """Return by module the lines that no case runs, as ranges, and how many mutants they would have made."""
    found: dict[str, set[tuple[int, int]]] = {}
    for mutant in mutants:
        found.setdefault(mutant.module, set()).add(mutant.lines)
    return {
        module: [str(first) if first == last else f"{first}-{last}" for first, last in sorted(ranges)]
        for module, ranges in found.items()
    }


def _told(entry: Mapping[str, Any]) -> str:
    verdict = f"red by {entry['by']}: {entry['red'][:60]}" if entry["red"] else f"GREEN after {entry['asked']} cases"
    place = f"{entry['module'].removeprefix('shellbench.')}:{entry['line']}"
    return f"{place} {entry['rule']}: {entry['old'][:50]} -> {entry['new'][:50]}: {verdict}, {entry['seconds']} s"
