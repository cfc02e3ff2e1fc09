"""A second kind of problem: chains go from their file to the gate and the page, and the bench knows nothing of them."""

import numpy as np
import pytest

from derivations.discrete_catenary import catenary, lowest_by_angles
from shellbench.bench.catalogue import catalog
from shellbench.cli import main
from shellbench.errors import InputError, SolveFailure
from shellbench.problems.rope.case import RopeCase
from shellbench.solvers.chain.solver import ChainSolver, jacobian, residual

CASE = catalog.named_case("hanging_chain")
CHAIN = CASE.chain
WEIGHT = CHAIN.mass * CHAIN.gravity


def like(**changes):
    return CASE.model_copy(update={"chain": CHAIN.model_copy(update=changes)})


def asked(nodes, tensions):
    return {"sag": nodes[4, 1], "first_node_x": nodes[1, 0], "end_tension": tensions[0], "middle_tension": tensions[4]}


def test_the_judges_are_the_discrete_catenary():
    values = asked(*catenary(CHAIN.links, CHAIN.link_length, WEIGHT, CHAIN.span))
    for name, value in values.items():
        judge = catalog.known_values("hanging_chain").judge(name, CASE.theory)
        assert abs(judge.value - value) <= judge.uncertainty


def test_least_potential_energy_gives_the_same_chain():
    """Its links point along their tension: the horizontal part follows from two neighbours' slopes and the weight."""
    nodes = lowest_by_angles(CHAIN.links, CHAIN.link_length, WEIGHT, CHAIN.span)
    steps = np.diff(nodes, axis=0)
    slopes = -steps[:, 1] / steps[:, 0]
    horizontal = WEIGHT * (CHAIN.links - 1) / (slopes[0] - slopes[-1])
    values = asked(nodes, horizontal * np.hypot(1.0, slopes))
    for name, value in values.items():
        (origin,) = catalog.known_values("hanging_chain").of(name, "origin")
        assert abs(origin.value - value) <= origin.uncertainty


@pytest.mark.parametrize(("links", "span"), [(2, 0.1), (9, 0.899), (10, 0.5), (50, 1.0)])
def test_the_solver_finds_the_catenary_of_other_chains(links, span):
    solution = ChainSolver().solve(like(links=links, span=span), None)
    nodes, tensions = catenary(links, CHAIN.link_length, WEIGHT, span)
    assert np.abs(solution.nodes - nodes).max() < 1e-11
    assert solution.tensions == pytest.approx(tensions, rel=1e-9)


def test_the_ends_carry_the_weight_and_mirror_each_other():
    solution = ChainSolver().solve(like(drop=0.2), None)
    pulls = np.diff(solution.nodes, axis=0) * (solution.tensions / CHAIN.link_length)[:, None]
    assert pulls[-1] - pulls[0] == pytest.approx([0.0, WEIGHT * (CHAIN.links - 1)], abs=1e-9)
    mirrored = ChainSolver().solve(like(drop=-0.2), None)
    assert mirrored.tensions == pytest.approx(solution.tensions[::-1], rel=1e-9)


def test_the_jacobian_is_that_of_the_residual():
    random = np.random.default_rng(3)
    nodes, densities = random.normal(size=(CHAIN.links + 1, 2)), random.normal(size=CHAIN.links)
    direction, step = random.normal(size=3 * CHAIN.links - 2), 1e-6

    def at(share):
        moved = nodes.copy()
        moved[1:-1] += share * direction[: 2 * CHAIN.links - 2].reshape(-1, 2)
        return np.concatenate([r.ravel() for r in residual(CASE, moved, densities + share * direction[-CHAIN.links :])])

    difference = (at(step) - at(-step)) / (2 * step)
    assert jacobian(CASE, nodes, densities) @ direction == pytest.approx(difference, rel=1e-6, abs=1e-6)


def test_a_state_that_is_no_minimum_is_refused():
    with pytest.raises(SolveFailure, match="a link is pushed"):
        ChainSolver().solve(like(span=0.01), None)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"chain": CHAIN.model_dump() | {"span": 2.0}}, "the ends are 2 m apart, but the chain is 0.9 m long"),
        ({"theory": "kirchhoff-love-linear"}, "field 'theory'"),
        ({"surface": {}}, "field 'surface' is not known here"),
    ],
)
def test_bad_chains_are_refused_in_one_sentence(change, words):
    data = {key: value for key, value in CASE.data().items() if key != "name"} | change
    with pytest.raises(InputError) as caught:
        RopeCase.build(data, "chain", "chain.toml")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_solution_survives_its_file(tmp_path):
    solution = ChainSolver().solve(CASE, None)
    again = ChainSolver().load(solution.save(tmp_path / "chain"))
    assert again.case.digest() == CASE.digest()
    assert np.array_equal(again.nodes, solution.nodes)
    assert np.array_equal(again.tensions, solution.tensions)


@pytest.mark.long
def test_a_chain_goes_from_its_file_to_the_gate_and_the_page(tmp_path, capsys, monkeypatch):
    store = tmp_path / "runs"

    def command(*arguments):
        monkeypatch.setattr("sys.argv", ["shellbench", *arguments, "--store", str(store)])
        try:
            main()
        except SystemExit as ended:
            return ended.code or 0, capsys.readouterr()
        return 0, capsys.readouterr()

    assert command("run", "hanging_chain")[0] == 0
    code, said = command("gate", "--suite", "rope", "--solver", "chain")
    assert (code, "accuracy: 4 ok" in said.out) == (0, True)
    code, said = command("table", "hanging_chain")
    assert (code, "chain" in said.out, "-0.297132" in said.out) == (0, True, True)
    assert command("report", "hanging_chain", "--out", str(tmp_path / "page"))[0] == 0
    assert "Hanging chain" in (tmp_path / "page" / "rope.html").read_text()
    code, said = command("export", "hanging_chain", "--solver", "chain", "--out", str(tmp_path / "chain.obj"))
    assert (code, "no surfaces to export" in said.err) == (2, True)
