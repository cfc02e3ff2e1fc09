"""Views as the page keeps them: whole numbers of two bytes, their differences from point to point, compressed.

The first answer is rounded to 1/32767 of its largest component. Of the others the differences from it are kept, so
that what two solvers differ by is rounded relative to the difference, however small it is beside the displacement.
"""

from __future__ import annotations

import base64
import gzip
import json
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from shellbench.report.shells import BOTH_SIGNS, DIVERGING, SEQUENTIAL
from shellbench.report.view import View

Array = NDArray[np.float64]

LARGEST = 32767  # of two bytes
APART = "cividis"  # colours of differences, told from those of displacements
SAME = 1e-9  # of directions
STOPS = 33  # of a colour map; between them colours are interpolated


def view_json(view: View) -> str:
    """Return the view as JSON that may stand in a script element, `data` its arrays as packed by `packed`."""
    planes: list[NDArray[np.int16]] = []
    centre = (view.position.min(axis=(0, 1)) + view.position.max(axis=(0, 1))) / 2
    position = _kept(view.position - centre, planes)
    answers: list[dict[str, Any]] = []
    first: list[Array | None] = [None] * len(view.marks)
    for place, answer in enumerate(view.answers):
        states: list[dict[str, Any] | None] = []
        for mark, state in enumerate(answer.states):
            if state is None:
                states.append(None)
                continue
            base = first[mark]
            step = _kept(state if base is None else state - base, planes)
            states.append({"step": step, "relative": base is not None})
            if not place:
                first[mark] = state
        density = None if answer.density is None else _kept(answer.density[..., None], planes)
        answers.append({"label": answer.label, "run": answer.run_id, "states": states, "density": density})
    held = {
        "case": view.case,
        "title": view.title,
        "unit": view.unit,
        "density_unit": "J/m²" if view.unit == "m" else f"N {view.unit}/{view.unit}²",
        "shape": view.position.shape[:2],
        "centre": centre.tolist(),
        "position": position,
        "marks": view.marks,
        "held": view.held,
        "scale": view.scale,
        "largest_scale": view.largest_scale,
        "look": [view.camera.azimuth, view.camera.elevation],
        "up": view.camera.up,
        "along": along(view.direction),
        "answers": answers,
        "data": packed(planes),
    }
    return in_script(held)


def palettes_json() -> str:
    """Return the colour maps, and when a component is coloured about zero, as in the still pictures."""
    maps = {"sequential": SEQUENTIAL, "diverging": DIVERGING, "difference": APART}
    stops = np.linspace(0.0, 1.0, STOPS)
    found = {use: [[round(float(s), 5), to_hex(colormaps[name](s))] for s in stops] for use, name in maps.items()}
    return in_script({"maps": found, "both_signs": BOTH_SIGNS})


def in_script(value: Any) -> str:
    """Write JSON that can't end the script element which it stands in."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


def packed(planes: list[NDArray[np.int16]]) -> str:
    """Return base64 of gzip of the planes one after another, each as differences from one point to the next."""
    steps = [np.diff(plane, prepend=np.int16(0)).astype("<i2") for plane in planes]  # they wrap around, and back again
    return packed_bytes(np.concatenate(steps).tobytes() if steps else b"")


def packed_bytes(data: bytes) -> str:
    """Return base64 of gzip, the same for the same bytes."""
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode("ascii")


def _kept(values: Array, planes: list[NDArray[np.int16]]) -> float:
    """Add the components of values (n1, n2, k) to the planes and return the step of their rounding."""
    step = float(np.abs(values).max() / LARGEST) or 1.0
    whole = np.rint(values / step).astype(np.int16)
    planes += [whole[..., k].ravel() for k in range(values.shape[-1])]
    return step


def along(direction: tuple[float, float, float] | None) -> dict[str, Any] | None:
    """Return the unit vector along which the still picture is coloured, and its symbol, % standing for u; or None."""
    if direction is None:
        return None
    vector = np.asarray(direction) / np.linalg.norm(direction)
    axis = int(np.argmax(np.abs(vector)))
    if abs(vector[axis]) > 1 - SAME:
        symbol = f"{'−' if vector[axis] < 0 else ''}%<sub>{'xyz'[axis]}</sub>"
    else:
        symbol = f"% along ({', '.join(f'{part:g}' for part in direction)})".replace("-", "−")
    return {"vector": vector.tolist(), "symbol": symbol}
