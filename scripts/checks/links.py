#!/usr/bin/env python3
"""Checks that the relative links of Markdown files lead to files and headings that are there."""

import re
import urllib.parse

import tree

FENCE = re.compile(r"^ {0,3}(```+|~~~+).*?^ {0,3}\1[`~]*\s*$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"(`+).+?\1")
LINK = re.compile(r"\[(?:[^\[\]]|\[[^\]]*\])*\]\(\s*<?([^()\s>]+(?:\([^()\s]*\)[^()\s]*)?)>?(?:\s+\"[^\"]*\")?\s*\)")
REFERENCE = re.compile(r"^ {0,3}\[[^\]]+\]:\s*<?(\S+?)>?\s*$", re.MULTILINE)
HTML = re.compile(r"<(?:a|img)\s[^>]*?(?:href|src)=\"([^\"]+)\"")
HEADING = re.compile(r"^ {0,3}#{1,6}\s+(.*?)\s*#*\s*$", re.MULTILINE)
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


def file_problems(path):
    """Returns the links of one file that lead nowhere."""
    text = FENCE.sub(keep_lines, path.read_text(encoding="utf-8"))
    text = CODE.sub(keep_lines, text)
    matches = [match for pattern in (LINK, REFERENCE, HTML) for match in pattern.finditer(text)]
    for match in sorted(matches, key=lambda match: match.start()):
        link = match.group(1)
        if re.match(r"[a-z][a-z0-9+.-]*:|//", link):
            continue
        target, _, anchor = urllib.parse.unquote(link).partition("#")
        file = (path.parent / target).resolve() if target else path
        line = text.count("\n", 0, match.start()) + 1
        if not file.exists():
            yield f"{path}:{line}: no such file: {link}"
        elif anchor and file.suffix == ".md" and anchor not in anchors(file.read_text(encoding="utf-8")):
            yield f"{path}:{line}: no such heading: {link}"


def main():
    """Checks all Markdown files."""
    files = tree.list_files(tree.parse_root(__doc__), "*.md")
    tree.finish("links", [problem for path in files for problem in file_problems(path)], f"{len(files)} files")


if __name__ == "__main__":
    main()
