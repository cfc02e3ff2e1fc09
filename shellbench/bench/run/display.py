"""Progress of runs: bars on a terminal, one plain line a run elsewhere."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import IO

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Column
from rich.text import Text

from shellbench import problem
from shellbench.bench.catalogue.catalog import named_case
from shellbench.bench.plugins.kinds import problem_of
from shellbench.bench.run.execute import Observer, Outcome
from shellbench.bench.store.record import NOT_SETTLED, Record
from shellbench.bench.store.task import Task

BAR = 16  # letters of a bar: names and words need the room of 80 columns
COLOURS = {"ok": "green", NOT_SETTLED: "yellow", "failed": "red", "timeout": "red"}


class Silent:
    """Shows nothing."""

    def started(self, task: Task) -> None:
        """Show nothing."""

    def progressed(self, task: Task, progress: problem.Progress) -> None:
        """Show nothing."""

    def ended(self, outcome: Outcome) -> None:
        """Show nothing."""


class Lines:
    """Prints a line for each ended run, for pipes and files. If `verbose`, also for each step of a run."""

    def __init__(self, file: IO[str], verbose: bool = False) -> None:
        self.file = file
        self.verbose = verbose

    def started(self, task: Task) -> None:
        """Print the start of a run, if verbose."""
        if self.verbose:
            self._print(f"begins {run_name(task)}")

    def progressed(self, task: Task, progress: problem.Progress) -> None:
        """Print a step, if verbose."""
        if self.verbose:
            of = "" if progress.total is None else f"/{progress.total}"
            self._print(f"  step {progress.step}{of} {run_name(task)}  {progress.message}")

    def ended(self, outcome: Outcome) -> None:
        """Print the line at once, so that readers of a pipe see the progress."""
        self._print(Text.from_markup(_line(outcome)).plain)

    def _print(self, words: str) -> None:
        shown = "".join(letter if letter.isprintable() else " " for letter in words)
        print(" ".join(shown.split()), file=self.file, flush=True)


class Bars:
    """One bar for all runs and one for each current run; a line for each ended run."""

    def __init__(self, bars: Progress, total: int) -> None:
        self.bars = bars
        self.overall = bars.add_task("all runs", total=total)
        self.lines: dict[str, TaskID] = {}

    def started(self, task: Task) -> None:
        """Add a bar."""
        self.lines[task.run_id] = self.bars.add_task(escape(run_name(task)), total=None)

    def progressed(self, task: Task, progress: problem.Progress) -> None:
        """Move the bar."""
        line = self.lines[task.run_id]
        said = f"{run_name(task)}  {progress.message}" if progress.message else run_name(task)
        self.bars.update(line, completed=progress.step, total=progress.total, description=escape(said))

    def ended(self, outcome: Outcome) -> None:
        """Replace the bar by a line."""
        line = self.lines.pop(outcome.task.run_id, None)
        if line is not None:
            self.bars.remove_task(line)
        self.bars.console.print(_line(outcome), highlight=False)
        self.bars.advance(self.overall)


@contextlib.contextmanager
def display(console: Console, total: int, verbose: bool = False) -> Iterator[Observer]:
    """Show runs: bars on a terminal, plain lines elsewhere; also steps if `verbose`."""
    if not total:
        yield Silent()
        return
    if not console.file.isatty():  # a pipe gets plain text, even if FORCE_COLOR is set
        yield Lines(console.file, verbose)
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis")),
        BarColumn(bar_width=BAR),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True, expand=True) as bars:
        yield Bars(bars, total)


def run_name(run: Task | Record) -> str:
    """Return the name of a run: case, solver, seed."""
    seed = run.identity.seed
    return f"{run.case_name} {run.identity.solver}" + ("" if seed is None else f" seed {seed}")


def _line(outcome: Outcome) -> str:
    record = outcome.record
    name = escape(run_name(outcome.task))
    if record is None:
        return f"[red]refused[/] {name}: {escape(outcome.refused or '')}"
    colour = COLOURS[record.status]
    case = problem_of(record.case) if record.own_case else named_case(record.case_name)  # the latter is at hand
    primary = case.primary
    measured = record.values.get(primary.name)
    answer = f"  {primary.name} = {measured.value:.6g} {primary.unit}" if measured else ""
    moving = ", ".join(q.name for q in case.quantities if q.name in record.values and record.converged(q.name) is False)
    words = [f"not converged: {moving}" if moving else "", case.remark if record.status == "ok" else ""]
    reasons = dict.fromkeys(record.declined.values() if record.values else ())
    words += [f"declines {', '.join(n for n, one in record.declined.items() if one == why)}: {why}" for why in reasons]
    said = escape("; ".join(filter(None, words)))
    return f"[{colour}]{record.status:>7}[/] {name}  {record.seconds:.2f} s{answer}{': ' if said else ''}{said}"
