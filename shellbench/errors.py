"""Errors of shellbench, each with the exit code of the command line."""

from __future__ import annotations

from typing import Any

LONGEST_QUOTE = 200  # characters of a found value in a sentence


def without_middle(text: str, most: int = LONGEST_QUOTE) -> str:
    """Return a text for a quotation in a sentence: without its middle if it is too long."""
    end = most // 3
    return text if len(text) <= most else f"{text[: most - end - 3]}...{text[-end:]}"


class ShellbenchError(Exception):
    """An error that is reported as one sentence, never as a traceback."""

    exit_code = 1


class InputError(ShellbenchError, ValueError):
    """Bad input or usage: a malformed case, an unknown solver, a setting out of range."""

    exit_code = 2


class PluginError(ShellbenchError):
    """Code of another package ended, hung or returned invalid data."""


class Interrupted(ShellbenchError):
    """The user, or a signal, ended a command."""

    exit_code = 130  # the shells' exit code of a program that Ctrl-C has ended


class SolveFailure(ShellbenchError):
    """A solve that ended without a trustworthy answer.

    Parameters
    ----------
    reason
        One sentence for the user.
    partial
        The converged part of the solution, if there is one.
    """

    def __init__(self, reason: str, partial: Any = None) -> None:
        super().__init__(reason)
        self.partial = partial
