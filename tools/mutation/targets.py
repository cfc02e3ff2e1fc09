"""Code that is mutated: the mechanics of the solvers and of the question, without the exclusions of these rules.

Modules with settings, files, checks, training, or the choice of resolution and steps are excluded: a mistake there appears
as cost or as a refusal. The same holds for the choice of trial functions. In the other modules these statements are excluded:

- docstrings, messages, `raise`, `assert`, and a condition with nothing but a `raise`;
- progress reports; `isinstance`;
- fields of classes, defaults of arguments, decorators, annotations;
- numbers and types with a name of their own at the top of a module: tolerances, limits, numbers of points;
- functions that return text, check input, or read and write files.

These rules name modules, but some modules mix mechanics with other tasks: a module of meshes has basis functions and
chooses lines. `KINDS` applies the same rules to functions, by their task and not by the results of their mutants. It was
written when seeds 1 to 6 had been seen, and before seed 7 was drawn. Up to seed 7 mutants were drawn from all statements.
The score is given for all of them, for mechanics, and for uncertainties, which are part of the answer and are judged by
calibration. From seed 8 on mutants are drawn from mechanics only (`--kind mechanics`).
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Target:
    """Modules that are mutated, and the solvers whose exam judges them.

    Attributes
    ----------
    folders
        Folders of the package; `**` at the end includes the folders below.
    excluded
        Patterns of stems of modules that are left out, each with the reason.
    """

    name: str
    solvers: tuple[str, ...]
    folders: tuple[str, ...]
    excluded: tuple[tuple[str, str], ...]

    def modules(self) -> list[str]:
        """Return the modules by name, sorted."""
        paths = (path for folder in self.folders for path in sorted(ROOT.glob(f"{folder}/*.py")))
        return [module_of(path) for path in paths if self.why_excluded(path.stem) is None]

    def why_excluded(self, stem: str) -> str | None:
        """Return the reason why a module is left out, None if it is not."""
        return next((why for pattern, why in self.excluded if re.fullmatch(pattern, stem)), None)


CONTROL = "it chooses how fine and in which steps to solve"
EQUATIONS = "it solves equations that others set up, and checks the residual"
TRIALS = "it chooses trial functions, of which the energy decides"
SETTINGS = "settings, choices and files"
CHECKS = "it refuses, and solves nothing"

FEM = Target(
    "fem",
    ("fem",),
    ("shellbench/solvers/fem/**",),
    (
        ("__init__|solver|(conditioned_)?settings|choices", SETTINGS),
        ("solving|refinement|convergence|continuation|large_displacement|motion|corners", CONTROL),
        ("kinks", CHECKS),
        ("dissection|factor", EQUATIONS),
    ),
)
NDF = Target(
    "ndf-ritz",
    ("ndf-ritz",),
    ("shellbench/solvers/ndf/**",),
    (
        ("__init__|.*_solver|.*_settings|choices|weights|checkpoint|build", SETTINGS),
        ("declines|refusal|certificate", CHECKS),
        (
            "published.*|trainer|training.*|gauss_newton|sketch|layers|soft",
            "ndf-ritz trains nothing and has no soft supports",
        ),
        ("resolution|lengths|refinement|continuation|newton|large_displacement|motion|integration", CONTROL),
        ("corners|inputs", TRIALS),
    ),
)
QUESTION = Target(
    "question",
    ("fem", "ndf-ritz"),
    (
        "shellbench/problems",
        *(
            f"shellbench/problems/shell/{room}"
            for room in ("", "question", "quantities", "posed", "symmetry", "records")
        ),
    ),
    (
        ("__init__|formula_text|case|kind|field|history|surfaces|quantities", SETTINGS),
        ("course|path|declining", CHECKS),
        ("portrait|drawing|sampling|series|solution", "what a record keeps beside its values, and no value is made of"),
        ("variants|placing|reparametrisation|units", "it asks the variants: it is the exam, not the examined"),
        ("symmetry", "it tells solvers what they may leave out; a wrong answer is theirs"),
    ),
)
TARGETS = {target.name: target for target in (FEM, NDF, QUESTION)}

MECHANICS = "mechanics"  # what an answer's value is made of
STATEMENT = "statement"  # of how sure an answer is, and of what is rounding in it
CHOICE = "choice"  # of meshes, points, steps, trial functions and folding: answers converge to the same
CHECK = "check"  # refuses an answer, and changes none
EQUATION = "equation"  # solves what others set up; ends an iteration
RECORD = "record"  # what a record or a picture has beside the values
LEFT_OUT = (CHOICE, CHECK, EQUATION, RECORD)
ALL_KINDS = (MECHANICS, STATEMENT, *LEFT_OUT)

DRAWN_ONLY = "fields at points are drawn, and no quantity is made of them"
FOLDS = "it tells what may be left out of a symmetric shell, as `symmetry` of the question does, which is left out"

# Module, functions (a pattern of the whole name), what they are, and why. What is named nowhere is mechanics.
KINDS: tuple[tuple[str, str, str, str], ...] = (
    # fem
    (
        "fem.path.buckling",
        r"following_steps|.*(softest_stiffness|softest_mode|area|stiffness|relax|_move_supports|_push_along_softest_mode|_descend)",
        CHOICE,
        "steps from an unstable state to a stable one; `last_stable_state`, which tells the critical load, is mechanics",
    ),
    ("fem.path.buckling", r"_relax_or_end|_product", CHOICE, "parts of these steps"),
    ("fem.algebra.cell_dissection", r".*", EQUATION, "the order of an elimination, and a factorisation"),
    ("fem.linear.contact", r"_step_share", EQUATION, "the length of a step toward a minimum"),
    ("fem.mechanics.contact_points", r".*penalty_factors", CHOICE, "penalties in the order in which they are tried"),
    ("fem.algebra.eigenpairs", r".*", EQUATION, "a block Lanczos method"),
    (
        "fem.algebra.direct_solve",
        r"solve_reduced|_refine|_conjugate_gradients|_quotient|_cosine|_ratio|_factorise_by_.*|factorised",
        EQUATION,
        "iterative refinement, and factorisations",
    ),
    ("fem.algebra.direct_solve", r"_energy", STATEMENT, "the energy of rounding"),
    (
        "fem.path.finite_state",
        r".*",
        EQUATION,
        "a step of Newton's method with one more equation, or by a symmetric factor",
    ),
    ("fem.mechanics.layers", r".*", CHOICE, "how a mesh is graded toward layers"),
    (
        "fem.mesh.grading",
        r".*",
        CHOICE,
        "where mesh lines are",
    ),
    ("fem.path.newton", r".*", EQUATION, "Newton's method: its first step, its steps, and when it ends"),
    ("fem.path.problem", r".*\.(revolution|factorised)", EQUATION, "what Newton's method asks beside the mechanics"),
    ("fem.mechanics.solution|fem.motion.motion_solution", r".*\.field_at", RECORD, DRAWN_ONLY),
    (
        "fem.linear.symmetry",
        r".*\.(from_case|fold|_case_in_mirror_frame)|_CaseOnMesh\..*|_gauss_points",
        CHOICE,
        FOLDS + "; how a part is unfolded, and the answer turned back, is mechanics",
    ),
    (
        "fem.motion.time_step",
        r"_StepPotential\.(minimise|_factorised)|_solve_on_free",
        EQUATION,
        "Newton's method; the potential and its derivatives are mechanics",
    ),
    # ndf-ritz
    ("ndf.path.buckling", r"trust_region_step", EQUATION, "the least of a quadratic form within a radius"),
    (
        "ndf.path.buckling",
        r"relax_to_stable|_size|follow_steps|_to_buckling|_beyond_buckling|_step_to",
        CHOICE,
        "steps of a path; `_critical_state` and `_critical_load`, which tell the critical load, are mechanics",
    ),
    (
        "ndf.linear.contact",
        r"solve|_fit_creases|edges_of_contact|_root_of_gap|draw_field",
        CHOICE,
        "resolutions, and where features jump",
    ),
    ("ndf.linear.contact", r"_as_answer", STATEMENT, "the uncertainty of an answer in contact"),
    ("ndf.path.contact_at_finite_strain", r"contact_state", EQUATION, "Newton's method; its rows are mechanics"),
    ("ndf.strains.energy", r"energy_gap", CHECK, "an answer is refused where two rules differ"),
    ("ndf.path.equilibrium", r".*\.(independent|_stiffness)", CHOICE, "which combinations of features are kept"),
    (
        "ndf.path.equilibrium",
        r".*\.(rounding_energy|cosine|predicted_stresses|predicted_energies|_strain_change)",
        EQUATION,
        "when Newton's method ends, and what it predicts",
    ),
    (
        "ndf.field.network",
        r"Network\.first_features|siren|random_features|deep_random_features|_uniform",
        CHOICE,
        "trial functions are drawn",
    ),
    (
        "ndf.field.field",
        r"FixedFeatures\.(from_case|coarser_mask|component_mask|_focus_jets)|Features\.pairs",
        CHOICE,
        "which fixed trial functions there are; their jets are mechanics",
    ),
    ("ndf.path.modes", r"remaining_error", STATEMENT, "the uncertainty of modes"),
    (
        "ndf.path.modes",
        r"solve|_OneLevel\._combinations",
        CHOICE,
        "levels of ever more features, and which are independent",
    ),
    ("ndf.motion.motion_problem", r".*\.highest_frequency", CHOICE, "how long a step in time may be"),
    ("ndf.linear.patches", r"Recovery\._fits_polynomials", CHOICE, "whether polynomials may be fitted on a patch"),
    ("ndf.path.path_challenge", r".*", STATEMENT, "how sure a path is, by challengers"),
    (
        "ndf.field.quadrature",
        r"_?panel_ends|_layered_ends|ends_of|_cut_cells|_panels_at",
        CHOICE,
        "where panels end; points and weights on them are mechanics",
    ),
    ("ndf.ritz", r".*", CHOICE, "rungs, which are tried in order until a path settles"),
    (
        "ndf.strains.smooth",
        r".*independent|smooth|placed_features|scales|width_for|degrees",
        CHOICE,
        "trial functions of paths and motions",
    ),
    ("ndf.strains.smooth", r"rule_of|finer", CHOICE, "how fine a rule is"),
    ("ndf.linear.signs", r"rounding_energy", STATEMENT, "an energy that is rounding"),
    ("ndf.linear.signs", r".*", CHECK, "what makes a solved field no answer"),
    (
        "ndf.linear.solution|ndf.motion.motion_solution",
        r".*\.(field_at|_strain_data|with_rounded_features)|field_by_name|strain_data",
        RECORD,
        DRAWN_ONLY + "; sizes of files",
    ),
    ("ndf.linear.solve", r"(RegularisedInverse|HeldInverse)\..*", EQUATION, "factorisations with a jitter, refined"),
    ("ndf.linear.static", r"solve|_without_challengers", CHOICE, "levels of ever more features"),
    ("ndf.linear.answer", r"SolvedLevel\.with_challengers", CHOICE, "levels of ever more features"),
    ("ndf.linear.answer", r"Candidate\.error_bounds", STATEMENT, "the uncertainty of a linear shell's answer"),
    (
        "ndf.linear.static",
        r"_as_answer|_recovery_bounds",
        STATEMENT,
        "the uncertainty of a linear shell's answer",
    ),
    # the question
    ("problems.kinks", r".*", CHOICE, "where meshes and panels get lines, or a refusal"),
    ("problems.solving", r".*", RECORD, "how solvers take a case: no mechanics"),
    ("shell.question.contact", r"kept_touch|restored_touch", RECORD, "what a file keeps"),
    (
        "shell.symmetry.mirror_frame",
        r".*",
        CHOICE,
        FOLDS,
    ),
    (
        "shell.posed.mirrors",
        r"ComparisonPoints\..*|mirror_of|_.*|point_forces",
        CHOICE,
        FOLDS + "; how points, places and supports are mirrored is mechanics",
    ),
    ("shell.records.self_intersection", r".*", RECORD, "a study of an answer, and no quantity"),
    ("shell.posed.shell", r"Shell\.(physics|asked_as_well)", RECORD, "which records answer a question"),
)


def kind_of(module: str, function: str) -> str:
    """Return the kind of a module's function: mechanics unless `KINDS` has another one; the first matching entry counts."""
    for modules, functions, kind, _ in KINDS:
        if any(module.endswith(f".{name}") for name in modules.split("|")) and re.fullmatch(functions, function):
            return kind
    return MECHANICS


FILES_AND_CHECKS = re.compile(
    r"_pole|_?check(ed)?|_?check_.*|_?declined?s?|save|load|kept|restored|rounded|storage_bytes|__\w+__"
)
VALIDATORS = {"model_validator", "field_validator"}
TYPES = {"Annotated", "Callable", "Literal", "NDArray", "Union"}
PROGRESS = {"progress", "tell", "Progress", "HistoryStep"}
TYPE_CHECKS = {"isinstance", "issubclass"}


def module_of(path: Path) -> str:
    """Return the name of the module in a file."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def file_of(module: str) -> Path:
    """Return the file of a module."""
    return ROOT.joinpath(*module.split(".")).with_suffix(".py")


@dataclass(frozen=True)
class Part:
    """A statement of mechanics, or the head of one that has a body.

    Attributes
    ----------
    statement
        The statement.
    expressions
        Nodes in it that may be changed, in the order of the tree.
    lines
        First and last line: running one of them reaches the statement.
    function
        Function around it, `Class.method` for a method; functions within functions are part of these. Empty at the top.
    """

    statement: ast.stmt
    expressions: tuple[ast.AST, ...]
    lines: tuple[int, int]
    function: str = ""


def parts(tree: ast.Module) -> Iterator[Part]:
    """Yield the changeable parts of a module, statement by statement."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield from _named(node.name, _of_function(node))
        elif isinstance(node, ast.ClassDef):
            yield from _of_class(node)
        elif isinstance(node, ast.Assign | ast.AnnAssign) and not (_is_named_number(node) or _is_type(node)):
            yield from _part(node)


def _of_class(node: ast.ClassDef) -> Iterator[Part]:
    for child in node.body:
        if isinstance(child, ast.FunctionDef):
            yield from _named(f"{node.name}.{child.name}", _of_function(child))


def _named(function: str, found: Iterator[Part]) -> Iterator[Part]:
    return (replace(part, function=function) for part in found)


def _of_function(node: ast.FunctionDef) -> Iterator[Part]:
    if not _no_mechanics(node):
        yield from _of_body(node.body)


def _of_body(body: list[ast.stmt]) -> Iterator[Part]:
    for node in body:
        match node:
            case ast.FunctionDef():
                yield from _of_function(node)
            case ast.If():
                if not _only_refuses(node.body):
                    yield from _part(node, node.test)
                yield from (*_of_body(node.body), *_of_body(node.orelse))
            case ast.For():
                yield from (*_part(node, node.iter), *_of_body(node.body), *_of_body(node.orelse))
            case ast.While():
                yield from (*_part(node, node.test), *_of_body(node.body), *_of_body(node.orelse))
            case ast.With():
                yield from _of_body(node.body)
            case ast.Try():
                yield from _of_body([*node.body, *node.orelse, *node.finalbody])
                yield from (part for handler in node.handlers for part in _of_body(handler.body))
            case ast.Match():
                yield from _part(node, node.subject)
                yield from (part for case in node.cases for part in _of_body(case.body))
            case ast.Assign() | ast.AugAssign() | ast.AnnAssign() | ast.Return() | ast.Expr():
                yield from _part(node)


def _part(statement: ast.stmt, head: ast.expr | None = None) -> Iterator[Part]:
    whole = head or statement
    expressions = tuple(_mechanics(whole))
    if expressions:
        yield Part(statement, expressions, (whole.lineno, whole.end_lineno or whole.lineno))


def _mechanics(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and those below it, without text, annotations, type checks and progress."""
    if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Call) and _name(node.func) in PROGRESS | TYPE_CHECKS):
        return
    yield node
    for name, value in ast.iter_fields(node):
        if name != "annotation":
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _mechanics(child)


def _no_mechanics(node: ast.FunctionDef) -> bool:
    text = node.returns is not None and ast.unparse(node.returns).replace(" | None", "") == "str"
    validates = any(_name(d.func if isinstance(d, ast.Call) else d) in VALIDATORS for d in node.decorator_list)
    return text or validates or bool(FILES_AND_CHECKS.fullmatch(node.name))


def _only_refuses(body: list[ast.stmt]) -> bool:
    return all(isinstance(node, ast.Raise) for node in body)


def _is_named_number(node: ast.Assign | ast.AnnAssign) -> bool:
    """Return True if an assignment gives a name to one number, or to an expression of numbers."""
    value = node.value
    return value is None or all(
        isinstance(part, ast.Constant | ast.BinOp | ast.UnaryOp | ast.operator | ast.unaryop)
        for part in ast.walk(value)
    )


def _is_type(node: ast.Assign | ast.AnnAssign) -> bool:
    """Return True if an assignment gives a name to a type."""
    value = node.value
    return isinstance(value, ast.BinOp) or (isinstance(value, ast.Subscript) and _name(value.value) in TYPES)


def _name(node: ast.AST) -> str:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case _:
            return ""
