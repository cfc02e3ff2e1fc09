"""A section on springs."""

from __future__ import annotations

import pandas as pd

from shellbench.report.data.columns import Column
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.section import Section
from shellbench.report.data.table import Table


def section(found: Evidence) -> Section | None:
    rows = [row for row in found.rows if row.solver == "hooke"]
    if not rows:
        return None
    data = pd.DataFrame({"case": [row.case for row in rows], "extension": [f"{row.value:g} m" for row in rows]})
    columns = tuple(
        Column(name.title(), lambda line, to, name=name: line[name], right=False) for name in ("case", "extension")
    )
    table = Table("springs", "Springs", "How far they go.", data.assign(block=""), columns)
    return Section("springs", "Springs", ("Springs go as far as Hooke says.",), (table,))
