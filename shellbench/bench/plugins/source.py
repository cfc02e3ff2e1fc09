"""The digest of a solver's source: old records stay valid as long as it is unchanged.

It includes the module and, recursively, all its imports from its own top-level package and from shellbench (the import
closure). The closure is found by reading the source, not by running it. Only the statements count, in any order and
place. Comments, docstrings, imports and blank lines do not count, so that edits of them keep the records of long
trainings. Data files that a package reads do not count either; a plug-in that changes them changes its version.
"""

from __future__ import annotations

import ast
import hashlib
import io
import sys
import tokenize
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from shellbench.disk import Look, is_settled, look_up, read_cache, write_cache
from shellbench.errors import InputError

IMPORTERS = ("import_module", "__import__")  # functions that import a module by its name
TO_BE_LOOKED_INTO = ("#", '"""', "'''", "\\")  # signs in a line of a comment, or of a string over several lines
OWN = __name__.partition(".")[0]
SUITES = ("body", "handlers", "orelse", "finalbody", "cases")  # fields of a statement that hold statements
IMPORTS = (ast.Import, ast.ImportFrom)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def source_digest(modules: Iterable[str], *more: str) -> str:
    """Return the hexadecimal SHA-256 of the statements in the import closures of modules, and of any more text.

    The statements are those of the top level, sorted, each counted once, without the names of their modules. Moving
    code or renaming a module therefore keeps the digest. Exchanging two definitions of one name between two modules
    also keeps it; a digest without names of modules can't detect this.

    Raises
    ------
    InputError
        If the source of one of `modules` can't be found.
    """
    modules = tuple(modules)
    what = (*((name, locate(name)) for name in modules), *more)
    known = _DIGESTS.get(what) or _Digest.kept(what)
    if known and known.holds:
        _DIGESTS[what] = known
        return known.digest
    closure = import_closure(*modules)
    places = {str(place): look_up(place) for path in closure.values() for place in (path, path.parent)}
    places[__file__] = look_up(Path(__file__))  # version of the digest's definition
    statements = {text for name, path in closure.items() for text in _looked_at(path, _package(name, path)).statements}
    lengths_and_texts = (f"{len(text)}\n{text}" for text in sorted(statements))
    digest = hashlib.sha256("\n".join([*lengths_and_texts, *more]).encode("utf-8", "surrogatepass")).hexdigest()
    _DIGESTS[what] = _Digest(digest, places)
    _DIGESTS[what].keep(what)
    return digest


@dataclass(frozen=True)
class _Digest:
    """A digest, with marks of its files and their folders from before they were read.

    It is stored for later processes in the user's cache.
    """

    digest: str
    places: dict[str, Look | None]

    @property
    def holds(self) -> bool:
        """Return True if no file has been changed, added or removed since."""
        return bool(self.places) and all(look_up(Path(path)) == seen for path, seen in self.places.items())

    @classmethod
    def kept(cls, what: tuple[object, ...]) -> _Digest | None:
        """Return the digest that an earlier process has stored; None if none can be read."""
        match read_cache(_cached_as(what)):
            case {"digest": str(digest), "places": dict(places)}:
                return cls(digest, {path: tuple(s) if isinstance(s, list) else None for path, s in places.items()})
        return None

    def keep(self, what: tuple[object, ...]) -> None:
        """Store the digest, unless a file is so new that its next change may have the same time."""
        if all(map(is_settled, self.places.values())):
            write_cache(_cached_as(what), {"digest": self.digest, "places": self.places})


def _cached_as(what: tuple[object, ...]) -> str:
    # shellbench may have another path for the same plug-in, and each version of Python has its own parser
    key = repr((what, locate(OWN), sys.version))
    return f"sources/{hashlib.sha256(key.encode('utf-8', 'surrogatepass')).hexdigest()}.json"


_DIGESTS: dict[tuple[object, ...], _Digest] = {}  # by modules, where they are, and any more text


def import_closure(*modules: str) -> dict[str, Path]:
    """Return modules, their parent packages and all that they import from their own package or ours, by name."""
    closure: dict[str, Path] = {}
    waiting, seen = list(modules), set[str]()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        path = locate(name)
        if path is None:
            if name in modules:
                raise InputError(f"the source of module '{name}' can't be found")
            continue
        closure[name] = path
        within = (name.partition(".")[0], OWN)
        waiting.append(name.rpartition(".")[0] or name)
        waiting.extend(n for n in _looked_at(path, _package(name, path)).imports if n.partition(".")[0] in within)
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
        if not stem.parent.is_dir():  # a name that is imported from a module: no module
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
    """The parts of a file that count: its statements, and names that may be modules."""

    statements: tuple[str, ...]
    imports: tuple[str, ...] = ()


_SEEN: dict[tuple[str, str, int, int, int, int], _File] = {}  # by path, package, number, changes in ns, and bytes


def _looked_at(path: Path, package: str) -> _File:
    status = path.stat()
    key = (str(path), package, status.st_ino, status.st_ctime_ns, status.st_mtime_ns, status.st_size)
    if key not in _SEEN:
        _SEEN[key] = _look_at(path, package)
    return _SEEN[key]


def _look_at(path: Path, package: str) -> _File:
    data = path.read_bytes()
    if path.suffix != ".py":
        return _File((hashlib.sha256(data).hexdigest(),))
    source, tree = data.decode("utf-8"), ast.parse(data)
    by_name = any(name in source for name in IMPORTERS)
    statements = [*_statements_of(source, tree), *_foreign(tree, package.partition(".")[0])]
    return _File(tuple(statements), tuple(dict.fromkeys(_imported(tree, package, by_name))))


def _foreign(tree: ast.Module, top: str) -> Iterator[str]:
    """Yield the imports from other distributions, because `solve` of SciPy is not that of NumPy.

    The place of the import does not matter.
    """
    for node in _statements(tree):
        if isinstance(node, ast.Import):
            names = [(alias.name, alias.asname or alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names = [(f"{node.module}.{alias.name}", alias.asname or alias.name) for alias in node.names]
        else:
            continue
        for name, known_as in names:
            if name.partition(".")[0] not in (top, OWN, *sys.stdlib_module_names):
                yield f"import {name} as {known_as}"


def statements_of(source: str) -> list[str]:
    """Return the statements of a module: without imports, comments, docstrings, blank lines and trailing blanks.

    `__all__` and statements for types only do not count as code either.
    """
    return list(_statements_of(source, ast.parse(source)))


def _statements_of(source: str, tree: ast.Module) -> Iterator[str]:
    """Yield what `statements_of` returns.

    Only statements that may have comments or strings over several lines are tokenized, because Python's tokenizer takes
    most of the time.
    """
    lines = source.splitlines()
    for row in list(_rows_that_do_not_compute(lines, tree)):
        lines[row - 1] = ""
    for first, last in _rows_of_statements(tree):
        text = lines[first - 1 : last]
        verbatim: set[int] = set()  # rows of strings that go over several lines: blanks count there
        if any(sign in line for line in text for sign in TO_BE_LOOKED_INTO):
            verbatim = _strip_comments(text)
        stripped = (line if row in verbatim else line.rstrip() for row, line in enumerate(text, start=1))
        kept = [line for row, line in enumerate(stripped, start=1) if line or row in verbatim]
        if kept:
            yield "\n".join(kept)


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
    """Remove the comments from rows of whole statements; return the rows, from one, of strings over several lines."""
    verbatim: set[int] = set()
    text = "".join(f"{line}\n" for line in lines)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        (row, column), (last, _) = token.start, token.end
        if token.type == tokenize.COMMENT:
            lines[row - 1] = lines[row - 1][:column]
        elif last > row:
            verbatim |= set(range(row, last + 1))
    return verbatim


def _rows_that_do_not_compute(lines: list[str], tree: ast.Module) -> Iterator[int]:
    """Yield the rows of docstrings and imports that share theirs with no other code."""
    for node in _statements(tree):
        text: ast.AST = node
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            text = node.body[0]
        elif not (isinstance(node, IMPORTS) or _says_nothing(node)):
            continue
        if isinstance(text, ast.stmt):
            last = text.end_lineno or text.lineno
            before = lines[text.lineno - 1].encode()[: text.col_offset].decode().strip()
            after = lines[last - 1].encode()[text.end_col_offset or 0 :].decode().strip()
            if not before and (not after or after.startswith("#")):
                yield from range(text.lineno, last + 1)


def _says_nothing(node: ast.AST) -> bool:
    """Return True if a statement is for types only, or assigns `__all__`."""
    if isinstance(node, ast.If):
        return _for_types(node) and not node.orelse
    return isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets)


def _for_types(node: ast.If) -> bool:
    match node.test:
        case ast.Name(id="TYPE_CHECKING") | ast.Attribute(value=ast.Name(id="typing"), attr="TYPE_CHECKING"):
            return True
    return False


def _blocks(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the statements, handlers and cases of a statement, without expressions, which are most of a tree."""
    for name in SUITES:
        yield from getattr(node, name, ())


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a module or statement and all statements in it."""
    yield node
    for child in _blocks(node):
        yield from _statements(child)


def _imported(tree: ast.AST, package: str, by_name: bool) -> Iterator[str]:
    """Yield names that may be modules: a name of `from p import n` may be one, or an attribute of p.

    `by_name` looks into expressions as well, for calls that import a module.
    """
    for node in ast.iter_child_nodes(tree) if by_name else _blocks(tree):
        if isinstance(node, ast.If) and _for_types(node):
            yield from _imported(ast.Module(node.orelse, []), package, by_name)
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
