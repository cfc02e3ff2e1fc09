"""Export of a stored solution, sampled on a regular grid, for other programs.

Meshes consist of quadrilaterals whose normals point along a_1 x a_2. If the surface is closed, the two sides of its
seam share their vertices, so that no viewer shows a slit or a crease in the shading. This requires that the field is
closed too: a solver whose field jumps at the seam shows its jump.
"""

from __future__ import annotations

import errno
import io
import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.kinds import find_kind
from shellbench.bench.plugins.outside import AskedSolver, resolve_solver
from shellbench.bench.plugins.registry import find_solver
from shellbench.bench.store.current import CurrentRun, current_runs
from shellbench.bench.store.record import ANSWERED
from shellbench.bench.store.store import Say, Store, silent
from shellbench.disk import said_plainly
from shellbench.errors import InputError, ShellbenchError
from shellbench.protocol.sample import Sample

Array = NDArray[np.float64]


def as_npz(sample: Sample, scale: float) -> bytes:
    """Return all arrays unchanged, with both sides of seams; `scale` is not used."""
    file = io.BytesIO()
    np.savez_compressed(file, position=sample.position, **sample.point_data)  # type: ignore[arg-type] # its own options
    return file.getvalue()


def as_obj(sample: Sample, scale: float) -> bytes:
    """Return the deformed midsurface as quadrilaterals, with all digits: displacements can be tiny beside the shell."""
    points = sample.vertices(sample.deformed(scale))
    vertices = (f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in points)
    faces = (f"f {a} {b} {c} {d}" for a, b, c, d in quadrilaterals(len(sample.xi), sample.closed) + 1)  # from 1
    return ("\n".join([f"# {sample.title}", *vertices, *faces]) + "\n").encode()


def as_vtu(sample: Sample, scale: float) -> bytes:
    """Return the reference midsurface with displacement, strains and energy densities at its points.

    `scale` is not used: viewers warp by the displacement themselves. Components have the names of the theory, the
    state of a motion its time. VTK writes to memory: it does not say whether it could write a file.

    Raises
    ------
    InputError
        If pyvista is not installed.
    """
    try:
        import pyvista
        from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter
    except ImportError:
        raise InputError("writing .vtu needs pyvista: install it by `pip install 'shellbench[vtk]'`") from None
    corners = quadrilaterals(len(sample.xi), sample.closed)
    cells = np.concatenate([np.full((len(corners), 1), 4), corners], axis=1)
    types = np.full(len(cells), pyvista.CellType.QUAD)
    mesh = pyvista.UnstructuredGrid(cells.ravel(), types, sample.vertices(sample.position))
    for name, values in sample.point_data.items():
        mesh.point_data[name] = sample.vertices(values)
        for i, component in enumerate(sample.components.get(name, ())):
            mesh.GetPointData().GetArray(name).SetComponentName(i, component)
    mesh.set_active_vectors("displacement")
    if sample.scalar:
        mesh.set_active_scalars(sample.scalar)
    if sample.at is not None:
        mesh.field_data["TimeValue"] = np.array([sample.at])  # the name that ParaView looks for
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(mesh)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    if not writer.Write():
        raise ShellbenchError(f"VTK could not write {sample.title}")
    # A string in the field data would keep meshio from reading the file at all, so that the title is a comment.
    declaration, _, rest = str(writer.GetOutputString()).partition("\n")
    return f"{declaration}\n<!-- {re.sub('-+', '-', sample.title)} -->\n{rest}".encode()


WRITERS: dict[str, Callable[[Sample, float], bytes]] = {".npz": as_npz, ".obj": as_obj, ".vtu": as_vtu}


def quadrilaterals(n: int, closed: tuple[bool, bool] = (False, False)) -> NDArray[np.int64]:
    """Return the corners (m, 4) of the cells of an n x n grid, in order around each.

    Vertices are counted row by row; in a closed coordinate the last cells end at the first vertices.
    """
    rows, columns = (n - 1 if is_closed else n for is_closed in closed)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij"))
    after_i, after_j = (i + 1) % rows, (j + 1) % columns
    corners = (i * columns + j, after_i * columns + j, after_i * columns + after_j, i * columns + after_j)
    return np.stack(corners, axis=-1)


def stored_run(store: Store, case_text: str, solver: str, seed: int | None, say: Say = silent) -> CurrentRun:
    """Return the newest valid run of a case by a solver, if possible with default settings.

    `say` receives a sentence for each damaged file.

    Raises
    ------
    InputError
        If a name is unknown or the store has no such valid run.
    """
    case = catalog.find_case(case_text)
    find_solver(solver)
    current = current_runs(store.read())
    for sentence in current.damaged:
        say(sentence)
    found = [
        run
        for run in current.runs
        if run.record.identity.case == case.digest()
        and run.record.identity.solver == solver
        and run.record.status in ANSWERED
        and store.file(run.record.solution_file)
        and (seed is None or run.record.identity.seed == seed)
    ]
    for run in sorted(found, key=lambda run: (not run.overrides, run.record.order), reverse=True):
        damage = store.check(run.record, run.record.solution_file)
        if damage is None:
            return run
        say(damage)
    seeded = "" if seed is None else f" --seed {seed}"
    raise InputError(
        f"store {store.folder} has no current solution: make one by "
        f"`shellbench run {case_text} --solver {solver}{seeded}`"
    )


def sample(store: Store, run: CurrentRun, resolution: int, at: float | None = None) -> Sample:
    """Load a stored solution and sample it on a grid; see `samples`."""
    return next(samples(store, run, resolution, (at,)))


def marks_of(run: CurrentRun, frames: int) -> tuple[float, ...]:
    """Return the marks of a series: times of a motion, evenly from rest to its end, or the states of a path.

    Raises
    ------
    InputError
        If the case has one state only.
    """
    ends = find_kind(run.case.kind).portrait(run.case).ends
    marks = run.case.states if ends is None else tuple(np.linspace(0.0, ends, frames).tolist())
    if len(marks) < 2:
        raise InputError(f"{run.case.name} has one state only: a series needs a motion or the states of a path")
    return marks


def samples(store: Store, run: CurrentRun, resolution: int, marks: Sequence[float | None]) -> Iterator[Sample]:
    """Load a stored solution and sample it, state by state, on a grid.

    Parameters
    ----------
    marks
        Times, s, or marks of kept states of a path; None is the last state.

    Raises
    ------
    ShellbenchError
        If its file can't be read.
    InputError
        If the solution has no state there.
    """
    kind = find_kind(run.case.kind)
    for at in marks:
        if at is not None:
            run.case.check_state(at)
    if kind.sample is None:
        raise InputError(f"{run.case.name}: solutions of the kind '{run.case.kind}' are no surfaces to export")
    record = run.record
    path = store.file(record.solution_file)
    solver = resolve_solver(find_solver(record.identity.solver))
    try:
        if path is None:
            raise FileNotFoundError("it is gone")
        solution = None if isinstance(solver, AskedSolver) else solver.load(path)
    except ShellbenchError:
        raise
    except Exception as error:  # a reader can raise anything
        raise ShellbenchError(f"the solution of {record.run_id} can't be read: {error}") from error
    for at in marks:
        state = "" if at is None else f" at {run.case.mark_words(at)}"
        title = f"{run.case.name} by {record.identity.solver} ({record.run_id}){state}, {run.case.units} units"
        if isinstance(solver, AskedSolver):
            yield solver.sample(run.case.kind, path, resolution, at, title)
        else:
            yield kind.sample(solution, resolution, at, title)


def export(sampled: Sample, path: Path, scale: float = 1.0) -> None:
    """Write a sample in the format of the file's suffix, whole or not at all.

    Raises
    ------
    InputError
        If the format is unknown, or needs a package that is not installed.
    StoreError
        If it can't be written, for instance because the disk is full.
    """
    write(path, writer_of(path)(sampled, scale))


def write(path: Path, data: bytes) -> None:
    """Write a file whole or not at all; StoreError if it can't be written."""
    temporary = path.with_name(f".partial-{path.name}")
    with said_plainly(path.parent, "folder"):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())  # a disk may say only now that it is full
            if temporary.stat().st_size != len(data):
                raise OSError(errno.EIO, f"{temporary.stat().st_size} of {len(data)} bytes were kept")
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def writer_of(path: Path, others: Sequence[str] = ()) -> Callable[[Sample, float], bytes]:
    """Return the writer for files of this suffix; InputError with the known suffixes and `others` if there is none."""
    if path.suffix not in WRITERS:
        raise InputError(f"--out {path}: can't write '{path.suffix}'; formats are {', '.join([*WRITERS, *others])}")
    return WRITERS[path.suffix]
