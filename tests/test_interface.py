"""`shellbench.run` and `shellbench.table`: the store's rows as a DataFrame; and what notebooks show."""

import json
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import shellbench
from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.compare import as_json, rows
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from tests.bench import strip
from tests.bench.conftest import (  # noqa: F401 - fixtures
    made_once,
    plugin,
    recorded,
    store,
    toys,
)
from tests.patience import GUARD
from tests.test_cli_first import here  # noqa: F401 - fixture


@pytest.mark.usefixtures("toys", "here")
def test_a_run_is_a_frame_and_answers_the_next_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = {"solvers": ["toy", "toy-noisy"], "seeds": [3], "store": tmp_path / "runs"}
    found = shellbench.run("strip", settings={"toy": {"factor": 0.5}}, **asked)
    assert capsys.readouterr().out.count("\n") == 2
    headline = found[found["primary"]].set_index("solver")
    assert headline.loc["toy", "value"] == pytest.approx(strip.CENTRE / 2)
    assert headline.loc["toy", "relative_error"] == pytest.approx(-0.5)
    assert headline.loc["toy-noisy", "seed"] == 3
    again = shellbench.run("strip", settings={"toy": {"factor": 0.5}}, quiet=True, **asked)
    assert list(again["run_id"]) == list(found["run_id"])
    assert set(shellbench.run("strip", solvers=["toy-noisy"], store=asked["store"])["solver"]) == {"toy-noisy"}


def test_a_table_has_the_columns_and_lines_of_the_contract(recorded: Store) -> None:  # noqa: F811
    found = shellbench.table(store=recorded.folder)
    expected = json.loads(as_json(rows(recorded)))
    assert isinstance(found, pd.DataFrame)
    assert set(found.columns) == set(expected[0])
    assert list(found["value"]) == [row["value"] for row in expected]
    empty = shellbench.table(store=recorded.folder / "none")
    assert (len(empty), set(empty.columns)) == (0, set(found.columns))


@pytest.mark.usefixtures("toys")
def test_bad_input_is_the_same_sentence_as_on_the_command_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown case 'strop' \\(did you mean strip"):
        shellbench.run("strop", store=tmp_path)


def test_all_public_names_are_listed_and_documented() -> None:
    page = (Path(__file__).parents[1] / "docs/api.md").read_text(encoding="utf-8")
    names = [name for name in dir(shellbench) if not name.startswith("_")]
    assert names == ["Picture", "case", "judge", "picture", "run", "solve", "table"]
    assert [name for name in names if f"::: shellbench.interface.{name}\n" not in page] == []


def test_the_package_is_light_until_it_is_asked() -> None:
    program = "import sys, shellbench; print(sorted({'numpy', 'pandas', 'pydantic', 'torch'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=GUARD, check=True)
    assert done.stdout == "[]\n"
    with pytest.raises(AttributeError, match="walk"):
        _ = shellbench.walk


def test_one_case_is_solved_and_drawn_in_this_process() -> None:
    plate = shellbench.case("square_plate")
    answer = shellbench.solve(plate, "fem", cells=(2, 2))
    assert "centre_deflection" in answer._repr_html_()
    assert shellbench.picture(answer)._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(InputError, match="settings of 'fem'"):
        shellbench.solve(plate, "fem", cell=2)
    with pytest.raises(InputError, match="fem can't take rope_"):
        shellbench.solve("rope_ball", "fem")


def test_notebooks_show_cases_and_solutions() -> None:
    case = catalog.named_case("square_plate")
    assert "<strong>Square plate</strong>" in case._repr_html_()
    assert "centre_deflection" in case._repr_html_()
    hostile = case.model_copy(update={"title": "<script>"})
    assert "<script>" not in hostile._repr_html_()
