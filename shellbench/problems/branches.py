"""Branches of piecewise formulas: the smooth formula that a piecewise one is around a point."""

from __future__ import annotations

import ast

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.expression import Expression


def branch_at(formula: Expression, point: NDArray[np.float64]) -> Expression:
    """Return a formula with each min, max, abs and where replaced by the argument that it takes at a point (2,)."""
    return formula.of_tree(_Branch(formula, point).visit(formula.copied_tree()))


class _Branch(ast.NodeTransformer):
    def __init__(self, formula: Expression, point: NDArray[np.float64]) -> None:
        self.formula, self.point = formula, point

    def value(self, tree: ast.expr) -> float:
        return float(self.formula.of_tree(tree).derivatives(self.point, 0)[0, 0])

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)  # the arguments first: they are smooth from here on
        match node:
            case ast.Call(func=ast.Name(id="abs"), args=[argument]):
                return argument if self.value(argument) >= 0 else ast.UnaryOp(ast.USub(), argument)
            case ast.Call(func=ast.Name(id="min" | "max" as name), args=arguments):
                return (min if name == "min" else max)(arguments, key=self.value)
            case ast.Call(func=ast.Name(id="where"), args=[comparison, given, otherwise]):
                chosen = ast.Call(node.func, [comparison, ast.Constant(1.0), ast.Constant(0.0)], [])
                return given if self.value(chosen) else otherwise
        return node
