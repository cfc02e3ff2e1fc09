"""The page in a real browser: nothing is fetched, shells turn and move, tables sort, by hand, by key and on paper."""

import base64
import json
import os
import shutil
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from shellbench.bench.store.store import Store as Records
from shellbench.report.data import exhibit
from shellbench.report.data.fields import read_fields
from shellbench.report.figures import shells
from shellbench.report.figures.pictures import PICTURE, lead_shells, pictured
from shellbench.report.figures.shells import AXES_TO_UP
from shellbench.report.page import page, sections
from tests.patience import GUARD, until
from tests.report.conftest import coarse_figures
from tests.report.motion import BROKEN, OFFSET

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # WebGL by software
)
WITHOUT_WEBGL = ("--disable-3d-apis", "--disable-webgl")
NARROW = {"width": 360, "height": 740}
HIGHEST = 8000  # pixels of a suite's page
ROUNDING = 3e-5  # of the largest component: what two bytes keep


@pytest.fixture(scope="module")
def playwright():
    reason = "the page is tested in a browser: install playwright (pip install playwright) and Chromium or Chrome"
    api = pytest.importorskip("playwright.sync_api", reason=reason)
    with api.sync_playwright() as running:
        yield running


def launched(playwright, *flags):
    path = os.environ.get("SHELLBENCH_BROWSER") or next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip(f"no browser to test the page in: install one of {', '.join(BROWSERS)}, or set SHELLBENCH_BROWSER")
    return playwright.chromium.launch(executable_path=path, args=[*FLAGS, *flags], headless=True, timeout=1000 * GUARD)


@pytest.fixture(scope="module")
def browser(playwright):
    with launched(playwright) as running:
        yield running


@pytest.fixture(scope="module")
def course_page(course_report):
    return course_report.parent / "obstacle_course.html"


@pytest.fixture(scope="module")
def cloth_page(motion, tmp_path_factory):
    def pictures(evidence):
        return [
            exhibit.Exhibit(f"{PICTURE}{one.case}", one.title, "", one.title, shells.shell_figure(one), (), False)
            for one in lead_shells(pictured(evidence.records, evidence.compared), evidence.folder)
        ]

    folder = tmp_path_factory.mktemp("cloth")
    with coarse_figures(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(sections, "exhibits", pictures)
        page.write_report(Records(motion.folder), motion.rows, folder, motion.known_values, for_print=False)
    return folder / "cloth.html"


class Open:
    """A page in a browser, with whatever it complained of or asked for."""

    def __init__(self, browser, path, **context):
        self.context = browser.new_context(device_scale_factor=0.5, **context)  # a quarter of the pixels to draw
        self.context.set_default_timeout(1000 * GUARD)
        self.page = self.context.new_page()
        self.complaints, self.requests = [], []
        self.page.on("console", lambda message: self._heard(message.type, message.text))
        self.page.on("pageerror", lambda error: self._heard("error", str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.file = path.name
        self.page.goto(path.as_uri())

    def unfold(self):
        """Open all that is folded."""
        self.page.evaluate("() => document.querySelectorAll('main details').forEach((one) => (one.open = true))")

    def _heard(self, kind, text):
        if kind == "error":
            self.complaints.append(text)

    def view(self, case):
        """Open a case's view; return its figure."""
        figure = self.page.locator(f"figure[data-case={case}]")
        if not figure.locator(".view").count():
            figure.locator("button.opener").click()
        figure.locator(".plot canvas").first.wait_for()
        self.settle(case)
        return figure

    def settle(self, case):
        self.page.evaluate(f"() => shellbench.views.alive.get({case!r}).drawn")

    def surface(self, case):
        """Return the shown surface: coordinates by the titles of their axes, colours and their bar."""
        self.settle(case)
        shown = self.page.evaluate(
            """(name) => {
              const { plot } = shellbench.views.alive.get(name);
              const { x, y, z, surfacecolor, colorbar, cmin, cmax, showscale } = plot.data[0];
              const { scene } = plot.layout;
              const axes = { x: scene.xaxis, y: scene.yaxis, z: scene.zaxis };
              const camera = plot._fullLayout.scene._scene.getCamera();
              return { x, y, z, surfacecolor, title: colorbar.title.text, cmin, cmax, showscale, camera,
                       titles: Object.fromEntries(Object.entries(axes).map(([k, v]) => [k, v.title.text])) };
            }""",
            case,
        )
        return {**shown, **{name: np.array(shown[name]) for name in ("x", "y", "z", "surfacecolor")}}


@pytest.fixture(scope="module")
def course(browser, course_page):
    opened = Open(browser, course_page, viewport={"width": 1280, "height": 900}, accept_downloads=True)
    opened.unfold()
    yield opened
    opened.context.close()


@pytest.fixture(scope="module")
def cloth(browser, cloth_page):
    opened = Open(browser, cloth_page, viewport={"width": 1280, "height": 900})
    yield opened
    opened.context.close()


def fields_of(store, case, solver):
    first = min(
        (row for row in store.rows if (row.case, row.solver) == (case, solver) and row.default_settings and row.value),
        key=lambda row: row.seed or 0,
    )
    record = next(record for record in store.records if record.run_id == first.run_id)
    return read_fields(record, store.folder)


def coordinates(shown, up):
    """Cartesian coordinates (n1, n2, 3): the page draws the axis that points up as its z."""
    values = np.empty((*shown["x"].shape, 3))
    for name, axis in zip("xyz", AXES_TO_UP[up], strict=True):
        values[..., axis] = shown[name]
        assert shown["titles"][name] in (f"{'xyz'[axis]} (m)", "")
    return values


def set_slider(figure, name, value):
    figure.locator(f"input[name={name}]").evaluate(
        "(input, value) => { input.value = value; input.dispatchEvent(new Event('input')); }", str(value)
    )


def choose(figure, name, words):
    figure.locator(f"select[name={name}]").select_option(label=words)


def test_the_page_loads_alone_and_without_a_complaint(course, cloth):
    for opened in (course, cloth):
        assert opened.page.title().startswith("shellbench report: ")
    course.view("scordelis_lo")
    cloth.view("napkin_plane")
    for opened in (course, cloth):
        assert opened.complaints == []
        assert [url for url in opened.requests if not url.startswith(("file:", "data:", "blob:"))] == []
        files = [url.rpartition("/")[2] for url in opened.requests if url.startswith("file:")]
        assert files == [opened.file, "plotly.js"]  # the page itself, and the library that the pages share


def test_every_picture_is_drawn(course):
    widths = course.page.locator("img").evaluate_all(
        "(all) => Promise.all(all.map((one) => one.decode().then(() => one.naturalWidth, () => 0)))"
    )
    assert len(widths) > 8
    assert min(widths) > 0


def test_the_verdict_is_seen_first(course):
    verdict = course.page.locator(".verdict").bounding_box()
    assert verdict["y"] + verdict["height"] < 400
    assert verdict["y"] < course.page.locator("table").first.bounding_box()["y"]


@pytest.mark.parametrize("viewport", [{"width": 1440, "height": 900}, {"width": 390, "height": 844}])
def test_the_first_page_shows_a_result_without_scrolling(browser, course_report, viewport):
    opened = Open(browser, course_report, viewport=viewport)
    for shown in (".verdict", "table.results thead", "table.results tbody tr >> nth=0"):
        box = opened.page.locator(shown).first.bounding_box()
        assert box["y"] + box["height"] <= viewport["height"]
    assert opened.page.evaluate("() => document.documentElement.scrollWidth") <= viewport["width"]
    assert not opened.page.locator("details[open] code").filter(has_text="shellbench run").count()
    opened.context.close()


def test_a_page_of_a_suite_is_short_and_links_open_what_is_folded(browser, course_page):
    opened = Open(browser, course_page, viewport={"width": 1440, "height": 900})
    assert opened.page.evaluate("() => document.documentElement.scrollHeight") <= HIGHEST
    table = opened.page.locator("#table-displacements_obstacle_course")
    assert not table.is_visible()
    opened.page.locator("nav a[href='#displacements']").click()
    table.wait_for(state="visible")
    opened.unfold()
    clipped = (
        "(all) => all.filter((one) => one.scrollWidth > one.clientWidth && getComputedStyle(one).overflowX !== 'auto')"
    )
    assert opened.page.locator(".wide").evaluate_all(clipped) == []
    assert opened.page.evaluate("() => document.documentElement.scrollWidth") <= 1440
    opened.context.close()


def test_the_slider_moves_the_shell(course, store):
    figure = course.view("pinched_cylinder_free")
    choose(figure, "shown", "fem")
    fields = fields_of(store, "pinched_cylinder_free", "fem")
    highest = float(figure.locator("input[name=scale]").get_attribute("max"))
    for scale in (0.0, 0.25 * highest, highest):
        set_slider(figure, "scale", scale)
        seen = coordinates(course.surface("pinched_cylinder_free"), "z")
        expected = fields.position + scale * fields.displacement
        size = np.abs(fields.position).max() + scale * np.abs(fields.displacement).max()
        assert np.abs(seen - expected).max() < ROUNDING * size
    assert f"displacement × {highest:.0f}, coloured by" in figure.locator(".said").inner_text()


def test_colours_are_chosen_and_named(course, store):
    figure = course.view("square_plate")
    choose(figure, "shown", "fem")
    fields = fields_of(store, "square_plate", "fem")
    shown = course.surface("square_plate")
    assert shown["title"] == "−u<sub>z</sub> (m)"  # as in the still picture
    assert shown["surfacecolor"].max() == pytest.approx(0.4875, rel=1e-4)
    choose(figure, "colour", "magnitude")
    shown = course.surface("square_plate")
    assert shown["title"] == "|u| (m)"
    size = np.linalg.norm(fields.displacement, axis=-1)
    assert np.abs(shown["surfacecolor"] - size).max() < ROUNDING * size.max()
    choose(figure, "colour", "z component")
    shown = course.surface("square_plate")
    assert shown["title"] == "u<sub>z</sub> (m)"
    assert np.abs(shown["surfacecolor"] - fields.displacement[..., 2]).max() < ROUNDING * size.max()
    assert "coloured by u_z (m) from −0.487 to 0" in figure.locator(".said").inner_text()
    choose(figure, "colour", "strain energy density")
    shown = course.surface("square_plate")
    assert shown["title"] == "energy density (J/m²)"
    assert np.abs(shown["surfacecolor"] - 3 * fields.xi[..., 0]).max() < ROUNDING * 300


def test_a_density_that_was_not_kept_is_no_choice(course):
    figure = course.view("pinched_cylinder_diaphragm")
    assert "strain energy density" not in figure.locator("select[name=colour]").inner_text()


def test_the_difference_of_two_solvers_is_theirs(course, store):
    figure = course.view("square_plate")
    choose(figure, "shown", "difference: ndf-ritz − fem")  # the picture's solver comes first
    shown = course.surface("square_plate")
    ours, theirs = (fields_of(store, "square_plate", name).displacement for name in ("fem", "ndf-ritz"))
    apart = np.linalg.norm(ours - theirs, axis=-1)
    assert shown["title"] == "|Δu| (m)"
    assert np.abs(shown["surfacecolor"] - apart).max() < ROUNDING * apart.max()  # not of the displacement
    assert shown["cmax"] == pytest.approx(apart.max(), rel=ROUNDING)


def test_at_most_four_are_alive_and_the_others_are_pictures_again(course):
    page = course.page
    for case in ("square_plate", "scordelis_lo", "pinched_cylinder_free", "pinched_cylinder_diaphragm"):
        course.view(case)
    assert page.evaluate("() => shellbench.views.alive.size") == 4
    figure = page.locator("figure[data-case=scordelis_lo]")
    figure.locator("button.opener").click()
    assert page.evaluate("() => shellbench.views.alive.size") == 3
    assert figure.locator("img").is_visible()
    assert not figure.locator(".plot").count()
    assert course.complaints == []


@pytest.mark.long
def test_a_fifth_view_closes_the_oldest(cloth):
    cases = cloth.page.locator("figure[data-case]").evaluate_all("(all) => all.map((one) => one.dataset.case)")
    assert len(cases) == 4
    alive = cloth.page.evaluate(
        """async (cases) => {
          for (const view of [...shellbench.views.alive.values()]) shellbench.views.close(view);
          const { alive, open } = shellbench.views;
          for (const name of cases) await open(document.querySelector(`figure[data-case=${name}]`));
          const copy = document.querySelector(`figure[data-case=${cases[3]}]`).cloneNode(true);
          copy.querySelector(".view").remove();
          copy.dataset.case = "again";
          const kept = document.getElementById(`view-${cases[3]}`).cloneNode(true);
          kept.id = "view-again";
          kept.textContent = kept.textContent.replace(`"case":"${cases[3]}"`, '"case":"again"');
          document.body.append(copy, kept);
          await open(copy);
          return [...alive.keys()];
        }""",
        cases,
    )
    assert alive == [*cases[1:], "again"]
    cloth.page.reload()


def test_keys_turn_the_shell(course):
    figure = course.view("pinched_cylinder_free")  # open since the slider moved it
    plot = figure.locator(".plot")
    plot.focus()

    def angles():
        eye = course.surface("pinched_cylinder_free")["camera"]["eye"]
        level = np.hypot(eye["x"], eye["y"])
        return np.degrees([np.arctan2(eye["y"], eye["x"]), np.arctan2(eye["z"], level)])

    first = angles()
    course.page.keyboard.press("ArrowRight")
    until(lambda: angles() - first == pytest.approx([10, 0], abs=0.1))
    course.page.keyboard.press("ArrowUp")
    until(lambda: angles() - first == pytest.approx([10, 10], abs=0.1))
    figure.locator("button[aria-label='Back to the first view']").click()
    until(lambda: angles() == pytest.approx(first, abs=0.1))
    assert plot.get_attribute("tabindex") == "0"
    assert "Arrow keys" in plot.get_attribute("aria-label")
    labels = figure.locator("input, select, button").evaluate_all(
        "(all) => all.map((one) => one.closest('label')?.textContent || one.getAttribute('aria-label') || one.textContent)"
    )
    assert all(label.strip() for label in labels)


def test_motions_have_a_slider_over_time(cloth, motion):
    cloth.page.evaluate("() => [...shellbench.views.alive.values()].forEach(shellbench.views.close)")
    figure = cloth.view("pendulum_strip")
    fields = fields_of(motion, "pendulum_strip", "fem")
    marks = json.loads(cloth.page.locator("#view-pendulum_strip").text_content())["marks"]
    for place in (0, len(marks) // 2, len(marks) - 1):
        set_slider(figure, "mark", place)
        t = float(marks[place].split()[2])
        assert marks[place] in figure.locator(".said").inner_text()
        frame = int(np.argmin(np.abs(fields.marks - t)))
        assert fields.marks[frame] == pytest.approx(t, rel=1e-3, abs=1e-9)
        seen = coordinates(cloth.surface("pendulum_strip"), up_of(cloth, "pendulum_strip"))
        expected = fields.position + fields.displacements[frame]
        assert np.abs(seen - expected).max() < ROUNDING * 3
    broken = next(o for o in figure.locator("select[name=shown] option").all_inner_texts() if "(failed)" in o)
    choose(figure, "shown", broken.strip())
    assert float(marks[-1].split()[2]) > BROKEN
    assert "no such state was kept" in figure.locator(".said").inner_text()
    assert cloth.complaints == []


def up_of(opened, case):
    return json.loads(opened.page.locator(f"#view-{case}").text_content())["up"]


def test_a_motion_plays_and_stops(cloth):
    figure = cloth.page.locator("figure[data-case=free_fall]")
    cloth.view("free_fall")
    set_slider(figure, "mark", 0)
    figure.get_by_role("button", name="Play all states").click()
    cloth.page.wait_for_function("() => shellbench.views.alive.get('free_fall').choice.mark > 1")
    figure.get_by_role("button", name="Stop").click()
    assert cloth.page.evaluate("() => shellbench.views.alive.get('free_fall').timer") is None
    assert figure.get_by_role("button", name="Play all states").count() == 1


def test_the_difference_of_motions_is_that_of_their_formulas(cloth):
    figure = cloth.view("napkin_plane")
    choose(figure, "shown", "difference: fem − ndf")
    shown = cloth.surface("napkin_plane")
    assert shown["surfacecolor"] == pytest.approx(np.full_like(shown["surfacecolor"], OFFSET), rel=1e-4)


COLUMN = """(table, column) => [...table.tBodies].map((body) => [...body.rows]
  .filter((row) => !row.classList.contains("block"))
  .map((row) => row.cells[column].dataset.value ?? null))"""


def test_tables_sort_by_key_and_by_number(course):
    table = course.page.locator("#table-displacements_obstacle_course")
    headings = [text.strip() for text in table.locator("thead th").all_inner_texts()]
    column = headings.index("Time (s)")
    heading = table.locator("thead th").nth(column)
    before = table.evaluate(COLUMN, column)
    assert len(before) == 4  # blocks stay apart
    for direction, key in (("ascending", "Enter"), ("descending", "Space")):
        heading.locator("button").focus()
        course.page.keyboard.press(key)
        assert heading.get_attribute("aria-sort") == direction
        for block in table.evaluate(COLUMN, column):
            values = [float(value) for value in block if value is not None]
            assert values == sorted(values, reverse=direction == "descending")
            assert block[len(values) :] == [None] * (len(block) - len(values))  # those without one come last
    course.page.keyboard.press("Enter")
    assert heading.get_attribute("aria-sort") == "none"
    assert table.evaluate(COLUMN, column) == before


def test_columns_without_a_key_sort_by_the_numbers_that_they_show(course):
    table = course.page.locator("#table-fields")
    assert table.count() == 1
    headings = [text.strip() for text in table.locator("thead th").all_inner_texts()]
    column = headings.index("Largest")
    table.locator("thead th button").nth(column).click()
    for body in table.locator("tbody").all():
        texts = body.locator("tr:not(.block)").evaluate_all(
            f"(rows) => rows.map((row) => row.cells[{column}].innerText)"
        )
        values = [number(text) for text in texts]
        assert values == sorted(values)
        assert len(values) > 1


def number(text):
    mantissa, _, power = text.replace("\u202f", "").rstrip("%").replace("−", "-").partition("×10")
    return float(mantissa) * 10.0 ** int(power or 0)


def test_downloads_hold_what_the_report_wrote(course, course_page):
    with course.page.expect_download() as caught:
        course.page.locator("a[download='fields.csv']").click()
    assert caught.value.suggested_filename == "fields.csv"
    written = (course_page.parent / "fields.csv").read_text(encoding="utf-8")
    assert Path(caught.value.path()).read_text(encoding="utf-8") == written
    link = course.page.locator("a[download='displacements_obstacle_course.csv']").get_attribute("href")
    assert base64.b64decode(link.partition(",")[2]).decode() in (course_page.parent / "table.csv").read_text("utf-8")


def test_a_narrow_screen_does_not_scroll_sideways(browser, course_page):
    opened = Open(browser, course_page, viewport=NARROW)
    figure = opened.view("square_plate")
    assert opened.page.evaluate("() => document.documentElement.scrollWidth") <= NARROW["width"]
    assert opened.page.evaluate("() => document.body.scrollWidth") <= NARROW["width"]
    for control in figure.locator("input, select, button").all():
        box = control.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= NARROW["width"]
    bar = figure.locator(".infolayer [class*=colorbar]").first.bounding_box()
    scene = figure.locator(".plot .gl-container > div").first.bounding_box()
    assert scene["y"] + scene["height"] <= bar["y"] + 1  # axes and their words end where the bar of colours begins
    opened.context.close()


def test_the_contents_stay_in_sight(browser, course_page):
    for viewport in ({"width": 1600, "height": 900}, NARROW):
        opened = Open(browser, course_page, viewport=viewport)
        opened.page.evaluate("() => window.scrollTo(0, document.body.scrollHeight)")
        box = opened.page.locator("nav").bounding_box()
        assert -1 <= box["y"] < viewport["height"] / 2
        opened.context.close()


def test_the_full_width_is_used(browser, course_page):
    opened = Open(browser, course_page, viewport={"width": 2200, "height": 900})
    opened.unfold()
    box = opened.page.locator("#table-displacements_obstacle_course").bounding_box()
    assert box["x"] + box["width"] > 2100
    opened.context.close()


def test_in_the_dark_the_page_is_dark_and_figures_follow(browser, course_page):
    opened = Open(browser, course_page, color_scheme="dark")
    colour = "(one) => getComputedStyle(one).{}.match(/[0-9]+/g).slice(0, 3).map(Number)"
    page = opened.page.locator("body").evaluate(colour.format("backgroundColor"))
    words = opened.page.locator("main p").first.evaluate(colour.format("color"))
    assert max(page) < 64
    assert min(words) > 128
    for kind in ("drawing", "picture"):
        image = opened.page.locator(f"figure img.{kind}").first.screenshot(type="png")
        assert np.median(np.asarray(Image.open(BytesIO(image)).convert("L"))) < 64
    opened.context.close()


def test_the_view_begins_with_what_the_picture_shows(course):
    figure = course.page.locator("figure[data-case=scordelis_lo]")
    if figure.locator(".view").count():
        figure.locator("button.opener").click()
    figure = course.view("scordelis_lo")
    solver = figure.locator("select[name=shown] option:checked").inner_text().strip()
    assert f"Solved by {solver}." in figure.locator("figcaption").text_content()


def test_paper_shows_pictures_and_no_controls(course):
    page = course.page
    figure = page.locator("figure[data-case=square_plate]")
    course.view("square_plate")
    assert not figure.locator("img").is_visible()
    page.emulate_media(media="print")
    assert figure.locator("img").is_visible()
    assert not page.locator(".view, button.opener, .files, nav, details.made").filter(visible=True).count()
    clipped = page.locator(".wide").evaluate_all(
        "(all) => all.filter((one) => getComputedStyle(one).overflowX !== 'visible')"
    )
    assert clipped == []
    page.emulate_media(media="screen")


def test_without_scripts_the_pictures_and_tables_are_there(browser, course_page):
    opened = Open(browser, course_page, java_script_enabled=False)
    page = opened.page
    assert page.locator("figure[data-case=square_plate] img").is_visible()
    assert page.locator("button").filter(visible=True).count() == 0
    assert "Verdict." in page.locator(".verdict").inner_text()
    opened.context.close()


@pytest.mark.long
def test_without_webgl_the_page_says_so(playwright, course_page):
    with launched(playwright, *WITHOUT_WEBGL) as browser:
        opened = Open(browser, course_page)
        figure = opened.page.locator("figure[data-case=square_plate]")
        assert "no WebGL" in figure.locator(".said").inner_text()
        assert figure.locator("img").is_visible()
        assert not figure.locator("button.opener").count()
        assert opened.complaints == []
