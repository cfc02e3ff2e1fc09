"""Commands that other packages add, by the entry-point group ``shellbench.commands``.

::

    [project.entry-points."shellbench.commands"]
    mine = "my_package.cli:command"

The entry point names a function for typer, or a `typer.Typer` with several. It is imported when it is called, and not
for ``--help``. A name of a built-in command can't be replaced.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from shellbench.errors import InputError, PluginError, ShellbenchError

GROUP = "shellbench.commands"


class _Untyped:
    """Shows flags and arguments in the help without their Python types, such as ``<bool>``."""

    def get_params(self, ctx: Any) -> Any:
        """Return the options and arguments of the command."""
        found = super().get_params(ctx)  # type: ignore[misc]
        for one in found:
            if getattr(one, "is_flag", True):  # an argument has no such attribute
                one.display_type_rich = lambda ctx: ""
        return found


class Command(_Untyped, TyperCommand):
    """A command of shellbench."""


class CommandsOfOthers(_Untyped, TyperGroup):
    """The built-in commands, followed by those of other packages."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        own = super().list_commands(ctx)
        return [*own, *(name for name in _packages() if name not in own)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a built-in command, or the stand-in of one of another package."""
        own = super().get_command(ctx, cmd_name)
        package = None if own else _packages().get(cmd_name)
        return TyperCommand(cmd_name, help=f"Of package {package}.") if package else own

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the called command; if it is another package's, import it now."""
        name, command, rest = super().resolve_command(ctx, args)
        if name is not None and super().get_command(ctx, name) is None:
            return name, _loaded(name), rest
        return name, command, rest


def _packages() -> dict[str, str]:
    """Return the package of each command, by name, sorted."""
    points = sorted(entry_points(group=GROUP), key=lambda point: point.name)
    return {point.name: str(point.dist.name) if point.dist else "?" for point in points}


def _loaded(name: str) -> Any:
    from shellbench.bench.plugins.registry import load, registered

    try:
        command = load(registered(GROUP, "command")[name], "command", _as_command)
    except SystemExit:
        raise InputError(f"command '{name}' can't be used: its import ends the process") from None
    command.name = name
    invoke = command.invoke

    def invoked(ctx: Any) -> Any:
        try:
            return invoke(ctx)
        except Exception as error:
            _one_sentence(name, error)

    command.invoke = invoked
    return command


def _as_command(found: Any) -> Any:
    if isinstance(found, typer.Typer):
        return typer.main.get_command(found)
    alone = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    alone.command()(found)
    return typer.main.get_command(alone)


def _one_sentence(name: str, error: Exception) -> NoReturn:
    """Turn the exceptions of a command into one sentence; its exits and errors of usage are unchanged."""
    # Typer's error of usage has no public name: it is the base class of the error of a bad parameter.
    passed = (ShellbenchError, typer.Exit, typer.Abort, typer.BadParameter.__base__)
    if isinstance(error, passed):  # type: ignore[arg-type]
        raise error
    said = " ".join(str(error).split())
    raise PluginError(f"command '{name}' failed: {type(error).__name__}{': ' if said else ''}{said}") from error
