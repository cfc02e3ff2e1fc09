"""Solvers and kinds of problem of other packages run in their own processes; built-in ones run in this process.

Their code could end this process, hang it, or change its judgement. A child process with a limit therefore loads them
(`shellbench.bench.plugins.inside`), and answers in JSON. Its answers are cached until one of these changes: the files
of the package, the files that the child has imported, or the folders in Python's search path. Failures are not cached.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import psutil
from pydantic import BaseModel, ConfigDict, ValidationError

from shellbench.bench.plugins import registry
from shellbench.bench.plugins.facts import facts_of
from shellbench.bench.plugins.registry import SolverEntry, load_solver
from shellbench.bench.plugins.settings import make_settings
from shellbench.bench.plugins.source import locate
from shellbench.bench.plugins.subject import NoAnswer, Refused, Subject
from shellbench.disk import look_up, read_cache, write_cache
from shellbench.errors import InputError, PluginError
from shellbench.problem import Capabilities, Device, Problem, SeededSettings, Settings, Solver, why_declined
from shellbench.protocol.sample import Sample
from shellbench.protocol.schema import one_sentence

SECONDS = 60.0  # limit in seconds for the import, and for each answer
MEMORY = 8e9  # limit of memory in bytes
MOST_FILES = 20000  # largest number of a package's files that are checked for changes
REFUSE = ("settings", "build", "rebuild", "variant", "sample")  # questions whose arguments may be refused
MOST_WORDS = 300  # letters of a reason

T = TypeVar("T", bound=BaseModel)


class Facts(BaseModel):
    """Facts that a solver states of itself; see `shellbench.bench.plugins.facts`."""

    model_config = ConfigDict(strict=True)

    label: str
    engine: str | None
    theories: list[str]
    devices: list[Device]
    seeded: bool
    settings: list[dict[str, Any]]
    uses_start: bool


class Refusal(BaseModel):
    """The reason why a solver declines a problem; None if it takes it."""

    model_config = ConfigDict(strict=True)

    reason: str | None


class KnownSettings(Settings):
    """Settings as data; only their solver knows their class."""

    model_config = ConfigDict(extra="allow")


class KnownSeededSettings(SeededSettings):
    """The same, with a seed."""

    model_config = ConfigDict(extra="allow")


@dataclass
class Outsider:
    """A solver or kind of another package in its own process.

    Attributes
    ----------
    what
        "solver" or "kind".
    answers, places
        Cached answers, and the marks of files and folders on which they depend.
    """

    what: str
    entry: SolverEntry
    answers: dict[str, Any] = field(default_factory=dict)
    places: dict[str, Any] = field(default_factory=dict)
    subject: Subject | None = None
    trouble: str = ""

    @property
    def name(self) -> str:
        """Its name in messages."""
        noun = f"solver '{self.entry.name}'" if self.what == "solver" else f"problems of kind '{self.entry.name}'"
        return f"{noun} can't be used"

    def ask(self, answer: type[T], operation: str, *arguments: Any) -> T:
        """Return the answer to a question, in the given form.

        Raises
        ------
        InputError
            If it refuses the arguments.
        PluginError
            In one sentence with its name and its failure, if it does not answer.
        """
        plain = json.loads(json.dumps(arguments, default=str))  # a date of TOML is a text here
        key = hashlib.sha256(json.dumps([operation, plain], sort_keys=True).encode()).hexdigest()
        told = self.answers.get(key)
        if told is None:
            told = self.call(operation, *plain)
        try:
            found = answer.model_validate(told)
        except ValidationError as error:
            self.answers.pop(key, None)
            raise self.failed(f"{operation} returned no valid answer: {one_sentence(error)}") from None
        if key not in self.answers:
            self.answers[key] = told
            self._keep()
        return found

    def call(self, operation: str, *arguments: Any) -> Any:
        """Return the answer in any form; see `ask`."""
        if self.trouble:  # do not wait for it again
            raise PluginError(self.trouble)
        try:
            if self.subject is None or not self.subject.alive:
                self.subject = self._started()
            return self.subject.call(operation, *arguments)
        except NoAnswer as trouble:
            if isinstance(trouble, Refused) and operation in REFUSE:
                raise InputError(str(trouble).removeprefix(f"{operation} refused: ")) from None
            raise self.failed(str(trouble)) from None

    def _started(self) -> Subject:
        entry, memory = self.entry, min(MEMORY, psutil.virtual_memory().total / 2)
        try:
            subject = Subject.start(
                "shellbench.bench.plugins.inside", self.what, entry.name, entry.target, seconds=SECONDS, memory=memory
            )
        except Refused as refusal:  # the solver itself reports unusable settings
            words = str(refusal).removeprefix("the import refused: ").removeprefix(f"{self.name}: ")
            raise self.failed(words) from None
        imported = subject.greeting if isinstance(subject.greeting, list) else []
        self.places |= marks_of_places(map(str, imported[:MOST_FILES]))
        return subject

    def failed(self, words: str) -> PluginError:
        """Return the error of its failure, and repeat it for later questions."""
        self.trouble = f"{self.name}: {one_line(words)}"
        return PluginError(self.trouble)

    @property
    def _cached_as(self) -> str:
        entry = self.entry
        key = (self.what, entry.name, entry.target, entry.distribution, entry.version, sys.prefix, sys.version)
        return f"plugins/{hashlib.sha256(repr(key).encode()).hexdigest()}.json"

    def load_cached(self) -> None:
        """Load the cached answers if they belong to the present files."""
        self.places = marks_of_places((*package_files(self.entry), *sys.path))
        match read_cache(self._cached_as):
            case {"places": dict(places), "answers": dict(answers)}:
                if places == marks_of_places(places) and self.places.items() <= places.items():
                    self.places, self.answers = dict(places), dict(answers)

    def _keep(self) -> None:
        if len(self.places) <= 2 * MOST_FILES and marks_of_places(self.places) == self.places:
            write_cache(self._cached_as, {"places": self.places, "answers": self.answers})


def marks_of_places(places: Iterable[str]) -> dict[str, Any]:
    """Return a mark of each place, by its path; it changes when the file, or the names in the folder, change.

    A folder's time and hidden names do not count: tools and Python keep caches there.
    """
    return {place: _look(Path(place)) for place in places}


def _look(place: Path) -> Any:
    with contextlib.suppress(OSError):
        if place.is_dir():
            names = sorted(file.name for file in place.iterdir())
            names = [name for name in names if name[0] != "." and name != "__pycache__"]
            return hashlib.sha256("\n".join(names).encode(errors="surrogateescape")).hexdigest()
    seen = look_up(place)
    return None if seen is None else list(seen)


def package_files(entry: SolverEntry) -> list[str]:
    """Return the files of the package of which a module is, data among them, and its folders."""
    found = locate(entry.module.partition(".")[0])
    if found is None or found.name != "__init__.py":
        return [str(found)]
    return [
        os.path.join(folder, name)  # noqa: PTH118 - of thousands of files
        for folder, folders, names in os.walk(found.parent)
        if folders.sort() is None and Path(folder).name != "__pycache__"
        for name in names
    ][: MOST_FILES + 1]


def one_line(words: str) -> str:
    """Return text of others as one line that is safe for a terminal."""
    line = " ".join(words.split())
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in line)[:MOST_WORDS]


@cache
def outsider(what: str, entry: SolverEntry) -> Outsider:
    """Return the handle of another package's entry, with its stored answers."""
    found = Outsider(what, entry)
    found.load_cached()
    return found


@dataclass(frozen=True)
class AskedSolver:
    """A solver of another package, for all of its methods except solutions."""

    entry: SolverEntry
    facts: Facts

    @property
    def name(self) -> str:
        """Its name."""
        return self.entry.name

    @property
    def capabilities(self) -> Capabilities:
        """Its theories, label and devices."""
        facts = self.facts
        return Capabilities(tuple(facts.theories), one_line(facts.label), tuple(facts.devices))

    @property
    def uses_start(self) -> bool:
        """True if it can continue an earlier solution."""
        return self.facts.uses_start

    def settings(self, overrides: Mapping[str, Any], seed: int, device: str) -> Settings:
        """Return its settings, as `shellbench.bench.plugins.settings.make_settings` does."""
        kind = KnownSeededSettings if self.facts.seeded else KnownSettings
        return outsider("solver", self.entry).ask(kind, "settings", dict(overrides), seed, device)

    def declines(self, case: Problem) -> str | None:
        """Return the reason why the solver can't take a problem, or None if it can."""
        data = {**case.data(), "name": case.name}
        reason = outsider("solver", self.entry).ask(Refusal, "declines", data).reason
        return None if reason is None else one_line(reason)

    def sample(self, kind: str, file: Path, resolution: int, at: float | None, title: str) -> Sample:
        """Return a stored solution of a kind of problem on a grid with `points` points a side."""
        plugin = outsider("solver", self.entry)
        told = plugin.call("sample", kind, str(file.resolve()), resolution, at, title)
        try:
            names = {name: tuple(parts) for name, parts in told.pop("components").items()}
            return Sample(**told | {"periodic": tuple(told["periodic"]), "components": names})
        except (AttributeError, KeyError, TypeError) as error:
            raise plugin.failed(f"sample returned no valid sample: {error}") from None


def resolve_solver(entry: SolverEntry) -> Solver | AskedSolver:
    """Return a built-in solver, or the stand-in of one of another package.

    Raises
    ------
    InputError
        If it is built in and can't be imported.
    PluginError
        If it is another package's and does not answer.
    """
    if registry.loads_here(entry):
        return load_solver(entry)
    return AskedSolver(entry, outsider("solver", entry).ask(Facts, "describe"))


def settings_of(solver: Solver | AskedSolver, overrides: Mapping[str, Any], seed: int, device: str) -> Settings:
    """Return a solver's settings; see `shellbench.bench.plugins.settings.make_settings`."""
    if isinstance(solver, AskedSolver):
        return solver.settings(overrides, seed, device)
    return make_settings(solver, overrides, seed, device)


def describe_solver(entry: SolverEntry) -> dict[str, Any]:
    """Return a solver's description of itself; raises as `asked`."""
    found = resolve_solver(entry)
    return found.facts.model_dump() if isinstance(found, AskedSolver) else facts_of(found)


def declines(solver: Solver | AskedSolver, case: Problem) -> str | None:
    """Return the reason why a solver can't take a case, or None if it can."""
    if case.theory not in solver.capabilities.theories:
        return f"it does not solve {case.theory}"
    return solver.declines(case) if isinstance(solver, AskedSolver) else why_declined(solver, case)
