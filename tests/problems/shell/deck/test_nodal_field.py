"""Nodal results of other programs: measured between nodes, on the whole or a part, in any units; faults are found."""

import meshio
import numpy as np
import pytest

import shellbench
from shellbench.errors import InputError
from shellbench.problems.shell.deck import cells, nodal_field
from shellbench.problems.shell.deck.cells import MESHIO, Mesh
from shellbench.problems.shell.deck.deck import Deck
from shellbench.problems.shell.deck.nodal_field import NodalField, measure_nodes, read_nodes
from shellbench.problems.shell.posed.mirrors import Mirror
from shellbench.problems.shell.symmetry.symmetry import part_of, whole_of

PLATE, ROOF, CYLINDER = (shellbench.case(n) for n in ("square_plate", "scordelis_lo", "pinched_cylinder_free"))


def symmetric(part, points):
    """A displacement that is linear in the coordinates of the part, and has its planes of symmetry."""
    folded = part.fold(points)
    share = (folded.points - part.lower) / np.subtract(part.upper, part.lower)
    u = np.stack([1 + share[:, 0], 2 - share[:, 1], 1 + share @ [2, 1]], axis=-1)
    for mirror in part.mirrors:
        u[:, mirror.normal] = folded.points[:, mirror.axis] - mirror.at
    return u * folded.signs


def written(path, case, shape, whole=False, unit=1.0, strewn=0.2):
    """Write a file of the field on a mesh, its nodes shuffled and in other units; return the positions of nodes.

    A part is the mirror image of that of `part_of`.
    """
    part = part_of(case)
    deck = Deck.of(whole_of(case) if whole else part, (8, 12), shape, 0.0 if whole else strewn)
    order = np.random.default_rng(2).permutation(len(deck.nodes))
    x, u, mirror = deck.nodes[order], symmetric(part, deck.grid.nodes)[order], part.mirrors[-1]
    x, u = (unit * x, unit * u) if whole else (unit * mirror.reflected_positions(x), unit * mirror.signs * u)
    if path.suffix == ".csv":
        np.savetxt(path, np.hstack([x, u]), "%.17g", ",", header="x,y,z,ux,uy,uz", comments="")
    else:
        mesh = meshio.Mesh(x, [(MESHIO[shape], np.argsort(order)[deck.cells])], {"U": u, "forces": 0 * u})
        meshio.write(path, mesh)
    return x


def largest_error(path, case, unit=1.0):
    positions, moved, found = read_nodes(path)
    points = np.random.default_rng(3).uniform(case.surface.domain.lower, case.surface.domain.upper, (200, 2))
    there = NodalField.on(case, positions / unit, moved / unit, found).displacement(points)
    return np.abs(there / symmetric(part_of(case), points) - 1).max()


@pytest.mark.parametrize("whole", [False, True], ids=["part", "whole"])
@pytest.mark.parametrize("case", [ROOF, CYLINDER], ids=lambda case: case.name)
@pytest.mark.parametrize("shape", [*MESHIO, "csv"])
def test_the_field_between_shuffled_nodes_in_another_unit(tmp_path, shape, case, whole):
    path = tmp_path / ("a.csv" if shape == "csv" else "a.vtu")
    written(path, case, "quad4" if shape == "csv" else shape, whole, 1e3)
    assert largest_error(path, case, 1e3) < 1e-7
    found = measure_nodes(case, path, 1e-3)
    assert found.share == pytest.approx(1 if whole else 1 / part_of(case).copies, rel=1e-6)
    at = case.primary.coordinates(NodalField(part_of(case), (), np.zeros((1, 3))))
    expected = np.mean(np.sum(symmetric(part_of(case), at) * case.primary.directions, axis=-1))
    assert found.values[case.primary.name] == pytest.approx(expected, rel=1e-9)


FAULTS = {
    "a mirror without its sign": (Mirror, "signs", np.ones(3)),
    "a cell's nodes in another order": (
        nodal_field,
        "shapes_at",
        lambda *a: tuple(v[:, ::-1] for v in cells.shapes_at(*a)),
    ),
    "the nearest node": (nodal_field, "shapes_at", lambda *a: (np.round(cells.shapes_at(*a)[0]), None)),
    "the nearest cell's middle": (
        Mesh,
        "locate",
        lambda self, p: (self._finder[0].query(p)[1], 0 * p + 0.5, 0 * p[:, 0]),
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_measuring_is_found(tmp_path, monkeypatch, fault):
    written(tmp_path / "a.vtu", ROOF, "quad4")
    monkeypatch.setattr(*FAULTS[fault])
    assert largest_error(tmp_path / "a.vtu", ROOF) > 1e-2


def test_rigid_motions_that_the_case_removes_are_taken_out(tmp_path):
    written(tmp_path / "a.csv", ROOF, "quad4", whole=True)
    rows = np.loadtxt(tmp_path / "a.csv", delimiter=",", skiprows=1)
    found = [NodalField.on(ROOF, rows[:, :3], rows[:, 3:] + [0, 0, by], []).displacement([[1.0, 9.0]]) for by in (0, 7)]
    np.testing.assert_allclose(found[1], found[0], rtol=1e-12)


def test_what_is_not_nodal_results_of_this_shell_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    x = written(path, ROOF, "quad4")
    for case, factor, why in ((PLATE, 1.0, "not the shell of case 'square_plate'"), (ROOF, 1e-3, "other --units?")):
        with pytest.raises(InputError, match=why):
            measure_nodes(case, path, factor)
    kept = x[:, 2] > 30
    np.savetxt(path, np.hstack([x, x])[kept], "%.9g", ",", header="x,y,z,ux,uy,uz", comments="")
    with pytest.raises(InputError, match=r"a.csv: (point '\w+'|the point) at \(.*\) lies outside of the mesh"):
        measure_nodes(ROOF, path, 1.0)
    good = path.read_text().splitlines()
    for found in ("nan", '"1,5"', "much"):
        path.write_text("\n".join([*good[:5], ",".join([*good[5].split(",")[:4], found, "0"]), *good[6:]]))
        with pytest.raises(InputError, match=r"a.csv: line 6, field 'uy': found no finite number"):
            measure_nodes(ROOF, path, 1.0)
