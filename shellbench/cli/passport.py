"""The command ``passport``, which measures the stiffnesses that a solver really simulates."""

from __future__ import annotations

from typing import Annotated

import typer

from shellbench.cli.options import (
    DEFAULT_STORE,
    SOLVERS,
    SettingOption,
    StoreOption,
    WideOption,
    settings_of,
    text_width,
    warn,
)
from shellbench.cli.solve import carry_out


def passport_command(
    solver: Annotated[str, typer.Argument(metavar="SOLVER", help="Whose passport.", **SOLVERS)],
    settings: SettingOption = None,
    store: StoreOption = DEFAULT_STORE,
    wide: WideOption = False,
) -> None:
    """Measure the material that a solver really simulates: its stiffnesses as multiples of the given ones.

    The tests are stretch, shear, twist, bending under its own weight up to Gamma = q L^3 / B = 1000, also of woven
    cloth along its warp, its weft and between them, and free fall. The runs are those of the suite `passport`, some of
    them on several meshes. A ratio is that of the finest mesh, with its uncertainty. Declined cases are listed. The
    exit code is 1 if nothing could be measured or a run failed.

    Examples
    --------
        shellbench passport cst-hinge

        shellbench passport mine --set mine.cells=64
    """
    from shellbench.bench.judge import compare
    from shellbench.bench.judge.passport import SUITE
    from shellbench.bench.run.local import LocalProcesses
    from shellbench.bench.run.plan import Request
    from shellbench.bench.store import environment
    from shellbench.bench.store.store import Store
    from shellbench.report.studies.passport import table

    where = Store(store)
    request = Request(suites=(SUITE,), solvers=(solver,), settings=settings_of(settings), threads=1)
    code = carry_out(request, where, LocalProcesses(environment.cores(), 1))
    rows, notes = compare.rows_and_notes(where, (SUITE,), ())
    warn(notes)
    mine = [row for row in rows if row.solver == solver]
    typer.echo(table(mine).write("text", text_width(wide)), nl=False)
    raise typer.Exit(code if any(row.value is not None for row in mine) else 1)
