"""Known values in a user's case file judge the answers to it, and nothing else."""

from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.compare import rows
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import Verdict, gate
from shellbench.bench.plugins.kinds import read_problem
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from tests.bench.running import run
from tests.bench.strip import CENTRE
from tests.bench.test_compare import edit

pytestmark = pytest.mark.usefixtures("toys")


def known(path: Path, value: float = CENTRE, more: str = "tolerance = 1e-6", quantity: str = "centre") -> str:
    """Append a known value to a case file, or put it in place of the one that is there."""
    text = path.read_text(encoding="utf-8").partition("[[known]]")[0]
    path.write_text(
        f'{text}[[known]]\nquantity = "{quantity}"\nvalue = {value!r}\nsource = "closed form"\n{more}\n',
        encoding="utf-8",
    )
    return str(path)


def judged(store: Store, path: str, **more: object) -> Verdict:
    run(store, path, solvers=("toy",), **more)  # type: ignore[arg-type]
    return gate(store, None, Scope(cases=(path,)))


def colours(verdict: Verdict) -> list[tuple[str, str]]:
    return [(finding.row.quantity, finding.colour) for finding in verdict.accuracy]


def test_a_right_answer_is_green_and_a_wrong_one_red(store: Store, own_case: Path) -> None:
    verdict = judged(store, known(own_case))
    assert colours(verdict) == [("centre", "green")]
    assert verdict.good()
    row = verdict.accuracy[0].row
    assert (row.reference, row.reference_source, row.tolerance) == (CENTRE, "closed form", 1e-6)
    # What is known is no physics: the run still counts, and the file that is named judges it.
    verdict = gate(store, None, Scope(cases=(known(own_case, 1.001 * CENTRE),)))
    assert colours(verdict) == [("centre", "red")]
    assert not verdict.good()
    assert [row.passed for row in rows(store, cases=(str(own_case),)) if row.quantity == "centre"] == [False]


def test_without_the_file_the_run_says_what_was_known(store: Store, own_case: Path) -> None:
    judged(store, known(own_case))
    known(own_case, 2 * CENTRE)
    assert colours(gate(store, None, Scope())) == [("centre", "green")]


def test_a_tolerance_can_be_absolute(store: Store, own_case: Path) -> None:
    verdict = judged(store, known(own_case, CENTRE + 2e-6, "tolerance = 1e-6\nabsolute = true"))
    assert colours(verdict) == [("centre", "red")]
    verdict = gate(store, None, Scope(cases=(known(own_case, CENTRE + 2e-6, "tolerance = 3e-6\nabsolute = true"),)))
    assert colours(verdict) == [("centre", "green")]
    assert verdict.accuracy[0].row.tolerance_is_absolute


def test_without_a_tolerance_it_is_shown_and_judges_nothing(store: Store, own_case: Path) -> None:
    with pytest.raises(InputError, match="case 'own_strip': no tolerance is stated"):
        judged(store, known(own_case, 2 * CENTRE, ""))
    (row,) = (row for row in rows(store) if row.quantity == "centre")
    assert row.relative_error == pytest.approx(-0.5)
    assert row.passed is None


def test_settings_that_are_not_the_default_are_not_gated(store: Store, own_case: Path) -> None:
    with pytest.raises(InputError, match=r"case 'own_strip': only runs with default settings .* toy\.factor=0\.5$"):
        judged(store, known(own_case, 2 * CENTRE), settings={"toy": {"factor": 0.5}})


def test_a_run_of_another_shell_is_not_judged(store: Store, own_case: Path) -> None:
    known(own_case)
    run(store, str(own_case), solvers=("toy",))
    other = own_case.with_name("other.toml")
    other.write_text(own_case.read_text(encoding="utf-8"), encoding="utf-8")
    run(store, str(other), solvers=("toy",))
    for path in (own_case, other):
        edit(path, "thickness = 0.1", "thickness = 0.2")
    run(store, str(other), solvers=("toy",))  # one run of another case is left out, too: that is not said
    with pytest.raises(InputError, match="case 'own_strip': no run counts; 1 stored run is left out: the case has cha"):
        gate(store, None, Scope(cases=(str(own_case),)))


@pytest.mark.parametrize(
    ("quantity", "value", "more", "words"),
    [
        ("centr", 1.0, "", "a known value is of 'centr', which is no quantity; they are centre, energy, membrane"),
        ("centre", 1.0, "tolerance = 2.0", "has the tolerance 2, but a relative one must be less than 1"),
        ("membrane", 0.0, "tolerance = 0.1", "may be zero, so that its tolerance needs `absolute = true`"),
        ("centre", 1.0, "uncertainty = 0.1\ntolerance = 0.2", "must be at least 0.3, not 0.2"),
        ("centre", 1.0, "uncertainty = -0.1", "field 'known.0.uncertainty': found -0.1"),
        ("centre", 1.0, 'tolerance = "small"', "field 'known.0.tolerance': found 'small'"),
        ("centre", 1.0, "theory = 1", "field 'known.0.theory' is not known here"),
    ],
)
def test_what_cannot_judge_is_refused_in_one_sentence(
    own_case: Path, quantity: str, value: float, more: str, words: str
) -> None:
    with pytest.raises(InputError) as error:
        read_problem(Path(known(own_case, value, more, quantity)))
    assert str(error.value).startswith(f"{own_case}: ")
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_two_values_of_one_quantity_are_refused(own_case: Path) -> None:
    known(own_case)
    text = own_case.read_text(encoding="utf-8")
    own_case.write_text(text + text[text.index("[[known]]") :], encoding="utf-8")
    with pytest.raises(InputError, match="two known values are of 'centre'; one must judge it"):
        read_problem(own_case)


def test_a_case_of_the_suite_has_its_known_values_in_a_file_of_their_own(toys: Path) -> None:
    known(toys / "cases" / "strip.toml")
    with pytest.raises(InputError, match="field 'known' is no field of a suite's case"):
        catalog.named_case("strip")
