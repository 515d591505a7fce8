"""The page in Chromium: what it shows, and that it reads films and cameras."""

import functools
import json
import re
import shutil
import struct
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from browser import PATIENCE_S, open_page, serve_folder, text_of, wait_for
from pilot_films import TEXT, filmed, robust_film
from stand_in import CORNERS, answering, arrived, with_comlink
from web_films import limited, write_film, write_y4m

from link.code.authenticate import sign
from link.code.framing import encode
from link.presets import PRESETS

pytestmark = pytest.mark.slow

CAMERA, ALLOWED = "--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream"
FILMING = CAMERA, ALLOWED, "--use-file-for-fake-video-capture={}"
"""Flags: a simulated camera, which every page may use unasked, and which plays a film."""


@pytest.fixture(scope="module")
def address(site, tmp_path_factory) -> Iterator[tuple[str, Path]]:
    """The address of the served site, and the folder that is served."""
    folder = tmp_path_factory.mktemp("served")
    shutil.copytree(site, folder, dirs_exist_ok=True)
    with serve_folder(folder) as url:
        yield url, folder


@pytest.fixture(scope="module")
def short_film(address) -> str:
    """Address of the page that reads a film of gray noise, 40 frames of 64 x 48."""
    url, folder = address
    noise = np.random.default_rng(0).integers(0, 256, (40, 48, 64)).astype(np.uint8)
    write_film(folder / "short.mkv", noise)
    return f"{url}?film=short.mkv"


WATCH = """window.said = [];
addEventListener("DOMContentLoaded", () => {
  const parts = ["status", "percent", "outline"].map((name) => document.getElementById(name));
  const seen = () => parts.map((part) => part.getAttribute("points") ?? part.textContent);
  const options = { subtree: true, childList: true, characterData: true, attributes: true };
  new MutationObserver(() => window.said.push(seen())).observe(document.body, options);
});"""


def test_the_page_says_what_is_going_on(browser, short_film) -> None:
    found = {"corners": CORNERS, "preset": "robust", "found": 10}
    answers = [{}] * 5 + [found] * 8 + [{**found, "synchronised": True, "progress": 0.42}] * 8
    with open_page(browser, worker=answering(*answers, arrived("done"))) as page:
        page.add_init_script(WATCH)
        page.goto(short_film)
        wait_for(page, lambda: text_of(page, "message"))
        said = [tuple(seen) for seen in page.evaluate("said")]
        outline = "10,8 50,6 52,40 9,41"
        expected = [
            ("Looking for the display", "0 %", ""),
            ("Display found, hold still", "15 %", outline),
            ("Receiving the message", "43 %", outline),
        ]
        assert [seen for seen in dict.fromkeys(said) if seen in expected] == expected
        assert text_of(page, "status") == "Message received"
        assert page.locator("#message").is_visible()


@contextmanager
def received(browser, short_film, text, **more):
    """A page that has received a message."""
    with open_page(browser, worker=answering(arrived(text)), **more) as page:
        page.goto(short_film)
        wait_for(page, lambda: text_of(page, "status") == "Message received")
        yield page


HOSTILE = "<img src=x onerror=alert(1)><script>alert(2)</script>\u202ejavascript:alert(3)"


def test_a_hostile_message_is_shown_as_text(browser, short_film) -> None:
    with received(browser, short_film, HOSTILE) as page:
        assert text_of(page, "message") == HOSTILE
        assert page.evaluate("document.getElementById('message').childElementCount") == 0
        assert not page.locator("#open").is_visible()
        page.wait_for_timeout(300)  # an image would have failed by now
    assert not [url for url in page.requested if not url.startswith(short_film.split("?")[0])]


def test_a_link_can_be_opened_and_says_where_it_leads(browser, short_film) -> None:
    text = "https://example.org/path?x=1"
    with received(browser, short_film, text) as page:
        link = page.locator("#open")
        assert link.inner_text() == "Open example.org"
        assert link.get_attribute("href") == text
        assert "noopener" in link.get_attribute("rel")


UNSEEN = {"a bell\u0007": "cannot be seen or", "\u05e9\u05dc\u05d5\u05dd" + "long " * 13_000: ""}


@pytest.mark.parametrize("text", UNSEEN, ids=["bell", "long"])
def test_what_cannot_be_seen_in_a_message_is_said(text, browser, short_film) -> None:
    with received(browser, short_film, text) as page:
        assert text_of(page, "message") == text
        assert UNSEEN[text] in text_of(page, "note")
        assert page.locator("#note").is_visible() == bool(UNSEEN[text])
        assert page.evaluate("document.documentElement.scrollHeight") < 3000


def test_what_a_worker_without_a_browser_it_knows_says_is_shown(browser, short_film) -> None:
    worker = with_comlink("expose({ load() { throw new Error('no WebAssembly'); } });")
    with open_page(browser, worker=worker) as page:
        page.goto(short_film)
        wait_for(page, lambda: "cannot work" in text_of(page, "status"))
        assert text_of(page, "advice").startswith("No WebAssembly.")


def test_a_machine_without_a_camera_is_told_so(browser, address) -> None:
    with open_page(browser, [ALLOWED], worker=answering({})) as page:
        page.goto(address[0])
        wait_for(page, lambda: text_of(page, "status") == "No camera")
        assert text_of(page, "advice").startswith("No camera was found")
        assert page.get_by_role("button", name="Try the camera again").is_visible()
        with page.expect_file_chooser():
            page.get_by_role("button", name="Read a film instead").click()


def test_a_refused_camera_is_explained(browser, address) -> None:
    with open_page(browser, [CAMERA], worker=answering({}), permissions=[]) as page:
        page.goto(address[0])
        wait_for(page, lambda: text_of(page, "status") == "No camera")
        assert "Allow it in the browser's settings" in text_of(page, "advice")
        page.get_by_role("button", name="Try the camera again").click()
        wait_for(page, lambda: text_of(page, "status") == "No camera")


def write_silence(file: Path) -> None:
    """A second of silence, of the kind that the file's name says."""
    with av.open(file, "w") as container:
        stream = container.add_stream("aac" if file.suffix == ".mp4" else "pcm_s16le", rate=8000)
        silence = av.AudioFrame.from_ndarray(np.zeros((1, 8000), np.float32), "fltp", "mono")
        silence.sample_rate = 8000
        container.mux(stream.encode(silence))
        container.mux(stream.encode())


def test_what_is_no_film_is_refused_in_plain_words(browser, address) -> None:
    folder = address[1]
    (folder / "empty.webm").touch()
    write_silence(folder / "sound.wav")
    write_silence(folder / "sound.mp4")
    with open_page(browser, worker=answering({})) as page:
        for film_name, why in (
            ("https://example.org/a.mp4", "same site"),
            ("none.mp4", "There is no film"),
            ("presets.json", "The file is no film"),
            ("empty.webm", "The file is empty"),
            ("sound.wav", "The file is no film"),
            ("sound.mp4", "The file has no picture"),
        ):
            page.goto(f"{address[0]}?film={film_name}")
            wait_for(page, lambda: text_of(page, "status") == "The film cannot be read")
            assert why in text_of(page, "advice")
            assert page.locator("#start").is_visible()
        assert not [url for url in page.requested if "example.org/a" in url and "?film" not in url]


def noise(count: int) -> np.ndarray:
    """Images of noise, 160 x 120."""
    return np.random.default_rng(3).integers(0, 256, (count, 120, 160), np.uint8)


def test_every_frame_of_a_film_is_read(browser, address) -> None:
    write_film(address[1] / "noise.mp4", noise(45))
    with open_page(browser, worker=answering({})) as page:
        page.goto(f"{address[0]}?film=noise.mp4")
        wait_for(page, lambda: text_of(page, "status") == "No display found in this film")
        assert "45 frames read, 0 skipped" in text_of(page, "details")


def test_a_damaged_film_is_said_to_be_damaged(browser, address) -> None:
    folder = address[1]
    film = folder / "whole.mp4"
    write_film(film, noise(30))
    content = film.read_bytes()
    middle = len(content) // 2
    (folder / "hole.mp4").write_bytes(
        content[:middle] + bytes(len(content) // 4) + content[middle + len(content) // 4 :]
    )
    (folder / "cut.mp4").write_bytes(content[:middle])
    with open_page(browser, worker=answering({})) as page:
        for name, why in (
            ("hole.mp4", "It cannot be read on from frame"),
            ("cut.mp4", "no picture"),
        ):
            page.goto(f"{address[0]}?film={name}")
            wait_for(page, lambda: text_of(page, "status") == "The film cannot be read")
            assert why in text_of(page, "advice")


def test_the_tab_key_reaches_every_control(browser, short_film) -> None:
    with received(browser, short_film, "https://example.org") as page:
        page.locator("summary").click()
        reached = set()
        for _ in range(20):
            page.keyboard.press("Tab")
            reached.add(
                page.evaluate("document.activeElement.id || document.activeElement.tagName")
            )
        assert {"open", "copy", "keep", "again", "start", "SUMMARY", "film", "key"} <= reached


# The real worker


def test_a_phone_loads_no_more_than_promised(site) -> None:
    """Or `build_site` would have refused; all files but the service worker are kept for offline."""
    files = {file.relative_to(site).as_posix() for file in site.rglob("*") if file.is_file()}
    graphs = {"models/film.onnx", "models/region.onnx"}
    assert {"index.html", "worker.js", "licences.txt", *graphs} <= files
    worker = (site / "serviceWorker.js").read_text()
    assert all(name in worker for name in files - {"serviceWorker.js"})


KEY = bytes(range(32))


@functools.cache
def signed_film() -> list[np.ndarray]:
    """A second of a display that shows "Hello", signed, by the preset robust."""
    layout = PRESETS["robust"].layout
    bits = encode(sign(b"Hello", KEY, 7), layout.n_bits, signed=True)
    return filmed(layout, 30, seed=3, message=bits)[0]


ONES = (1 << 16, 1 << 16, 1 << 30) * 3
"""What stands for 1 in the matrix of a track's header (ISO/IEC 14496-12, 8.3.2)."""


def turn_upright(film: Path) -> None:
    """Write into a film of the kind .mp4 that it is to be shown turned clockwise by 90 degrees."""
    unturned, turned = (
        struct.pack(">9i", *(one * number for one, number in zip(ONES, matrix, strict=True)))
        for matrix in ((1, 0, 0, 0, 1, 0, 0, 0, 1), (0, 1, 0, -1, 0, 0, 0, 0, 1))
    )
    content = film.read_bytes()
    track = content.index(b"tkhd")
    film.write_bytes(content[:track] + content[track:].replace(unturned, turned, 1))


@pytest.fixture(scope="module")
def reader(browser, address):
    """The page with its own worker, at the address of a film whose name says nothing of its kind.

    It must have no errors, and ask nothing of anybody else.
    """
    url, folder = address
    film = folder / "film.mp4"
    write_film(film, signed_film())
    turn_upright(film)
    film.rename(folder / "coded")
    with open_page(browser, width=1280) as page:
        page.on("console", lambda said: said.type == "error" and page.errors.append(said.text))
        page.goto(f"{url}?film=coded")
        yield page
    assert all(request.startswith((url, "blob:")) for request in page.requested)


def test_the_message_of_a_film_at_an_address_is_shown(reader) -> None:
    """No frame is lost, however slow the machine."""
    wait_for(reader, lambda: text_of(reader, "message"))
    assert text_of(reader, "message") == "Hello"
    assert text_of(reader, "seal") == "It is signed, not checked: that needs its key."
    assert "480 × 640 pixels, 30.0 frames a second" in text_of(reader, "details")
    assert " 0 skipped" in text_of(reader, "details")


WITHOUT = {
    "rgba": "delete self.MediaStreamTrackProcessor; delete self.VideoFrame;",
    "frame": "delete self.MediaStreamTrackProcessor;",
}
"""Scripts that take from a browser what some do not have, by what the worker is given then."""
GIVEN = """
expose({
  load() {},
  warm() {},
  start() {},
  record: () => null,
  async take(pixels) {
    const [[kind, given]] = Object.entries(pixels);
    const levels = given.data ?? new Uint8Array(given.allocationSize());
    if (!given.data) await given.copyTo(levels);
    const text = JSON.stringify([kind, levels[0], given.colorSpace?.fullRange ?? null]);
    const arrival = { data: new TextEncoder().encode(text), refused: null, stamp: null };
    return { width: 64, height: 48, corners: null, bits: null, found: 0, progress: 1,
      explanation: "", arrival };
  },
});
"""
"""A worker that says what it was given as a message: its kind, a pixel's level, and its range."""


@pytest.mark.parametrize("kind", WITHOUT)
def test_browsers_without_something_give_the_camera_s_frames_too(
    kind, browser, address, tmp_path
) -> None:
    """The film's range is limited, as cameras have it: browsers take it to be when they draw it."""
    even = np.full((20, 48, 64), 64, np.uint8)
    write_y4m(tmp_path / "film.y4m", limited(even))
    flags = [flag.format(tmp_path / "film.y4m") for flag in FILMING]
    with open_page(browser, flags, worker=with_comlink(GIVEN)) as page:
        page.add_init_script(WITHOUT[kind])
        page.goto(address[0])
        wait_for(page, lambda: text_of(page, "message"))
        given, level, full_range = json.loads(text_of(page, "message"))
    assert given == kind
    assert abs(level - (64 if kind == "rgba" or full_range else limited(even)[0, 0, 0])) <= 1


def test_a_film_without_a_display_is_said_to_have_none(reader, tmp_path) -> None:
    """It shows a wall with a picture on it."""
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.uniform(0, 255, (480, 640)), (0, 0), 20)
    image = cv2.normalize(image, None, 60, 190, cv2.NORM_MINMAX)
    cv2.rectangle(image, (200, 120), (440, 330), 225.0, -1)
    frames = [np.clip(image + rng.normal(0, 2, image.shape), 0, 255) for _ in range(30)]
    write_film(tmp_path / "wall.mkv", [frame.astype(np.uint8) for frame in frames])
    reader.locator("#film").set_input_files(tmp_path / "wall.mkv")
    wait_for(reader, lambda: text_of(reader, "status") == "No display found in this film")
    assert "Fit the whole display into the frame" in text_of(reader, "advice")
    assert "mirrored" in text_of(reader, "advice")
    assert text_of(reader, "message") == ""


ODD_CAMERA = """
window.locks = [];
const request = async () => (locks.push("asked"), { release: async () => {} });
Object.defineProperty(navigator, "wakeLock", { value: { request } });
const Processor = MediaStreamTrackProcessor;
window.MediaStreamTrackProcessor = class {
  constructor({ track }) {
    window.track = track;
    const frames = new Processor({ track }).readable.getReader();
    this.readable = new ReadableStream({
      async pull(to) {
        for (;;) {
          const { value, done } = await frames.read();
          if (done) return to.close();
          if (!window.silent) return to.enqueue(value);
          value.close();
        }
      },
    });
  }
};
"""
"""Script that lets the test silence the camera (``silent``), and counts how often the display is
asked to stay on."""


def test_a_camera_that_falls_silent_is_said_and_can_be_started_again(browser, address) -> None:
    """Help comes after ten seconds in vain; the display is kept on again, the camera remembered."""
    flags = ["--use-fake-device-for-media-stream=device-count=3", ALLOWED]
    with open_page(browser, flags, worker=answering({})) as page:
        page.clock.install()
        page.add_init_script(ODD_CAMERA)
        page.goto(address[0])
        wait_for(page, lambda: text_of(page, "status") == "Looking for the display")
        assert page.locator("#how").is_visible() and not page.locator("#vain").is_visible()
        page.evaluate("window.silent = true")
        page.clock.fast_forward(3_000)
        wait_for(page, lambda: text_of(page, "status") == "The camera sends no pictures")
        assert page.get_by_role("button", name="Start the camera again").is_visible()
        page.evaluate("window.silent = false")
        wait_for(page, lambda: text_of(page, "status") == "Looking for the display")
        wait_for(page, lambda: not page.locator("#start").is_visible())
        page.evaluate("document.dispatchEvent(new Event('visibilitychange'))")
        assert page.evaluate("locks.length") == 2
        page.clock.fast_forward(10_000)
        wait_for(page, lambda: page.locator("#vain").is_visible())
        assert not page.locator("#how").is_visible()
        choice = page.locator("#controls select")
        chosen = choice.locator("option").last.get_attribute("value")
        choice.select_option(chosen)
        used = "window.track?.getSettings().deviceId"
        wait_for(page, lambda: page.evaluate(used) == chosen)
        page.reload()
        wait_for(page, lambda: page.evaluate(used) == chosen)
        page.add_init_script("HTMLMediaElement.prototype.play = () => new Promise(() => {})")
        page.reload()  # now no picture comes at all
        wait_for(page, lambda: text_of(page, "status") == "The camera sends no pictures")
        assert page.get_by_role("button", name="Start the camera again").is_visible()


def test_what_the_camera_sees_is_read_and_can_be_saved(browser, address, tmp_path) -> None:
    film = tmp_path / "robust.y4m"
    write_y4m(film, robust_film(90)[0])
    with open_page(browser, [flag.format(film) for flag in FILMING]) as page:
        page.goto(address[0])
        wait_for(page, lambda: page.evaluate("!document.getElementById('record').disabled"))
        page.locator("summary").click()
        with page.expect_download(timeout=1e3 * PATIENCE_S) as download:
            page.get_by_role("button", name="Save what the camera sees").click()
        download.value.save_as(tmp_path / "saved.tar")
        wait_for(page, lambda: text_of(page, "message"))
        assert text_of(page, "message") == TEXT.decode()
        assert text_of(page, "status") == "Message received"
    with tarfile.open(tmp_path / "saved.tar") as archive:
        archive.extractall(tmp_path, filter="data")
    about = json.loads((tmp_path / "about.json").read_text())
    assert about["versions"]["onnxruntime-web"] and "Chrome" in about["browser"]
    assert about["camera"]["width"] == 640
    assert 1 <= len(about["times"]) <= 200
    assert (np.diff(about["times"]) > 0).all()
    saved = (tmp_path / "film.y4m").read_bytes()
    start = saved.index(b"\n", saved.index(b"FRAME")) + 1
    frame = saved[start : start + 640 * 480]
    assert frame in film.read_bytes()  # bit for bit


def test_only_messages_with_the_key_are_shown(reader, tmp_path) -> None:
    (tmp_path / "key").write_bytes(KEY)
    (tmp_path / "other").write_bytes(bytes(32))
    (tmp_path / "short").write_bytes(bytes(3))
    write_film(tmp_path / "film.mkv", signed_film())
    reader.locator("summary").click()
    age = reader.get_by_label("largest age of a message")
    assert age.is_disabled()  # only a message with a key has an age
    reader.locator("#key").set_input_files(tmp_path / "short")
    assert text_of(reader, "status") == "This file is no key"
    reader.locator("#key").set_input_files(tmp_path / "other")
    reader.locator("#film").set_input_files(tmp_path / "film.mkv")
    wait_for(reader, lambda: text_of(reader, "status") == "A message was refused")
    assert text_of(reader, "advice").startswith("The tag does not fit; made without")
    assert text_of(reader, "message") == ""
    reader.locator("#key").set_input_files(tmp_path / "key")
    wait_for(reader, lambda: text_of(reader, "message") == "Hello")
    assert text_of(reader, "seal") == "It was sent with your key; stamp 7."
    for wrong in ("0", "-3", "1e300"):
        age.fill(wrong)
        age.blur()
        wait_for(reader, lambda: text_of(reader, "status") == "This is no age")
        assert age.input_value() == ""
    age.fill("100")
    age.blur()
    wait_for(reader, lambda: text_of(reader, "status") == "A stale message was refused")
    assert re.fullmatch(
        r"Stale: made \d+ s ago, and the largest age is 100 s\.", text_of(reader, "advice")
    )
    wait_for(reader, lambda: reader.locator("#start").is_visible())  # the film has ended
    assert text_of(reader, "status") == "A stale message was refused"
