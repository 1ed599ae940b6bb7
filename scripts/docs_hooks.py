"""Hooks of MkDocs: adds the pages that stand outside docs/, and writes formulas as MathML, which needs no script."""

import html
import pathlib
import re

import latex2mathml.converter
from mkdocs.structure.files import File

ROOT = pathlib.Path(__file__).resolve().parents[1]
ROOT_PAGES = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_files(files, config):
    """Adds the pages at the project's root, with links as seen from docs/."""
    for name, page in ROOT_PAGES.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        for other, other_page in ROOT_PAGES.items():
            text = text.replace(f"]({other}", f"]({other_page}")
        files.append(File.generated(config, page, content=text.replace("](docs/", "](")))
    return files


def on_page_markdown(markdown, **_):
    """Makes links to the pages at the project's root lead to the site's pages."""
    for name, page in ROOT_PAGES.items():
        markdown = markdown.replace(f"](../{name}", f"]({page}")
    return markdown


def on_page_content(content, **_):
    """Writes formulas as MathML."""

    def convert(match):
        display = "block" if match.group(1) == "div" else "inline"
        return latex2mathml.converter.convert(html.unescape(match.group(2)), display=display)

    return FORMULA.sub(convert, content)
