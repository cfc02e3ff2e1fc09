"""shellbench: validation and benchmarks for thin-shell solvers, neural and classical.

`shellbench.run` solves cases, `shellbench.table` returns earlier runs, and `shellbench.judge` compares results of other
programs with known values: each returns a pandas DataFrame.
`shellbench.case`, `shellbench.solve` and `shellbench.picture` return one case, its answer, and its picture; see
`shellbench.interface`, which is imported at the first use of one of them.
"""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

ASKED = ("Picture", "case", "judge", "picture", "run", "solve", "table")
__all__ = ["__version__", *ASKED]

try:
    __version__ = version("shellbench")
except PackageNotFoundError:  # a source tree that was never installed
    __version__ = "0+unknown"


def __getattr__(name: str) -> Any:
    if name in ASKED:
        # The name is computed, so that this module is no part of the code whose digest a record keeps.
        return getattr(import_module(f"{__name__}.interface"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
