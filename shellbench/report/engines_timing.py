"""Whether the seconds of runs may be set against each other: taken on one core, by one command, in one environment."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise

from shellbench.bench.record import Record

TOGETHER = 60.0  # seconds between runs that one command planned: a plan of hundreds of runs takes a few


def why_incomparable(records: Sequence[Record]) -> str | None:
    """Say why ratios of the runs' seconds would mislead, as the end of a sentence; None if they would not.

    A record carries the time at which its run was planned; all runs of one command are planned together. It does not
    say how many runs the command made at a time, nor what else the machine did.
    """
    found = [record.environment for record in records]
    machines = list(dict.fromkeys(f"{one.processor}, {one.cores} cores, {one.platform}" for one in found))
    if len(machines) > 1:
        return f"they were taken on different machines ({'; '.join(machines)})"
    if len({one.gpu for one in found}) > 1 or len({record.identity.device for record in records}) > 1:
        return "some were taken on a GPU and some were not"
    threads = sorted({one.threads for one in found})
    if threads and threads != [1]:
        return f"they were taken with {' and '.join(map(str, threads))} threads, not with one"
    if len({one.python for one in found}) > 1:
        return f"they were taken by different versions of Python ({', '.join(sorted({one.python for one in found}))})"
    if package := _differing(records):
        return f"they were taken with different versions of {package}"
    commands = planned_apart(records)
    if len(commands) > 1:
        return f"they were taken by {len(commands)} commands, planned at {' and '.join(commands)}"
    return None


def planned_apart(records: Sequence[Record]) -> list[str]:
    """Return when each command planned its first of the runs, to the second."""
    times = sorted({record.created for record in records}, key=_instant)
    later = [after for before, after in pairwise(times) if _instant(after) - _instant(before) > TOGETHER]
    return [datetime.fromisoformat(time).strftime("%Y-%m-%d %H:%M:%S") for time in (*times[:1], *later)]


def _instant(created: str) -> float:
    return datetime.fromisoformat(created).timestamp()


def _differing(records: Sequence[Record]) -> str | None:
    """Return a package of which two runs name different versions; not all runs name an engine or a plug-in."""
    named: dict[str, str] = {}
    for record in records:
        for package, version in record.environment.versions.items():
            if named.setdefault(package, version) != version:
                return package
    return None
