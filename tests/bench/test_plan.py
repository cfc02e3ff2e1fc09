"""Plans that follow from requests."""

from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import problem_of
from shellbench.bench.plugins.registry import find_solver, load_solver, solver_entries
from shellbench.bench.plugins.settings import parse_setting
from shellbench.bench.run.plan import Plan, Request, make_plan, wanted_runs
from shellbench.bench.store import environment
from shellbench.bench.store.store import Contents, Store
from shellbench.bench.store.task import Task
from shellbench.errors import InputError
from shellbench.problems.shell.case import Case, build_case, read_case
from shellbench.protocol.schema import read_toml
from tests.bench import strip
from tests.bench.running import run
from tests.families import with_something_new

NOTHING = Contents(())


def plan(*cases: str, **more: Any) -> Plan:
    return make_plan(Request(cases=tuple(map(str, cases)), **more), NOTHING)


def runs(made: Plan) -> list[tuple[str, str, int | None]]:
    return [(t.case_name, t.identity.solver, t.identity.seed) for t in made.tasks]


def test_a_suite_runs_what_it_declares(toys: Path) -> None:
    made = plan(suites=("toys",))
    assert runs(made) == [
        ("strip", "toy", None),
        *(("strip", "toy-noisy", s) for s in (0, 1, 2)),
        ("strip", "toy", None),
    ]
    assert [t.identity.settings["factor"] for t in made.tasks if t.identity.solver == "toy"] == [1.0, 0.5]


def test_a_named_solver_narrows_a_suite_and_seeds_replace_its_own(toys: Path) -> None:
    assert runs(plan(suites=("toys",), solvers=("toy-noisy",), seeds=(7,))) == [("strip", "toy-noisy", 7)]


def test_a_solver_that_a_suite_has_not_joins_with_its_defaults(toys: Path) -> None:
    suite = toys / "cases" / "suites" / "toys.toml"
    suite.write_text('title = "Toys"\n[[runs]]\nsolver = "toy"\n', encoding="utf-8")
    catalog.find_suite.cache_clear()
    assert runs(plan(suites=("toys",), solvers=("toy", "toy-noisy"))) == [
        ("strip", "toy", None),
        ("strip", "toy-noisy", 0),
    ]


def test_a_case_of_the_suite_runs_as_its_first_suite_declares(toys: Path) -> None:
    assert runs(plan("strip")) == runs(plan(suites=("toys",)))


def test_a_deterministic_solver_runs_once_whatever_the_seeds(toys: Path) -> None:
    assert runs(plan("strip", solvers=("toy",), seeds=(0, 1, 2))) == [("strip", "toy", None)]


def test_an_own_case_is_told_from_the_suites_by_its_physics(toys: Path, tmp_path: Path) -> None:
    text = (toys / "cases" / "strip.toml").read_text(encoding="utf-8")
    same, other = tmp_path / "strip.toml", tmp_path / "thick" / "strip.toml"
    other.parent.mkdir()
    same.write_text(text.replace("Strip", "My strip"), encoding="utf-8")
    other.write_text(text.replace("thickness = 0.1", "thickness = 0.2"), encoding="utf-8")
    assert not catalog.is_own(read_case(same))
    assert catalog.is_own(read_case(other))
    assert [t.own_case for t in plan(str(other), solvers=("toy",)).tasks] == [True]


def test_settings_are_checked_in_one_sentence(toys: Path) -> None:
    for settings, said in [
        ({"toy": {"factr": 1}}, "field 'factr' is not known here (did you mean factor?)"),
        ({"toy": {"factor": "big"}}, "field 'factor': found 'big'"),
        ({"toy": {"seed": 1}}, "--seed"),
        ({"toy": {"device": "cuda"}}, "--device"),
        ({"toy-noisy": {"noise": 1}}, "is not to be run"),
        ({"nobody": {"noise": 1}}, "unknown solver 'nobody'"),
    ]:
        with pytest.raises(InputError) as caught:
            plan("strip", solvers=("toy",), settings=settings)
        assert said in str(caught.value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("toy.a=1", 1),
        ("toy.a=1e-6", 1e-6),
        ("toy.a=true", True),
        ("toy.a=[1, 2]", [1, 2]),
        ('toy.a="1"', "1"),
        ("toy.a=gelu", "gelu"),
        ("toy.a=", ""),
        ("toy.a=1\nb = 2", "1\nb = 2"),
        ("toy.a=x=y", "x=y"),
    ],
)
def test_values_of_settings_are_toml_or_text(text: str, value: object) -> None:
    assert parse_setting(text) == ("toy", "a", value)


@pytest.mark.parametrize("text", ["", "=", "toy", "toy=1", "toy.=1", ".a=1", "toy.a"])
def test_malformed_settings_are_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"SOLVER\.KEY=VALUE"):
        parse_setting(text)


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        (Request(), "nothing to run"),
        (Request(cases=("nowhere",)), "unknown case 'nowhere'"),
        (Request(cases=("nowhere.toml",)), "can't be read"),
        (Request(suites=("nothing",)), "unknown suite 'nothing'"),
        (Request(cases=("strip",), solvers=("nobody",)), "unknown solver 'nobody': solvers are "),
        (Request(cases=("strip",), solvers=("toy-broken",)), "solver 'toy-broken' can't be used: No module named"),
        (Request(cases=("strip",), solvers=("toy",), device="cuda"), "--device cuda: solver 'toy' runs on cpu"),
    ],
)
def test_bad_requests_are_refused_in_one_sentence(toys: Path, request_: Request, said: str) -> None:
    with pytest.raises(InputError) as caught:
        make_plan(request_, NOTHING)
    assert said in str(caught.value)


def test_what_does_not_apply_is_no_failure(toys: Path, tmp_path: Path) -> None:
    path = tmp_path / "tube.toml"
    text = (toys / "cases" / "strip.toml").read_text(encoding="utf-8")
    path.write_text(text.replace('kind = "plane"', 'kind = "cylinder"\naxis = "y"\nradius = 9'), encoding="utf-8")
    made = plan(str(path), solvers=("toy", "toy-noisy"))
    assert runs(made) == [("tube", "toy-noisy", 0)]
    assert [(d.case, d.solver, d.reason) for d in made.declined] == [("tube", "toy", "it solves planes only")]


def test_a_solver_is_asked_only_where_no_record_answers_and_is_expected_first(
    toys: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[str] = []
    solver = load_solver(find_solver("toy"))
    monkeypatch.setattr(type(solver), "declines", lambda self, case: heard.append(f"asked {case.name}"))
    request = Request(cases=("strip",), solvers=("toy",))
    for force, words in ((False, ["expected", "asked strip"]), (True, ["expected", "asked strip"])):
        heard.clear()
        make_plan(request, store.read(), force, lambda task: heard.append("expected"))
        assert heard == words
        run(store, "strip", solvers=("toy",))
    heard.clear()
    kept = make_plan(request, store.read(), expect=lambda task: heard.append("expected"))
    assert len(kept.kept) == 1
    assert heard == []


def test_another_theory_is_declined(toys: Path, tmp_path: Path) -> None:
    path = tmp_path / "bent.toml"
    text = (toys / "cases" / "strip.toml").read_text(encoding="utf-8")
    text = text.replace("love-linear", "love-nonlinear").replace(f"-{strip.LOAD}]", f'"-{strip.LOAD}*t"]')
    path.write_text(text, encoding="utf-8")
    assert [d.reason for d in plan(str(path), solvers=("toy",)).declined] == [
        "it does not solve kirchhoff-love-nonlinear"
    ]


def test_a_broken_plugin_harms_nobody_else(plugin: Path) -> None:
    assert "toy-broken" in solver_entries()
    assert load_solver(find_solver("toy")).name == "toy"


def test_two_packages_with_one_name_are_refused(plugin: Path) -> None:
    other = plugin / "rival-1.0.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: rival\nVersion: 1.0\n", encoding="utf-8")
    (other / "entry_points.txt").write_text("[shellbench.solvers]\ntoy = rival:Solver\n", encoding="utf-8")
    with pytest.raises(InputError, match="two installed packages call a solver 'toy'"):
        solver_entries()


@pytest.mark.parametrize("name", with_something_new(catalog.case_names()))
def test_a_case_survives_the_way_to_another_process(name: str) -> None:
    from shellbench.bench.store.task import case_data

    case = catalog.named_case(name)
    again = problem_of(case_data(case))
    assert (type(again), again.digest()) == (type(case), case.digest())


def test_symmetry_survives_the_way_to_another_process() -> None:
    from shellbench.bench.store.task import case_data
    from tests.bench import strip

    data = read_toml_text(strip.CASE)
    data["supports"].append({"name": "mirror", "on": ["xi2_min"], "symmetry": "y"})
    case = build_case(data, "half", "half")
    assert Case.model_validate(case_data(case)).digest() == case.digest()


def read_toml_text(text: str) -> dict[str, Any]:
    import tomllib

    return tomllib.loads(text)


def test_a_changed_solver_is_never_answered_by_an_old_record(toys: Path, plugin: Path, store: Store) -> None:
    first = run(store, "strip", solvers=("toy",), apart=True)[0].record
    assert run(store, "strip", solvers=("toy",)) == []
    law = plugin / "toy_shells" / "strip.py"
    law.write_text(law.read_text(encoding="utf-8").replace("/ (24 *", "/ (12 *"), encoding="utf-8")
    second = run(store, "strip", solvers=("toy",), apart=True)[0].record
    assert first is not None
    assert second is not None
    assert second.values["centre"].value == pytest.approx(2 * first.values["centre"].value)


def test_changed_physics_is_not_answered_by_an_old_record_but_changed_prose_is(
    own_case: Path, toys: Path, store: Store
) -> None:
    run(store, str(own_case), solvers=("toy",))
    text = own_case.read_text(encoding="utf-8")
    own_case.write_text(text.replace('title = "Strip"', 'title = "Other"').replace("1e-9", "1e-3"), encoding="utf-8")
    assert run(store, str(own_case), solvers=("toy",)) == []
    own_case.write_text(text.replace("thickness = 0.1", "thickness = 0.2"), encoding="utf-8")
    assert len(run(store, str(own_case), solvers=("toy",))) == 1


def test_tasks_are_data(toys: Path, tmp_path: Path) -> None:
    task = plan("strip", solvers=("toy-noisy",)).tasks[0]
    task.write(tmp_path)
    assert Task.read(tmp_path) == task
    assert read_toml(toys / "cases" / "strip.toml")["title"] == task.case["title"]


def test_threads_that_are_asked_for_are_in_the_environment_of_each_task(toys: Path) -> None:
    assert {task.environment.threads for task in plan("strip", threads=3).tasks} == {3}
    assert {task.environment.threads for task in plan("strip").tasks} == {environment.threads()}


def test_a_solver_whose_extra_is_missing_names_the_extra(toys: Path, plugin: Path) -> None:
    source = plugin / "toy_shells" / "solver.py"
    need = 'from shellbench.protocol.engine import need\n\nneed("kratos", ["no-such-engine"])\n'
    text = source.read_text(encoding="utf-8")
    source.write_text(text.replace("from toy_shells import strip\n", f"{need}from toy_shells import strip\n"))
    with pytest.raises(InputError) as caught:
        plan("strip", solvers=("toy",))
    assert str(caught.value) == (
        "solver 'toy' can't be used: no-such-engine is not installed: python -m pip install 'shellbench[kratos]'"
    )


def test_the_version_of_an_engine_is_in_identity_and_environment(toys: Path, plugin: Path) -> None:
    source = plugin / "toy_shells" / "solver.py"
    setting = '    engine: str = Field(default_factory=lambda: engine_version("psutil"))\n'
    text = source.read_text(encoding="utf-8").replace(
        "    seconds: float = 0.0\n", f"    seconds: float = 0.0\n{setting}"
    )
    source.write_text(
        text.replace("from toy_shells", "from shellbench.protocol.engine import engine_version\nfrom toy_shells")
    )
    (task,) = plan("strip", solvers=("toy",), settings={"toy": {"factor": 2.0}}).tasks
    assert task.identity.settings["engine"] == f"psutil {version('psutil')}"
    assert task.environment.versions["psutil"] == version("psutil")


def quick(**asked: Any) -> list[tuple[str, str, tuple[int, ...]]]:
    return [
        (case.name, run.solver, run.seeds) for case, run in wanted_runs(Request(quick=("fem", "ndf-ritz"), **asked))
    ]


def test_quick_is_two_solvers_with_one_seed_of_whatever_is_asked() -> None:
    found = quick(suites=("obstacle_course",))
    cases = [case.name for case in catalog.cases_of("obstacle_course")]
    assert found == [(case, solver, (0,)) for case in cases for solver in ("fem", "ndf-ritz")]
    assert quick(cases=("scordelis_lo",)) == [("scordelis_lo", "fem", (0,)), ("scordelis_lo", "ndf-ritz", (0,))]
    assert quick(suites=("nonlinear",), cases=("rolled_plate",), solvers=("ndf",)) == [("rolled_plate", "ndf", (0,))]


def test_quick_joins_no_solver_that_a_suite_does_not_run() -> None:
    assert {solver for _, solver, _ in quick(suites=("cloth",))} == {"fem"}
    with pytest.raises(InputError, match="nothing to run: --quick takes fem and ndf-ritz"):
        quick(suites=("rope",))
