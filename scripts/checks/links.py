#!/usr/bin/env python3
"""Checks that the links in Markdown files lead to existing files and headings, and that named source files exist."""

import re
import urllib.parse

import tree

FENCE = re.compile(r"^ {0,3}(```+|~~~+).*?^ {0,3}\1[`~]*\s*$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"(`+).+?\1")
LINK = re.compile(r"\[(?:[^\[\]]|\[[^\]]*\])*\]\(\s*<?([^()\s>]+(?:\([^()\s]*\)[^()\s]*)?)>?(?:\s+\"[^\"]*\")?\s*\)")
REFERENCE = re.compile(r"^ {0,3}\[[^\]]+\]:\s*<?(\S+?)>?\s*$", re.MULTILINE)
HTML = re.compile(r"<(?:a|img)\s[^>]*?(?:href|src)=\"([^\"]+)\"")
HEADING = re.compile(r"^ {0,3}#{1,6}\s+(.*?)\s*#*\s*$", re.MULTILINE)
# Matches `folder/file.cc` in code, but not placeholders such as `configs/NAME.py`.
SOURCE_PATH = re.compile(r"`([\w.-]+(?:/[\w.-]+)*/(?![A-Z]+\.(?!md))[\w.-]+\.(?:cc|h|py|sh|md))`")
HTML_ANCHOR = re.compile(r"<a\s[^>]*?(?:id|name)=\"([^\"]+)\"")


def keep_lines(match):
    """Replaces a match by blanks so that line numbers stay."""
    return re.sub(r"[^\n]", " ", match.group())


def anchors(text):
    """Returns the anchors of a file as GitHub makes them from its headings."""
    text = FENCE.sub(keep_lines, text)
    found, counts = set(HTML_ANCHOR.findall(text)), {}
    for heading in HEADING.findall(text):
        heading = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)  # a link counts by its text
        slug = re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        count = counts.get(slug, 0)
        counts[slug] = count + 1
        found.add(f"{slug}-{count}" if count else slug)
    return found


def link_problems(path, text):
    """Returns (position, message) of the links that lead nowhere."""
    text = CODE.sub(keep_lines, text)
    for match in (match for pattern in (LINK, REFERENCE, HTML) for match in pattern.finditer(text)):
        link = match.group(1)
        if re.match(r"[a-z][a-z0-9+.-]*:|//", link):
            continue
        target, _, anchor = urllib.parse.unquote(link).partition("#")
        file = (path.parent / target).resolve() if target else path
        if not file.exists():
            yield match.start(), f"no such file: {link}"
        elif anchor and file.suffix == ".md" and anchor not in anchors(file.read_text(encoding="utf-8")):
            yield match.start(), f"no such heading: {link}"


def source_problems(root, path, text):
    """Returns (position, message) of named source files that do not exist; a changelog may name former ones."""
    if path.name == "CHANGELOG.md":
        return
    for match in SOURCE_PATH.finditer(text):
        folders = (root, path.parent, root / "src" / "colmap_lazyloc")
        if not any((folder / match.group(1)).exists() for folder in folders):
            yield match.start(), f"no such source file: {match.group(1)}"


def file_problems(root, path):
    """Returns the problems of one file, sorted by position."""
    text = FENCE.sub(keep_lines, path.read_text(encoding="utf-8"))
    found = sorted([*link_problems(path, text), *source_problems(root, path, text)])
    return [f"{path}:{text.count(chr(10), 0, position) + 1}: {message}" for position, message in found]


def main():
    """Checks all Markdown files."""
    root = tree.parse_root(__doc__)
    files = tree.list_files(root, "*.md")
    tree.finish("links", [problem for path in files for problem in file_problems(root, path)], f"{len(files)} files")


if __name__ == "__main__":
    main()
