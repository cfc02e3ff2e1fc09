"""Turning views of the page: each solver's displacement of one case, state by state, with the scripts that show it.

A view is stored as compressed two-byte integers, as differences from point to point. The first answer is rounded to
1/32767 of its largest component. Every other answer is stored as its difference from the first. The rounding of this
difference is therefore relative to the difference, even if it is small beside the displacement.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from shellbench.bench.store.record import Record, portrait_of
from shellbench.errors import ShellbenchError
from shellbench.protocol.picture import Portrait
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.fields import Fields, kept_arrays, read_fields, read_ribbon
from shellbench.report.figures.grids import inward
from shellbench.report.figures.pictures import PICTURE, near_obstacles, picture_scale, pictured, spread
from shellbench.report.figures.shells import BOTH_SIGNS, DIVERGING, SEQUENTIAL, axis_of

Array = NDArray[np.float64]
Planes = list[NDArray[np.int16]]

ROUGH = 21  # points a side of obstacles at most
FINE, COARSE = 61, 31  # points a side at most, of one state and of several
MOST_STATES = 21  # on a slider: more are not told apart, and each takes its bytes
NARROW, MOST_OF_NARROW = 2, 61  # points a side of a chain, whose states take few bytes
MARK_DIGITS = 6  # marks that agree in so many digits are the same state
ENERGY_PARTS = ("membrane_energy_density", "bending_energy_density")
MAGNIFIED = 2.0  # the slider's end, in picture scales, where displacements are small
LARGEST = 32767  # of two bytes
APART = "cividis"  # colours of differences, told from those of displacements
STOPS = 33  # of a colour map; between them colours are interpolated
HOLDER = "(window.shellbench = window.shellbench || {}).library = "
LIBRARY = "plotly.js"  # beside the pages, which share it


@dataclass(frozen=True)
class View:
    """One case, to be turned.

    Attributes
    ----------
    json
        What is seen: it may stand in a script element.
    run_ids
        Of the runs that answer.
    dense
        Whether a strain energy density is kept of any.
    """

    json: str
    run_ids: tuple[str, ...]
    dense: bool


def views(evidence: Evidence, first: Mapping[str, str] | None = None) -> dict[str, View]:
    """Return a view of each case of which a run kept its field, by name of case.

    Parameters
    ----------
    first
        By name of case the run that is seen first: the one that the still picture shows.
    """
    found: dict[str, View] = {}
    for case, of_case in pictured(evidence.records, evidence.compared).items():
        lead = (first or {}).get(case)
        made = view(sorted(of_case, key=lambda record: record.run_id != lead), evidence.folder)
        found |= {} if made is None else {case: made}
    return found


def view(records: Sequence[Record], folder: Path) -> View | None:
    """Return the view of one case; None if none of its records has a field that can be read."""
    case = portrait_of(records[0]) if records else None
    if case is None:
        return None
    kept_by = ((record, read_fields(record, folder) or read_ribbon(record, folder, case)) for record in records)
    found = [(record, fields) for record, fields in kept_by if fields is not None]
    case = portrait_of(found[0][0]) if found else None
    if case is None or case.scene is None:
        return None
    scene, grid = case.scene, found[0][1].position
    answers = [(record, fields, states_of(fields)) for record, fields in found if fields.position.shape == grid.shape]
    most = MOST_STATES if grid.shape[1] > NARROW else MOST_OF_NARROW
    marks = spread(sorted({mark for _, _, states in answers for mark in states}), most)
    several = len(marks) > 1 or case.ends is not None
    thin = stride(len(grid), FINE if len(marks) == 1 else COARSE)
    scale = picture_scale(scene, grid, [state for _, _, states in answers for state in states.values()])
    planes: Planes = []
    position = grid[::thin, ::thin]
    centre = (position.min(axis=(0, 1)) + position.max(axis=(0, 1))) / 2
    kept: dict[str, Any] = {
        "case": found[0][0].case_name,
        "title": case.title,
        "what": "chain that moves" if case.frames else "deformed shell",
        "unit": case.unit_of_length,
        "shape_unit": case.unit_of_shape or "scaled",
        "density_unit": _density_unit(case.unit_of_shape),
        "shape": position.shape[:2],
        "centre": centre.tolist(),
        "position": _kept(position - centre, planes),
        "marks": [case.mark_words(mark) if several else "" for mark in marks],
        "held": tuple(dict.fromkeys(scene.held)),
        "scale": scale,
        "largest_scale": scale * (1.0 if several else MAGNIFIED),
        "look": scene.view[::-1],
        "up": scene.up,
        "along": along(scene.direction, grid[::thin, ::thin], planes),
        "obstacles": _obstacles(case, position, [state for _, _, states in answers for state in states.values()]),
        "answers": [],
    }
    for record, fields, states in answers:
        steps: list[dict[str, Any] | None] = []
        for mark in marks:
            base = answers[0][2].get(mark) if kept["answers"] else None
            state = None if mark not in states else states[mark] if base is None else states[mark] - base
            whole = None if state is None else _kept(state[::thin, ::thin], planes)
            steps.append(None if whole is None else {"step": whole, "relative": base is not None})
        density = energy_density(record, fields, folder) if max(states) in marks else None
        label = record.identity.solver + ("" if record.status == "ok" else f" ({record.status})")
        dense = None if density is None else _kept(density[::thin, ::thin, None], planes)
        kept["answers"].append({"label": label, "run": record.run_id, "states": steps, "density": dense})
    run_ids = tuple(record.run_id for record, _, _ in answers)
    dense = any(one["density"] is not None for one in kept["answers"])
    return View(in_script(kept | {"data": packed(planes)}), run_ids, dense)


def _obstacles(case: Portrait, position: Array, displacements: Sequence[Array]) -> list[dict[str, Any]]:
    """Return points at rest and their ways to each obstacle, rows of x, y and z; null where none is drawn."""
    thin = stride(len(position), ROUGH)
    found = []
    for at, way in near_obstacles(case, position[::thin, ::thin], displacements):
        grids = {"at": at, "way": way}
        found.append({name: [_short(grid[..., k]) for k in range(3)] for name, grid in grids.items()})
    return found


def _short(values: Array) -> list[list[float | None]]:
    return [[float(f"{v:.4g}") if np.isfinite(v) else None for v in row] for row in values]


def energy_density(record: Record, fields: Fields, folder: Path) -> Array | None:
    """Return the strain energy per area (n1, n2) that a run kept; None if it kept none or it is not finite."""
    parts = kept_arrays(record, folder, *ENERGY_PARTS)
    if parts is None or any(part.shape != fields.xi.shape[:2] for part in parts):
        return None
    return np.asarray(np.sum(parts, axis=0))


def states_of(fields: Fields) -> dict[float, Array]:
    """Return the displacements that a run kept, by mark; the mark of a linear answer is 1."""
    if not len(fields.marks):
        return {1.0: fields.displacement}
    return dict(zip((float(f"{mark:.{MARK_DIGITS}g}") for mark in fields.marks), fields.displacements, strict=True))


def stride(points: int, most: int) -> int:
    """Return the smallest step through a grid's points a side that keeps both ends and leaves at most `most`."""
    steps = (step for step in range(1, points) if (points - 1) % step == 0 and (points - 1) // step < most)
    return next(steps, points - 1)


def palettes_json() -> str:
    """Return the colour maps, and when a component is coloured about zero, as in the still pictures."""
    maps = {"sequential": SEQUENTIAL, "diverging": DIVERGING, "difference": APART}
    stops = np.linspace(0.0, 1.0, STOPS)
    found = {use: [[round(float(s), 5), to_hex(colormaps[name](s))] for s in stops] for use, name in maps.items()}
    return in_script({"maps": found, "both_signs": BOTH_SIGNS})


def in_script(value: Any) -> str:
    """Write JSON that can't end the script element which it stands in."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


def packed(planes: Planes) -> str:
    """Return base64 of gzip of the planes one after another, each as differences from one point to the next."""
    steps = [np.diff(plane, prepend=np.int16(0)).astype("<i2") for plane in planes]  # they wrap around, and back again
    return packed_bytes(np.concatenate(steps).tobytes() if steps else b"")


def packed_bytes(data: bytes) -> str:
    """Return base64 of gzip, the same for the same bytes."""
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode("ascii")


def _kept(values: Array, planes: Planes) -> float:
    """Add the components of values (n1, n2, k) to the planes and return the step of their rounding."""
    step = float(np.abs(values).max() / LARGEST) or 1.0
    whole = np.rint(values / step).astype(np.int16)
    planes += [whole[..., k].ravel() for k in range(values.shape[-1])]
    return step


def along(
    direction: tuple[float, float, float] | Literal["inward"] | None, position: Array, planes: Planes
) -> dict[str, Any] | None:
    """Return the unit vector along which the still picture is coloured, and its symbol, % standing for u; or None.

    Of a surface that is coloured by its inward displacement the vectors are added to the planes, point by point.
    """
    if direction is None:
        return None
    if direction == "inward":
        return {"inward": _kept(inward(position), planes), "symbol": "inward %"}
    vector, axis = np.asarray(direction) / np.linalg.norm(direction), axis_of(direction)
    symbol = f"{axis[0]}%<sub>{axis[1]}</sub>" if axis else f"% along ({', '.join(f'{part:g}' for part in direction)})"
    return {"vector": vector.tolist(), "symbol": symbol.replace("-", "\N{MINUS SIGN}")}


def scripts(viewing: bool) -> tuple[str, ...]:
    """Return the scripts that stand in a page that has views, or none."""
    names = ("sort.js", "view.js") if viewing else ("sort.js",)
    return tuple((files("shellbench.report") / "templates" / name).read_text(encoding="utf-8") for name in names)


def script_sources(viewing: bool) -> tuple[str, ...]:
    """Return sources for the content security policy: by hash these scripts and Plotly, and the own folder."""
    run = (*scripts(viewing), *([plotly()] if viewing else []))
    hashes = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in run)
    return (*(f"'sha256-{text}'" for text in hashes), *(["'self'"] if viewing else []))


def library() -> str:
    """Return the script that holds Plotly, compressed, as base64."""
    return f"{HOLDER}{json.dumps(packed_bytes(plotly().encode()))};\n"


@cache
def plotly() -> str:
    """Return the library from plotly's package, which is not imported: that takes longer than to read the file."""
    spec = find_spec("plotly")
    if spec is None or not spec.submodule_search_locations:
        raise ShellbenchError("plotly, which draws in three dimensions, is not installed")
    return (Path(spec.submodule_search_locations[0]) / "package_data" / "plotly.min.js").read_text(encoding="utf-8")


def _density_unit(unit: str) -> str:
    """Return the unit of energy per area where displacements are in this unit; none where these are only scaled."""
    return {"m": "J/m²", "": "scaled"}.get(unit, f"N {unit}/{unit}²")


def page_scripts(turned: Mapping[str, View]) -> dict[str, Any]:
    """Return the views by the name of the picture that each takes the place of, and what runs in the page."""
    return {
        "views": {f"{PICTURE}{case}": one.json for case, one in turned.items()},
        "dense": any(one.dense for one in turned.values()),
        "palettes": palettes_json(),
        "scripts": scripts(viewing=bool(turned)),
        "library": LIBRARY if turned else "",
        "script_hashes": script_sources(viewing=bool(turned)),
    }
