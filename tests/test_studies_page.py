"""The page on studies of motion shows what is kept of their runs."""

import re

import numpy as np
import pytest

from docs import studies, studies_page


def test_the_tables_of_the_page_are_those_of_the_kept_runs():
    text = studies_page.PAGE.read_text(encoding="utf-8")
    names = re.findall(r"<!-- table (\w+) -->", text)
    assert set(names) == studies_page.TABLES.keys()
    for name in names:
        assert "\n".join(studies_page.TABLES[name]()) in text, "write it anew by `python docs/studies_page.py`"


def test_each_kept_line_is_that_of_a_declared_run():
    """Only the last study's lines are made of another's runs."""
    for name, study in studies.STUDIES.items():
        kept = [(line["case"], line["solver"], line["settings"], line["seed"]) for line in studies_page.lines_of(name)]
        assert kept == [(run.case, run.solver, run.settings, run.seed) for run in study()]


def test_the_least_functional_of_a_free_fall_is_that_of_its_closed_form():
    t, weights = np.polynomial.legendre.leggauss(4)
    t, weights = (t + 1) / 2, weights / 2

    def functional(way, speed):
        return studies_page.AREA_DENSITY * weights @ (speed(t) ** 2 / 2 - studies_page.GRAVITY * way(t))

    g = studies_page.GRAVITY
    least = functional(lambda t: g * (t - t**2 / 2), lambda t: g * (1 - t))
    assert pytest.approx(least, rel=1e-14) == studies_page.LEAST
    assert functional(lambda t: g * t**2 / 2, lambda t: g * t) > least
