"""Hooks of MkDocs: adds the pages that stand outside docs/, and writes formulas as MathML, which needs no script."""

import html
import pathlib
import re

import latex2mathml.converter
import ziamath
from mkdocs.structure.files import File

ROOT = pathlib.Path(__file__).resolve().parents[1]
ROOT_PAGES = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
MAX_UNBROKEN = 20  # characters of a word in a line of text; longer ones may break
STACKED = re.compile(
    r"<table>\s*<thead>\s*<tr>\s*<th>(option|status|format)</th>(?:\s*<th>[^<]*</th>){2}.*?</table>", re.DOTALL
)
FIGURES = re.compile(r"<td>(\d{4}-\d\d-\d\d|[\d.]+ / [\d.]+)")
CODE = re.compile(r"<pre>.*?</pre>|<code>([^<]*)</code>", re.DOTALL)
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_config(config):
    """Leaves out the page for addresses that a server does not find, because the site opens from the disk."""
    config.theme.static_templates.discard("404.html")


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


def on_page_markdown(markdown, **_):
    """Makes links to the pages at the project's root lead to the site's pages."""
    for name, page in ROOT_PAGES.items():
        markdown = markdown.replace(f"](../{name}", f"]({page}")
    return markdown


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
