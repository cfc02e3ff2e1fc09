"""Check the built site with axe-core: `python docs/accessibility.py [site] [--page NAME ...]`; `nox -s accessibility`.

Each page is opened in Chromium, as wide as a screen and as a phone, light and dark. It is checked by the rules of WCAG
2.1, levels A and AA, and axe's best practices. The script exits 1 if a rule is broken, and names the place. It starts a
file server, because the page "not found" takes its style and its scripts from the root.
"""

from __future__ import annotations

import argparse
import shutil
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, sync_playwright

VIEWS = tuple((width, scheme) for width in (1440, 390) for scheme in ("light", "dark"))
RULES = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"]}
WHERE = {"exclude": [[".md-code__nav"]]}  # the theme's buttons to copy code: a landmark each, all without a name
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
SHOWN = 3  # places that are named of a broken rule


class Quiet(SimpleHTTPRequestHandler):
    """Serves files without a log."""

    def log_message(self, format: str, *args: Any) -> None:
        """Write no log."""


@contextmanager
def served(site: Path) -> Iterator[str]:
    """Serve a folder on this machine only; yield its address."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site))) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def broken(browser: Browser, pages: list[str], address: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield page, view and rule for each broken rule."""
    axe = Axe()
    for width, scheme in VIEWS:
        with browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme) as context:
            tab = context.new_page()
            for page in pages:
                tab.goto(f"{address}/{page}")
                found = axe.run(tab, context=WHERE, options=RULES).response["violations"]
                yield from ((f"{page} at {width} pixels, {scheme}", rule) for rule in found)


def main() -> int:
    """Print the broken rules, and return the exit code."""
    parser = argparse.ArgumentParser(description="Ask axe-core about the built site.")
    parser.add_argument("site", nargs="?", type=Path, default=Path("site"))
    parser.add_argument("--page", action="append", help="such as findings/course.html; all if none")
    options = parser.parse_args()
    pages = options.page or sorted(path.relative_to(options.site).as_posix() for path in options.site.rglob("*.html"))
    installed = next(filter(None, map(shutil.which, BROWSERS)), None)
    with served(options.site) as address, sync_playwright() as play:
        browser = play.chromium.launch(executable_path=installed, args=["--no-sandbox"])
        found = list(broken(browser, pages, address))
    rules: dict[str, list[str]] = defaultdict(list)
    for where, rule in found:
        places = [str(node["target"][0]) for node in rule["nodes"]]
        rules[f"{rule['id']} ({rule['impact']}): {rule['help']}"].append(f"{where}: {', '.join(places[:SHOWN])}")
    for rule, wheres in rules.items():
        print(f"{rule}, {len(wheres)} times", *wheres[:SHOWN], sep="\n    ")
    print(f"{len(pages)} pages in {len(VIEWS)} views: {len(rules)} rules are broken")
    return 1 if rules or not pages else 0


if __name__ == "__main__":
    raise SystemExit(main())
