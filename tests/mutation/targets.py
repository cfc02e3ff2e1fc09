"""Where mutants are made: the mechanics of the solvers and of the question, and what is left out of it by rule.

Whole modules are left out that hold settings, files, checks, training, or choose how fine and in which steps to solve:
a mistake there shows as cost or as a refusal. So does one in the choice of trial functions. Of the other modules these statements are left out:

- docstrings, messages, `raise`, `assert`, and the condition under which a `raise` is all that follows;
- what tells of progress; `isinstance`;
- fields of classes, defaults of arguments, decorators, annotations;
- numbers and types with a name of their own at the top of a module: tolerances, limits, numbers of points;
- functions that return text, check input, or read and write files.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Target:
    """Modules of which mutants are made, and the solvers whose exam they go through.

    Attributes
    ----------
    folders
        Of the package; modules in folders below are not meant.
    excluded
        Patterns of stems of modules that are left out, each with the reason.
    """

    name: str
    solvers: tuple[str, ...]
    folders: tuple[str, ...]
    excluded: tuple[tuple[str, str], ...]

    def modules(self) -> list[str]:
        """Return the modules by name, sorted."""
        paths = (path for folder in self.folders for path in sorted((ROOT / folder).glob("*.py")))
        return [module_of(path) for path in paths if self.why_excluded(path.stem) is None]

    def why_excluded(self, stem: str) -> str | None:
        """Return why a module is left out, None if it is not."""
        return next((why for pattern, why in self.excluded if re.fullmatch(pattern, stem)), None)


CONTROL = "it chooses how fine and in which steps to solve"
EQUATIONS = "it solves equations that others set up, and checks the residual"
TRIALS = "it chooses trial functions, of which the energy decides"
SETTINGS = "settings, choices and files"
CHECKS = "it refuses, and solves nothing"

FEM = Target(
    "fem",
    ("fem",),
    ("shellbench/solvers/fem",),
    (
        ("__init__|solver|choices", SETTINGS),
        ("solving|refinement|continuation|large_displacement|motion|corners", CONTROL),
        ("kinks", CHECKS),
        ("linear_solve|dissection", EQUATIONS),
    ),
)
NDF = Target(
    "ndf-ritz",
    ("ndf-ritz",),
    ("shellbench/solvers/ndf",),
    (
        ("__init__|.*_solver|choices|weights|checkpoint|build", SETTINGS),
        ("declines|refusal|certificate", CHECKS),
        ("published.*|trainer|training|gauss_newton|network|soft", "ndf-ritz trains nothing and has no soft supports"),
        ("resolution|lengths|refinement|continuation|newton|large_displacement|motion", CONTROL),
        ("corners|inputs", TRIALS),
    ),
)
QUESTION = Target(
    "question",
    ("fem", "ndf-ritz"),
    ("shellbench/problems", "shellbench/problems/shell"),
    (
        ("__init__|formula_text|case|kind|field|history|surfaces|quantities", SETTINGS),
        ("course|path", CHECKS),
        ("portrait|sampling|series|solution", "what a record keeps beside its values, and no value is made of"),
        ("variants|placing|reparametrisation|units", "it asks the variants: it is the exam, not the examined"),
        ("symmetry", "it tells solvers what they may leave out; a wrong answer is theirs"),
    ),
)
TARGETS = {target.name: target for target in (FEM, NDF, QUESTION)}

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
        First and last line: whatever runs one of them reaches it.
    """

    statement: ast.stmt
    expressions: tuple[ast.AST, ...]
    lines: tuple[int, int]


def parts(tree: ast.Module) -> Iterator[Part]:
    """Yield what may be changed of a module, statement by statement."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield from _of_function(node)
        elif isinstance(node, ast.ClassDef):
            yield from _of_class(node)
        elif isinstance(node, ast.Assign | ast.AnnAssign) and not (_is_named_number(node) or _is_type(node)):
            yield from _part(node)


def _of_class(node: ast.ClassDef) -> Iterator[Part]:
    for child in node.body:
        if isinstance(child, ast.FunctionDef):
            yield from _of_function(child)


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
    """Whether an assignment gives a name to one number, or to an expression of numbers."""
    value = node.value
    return value is None or all(
        isinstance(part, ast.Constant | ast.BinOp | ast.UnaryOp | ast.operator | ast.unaryop)
        for part in ast.walk(value)
    )


def _is_type(node: ast.Assign | ast.AnnAssign) -> bool:
    """Whether an assignment gives a name to a type."""
    value = node.value
    return isinstance(value, ast.BinOp) or (isinstance(value, ast.Subscript) and _name(value.value) in TYPES)


def _name(node: ast.AST) -> str:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case _:
            return ""
