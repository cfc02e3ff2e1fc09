"""Suggestions for misspelt names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LIKE = 0.6  # least similarity of two names, as in `difflib`
MOST_OFFERED = 3  # largest number of suggestions


def nearest(name: str, names: Iterable[str]) -> list[str]:
    """Return the names that are most similar to a typed one, the nearest first; none if no name is similar.

    A name that contains the typed one, or begins like it, is near, even if it is much longer.
    """
    known, typed = list(dict.fromkeys(names)), name.lower().replace("-", "_")
    within = [one for one in known if len(typed) > 2 and typed in one.lower().replace("-", "_")]
    like = difflib.get_close_matches(name, known, n=MOST_OFFERED, cutoff=LIKE)
    return list(dict.fromkeys([*like, *sorted(within, key=len)]))[:MOST_OFFERED]


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Return a suggestion such as ``, did you mean 'fem'?`` to append to a name; empty if no name is near."""
    near = nearest(name, names)
    return f" (did you mean {' or '.join(near)}?)" if near else ""
