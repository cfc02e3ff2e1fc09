"""Judgement of stated answers: which limit they tend to, their errors and classes, and their records."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from shellbench import __version__
from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownValue, KnownValues
from shellbench.bench.judge.classes import class_of
from shellbench.bench.judge.compare import row_of, values_of_file
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.kinds import find_kind
from shellbench.bench.stated.answers import Answer, Read
from shellbench.bench.store.current import CurrentRun
from shellbench.bench.store.identity import GATED_DTYPE
from shellbench.bench.store.record import STATED, Environment, Identity, Measured, Record, Stated
from shellbench.bench.store.store import Store
from shellbench.bench.store.task import case_data, new_run_id
from shellbench.errors import InputError
from shellbench.problem import VARIANT, Problem
from shellbench.protocol.limit import Limit, limit_of

ENOUGH = 3  # meshes that show a limit
THOUSAND = 0.15  # decades by which a factor may differ from a power of a thousand that a wrong unit explains
NOT_STATED = "not stated"


@dataclass(frozen=True)
class Author:
    """Who states results: a name for tables, the program with its version, and the element; each may be empty."""

    name: str = ""
    program: str = ""
    element: str = ""

    @property
    def solver(self) -> str:
        """The name under which the results are recorded."""
        return f"{self.name or ' '.join(filter(None, (self.program, self.element))) or 'unnamed'}{STATED}"


@dataclass(frozen=True)
class Judged:
    """One quantity of stated results.

    Attributes
    ----------
    rows
        One a mesh, from coarse to fine, compared with the known value of the theory that judges.
    answers
        The same as they were stated.
    known
        Known values by name of their limit.
    judge
        Name of the limit of the theory that judges.
    limit
        Of the meshes; None for one mesh.
    """

    rows: tuple[Row, ...]
    answers: tuple[Answer, ...]
    known: Mapping[str, KnownValue]
    judge: str
    limit: Limit | None

    @property
    def nearest(self) -> list[str]:
        """Names of the known limits, that which the answers tend to first."""
        end = self.answers[-1].value if self.limit is None else self.limit.value
        return sorted(self.known, key=lambda name: abs(self.known[name].value - end))


@dataclass(frozen=True)
class Judgement:
    """All judged quantities; the record of each case; warnings in one sentence each."""

    judged: tuple[Judged, ...]
    records: tuple[Record, ...]
    warnings: tuple[str, ...]

    def missed(self, size: float) -> list[Judged]:
        """Return the judged quantities that are not within a class."""
        with_known = [one for one in self.judged if one.rows[-1].reference is not None]
        return [one for one in with_known if class_of(one.rows[-1], (size,)) is None]


def judge_answers(read: Read, author: Author, theory: str | None = None) -> Judgement:
    """Compare answers with the known values of their cases.

    Each case is judged in one theory: the given one; else that of the limit that its headline tends to, if three meshes
    or more show a limit; else the case's own.

    Raises
    ------
    InputError
        If a quantity has several values on one mesh, or no mesh is stated of several values; if the theory is unknown.
    """
    judged: list[Judged] = []
    records, warnings = [], list(read.remarks)
    cases = {answer.case.name: answer.case for answer in read.answers}
    for case in cases.values():
        mine = [answer for answer in read.answers if answer.case.name == case.name]
        ladders = {q.name: _ladder(q.name, mine) for q in case.quantities if any(a.quantity == q.name for a in mine)}
        limits = {name: _limit(ladder) for name, ladder in ladders.items()}
        theories = _theories(case)
        seen = theory or _theory(case, theories, ladders, limits)
        if seen is not None and seen not in theories:
            raise InputError(f"--theory: found {theory!r}, but case '{case.name}' has values of {', '.join(theories)}")
        chosen = seen or next(name for name, (same, _) in theories.items() if same.digest() == case.digest())
        asked, words = theories[chosen][0], find_kind(case.kind).limits
        meshes = max(len(ladder) for ladder in ladders.values())
        found = {}
        for name, ladder in ladders.items():
            rows = tuple(_row(asked, name, answer, author, read) for answer in ladder)
            known = {words.get(of, f"{of} value"): value for of, value in _known(theories, name).items()}
            found[name] = Judged(rows, ladder, known, words.get(chosen, f"{chosen} value"), limits[name])
        records.append(_record(asked, [one.answers[-1] for one in found.values()], limits, author, read, theory or ""))
        judged += found.values()
        warnings += [words for one in found.values() for words in _doubts(one)]
        lacking = [q.name for q in case.quantities if q.name not in ladders and _known(theories, q.name)]
        warnings += [f"{case.name}: nothing is stated of {', '.join(lacking)}"] if lacking else []
        if seen is None and len(_known(theories, _headline(case, ladders))) > 1 and meshes >= ENOUGH:
            own = words.get(chosen, chosen)
            warnings.append(f"{case.name}: which limit the values tend to is not sure: the {own} judges, or --theory")
        if meshes < ENOUGH:
            few = f"{meshes} mesh{'es' if meshes > 1 else ''}"
            warnings.append(f"{case.name}: {few} of {ENOUGH}: which limit the program tends to is not sure")
    return Judgement(tuple(judged), tuple(records), tuple(warnings))


def store_records(judgement: Judgement, store: Store) -> None:
    """Store the records; StoreError if the store can't be written."""
    with store.at_work():
        for record in judgement.records:
            store.commit(store.begin(record.run_id), record)


def _ladder(quantity: str, answers: Sequence[Answer]) -> tuple[Answer, ...]:
    """Return the answers of a quantity from coarse to fine."""
    found = [answer for answer in answers if answer.quantity == quantity]
    sizes = [answer.size for answer in found]
    for number, answer in enumerate(found):
        if len(found) > 1 and (answer.size is None or answer.size in sizes[:number]):
            if answer.size is None:
                raise InputError(
                    f"{answer.file}: {answer.where}, field 'cells': {quantity} has other values: on which mesh?"
                )
            other = found[sizes.index(answer.size)]
            raise InputError(
                f"{answer.file}: {answer.where}: {quantity} has a value on this mesh in {other.file}, {other.where},"
                " too: judge each element for itself"
            )
    return tuple(sorted(found, key=lambda answer: -(answer.size or 0.0)))


def _limit(ladder: Sequence[Answer]) -> Limit | None:
    sizes = [answer.size or 1.0 for answer in ladder]
    rounding = min(answer.rounding for answer in ladder)  # spreadsheets drop zeros at the end of some
    return None if len(ladder) == 1 else limit_of(sizes, [answer.value for answer in ladder], rounding)


Theories = Mapping[str, tuple[Problem, KnownValues]]


def _theories(case: Problem) -> Theories:
    """Return the case and its known values in each theory: by the theory of the case as declared, and by twin."""
    if catalog.is_own(case):
        return {case.theory: (case, values_of_file(case))}
    twins, own = find_kind(case.kind).twins, catalog.own_twins()
    base = catalog.named_case(case.base) if case.name.partition(VARIANT)[2] in twins else case
    full = {twin: f"{case.base}{VARIANT}{twin}" for twin in twins if f"{case.base}{VARIANT}{twin}" in own}
    return {base.theory: (base, catalog.known_values(case.base))} | {
        twin: (catalog.named_case(name), catalog.known_values(name)) for twin, name in full.items()
    }


def _known(theories: Theories, quantity: str) -> dict[str, KnownValue]:
    """Return the known values of a quantity by theory."""
    judges = {name: known.judge(quantity, case.theory) for name, (case, known) in theories.items()}
    return {name: value for name, value in judges.items() if value is not None}


def _headline(case: Problem, stated: Mapping[str, object]) -> str:
    """Return the primary quantity, or the first that is stated."""
    return next(q.name for q in sorted(case.quantities, key=lambda q: not q.primary) if q.name in stated)


def _theory(
    case: Problem, theories: Theories, ladders: Mapping[str, Sequence[Answer]], limits: Mapping[str, Limit | None]
) -> str | None:
    """Return the name of the theory whose limit the headline tends to; None if it does not tell the limits apart."""
    headline = _headline(case, ladders)
    limit, known = limits[headline], _known(theories, headline)
    if limit is None or not known or len(ladders[headline]) < ENOUGH:
        return None
    far = {name: abs(value.value - limit.value) for name, value in known.items()}
    nearest, *others = sorted(far, key=lambda name: far[name])
    return nearest if all(far[name] - far[nearest] > 2 * limit.uncertainty for name in others) else None


def _record(
    case: Problem,
    answers: Sequence[Answer],
    limits: Mapping[str, Limit | None],
    author: Author,
    read: Read,
    theory: str,
) -> Record:
    """Return the record of the values on the finest mesh."""
    values = {}
    for answer in answers:
        limit = limits.get(answer.quantity)
        sure = None if limit is None else abs(limit.value - answer.value) + limit.uncertainty
        values[answer.quantity] = Measured(
            value=answer.value, uncertainty=sure, extrapolated=limit.value if limit and limit.rate else None
        )
    settings = {"program": author.program, "element": author.element}
    run_id, created = new_run_id(case.name, author.solver, None)
    finest = max(answers, key=lambda answer: (answer.cells or 0, answer.unknowns or 0))
    mesh = {"cells": finest.cells, "unknowns": finest.unknowns, "seconds": finest.seconds}
    source = hashlib.sha256(json.dumps(sorted(read.files.values())).encode()).hexdigest()
    return Record(
        run_id=run_id,
        created=created,
        identity=Identity(
            case=case.digest(),
            solver=author.solver,
            source=source,
            settings=settings,
            seed=None,
            device="cpu",
            dtype=GATED_DTYPE,
        ),
        case_name=case.name,
        case=case_data(case),
        own_case=catalog.is_own(case),
        defaults=settings,
        solver_label=", ".join(filter(None, settings.values())) or NOT_STATED,
        exam=catalog.exam_version(),
        status="ok",
        seconds=0.0,
        parameters=finest.unknowns,
        values=values,
        environment=Environment(
            python=NOT_STATED,
            versions={"shellbench": __version__},
            platform=NOT_STATED,
            processor=NOT_STATED,
            cores=0,
            threads=0,
        ),
        stated=Stated(program=author.program, element=author.element, theory=theory, files=dict(read.files), **mesh),
    )


def _row(case: Problem, quantity: str, answer: Answer, author: Author, read: Read) -> Row:
    record = _record(case, [answer], {}, author, read, "")
    return row_of(CurrentRun(record, case, {}, installed=False), case.quantity(quantity))


def _doubts(one: Judged) -> list[str]:
    """Return warnings about the value on the finest mesh: its sign, and factors that a wrong unit explains."""
    row, known = one.rows[-1], [value.value for value in one.known.values()]
    value, found = row.value or 0.0, []
    if known and all(value * other < 0 for other in known):
        found.append(f"{row.case} {row.quantity}: the sign is against all known values")
    ratios = [math.log10(abs(value / other)) for other in known if value and other]
    for power in (-6, -3, 3, 6):
        if ratios and all(abs(ratio - power) < THOUSAND for ratio in ratios):
            found.append(f"{row.case} {row.quantity}: about 1e{power:+d} times all known values: is the unit right?")
    return found
