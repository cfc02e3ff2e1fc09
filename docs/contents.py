"""Hook of the site: the cases are the third entry of the contents, and each finding says how to cite it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PLACE, ENTRY = 2, {"The cases": "cases/index.md"}  # after "Start" and "Use it"
FINDINGS = "Findings"
CITE = """

---

**To cite this finding:** {authors}, *{title}*, in shellbench {version}, exam {exam}, `docs/{page}`, {year}.
"""


def on_config(config: Any) -> Any:
    """Add the index of the cases to the contents, if `python docs/cases.py` has built it."""
    if (Path(config["docs_dir"]) / ENTRY["The cases"]).is_file():
        config["nav"].insert(PLACE, ENTRY)
    return config


def on_page_markdown(markdown: str, page: Any, **rest: Any) -> str:
    """Say below a finding how to cite it, with the versions of the package and of the exam."""
    if page.parent is None or page.parent.title != FINDINGS or page.is_index:
        return markdown
    said = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    facts = {
        name: re.search(pattern, said, re.MULTILINE)[1]
        for name, pattern in (
            ("authors", r'^ {2}- name: "(.*)"'),
            ("version", r"^version: (\S+)"),
            ("year", r"^date-released: (\d+)"),
        )
    }
    exam = json.loads((ROOT / "references/lock.json").read_bytes())["version"]
    title = re.search(r"^# (.*)$", markdown, re.MULTILINE)[1]
    return markdown + CITE.format(title=title, exam=exam, page=page.file.src_uri, **facts)
