"""Write the two pages of the case format from the models that read case files: `python docs/case_format.py`.

`case_format.md` is about shells, `case_format_kinds.md` about the other kinds of problem. Each topic has one table of
keys and one short example. Types, bounds and defaults come from the models' JSON schema. The meaning of a key comes
from the section "Attributes" of its class or of a class that it inherits from, or from `Field(description=...)`; a key
without either is an error. Each fragment of `EXAMPLES` belongs to a whole case, one of `WHOLE`;
`tests/test_case_format.py` reads it.
"""

from __future__ import annotations

import inspect
import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
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
from shellbench.problems.formula_functions import FUNCTIONS
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
KINDS_PAGE = Path(__file__).with_name("case_format_kinds.md")
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
quantities = [{ name = "tip_deflection", kind = "largest_displacement", primary = true }]
""",
}
WHOLE["path"] = WHOLE["linear"].replace("love-linear", "love-nonlinear").replace(
    "loads = []", 'loads = [{ kind = "edge", on = ["xi1_max"], vector = [0, 0, "4*t"] }]'
)  # fmt: skip
WHOLE["motion"] = WHOLE["linear"].replace("love-linear", "love-nonlinear") + "dynamics = { until = 1.0 }\n"
WHOLE["forces"] = WHOLE["linear"] + 'edge_parts = { middle = { edge = "xi1_min", between = [0.2, 0.8] } }'


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
        return data


EXAMPLES = {  # by section
    "Surface": Example(
        '[surface]\nkind = "expression"\nx = "(r + xi2)*cos(xi1)"\ny = "(r + xi2)*sin(xi1)"\nz = "H*xi2**2"\n'
        'xi1 = [0, 90]           # degrees\nxi2 = [0, 1]\nangles = ["xi1"]\nconstants = { r = 2.0, H = 0.5 }'
    ),
    "Material": Example(
        '[material]\nyoungs_modulus = 2e11             # Pa\npoissons_ratio = 0.3\nthickness = 0.01                  # m\n'
        'areal_density = 8.0               # kg/m^2\nthickness_factor = "1 - 0.5*xi1"  # half as thick at xi1 = 1'
    ),
    "Orthotropic materials": Example(
        '[material]\nkind = "orthotropic"\nmembrane = [9e3, 1e3, 4e3, 300]    # N/m\nbending = [3e-4, 2e-5, 1e-4, 4e-5] # N m\n'
        'thickness = 0.001                  # m\nangle = 30                         # warp, from the line of xi1\nareal_density = 0.1'
    ),
    "Parts of edges": Example(
        '[edge_parts]\nhinge = { edge = "xi2_min", between = [0.2, 0.6] }\n\n[[supports]]\nname = "hinge"\non = ["hinge"]\ncomponents = ["z"]'
    ),
    "Supports": Example(
        '[[supports]]\nname = "mirror"\non = ["xi2_min"]\nsymmetry = "y"\n\n'
        '[[supports]]\nname = "turned"\non = ["xi1_max"]\nclamped = true\n'
        'motion = { kind = "rotation", axis = [1, 0, 0], centre = [0, 0.5, 0], angle = "90*t" }',
        "path",
    ),
    "Springs": Example('[[springs]]\nname = "pin"\nstiffness = "1e4*exp(-(xi1**2 + xi2**2)/0.01)"', "motion"),
    "Loads": Example(
        '[[loads]]\nkind = "area"\nvector = [0, 0, "-1 - max(xi1 - 0.5, 0)"]  # grows from xi1 = 0.5 on\n\n'
        '[[loads]]\nkind = "edge"\non = ["xi1_max"]\nvector = [0, 5, 0]  # pulls at the edge\nframe = "local"\n\n'
        '[[loads]]\nkind = "point"\non = ["tip", "xi1_max,xi2_min"]\nforce = [0, 0, -2]'
    ),
    "Obstacles and contact": Example(
        '[[obstacles]]\nkind = "plane"\ncentre = [0, 0, -0.01]\nnormal = [0, 0, 1]\n\n[contact]\nthickness = true  # the lower face touches'
    ),
    "Path": Example(
        '[[quantities]]\nname = "tip_lift"\nkind = "displacement"\npoints = ["tip"]\ndirection = [0, 0, 1]\nat = 0.4  # m of this quantity\n\n'
        '[path]\ncontrol = "displacement"\nquantity = "tip_lift"\nuntil = 1.0  # m\nstates = [0.1, 0.2]',
        "path",
    ),
    "Dynamics": Example("[dynamics]\nuntil = 2.0\nstates = [0.5, 1.5]", "motion"),
    "Quantities": Example(
        '[[quantities]]\nname = "tip_sag"\ndescription = "downward displacement of the tip"\nkind = "displacement"\n'
        'points = ["tip"]\ndirection = [0, 0, -1]\n\n'
        '[[quantities]]\nname = "wall_force"\nkind = "reaction"\nsupport = "wall"\ndirection = [0, 0, 1]\n\n'
        '[[quantities]]\nname = "wall_moment"\nkind = "moment"\ncomponent = "principal_1"\non = ["middle"]  # the mean along it',
        "forces",
    ),
    "Other names": Example('also_known_as = [{ name = "NAFEMS LE1", locator = "Standard NAFEMS Benchmarks, elliptic membrane" }]'),
    "Known values": Example(
        '[[known]]\nquantity = "tip_deflection"\nvalue = 0.0125\nuncertainty = 1e-5\nsource = "Timoshenko & Woinowsky-Krieger, article 45"\n'
        "tolerance = 0.01  # 1 %"
    ),
    "Picture": Example('[picture]\nscale = 50\ndirection = [0, 0, -1]\nview = [25, -60]\nup = "z"'),
}  # fmt: skip

SECTIONS = (  # heading, words, common base, classes
    ("Surface", "`[surface]` is one of four kinds. All kinds have the first two keys; a mesh needs neither, and has them in units of (u, v).", surface.AnalyticSurface, ("Plane", "Cylinder", "ExpressionSurface", "MeshSurface")),
    ("Material", "`[material]` is linear, and isotropic unless its kind is another. The membrane stiffness is D = E h / (1 - nu^2), the bending stiffness B = E h^3 / (12 (1 - nu^2)). The factors vary D and B only, not the areal density. `bending_poissons_ratio` changes the [energy](theory.md#energy) of bending, not B.", None, ("Material",)),
    ("Orthotropic materials", "`[material]` of `kind = \"orthotropic\"`: woven cloth, ribbed plates, laminates. One layer has `youngs_modulus`, `poissons_ratio` and `shear_modulus`, and A = h Q, D = h^3 Q / 12."
     " Cloth and laminates have the stiffnesses `membrane` and `bending` instead. Direction 2 is the normal x direction 1. The stiffnesses are the same everywhere.", None, ("OrthotropicMaterial",)),
    ("Parts of edges", "`[edge_parts]` is a table of names. Supports, and loads of the kinds `edge` and `moment`, can use these names.", None, ("EdgePart",)),
    ("Supports", "`[[supports]]`: any number. A support holds its `components` at zero or moves them as `motion` says; the other components are free."
     ' Components are Cartesian, or local to the shell at rest: "along" an edge, "across" it within the surface, "normal" to the surface.'
     " `clamped` also holds the slope."
     " In linear theory, a support at a point along the midsurface holds against rigid motions only; the loads must balance without it.",
     None, ("Support", "Value", "Translation", "Rotation")),
    ("Springs", "`[[springs]]`: any number, in linear theory and in motion. A spring over the whole shell is an elastic foundation.", None, ("Spring",)),
    ("Loads", "`[[loads]]`: any number, each of one of six kinds. All loads are dead (they keep their direction), except a pressure with `follows = true`: it acts along the deformed normal, per deformed area."
     " The work of a moment is the moment times the angle by which the normal turns; its axis should be tangential to the edge."
     " A point force along the midsurface has no finite displacement there: [forces at points](theory.md#forces-and-supports-at-points).", None,
     ("AreaLoad", "PressureLoad", "GravityLoad", "EdgeLoad", "PointLoad", "MomentLoad")),
    ("Obstacles and contact", "`[[obstacles]]`: any number of rigid bodies that the shell cannot enter; in linear theory without friction, and in motion."
     " They can move, but do not turn. All kinds have the first two keys; [contact](theory.md#contact) has the theory.", obstacle.Body,
     ("HalfSpace", "Plate", "Sphere", "Capsule", "Box", "ConvexMesh", "FormulaBody", "Contact")),
    ("Path", "`[path]` is for the non-linear theory at rest.", None, ("Path",)),
    ("Dynamics", "`[dynamics]` makes the case a motion. It needs the non-linear theory and an areal density.", None, ("Dynamics",)),
    ("Quantities", "`[[quantities]]`: at least one. All kinds have the keys of the first rows; the unit in the row of a kind is its default `unit`."
     " `total_energy` is kinetic, strain and spring energy less the work of constant loads; `potential_energy` has no kinetic part."
     " `energy_balance` is the largest deviation that the solver's own history states."
     " Where supports meet and hold the same direction, they share a concentrated reaction equally.", quantities.ShellQuantity,
     ("DisplacementQuantity", "PositionQuantity", "CentreOfMass", "LargestDisplacement", "Shadow", "FieldError", "EnergyQuantity", "MotionEnergy", "PotentialEnergy",
       "ReactionQuantity", "TorqueQuantity", "ContactForce", "LargestPenetration", "ContactPoint", "LoadQuantity", "LimitPoint", "CriticalPoint",
       "Frequency", "BucklingLoad", "MembraneForce", "Moment", "ShearForce", "Stress", "DerivativeQuantity")),
    ("Other names", "`also_known_as`: any number of names under which others know the case, as inline tables."
     " They change no answer. `shellbench list WORDS` finds cases by them.", None, ("OtherName",)),
    ("Known values", "`[[known]]`: any number, in your own case only. `shellbench gate FILE` judges by them. A tolerance here is for all "
        "solvers. The `tolerance` of a quantity judges nothing; it only says for one solver when a headline has settled.", None, ("Known",)),
    ("Picture", "`[picture]`: how the report draws the shell.", None, ("Picture",)),
)  # fmt: skip
TABLES = {  # models that are tables of a section beside its own
    "Value": "motion.kind",
    "Translation": "motion.kind",
    "Rotation": "motion.kind",
    "Contact": "[contact]",
}
FORMULA_NOTE = (
    "The `phi` of a formula body may be piecewise: `min` joins bodies, `max` keeps their common part. It need not be a distance."
    " `t` is not allowed in it: `centre` moves the body. Where a mass starts, its gradient must not vanish."
)
OTHERS = (  # heading, words, model of the case, tables, quantities, example, names of quantities shown
    ("Ropes", 'kind = "rope"', "Point masses on rigid links: at rest between two ends, in motion from a root, or loose; or a net of springs at rest. A file has exactly one of"
     " `chain`, `net`, `rope` and `particles`. `[[obstacles]]` are [those of shells](case_format.md#obstacles-and-contact). A chain or net at rest has"
     " the quantities `position` and `tension` only.",
     rope.RopeCase, {"[chain]": rope.Chain, "[net]": rope.Net, "[rope]": rope.Rope, "[rope.lateral]": rope.Lateral, "[particles]": rope.Particles,
                     "[wind]": rope.Wind},
     (asked.NodePosition, asked.LinkTension, asked.NodeSpeed, asked.AngularSpeed, asked.Stretch, asked.Penetration,
      asked.Momentum, asked.Energy, asked.Share), "hanging_chain", ("sag", "end_tension")),
    ("Capes (skinning)", 'kind = "skinning"', "The mesh of a simulated cape or skirt from a few bones, in frames that are held out. With `[ropes]`, rope chains are the bones of these frames.",
     skinning.SkinningCase, {"[cape]": cape.Cape, "[[body]]": body.Capsule, "[bones]": skinning.Bones,
                             '[split] by = "clips"': skinning.ByClips, '[split] by = "frames"': skinning.ByFrames, "[ropes]": skinning.Ropes},
     (skinned.SkinError, skinned.FineError, skinned.PenetrationShare, skinned.PenetrationDepth, skinned.EdgeStrain, skinned.BoneDistance,
      skinned.BoneError, skinned.Jitter), "cape_clips", ("error",)),
    ("Series of materials", 'kind = "conditioned"', "One shell for a range of materials, in linear theory or in motion, judged at held-out materials."
     " The table `[shell]` is a shell without title, theory, quantities and the three material keys of `[ranges]`."
     " Quantities have no `at`: motions are judged at their end.",
     conditioned.ConditionedCase, {"[ranges]": conditioned.Ranges, "[held_out]": conditioned.HeldOut, "[asked]": conditioned.Asked},
     (of_materials.Value, of_materials.Sensitivity), "conditioned_roof", ("value_00", "by_thickness_00")),
    ("Edited shells", 'kind = "editing"', "A shell, and one change of it. The table `[shell]` has the keys of a shell without title, theory and quantities.",
     editing.EditingCase, {"[edit]": editing.Edit, "[[edit.changes]]": editing.Change}, (EditedDisplacement,), "edit_cantilever_pose", ("deflection",)),
    ("Fields", 'kind = "field"', "A vector field over the unit square of u and v; points from a density; or distances from a body."
     " Numbers of equations are those of Shu et al. ([fields on grids](fields.md)). Quantities have no `at`. A `[body]` is of kind `\"ball\"`, `\"torus\"` or `\"prism\"`.",
     field.FieldCase, {"[match]": field.Match, "[cloth]": field.Cloth, "[training]": field.Training, "[[pins]]": field.Pin,
                       "[disc]": field.Disc, "[density]": field.Density, '[body] kind = "ball"': ball.Ball,
                       '[body] kind = "torus"': ball.Torus, '[body] kind = "prism"': ball.Prism},
     tuple(dict.fromkeys((*of_fields.FIT, *of_fields.CLOTH, *of_fields.DENSITY, *of_fields.BODY))), "field_hang", ("elongation",)),
)  # fmt: skip

GENERATED = "<!-- Written by docs/case_format.py from the models. Change those, and run it. -->"
COLUMNS = "|key|type|unit|default|meaning|\n|---|---|---|---|---|"
PREFACE = f"""# Case format: shells

{GENERATED}

A case is one TOML file, named after the case. This page lists every key of a shell.
[Other kinds](case_format_kinds.md) has ropes, capes, series of materials, edited shells and fields.
[Your own case](own_case.md) writes a file step by step.

An error message names the file, the key, the value found and the values allowed. Unknown keys are refused.

## Conventions

- **Units**: SI, or any other consistent set; nothing is converted. Tables give the SI unit. Angles are in degrees.
- **Coordinates**: (xi1, xi2) run over the rectangle of `xi1` and `xi2`. `[x, y, z]` are Cartesian.
- **Places**: edges are `xi1_min`, `xi1_max`, `xi2_min` and `xi2_max`. A corner is named by its two edges, `"xi1_min,xi2_max"`. `[points]`
  and `[edge_parts]` define more names. `"surface"` is the whole shell. A closed coordinate has no edges.
- **Names** begin with a letter and have at most 60 letters, digits and underscores.
- **Time**: `t` is the time in a motion. In the non-linear theory at rest it is the load factor: 0 at rest, where loads and motions of
  supports begin. In linear theory it is 1.
- **Types**: a `formula` is a number or text. A type in the plural is a list.

A formula has at most {MAX_LENGTH:,} characters: numbers, names, `+ - * / **`, parentheses, `pi` and {", ".join(f"`{name}`" for name in FUNCTIONS)}.
It may use `xi1`, `xi2` (radians if an angle), `t` and the surface's `constants`. It is parsed, never run as Python.
Loads, springs and material factors may be piecewise: `min(a, b)`, `max(a, b)`, `abs(a)`, `where(a < b, c, d)` with `<`, `<=`, `>` or `>=`.
The pieces must meet along lines `xi1 = ...` or `xi2 = ...`, and must not depend on `t`.
"""
KINDS_PREFACE = f"""# Case format: other kinds of problem

{GENERATED}

A shell is the default kind; the key `kind` chooses another. Every kind has the keys `title`, `description`, `also_known_as`, `units`, `suites`, `theory`,
`known` and `quantities` of [a shell](case_format.md), and the conventions of that page. Their quantities have the
[common keys](case_format.md#quantities) of a shell's quantities. `t` is the time in formulas.
"""


class UndescribedError(Exception):
    """A key that neither its class nor its definition explains."""


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
    """Return the first paragraph of the docstring of a class in one line, without its unit."""
    words = " ".join(inspect.cleandoc(cls.__doc__ or "").split("\n\n")[0].split())
    return UNIT.sub("", words, count=1) if len(UNIT.findall(words)) == 1 else words


UNITS = {"metres": "m", "kg per square metre": "kg/m^2", "degrees": "degrees"} | {
    unit: unit
    for unit in ("N m/m", "N/m^3", "N/m^2", "N/m", "N m", "kg m/s", "kg/s", "m/s^2", "m/s", "rad/s", "1/s", "Pa", "kg", "Hz", "J", "N", "m", "s")
}  # fmt: skip
SYMBOLS = "h", "k", "m", "nu", "rho", "v"  # at the head of a description: no words to be capitalised
UNIT = re.compile(rf"(?:^|[,;] )({'|'.join(map(re.escape, UNITS))})(?=[.;:,]|$)")


def description(cls: type[Model], name: str) -> tuple[str, str]:
    """Return the unit of a key and its meaning.

    A description with one unit gives it apart; one with several keeps them.

    Raises
    ------
    UndescribedError
        If nothing describes it.
    """
    words = attributes(cls).get(name) or cls.model_fields[name].description
    if not words:
        raise UndescribedError(
            f"{cls.__name__}.{name} has no description: add it to the section Attributes of its class"
        )
    words = re.sub(r" \(see `[^`]*`\)", "", words)
    found = UNIT.findall(words)
    unit = UNITS[found[0]] if len(found) == 1 else ""
    if unit:
        words = UNIT.sub("", words, count=1).lstrip(" ;:,")
    words = f"{name} {words}" if words.startswith("of ") else words  # "seed: of the draw" is the seed of the draw
    words = words.strip(".") or name.replace("_", " ")
    first = words if words.partition(" ")[0].strip(",;:") in SYMBOLS else words[0].upper() + words[1:]
    return unit, f"{first}."


def allowed(schema: Schema) -> str:
    """Return in words what a key may be."""
    if "const" in schema:
        return f'`"{schema["const"]}"`'
    if "enum" in schema:
        return ", ".join(f'`"{value}"`' for value in schema["enum"])
    if "$ref" in schema or "oneOf" in schema:
        return "table"
    if "anyOf" in schema:
        kinds = [allowed(option) for option in schema["anyOf"] if option.get("type") != "null"]
        return "formula" if kinds == ["number", "text"] else " or ".join(kinds)
    match schema.get("type"):
        case "array" if "prefixItems" in schema:
            inner = {allowed(item) for item in schema["prefixItems"]}
            return f"{len(schema['prefixItems'])} {plural(inner.pop())}"
        case "array" if "$ref" in schema["items"] or "oneOf" in schema["items"]:
            return "tables"
        case "array":
            return plural(allowed(schema["items"])) + (", at least one" if schema.get("minItems") else "")
        case "object":
            values = schema.get("additionalProperties") or one(schema["patternProperties"].values())
            return f"table of names: {allowed(values)}"
        case "number" | "integer" as kind:
            bounds = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
            said = [
                f"{sign} {schema[key]:g}" for key, sign in bounds.items() if abs(schema.get(key, LARGEST)) < LARGEST
            ]
            return " ".join([kind, ", ".join(said)]).strip()
        case "boolean":
            return "`true`, `false`"
        case "string":
            length = f" of at most {schema['maxLength']} characters" if "maxLength" in schema else ""
            return "name" if "pattern" in schema else f"text{length}"
    raise ValueError(f"no words for {schema}")


def plural(words: str) -> str:
    """Return a type in the plural; a list of choices or of lists says so."""
    if words.startswith("`"):
        return f"list: {words}"
    if words[0].isdigit() or words.startswith("numbers"):
        return f"lists of {words}"
    first, _, rest = words.partition(" ")
    return f"{first}s {rest}".strip()


def one(values: Any) -> Any:
    """Return the only one."""
    (only,) = values
    return only


def default(schema: Schema, required: bool) -> str:
    """Return the default of a key as it would stand in a file."""
    if required:
        return "required"
    if (value := schema.get("default")) is None or value in ([], {}, ""):
        return "none"
    return f"`{json.dumps(value)}`"


def line(*cells: str) -> str:
    """Return a row of a Markdown table."""
    return f"|{'|'.join(cell.replace('|', chr(92) + '|') for cell in cells)}|"


def keys(cls: type[Model], names: Iterable[str]) -> list[str]:
    """Return the rows of some keys of a model."""
    schema = cls.model_json_schema()
    rows = []
    for name in names:
        key = schema["properties"][name]
        unit, meaning = description(cls, name)
        if cls is not Case and name in Case.model_fields and meaning == description(Case, name)[1]:
            meaning = "As for shells."
        if key.get("type") == "boolean":
            meaning = meaning.replace("Whether ", "True if ", 1)
        rows.append(line(f"`{name}`", allowed(key), unit, default(key, name in schema.get("required", ())), meaning))
    return rows


def kinds(cls: type[Model], key: str = "kind") -> list[str]:
    """Return the values of `kind` that choose a model; none for models without one."""
    choices = cls.model_json_schema()["properties"].get(key, {})
    return choices.get("enum") or [value for value in [choices.get("const")] if value]


def group(name: str, cls: type[Model], common: Iterable[str], unit: str = "") -> list[str]:
    """Return the rows of one model: its name with a summary, then its own keys."""
    chosen = {"kind", *(["by"] if "by = " in name else [])}
    own = [key for key in cls.model_json_schema()["properties"] if key not in chosen and key not in common]
    return [line(f"**{name}**", "", unit, "", summary(cls)), *keys(cls, own)]


def group_name(cls: type[Model]) -> str:
    """Return the keys by which a file chooses a model."""
    before = TABLES.get(cls.__name__, "kind") if _is_shown(cls) else "kind"
    choices = ", ".join(f'`"{kind}"`' for kind in kinds(cls))
    return f"`{before}` = {choices}" if choices else f"`{before}`"


def section(heading: str, words: str, base: type[Model] | None, classes: tuple[str, ...]) -> str:
    """Return the section of one topic of a shell's file."""
    common = list(base.model_fields) if base else []
    rows = keys(base, common) if base else []
    for name in classes:
        cls = model_class(name)
        if name == heading.rstrip("s") or len(classes) == 1:
            rows += keys(cls, cls.model_json_schema()["properties"])
        else:
            rows += group(group_name(cls), cls, common, cls.model_fields["unit"].default if "unit" in common else "")
    note = f"\n\n{FORMULA_NOTE}" if "FormulaBody" in classes else ""
    return (
        f"## {heading}\n\n{words}\n\n{COLUMNS}\n"
        + "\n".join(rows)
        + f"{note}\n\n```toml\n{EXAMPLES[heading].text}\n```"
    )


def page() -> str:
    """Return the page of shells."""
    whole = [name for name in Case.model_fields if name != "name"]
    top = f"## The file\n\nThe keys of a case file; most are tables, described below.\n\n{COLUMNS}\n" + "\n".join(
        keys(Case, whole)
    )
    return "\n\n".join([PREFACE.strip(), top, *(section(*each) for each in SECTIONS)]) + "\n"


def other(
    heading: str,
    chosen: str,
    words: str,
    case: type[Problem],
    tables: Mapping[str, type[Model]],
    asked_for: Iterable[type[Model]],
    example: str,
    shown: tuple[str, ...],
) -> str:
    """Return the section of another kind of problem."""
    own = [name for name in case.model_fields if name not in {*Problem.model_fields, "kind", "known", "shell"}]
    rows = keys(case, dict.fromkeys(["theory", *(name for name in own if name != "quantities")]))
    for name, cls in tables.items():
        rows += group(f"`{name}`", cls, ())
    common = list(quantities.ShellQuantity.model_fields)
    for cls in asked_for:
        rows += group(group_name(cls), cls, common, cls.model_fields["unit"].default)
    return (
        f"## {heading}\n\n`{chosen}`. {words}\n\n{COLUMNS}\n"
        + "\n".join(rows)
        + f"\n\nFrom `cases/{example}.toml`:\n\n```toml\n{excerpt(example, shown)}\n```"
    )


def excerpt(case: str, shown: tuple[str, ...]) -> str:
    """Return the file of a case with some of its quantities, without its description."""
    file = (CASES / f"{case}.toml").read_text(encoding="utf-8")
    head, *asked_for = re.sub(r"^description = .*\n", "", file.strip(), flags=re.MULTILINE).split("[[quantities]]")
    kept = [text for text in asked_for if any(f'name = "{name}"\n' in text for name in shown)]
    return "[[quantities]]".join([head, *kept]).strip()


def kinds_page() -> str:
    """Return the page of the other kinds of problem."""
    return "\n\n".join([KINDS_PREFACE.strip(), *(other(*each) for each in OTHERS)]) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    KINDS_PAGE.write_text(kinds_page(), encoding="utf-8")
