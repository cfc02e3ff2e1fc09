"""Rules that make mutants: small changes of an expression that resemble common mistakes.

Each rule takes one node of a syntax tree and yields its replacements. A rule knows no types: if a plus joins two lists,
the mutant crashes, and a crash is red.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable, Iterator
from itertools import pairwise

Rule = Callable[[ast.AST], Iterator[ast.AST]]

EXCHANGED = {  # by either name, as a function or as a method
    "min": "max",
    "minimum": "maximum",
    "amin": "amax",
    "fmin": "fmax",
    "argmin": "argmax",
    "clamp_min": "clamp_max",
}
EXCHANGED |= {other: name for name, other in EXCHANGED.items()}
SYMMETRIC = {*EXCHANGED, "hypot", "isinstance", "issubclass", "isclose", "allclose", "dot", "array_equal"}
RELATIONS: dict[type[ast.cmpop], type[ast.cmpop]] = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
TRANSPOSES = {"T", "mT"}
ORDERS = {"order", "derivative", "degree"}  # keywords whose numbers count


def sign(node: ast.AST) -> Iterator[ast.AST]:
    """Flip a sign: -a, a + b, a - b, x += a, x -= a."""
    match node:
        case ast.UnaryOp(op=ast.USub(), operand=operand) if not isinstance(operand, ast.Constant):
            yield operand
        case ast.BinOp(op=ast.Add()) | ast.AugAssign(op=ast.Add()):
            yield _with(node, op=ast.Sub())
        case ast.BinOp(op=ast.Sub()) | ast.AugAssign(op=ast.Sub()):
            yield _with(node, op=ast.Add())


def factor(node: ast.AST) -> Iterator[ast.AST]:
    """Double or halve a number in a product, quotient, power or sum, or a term of a sum."""
    match node:
        case ast.BinOp(op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() | ast.Pow(), left=left, right=right):
            for side, part in (("left", left), ("right", right)):
                if _is_number(part):
                    yield from (_with(node, **{side: _number(changed)}) for changed in _doubled_and_halved(part.value))
                elif isinstance(node.op, ast.Add | ast.Sub) and not _is_sum(part):
                    yield from (_with(node, **{side: _times(by, part)}) for by in (2, 0.5))


def quotient(node: ast.AST) -> Iterator[ast.AST]:
    """Exchange times and divided by."""
    match node:
        case ast.BinOp(op=ast.Mult()) | ast.AugAssign(op=ast.Mult()):
            yield _with(node, op=ast.Div())
        case ast.BinOp(op=ast.Div()) | ast.AugAssign(op=ast.Div()):
            yield _with(node, op=ast.Mult())


def transposed(node: ast.AST) -> Iterator[ast.AST]:
    """Exchange two indices: of a subscript, of an operand of einsum, or by leaving a transpose away."""
    match node:
        case ast.Subscript(slice=ast.Tuple(elts=indices)):
            for place, (one, other) in enumerate(pairwise(indices)):
                if _is_index(one) and _is_index(other) and ast.dump(one) != ast.dump(other):
                    swapped = [*indices[:place], other, one, *indices[place + 2 :]]
                    yield _with(node, slice=_with(node.slice, elts=swapped))
        case ast.Attribute(value=value, attr=name) if name in TRANSPOSES:
            yield value
        case ast.Call(args=[array, _, _]) if _called(node) == "swapaxes":
            yield array
        case ast.Call(args=[*axes], func=ast.Attribute()) if _called(node) in {"transpose", "permute"}:
            for place in range(len(axes) - 1):
                yield _with(node, args=[*axes[:place], axes[place + 1], axes[place], *axes[place + 2 :]])
        case ast.Call(args=[ast.Constant(value=str(formula)), *operands]) if _called(node) == "einsum":
            yield from (_with(node, args=[ast.Constant(text), *operands]) for text in _exchanged_letters(formula))


def dropped_term(node: ast.AST) -> Iterator[ast.AST]:
    """Leave out a term of a sum, or an addition in place."""
    match node:
        case ast.BinOp(op=ast.Add(), left=left, right=right):
            yield left
            yield right
        case ast.BinOp(op=ast.Sub(), left=left, right=right):
            yield left
            yield ast.UnaryOp(ast.USub(), right)
        case ast.AugAssign(op=ast.Add() | ast.Sub()):
            yield ast.Pass()


def arguments(node: ast.AST) -> Iterator[ast.AST]:
    """Exchange two neighbouring positional arguments that look alike."""
    if isinstance(node, ast.Call) and _called(node) not in SYMMETRIC:
        for place, (one, other) in enumerate(pairwise(node.args)):
            alike = type(one) is type(other) and isinstance(one, ast.Name | ast.Attribute | ast.Subscript)
            if (alike or (_is_number(one) and _is_number(other))) and ast.dump(one) != ast.dump(other):
                yield _with(node, args=[*node.args[:place], other, one, *node.args[place + 2 :]])


def off_by_one(node: ast.AST) -> Iterator[ast.AST]:
    """Miss by one: the ends of a range, of a slice, an index, an order."""
    match node:
        case ast.Call(args=[stop]) if _called(node) == "range":
            yield _with(node, args=[_shifted(stop, -1)])
            yield _with(node, args=[ast.Constant(1), stop])
        case ast.Call(args=[start, stop, *step]) if _called(node) == "range":
            yield _with(node, args=[start, _shifted(stop, -1), *step])
            yield _with(node, args=[_shifted(start, 1), stop, *step])
        case ast.Slice(lower=lower, upper=upper):
            if lower is not None:
                yield _with(node, lower=_shifted(lower, 1))
            if upper is not None:
                yield _with(node, upper=_shifted(upper, -1))
        case ast.Subscript(slice=ast.Constant(value=int(index))) if not isinstance(index, bool):
            yield _with(node, slice=_number(_neighbour(index)))
        case ast.Subscript(slice=ast.Tuple(elts=indices)):
            for place, index in enumerate(indices):
                if isinstance(index, ast.Constant) and _is_integer(index):
                    moved = [*indices[:place], _number(_neighbour(index.value)), *indices[place + 1 :]]
                    yield _with(node, slice=_with(node.slice, elts=moved))
        case ast.keyword(arg=name, value=ast.Constant() as value) if name in ORDERS and _is_integer(value):
            yield _with(node, value=_number(_neighbour(value.value)))


def boundary(node: ast.AST) -> Iterator[ast.AST]:
    """Exchange min and max, less and at most, more and at least; leave a `not` out."""
    match node:
        case ast.Compare(ops=[relation]) if type(relation) in RELATIONS:
            yield _with(node, ops=[RELATIONS[type(relation)]()])
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield operand
        case ast.Call(func=ast.Name(id=name)) if name in EXCHANGED:
            yield _with(node, func=ast.Name(EXCHANGED[name], ast.Load()))
        case ast.Call(func=ast.Attribute(attr=name)) if name in EXCHANGED:
            yield _with(node, func=_with(node.func, attr=EXCHANGED[name]))


RULES: dict[str, Rule] = {
    "sign": sign,
    "factor": factor,
    "quotient": quotient,
    "transposed": transposed,
    "dropped term": dropped_term,
    "arguments": arguments,
    "off by one": off_by_one,
    "boundary": boundary,
}


def _with(node: ast.AST, **fields: object) -> ast.AST:
    """Return a shallow copy of a node with other fields."""
    changed = copy.copy(node)
    for name, value in fields.items():
        setattr(changed, name, value)
    return changed


def _called(node: ast.Call) -> str:
    match node.func:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case _:
            return ""


def _is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)


def _is_integer(node: ast.Constant) -> bool:
    return isinstance(node.value, int) and not isinstance(node.value, bool)


def _is_sum(node: ast.AST) -> bool:
    """Return True if a node is a sum, whose terms are changed one by one."""
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub)


def _is_index(node: ast.AST) -> bool:
    """Return True if a node is one index: no slice, no ellipsis, no new axis."""
    return not isinstance(node, ast.Slice | ast.Starred) and not (
        isinstance(node, ast.Constant) and not isinstance(node.value, int)
    )


def _number(value: float) -> ast.expr:
    return ast.Constant(value) if value >= 0 else ast.UnaryOp(ast.USub(), ast.Constant(-value))


def _doubled_and_halved(value: float) -> Iterator[float]:
    if value:
        yield 2 * value
        half = value / 2
        yield int(half) if isinstance(value, int) and half == int(half) else half


def _times(by: float, part: ast.expr) -> ast.expr:
    return ast.BinOp(ast.Constant(by), ast.Mult(), part)


def _shifted(node: ast.expr, by: int) -> ast.expr:
    if isinstance(node, ast.Constant) and _is_integer(node):
        return _number(node.value + by)
    return ast.BinOp(node, ast.Add() if by > 0 else ast.Sub(), ast.Constant(abs(by)))


def _neighbour(index: int) -> int:
    return index - 1 if index > 0 else index + 1


def _exchanged_letters(formula: str) -> Iterator[str]:
    """Yield a formula of einsum with the last two letters of one operand exchanged."""
    inputs, arrow, output = formula.partition("->")
    operands = inputs.split(",")
    for place, letters in enumerate(operands):
        if len(letters) > 1 and letters[-2:].isalpha() and letters[-1] != letters[-2]:
            swapped = [*operands[:place], letters[:-2] + letters[-1] + letters[-2], *operands[place + 1 :]]
            yield ",".join(swapped) + arrow + output
