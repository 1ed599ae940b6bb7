"""Drives headless Chromium for tests of the report page: from file://, without a network."""

import contextlib
import dataclasses
import pathlib
import shutil
import time

from playwright.sync_api import Page, sync_playwright

ARGUMENTS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)


def chromium_path() -> str | None:
    """Returns the program of Debian's package, or None."""
    return shutil.which("chromium")


@dataclasses.dataclass
class OpenedReport:
    """A report in a browser, and what went wrong there: console errors, exceptions, requests beyond the report."""

    page: Page
    folder: pathlib.Path
    problems: list[str] = dataclasses.field(default_factory=list)

    def state(self) -> dict:
        """Returns the page's account of itself."""
        return self.page.evaluate("() => window.report.state()")

    def wait_for(self, function: str, argument=None, seconds: float = 30):
        """Waits until a function in JavaScript is true. Playwright's own waiting needs eval, which the page forbids."""
        deadline = time.monotonic() + seconds
        while not self.page.evaluate(function, argument):
            assert time.monotonic() < deadline, f"never true: {function}"
            self.page.wait_for_timeout(50)

    def select_by_address(self, query: int):
        """Writes a query's name into the address, and waits until it is selected."""
        self.page.evaluate(
            """query => { location.hash =
              '#query/' + window.report.data.queries.names[query].split('/').map(encodeURIComponent).join('/'); }""",
            query,
        )
        self.wait_for_selected(query)

    def wait_for_selected(self, query: int):
        self.wait_for("query => window.report.state().selected === query", query)

    def watch(self):
        """Notes every problem from now on."""
        self.page.on("console", lambda message: message.type == "error" and self.problems.append(message.text))
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("dialog", lambda dialog: (self.problems.append(f"dialog {dialog.message}"), dialog.dismiss()))
        self.page.on("request", self._check_request)

    def _check_request(self, request):
        allowed = ("data:", "blob:", self.folder.as_uri())
        if not request.url.startswith(allowed):
            self.problems.append(f"request {request.url}")


@contextlib.contextmanager
def open_browsers():
    """Yields a function that starts headless Chromium with further arguments; all are closed at the end."""
    with sync_playwright() as playwright, contextlib.ExitStack() as stack:

        def start(*arguments: str) -> Browser:
            program = playwright.chromium.launch(executable_path=chromium_path(), args=(*ARGUMENTS, *arguments))
            stack.callback(program.close)
            return Browser(program)

        yield start


class Browser:
    """Headless Chromium, without a network."""

    def __init__(self, program):
        self._program = program

    def open(self, path: pathlib.Path, fragment: str = "", width=1280, height=800, **options) -> OpenedReport:
        """Opens a report and waits until it shows its queries."""
        report = self.open_any(path, fragment, width, height, **options)
        report.wait_for("() => window.report?.state?.()?.viewer", seconds=120)
        return report

    def open_any(self, path: pathlib.Path, fragment: str = "", width=1280, height=800, **options) -> OpenedReport:
        """Opens a page, offline; `options` are those of a browser context."""
        context = self._program.new_context(viewport={"width": width, "height": height}, offline=True, **options)
        path = path.resolve()
        report = OpenedReport(context.new_page(), path.parent)
        report.watch()
        report.page.goto(path.as_uri() + fragment)
        return report
