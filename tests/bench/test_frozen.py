"""Tables and the gate say of archived records what they have always said."""

import pytest

from tests.bench.frozen import FOLDER, outputs

NAMES = ("table.json", "table.text", "table.markdown", "table.latex", "table.csv", "gate.txt")


@pytest.fixture(scope="module")
def said() -> dict[str, str]:
    return outputs()


@pytest.mark.parametrize("name", NAMES)
def test_archived_records_are_shown_as_before(said: dict[str, str], name: str) -> None:
    assert said[name] == (FOLDER / name).read_text(encoding="utf-8")


def test_all_outputs_are_held(said: dict[str, str]) -> None:
    assert said.keys() == set(NAMES)
