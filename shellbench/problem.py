"""Problem, Solution and Solver: the base of the package, and the imports of plug-ins.

A solver turns a problem into a solution, and the problem's quantities measure the solution. The bench and the report
use only these three, and no kind of problem or solver by name. Kinds of problem are found through the entry-point group
``shellbench.problems`` and solvers through ``shellbench.solvers``; built-in ones register there like others. The
definitions are in `shellbench.protocol`, one module each.
"""

from __future__ import annotations

from shellbench.protocol.kind import Account, Kind, NodalValues, Variant
from shellbench.protocol.problem import VARIANT, CaseName, Problem
from shellbench.protocol.quantity import FULL, Quantity
from shellbench.protocol.solution import FIELDS, NumberFormat, Progress, ProgressCallback, Solution, Step
from shellbench.protocol.solver import (
    Capabilities,
    Device,
    SeededSettings,
    Settings,
    Solver,
    answerable,
    declined_quantities,
    why_declined,
)

__all__ = [
    "FIELDS",
    "FULL",
    "VARIANT",
    "Account",
    "Capabilities",
    "CaseName",
    "Device",
    "Kind",
    "NodalValues",
    "NumberFormat",
    "Problem",
    "Progress",
    "ProgressCallback",
    "Quantity",
    "SeededSettings",
    "Settings",
    "Solution",
    "Solver",
    "Step",
    "Variant",
    "answerable",
    "declined_quantities",
    "why_declined",
]
