"""Problem, Solution and Solver: what everything else stands on.

A problem is asked, a solver turns it into a solution, and the problem's quantities measure that. The bench and the
report are written against these three and know no kind of problem and no solver by name. Kinds of problem are found
through the entry-point group ``shellbench.problems`` and solvers through ``shellbench.solvers``; our own register there
like anyone's.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, Self, get_args

from numpy.typing import NDArray
from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticKnownError

from shellbench.account import Phase
from shellbench.errors import InputError
from shellbench.known import Known, check_known
from shellbench.model import LONGEST_TITLE, Finite, Flag, Model, Name, Positive, check_sizes, one_sentence, read_toml
from shellbench.portrait import Portrait
from shellbench.sample import Sample
from shellbench.shown import case_html

Device = Literal["cpu", "cuda"]
NumberFormat = Literal["float64", "float32", "float16"]
VARIANT = "@"  # between a case's name and its variant's
CaseName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*(@[a-z]+)?$", max_length=80)]
FULL = 1.0  # the mark of a figure of which nothing else is said

FIELDS = ("membrane_strain", "bending_strain", "membrane_energy_density", "bending_energy_density")
"""Names that a shell solution's `evaluate` knows.

Strains are (..., 3): covariant components 11, 22, 12 in the surface's coordinates, eps = (a - abar)/2 without
unit and kappa = bbar - b in 1/m, both times the coordinates' own units; densities are (...), J per square metre
of reference area.
"""


class Quantity(Model):
    """A figure that a problem asks of every solution.

    A kind of problem derives its quantities from this class; each says its unit, and how it is measured.

    Attributes
    ----------
    name
        Unique in the case; known values refer to it.
    description
        What a table says, without the unit.
    unit
        Unit of the value, for tables.
    primary
        Whether it is the headline of the case: exactly one is.
    tolerance, open_finding
        By solver, in a user's own case only, and judged by no gate: what our cases allow is frozen in
        references/tolerances/, and so are their open findings.
    absolute
        Whether an error relative to the known value would say nothing, so that it is given in the unit.
    at
        Mark of the state that it belongs to, such as a time in s or a load factor.
    factor
        What its measured value is multiplied by before it is recorded: 0.001 of a displacement in a case in
        millimetres whose known values are in metres.
    is_an_error
        Of a class: its value is an error already. Solvers are not held against each other over it.
    """

    is_an_error: ClassVar[bool] = False

    name: Name
    description: str = ""
    unit: str = "m"
    primary: Flag = False
    at: Finite = FULL
    factor: Positive = 1.0
    tolerance: dict[str, Positive] = Field(default_factory=dict)
    absolute: Flag = False
    open_finding: dict[str, str] = Field(default_factory=dict)

    if TYPE_CHECKING:

        @property
        def kind(self) -> str:
            """What case files call it."""
            ...

    @property
    def mark(self) -> float | None:
        """The mark of its state; None where the solution itself marks the state."""
        return self.at

    def measure(self, solution: Any) -> float:
        """Return its value, in SI units or the problem's own.

        Raises
        ------
        ValueError
            If it belongs to a state that the solution did not reach.
        """
        raise NotImplementedError


class Problem(Model):
    """A question that is put to solvers.

    A kind of problem derives its own from this class, with the fields that its file has; `quantities` is one of them.

    Attributes
    ----------
    name
        Stem of the file; records and known values refer to it. A file does not give it.
    kind
        Kind of problem: the name of its entry point.
    title
        One line, for tables and figures.
    description
        What is asked and where it comes from, in prose.
    suites
        Suites that the case belongs to; a case of your own needs none.
    units
        Units of the file: SI unless it says otherwise (text for tables; nothing is converted).
    theory
        Which theory the answer is asked for: known values of another theory do not judge it.
    known
        What its quantities should be, in a user's own case only: those of our cases are in references/.
    """

    not_physics: ClassVar[frozenset[str]] = frozenset({"name", "title", "description", "suites", "units", "known"})
    not_physics_of_a_quantity: ClassVar[frozenset[str]] = frozenset(
        {"description", "unit", "primary", "tolerance", "absolute", "open_finding"}
    )

    name: CaseName
    kind: str
    title: str = Field(max_length=LONGEST_TITLE)
    description: str = ""
    units: str = "SI"
    suites: tuple[Name, ...] = ()
    theory: str
    known: tuple[Known, ...] = ()

    if TYPE_CHECKING:

        @property
        def quantities(self) -> Sequence[Quantity]:
            """What is asked."""
            ...

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read and check a file.

        Raises
        ------
        InputError
            In one sentence with the file, the field, what was found and what is allowed.
        """
        return cls.build(read_toml(path), name=path.stem, where=str(path))

    @classmethod
    def build(cls, data: Mapping[str, Any], name: str, where: str) -> Self:
        """Make a problem of parsed data; `where` stands at the start of error messages."""
        if "name" in data:
            raise InputError(f"{where}: field 'name' is not known here; a case is named by its file")
        if VARIANT in name:
            raise InputError(f"{where}: a case's name can't contain '{VARIANT}', which stands before a variant's")
        whole = {**data, "name": name}
        try:
            check_sizes(whole)
            return cls.model_validate(whole)
        except ValidationError as error:
            raise InputError(f"{where}: {one_sentence(error, whole)}") from None
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

    @property
    def base(self) -> str:
        """Name of the case as declared: its own, unless it is a variant."""
        return self.name.partition(VARIANT)[0]

    @property
    def primary(self) -> Quantity:
        """The headline quantity."""
        return next(q for q in self.quantities if q.primary)

    @property
    def states(self) -> tuple[float, ...]:
        """Marks at which the answer is kept, increasing."""
        return tuple(sorted({q.at for q in self.quantities if q.mark is not None}))

    def quantity(self, name: str) -> Quantity:
        """Return the quantity of this name; KeyError if there is none."""
        for quantity in self.quantities:
            if quantity.name == name:
                return quantity
        raise KeyError(name)

    def mark_words(self, mark: float) -> str:
        """Return what a mark means, such as "t = 0.25"."""
        return f"t = {mark:.4g}"

    def telling_mark(self, quantity: Quantity) -> str:
        """Return the words for a quantity's mark; empty where all figures belong to the full load."""
        mark = quantity.mark
        asked = {other.mark for other in self.quantities} - {None}
        return "" if mark is None or asked == {FULL} else self.mark_words(mark)

    def physics(self) -> dict[str, Any]:
        """Return all that an answer depends on: no tolerances, suites or prose."""
        data = self.model_dump(mode="json", exclude=set(self.not_physics))
        for quantity in data["quantities"]:
            for name in self.not_physics_of_a_quantity:
                quantity.pop(name, None)
            if quantity["factor"] == 1.0:  # as in every case that was recorded before there were factors
                del quantity["factor"]
        return data

    def digest(self) -> str:
        """Return the hexadecimal SHA-256 of the physics."""
        text = json.dumps(self.physics(), sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()

    def without(self, names: Collection[str]) -> Self:
        """Return the same question without some of its quantities, of which none is the headline."""
        data = self.data()
        for part, key in (("quantities", "name"), ("known", "quantity")):
            if part in data:
                data[part] = [one for one in data[part] if one[key] not in names]
        return type(self).model_validate(data)

    def asked_as_well(self) -> Self | None:
        """Return the same question with data that say as much; None if its data leave no choice.

        How far the answers are apart is the data's share of the uncertainty, as of a surface that was fitted to points.
        """
        return None

    @property
    def remark(self) -> str:
        """A clause on what is to be known of every answer to it; empty if nothing is."""
        return ""

    def drifts(self, solution: Any) -> Mapping[str, float]:
        """Return how far values that have no limit move with a solver's resolution, by quantity, before its factor.

        They are added to the uncertainties that a solver states. One of more than a hundredth of its value makes the
        answer not settled.
        """
        return {}

    @property
    def undecided(self) -> str | None:
        """Return why no solution of it counts as settled, as one clause: what in its data nobody can tell; or None."""
        return None

    def check_state(self, at: float) -> None:
        """Raise InputError if no solution can be asked at this mark."""

    def data(self) -> dict[str, Any]:
        """Return the problem as JSON data from which it can be made again."""
        return self.model_dump(mode="json", exclude_unset=True)

    def shown(self) -> dict[str, Any]:
        """Return the problem's data as far as a reader looks at them."""
        return self.data()

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return case_html(self)

    @model_validator(mode="after")
    def _one_quantity_is_primary(self) -> Self:
        names = [quantity.name for quantity in self.quantities]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two of them are called '{name}': quantity names must differ")
        if sum(q.primary for q in self.quantities) != 1:
            raise ValueError("exactly one quantity must be primary")
        check_known(self.known, names)
        return self


class Settings(Model):
    """Settings of a solver that computes the same answer every time.

    A setting called `checkpoint`, a folder or None, says where an interrupted solve is kept to go on from; the
    bench gives one. Settings that can't change the answer, like that one, are declared with `exclude=True`:
    they are no part of a run's identity.
    """

    @field_validator("*", mode="before")
    @classmethod
    def _is_true_or_false(cls, value: Any, info: ValidationInfo) -> Any:
        field = cls.model_fields.get(info.field_name or "")
        if field is not None and field.annotation is bool and not isinstance(value, bool):
            raise PydanticKnownError("bool_type")
        return value


class SeededSettings(Settings):
    """Settings of a solver whose answer depends on a seed; it may run on an accelerator."""

    seed: int = Field(0, ge=0, le=2**31 - 1, strict=True, description="seed of the random numbers")
    device: Device = Field("cpu", description="where to run")


@dataclass(frozen=True)
class Capabilities:
    """What a solver can do.

    Attributes
    ----------
    theories
        Theories that it solves.
    devices
        Where it runs.
    label
        One line for tables: what the solver is, honestly.
    """

    theories: tuple[str, ...]
    label: str
    devices: tuple[Device, ...] = ("cpu",)


@dataclass(frozen=True)
class Step:
    """One entry of a solution's history: a refinement, an iteration, or a load step.

    Attributes
    ----------
    iteration
        Number of the step, from 0.
    seconds
        Wall time since the start of the solve.
    energy
        Potential energy of the step's own discretisation, J; of a step in time the kinetic energy and those of strains
        and springs, less the work done by loads and supports since rest: what has been lost or gained.
    unknowns
        Free parameters or degrees of freedom at this step.
    at
        Time, s, or load factor.
    gap
        Quadrature gap of this step, |C_train/C_fine - 1|; None where it was not measured.
    quantities
        The case's quantities at this step, by name, in SI; may be empty. Of a step of a path, its displacement
        quantities at the state of this step, whatever state they are asked for.
    phase
        "path": one equilibrium state of the final discretisation on its way from rest, in order: the
        load-displacement curve; "critical": the first state at which the shell can buckle, which is kept; "time": one
        step of a motion, in order; "solve": anything else.
    iterations
        Iterations that this step took; None where that says nothing.
    """

    iteration: int
    seconds: float
    energy: float
    unknowns: int
    at: float = 1.0
    gap: float | None = None
    quantities: Mapping[str, float] = field(default_factory=dict)
    phase: Phase = "solve"
    iterations: int | None = None


@dataclass(frozen=True)
class Progress:
    """What a running solve tells: the step it is at, of how many if it knows, and a word on it."""

    step: int
    total: int | None
    message: str


ProgressCallback = Callable[[Progress], None]


class Solution(Protocol):
    """An answer to a problem, and how it came about.

    One part is optional: `unsettled`, one clause that says why the answer has not settled, such as "centre_z still
    moves by 2e-3 when features of other kinds join". None, or no such attribute, says that it has. An answer has not
    settled either if the stated uncertainty of its headline is more than a hundredth of it.
    """

    @property
    def case(self) -> Any:
        """The problem that it answers."""
        ...

    @property
    def history(self) -> tuple[Step, ...]:
        """How it came about, in order."""
        ...

    @property
    def parameters(self) -> int:
        """Number of free parameters (degrees of freedom, weights) that were solved for or trained."""
        ...

    @property
    def storage_bytes(self) -> int:
        """Bytes needed to keep the answer, beside the problem."""
        ...

    @property
    def diagnostics(self) -> Mapping[str, Any]:
        """Figures about the solve by name, such as ``residual`` or ``energy_gap``; JSON values only."""
        ...

    @property
    def uncertainty(self) -> Mapping[str, float]:
        """The solver's own estimate of its error by quantity, in the quantity's unit; may be empty."""
        ...

    @property
    def extrapolated(self) -> Mapping[str, float]:
        """Values extrapolated from the history by quantity; they stand beside the answer and never replace it."""
        ...

    def save(self, path: Path) -> Path:
        """Write the solution (safetensors or npz, never a pickle); return the file with its suffix."""
        ...


class Solver(Protocol):
    """Something that solves problems.

    Attributes
    ----------
    name
        Name on the command line and in records.
    capabilities
        What it can do.
    settings_type
        Its settings: a subclass of `Settings`, or of `SeededSettings` if a seed matters.
    """

    name: ClassVar[str]
    capabilities: ClassVar[Capabilities]
    settings_type: ClassVar[type[Settings]]

    def declines(self, case: Any) -> str | None:
        """Return why the solver can't take this problem, as one clause, or None if it can.

        A solver that takes the problem but can't give one of its quantities has the optional method
        ``declines_quantity(case, quantity) -> str | None``, which returns why not. The quantity is recorded as
        declined, and all others are asked; see `answerable`.
        """
        ...

    def solve(
        self,
        case: Any,
        settings: Any,
        start: Solution | Path | None = None,
        progress: ProgressCallback | None = None,
    ) -> Solution:
        """Solve the problem.

        `start` is an earlier solution, or a checkpoint file of an interrupted solve, to go on from; a solver that can't
        refuses it by InputError, in one sentence.

        Raises
        ------
        SolveFailure
            If no trustworthy answer was reached; what had converged comes with it.
        InputError
            If the settings or `start` do not fit the case.
        """
        ...

    def load(self, path: Path) -> Solution:
        """Read a solution that `Solution.save` wrote."""
        ...


Account = Callable[[Any, Any, Mapping[str, float]], Sequence[Model]]
"""What makes one field of a record (see `shellbench.account`) of a solution, its problem and its values by name."""


@dataclass(frozen=True)
class Variant:
    """A way to ask the same question otherwise.

    Attributes
    ----------
    words
        What titles say of it.
    make
        Takes a problem; returns the data of the variant. It may raise InputError with the reason, as a clause, why
        the problem can't be asked so.
    """

    words: str
    make: Callable[[Any], dict[str, Any]]


def declined_quantities(solver: object, case: Problem) -> dict[str, str]:
    """Return why a solver can't give each quantity of a case that it declines, by name; empty if it gives all."""
    ask = getattr(solver, "declines_quantity", None)
    if ask is None:
        return {}
    return {q.name: why for q in case.quantities if (why := ask(case, q)) is not None}


def why_declined(solver: Solver, case: Problem) -> str | None:
    """Return why a solver can't take a case, as one clause: the case itself, or its headline; None if it can."""
    return solver.declines(case) or declined_quantities(solver, case).get(case.primary.name)


def answerable(solver: Solver, case: Problem) -> tuple[Problem, dict[str, str]]:
    """Return a case without the quantities that a solver declines, and why it declines each, by name."""
    declined = declined_quantities(solver, case)
    return (case.without(declined) if declined else case), declined


@dataclass(frozen=True)
class Kind:
    """A kind of problem, as its entry point names it.

    Attributes
    ----------
    problem
        Its problems, read from files.
    keep
        Takes a solution and its problem; returns the arrays that are kept for comparison and pictures, by name. None if
        the solution has no finite answer.
    accounts
        What else a record keeps, by the record's field: without it a run is not whole.
    studies
        What stands beside the answer, by the record's field: a study that fails is left out.
    portrait
        Takes a problem; returns what a report can ask it.
    variants
        The same question asked otherwise, by name: known values carry over.
    sample
        Takes a solution, points a side, a mark (None: the last state) and a title; returns what is exported. None if
        solutions of this kind are no surfaces.
    from_file
        Takes a file with data of a user's own, such as a mesh, and the path of a case file; returns the text of a case
        to begin with. It may raise InputError with the reason, as a clause. None if there are no such files.
    headline, headlines
        What its headline quantities are, for the heading of their table; other words by unit.
    exam, quick
        Suites by which a solver is graded, in minutes, and at a first look.
    """

    problem: type[Problem]
    keep: Callable[[Any, Any], Mapping[str, NDArray[Any]] | None]
    accounts: Mapping[str, Account] = field(default_factory=dict)
    studies: Mapping[str, Account] = field(default_factory=dict)
    portrait: Callable[[Any], Portrait] = Portrait
    variants: Mapping[str, Variant] = field(default_factory=dict)
    sample: Callable[[Any, int, float | None, str], Sample] | None = None
    from_file: Callable[[Path, Path], str] | None = None
    headline: str = "Headline figures"
    headlines: Mapping[str, str] = field(default_factory=dict)
    exam: tuple[str, ...] = ()
    quick: tuple[str, ...] = ()

    @property
    def theories(self) -> tuple[str, ...]:
        """Theories that its problems can ask for; none if they do not say which."""
        return tuple(map(str, get_args(self.problem.model_fields["theory"].annotation)))
