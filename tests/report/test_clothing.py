"""Section "Clothing": splits side by side, the best method first, spreads over seeds, and the worst meshes."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.kinds import portrait_of_named
from shellbench.report.data.evidence import Evidence
from shellbench.report.studies import clothing

CLIPS, FRAMES = "cape_clips", "cape_frames"
FACTS = {"suite": "skinning", "at": 1.0, "status": "ok", "reference": None, "settings": {}}


def rows(solver, errors, case=CLIPS):
    return [
        Row(
            case=case, case_title=case, solver=solver, seed=seed, quantity=quantity, primary=quantity == "error",
            value=error * factor, unit=unit, run_id=f"{case} {solver} {seed}", **FACTS,
        )
        for seed, error in enumerate(errors)
        for quantity, factor, unit in (("error", 1.0, "m"), ("inside", 10.0, ""))
    ]  # fmt: skip


FOUND = [*rows("far", [0.02, 0.04]), *rows("near", [0.01]), *rows("far", [0.005], FRAMES)]


def test_cases_stand_side_by_side():
    lines = {line["solution"]: line for line in clothing.by_split(FOUND).data.to_dict("records")}
    assert (lines["far"][CLIPS], lines["far"][FRAMES]) == pytest.approx((0.03, 0.005))
    assert lines["far"][CLIPS + clothing.SPREAD] == pytest.approx(0.02 / np.sqrt(2))
    assert np.isnan(lines["near"][FRAMES])
    assert clothing.by_split(rows("near", [0.01])) is None


def test_the_best_method_comes_first_with_all_its_figures(tmp_path):
    table = clothing.by_method(Evidence({}, FOUND, tmp_path), FOUND)
    assert [line["solution"] for line in table.data.to_dict("records")] == ["near", "far", "far"]
    first, second, _ = table.data.to_dict("records")
    assert (first["seeds"], second["seeds"], second["inside"]) == (1, 2, pytest.approx(0.3))
    text = table.write("text")
    assert "30.0 ± 14" in text
    assert "inside" in text


def test_worst_meshes_are_drawn_with_their_distance(tmp_path):
    case = catalog.named_case(CLIPS)
    names = portrait_of_named(case).worst
    truth = case.cape.rest()
    np.savez(tmp_path / "kept.npz", **dict(zip(names, (truth, truth + np.array([0.0, 0.03, 0.04])), strict=True)))

    class Kept:
        fields_file = "kept.npz"

    near = [row for row in FOUND if row.solver == "near"]
    found = Evidence({near[0].run_id: Kept()}, near, tmp_path)
    (exhibit,) = clothing.worst_exhibits(found, near, {CLIPS: names})
    assert exhibit.description == "near: up to 0.05 m"
    assert portrait_of_named(catalog.named_case("rope_nine_links")).worst is None
