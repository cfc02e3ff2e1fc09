"""A process that loads code of other packages, so that the judging process never loads it.

It answers on a line (`shellbench.bench.plugins.line`) until the other end closes. The methods of a solver are:

- ``describe``: its description of itself;
- ``settings``: the checked settings;
- ``declines``: the reason why it can't take a problem;
- ``sample``: a stored solution on a grid.

The methods of a kind of problem are:

- ``describe``: its description of itself;
- ``build`` and ``rebuild``: a problem from a file, or from a record;
- ``variant``: the data of a variant.
"""

from __future__ import annotations

import contextlib
import resource
import socket
import sys
import sysconfig
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from shellbench.bench.plugins import kinds
from shellbench.bench.plugins.facts import facts_of
from shellbench.bench.plugins.line import Line
from shellbench.bench.plugins.registry import SolverEntry, load_solver
from shellbench.bench.plugins.settings import make_settings
from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Kind, Problem, Solver, declined_quantities
from shellbench.protocol.schema import one_sentence

LARGEST_OUTPUT = 1 << 30  # bytes that it may write into a file


def serve(descriptor: str, load: Callable[[], Any]) -> None:
    """Load the solver or kind, and answer on the line with this descriptor until the other end closes.

    Questions are (number, method, arguments). Answers are (number, "ok", result), or the reason of the refusal.
    """
    line = Line(socket.socket(fileno=int(descriptor)))
    kinds.load_here()
    kind, result = answer(load, ())
    line.send((0, kind, modules() if kind == "ok" else result))
    while kind == "ok":
        try:
            number, operation, arguments = line.receive()
        except EOFError:
            return
        reply = answer(getattr(result, operation), arguments)
        try:
            line.send((number, *reply))
        except (TypeError, ValueError) as error:
            line.send((number, "raised", error_line(error)))


def answer(operation: Callable[..., Any], arguments: Any) -> tuple[str, Any]:
    """Execute one method and return its status and result."""
    try:
        return "ok", operation(*arguments)
    except InputError as error:
        return "refused", " ".join(str(error).split())
    except SolveFailure as error:
        return "failed", " ".join(str(error).split())
    except KeyError as error:
        return "unknown", error_line(error)
    except BaseException as error:
        return "raised", error_line(error)


def error_line(error: BaseException) -> str:
    """Return the error as one line."""
    words = " ".join(str(error).split())
    return f"{type(error).__name__}: {words}"[:300] if words else type(error).__name__


def modules() -> list[str]:
    """Return the files of the modules imported so far, without those of Python itself."""
    found = {str(getattr(module, "__file__", None)) for module in list(sys.modules.values())}
    python = sysconfig.get_path("stdlib")
    return sorted(f for f in found if f.endswith(".py") and (not f.startswith(python) or "site-packages" in f))


class AskedSolver:
    """Methods of a solver."""

    def __init__(self, solver: Solver) -> None:
        self.solver = solver

    def describe(self) -> dict[str, Any]:
        """Return the solver's description of itself."""
        return facts_of(self.solver)

    def settings(self, overrides: Mapping[str, Any], seed: int, device: str) -> dict[str, Any]:
        """Return its settings as JSON data; InputError if it refuses them."""
        return make_settings(self.solver, overrides, seed, device).model_dump(mode="json")

    def declines(self, data: Mapping[str, Any]) -> dict[str, str | None]:
        """Return, as ``reason``, why it can't take a problem, or None."""
        case = kinds.problem_of(data)
        reason: Any = self.solver.declines(case)
        if reason is None:
            reason = declined_quantities(self.solver, case).get(case.primary.name)
        if not isinstance(reason, str | None):
            raise TypeError(f"it returned {type(reason).__name__}, which is neither a text nor None")
        return {"reason": reason}

    def sample(self, kind: str, file: str, resolution: int, at: float | None, title: str) -> dict[str, Any]:
        """Return a sample of a stored solution, field by field; InputError if it has no state there."""
        take = kinds.find_kind(kind).sample
        assert take is not None
        return vars(take(self.solver.load(Path(file)), resolution, at, title))


class AskedKind:
    """Methods of a kind of problem."""

    def __init__(self, name: str) -> None:
        self.kind: Kind = kinds.find_kind(name)

    def describe(self) -> dict[str, Any]:
        """Return the kind's description of itself."""
        kind = self.kind
        return {
            "theories": list(kind.theories),
            "variants": {name: variant.words for name, variant in kind.variants.items()},
            "headline": kind.headline,
            "headlines": dict(kind.headlines),
            "samples": kind.sample is not None,
            "exam": list(kind.exam),
            "quick": list(kind.quick),
        }

    def build(self, data: Mapping[str, Any], name: str, where: str) -> dict[str, Any]:
        """Return the facts about a problem from a file; InputError if it is malformed."""
        return problem_facts(self.kind.problem.build(data, name, where))

    def rebuild(self, data: Mapping[str, Any]) -> dict[str, Any]:
        """Return the facts about a problem from a record; InputError if it is malformed."""
        try:
            return problem_facts(self.kind.problem.model_validate(data))
        except ValidationError as error:
            raise InputError(one_sentence(error, data)) from None

    def variant(self, data: Mapping[str, Any], name: str) -> dict[str, Any]:
        """Return the data of a variant of a problem; InputError if it can't be asked so."""
        return self.kind.variants[name].make(self.kind.problem.model_validate(data))


def problem_facts(problem: Problem) -> dict[str, Any]:
    """Return the facts about a problem that the judging process needs."""
    names = ("name", "unit", "description", "primary", "at", "factor", "absolute", "tolerance", "open_finding")
    return {
        "fields": {name: getattr(problem, name) for name in ("name", "kind", "title", "description", "units", "theory")}
        | {"suites": list(problem.suites)},
        "quantities": [
            {name: getattr(quantity, name) for name in names}
            | {"kind": quantity.kind, "is_an_error": quantity.is_an_error, "mark": quantity.mark}
            for quantity in problem.quantities
        ],
        "digest": problem.digest(),
        "data": problem.data(),
        "shown": problem.shown(),
        "states": list(problem.states),
        "marks": {
            repr(float(mark)): problem.mark_words(mark)
            for mark in {*problem.states, *(q.mark for q in problem.quantities if q.mark is not None)}
        },
    }


def main(descriptor: str, what: str, name: str, target: str) -> None:
    """Serve a solver or a kind of problem."""
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_OUTPUT, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    entry = SolverEntry(name, target, "", "")
    serve(descriptor, lambda: AskedSolver(load_solver(entry)) if what == "solver" else AskedKind(name))


if __name__ == "__main__":
    main(*sys.argv[1:])
