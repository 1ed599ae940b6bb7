"""Takes pictures of the demo's report: the page with its scene, and the page of a query.

scripts/report_pictures.sh [REPORT]
"""

import io
import pathlib
import sys

from PIL import Image

from browser import open_browsers

MAX_BYTES = 300_000
QUERY = "query/03.jpg"


def save(png: bytes, path: pathlib.Path):
    """Writes a picture with at most 256 colours, because photos make a PNG file large."""
    Image.open(io.BytesIO(png)).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
    if path.stat().st_size > MAX_BYTES:
        sys.exit(f"{path}: {path.stat().st_size} bytes, of at most {MAX_BYTES}")


def main():
    report_path, folder = map(pathlib.Path, sys.argv[1:])
    folder.mkdir(parents=True, exist_ok=True)
    with open_browsers() as start_browser:
        report = start_browser().open(report_path, width=1280, height=860)
        report.page.wait_for_timeout(2000)
        save(report.page.screenshot(), folder / "report.png")
        report.page.evaluate("name => { location.hash = `#query/${name}`; }", QUERY)
        report.page.wait_for_timeout(2000)
        page = report.page.locator(".query-page")
        page.scroll_into_view_if_needed()
        save(page.screenshot(), folder / "report_query.png")
        if report.problems:
            sys.exit("\n".join(report.problems))


if __name__ == "__main__":
    main()
