r"""Shells drawn by a seed, each with its exact answer, as a test of solvers' stated uncertainties.

`python -m derivations.drawn_shells FOLDER [COUNT]` writes a case file for each seed from 0. `manufactured` computes the
load that gives the drawn displacement; it shares no code with the solvers.

1. Surface: a height z = f(xi1, xi2) of degree 3 over a parallelogram: flat, singly curved, or of either sign of the
   curvature, in coordinates that cross at 59 to 121 degrees.
2. Material: the thickness from 1/20 to 1/200 of the span, evenly by its logarithm, and Poisson's ratio.
3. Supports: all edges clamped, all hinged, or two clamped and two free.
4. Displacement: u = p t^a x,a + q w n, with n = x,1 x x,2, where p and q vanish at the edges so often that
   clamped edges have neither displacement nor rotation (p of order 1, q of order 2), hinged ones no displacement nor
   moment (2, 3), free ones nothing that needs a force (4, 4). t and w are random polynomials and waves.
5. Uncertainty of the known values: the declared load is a polynomial, and differs from that of the strong form by df. The
   answer changes by at most |df| / (lowest stiffness). The lowest stiffness is estimated by that of a plate strip between
   clamps, B (4.73 / L)^4; stretching makes the shell stiffer. The uncertainty is ten times this bound.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from shellbench.problems.shell.case import Case

from .manufactured import exact_formulas, load_formulas, manufactured_load, parametric_rule, values_of

COUNT = 48
SPAN = 2.0  # m, of both coordinates
THICKNESSES = 0.01, 0.1  # m
HEIGHT = 1e-3  # m: what the displacement is about as large as
DROPPED = 1e-14  # part of the largest load below which a coefficient is dropped
LOWEST = 4.730040744862704  # first root of cosh x cos x = 1: a beam between clamps vibrates by (x / L)^4
SURE = 10.0  # times the response to what the load misses
TOLERANCE = 1e-2  # of every gated figure: the loosest class
FAMILIES = ("plane", "cylinder", "paraboloid", "saddle", "wavy")
RIMS = ("clamped", "hinged", "two free")
ORDERS = {"clamped": (1, 2), "hinged": (2, 3), "free": (4, 4)}
"""Number of times that the tangential and the normal part of the displacement vanish at an edge."""


def drawn(seed: int) -> dict[str, Any]:
    """Return the case of a seed as data, without its load and what is known of it."""
    rng = np.random.default_rng(seed)
    family, rim = FAMILIES[seed % len(FAMILIES)], RIMS[seed // len(FAMILIES) % len(RIMS)]
    shear = round(rng.uniform(-0.6, 0.6), 2)
    height, slopes = _height(rng, family)
    thickness = float(f"{THICKNESSES[0] * (THICKNESSES[1] / THICKNESSES[0]) ** rng.uniform():.3g}")
    edges = [["xi1_min", "xi1_max"], ["xi2_min", "xi2_max"]]
    ends = ["hinged" if rim == "hinged" else "clamped", "free" if rim == "two free" else rim]
    held = [edge for pair, end in zip(edges, ends, strict=True) if end != "free" for edge in pair]
    support = {"name": "rim", "on": held} | ({"clamped": True} if rim != "hinged" else {})
    points = np.round(rng.uniform(-0.7, 0.7, (2, 2)), 2).tolist()
    return {
        "title": f"Drawn shell {seed}: {family}, {rim}, h = {thickness:g}",
        "description": "Drawn by its seed, with the load under which the drawn displacement is the answer.",
        "theory": "kirchhoff-love-linear",
        "surface": {
            "kind": "expression",
            "x": f"xi1 + {shear}*xi2",
            "y": "xi2",
            "z": height,
            **{f"xi{k}": [-SPAN / 2, SPAN / 2] for k in (1, 2)},
        },
        "material": {
            "youngs_modulus": 1e7,
            "poissons_ratio": round(rng.uniform(0.0, 0.45), 2),
            "thickness": thickness,
        },
        "points": {"one": points[0], "other": points[1]},
        "supports": [support],
        "quantities": [
            {"name": "largest_displacement", "kind": "largest_displacement", "primary": True},
            {"name": "field_error", "kind": "field_error", "exact": _displacement(rng, slopes, shear, ends)},
            {"name": "one_displacement", "kind": "displacement", "points": ["one"], "direction": [1, 2, -2]},
            {"name": "other_displacement", "kind": "displacement", "points": ["other"], "direction": [0, 0, 1]},
            *({"name": f"{kind}_energy", "kind": f"{kind}_energy"} for kind in ("strain", "membrane", "bending")),
        ],
    }


def _height(rng: np.random.Generator, family: str) -> tuple[str, tuple[str, str]]:
    """Return the formula of the height and those of its slopes."""
    a, b, c, d = (round(one, 3) for one in rng.uniform(0.08, 0.2, 4))
    p, q, r, s = {
        "plane": (0, 0, 0, 0),
        "cylinder": (a, 0, 0, 0),
        "paraboloid": (a, 0, b, 0),
        "saddle": (a, 0.5 * c, -b, 0),
        "wavy": (a, c, -b, d),
    }[family]
    height = f"-({p}*xi1**2 + {q}*xi1*xi2 + {r}*xi2**2 + {s}*xi1**2*xi2/2)"
    return height, (f"-({2 * p}*xi1 + {q}*xi2 + {s}*xi1*xi2)", f"-({q}*xi1 + {2 * r}*xi2 + {s}*xi1**2/2)")


def _displacement(rng: np.random.Generator, slopes: tuple[str, str], shear: float, ends: list[str]) -> list[str]:
    """Return the formulas of x, y and z: with f,1 and f,2, x,1 = (1, 0, f,1), x,2 = (s, 1, f,2), n their product."""
    edge = [f"(1 - xi{k + 1}**2)" for k in (0, 1)]
    along, across = ("*".join(f"{edge[k]}**{ORDERS[end][part]}" for k, end in enumerate(ends)) for part in (0, 1))
    first, second = (f"({_polynomial(rng, 0.1)})" for _ in range(2))
    k, m, phase = np.round(rng.uniform([0.0, 0.0, 0.0], [4.0, 4.0, 6.0]), 2)
    wave = f"{round(rng.uniform(0.0, 0.6), 2)}*cos({k}*xi1 + {m}*xi2 + {phase})"
    normal = f"(1 + {_polynomial(rng, 0.5)} + {wave})"
    f1, f2 = (f"({slope})" for slope in slopes)
    return [
        f"{HEIGHT}*({along}*({first} + {shear}*{second}) - {across}*{normal}*{f1})",
        f"{HEIGHT}*({along}*{second} + {across}*{normal}*({shear}*{f1} - {f2}))",
        f"{HEIGHT}*({along}*({first}*{f1} + {second}*{f2}) + {across}*{normal})",
    ]


def _polynomial(rng: np.random.Generator, size: float) -> str:
    c = np.round(rng.uniform(-size, size, 4), 3)
    return f"{c[0]} + {c[1]}*xi1 + {c[2]}*xi2 + {c[3]}*xi1*xi2"


def with_load(data: dict[str, Any], name: str) -> tuple[Case, dict[str, Any]]:
    """Return the case with its load, and all of it as data, what is known of it included."""
    nothing = {"loads": [{"kind": "area", "vector": [0, 0, 1]}]}
    bare = Case.model_validate(data | nothing | {"name": name})
    whole = data | {"loads": [{"kind": "area", "vector": list(load_formulas(bare, DROPPED))}]}
    case = Case.model_validate(whole | {"name": name})
    doubt = SURE * response(case)
    known = values_of(case, doubt)
    size = known["largest_displacement"].value
    whole["known"] = [
        {
            "quantity": quantity.name,
            "value": (value := known[quantity.name].value),
            # A field that is wrong by so much of its size may be wrong by so much of its size at each point.
            "uncertainty": doubt * size if quantity.kind == "displacement" else known[quantity.name].uncertainty,
            "source": "prescribed, the load by the equations of equilibrium",
            "tolerance": TOLERANCE * (size if quantity.kind == "displacement" else value or 1.0),
            "absolute": True,
        }
        for quantity in case.quantities
    ]
    return case, whole


def response(case: Case) -> float:
    """Return a bound of the relative difference between the answer to the declared load and the prescribed answer."""
    points, weights = parametric_rule(case, 30)
    missed = case.evaluate(case.loads[0].vector, points)[0, 0] - manufactured_load(case, points)
    exact = case.evaluate(exact_formulas(case), points)[0, 0]
    size, force = (float(np.sqrt(weights @ np.sum(one**2, axis=-1))) for one in (exact, missed))
    return force / (case.material.bending_stiffness * (LOWEST / SPAN) ** 4) / size


def as_toml(data: dict[str, Any]) -> str:
    """Return a case as the text of its file."""
    tables = {key: value for key, value in data.items() if isinstance(value, dict)}
    lists = {key: value for key, value in data.items() if isinstance(value, list)}
    lines = [f"{key} = {_value(value)}" for key, value in data.items() if key not in tables | lists]
    for key, table in tables.items():
        lines += ["", f"[{key}]", *(f"{name} = {_value(value)}" for name, value in table.items())]
    for key, entries in lists.items():
        for table in entries:
            lines += ["", f"[[{key}]]", *(f"{name} = {_value(value)}" for name, value in table.items())]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    """Return a value as TOML writes it."""
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)


def write(folder: Path, count: int = COUNT) -> Iterator[Path]:
    """Write the cases of the first seeds; yield their files."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(count):
        path = folder / f"drawn_{seed}.toml"
        _, data = with_load(drawn(seed), path.stem)
        path.write_text(as_toml(data), encoding="utf-8")
        yield path


if __name__ == "__main__":
    for path in write(Path(sys.argv[1]), *map(int, sys.argv[2:3])):
        print(path)
