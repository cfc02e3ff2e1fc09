"""Check of a solver's derivatives: by differences of its own answers, and by the sum rule, which needs no known value.

If all lengths of a shell grow by a factor s at constant moduli, and forces F, forces per length n and moments per
length m by s^2, s and s^2, strains stay; a quantity of dimension Pa^a length^d grows by s^d. The derivative by s, at
s = 1, is the sum rule: with L the lengths and F Q_F the derivative by the factor of a force,

    sum of L Q_L + 2 F Q_F + n Q_n + 2 m Q_m - k Q_k = d Q,

k the springs per volume; loads per area do not count. It holds at finite strain, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.derivative_quantities import quotient
from shellbench.problems.shell.question.conditions import Rotation
from shellbench.problems.shell.question.loads import EdgeLoad, MomentLoad, PointLoad
from shellbench.problems.shell.question.parameters import Parameter, changed, parameters_of
from shellbench.testing.examination import Examination, Findings, Verdict, not_applicable, own_uncertainty

CHANGES = (-0.02, -0.01, 0.01, 0.02)  # of a parameter, for a difference of fourth order
WEIGHTS = np.array([1, -8, 8, -1]) / 12 / 0.01
MOST = 1e-4  # largest error of a derivative, of Q/p, and of the sum rule, of Q; or thrice the stated uncertainty
COMPARED = ("material.youngs_modulus", "material.thickness")  # by differences


def sum_rule_weights(case: Case) -> Mapping[str, float] | None:
    """Return the factor of p Q_p in the sum rule, by parameter; None if the case has lengths that are no parameters."""
    surface, found = case.surface, parameters_of(case)
    formulas = [*(f for load in case.loads for f in load.formulas), *(s.stiffness for s in case.springs)]
    varying = [*formulas, case.material.modulus_factor, case.material.thickness_factor]
    moved = any(s.motion is not None and not isinstance(s.motion, Rotation) for s in case.supports)
    hidden = surface.kind not in ("plane", "cylinder") or case.edge_parts or surface.fold_lines or moved
    if hidden or any(case.formula(f).depends_on(name) for f in varying for name in ("xi1", "xi2")):
        return None
    powers = {PointLoad: 2.0, MomentLoad: 2.0, EdgeLoad: 1.0}
    weights = {f"loads.{number}": powers.get(type(load), 0.0) for number, load in enumerate(case.loads, start=1)}
    weights |= {f"springs.{spring.name}": -1.0 for spring in case.springs}
    lengths = {p.name: 1.0 for p in found.values() if p.powers == (1, 0)}
    return {name: weight for name, weight in (lengths | weights).items() if weight}


def derivatives(exam: Examination, case: Case) -> Verdict:
    """Check derivatives of the headline with respect to modulus and thickness, and the sum rule."""
    if case.dynamics is not None or case.obstacles or case.modal:
        return not_applicable("it needs a shell at rest without obstacles")
    if not exam.solve(case).facts["derivatives"]:
        return not_applicable("it gives no derivatives")
    rule = sum_rule_weights(case) or {}
    known = parameters_of(case)
    names = [*COMPARED, *(name for name in rule if name not in COMPARED)]
    asked = Case.model_validate(case.data() | {"name": case.name, "suites": [], "quantities": _quantities(case, names)})
    answer = exam.solve(asked)
    values = dict(answer.subject.call("derivatives", answer.key))
    given = {name: values[key] for key, name in zip(map(_key, range(len(names))), names, strict=True) if key in values}
    if not given:
        return not_applicable("it gives no derivatives")
    findings, q = Findings(), answer.headline()
    headline: Any = case.primary
    limit = max(MOST, 3 * own_uncertainty(answer))
    for name in COMPARED:
        if name in given:
            difference = sum(
                w * exam.solve(_changed(case, known[name], share)).headline()
                for w, share in zip(WEIGHTS, CHANGES, strict=True)
            )
            error = abs(given[name] * known[name].value - difference) / abs(q)
            findings.hold(error <= limit, f"by {name} it is off by {error:.1e} of Q/p", f"{name} {error:.1e}")
    if rule and rule.keys() <= given.keys():
        total = sum(weight * given[name] * known[name].value for name, weight in rule.items())
        length, force = headline.dimension(case)
        error = abs(total - (length + 2 * force) * q) / abs(q)
        findings.hold(error <= limit, f"the sum rule is missed by {error:.1e}", f"sum rule {error:.1e}")
    return findings.verdict()


def _key(number: int) -> str:
    return f"derivative_{number}"


def _quantities(case: Case, names: list[str]) -> list[dict[str, Any]]:
    headline = case.primary.model_dump(mode="json", exclude_unset=True)
    by = [
        {"name": _key(k), "kind": "derivative", "derivative_of": case.primary.name, "with_respect_to": name}
        for k, name in enumerate(names)
    ]
    units = parameters_of(case)
    return [headline, *({**d, "unit": quotient(case.primary.unit, units[d["with_respect_to"]].unit)} for d in by)]


def _changed(case: Case, parameter: Parameter, share: float) -> Case:
    data = changed(case, parameter, parameter.value * (1 + share)).data()
    return Case.model_validate(data | {"name": case.name, "suites": []})
