"""Exporting a stored solution, sampled on a regular grid, for other programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shellbench import catalog
from shellbench.bench.current import CurrentRun, current_runs
from shellbench.bench.marks import mark_words
from shellbench.bench.registry import find_solver, load_solver
from shellbench.bench.store import Store, said_plainly
from shellbench.errors import InputError, ShellbenchError
from shellbench.solution import FIELDS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sample:
    """A solution on a regular grid of n x n points.

    Attributes
    ----------
    xi
        (n, n, 2) curvilinear coordinates, angles in radians.
    position, displacement
        (n, n, 3) of the reference midsurface, metres.
    fields
        Strains (n, n, 3) and energy densities (n, n); see `shellbench.solution.FIELDS`.
    title
        One line on where it comes from.
    """

    xi: Array
    position: Array
    displacement: Array
    fields: dict[str, Array]
    title: str

    def deformed(self, scale: float) -> Array:
        """Return the positions (n, n, 3) after a displacement times `scale`."""
        return np.asarray(self.position + scale * self.displacement)


def write_npz(sample: Sample, path: Path, scale: float) -> None:
    """Write all arrays as they are; `scale` is not used."""
    arrays = {"xi": sample.xi, "position": sample.position, "displacement": sample.displacement, **sample.fields}
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type] # its stub takes them for its own options


def write_obj(sample: Sample, path: Path, scale: float) -> None:
    """Write the deformed midsurface as quadrilaterals."""
    n = sample.xi.shape[0]
    vertices = (f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in sample.deformed(scale).reshape(-1, 3))
    faces = (f"f {a} {b} {c} {d}" for a, b, c, d in quadrilaterals(n) + 1)  # obj counts from 1
    path.write_text("\n".join([f"# {sample.title}", *vertices, *faces]) + "\n", encoding="utf-8")


def write_vtu(sample: Sample, path: Path, scale: float) -> None:
    """Write the reference midsurface with displacement, strains and energy densities at its points.

    `scale` is not used: viewers warp by the displacement themselves.

    Raises
    ------
    InputError
        If pyvista is not installed.
    """
    try:
        import pyvista
    except ImportError:
        raise InputError("writing .vtu needs pyvista: install it by `pip install 'shellbench[vtk]'`") from None
    n = sample.xi.shape[0]
    cells = np.concatenate([np.full((len(quadrilaterals(n)), 1), 4), quadrilaterals(n)], axis=1)
    types = np.full(len(cells), pyvista.CellType.QUAD)
    mesh = pyvista.UnstructuredGrid(cells.ravel(), types, sample.position.reshape(-1, 3))
    mesh.point_data["displacement"] = sample.displacement.reshape(-1, 3)
    mesh.point_data["xi"] = sample.xi.reshape(-1, 2)
    for name, values in sample.fields.items():
        mesh.point_data[name] = values.reshape(n * n, -1) if values.ndim > 2 else values.ravel()
    mesh.save(path)


WRITERS: dict[str, Callable[[Sample, Path, float], None]] = {".npz": write_npz, ".obj": write_obj, ".vtu": write_vtu}


def quadrilaterals(n: int) -> NDArray[np.int64]:
    """Return the corners (m, 4) of the cells of an n x n grid, counted row by row, in order around each."""
    first = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    return np.stack([first, first + n, first + n + 1, first + 1], axis=-1)


def stored_run(store: Store, case_text: str, solver: str, seed: int | None) -> CurrentRun:
    """Return the newest good run of a case by a solver, with default settings if there is one.

    Raises
    ------
    InputError
        If a name is unknown or the store has no such run that counts.
    """
    case = catalog.find_case(case_text)
    find_solver(solver)
    found = [
        run
        for run in current_runs(store.read()).runs
        if run.record.identity.case == case.digest()
        and run.record.identity.solver == solver
        and run.record.status == "ok"
        and store.file(run.record.solution_file)
        and (seed is None or run.record.identity.seed == seed)
    ]
    if not found:
        seeded = "" if seed is None else f" --seed {seed}"
        raise InputError(
            f"store {store.folder} has no current solution: make one by "
            f"`shellbench run {case_text} --solver {solver}{seeded}`"
        )
    return max(found, key=lambda run: (not run.overrides, run.record.created))


def sample(store: Store, run: CurrentRun, resolution: int, at: float | None = None) -> Sample:
    """Load a stored solution and sample it on a grid of so many points a side.

    Parameters
    ----------
    at
        Time, s, or mark of a kept state of a path; the last state if None.

    Raises
    ------
    ShellbenchError
        If its file can't be read.
    InputError
        If the solution has no state there.
    """
    dynamics = run.case.dynamics
    if at is not None and dynamics is not None and not 0 <= at <= dynamics.until:
        raise InputError(f"--at: found {at:g}, but {run.case.name} moves from 0 to {dynamics.until:g} s")
    if at is not None and run.case.linear:
        raise InputError(f"--at: {run.case.name} is linear and has one state only")
    record = run.record
    path = store.file(record.solution_file)
    solver = load_solver(find_solver(record.identity.solver))
    try:
        if path is None:
            raise FileNotFoundError("it is gone")
        solution = solver.load(path)
    except ShellbenchError:
        raise
    except Exception as error:  # a plug-in's reader can raise anything
        raise ShellbenchError(f"the solution of {record.run_id} can't be read: {error}") from error
    xi = run.case.surface.domain.grid(resolution, resolution)
    state = "" if at is None else f" at {mark_words(run.case, at)}"
    return Sample(
        xi=xi,
        position=run.case.surface.position(xi),
        displacement=solution.displacement(xi, at=at),
        fields={name: solution.evaluate(name, xi, at=at) for name in FIELDS},
        title=f"{run.case.name} by {record.identity.solver} ({record.run_id}){state}, {run.case.units} units",
    )


def export(sampled: Sample, path: Path, scale: float = 1.0) -> None:
    """Write a sample in the format of the file's suffix, whole or not at all.

    Raises
    ------
    InputError
        If the format is unknown, or needs a package that is not installed.
    """
    temporary = path.with_name(f".partial-{path.name}")
    with said_plainly(path.parent, "folder"):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            writer_of(path)(sampled, temporary, scale)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def writer_of(path: Path) -> Callable[[Sample, Path, float], None]:
    """Return what writes a file of this suffix; InputError, naming the known ones, if nothing does."""
    if path.suffix not in WRITERS:
        raise InputError(f"--out {path}: can't write '{path.suffix}'; formats are {', '.join(WRITERS)}")
    return WRITERS[path.suffix]
