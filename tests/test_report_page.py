"""Drives report pages in headless Chromium: from file://, without a network, as a user opens them."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from browser import chromium_path, open_browsers
from colmap_lazyloc import results
from colmap_lazyloc.testing.synthetic_run import FAILURES

ROOT = Path(__file__).resolve().parents[1]
UTM = (512345.678, 5412345.678, 321.5)
pytestmark = pytest.mark.skipif(chromium_path() is None, reason="chromium is missing; scripts/setup.sh browser")


def run_module(name, *arguments):
    command = [sys.executable, "-m", f"colmap_lazyloc.{name}", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done


def make_run(folder, *options):
    run_module("testing.synthetic_run", folder, *options)
    return folder


def make_page(run, *options):
    output = run.parent / f"{run.name}.html"
    run_module("report", run, *options, "--output", output)
    return output


@pytest.fixture(scope="module")
def start_browser():
    with open_browsers() as start:
        yield start


@pytest.fixture(scope="module")
def browser(start_browser):
    return start_browser()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Makes a run at UTM coordinates with every status, rigs, photos, and names that no one should choose."""
    folder = tmp_path_factory.mktemp("ugly") / "run"
    origin = ("--origin", *UTM)
    return make_run(folder, "--num_queries", 100, "--frame_size", 2, *origin, "--ugly_names", "--photos")


@pytest.fixture(scope="module")
def page_path(run):
    return make_page(run, "--image_path", run / "images", "--ground_truth", run / "truth")


@pytest.fixture
def report(browser, page_path):
    opened = browser.open(page_path)
    yield opened
    assert opened.problems == []
    opened.page.context.close()


def names_of(report):
    return report.page.evaluate("() => window.report.data.queries.names")


def query_called(report, ending):
    """Returns the first query whose name ends so."""
    return next(query for query, name in enumerate(names_of(report)) if name.endswith(ending))


def address_of(report):
    return report.page.evaluate("() => decodeURIComponent(location.hash)")


def shown_rows(report):
    return report.page.locator(".rows [data-query]").evaluate_all("rows => rows.map(r => Number(r.dataset.query))")


def test_the_page_shows_every_query_and_status(report, run):
    statuses = {status["name"] for status in report.page.evaluate("() => window.report.data.summary.statuses")}
    assert statuses == {"LOCALIZED", *FAILURES}
    assert report.state()["numVisible"] == len(results.read_results(run / "results.jsonl")) == len(names_of(report))
    assert report.state()["viewer"] == "webgl"
    assert report.state()["numDrawnPoints"] > 0


@pytest.mark.parametrize(
    ("statuses", "title", "words"),
    [
        (["LOCALIZED", "LOCALIZED"], "Nothing stands out", "Half of all queries are below"),
        (["LOCALIZED"], "Nothing stands out", "One query: "),
        (["LOCALIZED", "NO_PAIRS"], "No warnings", "One query: "),
    ],
)
def test_the_head_suits_few_queries(browser, tmp_path, statuses, title, words):
    run = make_run(tmp_path / "run", "--num_queries", 16)
    found = list(results.read_results(run / "results.jsonl").values())
    chosen = []
    for status in statuses:
        chosen.append(next(result for result in found if result["status"] == status and result not in chosen))
    text = "".join(json.dumps(result | {"confidence": result["confidence"] and 0.99}) + "\n" for result in chosen)
    (run / "results.jsonl").write_text(text)
    report = browser.open(make_page(run))
    shown = report.page.locator("body").inner_text()
    assert title in shown and words in shown
    assert ("begins with the queries that are not localized" in shown) == (title == "No warnings")
    report.page.context.close()


def test_positions_are_exact_to_a_millimetre_at_utm_coordinates(report, run):
    data = report.page.evaluate(
        """() => { const { queries, scene } = window.report.data;
          return [queries.names, scene.origin, Array.from(scene.queryCentres)]; }"""
    )
    names, origin, centres = data[0], np.array(data[1]), np.array(data[2], float).reshape(-1, 3)
    expected = {name: results.pose_of(result) for name, result in results.read_results(run / "results.jsonl").items()}
    num_compared = 0
    for name, centre in zip(names, centres):
        if expected[name] is not None:
            assert np.linalg.norm(origin + centre - expected[name].cam_in_world) < 1e-3
            num_compared += 1
    assert num_compared > 50


def test_a_row_selects_the_query_in_address_scene_and_page(report):
    query = shown_rows(report)[3]
    report.page.locator(f".rows [data-query='{query}']").click()
    report.wait_for_selected(query)
    assert address_of(report) == f"#query/{names_of(report)[query]}" or "\n" in names_of(report)[query]
    assert report.page.locator(f".rows [data-query='{query}']").get_attribute("aria-selected") == "true"


def test_the_address_selects_and_back_returns(browser, page_path):
    report = browser.open(page_path)
    first, second = query_called(report, "with blanks.jpg"), query_called(report, "日本 é.jpg")
    report.select_by_address(first)
    report.select_by_address(second)
    report.page.go_back()
    report.wait_for_selected(first)
    assert report.problems == []


def test_an_unknown_name_in_the_address_is_said(browser, page_path):
    report = browser.open(page_path, "#query/nobody.jpg")
    assert report.state()["selected"] == -1
    assert "nobody.jpg" in report.page.locator("main").inner_text()
    assert report.problems == []


FIND_QUERY_ON_SCREEN = """() => {
  const canvas = document.querySelector('canvas');
  canvas.scrollIntoView({ block: 'center' });
  const box = canvas.getBoundingClientRect(), state = window.report.state();
  for (let i = 0; i < window.report.data.queries.names.length; ++i) {
    const [x, y] = state.projectedQuery(i);
    if (Number.isFinite(x) && document.elementFromPoint(x, y) === canvas) return [i, x, y];
  }
  return null;
}"""


def test_a_double_click_in_the_scene_selects(report):
    found = report.page.evaluate(FIND_QUERY_ON_SCREEN)
    assert found is not None, "no query is on the screen"
    report.page.mouse.dblclick(found[1], found[2])
    report.wait_for("() => window.report.state().selected >= 0")
    x, y = report.page.evaluate("() => { const s = window.report.state(); return s.projectedQuery(s.selected); }")
    assert np.hypot(x - found[1], y - found[2]) < 15  # another query may be in front


def test_positions_are_shown_and_copied(browser, page_path, run):
    report = browser.open(page_path, permissions=["clipboard-read", "clipboard-write"])
    found = {name: results.pose_of(result) for name, result in results.read_results(run / "results.jsonl").items()}
    names = names_of(report)
    query = next(i for i in range(len(names) - 1, -1, -1) if found[names[i]] is not None)
    xyz = found[names[query]].cam_in_world
    report.select_by_address(query)
    shown = report.page.locator(".query-page .position").inner_text()
    assert [float(word) for word in shown.split(", ")] == pytest.approx(xyz, abs=1e-3)
    assert report.page.locator(f".rows [data-query='{query}']").inner_text().count(shown) == 1

    def copied(button):
        button.click()
        report.wait_for("text => [...document.querySelectorAll('button')].some(b => b.textContent === text)", "Copied")
        return report.page.evaluate("() => navigator.clipboard.readText()")

    assert copied(report.page.locator(".positions button")) == shown
    report.page.wait_for_timeout(2500)  # until the button shows its label again
    report.page.get_by_role("searchbox").fill(names[query])
    head, *rows = copied(report.page.get_by_role("button", name="Copy positions")).splitlines()
    assert head.split("\t") == ["query", "status", "x", "y", "z", "standard deviation"]
    assert [row.split("\t")[2:5] for row in rows if row.startswith(names[query])] == [shown.split(", ")]
    assert report.problems == []


def test_the_column_of_positions_names_the_reference_system(browser, run, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    name = next(iter(results.read_results(run / "results.jsonl")))
    (folder / "positions.csv").write_text(
        f"name,status,latitude_deg,longitude_deg,height_m\n{name},LOCALIZED,45,9,301.5\n"
    )
    report = browser.open(make_page(folder, "--crs", "EPSG:32632"))
    headers = report.page.get_by_role("columnheader").all_inner_texts()
    assert [text for text in headers if "E, N, H" in text] == ["EPSG:32632: E, N, H (m)"], headers


@pytest.mark.parametrize("width", [390, 1280])
def test_start_and_end_of_long_names_are_in_sight(browser, page_path, width):
    report = browser.open(page_path, width=width)
    report.page.evaluate("""() => {
      const {queries, scene} = window.report.data;
      queries.names.forEach((_, i) => { queries.names[i] = `query/front/PXL_20230514_1015${30000 + i}.jpg`; });
      scene.databaseNames.forEach((_, i) => { scene.databaseNames[i] = `database/PXL_20230514_1015${30000 + i}.jpg`; });
    }""")
    search = report.page.get_by_role("searchbox")
    search.fill("f")
    search.fill("")  # so that the rows are made again
    report.page.get_by_role("grid").press("End")
    bar = report.page.locator(".open-bar strong")
    # The two parts of each name must be in the box, and wide enough for some characters.
    measure = """element => {
      const {left, right} = element.getBoundingClientRect();
      const parts = [...element.children].map(part => part.getBoundingClientRect());
      return [element.textContent, Math.min(...parts.map(part => part.width)),
        parts[0].left >= left - 1 && parts.at(-1).right <= right + 1, parts.length]; }"""
    row = report.page.locator('.row[aria-selected="true"] .cut-name')
    found = [row.evaluate(measure), bar.evaluate(measure)]
    report.page.get_by_role("grid").press("Enter")
    report.wait_for("() => document.querySelector('.pair-table tbody th')")
    found.append(report.page.locator(".pair-table .cut-name").first.evaluate(measure))
    for text, smallest, is_inside, num_parts in found:
        assert re.fullmatch(r"(query/front|database)/PXL_20230514_10153\d+\.jpg", text)
        assert smallest > 15 and is_inside and num_parts == 2, text
    assert report.problems == []


@pytest.mark.parametrize("width, color_scheme", [(1280, "light"), (1280, "dark"), (390, "light")])
def test_nothing_is_cut_off(browser, page_path, width, color_scheme):
    report = browser.open(page_path, width=width, color_scheme=color_scheme)
    cut = """selector => [...document.querySelectorAll(selector)]
      .filter(e => e.scrollWidth > e.clientWidth + 1).map(e => e.textContent)"""
    for header in report.page.get_by_role("columnheader").all():
        header.get_by_role("button").click()  # the arrow of the order needs room, too
        assert report.page.evaluate(cut, ".header .cell") == []
    assert report.page.evaluate(cut, ".rows .cell.number span, .rows .cell.confidence span") == []
    assert report.page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    measure = """field => { field.value = field.placeholder; const isCut = field.scrollWidth > field.clientWidth;
      field.value = ""; return isCut; }"""
    assert not report.page.get_by_role("searchbox").evaluate(measure)
    path = "/home/user" * 12  # of a file that is missing
    report.page.evaluate("path => { document.querySelector('.warnings p').textContent = path; }", path)
    assert report.page.evaluate(cut, ".warnings") == []
    if width == 1280:
        assert report.page.evaluate(cut, ".grid") == []
        report.select_by_address(len(names_of(report)) - 1)
        assert report.page.evaluate(cut, ".pair-table thead th") == []
    assert report.page.locator("h1").inner_text() == report.page.evaluate("() => window.report.data.summary.title")
    assert report.problems == []


def test_the_keyboard_reaches_rows_filter_and_nothing_selected(report):
    rows = shown_rows(report)
    report.page.locator("[role=grid]").focus()
    report.page.keyboard.press("ArrowDown")
    report.wait_for_selected(rows[0])
    report.page.keyboard.press("ArrowDown")
    report.wait_for_selected(rows[1])
    report.page.keyboard.press("End")
    report.wait_for("query => window.report.state().selected !== query", rows[1])
    report.page.keyboard.press("Escape")
    report.wait_for_selected(-1)
    report.page.keyboard.press("/")
    assert report.page.evaluate("() => document.activeElement.type") == "search"


def test_sorting_and_filtering(report):
    confidence = report.page.evaluate(
        "() => Array.from(window.report.data.queries.confidence, x => isNaN(x) ? null : x)"
    )
    header = report.page.get_by_role("columnheader").filter(has_text=re.compile("^Confidence"))
    for direction in ("first", "second"):
        header.get_by_role("button").click()
        order = header.get_attribute("aria-sort")
        shown = [confidence[query] for query in shown_rows(report) if confidence[query] is not None]
        assert order in ("ascending", "descending"), direction
        assert shown == sorted(shown, reverse=order == "descending")
    report.page.get_by_role("searchbox").fill("line")
    report.wait_for("() => window.report.state().numVisible < window.report.data.queries.names.length")
    assert query_called(report, "line\nbreak.jpg") in shown_rows(report)
    report.page.get_by_role("searchbox").fill("nothing is called so")
    report.wait_for("() => window.report.state().numVisible === 0")


def test_a_chip_filters_by_status(report):
    summary = report.page.evaluate("() => window.report.data.summary")
    number = next(i for i, status in enumerate(summary["statuses"]) if status["name"] == "NO_PAIRS")
    report.page.locator("header button, .chips button").filter(has_text=re.compile("no pairs", re.I)).first.click()
    count = summary["statuses"][number]["count"]
    report.wait_for("count => window.report.state().numVisible === count", count)


def test_names_are_shown_and_never_executed(report):
    for query, name in enumerate(names_of(report)):
        if "<" in name or "$(" in name:
            report.page.evaluate(
                "name => { location.hash = '#query/' + encodeURIComponent(name).replaceAll('%2F', '/'); }", name
            )
            report.wait_for_selected(query)
            assert name in report.page.locator("main").inner_text()
    assert report.page.locator("img[src=x]").count() == 0


def test_a_query_page_shows_photo_pairs_and_command(report):
    drawn = report.page.evaluate("() => Array.from(window.report.data.queries.isDrawn).indexOf(1)")
    assert drawn >= 0
    report.page.evaluate(
        "i => { location.hash = '#query/' + window.report.data.queries.names[i].split('/').map("
        "encodeURIComponent).join('/'); }",
        drawn,
    )
    report.wait_for_selected(drawn)
    report.page.locator("main image").first.wait_for()
    assert report.page.locator("main image").count() >= 2
    assert "colmap lazy_localizer" in report.page.locator("main").inner_text()


def test_without_webgl_the_plan_is_shown(start_browser, page_path):
    report = start_browser("--disable-3d-apis").open(page_path)
    assert report.state()["viewer"] == "plan"
    assert report.page.locator("svg").count() > 0


def test_print_shows_the_plan(report):
    report.page.emulate_media(media="print")
    assert len(report.page.pdf()) > 20_000


def test_dark_mode_is_dark(browser, page_path):
    def background(scheme):
        report = browser.open(page_path, color_scheme=scheme)
        color = report.page.evaluate("() => getComputedStyle(document.documentElement).backgroundColor")
        assert report.problems == []
        report.page.context.close()
        return sum(map(int, re.findall(r"\d+", color)[:3]))

    assert background("dark") < 200 < 600 < background("light")


def test_a_split_report_loads_what_is_beside_it(browser, run):
    folder = run.parent / "split"
    run_module("report", run, "--image_path", run / "images", "--split", "--output", folder)
    report = browser.open(next(folder.glob("*.html")))
    drawn = report.page.evaluate("() => Array.from(window.report.data.queries.isDrawn).indexOf(1)")
    report.page.evaluate(
        "i => { location.hash = '#query/' + window.report.data.queries.names[i].split('/').map("
        "encodeURIComponent).join('/'); }",
        drawn,
    )
    report.page.locator("main image").first.wait_for()
    assert report.problems == []


def test_a_damaged_chunk_is_said_in_the_page(browser, page_path, tmp_path):
    text = page_path.read_text(encoding="utf-8")
    damaged = tmp_path / "damaged.html"
    damaged.write_text(re.sub(r'(data-chunk="queries">)[^<]{400}', r"\1", text), encoding="utf-8")
    report = browser.open_any(damaged)
    report.page.get_by_role("alert").wait_for()
    assert "cannot be shown" in report.page.get_by_role("alert").inner_text()


def test_the_viewer_in_the_repository_is_what_its_source_builds():
    done = subprocess.run([ROOT / "scripts/build_viewer.sh", "--check"], capture_output=True, text=True, check=False)
    if done.returncode == 3:
        pytest.skip("npm is missing; scripts/setup.sh browser")
    assert done.returncode == 0, done.stdout + done.stderr
