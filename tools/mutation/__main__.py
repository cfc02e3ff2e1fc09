"""The command line: examine mutants, print scores and survivors."""

from __future__ import annotations

import argparse
import math
import sys
from functools import partial
from pathlib import Path


def main() -> None:
    from tools.mutation.report import add, words
    from tools.mutation.schedule import examined
    from tools.mutation.targets import ALL_KINDS, TARGETS

    parser = argparse.ArgumentParser(prog="python -m tools.mutation", description=__doc__)
    parser.add_argument("--target", "--solver", action="append", choices=sorted(TARGETS), help="all unless given")
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    parser.add_argument("--count", type=int, default=100, help="mutants of each target")
    parser.add_argument(
        "--kind", action="append", choices=ALL_KINDS, help="of what mutants are drawn, all unless given"
    )
    parser.add_argument("--longest", type=float, default=10.0, help="seconds of the longest case that is asked")
    parser.add_argument("--patience", type=float, default=math.inf, help="seconds of the longest exam of one mutant")
    parser.add_argument("--case", action="append", default=[], help="ask these alone, or SOLVER:CASE")
    parser.add_argument("--processes", type=int, default=2, help="beside each other, one thread each")
    parser.add_argument("--unseen", action="store_true", help="put the scores into references/exam_score.json")
    parser.add_argument("--store", type=Path, default=Path("reports/mutation"), help="folder of what is kept")
    chosen = parser.parse_args()
    say = partial(print, file=sys.stderr, flush=True)
    limits = chosen.longest, chosen.patience, chosen.case, chosen.processes
    for name in chosen.target or TARGETS:
        run = examined(TARGETS[name], chosen.seed, chosen.count, chosen.kind or ALL_KINDS, chosen.store, *limits, say)
        print(words(run))
        if chosen.unseen:
            add(run)


if __name__ == "__main__":
    main()
