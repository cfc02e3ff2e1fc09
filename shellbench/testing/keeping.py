"""Checks of what is kept of an answer: that it comes back whole, and that its size is counted honestly."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.testing.convergence import refinements
from shellbench.testing.examination import Examination, Findings, Verdict, apart, grid, not_shown, scattered
from shellbench.testing.files import REALS, Part, altered, compressed_size, pickled, read_arrays, what_matters
from shellbench.testing.subject import Answer, Lost, NoAnswer, Respondent, load_in

SAME = 1e-12  # relative difference of a displacement that was saved and loaded
COUNTED = 0.9  # of the compressed bytes that matter: what storage_bytes must state at least


def saving(exam: Examination, case: Case) -> Verdict:
    """Check that, saved and loaded in another process, the answer is the same; the file is no pickle."""
    found, answer = Findings(), exam.solve(case)
    path = answer.save(exam.folder / "saved")
    if not found.hold(path.is_file() or path.is_dir(), f"save says that it wrote {path.name}; there is no such file"):
        return found.verdict()
    found.hold(not pickled(path), "the saved file is, or holds, a pickle, which runs what it likes when it is read")
    points = np.concatenate([grid(case), scattered(case, 50, seed=8)])
    kept = _moved(path, exam.folder / "kept")
    with exam.fresh() as other:
        loaded = load_in(other, "loaded", case, kept)
        difference = apart(answer.displacement(points), loaded.displacement(points))
        found.hold(difference <= SAME, f"loaded, its displacement differs by {difference:.1e}")
        for count in ("parameters", "storage_bytes"):
            same = loaded.facts[count] == answer.facts[count]
            found.hold(same, f"loaded, its {count} are {loaded.facts[count]}, not {answer.facts[count]}")
        nothing = exam.folder / "no_solution"
        nothing.write_bytes(b"nothing that a solver has written")
        _refuses(found, other, case, nothing)
    found.figures.append(f"{path.suffix or 'folder'}, displacement the same to {difference:.1e}")
    return found.verdict()


def _moved(path: Path, folder: Path) -> Path:
    """Move what was saved to where nothing else lies, under another name, as stores do; return where it is."""
    folder.mkdir()
    return Path(shutil.move(path, folder / f"answer{path.suffix}"))


def _refuses(found: Findings, subject: Respondent, case: Case, path: object) -> None:
    try:
        subject.call("load", "nothing", str(path))
        found.faults.append("it loads a file that no solver wrote")
    except Lost as trouble:
        found.faults.append(f"given a file that no solver wrote: {trouble}")
    except NoAnswer:
        pass


def counts(exam: Examination, case: Case) -> Verdict:
    """Check that `parameters` is a whole number that grows with refinement."""
    found, answer = Findings(), exam.solve(case)
    fewest = 0 if case.prescribed else 1
    number = answer.facts["parameters"]
    if not found.hold(
        isinstance(number, int) and number >= fewest, f"its parameters are {number}, no positive integer"
    ):
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


def storage(exam: Examination, case: Case) -> Verdict:
    """Check that `storage_bytes` counts the numbers of the saved file without which the displacement is another."""
    found, answer = Findings(), exam.solve(case)
    stated = answer.facts["storage_bytes"]
    if not found.hold(isinstance(stated, int) and stated > 0, f"its storage_bytes are {stated}, no positive integer"):
        return found.verdict()
    saved = read_arrays(answer.save(exam.folder / "counted"))
    if saved is None:
        return not_shown(f"states {stated} bytes; the saved file is neither npz nor safetensors")
    points = scattered(case, 100, seed=9)
    u = answer.displacement(points)
    needed, names, untold, unknown = 0, [], [], 0
    with exam.fresh() as other:
        for name, array in saved.arrays.items():
            if array.size == 0 or (array.dtype.kind in REALS and not np.any(array)):
                continue

            def matters(part: Part, name: str = name) -> bool:
                changed = altered(saved, name, part, exam.folder / f"altered{saved.path.suffix}")
                return apart(u, _loaded(other, answer, changed).displacement(points)) > 0

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
    words = f"states {stated} bytes; what displacement needs, compressed: {needed} ({', '.join(names) or 'no arrays'})"
    if untold:
        words += f"; {', '.join(untold)} can't be altered"
    if not names or COUNTED * needed <= stated < COUNTED * (needed + unknown):
        found.unseen.append(words)
    else:
        found.hold(stated >= COUNTED * needed, words, words)
    return found.verdict()


def _loaded(subject: Respondent, answer: Answer, path: object) -> Answer:
    return Answer(subject, "altered", answer.case, subject.call("load", "altered", str(path)))
