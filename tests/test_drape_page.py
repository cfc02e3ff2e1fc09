"""The tables on the drape test are those that its script makes of the kept values."""

import json

from docs import drape


def test_the_tables_of_the_page_are_those_of_the_kept_values():
    kept, text = json.loads(drape.KEPT.read_text(encoding="utf-8")), drape.PAGE.read_text(encoding="utf-8")
    assert all(f"<!-- table {name} -->" in text for name in drape.TABLES)
    assert drape.page(kept, text) == text, "write them anew by `python docs/drape.py`"
