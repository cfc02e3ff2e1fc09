"""Write the reference of the case format from the models that read case files: `python docs/case_format.py`.

Types, bounds and defaults come from the models' JSON schema. What a field means comes from the section "Attributes" of
its class or of a class that it inherits from, or from `Field(description=...)`; a field without either is an error.
Each fragment of `EXAMPLES` belongs to a whole case, one of `WHOLE`, which `tests/test_case_format.py` reads.
"""

from __future__ import annotations

import inspect
import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shellbench.bench.plugins.facts import attributes
from shellbench.problem import Problem
from shellbench.problems import obstacle
from shellbench.problems.expression import MAX_LENGTH
from shellbench.problems.field import body as ball
from shellbench.problems.field import case as field
from shellbench.problems.field import quantities as of_fields
from shellbench.problems.formula_functions import CONSTANTS, FUNCTIONS
from shellbench.problems.rope import case as rope
from shellbench.problems.rope import quantities as asked
from shellbench.problems.series import conditioned
from shellbench.problems.series import edited as editing
from shellbench.problems.series import quantities as of_materials
from shellbench.problems.series.quantities import EditedDisplacement
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities import quantities
from shellbench.problems.shell.question import surface
from shellbench.problems.skinning import body, cape
from shellbench.problems.skinning import case as skinning
from shellbench.problems.skinning import quantities as skinned
from shellbench.protocol.schema import LARGEST, Model

PAGE = Path(__file__).with_name("case_format.md")
CASES = PAGE.parents[1] / "cases"
SHOWN = "shellbench.problems", "shellbench.protocol.known_value"
"""Modules of the models that case files are read into."""
Schema = Mapping[str, Any]

WHOLE = {
    "linear": """
title = "A strip, held on one side"
theory = "kirchhoff-love-linear"
surface = { kind = "plane", xi1 = [0, 1], xi2 = [0, 1] }
material = { youngs_modulus = 1e7, poissons_ratio = 0.3, thickness = 0.01, areal_density = 0.1 }
points = { tip = [1, 0.5] }
supports = [{ name = "wall", on = ["xi1_min"], clamped = true }]
loads = []
quantities = [{ name = "headline", kind = "largest_displacement", primary = true }]
""",
}
WHOLE["path"] = WHOLE["linear"].replace("love-linear", "love-nonlinear").replace(
    "loads = []", 'loads = [{ kind = "edge", on = ["xi1_max"], vector = [0, 0, "4*t"] }]'
)  # fmt: skip
WHOLE["arc length"] = (
    WHOLE["path"]
    .replace('"largest_displacement"', '"displacement", points = ["tip"], direction = [0, 0, 1], at = 0.5')
    .replace("loads =", 'path = { control = "arc_length", quantity = "headline", until = 0.5 }\nloads =')
)
WHOLE["motion"] = WHOLE["linear"].replace("love-linear", "love-nonlinear") + "dynamics = { until = 1.0 }\n"
WHOLE["modes"] = WHOLE["linear"].replace("largest_displacement", "frequency")
WHOLE["forces"] = WHOLE["linear"] + 'edge_parts = { middle = { edge = "xi1_min", between = [0.2, 0.8] } }'
WHOLE["buckling"] = (
    WHOLE["linear"]
    .replace("largest_displacement", "buckling_load")
    .replace("loads = []", 'loads = [{ kind = "edge", on = ["xi1_max"], vector = [-1, 0, 0] }]')
)


@dataclass(frozen=True)
class Example:
    """A fragment of a case file, and the whole case that it makes sense in."""

    text: str
    whole: str = "linear"

    def case(self) -> dict[str, Any]:
        """Return the whole case with the fragment in it: tables are replaced, arrays of tables are continued."""
        data = tomllib.loads(WHOLE[self.whole])
        for key, value in tomllib.loads(self.text).items():
            longer = isinstance(value, list) and all(isinstance(entry, dict) for entry in value)
            data[key] = data.get(key, []) + value if longer else value
        if "mesh" in data["surface"]:
            data["surface"]["mesh"] = str(CASES / data["surface"]["mesh"])
        return data


EXAMPLES = {
    "Plane": Example('[surface]\nkind = "plane"\nxi1 = [0, 2]\nxi2 = [0, 1]'),
    "Cylinder": Example('[surface]\nkind = "cylinder"\naxis = "y"\nradius = 25\nxi1 = [0, 90]  # degrees\nxi2 = [0, 50]'),
    "ExpressionSurface": Example(
        '[surface]\nkind = "expression"\nx = "(r + xi2)*cos(xi1)"\ny = "(r + xi2)*sin(xi1)"\nz = "H*xi2**2"\n'
        'xi1 = [0, 90]           # degrees\nxi2 = [0, 1]\nangles = ["xi1"]\nconstants = { r = 2.0, H = 0.5 }'
    ),
    "MeshSurface": Example('[surface]\nkind = "mesh"\nmesh = "roof_mesh.obj"  # beside this file\nxi1 = [0, 1]\nxi2 = [0, 0.5]             # half of it'),
    "Material": Example(
        "[material]\nyoungs_modulus = 2e11  # Pa\npoissons_ratio = 0.3\nthickness = 0.01      # m\nareal_density = 8.0   # kg/m^2\nthickness_factor = \"1 - 0.5*xi1\"  # half as thick at xi1 = 1"
    ),
    "Support": Example(
        '[[supports]]\nname = "mirror"\non = ["xi2_min"]\nsymmetry = "y"\n\n'
        '[[supports]]\nname = "guide"\non = ["xi2_max"]\ncomponents = ["normal", "across"]  # it may slide along itself\n\n'
        '[[supports]]\nname = "rail"\non = ["xi1_max"]\ncomponents = ["z"]'
    ),
    "EdgePart": Example(
        '[edge_parts]\nhinge = { edge = "xi2_min", between = [0.2, 0.6] }\n\n[[supports]]\nname = "hinge"\non = ["hinge"]\ncomponents = ["z"]\n\n'
        '[[loads]]\nkind = "edge"\non = ["hinge"]\nvector = [1, 0, 0]'
    ),
    "Value": Example('[[supports]]\nname = "lifted"\non = ["xi1_max"]\ncomponents = ["z"]\nmotion = { kind = "value", z = "0.1*xi2" }'),
    "Translation": Example(
        '[[supports]]\nname = "pulled"\non = ["xi1_max"]\nmotion = { kind = "translation", vector = ["0.1*t", 0, 0] }', "path"
    ),
    "Rotation": Example(
        '[[supports]]\nname = "turned"\non = ["xi1_max"]\nclamped = true\n'
        'motion = { kind = "rotation", axis = [1, 0, 0], centre = [0, 0.5, 0], angle = "90*t" }',
        "path",
    ),
    "Spring": Example('[[springs]]\nname = "pin"\nstiffness = "1e4*exp(-(xi1**2 + xi2**2)/0.01)"', "motion"),
    "AreaLoad": Example('[[loads]]\nkind = "area"\nvector = [0, 0, "-1 - max(xi1 - 0.5, 0)"]  # grows from xi1 = 0.5 on'),
    "PressureLoad": Example('[[loads]]\nkind = "pressure"\nvalue = "100*t"\nfollows = true', "path"),
    "GravityLoad": Example('[[loads]]\nkind = "gravity"\nacceleration = [0, 0, -9.81]', "motion"),
    "EdgeLoad": Example(
        '[[loads]]\nkind = "edge"\non = ["xi1_max"]\nvector = [0, 0, "sin(pi*xi2)"]\n\n'
        '[[loads]]\nkind = "edge"\non = ["xi1_max"]\nvector = [0, 5, 0]  # pulls at the edge\nframe = "local"'
    ),
    "PointLoad": Example('[[loads]]\nkind = "point"\non = ["tip", "xi1_max,xi2_min"]\nforce = [0, 0, -2]'),
    "MomentLoad": Example('[[loads]]\nkind = "moment"\non = ["xi1_max"]\naxis = [0, -1, 0]\nvalue = "0.5*t"', "path"),
    "HalfSpace": Example('[[obstacles]]\nkind = "plane"\ncentre = [0, 0, -0.01]\nnormal = [0, 0, 1]'),
    "Plate": Example('[[obstacles]]\nkind = "plate"\ncentre = [0, 0, -0.2]\nnormal = [0, 0, 1]\nhalf_thickness = 0.1'),
    "Sphere": Example('[[obstacles]]\nkind = "sphere"\ncentre = [0.5, 0.5, -1.01]\nradius = 1.0'),
    "Capsule": Example('[[obstacles]]\nkind = "capsule"  # a cylinder, where it is long\ncentre = [0.5, 0.5, -1.01]\nhalf_axis = [0, 10, 0]\nradius = 1.0'),
    "Box": Example('[[obstacles]]\nkind = "box"\ncentre = [0.5, 0.5, -0.2]\nhalf_sides = [0.3, 1.0, 0.1]'),
    "FormulaBody": Example('[[obstacles]]\nkind = "formula"\nphi = "z + 0.01 + 0.1*(x - 0.5)**2"'),
    "Contact": Example('[[obstacles]]\nkind = "plane"\ncentre = [0, 0, -0.01]\nnormal = [0, 0, 1]\n\n[contact]\nthickness = true  # the lower face touches'),
    "ContactForce": Example('[[obstacles]]\nkind = "plane"\ncentre = [0, 0, -0.01]\nnormal = [0, 0, 1]\n\n[[quantities]]\nname = "floor_force"\nkind = "contact_force"\ndirection = [0, 0, 1]'),
    "LargestPenetration": Example('[[obstacles]]\nkind = "plane"\ncentre = [0, 0, -0.01]\nnormal = [0, 0, 1]\n\n[[quantities]]\nname = "depth"\nkind = "penetration"\nabsolute = true'),
    "ContactPoint": Example('[[obstacles]]\nkind = "plane"\ncentre = [0, 0, -0.01]\nnormal = [0, 0, 1]\n\n[[quantities]]\nname = "touches_at"\nkind = "contact_point"\npoint = "xi1_min,xi2_min"\nalong = "xi1"'),
    "Path": Example(
        '[[quantities]]\nname = "tip_lift"\nkind = "displacement"\npoints = ["tip"]\ndirection = [0, 0, 1]\nat = 0.4  # m of this quantity\n\n'
        '[path]\ncontrol = "displacement"\nquantity = "tip_lift"\nuntil = 1.0  # m\nstates = [0.1, 0.2]',
        "path",
    ),
    "Dynamics": Example("[dynamics]\nuntil = 2.0\nstates = [0.5, 1.5]", "motion"),
    "DisplacementQuantity": Example(
        '[[quantities]]\nname = "tip_deflection"\ndescription = "downward displacement of the tip"\nkind = "displacement"\n'
        'points = ["tip"]\ndirection = [0, 0, -1]'
    ),
    "PositionQuantity": Example(
        '[[quantities]]\nname = "tip_z_500ms"\nkind = "position"\npoints = ["tip"]\ndirection = [0, 0, 1]\nat = 0.5  # s', "motion"
    ),
    "CentreOfMass": Example('[[quantities]]\nname = "centre_z"\nkind = "centre_of_mass"\ndirection = [0, 0, 1]\nat = 0.5', "motion"),
    "LargestDisplacement": Example('[[quantities]]\nname = "largest_displacement"\nkind = "largest_displacement"'),
    "FieldError": Example(
        '[[quantities]]\nname = "field_error"\nkind = "field_error"\nexact = [0, 0, "1e-3*xi1**2*(1 - xi2)"]  # m, by component'
    ),
    "EnergyQuantity": Example('[[quantities]]\nname = "stored"\nkind = "strain_energy"  # or membrane_energy, bending_energy'),
    "MotionEnergy": Example('[[quantities]]\nname = "kinetic"\nkind = "kinetic_energy"  # or total_energy, energy_balance\nat = 0.5', "motion"),
    "PotentialEnergy": Example('[[quantities]]\nname = "potential"\nkind = "potential_energy"', "path"),
    "ReactionQuantity": Example('[[quantities]]\nname = "wall_force"\nkind = "reaction"\nsupport = "wall"\ndirection = [0, 0, 1]'),
    "TorqueQuantity": Example(
        '[[quantities]]\nname = "wall_moment"\nkind = "torque"\nsupport = "wall"\naxis = [0, 1, 0]\ncentre = [0, 0.5, 0]'
    ),
    "LoadQuantity": Example('[[quantities]]\nname = "load_300mm"\nkind = "load"\nat = 0.3     # m of the path\'s displacement\nscale = 4.0', "arc length"),
    "LimitPoint": Example('[[quantities]]\nname = "limit_load"\nkind = "limit_point"\nturning = "load"\nnumber = 1\nscale = 4.0', "arc length"),
    "CriticalPoint": Example('[[quantities]]\nname = "critical_load"\nkind = "critical_point"\nscale = 4.0', "path"),
    "Frequency": Example('[[quantities]]\nname = "third_frequency"\nkind = "frequency"\nnumber = 3', "modes"),
    "MembraneForce": Example(
        '[[quantities]]\nname = "force_along"\nkind = "membrane_force"\ncomponent = "11"\non = ["tip"]'
    ),
    "Moment": Example(
        '[[quantities]]\nname = "wall_moment"\nkind = "moment"\ncomponent = "principal_1"\non = ["middle"]  # its mean along it',
        "forces",
    ),
    "ShearForce": Example('[[quantities]]\nname = "wall_shear"\nkind = "shear_force"\ncomponent = "1"\non = ["xi1_min"]'),
    "BucklingLoad": Example('[[quantities]]\nname = "second_load"\nkind = "buckling_load"\nnumber = 2', "buckling"),
    "Known": Example(
        '[[known]]\nquantity = "headline"\nvalue = 0.0125\nuncertainty = 1e-5\nsource = "Timoshenko & Woinowsky-Krieger, article 45"\n'
        "tolerance = 0.01  # 1 %"
    ),
    "Picture": Example('[picture]\nscale = 50\ndirection = [0, 0, -1]\nview = [25, -60]\nup = "z"'),
}  # fmt: skip

SECTIONS = (  # heading, one of them, words, common base, classes
    ("Surface", "Surface", "`[surface]` is one of four kinds. All have the fields of the first table.", surface.AnalyticSurface, ("Plane", "Cylinder", "ExpressionSurface", "MeshSurface")),
    ("Material", "", "`[material]`: linear, isotropic.", None, ("Material",)),
    ("Parts of edges", "", "`[edge_parts]`: a table of names. Supports, and loads of the kinds edge and moment, can be on them.", None, ("EdgePart",)),
    ("Supports", "", "`[[supports]]`: any number.", None, ("Support",)),
    ("Motions of supports", "Motion", "`motion` of a support is one of three kinds.", None, ("Value", "Translation", "Rotation")),
    ("Springs", "", "`[[springs]]`: any number, in the linear theory and in cases of motion. A spring all over the shell is a foundation.", None, ("Spring",)),
    ("Loads", "Load", "`[[loads]]`: any number, each of one of six kinds. All are dead, they keep their direction, but a pressure that follows.", None,
     ("AreaLoad", "PressureLoad", "GravityLoad", "EdgeLoad", "PointLoad", "MomentLoad")),
    ("Obstacles", "Obstacle", "`[[obstacles]]`: any number, in the linear theory without friction, and in motion. The shell keeps out of them; where it touches is found.", None,
     ("HalfSpace", "Plate", "Sphere", "Capsule", "Box", "FormulaBody")),
    ("Contact", "", "`[contact]`: how obstacles are touched.", None, ("Contact",)),
    ("Path", "", "`[path]`: in the non-linear theory, for cases that do not move.", None, ("Path",)),
    ("Dynamics", "", "`[dynamics]`: makes a case one of motion. It needs the non-linear theory and an areal density.", None, ("Dynamics",)),
    ("Quantities", "Quantity", "`[[quantities]]`: at least one. All have the fields of the first table.", quantities.ShellQuantity,
     ("DisplacementQuantity", "PositionQuantity", "CentreOfMass", "LargestDisplacement", "FieldError", "EnergyQuantity", "MotionEnergy", "PotentialEnergy",
       "ReactionQuantity", "TorqueQuantity", "ContactForce", "LargestPenetration", "ContactPoint", "LoadQuantity", "LimitPoint", "CriticalPoint",
       "Frequency", "BucklingLoad", "MembraneForce", "Moment", "ShearForce")),
    ("Known values", "", "`[[known]]`: any number. They stand in your own case alone, and `shellbench gate FILE` judges by them.", None, ("Known",)),
    ("Picture", "", "`[picture]`: how the report draws the shell.", None, ("Picture",)),
)  # fmt: skip

PREFACE = f"""# Case format

<!-- Written by docs/case_format.py from the models. Change those, and run it. -->

A case is one TOML file, named after the case. This page is generated from the models that read it, so that no field is missing.
[Your own case](own_case.md) writes a file step by step.

What is wrong with a file is said in one sentence that names the field. Unknown fields are refused.

## Conventions

**Units.** SI, or any other consistent units: nothing is converted. The units below are those of SI. Angles are in degrees.

**Coordinates.** (xi1, xi2) run over a rectangle, the bounds of `xi1` and `xi2`. `[x, y, z]` are Cartesian.

**Places.** Edges are `xi1_min`, `xi1_max`, `xi2_min`, `xi2_max`; a coordinate in which the surface closes has none. Corners are named by
their two edges, as in `"xi1_min,xi2_max"`. Points have names of their own, under `[points]`, and so have parts of edges,
under `[edge_parts]`. `"surface"` is the whole of it.

**Formulas.** Where "number or formula" is allowed, a formula is text of at most {MAX_LENGTH:,} characters: numbers, names, `+ - * / **`,
parentheses, {", ".join(f"`{name}`" for name in FUNCTIONS)} of one argument, and {", ".join(f"`{name}`" for name in CONSTANTS)}. It may name `xi1`, `xi2` (radians if an angle), `t`, and the
surface's `constants`. It is never evaluated as Python. In loads, springs and factors of the material it may be piecewise: `min(a, b)`,
`max(a, b)`, `abs(a)` and `where(a < b, c, d)`, with `<`, `<=`, `>` or `>=`. Where it changes over must be lines `xi1 = ...` or `xi2 = ...`;
`where(xi1 + xi2 < 1, ...)` is refused, and so is what changes over in `t`.

**`t`** is the time in a case of motion. In the non-linear theory without motion it is the load factor: rest is at 0, and loads and
motions of supports must begin there. In the linear theory it is 1.

**Names** begin with a letter and hold letters, digits and underscores, 60 at most.
"""


class UndescribedError(Exception):
    """A field that neither its class nor its definition explains."""


def _is_shown(cls: type[Model]) -> bool:
    # Quantities of many materials and edits have names of their own kind's, and bodies that wear capes those of obstacles.
    return cls.__module__.startswith(SHOWN) and not any(name in cls.__module__ for name in ("series", "skinning"))


def model_class(name: str) -> type[Model]:
    """Return the model of this name."""
    (found,) = {cls for cls in subclasses(Model) if cls.__name__ == name and _is_shown(cls)}
    return found


def subclasses(cls: type) -> Iterator[type]:
    """Yield all classes below a class."""
    for below in cls.__subclasses__():
        yield below
        yield from subclasses(below)


def summary(cls: type) -> str:
    """Return the docstring of a class without its section "Attributes"."""
    text = inspect.cleandoc(cls.__doc__ or "")
    return re.split(r"\n+Attributes\n-+\n", text)[0]


def description(cls: type[Model], name: str) -> str:
    """Return the meaning of a field.

    Raises
    ------
    UndescribedError
        If nothing says it.
    """
    words = attributes(cls).get(name) or cls.model_fields[name].description
    if not words:
        raise UndescribedError(
            f"{cls.__name__}.{name} has no description: add it to the section Attributes of its class"
        )
    return words if words.endswith((".", "?")) else words + "."


def allowed(schema: Schema) -> str:
    """Return in words what a field may be."""
    if "const" in schema:
        return f'`"{schema["const"]}"`'
    if "enum" in schema:
        return " or ".join(f'`"{value}"`' for value in schema["enum"])
    if "$ref" in schema or "oneOf" in schema:
        return "a table, see below"
    if "anyOf" in schema:
        kinds = [allowed(option) for option in schema["anyOf"] if option.get("type") != "null"]
        return "number or formula" if kinds == ["number", "text"] else " or ".join(kinds)
    match schema.get("type"):
        case "array" if "prefixItems" in schema:
            inner = {allowed(item) for item in schema["prefixItems"]}
            return f"list of {len(schema['prefixItems'])}: {inner.pop()}"
        case "array" if "$ref" in schema["items"] or "oneOf" in schema["items"]:
            return "tables, see below"
        case "array":
            return f"list of: {allowed(schema['items'])}" + ("; not empty" if schema.get("minItems") else "")
        case "object":
            values = schema.get("additionalProperties") or one(schema["patternProperties"].values())
            return f"table of names, each with: {allowed(values)}"
        case "number" | "integer" as kind:
            bounds = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
            said = [
                f"{sign} {schema[key]:g}" for key, sign in bounds.items() if abs(schema.get(key, LARGEST)) < LARGEST
            ]
            return " ".join(["whole number" if kind == "integer" else kind, ", ".join(said)]).strip()
        case "boolean":
            return "`true` or `false`"
        case "string":
            length = f" of at most {schema['maxLength']} characters" if "maxLength" in schema else ""
            return "name" if "pattern" in schema else f"text{length}"
    raise ValueError(f"no words for {schema}")


def one(values: Any) -> Any:
    """Return the only one."""
    (only,) = values
    return only


def default(schema: Schema, required: bool) -> str:
    """Return the default of a field as it would stand in a file."""
    if required:
        return "required"
    if (value := schema.get("default")) is None or value in ([], {}, ""):
        return "none"
    return f"`{json.dumps(value)}`"


def table(cls: type[Model], names: list[str]) -> str:
    """Return the Markdown table of some fields of a model."""
    schema = cls.model_json_schema()
    lines = ["| field | allowed | default | meaning |", "|---|---|---|---|"]
    for name in names:
        field = schema["properties"][name]
        cells = f"`{name}`", allowed(field), default(field, name in schema.get("required", ())), description(cls, name)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)


def kinds(cls: type[Model]) -> list[str]:
    """Return the values of `kind` that choose a model; none for models without one."""
    field = cls.model_json_schema()["properties"].get("kind", {})
    return field.get("enum") or [value for value in [field.get("const")] if value]


def section(heading: str, singular: str, words: str, base: type[Model] | None, classes: tuple[str, ...]) -> str:
    """Return the section of one part of a case file."""
    parts = [f"## {heading}\n\n{words}"]
    common = list(base.model_fields) if base else []
    if base:
        parts.append(table(base, common))
    for name in classes:
        cls = model_class(name)
        if chosen := kinds(cls):
            parts.append(f"### {singular} " + ", ".join(f"`{kind}`" for kind in chosen))
        parts.append(summary(cls))
        own = [name for name in cls.model_json_schema()["properties"] if name != "kind" and name not in common]
        if own:
            parts.append(table(cls, own))
        if "unit" in common and cls.model_fields["unit"].default != base.model_fields["unit"].default:
            parts.append(f'`unit` is `"{cls.model_fields["unit"].default}"` unless it says otherwise.')
        parts.append(f"```toml\n{EXAMPLES[name].text}\n```")
    return "\n\n".join(parts)


def page() -> str:
    """Return the whole reference."""
    whole = [name for name in Case.model_fields if name != "name"]
    top = "## The file\n\nThe tables of a case file, and the fields that stand before them:\n\n" + table(Case, whole)
    complete = (Path(__file__).parents[1] / "examples/hyperbolic_paraboloid.toml").read_text(encoding="utf-8")
    last = f"## A whole file\n\n`examples/hyperbolic_paraboloid.toml`:\n\n```toml\n{complete.strip()}\n```"
    return (
        "\n\n".join(
            [
                PREFACE.strip(),
                top,
                *(section(*each) for each in SECTIONS),
                last,
                chains(),
                capes(),
                materials(),
                edits(),
                fields(),
            ]
        )
        + "\n"
    )


def chains() -> str:
    """Return the reference of the second kind of problem, ropes."""
    own = {"theory", "chain", "rope", "particles", "wind", "obstacles", "quantities"}
    parts = [
        '## Ropes\n\nA file with `kind = "rope"` is about point masses: on rigid links, at rest between two ends or in'
        " motion from a root, or loose. It has the title, the description, the units and the suites of every case, exactly"
        " one of `chain`, `rope` and `particles`, and:",
        table(rope.RopeCase, [name for name in rope.RopeCase.model_fields if name in own]),
    ]
    for name, cls in (("chain", rope.Chain), ("rope", rope.Rope), ("particles", rope.Particles), ("wind", rope.Wind)):
        parts += [f"`[{name}]`: {summary(cls)}", table(cls, list(cls.model_fields))]
    parts.append("`[[obstacles]]`: any number, each of one of six kinds. They can move, and do not turn.")
    for cls in (
        obstacle.Sphere,
        obstacle.HalfSpace,
        obstacle.Plate,
        obstacle.Capsule,
        obstacle.Box,
        obstacle.FormulaBody,
    ):
        kind = cls.model_json_schema()["properties"]["kind"]["const"]
        parts += [f"`{kind}`: {summary(cls)}", table(cls, [name for name in cls.model_fields if name != "kind"])]
    parts.append(
        '`phi = "sqrt(x**2 + y**2 + z**2) - 0.5"` is a ball. It may be piecewise, and change over anywhere: `min` joins bodies,'
        " `max` leaves what they share. It need not be a distance. A formula that is none is a distance to first order, exact at the surface;"
        " where it exceeds the distance, a mass may pass a thin part within a step unseen. Where a mass starts, phi must have a"
        " gradient. `t` is not allowed in it: `centre` moves the body."
    )
    parts.append(
        "`[[quantities]]` have the fields that those of shells have in common; a chain at rest has the first two."
    )
    common = {"kind", *quantities.ShellQuantity.model_fields}
    for cls in (
        asked.NodePosition, asked.LinkTension, asked.NodeSpeed, asked.AngularSpeed, asked.Stretch, asked.Penetration,
        asked.Momentum, asked.Energy, asked.Share,
    ):  # fmt: skip
        field = cls.model_json_schema()["properties"]["kind"]
        kinds = [field["const"]] if "const" in field else field["enum"]
        parts.append(f"{', '.join(f'`{kind}`' for kind in kinds)}: {summary(cls)}")
        if own_fields := [name for name in cls.model_fields if name not in common]:
            parts.append(table(cls, own_fields))
    for name in ("hanging_chain", "rope_drop"):
        file = (Path(__file__).parents[1] / f"cases/{name}.toml").read_text(encoding="utf-8")
        parts.append(f"`cases/{name}.toml`:\n\n```toml\n{file.strip()}\n```")
    return "\n\n".join(parts)


def capes() -> str:
    """Return the reference of the kind of problem that skins a garment."""
    own = {"theory", "cape", "body", "margin", "bones", "split", "quantities"}
    parts = [
        '## Capes\n\nA file with `kind = "skinning"` asks for the mesh of a simulated cape from a few bones, in frames that'
        " are held out. It has the title, the description, the units and the suites of every case, and:",
        table(skinning.SkinningCase, [name for name in skinning.SkinningCase.model_fields if name in own]),
        f"`[cape]`: {summary(cape.Cape)}", table(cape.Cape, list(cape.Cape.model_fields)),
        f"`[[body]]`: {summary(body.Capsule)}", table(body.Capsule, list(body.Capsule.model_fields)),
        f"`[bones]`: {summary(skinning.Bones)}", table(skinning.Bones, list(skinning.Bones.model_fields)),
        "`[split]` is one of two kinds.",
    ]  # fmt: skip
    for split in (skinning.ByClips, skinning.ByFrames):
        by = split.model_json_schema()["properties"]["by"]["const"]
        parts += [f"`{by}`: {summary(split)}", table(split, [name for name in split.model_fields if name != "by"])]
    parts.append("`[[quantities]]` have the fields that those of shells have in common.")
    for cls in (skinned.SkinError, skinned.PenetrationShare, skinned.PenetrationDepth):
        kind = cls.model_json_schema()["properties"]["kind"]
        kinds = [kind["const"]] if "const" in kind else kind["enum"]
        parts.append(f"{', '.join(f'`{one}`' for one in kinds)}: {summary(cls)}")
    file = (Path(__file__).parents[1] / "cases/cape_clips.toml").read_text(encoding="utf-8")
    parts.append(f"`cases/cape_clips.toml`:\n\n```toml\n{file.strip()}\n```")
    return "\n\n".join(parts)


def materials() -> str:
    """Return the reference of the kind of problem that asks for a range of materials."""
    own = {"theory", "ranges", "held_out", "asked", "quantities"}
    parts = [
        '## Shells of many materials\n\nA file with `kind = "conditioned"` asks a shell for a range of'
        " materials, in the linear theory or in motion, and judges at some that are drawn with a seed. It has the title,"
        " the description, the units and the suites of every case; in the table `[shell]` all that a shell has, but for title, theory, quantities and the three"
        " figures of its material that have a range; and:",
        table(conditioned.ConditionedCase, [name for name in conditioned.ConditionedCase.model_fields if name in own]),
    ]
    tables = {"ranges": conditioned.Ranges, "held_out": conditioned.HeldOut, "asked": conditioned.Asked}
    for name, cls in tables.items():
        parts += [f"`[{name}]`: {summary(cls)}", table(cls, list(cls.model_fields))]
    parts.append(
        "`[[quantities]]` have the fields that those of shells have in common, but for `at`: motions are asked at their end."
    )
    common = {"kind", *quantities.ShellQuantity.model_fields}
    for cls in (of_materials.Value, of_materials.Sensitivity):
        kind = cls.model_json_schema()["properties"]["kind"]["const"]
        parts += [f"`{kind}`: {summary(cls)}", table(cls, [name for name in cls.model_fields if name not in common])]
    file = (Path(__file__).parents[1] / "cases/conditioned_roof.toml").read_text(encoding="utf-8")
    first, *rest = file.strip().split("[[quantities]]")
    shown = "[[quantities]]".join([first, rest[0], next(q for q in rest if "sensitivity" in q)])
    parts.append(
        f"Of `cases/conditioned_roof.toml`, with the first quantity of each kind:\n\n```toml\n{shown.strip()}\n```"
    )
    return "\n\n".join(parts)


def edits() -> str:
    """Return the reference of the kind of problem that asks for a shell and an edit of it."""
    own = {"theory", "edit", "accuracy", "quantities"}
    file = (Path(__file__).parents[1] / "cases/edit_cantilever_pose.toml").read_text(encoding="utf-8")
    common = {"kind", *quantities.ShellQuantity.model_fields}
    return "\n\n".join([
        '## Edited shells\n\nA file with `kind = "editing"` has a shell in the table `[shell]`, without title, theory and'
        " quantities, and what a user changes. It has the title, the description, the units and the suites of every case,"
        " and:",
        table(editing.EditingCase, [name for name in editing.EditingCase.model_fields if name in own]),
        f"`[edit]`: {summary(editing.Edit)}", table(editing.Edit, list(editing.Edit.model_fields)),
        f"`[[edit.changes]]`: {summary(editing.Change)}", table(editing.Change, list(editing.Change.model_fields)),
        f"`[[quantities]]` have the fields that those of shells have in common. `edited_displacement`: {summary(EditedDisplacement)}",
        table(EditedDisplacement, [name for name in EditedDisplacement.model_fields if name not in common]),
        f"`cases/edit_cantilever_pose.toml`:\n\n```toml\n{file.strip()}\n```",
    ])  # fmt: skip


def fields() -> str:
    """Return the reference of the third kind of problem, fields on the unit square."""
    own = set(field.FieldCase.model_fields) - {*Problem.model_fields, "kind"} | {"theory"}
    parts = [
        '## Fields\n\nA file with `kind = "field"` is about a vector field over the unit square of u and v, points of a density,'
        " or distances from a body of vertices. It has the title, the description, the units and the suites of every case, and:",
        table(field.FieldCase, [name for name in field.FieldCase.model_fields if name in own]),
    ]
    tables = {
        "match": field.Match,
        "cloth": field.Cloth,
        "training": field.Training,
        "density": field.Density,
        "body": ball.Ball,
    }
    for name, cls in tables.items():
        parts += [f"`[{name}]`: {summary(cls)}", table(cls, list(cls.model_fields))]
    parts += [f"`[[pins]]`: {summary(field.Pin)}", table(field.Pin, list(field.Pin.model_fields))]
    parts.append("`[[quantities]]` have the fields that those of shells have in common, but for `at`.")
    common = {"kind", *quantities.ShellQuantity.model_fields}
    for cls in dict.fromkeys((*of_fields.FIT, *of_fields.CLOTH, *of_fields.DENSITY, *of_fields.BODY)):
        kind = cls.model_json_schema()["properties"]["kind"]
        kinds = [kind["const"]] if "const" in kind else kind["enum"]
        parts.append(f"{', '.join(f'`{one}`' for one in kinds)}: {summary(cls)}")
        if own_fields := [name for name in cls.model_fields if name not in common]:
            parts.append(table(cls, own_fields))
    for name in ("field_sine", "field_hang", "field_sampler"):
        file = (Path(__file__).parents[1] / f"cases/{name}.toml").read_text(encoding="utf-8")
        parts.append(f"`cases/{name}.toml`:\n\n```toml\n{file.strip()}\n```")
    return "\n\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
