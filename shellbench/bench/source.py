"""The digest of a solver's source: what must change for an old record not to answer any more.

It is taken over the module, over all that it imports from its own top-level package, and so on (the import
closure), found by reading the source and not by running it. Comments, docstrings and blank lines do not count:
hours of training survive a better sentence. Data files that a package reads do not count either; a plug-in
that changes them changes its version.
"""

from __future__ import annotations

import ast
import hashlib
import io
import tokenize
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from shellbench.errors import InputError

IMPORTERS = ("import_module", "__import__")  # functions that import a module by its name
TO_BE_LOOKED_INTO = ("#", '"""', "'''", "\\")  # of a line: there may be a comment, or a string over several lines
BLOCKS = (ast.stmt, ast.excepthandler, ast.match_case)  # what has statements, or is one
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def source_digest(modules: Iterable[str], *more: str) -> str:
    """Return the hexadecimal SHA-256 of the import closures of modules, and of any more text.

    Raises
    ------
    InputError
        If the source of one of `modules` can't be found.
    """
    closure: dict[str, Path] = {}
    for module in modules:
        closure |= import_closure(module)
    lines = [f"{name} {_looked_at(path, _package(name, path)).digest}" for name, path in sorted(closure.items())]
    return hashlib.sha256("\n".join([*lines, *more]).encode()).hexdigest()


def import_closure(module: str) -> dict[str, Path]:
    """Return a module, its parent packages and all that they import from their own top-level package, by name."""
    if locate(module) is None:
        raise InputError(f"the source of module '{module}' can't be found")
    closure: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = locate(name)
        if name in closure or path is None:
            continue
        closure[name] = path
        waiting.append(name.rpartition(".")[0] or name)
        top = module.partition(".")[0]
        waiting.extend(n for n in _looked_at(path, _package(name, path)).imports if n.partition(".")[0] == top)
    return closure


def _package(module: str, path: Path) -> str:
    return module if path.name == "__init__.py" else module.rpartition(".")[0]


def locate(module: str) -> Path | None:
    """Return the file of a module without importing it or its parents; None if there is none."""
    top, *rest = module.split(".")
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):
        return None
    if spec is None:
        return None
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]
    if not rest:
        return Path(spec.origin) if spec.origin and Path(spec.origin).is_file() else None
    for folder in folders:
        stem = folder.joinpath(*rest)
        if not stem.parent.is_dir():  # what is imported from a module: no module
            continue
        for path in (stem / "__init__.py", stem.with_name(stem.name + ".py")):
            if path.is_file():
                return path
        compiled = sorted(path for path in stem.parent.glob(f"{stem.name}.*.so") if path.is_file())
        if compiled:
            return compiled[0]
    return None


@dataclass(frozen=True)
class _File:
    """What is taken from a file: the digest of its code, and names that may be modules."""

    digest: str
    imports: tuple[str, ...] = ()


def _looked_at(path: Path, package: str) -> _File:
    status = path.stat()
    return _look_at(path, package, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=4096)
def _look_at(path: Path, package: str, changed: int, size: int) -> _File:
    data = path.read_bytes()
    if path.suffix != ".py":
        return _File(hashlib.sha256(data).hexdigest())
    source, tree = data.decode("utf-8"), ast.parse(data)
    digest = hashlib.sha256(_code_of(source, tree).encode()).hexdigest()
    by_name = any(name in source for name in IMPORTERS)
    return _File(digest, tuple(dict.fromkeys(_imported(tree, package, by_name))))


def code_only(source: str) -> str:
    """Return Python source without comments, docstrings, blank lines and trailing blanks."""
    return _code_of(source, ast.parse(source))


def _code_of(source: str, tree: ast.Module) -> str:
    """Return the code of `code_only`.

    Tokens are looked at in those statements of the module only that may have comments or strings over several lines:
    Python's tokenizer takes longer than all else.
    """
    lines = source.splitlines()
    for row in list(_docstring_rows(lines, tree)):
        lines[row - 1] = ""
    verbatim: set[int] = set()  # rows of strings that go over several lines: blanks count there
    end = 0
    for first, last in _rows_of_statements(tree):
        for row in range(end + 1, first):
            lines[row - 1] = ""  # between statements there are comments only
        end = max(end, last)
        text = lines[first - 1 : last]
        if any(sign in line for line in text for sign in TO_BE_LOOKED_INTO):
            verbatim |= {first - 1 + row for row in _strip_comments(text)}
            lines[first - 1 : last] = text
    rows = range(1, end + 1)
    stripped = (lines[row - 1] if row in verbatim else lines[row - 1].rstrip() for row in rows)
    return "\n".join(line for row, line in zip(rows, stripped, strict=True) if line or row in verbatim)


def _rows_of_statements(tree: ast.Module) -> Iterator[tuple[int, int]]:
    """Yield first and last row of each statement of a module, decorators included; those that share a row are one."""
    first, last = 0, -1
    for node in tree.body:
        begin = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", ()))])
        if begin > last and last > 0:
            yield first, last
        if begin > last:
            first = begin
        last = max(last, node.end_lineno or node.lineno)
    if last > 0:
        yield first, last


def _strip_comments(lines: list[str]) -> set[int]:
    """Take the comments out of rows of whole statements; return the rows, from one, of strings over several lines."""
    verbatim: set[int] = set()
    text = "".join(f"{line}\n" for line in lines)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        (row, column), (last, _) = token.start, token.end
        if token.type == tokenize.COMMENT:
            lines[row - 1] = lines[row - 1][:column]
        elif last > row:
            verbatim |= set(range(row, last + 1))
    return verbatim


def _docstring_rows(lines: list[str], tree: ast.Module) -> Iterator[int]:
    for node in _statements(tree):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            text = node.body[0]
            last = text.end_lineno or text.lineno
            alone = lines[text.lineno - 1].lstrip()[:1] in {'"', "'", "r", "R"}
            ends = lines[last - 1].encode()[text.end_col_offset or 0 :].decode().strip()
            if alone and (not ends or ends.startswith("#")):
                yield from range(text.lineno, last + 1)


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a module or statement and all statements in it."""
    yield node
    for child in ast.iter_child_nodes(node):
        if isinstance(child, BLOCKS):
            yield from _statements(child)


def _imported(tree: ast.AST, package: str, by_name: bool) -> Iterator[str]:
    """Yield names that may be modules: a name of `from p import n` may be one, or an attribute of p.

    `by_name` looks into expressions as well, for calls that import a module.
    """
    for node in ast.iter_child_nodes(tree):
        if not (by_name or isinstance(node, BLOCKS)):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            for other in node.orelse:
                yield from _imported(other, package, by_name)
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = _absolute(node, package)
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and _called(node) in IMPORTERS:
            yield from (str(a.value) for a in node.args[:1] if isinstance(a, ast.Constant))
        yield from _imported(node, package, by_name)


def _called(node: ast.Call) -> str:
    match node.func:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case _:
            return ""


def _absolute(node: ast.ImportFrom, package: str) -> str:
    if not node.level:
        return node.module or ""
    parent = package.split(".")[: len(package.split(".")) - node.level + 1]
    return ".".join([*parent, *([node.module] if node.module else [])])
