"""Commands that ask the same question at the same time: one makes the run, the others take its record."""

import subprocess
import sys
import threading

import pytest

from shellbench.bench.run.display import Silent
from shellbench.bench.run.execute import Outcome, execute
from shellbench.bench.run.plan import Request, make_plan
from shellbench.bench.store.claims import NAME, Claims
from shellbench.bench.store.current import run_key
from shellbench.bench.store.store import Store
from tests.bench.running import InThisProcess, run
from tests.patience import GUARD, until

HOLD = "import sys; from pathlib import Path; from shellbench.bench.store.claims import Claims; c = Claims(Path(sys.argv[1]))\nprint(c.take('k'), flush=True); input()"


@pytest.mark.usefixtures("toys")
@pytest.mark.parametrize("ends_well", [True, False])
def test_a_run_that_another_command_makes_is_waited_for_and_taken(store: Store, ends_well: bool) -> None:
    plan = make_plan(Request(("strip",), (), ("toy",)), store.read())
    outcomes: list[Outcome] = []
    said: list[str] = []
    store.folder.mkdir(parents=True)
    with Claims(store.folder) as other:
        assert other.take(run_key(plan.tasks[0]))

        def wait() -> None:
            outcomes.extend(execute(plan.tasks, store, Silent(), InThisProcess(), plan.seen, said.append))

        thread = threading.Thread(target=wait)
        thread.start()
        until(lambda: said)
        if ends_well:
            run(store, "strip", solvers=("toy",))
    thread.join(GUARD)
    (outcome,) = outcomes
    assert outcome.taken is ends_well
    assert outcome.record is not None
    assert outcome.record.status == "ok"
    assert len(store.read().records) == 1
    assert said == ["1 run is being made by another command: waiting for the answer"]
    assert not list(store.folder.glob(f"{NAME}*"))


def test_a_claim_dies_with_its_owner(store: Store) -> None:
    store.folder.mkdir(parents=True)
    call = [sys.executable, "-c", HOLD, str(store.folder)]
    with subprocess.Popen(call, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as owner:
        assert owner.stdout is not None
        assert owner.stdout.readline() == b"True\n"
        with Claims(store.folder) as claims:
            assert not claims.take("k")
            owner.kill()
            owner.wait()
            assert claims.take("k")
