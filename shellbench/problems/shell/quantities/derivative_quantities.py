"""Derivatives of other quantities with respect to parameters of the case.

The derivative dQ/dp is that of the exact answer: loads, supports and all other numbers of the case stay as they are. At
finite strain the state stays at its mark: at its load factor, or at its value of the path's displacement. A solution
that gives derivatives has ``derivative(quantity, parameter) -> float``; solvers without it decline these quantities.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Literal

from pydantic import model_validator

from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.quantities.quantity import ShellQuantity
from shellbench.problems.shell.question.parameters import Parameter, parameters_of
from shellbench.protocol.schema import Flag, Name

SMOOTH = (
    "displacement", "position", "centre_of_mass", "strain_energy", "membrane_energy", "bending_energy",
    "potential_energy", "reaction", "torque", "frequency", "buckling_load", "load", "limit_point", "critical_point",
    "membrane_force", "moment", "shear_force", "stress",
)  # fmt: skip
"""Kinds of quantities that are differentiable functions of the parameters."""


class DerivativeQuantity(ShellQuantity):
    """The derivative of another quantity with respect to a parameter of the case, in the units of both.

    Attributes
    ----------
    derivative_of
        Name of the other quantity, Q.
    with_respect_to
        Name of the parameter p: `material.NAME`, `loads.NUMBER` or `springs.NAME` for a factor, `surface.radius` or a
        constant of the surface, `surface.xi1_min` and the other bounds, `points.NAME.xi1` or `.xi2`.
    relative
        True for p/Q dQ/dp, which has no unit, instead of dQ/dp.
    """

    series: ClassVar[Literal["motion", "path", ""]] = ""
    kind: Literal["derivative"]
    derivative_of: Name
    with_respect_to: str
    relative: Flag = False
    unit: str = ""

    @model_validator(mode="after")
    def _has_no_state_of_its_own(self) -> DerivativeQuantity:
        if "at" in self.model_fields_set:
            raise ValueError(f"quantity '{self.name}' is measured where '{self.derivative_of}' is, and has no 'at'")
        return self

    @property
    def mark(self) -> float | None:
        """None: the other quantity marks the state."""
        return None

    def parameter(self, shell: Any) -> Parameter:
        """Return the parameter; ValueError if the shell has none of this name."""
        known = parameters_of(shell)
        if self.with_respect_to not in known:
            raise ValueError(
                f"quantity '{self.name}' is a derivative with respect to '{self.with_respect_to}', which is no"
                f" parameter of the case; known are {', '.join(known)}"
            )
        return known[self.with_respect_to]

    def check(self, shell: Any) -> None:
        """Raise ValueError if there is no such quantity or parameter, if it has no derivative, or the unit is wrong."""
        before = shell.quantities[: shell.quantities.index(self)]
        others = {q.name: q for q in before if q.kind in SMOOTH}
        if self.derivative_of not in others:
            named = next((q for q in shell.quantities if q.name == self.derivative_of), None)
            why = "no quantity of the case"
            if named:
                smooth = named.kind in SMOOTH
                why = "which must stand before it" if smooth else f"of kind '{named.kind}', which has no derivative"
            raise ValueError(
                f"quantity '{self.name}' is a derivative of '{self.derivative_of}', {why}; known are {list(others)}"
            )
        parameter, other = self.parameter(shell), others[self.derivative_of]
        if shell.dynamics is not None or shell.obstacles:
            raise ValueError(f"quantity '{self.name}' needs a shell at rest without obstacles")
        if self.primary:
            raise ValueError(f"quantity '{self.name}' can't be primary, as not every solver gives derivatives")
        expected = "" if self.relative else quotient(other.unit, parameter.unit)
        if self.unit != expected and parameter.powers is not None and shell.units == "SI":
            raise ValueError(f"quantity '{self.name}': its unit is '{self.unit}', but must be '{expected}'")

    def dimension(self, shell: Any) -> tuple[int, int]:
        """Return the powers of length and of force in its unit."""
        powers = self.parameter(shell).powers
        if self.relative or powers is None:
            return (0, 0)
        length, force = shell.quantity(self.derivative_of).dimension(shell)
        return (length - powers[0], force - powers[1])

    def words(self, case: Any, known: Callable[[str], float | None]) -> str:
        """Return its description, with the known p/Q dQ/dp if the value has a unit."""
        other, parameter = case.quantity(self.derivative_of), self.parameter(case)
        kind = "relative derivative" if self.relative else "derivative"
        text = self.description or f"{kind} of {other.name.replace('_', ' ')} by {parameter.name}"
        slope, whole = known(self.name), known(other.name)
        if self.relative or not (slope and whole and parameter.value):
            return text
        return f"{text}, relative {slope / self.factor * parameter.value / (whole / other.factor):.4g}"

    def measure(self, solution: DisplacementField) -> float:
        """Return dQ/dp, or p/Q dQ/dp; ValueError if the solution gives no derivatives."""
        case: Any = solution.case
        give = getattr(solution, "derivative", None)
        if give is None:
            raise ValueError("this solution gives no derivatives")
        other, parameter = case.quantity(self.derivative_of), self.parameter(case)
        found = float(give(other, parameter.name))
        return found * parameter.value / float(other.measure(solution)) if self.relative else found


def quotient(above: str, below: str) -> str:
    """Return the unit of a derivative from the units of both: "m/Pa", "Pa/(kg/m^2)", "1/m" or "m"."""
    if not below:
        return above
    return f"{above or '1'}/{f'({below})' if '/' in below or ' ' in below else below}"
