"""The pytest plug-in: ``pytest --shellbench=SUITE --shellbench-solver=NAME`` gates a solver on a suite of cases.

If shellbench is installed, every run of pytest imports this module. It therefore imports only pytest, and without the
option it only declares the options. `shellbench.testing.pytest_gate` does the work.
"""

from __future__ import annotations

import pytest

SUITE = "shellbench"
SOLVER = "shellbench_solver"
TOLERANCE = "shellbench_tolerance"
SETTING = "shellbench_set"
STORE = "shellbench_store"
TIMEOUT = "shellbench_timeout"
MARKER = "shellbench: an item that judges a solver by a known value"

REPEATABLE = {
    SUITE: ("SUITE", "gate solvers on the cases of this suite; may be repeated"),
    SOLVER: ("NAME", "solver to gate, by the name that it is registered under; may be repeated"),
    TOLERANCE: (
        "[CASE[.QUANTITY]=]TOL",
        "error allowed where shellbench freezes no tolerance for the solver, relative unless the quantity's is absolute"
        " (default: 1e-2); may be repeated, for a case or a quantity",
    ),
    SETTING: ("SOLVER.KEY=VALUE", "a setting of a solver, its value in TOML; may be repeated"),
}
SINGLE = {
    STORE: ("DIR", "folder in which finished runs are kept (default: in pytest's cache)"),
    TIMEOUT: ("S", "stop a run, that run only, after so many seconds"),
}


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare the options, which can also stand in the configuration file."""
    group = parser.getgroup("shellbench", "shell solvers held against known values")
    for name, (metavar, words) in REPEATABLE.items():
        group.addoption(_flag(name), action="append", dest=name, metavar=metavar, help=words)
        parser.addini(name, words, type="args")
    for name, (metavar, words) in SINGLE.items():
        group.addoption(_flag(name), dest=name, metavar=metavar, help=words)
        parser.addini(name, words)


def pytest_configure(config: pytest.Config) -> None:
    """Register the gate if a suite is named.

    Raises
    ------
    pytest.UsageError
        In one sentence, if the options are inconsistent or name something unknown.
    """
    config.addinivalue_line("markers", MARKER)
    if not _values(config, SUITE):
        for name in (*REPEATABLE, *SINGLE):
            if config.getoption(name):
                raise pytest.UsageError(f"{_flag(name)} says nothing without {_flag(SUITE)}=SUITE")
        return
    from shellbench.testing.pytest_gate import Gate, GateOptions

    options = GateOptions.checked(
        config,
        suites=_values(config, SUITE),
        solvers=_values(config, SOLVER),
        tolerances=_values(config, TOLERANCE),
        settings=_values(config, SETTING),
        store=_value(config, STORE),
        timeout=_value(config, TIMEOUT),
    )
    config.pluginmanager.register(Gate(config, options), "shellbench-gate")


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")


def _values(config: pytest.Config, name: str) -> tuple[str, ...]:
    """Return the values of an option on the command line, or else in the configuration file, each once."""
    given = config.getoption(name) or config.getini(name) or ()
    return tuple(dict.fromkeys(map(str, given)))


def _value(config: pytest.Config, name: str) -> str | None:
    return config.getoption(name) or str(config.getini(name) or "") or None
