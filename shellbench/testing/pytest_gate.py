"""The gate in pytest: checked options, collected nodes, items to run, and a table at the end.

Items are below the session, beside the folders of ordinary tests. A report contains its judgement as data, so that the
process of the user makes the table and the final verdict, with pytest-xdist or without.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.outside import resolve_solver, settings_of
from shellbench.bench.plugins.registry import find_solver
from shellbench.bench.plugins.settings import parse_setting
from shellbench.bench.run.plan import FIRST_SEED
from shellbench.bench.store.store import Store
from shellbench.errors import InputError, ShellbenchError
from shellbench.testing.pytest_judging import Answers, Judgement, Question, Tolerances, positive, questions, table

ROOT = "shellbench"  # first part of the names of all items
PROPERTY = "shellbench"  # of a report
BEGAN = "shellbench_began"
CACHE = "shellbench"  # folder in pytest's cache
JUDGED = {"green", "red", "expected failure"}


@dataclass(frozen=True)
class GateOptions:
    """Options of the gate.

    Attributes
    ----------
    settings
        By solver; other solvers use their defaults.
    timeout
        Seconds after which a run is stopped; None for no limit.
    """

    suites: tuple[str, ...]
    solvers: tuple[str, ...]
    tolerances: Tolerances
    settings: Mapping[str, Mapping[str, Any]]
    store: Path
    timeout: float | None

    @classmethod
    def checked(
        cls,
        config: pytest.Config,
        *,
        suites: Sequence[str],
        solvers: Sequence[str],
        tolerances: Sequence[str],
        settings: Sequence[str],
        store: str | None,
        timeout: str | None,
    ) -> GateOptions:
        """Check options that were given as text.

        Raises
        ------
        pytest.UsageError
            In one sentence, if something is unknown, can't be read or is not installed.
        """
        if not solvers:
            raise pytest.UsageError("--shellbench needs a solver: --shellbench-solver=NAME")
        try:
            for suite in suites:
                if not catalog.cases_of(suite):
                    raise InputError(f"suite '{suite}' has no cases")
            given = _settings(settings, solvers)
            for name in solvers:
                entry = find_solver(name)
                if not hasattr(config, "workerinput"):  # the process that started this one has tried it
                    settings_of(resolve_solver(entry), given.get(name, {}), FIRST_SEED, "cpu")
            return cls(
                suites=tuple(suites),
                solvers=tuple(solvers),
                tolerances=Tolerances.read(tolerances),
                settings=given,
                store=_folder(config, store),
                timeout=None if timeout is None else positive(timeout, f"--shellbench-timeout={timeout}"),
            )
        except ShellbenchError as error:
            raise pytest.UsageError(" ".join(f"shellbench: {error}".split())) from None

    def headline(self, root: Path) -> str:
        """Describe the gated runs in one line, for the head of pytest's output; `root` is the project's folder."""
        store = self.store.relative_to(root) if self.store.is_relative_to(root) else self.store
        own = self.tolerances.narrower.items()
        given = ", ".join(f"{case}{f'.{name}' if name else ''} {tolerance:g}" for (case, name), tolerance in own)
        narrower = f" ({given})" if given else ""
        return (
            f"shellbench: {_list('suite', self.suites)}, {_list('solver', self.solvers)}, relative tolerance "
            f"{self.tolerances.general:g}{narrower} where shellbench freezes none, store {store}"
        )


def _settings(texts: Sequence[str], solvers: Sequence[str]) -> dict[str, dict[str, Any]]:
    given: dict[str, dict[str, Any]] = {}
    for text in texts:
        name, key, value = parse_setting(text)
        if name not in solvers:
            raise InputError(f"--shellbench-set={text}: solver '{name}' is not gated here")
        given.setdefault(name, {})[key] = value
    return given


def _folder(config: pytest.Config, store: str | None) -> Path:
    if store is not None:
        return config.invocation_params.dir / store
    cache: pytest.Cache | None = getattr(config, "cache", None)  # there is none with -p no:cacheprovider
    if cache is None:
        raise InputError("pytest's cache is off, so name a folder for finished runs: --shellbench-store=DIR")
    try:
        return cache.mkdir(CACHE)
    except OSError as error:
        reason = error.strerror or "no folder"
        raise InputError(
            f"pytest's cache can't be written ({reason}), so name a folder for finished runs: --shellbench-store=DIR"
        ) from None


def _list(what: str, names: Sequence[str]) -> str:
    return f"{what}{'s' if len(names) > 1 else ''} {', '.join(names)}"


class QuantityItem(pytest.Item):
    """One quantity of one case by one solver."""

    question: Question
    answers: Answers
    options: GateOptions

    def runtest(self) -> None:
        """Judge the quantity."""
        found = self.question.judged(self.answers, self.options.tolerances)
        self.user_properties.append((PROPERTY, found.plain()))
        match found.finding.colour:
            case "red":
                pytest.fail(found.finding.sentence, pytrace=False)
            case "expected failure":
                pytest.xfail(found.finding.sentence)
            case "not judged":
                pytest.skip(found.finding.sentence)

    def reportinfo(self) -> tuple[Any, int | None, str]:
        """Return the location of the item; it is in no file."""
        return self.path, None, self.nodeid.replace("::", " ")


class Branch(pytest.Collector):
    """All items, or those of a suite, a case, or a solver, with their parts."""

    below: dict[str, Any]
    gate: Gate

    def collect(self) -> Iterator[pytest.Item | pytest.Collector]:
        """Yield the nodes below."""
        for name, content in self.below.items():
            if isinstance(content, Question):
                item = QuantityItem.from_parent(self, name=name)
                item.question, item.answers, item.options = content, self.gate.answers, self.gate.options
                item.add_marker(ROOT)
                yield item
            else:
                yield self.gate.branch(self, name, content)


class Gate:
    """The plug-in itself, registered if a suite is named."""

    def __init__(self, config: pytest.Config, options: GateOptions) -> None:
        self.config = config
        self.options = options
        store = Store(options.store)
        known = getattr(config, "workerinput", {}).get(BEGAN)  # by pytest-xdist, when the session began
        try:
            self.began: int = store.last_number() if known is None else known
        except ShellbenchError as error:
            raise pytest.UsageError(" ".join(f"shellbench: {error}".split())) from None
        self.answers = Answers(store, self.began, options.settings, options.timeout)
        self.found: list[Judgement] = []

    def pytest_report_header(self) -> str:
        """Return the description of the gated runs."""
        return self.options.headline(self.config.rootpath)

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """Send the session's start to a process of pytest-xdist."""
        node.workerinput[BEGAN] = self.began

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(
        self, collector: pytest.Collector
    ) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
        """Add the gate to the session's collection."""
        report = yield
        if isinstance(collector, pytest.Session) and report.result is not None:
            report.result = [*report.result, self.branch(collector, ROOT, self.tree())]
        return report

    def tree(self) -> dict[str, Any]:
        """Return all questions by suite, case, solver and name."""
        return {
            suite: {
                case.name: {
                    solver: {question.name: question for question in questions(suite, case, solver)}
                    for solver in self.options.solvers
                }
                for case in catalog.cases_of(suite)
            }
            for suite in self.options.suites
        }

    def branch(self, parent: Any, name: str, below: dict[str, Any]) -> Branch:
        """Return a node with all nodes below it."""
        nodeid = name if isinstance(parent, pytest.Session) else f"{parent.nodeid}::{name}"
        branch: Branch = Branch.from_parent(parent, name=name, nodeid=nodeid, path=self.config.rootpath)
        branch.below, branch.gate = below, self
        return branch

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note the judgement in a report."""
        if report.when == "call":
            self.found.extend(Judgement.read(data) for name, data in report.user_properties if name == PROPERTY)

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Let the session fail if nothing was judged of a solver, because such a gate can't fail."""
        good = (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)
        if self.unjudged() and session.exitstatus in good:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def unjudged(self) -> list[str]:
        """Return a sentence for each solver and suite whose items ran without a judgement."""
        findings = [judgement.finding for judgement in self.found]
        asked = dict.fromkeys((finding.row.suite, finding.row.solver) for finding in findings)
        judged = {(finding.row.suite, finding.row.solver) for finding in findings if finding.colour in JUDGED}
        return [
            f"shellbench: nothing was judged: no case of suite '{suite}' that was asked for applies to '{solver}'"
            for suite, solver in asked
            if (suite, solver) not in judged
        ]

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the table of judgements."""
        if self.config.getoption("collectonly", False):
            return
        if not self.found:
            terminalreporter.write_line("shellbench: no item of the gate was run")
            return
        terminalreporter.write_sep("=", "shellbench")
        for line in table(self.found):
            terminalreporter.write_line(line)
        _write(terminalreporter, self.unjudged())


def _write(terminalreporter: pytest.TerminalReporter, sentences: Iterable[str]) -> None:
    for sentence in sentences:
        terminalreporter.write_line(sentence, red=True)
