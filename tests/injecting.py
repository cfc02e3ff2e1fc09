"""Faults are put into functions: their results or their arguments are changed as long as a test runs."""

from collections.abc import Callable
from typing import Any

import pytest


def wrapped(owner: Any, name: str, change: Callable) -> Callable[[pytest.MonkeyPatch], None]:
    """Replace a function by one that changes its result."""

    def inject(patch: pytest.MonkeyPatch) -> None:
        original = getattr(owner, name)
        patch.setattr(owner, name, lambda *args, **more: change(original(*args, **more)))

    return inject


def given(owner: Any, name: str, change: Callable) -> Callable[[pytest.MonkeyPatch], None]:
    """Replace a function by one that gets other arguments."""

    def inject(patch: pytest.MonkeyPatch) -> None:
        original = getattr(owner, name)
        patch.setattr(owner, name, lambda *args, **more: original(*change(*args), **more))

    return inject
