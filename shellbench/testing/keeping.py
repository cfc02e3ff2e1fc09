"""Checks of saved answers: they load completely, and their size is counted correctly.

The arrays of a saved solution can be read and altered by name.
"""

from __future__ import annotations

import json
import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.plugins.subject import Lost, NoAnswer, Respondent
from shellbench.problem import Problem
from shellbench.problems.shell.case import Case
from shellbench.testing.convergence import refinements
from shellbench.testing.examination import Examination, Findings, Verdict, deviation, grid, not_shown, scattered
from shellbench.testing.subject import RemoteSolution, load_in

PICKLE, PROTOCOLS = 0x80, range(2, 6)  # first byte of a pickle, and the second, which names its protocol
SAFETENSORS = {
    "F64": "<f8",
    "F32": "<f4",
    "F16": "<f2",
    "I64": "<i8",
    "I32": "<i4",
    "I16": "<i2",
    "I8": "i1",
    "U8": "u1",
    "BOOL": "u1",
}
"""Number formats of safetensors that NumPy knows; see huggingface.co/docs/safetensors."""

REALS = "fc"  # NumPy's kinds of real and complex numbers
NUMBERS = REALS + "iub"
NUDGE = 1e-3  # relative change of real numbers; displacements follow if they matter
HARDEST = 9  # zlib's level
SIDES = 9  # points a side, at edges and corners too, at which a kept displacement is looked at
MOST_SLICES = 12  # longest axis whose slices are altered one by one: components, not nodes

Part = tuple[slice | int, ...]
"""An index: which part of an array."""


@dataclass(frozen=True)
class SavedArrays:
    """The arrays of a file.

    Attributes
    ----------
    arrays
        By name, without texts.
    spans
        Place of each in the file, (first byte, bytes); empty for npz, which is rewritten.
    """

    path: Path
    arrays: dict[str, NDArray[Any]]
    spans: dict[str, tuple[int, int]]


def read_arrays(path: Path) -> SavedArrays | None:
    """Return the arrays of an npz or safetensors file; None if it is neither."""
    if zipfile.is_zipfile(path):
        return _npz(path)
    return _safetensors(path)


def is_pickled(path: Path) -> bool:
    """Return True if a file is a pickle or contains one."""
    if path.is_dir():
        return any(is_pickled(p) for p in path.rglob("*") if p.is_file())
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if any(name.endswith((".pkl", ".pickle")) for name in names):
                return True  # PyTorch's files are such
        try:
            with np.load(path, allow_pickle=False) as data:
                for name in data.files:
                    data[name]
        except ValueError:
            return True  # NumPy says that an array holds Python objects
        return False
    if _safetensors(path) is not None:
        return False  # its first bytes are a length, which may be anything
    start = path.read_bytes()[:2]
    return len(start) == 2 and start[0] == PICKLE and start[1] in PROTOCOLS


def _npz(path: Path) -> SavedArrays | None:
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
    except ValueError:
        return None
    return SavedArrays(path, {n: a for n, a in arrays.items() if a.dtype.kind in NUMBERS}, {})


def _safetensors(path: Path) -> SavedArrays | None:
    data = path.read_bytes()
    try:
        (length,) = struct.unpack("<Q", data[:8])
        header = json.loads(data[8 : 8 + length])
        arrays, spans = {}, {}
        for name, entry in header.items():
            if name == "__metadata__":
                continue
            first, last = (8 + length + offset for offset in entry["data_offsets"])
            kind = np.dtype(SAFETENSORS[entry["dtype"]])
            arrays[name] = np.frombuffer(data[first:last], dtype=kind).reshape(entry["shape"])
            spans[name] = (first, last - first)
    except (ValueError, KeyError, TypeError, AttributeError, struct.error):
        return None
    return SavedArrays(path, arrays, spans)


def what_matters(array: NDArray[Any], matters: Callable[[Part], bool]) -> NDArray[Any] | None:
    """Return the smallest part of an array that the displacement needs; None if it needs no part.

    `matters` returns True if altering a part changes the answer. Parts are the slices along a short axis, such as
    components.
    """
    if not matters(()):
        return None
    least = array
    for axis, count in enumerate(array.shape):
        if 1 < count <= MOST_SLICES:
            needed = [i for i in range(count) if matters((*(slice(None),) * axis, i))]
            part = np.take(array, needed, axis)
            least = part if needed and part.size < least.size else least
    return least


def write_altered(saved: SavedArrays, name: str, part: Part, target: Path) -> Path:
    """Write the file with a small change in a part of one array."""
    array = saved.arrays[name]
    nudged = np.asarray(array * (1 + NUDGE) if array.dtype.kind in REALS else np.bitwise_xor(array, 1)).astype(
        array.dtype
    )
    changed = array.copy()
    changed[part] = nudged[part]
    if not saved.spans:
        with np.load(saved.path, allow_pickle=False) as data:
            everything = {n: data[n] for n in data.files}
        np.savez(target, allow_pickle=False, **{**everything, name: changed})
        return target
    first, length = saved.spans[name]
    data_bytes = bytearray(saved.path.read_bytes())
    data_bytes[first : first + length] = changed.tobytes()
    target.write_bytes(data_bytes)
    return target


def compressed_size(array: NDArray[Any]) -> int:
    """Return the compressed size of an array in bytes, with its bytes sorted by significance."""
    numbers = np.ascontiguousarray(array)
    planes = np.frombuffer(numbers.tobytes(), dtype=np.uint8).reshape(-1, max(1, numbers.dtype.itemsize)).T
    return min(len(zlib.compress(planes.tobytes(), HARDEST)), numbers.nbytes)


SAME = 1e-12  # relative difference of a displacement that was saved and loaded
COUNTED = 0.9  # least storage_bytes, as a share of the compressed bytes that matter


def saving(exam: Examination, case: Problem) -> Verdict:
    """Check that an answer is the same after saving and loading in another process; the file must be no pickle."""
    found, answer = Findings(), exam.solve(case)
    path = answer.save(exam.folder / "saved")
    if not found.hold(path.is_file() or path.is_dir(), f"save says that it wrote {path.name}; there is no such file"):
        return found.verdict()
    found.hold(not is_pickled(path), "the saved file is, or holds, a pickle, which runs what it likes when it is read")
    kept = _moved(path, exam.folder / "kept")
    with exam.fresh() as other:
        loaded = load_in(other, "loaded", case, kept)
        difference = deviation(identity_of(answer), identity_of(loaded))
        found.hold(difference <= SAME, f"loaded, its {identity_words(case)} differs by {difference:.1e}")
        for count in ("parameters", "storage_bytes"):
            same = loaded.facts[count] == answer.facts[count]
            found.hold(same, f"loaded, its {count} are {loaded.facts[count]}, not {answer.facts[count]}")
        nothing = exam.folder / "no_solution"
        nothing.write_bytes(b"nothing that a solver has written")
        _refuses(found, other, case, nothing)
    found.figures.append(f"{path.suffix or 'folder'}, {identity_words(case)} the same to {difference:.1e}")
    return found.verdict()


def identity_of(answer: RemoteSolution) -> NDArray[np.float64]:
    """Return the values that identify a kept answer: displacements at points of a shell, else all quantities."""
    case = answer.case
    if not isinstance(case, Case):
        return answer.values()
    return answer.displacement(np.concatenate([grid(case, SIDES), scattered(case, 50, seed=8)]))


def identity_words(case: Problem) -> str:
    """Return the name of the values that identify an answer."""
    return "displacement" if isinstance(case, Case) else "figures"


def _moved(path: Path, folder: Path) -> Path:
    """Move a saved solution to an empty folder under another name, as stores do; return its path."""
    folder.mkdir()
    return Path(shutil.move(path, folder / f"answer{path.suffix}"))


def _refuses(found: Findings, subject: Respondent, case: Problem, path: object) -> None:
    try:
        subject.call("load", "nothing", str(path))
        found.faults.append("it loads a file that no solver wrote")
    except Lost as trouble:
        found.faults.append(f"given a file that no solver wrote: {trouble}")
    except NoAnswer:
        pass


def counts(exam: Examination, case: Problem) -> Verdict:
    """Check that `parameters` is an integer, and for a shell that it grows with refinement."""
    found, answer = Findings(), exam.solve(case)
    fewest = 0 if isinstance(case, Case) and case.prescribed else 1
    number = answer.facts["parameters"]
    if not found.hold(
        isinstance(number, int) and number >= fewest, f"its parameters are {number}, no positive integer"
    ):
        return found.verdict()
    if not isinstance(case, Case):
        found.figures.append(f"{number} parameters")
        return found.verdict()
    chosen, reason = refinements(exam, case)
    if not chosen:
        found.figures.append(f"{number} parameters")
        found.unseen.append(f"whether they grow: {reason}")
        return found.verdict()
    coarse, fine = (exam.solve(case, chosen[i]).facts["parameters"] for i in (0, -1))
    grows = isinstance(coarse, int) and isinstance(fine, int) and coarse < fine
    found.hold(
        grows, f"refined, its parameters go from {coarse} to {fine}", f"{number}; refined from {coarse} to {fine}"
    )
    return found.verdict()


def storage(exam: Examination, case: Problem) -> Verdict:
    """Check that `storage_bytes` counts the numbers of the saved file that the answer needs."""
    found, answer = Findings(), exam.solve(case)
    stated = answer.facts["storage_bytes"]
    if not found.hold(isinstance(stated, int) and stated > 0, f"its storage_bytes are {stated}, no positive integer"):
        return found.verdict()
    saved = read_arrays(answer.save(exam.folder / "counted"))
    if saved is None:
        return not_shown(f"states {stated} bytes; the saved file is neither npz nor safetensors")
    u = identity_of(answer)
    needed, names, untold, unknown = 0, [], [], 0
    with exam.fresh() as other:
        for name, array in saved.arrays.items():
            if array.size == 0 or (array.dtype.kind in REALS and not np.any(array)):
                continue

            def matters(part: Part, name: str = name) -> bool:
                changed = write_altered(saved, name, part, exam.folder / f"altered{saved.path.suffix}")
                return deviation(u, identity_of(_loaded(other, answer, changed))) > 0

            try:
                least = what_matters(array, matters)
            except Lost:
                raise
            except NoAnswer:
                untold.append(name)
                unknown += compressed_size(array) if array.dtype.kind in REALS else 0
                continue
            if least is not None:
                needed += compressed_size(least)
                names.append(name)
    arrays = ", ".join(names) or "no arrays"
    words = f"states {stated} bytes; what its {identity_words(case)} needs, compressed: {needed} ({arrays})"
    if untold:
        words += f"; {', '.join(untold)} can't be altered"
    if not names or COUNTED * needed <= stated < COUNTED * (needed + unknown):
        found.unseen.append(words)
    else:
        found.hold(stated >= COUNTED * needed, words, words)
    return found.verdict()


def _loaded(subject: Respondent, answer: RemoteSolution, path: object) -> RemoteSolution:
    return RemoteSolution(subject, "altered", answer.case, subject.call("load", "altered", str(path)))
