"""Properties of a case beyond plain statics, for which a solver may decline it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import LoadQuantity, Unmarked
from shellbench.problems.shell.question.features import why_too_narrow
from shellbench.problems.shell.question.loads import AreaLoad, EdgeLoad, MomentLoad
from shellbench.problems.shell.question.places import Edge

Beyond = Literal[
    "varying stiffness",
    "orthotropic",
    "stiffening",
    "bending Poisson's ratio",
    "foundation",
    "supported parts",
    "loaded parts",
    "local supports",
    "local loads",
    "kinks",
    "folds",
    "contact",
    "modes",
    "transverse shear",
    "resultants",
    "narrow formulas",
]
"""Features of cases that not every solver of shells takes."""


def why_not_plain(case: Case, takes: frozenset[Beyond] = frozenset()) -> str | None:
    """Return the first property beyond the plainest shells that a solver does not take, as one clause, or None."""
    found = next((words for beyond, words in _properties_beyond_plain(case) if beyond not in takes), None)
    if found is None and "narrow formulas" not in takes and (where := why_too_narrow(case)) is not None:
        return f"{where}, and this solver may miss it between its points"
    return found


def _properties_beyond_plain(case: Case) -> Iterator[tuple[Beyond, str]]:
    if case.theory == "naghdi-linear":
        yield "transverse shear", "its normals shear (naghdi-linear), and this solver's theory is Kirchhoff and Love's"
    if not case.material.uniform:
        yield "varying stiffness", "its modulus or thickness varies, and this solver takes the same everywhere"
    if case.material.kind == "orthotropic":
        yield "orthotropic", "its material is orthotropic, and this solver takes isotropic ones only"
    if case.material.stiffening is not None:
        yield "stiffening", "its membrane stiffens as it stretches, and this solver takes linear materials only"
    membrane, bending = case.material.poissons_ratios
    if case.material.kind == "isotropic" and membrane != bending:
        yield (
            "bending Poisson's ratio",
            "its bending has a Poisson's ratio of its own, and this solver takes one for both",
        )
    if case.springs and case.dynamics is None:
        yield "foundation", "it rests on springs, which this solver does not take"
    if any(isinstance(place, Edge) and not place.whole for _, place in case.supported_places()):
        yield "supported parts", "a support holds a part of an edge, and this solver takes whole edges only"
    loaded = (case.places[name] for load in case.loads if isinstance(load, EdgeLoad | MomentLoad) for name in load.on)
    if any(isinstance(place, Edge) and not place.whole for place in loaded):
        yield "loaded parts", "a load acts on a part of an edge, and this solver takes whole edges only"
    if any(support.local for support in case.supports):
        yield "local supports", "a support holds directions local to the shell, and this solver takes x, y and z only"
    if any(isinstance(load, AreaLoad | EdgeLoad) and load.frame == "local" for load in case.loads):
        yield "local loads", "a load is local to the shell, and this solver takes loads along x, y and z only"
    if case.surface.fold_lines:
        yield "folds", "its surface has folds, and this solver takes smooth surfaces only"
    if any(case.kinks):
        yield "kinks", "a formula of it has kinks or jumps, and this solver takes smooth ones only"
    if case.obstacles:
        yield "contact", "it touches obstacles, which this solver does not take"
    if case.modal:
        yield "modes", "it asks for modes, and this solver finds none"


def why_not_by_load(case: Case, removed: Iterable[str]) -> str | None:
    """Return the reason that prescribing the load can't follow the path, as one clause, or None if it can.

    `removed` are names of the rigid motions that the solver has to remove.
    """
    if case.path.control != "load" or any(isinstance(q, LoadQuantity) for q in case.quantities):
        return "it follows a path by displacement or arc length, and this solver prescribes the load only"
    if case.path.after_buckling == "follow" or any(isinstance(q, Unmarked) for q in case.quantities):
        return "it asks for buckling or turning points, and this solver finds none"
    if any(name.startswith("rotation") for name in removed):
        return "it removes rotations, which are not small in the non-linear theory"
    return None
