"""Copy the figures that README and docs show from built pages, small enough to be committed.

`python docs/evidence.py course` reads the page that `nox -s obstacle_course` has written; `python docs/evidence.py`
reads the two pages of some 60 MB that `nox -s example` and `nox -s engines` have built under reports/pages. It keeps

- the rows of the gated suites and of the ablations, and the headlines of the engines (table.json);
- the CSV files whose figures are quoted;
- the pictures that are shown.

`python docs/evidence.py resolution [STORE [REMARK]]` makes reports/resolution.json from the runs of the suite `resolution` on
the shells of the obstacle course (see docs/kept_resolution.py); `nox -s evidence` does both.

`python docs/evidence.py hinges` solves the four shells at rest by `cst-hinge`, and keeps the errors in reports/hinges.json.

`tests/test_readme.py` holds README and docs against these files.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "docs/figures"
BUILT = {
    "course": ROOT / "reports/latest",
    "example": ROOT / "reports/pages/example",
    "example_engines": ROOT / "reports/pages/example_engines",
}

WHOLE_SUITES = {"obstacle_course", "verification", "nonlinear", "cloth", "ablations", "strain_ablation"}
HEADLINE_SUITES = {"engines", "motion_engines"}
NOT_QUOTED = {"settings", "run_id", "idle_memory_bytes", "own_case", "declared", "dtype"}
NEEDED: dict[str, Any] = {
    "settings": {},
    "seed": None,
    "at": None,
    "value": None,
}  # keys of every row
QUOTED_CSV: dict[str, tuple[str, ...]] = {
    "course": (),
    "example": (
        "consistency", "memory_rounding", "newton", "sampling", "strains",
        "thinness_pinched_cylinder_rigid_diaphragms",
    ),
    "example_engines": ("cross_check",),
}  # fmt: skip
SHOWN = {
    "course": ("course_obstacle_course",),
    "example": (
        "cost_scordelis_lo", "frames_napkin_soft_pin", "newton", "states_cantilever_moment", "strain_rolled_plate",
    ),
    "example_engines": ("cross_check",),
}  # fmt: skip


def is_kept(row: Mapping[str, Any]) -> bool:
    """Return True if a row of a built table is committed."""
    suites = set(row["suites"])
    return bool(suites & WHOLE_SUITES) or (row["primary"] and bool(suites & HEADLINE_SUITES))


def shortened(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a row that pages quote. Empty fields and default settings are left out."""
    return NEEDED | {
        key: value for key, value in row.items() if key not in NOT_QUOTED and value not in (None, "", [], {})
    }


def reduce_table(source: Path, target: Path) -> None:
    """Write the rows that are kept, one a line."""
    rows = [json.dumps(shortened(row)) for row in json.loads(source.read_bytes()) if is_kept(row)]
    target.write_text("[\n" + ",\n".join(rows) + "\n]\n", encoding="utf-8")


def keep_few_colours(source: Path) -> None:
    """Write a picture with 256 colours: two fifths of its size, with visible loss on shaded shells only."""
    picture = Image.open(source).convert("RGB")
    few = picture.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    few.save(FIGURES / source.name, optimize=True)


def keep_resolution(store: str = "reports/runs", remark: str = "") -> None:
    """Replace the summary of the suite `resolution` by that of a store's runs, with a remark for readers."""
    from kept_resolution import as_text, of_store

    from shellbench.bench.catalogue import catalog
    from shellbench.bench.store.store import Store

    cases = catalog.find_suite("obstacle_course").order
    kept = of_store(Store(ROOT / store), cases)
    kept["made"]["remark"] = remark
    (ROOT / "reports/resolution.json").write_text(as_text(kept), encoding="utf-8")


def keep_hinges() -> None:
    """Solve the shells at rest by `cst-hinge`, and replace its errors that the README shows."""
    cases = ("square_plate", "scordelis_lo", "pinched_cylinder_diaphragm", "pinched_cylinder_free")
    with tempfile.TemporaryDirectory() as store:
        subprocess.run(("shellbench", "run", *cases, "--solver", "cst-hinge", "--store", store), check=True)
        table = subprocess.check_output(("shellbench", "table", *cases, "--store", store, "--format", "json"))
    rows = [
        {key: row[key] for key in ("case", "quantity", "relative_error")} for row in json.loads(table) if row["primary"]
    ]
    (ROOT / "reports/hinges.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def main(names: list[str]) -> None:
    """Replace the committed evidence of these pages by that of the built ones; without names, those of the example."""
    if names[:1] == ["resolution"]:
        keep_resolution(*names[1:])
        return
    if names == ["hinges"]:
        keep_hinges()
        return
    for name in names or ["example", "example_engines"]:
        built, kept = BUILT[name], ROOT / "reports" / name
        if not built.is_dir():  # such as the engines, which only Linux has
            continue
        for figure in SHOWN[name]:
            if not (built / "figures" / f"{figure}.png").is_file():
                raise SystemExit(f"{built} does not show {figure}: it is another page")
        shutil.rmtree(kept, ignore_errors=True)
        kept.mkdir(parents=True)
        reduce_table(built / "table.json", kept / "table.json")
        for csv_name in QUOTED_CSV[name]:
            shutil.copy(built / f"{csv_name}.csv", kept)
        for figure in SHOWN[name]:
            source = built / "figures" / f"{figure}.png"
            shutil.copy(source, FIGURES) if name == "course" else keep_few_colours(source)


if __name__ == "__main__":
    main(sys.argv[1:])
