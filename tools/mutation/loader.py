"""A mutant takes the place of its module when that is imported; no file is written.

Digests and the lock are computed from files, so that a mutant runs under the identity of the original code.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Sequence
from importlib.abc import InspectLoader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from types import CodeType, ModuleType

from tools.mutation.draw import Mutant, mutated
from tools.mutation.targets import file_of


class MutantLoader(InspectLoader):
    """Loads a module from a syntax tree."""

    def __init__(self, module: str, tree: ast.Module) -> None:
        self.module, self.tree = module, tree

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.tree, str(file_of(self.module)), "exec")

    def get_source(self, fullname: str) -> str:
        return ast.unparse(self.tree)

    def is_package(self, fullname: str) -> bool:
        return False


class MutantFinder(MetaPathFinder):
    """Finds one module, the mutated one."""

    def __init__(self, module: str, tree: ast.Module) -> None:
        self.module, self.tree = module, tree

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self.module:
            return None
        spec = spec_from_loader(fullname, MutantLoader(fullname, self.tree), origin=str(file_of(fullname)))
        if spec is not None:
            spec.has_location = True
        return spec


def plant(mutant: Mutant) -> None:
    """Import a mutant in place of its module.

    Raises
    ------
    RuntimeError
        If the module has been imported already.
    """
    if mutant.module in sys.modules:
        raise RuntimeError(f"{mutant.module} has been imported already: the mutant would not count")
    source = file_of(mutant.module).read_text(encoding="utf-8")
    sys.meta_path.insert(0, MutantFinder(mutant.module, mutated(source, mutant)))
