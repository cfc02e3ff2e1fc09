"""Changes that make the exam easier or different turn the gate red until the lock is moved."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.expected import Scope
from shellbench.bench.judge.gate import Verdict, gate
from shellbench.bench.judge.lock import JUDGING, check_lock, lock_path, main, read_lock, todays_lock, write_lock
from shellbench.bench.judge.verdicts import as_text
from shellbench.bench.store.store import Store
from tests.bench import strip
from tests.bench.conftest import forget, tolerances_of
from tests.bench.test_compare import edit

Change = Callable[[], None]


def case_file() -> Path:
    return catalog.data_folder("cases") / "strip.toml"


def suite_file() -> Path:
    return catalog.data_folder("cases") / "suites" / "toys.toml"


def known_file() -> Path:
    return catalog.data_folder("references") / "strip.toml"


def allow(old: str, new: str, solver: str = "toy") -> None:
    edit(tolerances_of(solver), old, new)


def remove(path: Path) -> None:
    path.unlink()
    forget()


def judged(store: Store) -> tuple[Verdict, str]:
    verdict = gate(store, None, Scope())
    return verdict, as_text(verdict, "baseline")


DISARMED: list[tuple[str, Change, list[str]]] = [
    (
        "a tolerance is deleted",
        lambda: allow("membrane = { absolute = 1e-12 }\n", ""),
        ["strip membrane toy has no tolerance any more, and 1e-12 absolute is locked"],
    ),
    (
        "a solver's tolerances are deleted",
        lambda: remove(tolerances_of("toy-noisy")),
        [
            "strip is not run any more by toy-noisy with seed 0, 1, 2 in suite toys",
            "strip centre toy-noisy has no tolerance any more, and 1e-06 relative is locked",
        ],
    ),
    (
        "a tolerance is widened",
        lambda: allow("1e-9", "2e-9"),
        ["strip centre toy is allowed 2e-09 relative, and 1e-09 relative is locked"],
    ),
    (
        "a relative tolerance is absolute",
        lambda: allow("centre = 1e-9", "centre = { absolute = 1e-9 }"),
        ["strip centre toy is allowed 1e-09 absolute, and 1e-09 relative is locked"],
    ),
    (
        "an absolute tolerance is relative",
        lambda: allow("absolute", "relative"),
        ["strip membrane toy is allowed 1e-12 relative, and 1e-12 absolute is locked"],
    ),
    (
        "a figure is declared an open finding",
        lambda: allow("centre = 1e-6", 'centre = { relative = 1e-6, open_finding = "noisy" }', "toy-noisy"),
        ["strip centre toy-noisy is an open finding, and was none"],
    ),
    (
        "a figure is declared an open finding of a variant",
        lambda: allow("centre = 1e-6", 'centre = { relative = 1e-6, variants = { turned = "noisy" } }', "toy-noisy"),
        ["strip centre toy-noisy is an open finding as turned, and was none"],
    ),
    (
        "a judging value is changed",
        lambda: edit(known_file(), f"value = {strip.CENTRE!r}", "value = 0.00625000000001"),
        [
            "strip centre is judged by 0.00625000000001 (uncertainty 1e-15, kirchhoff-love-linear), not by "
            f"{strip.CENTRE!r} (uncertainty 1e-15, kirchhoff-love-linear)"
        ],
    ),
    (
        "an uncertainty is changed",
        lambda: edit(known_file(), "uncertainty = 1e-15", "uncertainty = 1e-2"),
        [
            f"strip centre is judged by {strip.CENTRE!r} (uncertainty 0.01, kirchhoff-love-linear), not by "
            f"{strip.CENTRE!r} (uncertainty 1e-15, kirchhoff-love-linear)"
        ],
    ),
    (
        "another theory judges a figure",
        lambda: edit(known_file(), 'theory = "kirchhoff-love-linear"', 'theory = "mixed"'),
        [
            f"strip centre is judged by nothing, not by {strip.CENTRE!r} (uncertainty 1e-15, kirchhoff-love-linear)",
            "strip membrane is judged by nothing, not by 0.0 (uncertainty unknown, kirchhoff-love-linear)",
        ],
    ),
    (
        "a case has left its suite",
        lambda: edit(case_file(), 'suites = ["toys"]', "suites = []"),
        ["strip has left suite toys"],
    ),
    (
        "a suite leaves out a solver",
        lambda: edit(suite_file(), '[[runs]]\nsolver = "toy-noisy"\nseeds = [0, 1, 2]\n', ""),
        ["strip is not run any more by toy-noisy with seed 0, 1, 2 in suite toys"],
    ),
    (
        "a suite leaves out a seed",
        lambda: edit(suite_file(), "seeds = [0, 1, 2]", "seeds = [0, 2]"),
        ["strip is not run any more by toy-noisy with seed 1 in suite toys"],
    ),
    (
        "a tolerance is of no quantity",
        lambda: allow("membrane", "menbrane"),
        [
            "references/tolerances/toy.toml names 'menbrane', which is no quantity of strip",
            "strip membrane toy has no tolerance any more, and 1e-12 absolute is locked",
        ],
    ),
    (
        "a tolerance is of no case",
        lambda: allow("[strip]", "[other]\ncentre = 1e-9\n\n[strip]"),
        ["references/tolerances/toy.toml names 'other', which is no case"],
    ),
    (
        "the lock is gone",
        lambda: remove(lock_path()),
        [f"{catalog.LOCK}: is not there: restore it from the repository"],
    ),
    (
        "the lock is cut off",
        lambda: lock_path().write_text('{"cases": {', encoding="utf-8") and None,
        [f"{catalog.LOCK}: it is not valid JSON"],
    ),
    (
        "the lock is of another kind",
        lambda: lock_path().write_text('{"cases": {"strip": {}}}', encoding="utf-8") and None,
        [f"{catalog.LOCK}: field 'cases.strip.digest' is missing"],
    ),
]


@pytest.mark.parametrize(("change", "sentences"), [pytest.param(*d[1:], id=d[0]) for d in DISARMED])
def test_what_disarms_the_exam_is_red_and_said(full: Store, change: Change, sentences: list[str]) -> None:
    verdict, text = judged(full)
    assert verdict.good()
    assert "lock: exam 1: 1 cases, 2 figures of what is judged, as locked" in text.splitlines()
    change()
    verdict, text = judged(full)
    assert not verdict.good()
    assert len(verdict.lock.broken) == len(sentences)
    assert check_lock(("toys",)).broken == verdict.lock.broken
    for found, expected in zip(verdict.lock.broken, sentences, strict=True):
        assert expected in found
        assert "\n" not in found
        assert f"  RED  {found}" in text.splitlines()
    assert text.splitlines()[-1] == "a gate fell short"
    write_lock()  # moved, it is the exam; only what names nothing stays red
    assert judged(full)[0].lock.broken == tuple(words for words in verdict.lock.broken if ", which is no " in words)


def test_a_gate_of_suites_looks_at_their_cases_alone(full: Store) -> None:
    (suite_file().parent / "others.toml").write_bytes(suite_file().read_bytes())
    other = strip.CASE.replace('suites = ["toys"]', 'suites = ["others"]')
    (case_file().parent / "other.toml").write_text(other, encoding="utf-8")
    (known_file().parent / "other.toml").write_text(strip.REFERENCES, encoding="utf-8")
    forget()
    write_lock()
    edit(case_file().parent / "other.toml", "thickness = 0.1", "thickness = 0.2")
    (words,) = check_lock().broken
    assert words.startswith("other is another problem")
    assert check_lock(("others",)).broken == (words,)
    assert check_lock(("toys",)).broken == ()
    assert "lock: exam 2: 1 cases, 2 figures of what is judged, as locked" in as_text(
        gate(full, None, Scope(suites=("toys",))), "baseline"
    )


def test_a_changed_case_is_red_though_no_suite_is_named(full: Store) -> None:
    then = catalog.named_case("strip").digest()
    edit(case_file(), "thickness = 0.1", "thickness = 0.2")
    verdict, _ = judged(full)
    now = catalog.named_case("strip").digest()
    assert verdict.lock.broken == (f"strip is another problem: its digest is {now[:12]}, not {then[:12]}",)


def test_the_value_of_a_figure_that_no_solver_of_ours_is_held_to_is_locked_too(full: Store) -> None:
    """A third-party solver is judged by it."""
    value = '\n[[values]]\nquantity = "energy"\nrole = "judge"\nvalue = {}\ntheory = "kirchhoff-love-linear"\n'
    rest = 'origin = "made up"\nsource = "shellbench"\n'
    known_file().write_text(known_file().read_text() + value.format(2.0) + rest)
    forget()
    write_lock()
    edit(known_file(), "value = 2.0", "value = 2.22")
    assert "strip energy is judged by 2.22" in judged(full)[0].lock.broken[0]


def test_a_case_that_is_gone_is_red(full: Store) -> None:
    (case_file().parent / "other.toml").write_text(strip.CASE, encoding="utf-8")
    (known_file().parent / "other.toml").write_text(strip.REFERENCES, encoding="utf-8")
    allow("[strip]", "[other]\ncentre = 1e-9\n\n[strip]")
    assert judged(full)[0].lock.unlocked == ("new case other",)
    write_lock()
    remove(case_file().parent / "other.toml")
    assert "other is no case that is judged any more" in judged(full)[0].lock.broken


def test_a_lock_that_is_broken_elsewhere_is_red_for_a_narrowed_gate(full: Store) -> None:
    allow("1e-6", "1e-5", "toy-noisy")
    for scope in (Scope(solvers=("toy",)), Scope(cases=("strip",), solvers=("toy",)), Scope(suites=("toys",))):
        assert not gate(full, None, scope).good()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda: allow("1e-12", "1e-13"), "strip membrane toy is allowed 1e-13 absolute instead of 1e-12 absolute"),
        (lambda: allow("membrane", "energy = 1e-3\nmembrane"), "strip energy is judged"),
        (
            lambda: allow("centre", "membrane = { absolute = 1.0 }\ncentre", "toy-noisy"),
            "strip membrane toy-noisy is gated",
        ),
        (
            lambda: edit(suite_file(), "[0, 1, 2]", "[0, 1, 2, 3]"),
            "strip is run by toy-noisy with seed 3 in suite toys",
        ),
    ],
    ids=["tightened", "another figure", "another solver", "another seed"],
)
def test_what_makes_the_exam_harder_is_said_and_not_red(full: Store, change: Change, words: str) -> None:
    change()
    verdict, text = judged(full)
    assert verdict.lock.broken == ()
    assert verdict.lock.unlocked == (words,)
    assert f"  not yet locked: {words}" in text.splitlines()


def test_an_open_finding_that_is_closed_is_not_red(full: Store) -> None:
    allow("centre = 1e-9", 'centre = { relative = 1e-9, open_finding = "locks" }')
    write_lock()
    allow("locks", "locks, as is known")  # words do not matter
    assert judged(full)[0].lock == gate(full, None, Scope()).lock
    assert judged(full)[0].lock.unlocked == ()
    allow('{ relative = 1e-9, open_finding = "locks, as is known" }', "1e-9")
    assert judged(full)[0].lock.unlocked == ("strip centre toy is no open finding any more",)


CONSTANTS = [(module, name) for module, names in JUDGING.items() for name in names]


@pytest.mark.usefixtures("toys")
@pytest.mark.parametrize(("module", "name"), CONSTANTS, ids=[name for _, name in CONSTANTS])
def test_a_constant_that_judges_is_locked(monkeypatch: pytest.MonkeyPatch, module: ModuleType, name: str) -> None:
    assert check_lock().broken == ()
    value = getattr(module, name)
    other = {tuple: lambda: (*value, 0.1), str: lambda: "float32"}.get(type(value), lambda: 100 * value)()
    monkeypatch.setattr(module, name, other)
    (words,) = check_lock().broken
    assert words.endswith(f"{name} is {other}, and {value} is locked")


@pytest.mark.usefixtures("toys")
def test_a_lock_without_its_constants_is_broken() -> None:
    old = read_lock(lock_path()).model_copy(update={"constants": {}})
    lock_path().write_text(old.model_dump_json(exclude_none=True), encoding="utf-8")
    assert len(check_lock().broken) == len(CONSTANTS)


@pytest.mark.usefixtures("toys")
def test_the_lock_is_moved_by_a_command_that_states_each_change(capsys: pytest.CaptureFixture[str]) -> None:
    allow("1e-9", "1e-8")
    before = lock_path().read_text()
    assert main([]) == 1
    shown = capsys.readouterr().out
    assert "  strip centre toy is allowed 1e-08 relative, and 1e-09 relative is locked" in shown.splitlines()
    assert lock_path().read_text() == before
    assert main(["--write"]) == 0
    assert capsys.readouterr().out.startswith(shown)
    assert main([]) == 0
    assert read_lock(lock_path()) == todays_lock().model_copy(update={"version": 2})  # another exam
    assert main(["--write"]) == 0
    assert read_lock(lock_path()).version == 2  # the same
    assert main(["--wirte"]) == 2


@pytest.mark.parametrize("variants", ["one of each kind", pytest.param("all", marks=pytest.mark.long)])
def test_the_committed_lock_is_that_of_the_committed_files(variants: str, monkeypatch: pytest.MonkeyPatch) -> None:
    locked, asked = read_lock(lock_path()), catalog.variants_asked
    if variants != "all":
        some = {name.partition("@")[2]: name for held in locked.variants.values() for name in held}.values()
        monkeypatch.setattr(
            catalog, "variants_asked", lambda suite: tuple(name for name in asked(suite) if name in some)
        )
        few = {suite: {n: d for n, d in held.items() if n in some} for suite, held in locked.variants.items()}
        locked = locked.model_copy(update={"variants": {suite: held for suite, held in few.items() if held}})
    assert locked == todays_lock().model_copy(update={"version": locked.version})


@pytest.mark.long
def test_the_lock_needs_no_solver() -> None:
    program = (
        "import sys; from shellbench.bench.judge.lock import check_lock; check_lock();"
        "print(*sorted({m.partition('.')[0] for m in sys.modules} & {'torch', 'skfem', 'pandas', 'matplotlib'}))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
