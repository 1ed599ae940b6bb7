"""Writes the page: one file that holds everything."""

import base64
import hashlib
import html
import pathlib

FOLDER = pathlib.Path(__file__).parent
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data: blob:; script-src 'sha256-{digest}'"


def single_page(title: str, chunks: dict[str, bytes], photos: list[bytes]) -> str:
    """Returns the page."""
    script = (FOLDER / "viewer.js").read_text(encoding="utf-8")
    style = (FOLDER / "viewer.css").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    data = "".join(
        f'<script type="text/plain" data-chunk="{html.escape(name)}">{base64.b64encode(chunk).decode()}</script>\n'
        for name, chunk in chunks.items()
    )
    data += "".join(
        f'<script type="text/plain" data-photo="{i}">{base64.b64encode(photo).decode()}</script>\n'
        for i, photo in enumerate(photos)
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY.format(digest=digest)}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        '<div id="report"></div>\n<noscript>This report needs JavaScript, which this browser does not run.</noscript>\n'
        f"{data}<script>{script}</script>\n</body>\n</html>\n"
    )
