"""Files of shells of many materials: what they refuse in one sentence, the draw, and one solve a material by fem."""

import tomllib

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import portrait_of_named, read_problem
from shellbench.errors import InputError
from shellbench.solvers.fem.conditioned_solver import FemRepeatedSolver, RepeatedSettings
from shellbench.solvers.ndf.conditioned_published_solver import ConditionedPublishedSolver

NAME = "conditioned_plate"
PATH = catalog.data_folder("cases") / f"{NAME}.toml"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("thickness = [0.4, 2.0]", "thickness = [2.0, 0.4]", "found 2 to 0.4, but the first must be the smaller one"),
        ("poissons_ratio = [0.0, 0.45]", "poissons_ratio = [-0.2, 0.45]", "greater than or equal to 0"),
        (
            "[shell.points]",
            "[shell.material]\nthickness = 1.0\n[shell.points]",
            "'shell.material.thickness' is not known",
        ),
        ("material = 19", "material = 20", "is of material 20, but 20 are held out, from 0"),
        ('points = ["centre"]', 'points = ["middle"]', "in the table 'shell'"),
        ("[shell.points]", "[shell]\nmaterial = 3\n[shell.points]", r"'shell\.material': found 3, but a table is"),
        *(
            (
                "[shell.points]",
                f"[shell]\ndynamics = {found}\n[shell.points]",
                r"'shell\.dynamics': found .*, but a table is",
            )
            for found in ("5", "[1, 2]", '"ab"')
        ),
        ("count = 20", "count = 0", "greater than or equal to 1"),
    ],
)
def test_a_bad_file_is_one_sentence(tmp_path, old, new, words):
    text = PATH.read_text()
    assert old in text
    file = tmp_path / "mine.toml"
    file.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=words) as caught:
        read_problem(file)
    assert str(caught.value).count("\n") == 0


def test_materials_spread_over_the_ranges_and_follow_the_seed():
    case = catalog.named_case(NAME)
    h, e, nu = np.array(case.materials).T
    assert h.min() < 0.55
    assert h.max() > 1.5
    assert np.log10(e.max() / e.min()) > 0.7
    assert nu.max() - nu.min() > 0.25
    other = case.model_copy(update={"held_out": case.held_out.model_copy(update={"seed": 21})})
    assert set(other.__class__.model_validate(other.model_dump()).materials).isdisjoint(case.materials)
    assert set(portrait_of_named(case).materials) == {q.name for q in case.quantities if q.kind == "value"}


def test_who_solves_shells_at_rest_alone_declines_one_that_moves():
    moving = catalog.named_case("conditioned_napkin")
    assert ConditionedPublishedSolver().declines(moving) == f"it does not solve the theory {moving.theory}"


def test_fem_solves_each_material_and_derives_by_differences(tmp_path):
    data = tomllib.loads(PATH.read_text())
    data["held_out"]["count"] = 1
    data["quantities"] = [q for q in data["quantities"] if q["name"] in ("value_00", "by_thickness_00")]
    case = catalog.named_case(NAME).build(data, "two", "two")
    found = FemRepeatedSolver().solve(case, RepeatedSettings(cells=(1, 1)))
    for name, error in (("value_00", 1e-6), ("by_thickness_00", 1e-8)):
        known = catalog.known_values(NAME).judge(name, case.theory).value
        assert case.quantity(name).measure(found) == pytest.approx(known, rel=error)
    assert not found.uncertainty  # of one mesh nothing is known
    again = FemRepeatedSolver().load(found.save(tmp_path / "found"))
    assert again.value(0) == found.value(0)
