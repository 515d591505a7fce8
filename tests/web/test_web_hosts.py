"""The site on hosts of many kinds: it works, or says what is wrong."""

import re
import shutil
from pathlib import Path

import pytest
from browser import QuietHandler, serve_folder, text_of, wait_for
from conftest import OpenWindow
from playwright.sync_api import Browser, Route

from web.__main__ import SiteHandler

pytestmark = pytest.mark.slow

PAGES = {"": "Read a display", "index.html": "Read a display", "send": "Send from a display",
         "send.html": "Send from a display", "about.html": "How it works"}  # fmt: skip
"""Addresses of pages, and the titles of the pages."""


class CleanHost(QuietHandler):
    """Redirects /index.html to / and /send.html to /send, as many hosts do."""

    def do_GET(self) -> None:  # noqa: N802 - the name that the server calls
        """Answer a request."""
        path = self.path.partition("?")[0]
        if path.endswith(".html"):
            self.send_response(308)
            self.send_header("Location", re.sub(r"(index)?\.html$", "", path))
            self.send_header("Content-Length", "0")
            return self.end_headers()
        if "." not in path and not path.endswith("/"):
            self.path = f"{path}.html"
        return super().do_GET()


class TextHost(QuietHandler):
    """Takes programs for plain text."""

    def guess_type(self, path: object) -> str:
        """Type of a file."""
        return "text/plain" if str(path).endswith(".js") else super().guess_type(str(path))


class StrictHost(QuietHandler):
    """Lets pages run no WebAssembly."""

    def end_headers(self) -> None:
        """Send the policy, too."""
        self.send_header("Content-Security-Policy", "script-src 'self'")
        super().end_headers()


def test_a_host_serves_every_page_again_and_offline(site: Path, browser: Browser) -> None:
    context = browser.new_context()
    page = context.new_page()
    with serve_folder(site, CleanHost) as url:
        page.goto(f"{url}send.html")
        page.evaluate("navigator.serviceWorker.ready.then(() => true)")
        for name, title in PAGES.items():
            page.goto(url + name)
            assert page.title() == title
    for name, title in PAGES.items():  # nobody serves it any more
        page.goto(url + name)
        assert page.title() == title
        wait_for(page, "!document.getElementById('trouble')")
    page.goto(f"{url}send")
    page.locator("#show").click()
    wait_for(page, "Boolean(document.querySelector('iframe')?.contentWindow.player?.ready)")
    context.close()


def test_programs_of_a_wrong_type_are_said_and_the_own_server_has_the_right_one(
    site: Path, open_window: OpenWindow
) -> None:
    page = open_window(390, 844)
    with serve_folder(site, TextHost) as url:
        page.goto(url)
        assert not page.locator("#trouble").is_visible()  # perhaps it is merely slow
        page.evaluate("for (const each of document.getAnimations()) each.currentTime = 5000")
        assert page.locator("#trouble").is_visible()
        assert "text/javascript" in text_of(page, "trouble")
    assert SiteHandler.guess_type(SiteHandler.__new__(SiteHandler), "page.js") == "text/javascript"


def test_a_policy_without_webassembly_is_said_in_plain_words(
    site: Path, open_window: OpenWindow
) -> None:
    page = open_window(390, 844)
    with serve_folder(site, StrictHost) as url:
        page.goto(f"{url}?film=demo.mkv")
        words = "document.getElementById('status').textContent.includes('server forbids')"
        wait_for(page, words)
        assert "wasm-unsafe-eval" in text_of(page, "advice")


@pytest.mark.parametrize("name", ["sending.js", "player.html"])
def test_a_part_of_the_page_that_sends_that_is_missing_is_said(
    name: str, site: Path, open_window: OpenWindow, tmp_path: Path
) -> None:
    page = open_window(390, 844)
    shutil.copytree(site, tmp_path / "web")
    (tmp_path / "web" / name).unlink()
    with serve_folder(tmp_path / "web") as url:
        page.goto(f"{url}send.html")
        page.locator("#show").click()
        wait_for(page, "document.getElementById('status').textContent.includes('is missing:')")
        assert f"{name} is missing on the server" in text_of(page, "status")


def test_a_missing_part_stays_said_when_the_picture_comes_later(
    site: Path, open_window: OpenWindow, tmp_path: Path
) -> None:
    page = open_window(390, 844)
    shutil.copytree(site, tmp_path / "web")
    (tmp_path / "web" / "sending.js").unlink()
    pictures: list[Route] = []
    page.route("**/noon.jpg*", lambda route: pictures.append(route))
    with serve_folder(tmp_path / "web") as url:
        page.goto(f"{url}send.html")
        page.locator("#show").click()
        wait_for(page, "document.getElementById('status').textContent.includes('is missing:')")
        page.evaluate("document.getElementById('preview').width = 1")
        pictures[0].continue_()
        wait_for(page, "document.getElementById('preview').width > 1")
        assert "sending.js is missing on the server" in text_of(page, "status")


def test_a_page_that_stays_open_while_the_site_is_renewed_says_so(
    site: Path, browser: Browser, tmp_path: Path
) -> None:
    """Without a service worker and with one, which then takes over."""
    shutil.copytree(site, tmp_path / "web")
    version = (site / "version.txt").read_text()
    for services in ("block", "allow"):
        context = browser.new_context(service_workers=services)
        page = context.new_page()
        with serve_folder(tmp_path / "web") as url:
            page.goto(f"{url}send.html")
            if services == "allow":
                page.evaluate("navigator.serviceWorker.ready.then(() => true)")
                page.reload()
            newer = f"{services:x<16}"
            for file in (tmp_path / "web").iterdir():
                if file.suffix in (".js", ".html", ".txt"):
                    file.write_text(file.read_text().replace(version, newer))
            if services == "allow":
                page.evaluate("navigator.serviceWorker.ready.then((it) => it.update())")
                wait_for(page, f"caches.keys().then((it) => it.join() === 'receiver-{newer}')")
            page.locator("#show").click()
            wait_for(page, "document.getElementById('status').textContent.includes('renewed')")
            page.reload()
            page.locator("#show").click()
            wait_for(page, "Boolean(document.querySelector('iframe')?.contentWindow.player)")
        version = newer
        context.close()
