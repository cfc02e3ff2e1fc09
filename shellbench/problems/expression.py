"""Formulas in case files: parsed by an allow-list and differentiated exactly.

A formula such as ``R*cos(xi1) + 0.1*xi2**2`` is read into a small tree of allowed operations; nothing is
ever evaluated as Python. Its derivatives are exact: the tree is evaluated on truncated Taylor series in
(xi1, xi2) instead of on numbers (Griewank & Walther, Evaluating Derivatives, 2nd ed., chapter 13), so that
one pass yields the value and all partial derivatives up to the order asked for.

    >>> radius = Expression("R*cos(xi1)", variables=("xi1", "xi2"), constants={"R": 2.0})
    >>> series = radius.series({"xi1": Taylor.variable(0.0, axis=0, order=2)}, order=2)
    >>> float(series.derivative(2, 0))
    -2.0
"""

from __future__ import annotations

import ast
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.errors import InputError, without_middle
from shellbench.problems.formula_functions import CONSTANTS, FUNCTIONS, PIECEWISE
from shellbench.problems.interval import Interval, interval_of
from shellbench.problems.taylor import Array, Taylor, numbers

MAX_LENGTH = 100_000  # characters: the longest formula that is read
MAX_DEPTH = 200  # deepest nesting of a formula that is read
LONG, LOW = 500, 4  # nodes of a formula that is looked at by its parts, and powers that make nothing narrow


_FEWEST = {"min": 2, "max": 2, "abs": 1}
_MOST = {"min": math.inf, "max": math.inf, "abs": 1}
_COMPARISONS: dict[type[ast.cmpop], Callable[[Array, Array], NDArray[np.bool_]]] = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
}

_OPERATORS: dict[type[ast.operator], Callable[[Taylor, Taylor], Taylor]] = {
    ast.Add: Taylor.__add__,
    ast.Sub: Taylor.__sub__,
    ast.Mult: Taylor.__mul__,
    ast.Div: Taylor.__truediv__,
    ast.Pow: Taylor.power,
}


class Expression:
    """One formula of a case file.

    Parameters
    ----------
    text
        The formula: numbers, names, + - * / **, parentheses and the functions in `FUNCTIONS`.
    variables
        Names that get their values at evaluation.
    constants
        Named constants of the case file, beside pi.
    piecewise
        Whether it may contain min(a, b), max(a, b), abs(a) and where(a < b, c, d).

    Raises
    ------
    InputError
        If the text is no formula of allowed parts.
    """

    def __init__(
        self,
        text: str | float,
        variables: tuple[str, ...] = ("xi1", "xi2"),
        constants: Mapping[str, float] | None = None,
        piecewise: bool = False,
    ) -> None:
        self.text = str(text)
        self._variables = variables
        self._piecewise = piecewise
        self._constants = {**CONSTANTS, **(constants or {})}
        self._tree, self._evaluate = _read(self.text, variables, tuple(sorted(self._constants)), piecewise)

    @property
    def parts(self) -> tuple[Expression, ...]:
        """Parts of a long formula that may vary quickly: its calls, divisors and high powers; a short formula itself.

        A long formula is a polynomial of these parts. An interval of the whole formula would be too wide, since
        interval bounds grow with its length.
        """
        if sum(1 for _ in ast.walk(self._tree)) <= LONG:
            return (self,)
        texts = dict.fromkeys(ast.unparse(part) for part in _parts(self._tree))
        found = (Expression(text, self._variables, self._constants, self._piecewise) for text in texts)
        return tuple(part for part in found if not part.constant)

    @property
    def constant(self) -> bool:
        """True if the formula contains no variable."""
        return not any(self.depends_on(name) for name in self._variables)

    @property
    def key(self) -> tuple[object, ...]:
        """Text, variables and constants of the formula: its key in caches."""
        return self.text, self._variables, tuple(self._constants.items()), self._piecewise

    @classmethod
    def of_key(cls, key: tuple[Any, ...]) -> Expression:
        """Make the formula of a `key`."""
        return cls(key[0], key[1], dict(key[2]), key[3])

    def depends_on(self, variable: str) -> bool:
        """Return True if the formula contains a variable."""
        return any(isinstance(node, ast.Name) and node.id == variable for node in ast.walk(self._tree))

    @property
    def rivals(self) -> tuple[tuple[Expression, ...], ...]:
        """Rival formulas of each piecewise call, inner calls first; the least rival decides the call's value."""
        found: list[list[ast.expr]] = []
        for node in ast.walk(self._tree):
            match node:
                case ast.Call(func=ast.Name(id="abs"), args=[argument]):
                    found.append([argument, ast.UnaryOp(ast.USub(), argument)])
                case ast.Call(func=ast.Name(id="min"), args=arguments):
                    found.append(list(arguments))
                case ast.Call(func=ast.Name(id="max"), args=arguments):
                    found.append([ast.UnaryOp(ast.USub(), argument) for argument in arguments])
                case ast.Compare(left=left, comparators=[right]):
                    found.append([left, right])
        lines = _lines(self.text)
        return tuple(tuple(self._part(tree, lines) for tree in trees) for trees in found[::-1])

    def _part(self, tree: ast.expr, lines: tuple[bytes, ...]) -> Expression:
        """Return a part of the formula, without parsing it again."""
        part = object.__new__(Expression)
        part.text, part._tree = ast.unparse(tree), tree
        part._variables, part._constants, part._piecewise = self._variables, self._constants, self._piecewise
        part._evaluate = _evaluation(tree, lines)
        return part

    def copied_tree(self) -> ast.expr:
        """Return the tree of the formula, to be changed."""
        return ast.parse(self.text.strip(), mode="eval").body

    def of_tree(self, tree: ast.expr) -> Expression:
        """Return the formula of a tree, with the same names."""
        return Expression(ast.unparse(tree), self._variables, self._constants, self._piecewise)

    @property
    def quoted(self) -> str:
        """The formula, as far as a sentence quotes it."""
        return without_middle(self.text)

    def series(self, values: Mapping[str, Taylor], order: int) -> Taylor:
        """Return the Taylor series of the formula; variables without a value are an error."""
        return self._series({**values, **self._known(order)}, order)

    def _known(self, order: int) -> dict[str, Taylor]:
        return {name: Taylor.constant(value, order) for name, value in self._constants.items()}

    def _series(self, values: dict[str, Taylor], order: int) -> Taylor:
        with np.errstate(all="ignore"):
            return self._evaluate(values, order)

    def derivatives(self, points: ArrayLike, order: int, t: float = 1.0) -> dict[tuple[int, int], Array]:
        """Return all partial derivatives at the points.

        Parameters
        ----------
        points
            (..., 2) curvilinear coordinates; angles in radians.
        order
            Highest total order of derivatives.
        t
            Value of the variable t, if the formula has it.

        Returns
        -------
        dict
            (i, j) -> (...) derivative i times in xi1 and j times in xi2.
        """
        return {key: value[..., 0] for key, value in derivatives_of((self,), points, order, t).items()}

    def enclosed(self, boxes: Mapping[str, Interval], along: str = "", order: int = 0) -> list[Interval]:
        """Return intervals (n,) of the values on boxes, and of derivatives along a variable over k!, up to an order.

        Each variable has an interval for each box.
        """
        values = {
            name: Taylor.variable(box, 0, order) if name == along else Taylor.constant(box, order)  # type: ignore[arg-type]
            for name, box in boxes.items()
            if name in self._variables
        }
        series, count = self.series(values, order), len(next(iter(boxes.values())).low)
        found = (interval_of(series.terms.get((k, 0), np.zeros(()))) for k in range(order + 1))
        return [Interval(np.broadcast_to(k.low, count), np.broadcast_to(k.high, count)) for k in found]

    def __reduce__(self) -> tuple[type[Expression], tuple[object, ...]]:
        return Expression, (self.text, self._variables, self._constants, self._piecewise)

    def __repr__(self) -> str:
        return f"Expression({self.text!r})"


def derivatives_of(
    formulas: Sequence[Expression], points: ArrayLike, order: int, t: float = 1.0
) -> dict[tuple[int, int], Array]:
    """Return the derivatives (i, j) -> (..., formulas) of formulas with the same constants; see `derivatives`.

    Calls that formulas share are made once.
    """
    xi = numbers(points)
    values = {
        "xi1": Taylor.variable(xi[..., 0], axis=0, order=order),
        "xi2": Taylor.variable(xi[..., 1], axis=1, order=order),
        "t": Taylor.constant(t, order),
        **formulas[0]._known(order),
    }
    shape = (*xi.shape[:-1], len(formulas))
    every = [formula._series(values, order) for formula in formulas]
    kind = np.result_type(float, *(term.dtype for series in every for term in series.terms.values()))
    found = {(i, total - i): np.zeros(shape, kind) for total in range(order + 1) for i in range(total, -1, -1)}
    for number, series in enumerate(every):
        for key in series.terms:
            found[key][..., number] = series.derivative(*key)
    return found


class _Formula(NamedTuple):
    """A formula's text with the names and functions that it may contain; these decide if it is allowed."""

    text: str
    variables: tuple[str, ...]
    constants: tuple[str, ...]
    piecewise: bool


Evaluation = Callable[[dict[str, Taylor], int], Taylor]
"""Values of the names, and the order of the series -> the series of a formula; functions are kept among the values."""


@lru_cache(maxsize=4096)
def _read(
    text: str, variables: tuple[str, ...], constants: tuple[str, ...], piecewise: bool
) -> tuple[ast.expr, Evaluation]:
    """Parse and check a formula, cached: cases and their variants share most formulas, whatever their constants."""
    if len(text) > MAX_LENGTH:
        raise InputError(f"a formula of {len(text)} characters is longer than the {MAX_LENGTH} allowed")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError(f"'{without_middle(text)}' is not a formula") from None
    _check(_Formula(without_middle(text), variables, constants, piecewise), tree, depth=0)
    return tree, _evaluation(tree, _lines(text))


def _lines(text: str) -> tuple[bytes, ...]:
    return tuple(text.strip().encode().splitlines(keepends=True))


def _check(formula: _Formula, node: ast.AST, depth: int) -> None:
    if depth > MAX_DEPTH:
        raise InputError(f"'{formula.text[:40]}...' is nested more than {MAX_DEPTH} levels deep")
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            if abs(number) > sys.float_info.max:
                raise InputError(f"'{formula.text}' holds a number that is too large")
        case ast.Name(id=name):
            if name not in (*formula.variables, *formula.constants):
                known = ", ".join([*formula.variables, *formula.constants])
                raise InputError(f"'{formula.text}' uses the unknown name '{name}'; known are {known}")
        case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=operand):
            _check(formula, operand, depth + 1)
        case ast.BinOp(op=ast.BitXor()):
            raise InputError(f"'{formula.text}': write ** for a power, not ^")
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATORS:
            _check(formula, left, depth + 1)
            _check(formula, right, depth + 1)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
            _check(formula, argument, depth + 1)
        case ast.Call(func=ast.Name(id=name)) if name in {*PIECEWISE, "where"} and not formula.piecewise:
            raise InputError(
                f"'{formula.text}' calls '{name}', which has kinks: it may stand in surfaces, loads, springs and"
                " factors of the material alone"
            )
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if (
            name in PIECEWISE and _FEWEST[name] <= len(arguments) <= _MOST[name]
        ):
            for argument in arguments:
                _check(formula, argument, depth + 1)
        case ast.Call(func=ast.Name(id="where"), args=[condition, first, second], keywords=[]):
            if (
                not isinstance(condition, ast.Compare)
                or [*map(type, condition.ops)][1:]
                or (type(condition.ops[0]) not in _COMPARISONS)
            ):
                raise InputError(f"'{formula.text}': where takes one comparison by <, <=, > or >= and two values")
            for argument in (condition.left, *condition.comparators, first, second):
                _check(formula, argument, depth + 1)
        case ast.Call(func=ast.Name(id=name)):
            raise InputError(
                f"'{formula.text}' calls '{name}' in a way that is not allowed;"
                f" functions of one argument are {', '.join(FUNCTIONS)}"
            )
        case _:
            raise InputError(
                f"'{formula.text}' is not a formula:"
                " only numbers, names, + - * / **, parentheses and functions are allowed"
            )


def _evaluation(node: ast.AST, lines: tuple[bytes, ...]) -> Evaluation:
    """Return the function that evaluates a checked tree: the tree is walked once, and not at each evaluation."""
    match node:
        case ast.Constant(value=number):
            value = np.asarray(float(number))  # type: ignore[arg-type]
            return lambda _, order: Taylor({(0, 0): value}, order)
        case ast.Name(id=name):
            return lambda values, _: values[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            inner = _evaluation(operand, lines)
            return lambda values, order: -inner(values, order)
        case ast.UnaryOp(operand=operand):
            return _evaluation(operand, lines)
        case ast.BinOp(left=left, op=operator, right=right):
            operation = _OPERATORS[type(operator)]
            first, second = _evaluation(left, lines), _evaluation(right, lines)
            return lambda values, order: operation(first(values, order), second(values, order))
        case ast.Call():
            words, call = _words(node, lines), _call(node, lines)

            def called(values: dict[str, Taylor], order: int) -> Taylor:
                # in variants a coordinate is itself a formula, which occurs in many places: it is evaluated once
                if words not in values:
                    values[words] = call(values, order)
                return values[words]

            return called
    raise AssertionError("unreachable: the tree was checked")


def _parts(node: ast.AST) -> Iterator[ast.expr]:
    match node:
        case ast.Call():
            yield node
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            yield ast.BinOp(ast.Constant(1.0), ast.Div(), right)
            yield from _parts(left)
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int() as power)) if 0 <= power <= LOW:
            yield from _parts(left)
        case ast.BinOp(op=ast.Pow()):
            yield node
        case _:
            for child in ast.iter_child_nodes(node):
                yield from _parts(child)


def _words(node: ast.expr, lines: tuple[bytes, ...]) -> str:
    """Return the text of a part; `ast.unparse` on a nested part would take time as the square of its depth."""
    rows = [*lines[node.lineno - 1 : node.end_lineno]]
    rows[-1] = rows[-1][: node.end_col_offset]
    rows[0] = rows[0][node.col_offset :]
    return b"".join(rows).decode()


def _call(node: ast.Call, lines: tuple[bytes, ...]) -> Evaluation:
    match node:
        case ast.Call(func=ast.Name(id=name), args=[argument]) if name in FUNCTIONS:
            function, inner = FUNCTIONS[name], _evaluation(argument, lines)
            return lambda values, order: function(inner(values, order))
        case ast.Call(func=ast.Name(id="where"), args=[ast.Compare(left, [comparison], [right]), given, otherwise]):
            compared = _COMPARISONS[type(comparison)]
            first, second, third, fourth = (_evaluation(part, lines) for part in (left, right, given, otherwise))

            def either(values: dict[str, Taylor], order: int) -> Taylor:
                sides = first(values, order), second(values, order)
                mask = compared(sides[0].value, sides[1].value)
                return third(values, order).chosen(fourth(values, order), mask, sides)

            return either
        case ast.Call(func=ast.Name(id=name), args=arguments):
            chosen, inners = PIECEWISE[name], [_evaluation(argument, lines) for argument in arguments]
            return lambda values, order: chosen([inner(values, order) for inner in inners])
    raise AssertionError("unreachable: the tree was checked")
