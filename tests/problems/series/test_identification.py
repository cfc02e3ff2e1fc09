"""Identification: parameters come back, their scatter is that of 200 draws, and bad questions are refused."""

import copy

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.series.identification import IdentificationCase
from shellbench.solvers.fem.identifying_solver import FemDifferencesSolver, FemIdentifySolver
from tests.families import stated

COARSE = {"identified_strip": {"cells": [6, 1]}, "identified_roof": {"cells": [12, 12]}}


@pytest.mark.parametrize("name", ["identified_strip", pytest.param("identified_roof", marks=pytest.mark.long)])
@pytest.mark.parametrize("solver", [FemIdentifySolver, FemDifferencesSolver])
def test_parameters_come_back_and_scatter_as_predicted(name, solver, tmp_path):
    case, known = catalog.named_case(name), catalog.known_values(name)
    answer = solver().solve(case, COARSE[name])
    for quantity in case.quantities:
        exact = known.judge(quantity.name, case.theory).value
        assert quantity.measure(answer) == pytest.approx(exact, rel=0.15 if quantity.kind == "scatter" else 1e-6)
    counts = answer.diagnostics
    further = 2 * len(case.unknowns) if solver is FemDifferencesSolver else 0
    assert counts["solves"] == counts["iterations"] * (1 + further)
    again = solver().load(answer.save(tmp_path / "answer"))
    assert case.primary.measure(again) == case.primary.measure(answer)


@pytest.mark.long
@pytest.mark.parametrize(("name", "cells"), [("identified_strip", [2, 1]), ("identified_roof", [4, 4])])
def test_noisy_data_give_the_predicted_scatter(name, cells):
    """The solver identifies each of 40 draws, which have the stated covariance exactly: luck plays no part."""
    data, found = stated(name), []
    noise = np.random.default_rng(11).normal(size=(40, len(data["measured"])))
    noise -= noise.mean(axis=0)
    noise = 0.01 * np.linalg.solve(np.linalg.cholesky(np.cov(noise.T)), noise.T).T
    for errors in noise:
        noisy = [d | {"value": d["value"] * (1 + e)} for d, e in zip(data["measured"], errors, strict=True)]
        case = IdentificationCase.build(data | {"measured": noisy}, name, name)
        found.append(FemIdentifySolver().solve(case, {"cells": cells}).values[0])
    predicted = FemIdentifySolver().solve(catalog.named_case(name), {"cells": cells}).values[1]
    assert np.std(found, axis=0, ddof=1) == pytest.approx(predicted, rel=0.02)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["unknowns"].update({"material.colour": 1.0}), "'material.colour' is no parameter of the shell"),
        (lambda d: d["quantities"][1].update(parameter="loads.1"), "'loads.1' is asked for, but is not among"),
        (lambda d: d.update(measured=d["measured"][:1]), "1 data can't determine 2 unknowns"),
        (lambda d: d["measured"][0].update(value=0), "a datum is zero"),
    ],
)
def test_a_question_without_an_answer_is_refused(change, words):
    data = copy.deepcopy(stated("identified_strip"))
    change(data)
    with pytest.raises(InputError, match=words):
        IdentificationCase.build(data, "asked", "asked.toml")
