"""The commands that share results: ``pack`` and ``board``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shellbench.cli.options import DEFAULT_STORE, SOLVERS, StoreOption, SuiteOption, warn

DEFAULT_BOARD = Path("reports/board")


def pack(
    solver: Annotated[str, typer.Argument(metavar="SOLVER", help="Whose records.", **SOLVERS)],
    store: StoreOption = DEFAULT_STORE,
    suite: SuiteOption = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.zip", help="File to write; SOLVER-VERSION.zip if not given.")
    ] = None,
    install: Annotated[
        str,
        typer.Option("--install", metavar="COMMAND", help="How to install the solver. Default: from its repository."),
    ] = "",
) -> None:
    """Pack a solver's records into one file, to submit them to a board.

    The pack has the valid runs of the suite's own cases: values, settings, versions, seconds and machine, each record
    with its checksum. The file is a zip of JSON. It has no solutions and no code.

    Examples
    --------
        shellbench pack mine --suite obstacle_course --install "python -m pip install mine==1.2"
    """
    from shellbench.bench.store.pack import SUFFIX, entry_of, write_pack
    from shellbench.bench.store.store import Store
    from shellbench.errors import InputError

    entry = entry_of(Store(store), solver)
    file = out or Path(f"{entry.name}-{entry.version}{SUFFIX}")
    if file.suffix != SUFFIX:
        raise InputError(f"--out: found {str(file)!r}, but a pack is a file *{SUFFIX}")
    manifest, notes = write_pack(Store(store), solver, file, tuple(suite or ()), install)
    warn(notes)
    runs = len(manifest.runs)
    typer.echo(
        f"written to {file}: {runs} run{'' if runs == 1 else 's'} of {manifest.solver} {manifest.version}\n"
        f"install:  {manifest.install or 'not stated; --install COMMAND states it'}\n"
        f"checksum: {manifest.checksum}"
    )


def board(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of packs.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write.")] = DEFAULT_BOARD,
    store: Annotated[
        Path | None,
        typer.Option("--store", metavar="DIR", help="Your own runs: figures that they confirm are marked re-measured."),
    ] = None,
) -> None:
    """Build a static page from packs: by case, and by cost at equal error.

    Each pack is checked first. If a pack was changed since it was written, it is refused, and no page is built. Errors
    and verdicts are computed from today's known values.

    Examples
    --------
        shellbench board submissions --store reports/runs --out site/board
    """
    from shellbench.bench.judge.board import read_board
    from shellbench.bench.judge.gate import check_filled
    from shellbench.bench.store.store import Store
    from shellbench.report.page.board import write_board

    own = None if store is None else Store(store)
    if own is not None:
        check_filled(own)
    entries = read_board(folder, own)
    warn(tuple(f"{entry.name}: {words}" for entry in entries for words in (*entry.notes, *entry.differs)))
    typer.echo(f"written to {write_board(entries, out)}")
