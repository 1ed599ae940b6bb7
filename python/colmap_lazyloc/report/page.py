"""Makes the page: one file that holds everything, or a folder whose files are loaded when they are needed."""

import base64
import hashlib
import html
import json
import pathlib
from collections.abc import Iterator

from colmap_lazyloc.errors import InputError
from colmap_lazyloc.report.output import write_file

FOLDER = pathlib.Path(__file__).parent
PAGE_NAME = "index.html"  # in a folder
LINKS = '<nav id="links">'  # begins the line with links to other pages
# A page may run its own script only, which its digest names, and load nothing; a folder also its own files.
POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data: blob:{files}; script-src 'sha256-{digest}'{files}"
)


def single_page(title: str, chunks: dict[str, bytes], photos: list[bytes]) -> Iterator[str]:
    """Returns the pieces of the page."""
    head, script = _head_and_script(title, False)
    yield head
    for name, chunk in chunks.items():
        yield f'<script type="text/plain" data-chunk="{html.escape(name)}">{_base64(chunk)}</script>\n'
    for i, photo in enumerate(photos):
        yield f'<script type="text/plain" data-photo="{i}">{_base64(photo)}</script>\n'
    yield script


def page_files(title: str, chunks: dict[str, bytes], photos: list[bytes]) -> Iterator[tuple[str, bytes]]:
    """Returns the files of a folder: names and contents."""
    yield PAGE_NAME, "".join(_head_and_script(title, True)).encode()
    for name, chunk in chunks.items():
        yield f"chunks/{name}.js", f"report.addChunk({json.dumps(name)}, {json.dumps(_base64(chunk))});\n".encode()
    for i, photo in enumerate(photos):
        yield f"photos/{i}.jpg", photo


def set_links(page: pathlib.Path, links: str) -> None:
    """Writes HTML with links to other pages at the top of a page, in place of those that it has."""
    with page.open("rb") as lines:
        begin, text = LINKS.encode(), f"{LINKS}{links}</nav>\n".encode(errors="replace")
        write_file(page, (text if line.startswith(begin) else line for line in lines))


def read_links(page: pathlib.Path) -> str:
    """Returns the HTML with links that `set_links` has written into a page; empty if there is none."""
    if not page.is_file():
        return ""
    with page.open("rb") as lines:
        line = next((line for line in lines if line.startswith(LINKS.encode())), b"")
    return line.decode().removeprefix(LINKS).removesuffix("</nav>\n")


def _head_and_script(title: str, is_split: bool) -> tuple[str, str]:
    """Returns what stands before the data, and after it."""
    try:
        script, style = ((FOLDER / name).read_text(encoding="utf-8") for name in ("viewer.js", "viewer.css"))
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read: {error.strerror}; is the package incomplete?") from None
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = POLICY.format(digest=digest, files=" 'self' file:" if is_split else "")
    return (
        f'<!doctype html>\n<html lang="en"{" data-split" if is_split else ""}>\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        f'{LINKS}</nav>\n<div id="report"></div>\n'
        "<noscript>This report needs JavaScript, which this browser does not run.</noscript>\n"
    ), f"<script>{script}</script>\n</body>\n</html>\n"


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()
