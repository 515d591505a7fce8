"""The page in Chromium without a window, before a simulated camera that plays a film."""

import shutil
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from link.errors import InputError

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
    """Serves a folder's files, and others by their names, and prints nothing."""

    def __init__(self, *request: Any, others: Mapping[str, Path], directory: Path) -> None:
        self._others = others
        super().__init__(*request, directory=directory)

    def translate_path(self, path: str) -> str:
        """Tell which file an address names."""
        return str(self._others.get(path[1:]) or super().translate_path(path))

    def log_message(self, *_: object) -> None:
        """Leave out the line that is usually printed for each request."""

    def copyfile(self, source: Any, outputfile: Any) -> None:
        """Send a file, or as much of it as the browser wants before it leaves the page."""
        with suppress(ConnectionError):
            super().copyfile(source, outputfile)


@contextmanager
def serve_folder(folder: Path, others: Mapping[str, Path] | None = None) -> Iterator[str]:
    """Serve a folder to this machine alone; gives its address, which ends with a slash.

    Args:
        folder: the folder.
        others: more files, by the names that they have beside those of the folder.
    """
    handler = partial(QuietHandler, others=others or {}, directory=folder)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/"
        finally:
            server.shutdown()


@contextmanager
def open_chromium(flags: Sequence[str] = ()) -> Iterator["Page"]:
    """Open a window of the size of a phone in a Chromium of its own, without a page yet.

    Args:
        flags: more flags for Chromium.

    Raises:
        InputError: Playwright or Chromium is missing.
    """
    try:
        playwright_api = import_module("playwright.sync_api")
    except ModuleNotFoundError:
        raise InputError(
            "Playwright is missing, which drives Chromium; pip install -e '.[test]'"
        ) from None
    program = find_browser()
    if program is None:
        raise InputError(
            f"no Chromium: found none of {', '.join(BROWSERS)}; apt install chromium, or your "
            "system's way"
        )
    with playwright_api.sync_playwright() as playwright, TemporaryDirectory() as profile:
        chromium = playwright.chromium.launch_persistent_context(
            profile,  # without one, nothing that was compiled is kept
            executable_path=program,
            args=[*BROWSER_FLAGS, *flags],
            viewport={"width": 390, "height": 844},
            service_workers="block",
        )
        try:
            yield chromium.pages[0]
        finally:
            chromium.close()


def text_of(page: "Page", name: str) -> str:
    """Text of the element of a page that has an id."""
    script = "name => document.getElementById(name).textContent"
    return str(page.evaluate(script, name))
