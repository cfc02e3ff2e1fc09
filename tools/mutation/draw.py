"""All mutants of a target by the rules, and a sample of them that is the same on every machine."""

from __future__ import annotations

import ast
import copy
import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from tools.mutation.operators import RULES
from tools.mutation.targets import Part, file_of, kind_of, parts

SHOWN_DIGITS = 12  # of a mutant's name


@dataclass(frozen=True)
class Mutant:
    """One change of one expression.

    Attributes
    ----------
    module, line
        Place of the change.
    lines
        First and last line of the statement, or of its head.
    rule
        Name of the rule.
    old, new
        The expression before and after.
    statement, becomes
        The statement before and after: only its head if it has a body.
    number
        Among the mutants of the module with the same texts, for a statement may occur twice.
    place
        Numbers of the changed node among the module's nodes, and of the change among those of the rule.
    kind
        Kind of the function around it: see `targets.KINDS`.
    """

    module: str
    line: int
    lines: tuple[int, int]
    rule: str
    old: str
    new: str
    statement: str
    becomes: str
    number: int
    place: tuple[int, int]
    kind: str

    @property
    def name(self) -> str:
        """Name that does not depend on the statement's line."""
        text = "\n".join([self.module, self.rule, self.old, self.new, self.statement, self.becomes, str(self.number)])
        return hashlib.sha256(text.encode()).hexdigest()[:SHOWN_DIGITS]

    @property
    def key(self) -> tuple[str, str, str, str]:
        """Module, rule, statement and its new form."""
        return self.module, self.rule, self.statement, self.becomes


def mutants_of(module: str, source: str) -> list[Mutant]:
    """Return all mutants of a module's source, in the order of its text."""
    tree = ast.parse(source)
    found: list[Mutant] = []
    seen: Counter[tuple[str, ...]] = Counter()
    for place, (part, node) in enumerate(_nodes(tree)):
        kind = kind_of(module, part.function)
        before = _head(part.statement)
        for rule, change in RULES.items():
            for which, new in enumerate(change(node)):
                after = _head(_substituted(part.statement, node, new))
                texts = (rule, ast.unparse(node), ast.unparse(new), before, after)
                if before == after:
                    continue
                number = seen[texts]
                seen[texts] += 1
                line = getattr(node, "lineno", part.lines[0])
                found.append(Mutant(module, line, part.lines, *texts, number, (place, which), kind))
    return found


def mutated(source: str, mutant: Mutant) -> ast.Module:
    """Return the syntax tree of a module with one change; line numbers stay."""
    tree = ast.parse(source)
    place, which = mutant.place
    node = next(node for number, (_, node) in enumerate(_nodes(tree)) if number == place)
    new = list(RULES[mutant.rule](node))[which]
    if hasattr(node, "lineno"):
        new = ast.copy_location(new, node)
    return ast.fix_missing_locations(_substituted(tree, node, new))


def all_mutants(modules: Iterable[str]) -> list[Mutant]:
    """Return all mutants of modules of the source tree."""
    return [mutant for module in modules for mutant in mutants_of(module, file_of(module).read_text(encoding="utf-8"))]


def draw(mutants: Iterable[Mutant], seed: int, count: int) -> list[Mutant]:
    """Return `count` mutants, spread over modules first, over rules next, and over statements last.

    A hash draws: it is the same on every machine and for every version of Python.
    """
    waiting: dict[str, list[Mutant]] = {}
    for mutant in sorted(mutants, key=lambda m: _lot(seed, m.name)):
        waiting.setdefault(mutant.module, []).append(mutant)
    # Large modules get more, but not in proportion: by the square root of what they offer.
    share = {module: len(offered) ** 0.5 for module, offered in waiting.items()}
    taken: Counter[str] = Counter()
    rules: Counter[tuple[str, str]] = Counter()
    statements: Counter[tuple[str, str]] = Counter()
    drawn: list[Mutant] = []
    while waiting and len(drawn) < count:
        module = min(waiting, key=lambda m: ((taken[m] + 1) / share[m], _lot(seed, m)))
        offered = waiting[module]
        chosen = min(offered, key=lambda m: (statements[module, m.statement], rules[module, m.rule]))  # first by lot
        offered.remove(chosen)
        taken[module] += 1
        rules[module, chosen.rule] += 1
        statements[module, chosen.statement] += 1
        drawn.append(chosen)
        if not offered:
            del waiting[module]
    return drawn


def _lot(seed: int, name: str) -> str:
    return hashlib.sha256(f"{seed} {name}".encode()).hexdigest()


def _nodes(tree: ast.Module) -> Iterator[tuple[Part, ast.AST]]:
    for part in parts(tree):
        for node in part.expressions:
            yield part, node


def _head(statement: ast.stmt) -> str:
    """Return the text of a statement; of one with a body only its head."""
    shallow = copy.copy(statement)
    if hasattr(shallow, "body"):
        shallow.body = [ast.Pass()]
        if hasattr(shallow, "orelse"):
            shallow.orelse = []
        return ast.unparse(shallow).removesuffix("pass").strip()
    if isinstance(shallow, ast.Match):
        return f"match {ast.unparse(shallow.subject)}:"
    return ast.unparse(shallow)


def _substituted(tree: ast.AST, node: ast.AST, new: ast.AST) -> ast.AST:
    """Return a tree in which a new node stands in the place of one of its own; the tree itself stays as it is."""
    if tree is node:
        return new
    changed = copy.copy(tree)
    for name, value in ast.iter_fields(tree):
        if isinstance(value, ast.AST):
            setattr(changed, name, _substituted(value, node, new))
        elif isinstance(value, list):
            setattr(changed, name, [_substituted(v, node, new) if isinstance(v, ast.AST) else v for v in value])
    return changed
