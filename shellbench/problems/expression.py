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
from collections.abc import Callable, Mapping
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.errors import InputError
from shellbench.problems.taylor import (
    Array,
    Taylor,
    cos_terms,
    cosh_terms,
    exp_terms,
    integrated,
    log_terms,
    one,
    sin_terms,
    sinh_terms,
    square_root,
)

MAX_LENGTH = 100_000  # characters: the longest formula that is read
MAX_DEPTH = 200  # deepest nesting of a formula that is read


Function = Callable[[Taylor], Taylor]

FUNCTIONS: dict[str, Function] = {
    "sin": lambda x: x.compose(sin_terms),
    "cos": lambda x: x.compose(cos_terms),
    "tan": lambda x: x.compose(sin_terms) / x.compose(cos_terms),
    "exp": lambda x: x.compose(exp_terms),
    "log": lambda x: x.compose(log_terms),
    "sqrt": square_root,
    "sinh": lambda x: x.compose(sinh_terms),
    "cosh": lambda x: x.compose(cosh_terms),
    "tanh": lambda x: x.compose(sinh_terms) / x.compose(cosh_terms),
    "asin": lambda x: x.compose(integrated(np.arcsin, lambda s: one(s) / square_root(one(s) - s * s))),
    "acos": lambda x: x.compose(integrated(np.arccos, lambda s: -one(s) / square_root(one(s) - s * s))),
    "atan": lambda x: x.compose(integrated(np.arctan, lambda s: one(s) / (one(s) + s * s))),
    "asinh": lambda x: x.compose(integrated(np.arcsinh, lambda s: one(s) / square_root(one(s) + s * s))),
}

CONSTANTS = {"pi": math.pi}


def _least(arguments: list[Taylor]) -> Taylor:
    least, *others = arguments
    for other in others:
        least = least.chosen(other, least.value <= other.value)
    return least


PIECEWISE: dict[str, Callable[[list[Taylor]], Taylor]] = {
    "min": _least,
    "max": lambda arguments: -_least([-argument for argument in arguments]),
    "abs": lambda arguments: arguments[0].chosen(-arguments[0], arguments[0].value >= 0),
}
"""Functions with kinks, of as many arguments as `_FEWEST` and `_MOST` say; `where` is read by itself."""
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
        Whether min(a, b), max(a, b), abs(a) and where(a < b, c, d) may stand in it.

    Raises
    ------
    InputError
        If the text is anything else than a formula of allowed parts.
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
        if len(self.text) > MAX_LENGTH:
            raise InputError(f"a formula of {len(self.text)} characters is longer than the {MAX_LENGTH} allowed")
        try:
            self._tree = ast.parse(self.text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise InputError(f"'{self.text}' is not a formula") from None
        self._check(self._tree, depth=0)

    def depends_on(self, variable: str) -> bool:
        """Tell whether a variable stands in the formula."""
        return any(isinstance(node, ast.Name) and node.id == variable for node in ast.walk(self._tree))

    @property
    def switches(self) -> tuple[Expression, ...]:
        """Differences at whose changes of sign the formula may have a kink or jump."""
        pairs: list[tuple[ast.expr, ast.expr | None]] = []
        for node in ast.walk(self._tree):
            match node:
                case ast.Call(func=ast.Name(id="abs"), args=[argument]):
                    pairs.append((argument, None))
                case ast.Call(func=ast.Name(id="min" | "max"), args=arguments):
                    pairs += combinations(arguments, 2)
                case ast.Compare(left=left, comparators=[right]):
                    pairs.append((left, right))
        trees = (left if right is None else ast.BinOp(left, ast.Sub(), right) for left, right in pairs)
        return tuple(Expression(ast.unparse(tree), self._variables, self._constants, piecewise=True) for tree in trees)

    def _check(self, node: ast.AST, depth: int) -> None:
        if depth > MAX_DEPTH:
            raise InputError(f"'{self.text[:40]}...' is nested more than {MAX_DEPTH} levels deep")
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                if abs(number) > sys.float_info.max:
                    raise InputError(f"'{self.text}' holds a number that is too large")
            case ast.Name(id=name):
                if name not in self._variables and name not in self._constants:
                    known = ", ".join([*self._variables, *sorted(self._constants)])
                    raise InputError(f"'{self.text}' uses the unknown name '{name}'; known are {known}")
            case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=operand):
                self._check(operand, depth + 1)
            case ast.BinOp(op=ast.BitXor()):
                raise InputError(f"'{self.text}': write ** for a power, not ^")
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATORS:
                self._check(left, depth + 1)
                self._check(right, depth + 1)
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
                self._check(argument, depth + 1)
            case ast.Call(func=ast.Name(id=name)) if name in {*PIECEWISE, "where"} and not self._piecewise:
                raise InputError(
                    f"'{self.text}' calls '{name}', which has kinks: it may stand in loads, springs and factors of the"
                    " material alone"
                )
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if (
                name in PIECEWISE and _FEWEST[name] <= len(arguments) <= _MOST[name]
            ):
                for argument in arguments:
                    self._check(argument, depth + 1)
            case ast.Call(func=ast.Name(id="where"), args=[condition, first, second], keywords=[]):
                if (
                    not isinstance(condition, ast.Compare)
                    or [*map(type, condition.ops)][1:]
                    or (type(condition.ops[0]) not in _COMPARISONS)
                ):
                    raise InputError(f"'{self.text}': where takes one comparison by <, <=, > or >= and two values")
                for argument in (condition.left, *condition.comparators, first, second):
                    self._check(argument, depth + 1)
            case ast.Call(func=ast.Name(id=name)):
                raise InputError(
                    f"'{self.text}' calls '{name}' in a way that is not allowed;"
                    f" functions of one argument are {', '.join(FUNCTIONS)}"
                )
            case _:
                raise InputError(
                    f"'{self.text}' is not a formula:"
                    " only numbers, names, + - * / **, parentheses and functions are allowed"
                )

    def series(self, values: Mapping[str, Taylor], order: int) -> Taylor:
        """Return the Taylor series of the formula; variables without a value are an error."""
        with np.errstate(all="ignore"):
            return self._evaluate(self._tree, values, order)

    def _evaluate(self, node: ast.AST, values: Mapping[str, Taylor], order: int) -> Taylor:
        match node:
            case ast.Constant(value=number):
                return Taylor.constant(float(number), order)  # type: ignore[arg-type]
            case ast.Name(id=name):
                if name in self._constants:
                    return Taylor.constant(self._constants[name], order)
                return values[name]
            case ast.UnaryOp(op=operator, operand=operand):
                inner = self._evaluate(operand, values, order)
                return -inner if isinstance(operator, ast.USub) else inner
            case ast.BinOp(left=left, op=operator, right=right):
                operation = _OPERATORS[type(operator)]
                return operation(self._evaluate(left, values, order), self._evaluate(right, values, order))
            case ast.Call(func=ast.Name(id=name), args=[argument]):
                inner = self._evaluate(argument, values, order)
                return FUNCTIONS[name](inner) if name in FUNCTIONS else PIECEWISE[name]([inner])
            case ast.Call(func=ast.Name(id="where"), args=[ast.Compare(left, [operator], [right]), first, second]):
                sides = (self._evaluate(side, values, order).value for side in (left, right))
                mask = _COMPARISONS[type(operator)](*sides)
                return self._evaluate(first, values, order).chosen(self._evaluate(second, values, order), mask)
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return PIECEWISE[name]([self._evaluate(argument, values, order) for argument in arguments])
        raise AssertionError("unreachable: the tree was checked at construction")

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
        xi = np.asarray(points, dtype=float)
        series = self.series(
            {
                "xi1": Taylor.variable(xi[..., 0], axis=0, order=order),
                "xi2": Taylor.variable(xi[..., 1], axis=1, order=order),
                "t": Taylor.constant(t, order),
            },
            order,
        )
        shape = xi.shape[:-1]
        return {
            (i, total - i): np.broadcast_to(series.derivative(i, total - i), shape)
            for total in range(order + 1)
            for i in range(total, -1, -1)
        }

    def __repr__(self) -> str:
        return f"Expression({self.text!r})"
