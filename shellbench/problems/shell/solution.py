"""The common part of solutions of shells, which contains no mechanics.

The solution of a solver is a subclass. The subclass implements the answers at points (`displacement_at`, `field_at`,
`energies`, `reaction_at`) and the content of a file beside the case and the history (`kept`, `restored`). It names the
arrays that the displacement is made of (`numbers`). The base provides shapes of points, files, rounding, bytes, the
zero velocity of static cases, and one sentence for each wrong question. It contains no strain, energy or load: these
are each solver's own.

The common part of solvers of shells: checks of a case and of settings before anything is solved.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.errors import InputError
from shellbench.problem import FIELDS, NumberFormat, ProgressCallback, Solution, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import Beyond, why_not_plain
from shellbench.problems.shell.field import RESULTANTS
from shellbench.problems.shell.quantities.quantities import DerivativeQuantity, PlacedQuantity, SupportQuantity
from shellbench.problems.shell.question.contact import Touch
from shellbench.problems.shell.variants.edit import why_no_edit
from shellbench.problems.shell.variants.slopes import DERIVATIVES, from_energies, key, why_not_from_energies
from shellbench.problems.shortened import shortened as shortened
from shellbench.problems.solving import CheckedSolver
from shellbench.protocol.notebook import solution_html

Array = NDArray[np.float64]

Arrays = Mapping[str, NDArray[Any]]
Words = Mapping[str, Any]

SLACK = 1e-9  # of the largest mark: allowed difference of a mark from a state's own
DAMAGE = (ValueError, KeyError, TypeError, EOFError, IndexError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True, kw_only=True)
class ShellSolution:
    """Base of the solutions of shells; see `shellbench.problem.Solution` for the protocol.

    A subclass has `case` and `parameters`, as fields or as properties.

    Attributes
    ----------
    formats
        Formats of files: `save` writes the first one, such as "mine, format 1", and `load` reads them all.
    numbers
        Names of the arrays that the displacement is made of: they are counted, and rounded.
    history, diagnostics, uncertainty, extrapolated, unsettled
        See `shellbench.problem.Solution`.
    mode_values
        Values by number, if the case asks for modes (see `shellbench.problems.shell.quantities.modes`).
    """

    formats: ClassVar[tuple[str | int, ...]] = ()
    numbers: ClassVar[tuple[str, ...]] = ()

    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)
    unsettled: str | None = None
    mode_values: Mapping[int, float] = field(default_factory=dict)

    if TYPE_CHECKING:  # not attributes of the base: these would become default values of the fields

        @property
        def case(self) -> Case:
            """The case it answers."""

        @property
        def parameters(self) -> int:
            """Number of free parameters that were solved for."""

    @property
    def storage_bytes(self) -> int:
        """Bytes of the arrays that the displacement is made of."""
        return sum(int(getattr(self, name).nbytes) for name in self.numbers)

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows."""
        return solution_html(self)

    def displacement(
        self, points: ArrayLike, at: float | None = None, material: Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3) in metres at points (..., 2), angles in radians.

        Raises
        ------
        InputError
            If a material is given: the field is that of the case's own material.
        """
        if material is not None:
            raise InputError(f"{self.case.name}: this field is of the case's own material, and takes no other one")
        return self._on_points(points, lambda xi: self.displacement_at(xi, at))

    def velocity(self, points: ArrayLike, at: float | None = None) -> Array:
        """Return the velocity (..., 3) in m/s at points (..., 2)."""
        return self._on_points(points, lambda xi: self.velocity_at(xi, at))

    def evaluate(self, name: str, points: ArrayLike, at: float | None = None) -> Array:
        """Return one of `shellbench.problem.FIELDS` or `RESULTANTS` at points (..., 2); KeyError for another name."""
        if name in RESULTANTS:
            return self._on_points(points, lambda xi: self.resultant_at(name, xi, at))
        if name not in FIELDS:
            raise KeyError(name)
        return self._on_points(points, lambda xi: self.field_at(name, xi, at))

    def _on_points(self, points: ArrayLike, function: Callable[[Array], Array]) -> Array:
        """Return the values at points (..., 2) of a function of points (N, 2), which is never called with no points."""
        xi = np.asarray(points, dtype=float)
        values = function(xi.reshape(-1, 2) if xi.size else self.case.surface.domain.grid(3, 3)[1:2, 1])
        return np.asarray(values[: xi.size // 2].reshape((*xi.shape[:-1], *values.shape[1:])))

    def reaction(
        self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None
    ) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        Raises
        ------
        InputError
            If no support has this name.
        """
        names = [s.name for s in self.case.supports]
        if support not in names:
            raise InputError(f"{self.case.name}: no support is called '{support}'; known are {', '.join(names)}")
        return self.reaction_at(names.index(support), np.asarray(centre, dtype=float), at)

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        raise NotImplementedError

    def velocity_at(self, xi: Array, at: float | None) -> Array:
        """Return the velocity (N, 3) at points (N, 2): zero in a static case."""
        return np.zeros((len(xi), 3))

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2)."""
        raise NotImplementedError

    def resultant_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return membrane forces or moments (N, 3), or shear forces (N, 2), at points (N, 2)."""
        raise InputError(f"{self.case.name}: this solution states no stress resultants")

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J."""
        raise NotImplementedError

    def derivative(self, quantity: Any, parameter: str) -> float:
        """Return dQ/dp of a quantity of the case: by kept differences, or from energies (see `variants.slopes`).

        Raises
        ------
        ValueError
            If neither gives it.
        """
        kept = self.diagnostics.get(DERIVATIVES, {})
        name = key(quantity.name, parameter)
        return float(kept[name]) if name in kept else from_energies(self, quantity, parameter)

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force and moment about `centre` (3,) of the case's support of this number."""
        raise NotImplementedError

    def touch(self, at: float | None = None) -> Touch:
        """Return the contact forces of obstacles on the shell; InputError if the solver knows none."""
        raise InputError(f"{self.case.name}: this solution knows no obstacles")

    def rounded(self, format: NumberFormat) -> tuple[Self, int]:
        """Return the solution with the arrays of `numbers` rounded to a format, and the bytes it takes.

        Each is scaled by its largest magnitude before (see `shellbench.problems.shell.solution`).
        """
        changed: dict[str, Any] = {}
        bytes_taken = self.storage_bytes
        for name in self.numbers:
            array = getattr(self, name)
            short = shortened(array, format)
            bytes_taken += short.nbytes - array.nbytes
            if short.numbers is not array:
                changed[name] = short.expanded()
        return (replace(self, **changed) if changed else self), bytes_taken

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data that `restored` needs of a file: JSON values and arrays by name."""
        return {}, {name: getattr(self, name) for name in self.numbers}

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> Self:
        """Make a solution from the data of `kept`; ValueError or KeyError if they are inconsistent."""
        raise NotImplementedError

    def facts(self) -> dict[str, Any]:
        """Return the data that every file holds: the case, the history and the results of the solve."""
        modes = {"mode_values": {str(number): value for number, value in self.mode_values.items()}}
        return {
            **(modes if self.mode_values else {}),
            "case_name": self.case.name,
            "case": self.case.model_dump(mode="json", exclude_unset=True, exclude={"name"}),
            "history": self.history,
            "diagnostics": dict(self.diagnostics),
            "uncertainty": dict(self.uncertainty),
            "extrapolated": dict(self.extrapolated),
            "unsettled": self.unsettled,
        }

    def save(self, path: Path) -> Path:
        """Write an npz file without pickles; return its path, which ends in .npz."""
        target = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
        words, arrays = self.kept()
        facts = {"format": self.formats[0], "parameters": self.parameters, **self.facts(), **words}
        np.savez(target, allow_pickle=False, words=np.asarray(json.dumps(facts, default=asdict)), **arrays)
        return target

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file of `save`; InputError in one sentence if it is missing, damaged, or another file."""
        return read_solution(path, cls.formats, lambda case: cls)


S = TypeVar("S", bound=ShellSolution)


def read_solution(path: Path, formats: Sequence[str | int], kind: Callable[[Case], type[S]]) -> S:
    """Read a file that `ShellSolution.save` wrote, or one of an earlier format; `kind` chooses its class by its case.

    Raises
    ------
    InputError
        In one sentence, if the file is missing, damaged, or not of one of the formats.
    """
    solver = str(formats[0]).partition(",")[0]
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
        words = json.loads(str(arrays.pop("words")))
        if words.get("format", words.get("mark", str(arrays.get("mark")))) not in formats:
            raise ValueError("of another format")
        case = Case.model_validate({**words["case"], "name": words.get("case_name", words.get("name"))})
        return replace(
            kind(case).restored(case, words, arrays),
            history=tuple(Step(**step) for step in words["history"]),
            diagnostics=words["diagnostics"],
            uncertainty=words.get("uncertainty", {}),
            extrapolated=words.get("extrapolated", {}),
            unsettled=words.get("unsettled"),
            mode_values={int(number): value for number, value in words.get("mode_values", {}).items()},
        )
    except OSError as error:
        raise InputError(f"{path}: can't be read as a solution of {solver} ({error.strerror or 'damaged'})") from None
    except DAMAGE:
        raise InputError(f"{path}: is damaged, or not a solution of {solver}") from None


def state_number(case: Case, marks: ArrayLike, at: float | None) -> int:
    """Return the number of the state at a mark; of the last state if None.

    Raises
    ------
    InputError
        If the case has no state at the mark.
    """
    known = np.asarray(marks, dtype=float)
    if at is None:
        return len(known) - 1
    nearest = int(np.argmin(np.abs(known - at)))
    if not abs(known[nearest] - at) <= SLACK * np.abs(known).max():
        raise InputError(f"{case.name}: solved at {', '.join(f'{mark:g}' for mark in known)}, not at {at:g}")
    return nearest


def time_reached(case: Case, last: float, at: float | None) -> float:
    """Return a time, s, from 0 to the last one that a motion reached; None stands for the last one.

    Raises
    ------
    InputError
        If the motion did not reach it.
    """
    if at is None:
        return last
    if not -SLACK * last <= at <= (1 + SLACK) * last:
        raise InputError(f"{case.name}: solved from 0 to {last:g} s, not at {at:g} s")
    return min(max(float(at), 0.0), last)


class ShellSolver(CheckedSolver):
    """Base of the solvers of shells; see `shellbench.problem.Solver` for the protocol.

    A subclass gives `answer` and `load`, and `declines` if it can't take all cases of its theories. The module of the
    subclass is light: it imports the modules that solve only when it is called.

    Attributes
    ----------
    takes
        Properties beyond the plainest shells that it takes; it declines cases with more.
    reactions
        False if its solutions have no forces of supports.
    slopes
        Origin of its derivatives with respect to parameters; empty if it gives none.
    """

    takes: ClassVar[frozenset[Beyond]] = frozenset()
    reactions: ClassVar[bool] = True
    slopes: ClassVar[Literal["", "energies", "differences"]] = ""

    def declines(self, case: Case) -> str | None:
        """Return the reason that the solver declines a case, as one clause, or None if it takes it."""
        if case.theory not in self.capabilities.theories:
            return f"it does not solve the theory {case.theory}"
        return why_not_plain(case, self.takes)

    def declines_quantity(self, case: Case, quantity: Any) -> str | None:
        """Return the reason that it can't give a quantity of a case that it takes, as one clause, or None if it can."""
        if isinstance(quantity, PlacedQuantity) and "resultants" not in self.takes:
            return "this solver states no stress resultants"
        if isinstance(quantity, SupportQuantity) and not self.reactions:
            return "this solver computes no reactions"
        if not isinstance(quantity, DerivativeQuantity):
            return None
        other: Any = case.quantity(quantity.derivative_of)
        if not self.slopes:
            return "this solver gives no derivatives"
        if refusal := self.declines_quantity(case, other):
            return refusal
        if self.slopes == "energies":
            return why_not_from_energies(case, other, quantity.with_respect_to)
        parameter = quantity.parameter(case)
        return "its differences move no bounds and no points" if parameter.bound or parameter.point else None

    def answer_from(
        self, start: Solution | Path | None, case: Case, settings: Any, progress: ProgressCallback
    ) -> Solution:
        """Solve a case that is not declined; see `answer`."""
        return self.answer(case, settings, start, progress)

    def answer(self, case: Case, settings: Any, start: Solution | Path | None, progress: ProgressCallback) -> Solution:
        """Solve a case that is not declined; see `solve`."""
        raise NotImplementedError

    def load(self, path: Path) -> Solution:
        """Read a file of `Solution.save`; InputError in one sentence if it is no such file."""
        raise NotImplementedError


def checked_start(start: Solution, case: Case, solver: str, *kinds: type[S]) -> S:
    """Return an earlier solution to continue from; InputError if it is of another class or no edit."""
    if case.dynamics is not None:
        raise InputError(f"{solver} can't go on from an earlier solution in {case.name}: a motion begins at rest")
    if not isinstance(start, kinds):
        raise InputError(f"the start is no solution of '{solver}' at rest")
    if reason := why_no_edit(start.case, case):
        raise InputError(f"the start is '{start.case.name}', of which '{case.name}' is no edit: {reason}")
    return start
