"""Tests that the documentation's site builds without a broken link, needs no network, and is accessible."""

import pathlib
import re
import shutil
import subprocess
import sys

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

import colmap_lazyloc
from browser import ARGUMENTS, chromium_path
from conftest import PROJECT_PATH

SCHEMES = {"light": "default", "dark": "slate"}  # names of the theme
DOCS_PATH = PROJECT_PATH / "docs"
COMMAND = re.compile(r"(?<![\w/`])(lazyloc (?!cluster|retrieve)[a-z]+|colmap lazy_\w+) ([^|;&]*)")
QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"| #.*")
OPTION = re.compile(r"(?<!\S)--[A-Za-z][\w.]*")
SEARCHED = {"ros": "robots", "rtk": "drones", "iphone": "export_poses", "error code": "statuses", "metashape": "film"}
TWO_FRAMES = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
LOADED = re.compile(r"<(?:script|img|link|iframe)\b[^>]*?(?:src|href)=\"?((?:https?:)?//[^\s\">]+)")


def build(project, folder):
    command = [project / "scripts" / "build_docs.sh", folder]
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    done = build(PROJECT_PATH, tmp_path_factory.mktemp("site"))
    assert done.returncode == 0, done.stderr
    (page,) = done.stdout.splitlines()
    assert page.endswith(f"/{colmap_lazyloc.__version__}/index.html")
    return PROJECT_PATH.joinpath(page).parent


def test_pages_load_nothing_from_the_network(site):
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 40
    for page in pages:
        assert LOADED.findall(page.read_text()) == [], page


def commands_of(page):
    """Returns (command, its options) of the blocks of a page that a shell reads."""
    blocks = re.findall(r"^```(?:sh|console)\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    found = [match.groups() for line in lines for match in COMMAND.finditer(QUOTED.sub("", line))]
    return [(command, set(OPTION.findall(rest))) for command, rest in found]


def test_commands_have_the_options_of_the_pages():
    """Compares the options in docs/ with the help of lazyloc, and with the tables that are made from the program's."""
    reference = (DOCS_PATH / "command_line.md").read_text(encoding="utf-8")
    of_program, known = set(re.findall(r"--[A-Za-z][\w.]*", reference)), {}
    pages = [PROJECT_PATH / "README.md", *DOCS_PATH.rglob("*.md")]
    commands = [(page, *found) for page in pages for found in commands_of(page)]
    assert len(commands) > 80
    for page, command, options in commands:
        if command.startswith("lazyloc ") and command not in known:
            words = [sys.executable, "-m", "colmap_lazyloc", command.split()[1], "--help"]
            done = subprocess.run(words, cwd=PROJECT_PATH / "python", capture_output=True, text=True)
            known[command] = set(re.findall(r"--[A-Za-z][\w.]*", done.stdout)) | of_program
        assert options <= known.get(command, of_program), f"{page}: {command}"


def test_pages_have_the_words_that_readers_search(site):
    for words, page in SEARCHED.items():
        (path,) = site.rglob(f"{page}.html")
        assert re.search(rf"\b{words}\b", path.read_text(encoding="utf-8").lower()), page


def test_each_page_shows_the_version(site):
    assert f"colmap_lazyloc {colmap_lazyloc.__version__}" in (site / "users" / "index.html").read_text()


def test_home_leads_to_the_start_page(site):
    """From the disk, a link to the folder would show its files."""
    for page, target in (("index.html", "index.html"), ("users/robots.html", "../index.html")):
        (link,) = re.findall(r'<a href="([^"]*)"[^>]* class="md-header__button md-logo"', (site / page).read_text())
        assert link == target


def test_methods_have_anchors_and_lists_of_parameters(site):
    text = (site / "python.html").read_text()
    assert 'id="localizerlocalize_photo"' in text and "<li><code>camera</code>: " in text


def test_formulas_are_mathml(site):
    text = (site / "method.html").read_text()
    assert text.count("<math") > 40 and "arithmatex" not in text and "\\frac" not in text


@pytest.mark.skipif(chromium_path() is None, reason="chromium is missing; scripts/setup.sh browser")
def test_search_works_from_the_disk(site):
    """Opens the site as a reader does, without a server, and searches for a status."""
    problems = []
    with sync_playwright() as playwright:
        program = playwright.chromium.launch(executable_path=chromium_path(), args=ARGUMENTS)
        page = program.new_page()
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("request", lambda request: request.url.startswith("file:") or problems.append(request.url))
        page.goto((site / "index.html").as_uri())
        page.locator("input.md-search__input").click()
        page.keyboard.type("DAMAGED_DATA")
        page.locator("a.md-search-result__link[href*='statuses.html']").first.wait_for(timeout=30000)
        program.close()
    assert problems == []


@pytest.mark.skipif(chromium_path() is None, reason="chromium is missing; scripts/setup.sh browser")
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_are_accessible(site, scheme):
    """Runs axe-core on each page; on a dark page, only the contrast of colours is another one."""
    options = {"resultTypes": ["violations"]} | ({"runOnly": ["color-contrast"]} if scheme == "dark" else {})
    found = []
    with sync_playwright() as playwright:
        program = playwright.chromium.launch(executable_path=chromium_path(), args=ARGUMENTS)
        page = program.new_page(color_scheme=scheme)
        for path in sorted(site.rglob("*.html")):
            page.goto(path.as_uri())
            page.evaluate(TWO_FRAMES)  # until the script of the site has set the height of the sidebar
            assert page.locator("body").get_attribute("data-md-color-scheme") == SCHEMES[scheme]
            for violation in Axe().run(page, options=options).response["violations"]:
                if violation["impact"] in ("serious", "critical"):
                    found.append(f"{path.name}: {violation['id']}: {violation['nodes'][0]['html']}")
        program.close()
    assert found == []


def test_code_in_the_text_may_break_only_inside(site):
    """The closing tag of a code has a slash and a letter, between which a break would swallow what follows."""
    text = (site / "command_line.html").read_text()
    assert re.search("[.]<wbr>[a-z]", text) and "</<wbr>" not in text


def test_pictures_of_the_pipeline_name_what_the_code_has():
    """Compares the nodes of the pictures and the names in the text with the words of the sources."""
    text = (PROJECT_PATH / "CONTRIBUTING.md").read_text().partition("## The pipeline")[2].partition("## Glossary")[0]
    nodes = re.findall(r"^ +(\w+) -", text, re.MULTILINE) + re.findall(r"--> (\w+)$", text, re.MULTILINE)
    names = {name for name in nodes if name[0].isupper()} | set(re.findall(r"`([A-Za-z_]+)`", text))
    sources = PROJECT_PATH / "src" / "colmap_lazyloc"
    paths = [*sources.rglob("*.h"), *(sources / "pipeline").glob("*.cc")]
    words = {word for path in paths for word in re.findall(r"\w+", path.read_text())}
    assert len(names) >= 30 and names - words == set()


@pytest.fixture
def copy(tmp_path):
    """Copies what the site is built from."""
    for name in ("docs", "scripts", "src", "mkdocs.yml", "pyproject.toml", "CONTRIBUTING.md", "CHANGELOG.md"):
        source = PROJECT_PATH / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, tmp_path / name)
    version = pathlib.Path("python", "colmap_lazyloc", "__init__.py")
    (tmp_path / version).parent.mkdir(parents=True)
    shutil.copy(PROJECT_PATH / version, tmp_path / version)
    return tmp_path


def append(folder, page, text):
    with (folder / "docs" / page).open("a") as file:
        file.write(f"\n{text}\n")


def test_broken_link_is_an_error(copy):
    append(copy, "faq.md", "[a](nowhere.md) [b](method.md#nowhere)")
    done = build(copy, copy / "site")
    assert done.returncode == 1 and "nowhere.md" in done.stderr and "#nowhere" in done.stderr


def test_pages_show_values_of_the_code(copy):
    header = copy / "src" / "colmap_lazyloc" / "math" / "test_values.h"
    header.write_text("constexpr int kTestCount = 17;\nconst double kTestRatio = 2.5e-2;\nconst int kNumCells = 3;\n")
    values = ["kTestCount", "kTestRatio", "kTestRatio | percent", "test_values.kNumCells", 'default("num_retrieved")']
    append(copy, "faq.md", "Values: " + ", ".join(f"{{{{ {value} }}}}" for value in values) + ", `{{ kTestCount }}`.")
    done = build(copy, copy / "site")
    assert done.returncode == 0, done.stderr
    text = (copy / "site" / colmap_lazyloc.__version__ / "faq.html").read_text()
    assert "Values: 17, 2.5e-2, 2.5 %, 3, 20, <code>{{ kTestCount }}</code>." in text


@pytest.mark.parametrize(
    ("value", "count"), [("kNoSuchName", 0), ('default("no_such")', 0), ("no_file.kNumCells", 0), ("kNumCells", 2)]
)
def test_value_that_the_code_does_not_have_is_an_error(copy, value, count):
    append(copy, "faq.md", f"{{{{ {value} }}}}")
    done = build(copy, copy / "site")
    assert done.returncode == 1 and f"faq.md: {{{{ {value} }}}} has {count} values, but must have one" in done.stderr
