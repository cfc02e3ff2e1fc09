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
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from shellbench.errors import InputError

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
    lines = [f"{name} {_digest_of_file(path, *_stamp(path))}" for name, path in sorted(closure.items())]
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
        if path.suffix == ".py":
            package = name if path.name == "__init__.py" else name.rpartition(".")[0]
            top = module.partition(".")[0]
            found = _imports_of(path, package, *_stamp(path))
            waiting.extend(n for n in found if n.partition(".")[0] == top)
    return closure


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
        compiled = sorted(stem.parent.glob(f"{stem.name}.*.so"))
        for path in (stem / "__init__.py", stem.with_name(stem.name + ".py"), *compiled):
            if path.is_file():
                return path
    return None


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_mtime_ns, status.st_size


@lru_cache(maxsize=4096)
def _digest_of_file(path: Path, changed: int, size: int) -> str:
    data = path.read_bytes()
    if path.suffix == ".py":
        data = code_only(data.decode("utf-8")).encode()
    return hashlib.sha256(data).hexdigest()


def code_only(source: str) -> str:
    """Return Python source without comments, docstrings, blank lines and trailing blanks."""
    lines = source.splitlines()
    verbatim: set[int] = set()  # rows of strings that go over several lines: blanks count there
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        (row, column), (last, _) = token.start, token.end
        if token.type == tokenize.COMMENT:
            lines[row - 1] = lines[row - 1][:column]
        elif last > row:
            verbatim |= set(range(row, last + 1))
    for row in _docstring_rows(source):
        lines[row - 1] = ""
        verbatim.discard(row)
    kept = (line if row in verbatim else line.rstrip() for row, line in enumerate(lines, start=1))
    return "\n".join(line for row, line in enumerate(kept, start=1) if line or row in verbatim)


def _docstring_rows(source: str) -> Iterator[int]:
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            text = node.body[0]
            last = text.end_lineno or text.lineno
            alone = lines[text.lineno - 1].lstrip()[:1] in {'"', "'", "r", "R"}
            ends = lines[last - 1].encode()[text.end_col_offset or 0 :].decode().strip()
            if alone and (not ends or ends.startswith("#")):
                yield from range(text.lineno, last + 1)


@lru_cache(maxsize=4096)
def _imports_of(path: Path, package: str, changed: int, size: int) -> tuple[str, ...]:
    return tuple(dict.fromkeys(_imported(ast.parse(path.read_bytes()), package)))


def _imported(tree: ast.AST, package: str) -> Iterator[str]:
    """Yield names that may be modules: a name of `from p import n` may be one, or an attribute of p."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            for other in node.orelse:
                yield from _imported(other, package)
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = _absolute(node, package)
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and _called(node) in {"import_module", "__import__"}:
            yield from (str(a.value) for a in node.args[:1] if isinstance(a, ast.Constant))
        yield from _imported(node, package)


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
