"""shellbench: validation and benchmarks for thin-shell solvers, neural and classical."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("shellbench")
except PackageNotFoundError:  # a source tree that was never installed
    __version__ = "0+unknown"
