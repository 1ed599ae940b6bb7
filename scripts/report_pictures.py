"""Takes pictures of the demo's report, light and dark: the page with its scene, and the page of a query.

scripts/report_pictures.sh [REPORT]
"""

import io
import pathlib
import sys

from PIL import Image

from browser import open_browsers

MAX_BYTES = 300_000
QUERY = "query/03.jpg"
WIDTH, HEIGHT = 1280, 1000
ROOT = pathlib.Path(__file__).resolve().parents[1]
# Shows paths as seen from the project's folder, wherever this is.
SHORTEN_PATHS = """root => document.querySelectorAll("pre").forEach(
    element => { element.textContent = element.textContent.replaceAll(root, ""); })"""


def save(png: bytes, path: pathlib.Path):
    """Writes a picture; with 256 colours if it is too large, because photos make a PNG file large."""
    if len(png) <= MAX_BYTES:
        path.write_bytes(png)
        return
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture.quantize(256, kmeans=8, dither=Image.Dither.NONE).save(path, optimize=True)
    if path.stat().st_size > MAX_BYTES:
        sys.exit(f"{path}: {path.stat().st_size} bytes, of at most {MAX_BYTES}")


def main():
    report_path, folder = map(pathlib.Path, sys.argv[1:])
    folder.mkdir(parents=True, exist_ok=True)
    with open_browsers() as start_browser:
        for scheme, suffix in (("light", ""), ("dark", "_dark")):
            report = start_browser().open(report_path, width=WIDTH, height=HEIGHT, color_scheme=scheme)
            report.page.evaluate("name => { location.hash = `#query/${name}`; }", QUERY)
            report.page.evaluate("() => scrollTo(0, 0)")
            report.page.wait_for_timeout(3000)
            workspace = report.page.locator(".workspace").bounding_box()
            # What floats above the page is at the bottom of the window.
            height = round(workspace["y"] + workspace["height"]) + 20
            report.page.set_viewport_size({"width": WIDTH, "height": height})
            report.page.wait_for_timeout(1000)
            save(report.page.screenshot(), folder / f"report{suffix}.png")
            report.page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
            report.page.evaluate(SHORTEN_PATHS, f"{ROOT}/")
            save(report.page.locator(".query-page").screenshot(), folder / f"report_query{suffix}.png")
            if report.problems:
                sys.exit("\n".join(report.problems))


if __name__ == "__main__":
    main()
