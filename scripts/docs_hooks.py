"""Hooks of MkDocs: add the pages that stand outside docs/, insert values of the code, and write formulas as MathML.

In a page, `{{ kMinNumInliers }}` is the value of a constant or of a field's default in src/colmap_lazyloc. If several
files have one of this name, `{{ depth_scale.kNumCells }}` names the file. `{{ default("num_retrieved") }}` is the
default of an option. `{{ NAME | percent }}` shows 0.05 as 5 %. Code of a page stays as it is.
"""

import functools
import html
import pathlib
import re

import latex2mathml.converter
import ziamath
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

ROOT = pathlib.Path(__file__).resolve().parents[1]
ROOT_PAGES = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
MAX_UNBROKEN = 20  # characters of a word in a line of text; longer ones may break
STACKED = re.compile(
    r"<table>\s*<thead>\s*<tr>\s*<th>(option|status|format)</th>(?:\s*<th>[^<]*</th>){2}.*?</table>", re.DOTALL
)
FIGURES = re.compile(r"<td>(\d{4}-\d\d-\d\d|[\d.]+ / [\d.]+)")
CODE = re.compile(r"<pre>.*?</pre>|<code>([^<]*)</code>", re.DOTALL)
VALUE = re.compile(r"```.*?```|`[^`]*`|\{\{ ([^{}]*) \}\}", re.DOTALL)
DEFAULT = re.compile(r"^\| `--(?:LazyLocalizer\.(?:Advanced\.)?)?(\w+)` \| (\S+) \|", re.MULTILINE)
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_config(config):
    """Leaves out the page for addresses that a server does not find, because the site opens from the disk. Shows the
    version at the bottom of each page."""
    config.theme.static_templates.discard("404.html")
    package = (ROOT / "python" / "colmap_lazyloc" / "__init__.py").read_text(encoding="utf-8")
    config.copyright = f"colmap_lazyloc {re.search(r'__version__ = .([0-9.]+)', package)[1]}"


def on_files(files, config):
    """Adds the pages at the project's root, with links as seen from docs/, and a font for formulas."""
    for name, page in ROOT_PAGES.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        for other, other_page in ROOT_PAGES.items():
            text = text.replace(f"]({other}", f"]({other_page}")
        files.append(File.generated(config, page, content=text.replace("](docs/", "](")))
    font = pathlib.Path(ziamath.__file__).parent / "fonts" / "STIXTwoMath-Regular.ttf"
    files.append(File.generated(config, "math.ttf", content=font.read_bytes()))
    return files


def on_page_markdown(markdown, page, **_):
    """Inserts values, and makes links to the pages at the project's root lead to the site's pages."""
    for name, root_page in ROOT_PAGES.items():
        markdown = markdown.replace(f"](../{name}", f"]({root_page}")
    return VALUE.sub(lambda match: value_of(match.group(1), page) if match.group(1) else match.group(), markdown)


def value_of(expression, page):
    """Returns the text that a page shows for an expression in double braces."""
    name, _, form = expression.partition(" | ")
    if option := re.fullmatch(r'default\("(\w+)"\)', name):
        found = option_defaults().get(option.group(1), [])
    else:
        file, _, constant = name.rpartition(".")
        sources = [text for stem, text in source_files() if file in ("", stem)]
        found = re.findall(rf"\b{re.escape(constant)}(?:\[\])? = \{{?(-?[\d.]+(?:e-?\d+)?)\b", "\n".join(sources))
    if len(found) != 1 or form not in ("", "percent"):
        raise PluginError(f"{page.file.src_uri}: {{{{ {expression} }}}} has {len(found)} values, but must have one")
    return f"{100 * float(found[0]):g} %" if form else found[0]


@functools.cache
def source_files():
    """Returns name and text of each source file that is no test."""
    paths = sorted([*ROOT.glob("src/colmap_lazyloc/**/*.h"), *ROOT.glob("src/colmap_lazyloc/**/*.cc")])
    return [(path.stem, path.read_text(encoding="utf-8")) for path in paths if not path.stem.endswith("_test")]


@functools.cache
def option_defaults():
    """Returns the defaults of lazy_localizer's options by name; the tables are made from --help-all, which a test
    compares."""
    defaults = {}
    for name, value in DEFAULT.findall((ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")):
        defaults.setdefault(name, []).append(value)
    return defaults


def on_page_content(content, **_):
    """Writes formulas as MathML, and lets code in the text break between words, long names after a dot, too."""

    def convert(match):
        is_block = match.group(1) == "div"
        formula = html.unescape(match.group(2))
        text = latex2mathml.converter.convert(formula, display="block" if is_block else "inline")
        return f'<div class="formula" tabindex="0">{text}</div>' if is_block else text

    def break_word(word):
        pieces = re.split(r"(?<=[_./,=:])(?=[\w'])", word) if len(html.unescape(word)) > MAX_UNBROKEN else [word]
        return "<wbr>".join(f'<span class="word">{piece}</span>' if "-" in piece else piece for piece in pieces)

    def break_code(match):
        words = match.group(1)
        return match.group() if words is None else f"<code>{' '.join(map(break_word, words.split(' ')))}</code>"

    content = STACKED.sub(r'<div class="stacked \g<1>">\g<0></div>', content)
    content = FIGURES.sub(r'<td><span class="word">\1</span>', content)
    return CODE.sub(break_code, FORMULA.sub(convert, content))


def on_post_page(output, **_):
    """Names the dialog of the search for screen readers, which the theme leaves without a name."""
    return output.replace('role="dialog">', 'role="dialog" aria-label="Search">')
