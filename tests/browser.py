"""Chromium without a window, pages that it opens, and a server of the folder that it shows."""

import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from playwright.sync_api import Page

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
"""Names of the programs that are looked for, the first one first."""
BROWSER_FLAGS = [
    "--no-sandbox",  # tests may run as root
    "--disable-gpu",
    "--disable-quic",
    "--disable-sync",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
]
"""Flags with which Chromium is started."""


def find_browser() -> str | None:
    """Path of the machine's Chromium, or None where there is none."""
    return next((path for path in map(shutil.which, BROWSERS) if path), None)


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves a folder's files, and prints nothing."""

    def log_message(self, *_: object) -> None:
        """Leave out the line that is usually printed for each request."""

    def copyfile(self, source: Any, outputfile: Any) -> None:
        """Send a file, or as much of it as the browser wants before it leaves the page."""
        with suppress(ConnectionError):
            super().copyfile(source, outputfile)


@contextmanager
def serve_folder(folder: Path, kind: type[QuietHandler] = QuietHandler) -> Iterator[str]:
    """Serve a folder to this machine alone, as a kind of host does; gives its address.

    The address ends with a slash.
    """
    handler = partial(kind, directory=folder)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/"
        finally:
            server.shutdown()


@contextmanager
def open_page(browser, flags=(), worker=None, width=390, height=844, offline=False, **more):
    """Open a window, in a browser of its own with flags; ``worker`` stands in for the page's."""
    program, all_flags = find_browser(), [*BROWSER_FLAGS, *flags]
    own = browser.browser_type.launch(executable_path=program, args=all_flags) if flags else browser
    services = "allow" if offline else "block"
    context = own.new_context(
        viewport={"width": width, "height": height}, service_workers=services, **more
    )
    page = context.new_page()
    page.dialogs = []
    page.on("dialog", lambda dialog: (page.dialogs.append(dialog.message), dialog.dismiss()))
    page.requested = []
    page.on("request", lambda request: page.requested.append(request.url))
    page.errors = []
    page.on("pageerror", lambda error: page.errors.append(str(error)))
    if worker is not None:
        script = {"content_type": "text/javascript", "body": worker}
        page.route("**/worker.js*", lambda route: route.fulfill(**script))
    try:
        yield page
        assert page.dialogs == page.errors == []
    finally:
        context.close()
        if flags:
            own.close()


def text_of(page: "Page", name: str) -> str:
    """Text of the element of a page that has an id."""
    script = "name => document.getElementById(name).textContent"
    return str(page.evaluate(script, name))


PATIENCE_S = 200.0
"""Time, in seconds, that a loaded machine may take for what takes a few."""


def wait_for(page: "Page", condition: Callable[[], object] | str) -> None:
    """Wait until a function, or a script in the page, gives something true.

    Playwright's own way is refused by the pages' policy.
    """
    deadline = time.monotonic() + PATIENCE_S
    while not (page.evaluate(condition) if isinstance(condition, str) else condition()):
        assert time.monotonic() < deadline, page.inner_text("body")
        page.wait_for_timeout(20)
