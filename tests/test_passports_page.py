"""The page of passports is the one that its script makes of the kept figures."""

import json

from docs import passports


def test_the_page_is_that_of_the_kept_figures():
    made = passports.page(json.loads(passports.KEPT.read_text(encoding="utf-8")))
    assert passports.PAGE.read_text(encoding="utf-8") == made, "write it anew by `python docs/passports.py`"
