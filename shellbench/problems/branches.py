"""Branches of piecewise formulas: the formula that a piecewise one is in a rectangle."""

from __future__ import annotations

import ast

import numpy as np

from shellbench.errors import InputError
from shellbench.problems.expression import Expression
from shellbench.problems.features import Box
from shellbench.problems.kinks import kink_lines


def branch_in(formula: Expression, box: Box) -> Expression:
    """Return a formula with each min, max, abs and where replaced by the argument that it takes all over a rectangle.

    A call that changes over inside, however smoothly, is left as it is.
    """
    return formula.of_tree(_Branch(formula, box).visit(formula.copied_tree()))


class _Branch(ast.NodeTransformer):
    def __init__(self, formula: Expression, box: Box) -> None:
        self.formula, self.box, self.point = formula, box, np.mean(box, axis=1)

    def value(self, tree: ast.expr) -> float:
        return float(self.formula.of_tree(tree).derivatives(self.point, 0)[0, 0])

    def changes_over(self, call: ast.Call) -> bool:
        try:
            return any(kink_lines(self.formula.of_tree(call), self.box))
        except InputError:  # along no coordinate line
            return True

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)  # the arguments first
        match node:
            case ast.Call(func=ast.Name(id="abs" | "min" | "max" | "where")) if self.changes_over(node):
                return node
            case ast.Call(func=ast.Name(id="abs"), args=[argument]):
                return argument if self.value(argument) >= 0 else ast.UnaryOp(ast.USub(), argument)
            case ast.Call(func=ast.Name(id="min" | "max" as name), args=arguments):
                return (min if name == "min" else max)(arguments, key=self.value)
            case ast.Call(func=ast.Name(id="where"), args=[comparison, given, otherwise]):
                chosen = ast.Call(node.func, [comparison, ast.Constant(1.0), ast.Constant(0.0)], [])
                return given if self.value(chosen) else otherwise
        return node
