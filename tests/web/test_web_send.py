"""The page that sends makes the loops of sender, and says what is wrong with its input."""

import base64
import io
import json
import re
import struct
import zlib
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import PIL.Image
import pytest
from browser import open_page, serve_folder, text_of, wait_for
from conftest import OpenWindow, cases
from moving import write_moving
from pilot_films import CORNERS
from playwright.sync_api import Browser, Page
from port import Port, same
from stand_in import answering, arrived
from web_films import write_film

from link.code.authenticate import sign
from link.code.framing import encode
from link.geometry import homography_from_corners
from link.images import write_image
from link.layout import make_layout
from link.loop import Loop
from link.presets import PRESETS
from link.strength import block_steps
from link.types import Image
from sender.carrying import carried_share
from sender.player import write_film_player, write_player
from web.host.demo import MESSAGE
from web.host.site import WEB
from web.host.tables import send_preset
from web.package.api import Receiver

KEY = bytes(range(32))
PACKED = ("offsets", "patches", "pictures", "steps")
"""Keys of a loop whose arrays zlib packs, which is not everywhere the same."""


def picture(width: int = 512, height: int = 384, seed: int = 0) -> Image:
    """Noise over all levels on one side, on the other a smooth ramp from black to white."""
    rng = np.random.default_rng(seed)
    drawn = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    ramp = np.linspace(0, 255, height).round().astype(np.uint8)
    drawn[:, : width // 2] = ramp[:, None, None]
    return drawn


def unpacked(loop: dict[str, Any]) -> dict[str, Any]:
    """A loop with its arrays as bytes."""

    def opened(held: Any) -> Any:
        if isinstance(held, list):
            return [opened(each) for each in held]
        return held and zlib.decompress(base64.b64decode(held))

    plain = {key: opened(held) if key in PACKED else held for key, held in loop.items()}
    if "film" in plain:
        plain["film"] = {**plain["film"], "patches": opened(plain["film"]["patches"])}
    return plain


def sent_loop(file: Path) -> dict[str, Any]:
    held = re.search(r'<script type="application/json" id="loop">(.*?)</script>', file.read_text())
    assert held
    loop: dict[str, Any] = json.loads(held[1])
    return unpacked(loop)


@cases((512, 384, 48, 64), (130, 97, 9, 16), (600, 800, 24, 32))
def test_blocks_are_as_strong_as_python_makes_them(
    width: int, height: int, rows: int, cols: int, port: Port
) -> None:
    layout = make_layout(rows, cols, width, height, modulation="antipodal", pilots="auto")
    drawn = picture(width, height)
    given = {"width": width, "height": height, "data": drawn.reshape(-1)}
    found = port("link/strength.js").blockSteps(given, rows, cols)
    assert len(set(found.tolist())) > 8
    same(found, block_steps(drawn, layout))


@cases(
    ("paper", (512, 384)),
    ("hidden", (384, 512)),
    ("fast", (512, 384)),
    ("robust", (802, 600)),
)
def test_loops_are_those_of_python(
    name: str, size: tuple[int, int], port: Port, tmp_path: Path
) -> None:
    preset, drawn = PRESETS[name], picture(*size)
    if size == (802, 600):
        drawn[:] = drawn[:, :, :1]  # gray
    message, signed = sign(b"Gr\xc3\xbc\xc3\x9fe", KEY, 7), size == (384, 512)
    bits = encode(message, preset.layout.n_bits, signed=signed)
    loop = Loop(preset.layout, preset.kappa, bits, lambda: iter([drawn]), even=preset.even)
    table = json.loads(json.dumps(send_preset(name, preset)))
    write_player(tmp_path / "player.html", loop, preset.state_hz, dict(table["loop"]["flicker"]))
    given = {"width": size[0], "height": size[1], "data": drawn.reshape(-1)}
    content = {"data": message, "signed": signed}
    found = vars(port("sender/loop.js").makeLoop(table, content, given))
    assert unpacked(found) == sent_loop(tmp_path / "player.html")


# The page in Chromium

MESSAGES = {
    "text": "one\n\ttwo, Gr\u00fc\u00dfe, \u4f60\u597d \U0001f642 </script> ".encode(),
    "5 kB": b"A long one. " * 420,
    "signed file": np.random.default_rng(5).bytes(300),
}


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    """Where the page that sends is served."""
    with serve_folder(site) as url:
        yield f"{url}send.html"


SIXTY_HZ = """{
    let now = 0;
    window.requestAnimationFrame = (call) => setTimeout(() => call((now += 1000 / 60)), 16);
}"""
"""Script that gives a page the refresh times of a display of 60 Hz, however busy the machine is: a
slower display would show flicker, and ask before it plays."""


@pytest.fixture
def sender(address: str, open_window: OpenWindow) -> Iterator[Page]:
    """The page, which must ask nothing of anybody else, and have no errors."""
    page = open_window(390, 844)
    page.add_init_script(SIXTY_HZ)
    asked: list[str] = []
    errors: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    yield page
    ours = (address.removesuffix("send.html"), "blob:", "data:")
    assert errors == []
    assert [url for url in asked if not url.startswith(ours)] == []


def save(page: Page, file: Path) -> dict[str, Any]:
    """Press *Save*; gives the loop of the file."""
    with page.expect_download() as saved:
        page.locator("#save").click()
    saved.value.save_as(file)
    return sent_loop(file)


def given_file(name: str, data: bytes, kind: str = "") -> Any:
    return {"name": name, "mimeType": kind or "application/octet-stream", "buffer": data}


def give(page: Page, kind: str) -> None:
    """Choose one of the messages; what is signed, with KEY and the counter 7."""
    page.locator("details").last.evaluate("(element) => { element.open = true; }")
    page.fill("#counter", "7")
    page.fill("#text", "" if "file" in kind else MESSAGES[kind].decode())
    page.set_input_files("#file", given_file("any", MESSAGES[kind]) if "file" in kind else [])
    page.set_input_files("#key", given_file("key", KEY) if "signed" in kind else [])


@pytest.mark.slow
def test_a_saved_file_is_what_python_writes(sender: Page, tmp_path: Path) -> None:
    preset, drawn = PRESETS["hidden"], picture()
    write_image(tmp_path / "picture.png", drawn)
    sender.set_input_files("#picture", tmp_path / "picture.png")
    for kind, message in MESSAGES.items():
        give(sender, kind)
        signed = "signed" in kind
        sent = sign(message, KEY, 7) if signed else message
        loop = save(sender, tmp_path / "saved.html")
        rows = encode(sent, preset.layout.n_bits, signed=signed)
        assert loop["bits"] == ["".join(map(str, row)) for row in rows], kind
    made = Loop(preset.layout, preset.kappa, rows, lambda: iter([drawn]), even=preset.even)
    flickers = dict(send_preset("hidden", preset)["loop"]["flicker"])
    write_player(tmp_path / "player.html", made, preset.state_hz, flickers)
    assert loop == sent_loop(tmp_path / "player.html")


@pytest.mark.slow
def test_a_film_is_shown_and_saved_as_python_writes_it(sender: Page, tmp_path: Path) -> None:
    preset = PRESETS["hidden"]
    film = write_moving(tmp_path / "film.webm", 384, 512)
    sender.set_input_files("#picture", film)
    wait_for(sender, lambda: sender.evaluate("[preview.width, preview.height]") == [384, 512])
    sender.fill("#text", "Hi")
    bits = encode(b"Hi", preset.layout.n_bits)
    blank = np.zeros((512, 384, 3), np.uint8)
    made = Loop(preset.layout, preset.kappa, bits, lambda: iter([blank]), even=preset.even)
    flickers = dict(send_preset("hidden", preset)["loop"]["flicker"])
    write_film_player(tmp_path / "player.html", made, film, preset.state_hz, flickers)
    assert save(sender, tmp_path / "saved.html") == sent_loop(tmp_path / "player.html")
    sender.locator("#show").click()
    wait_for(sender, lambda: len(sender.frames) == 2)
    shown = sender.frames[1]
    wait_for(sender, lambda: shown.evaluate("Boolean(window.player?.ready)"))
    wait_for(sender, lambda: shown.evaluate("film.video.currentTime > 0.2"))
    assert "graphics card" in shown.evaluate("painter.word")


def png_chunk(kind: bytes, data: bytes) -> bytes:
    """A part of a PNG file."""
    check = struct.pack(">I", zlib.crc32(kind + data))
    return struct.pack(">I", len(data)) + kind + data + check


def huge_png(width: int, height: int) -> bytes:
    """A PNG of a size that its file does not show."""
    head = png_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    rows = png_chunk(b"IDAT", zlib.compress(bytes(2**20)))
    return b"\x89PNG\r\n\x1a\n" + head + rows + png_chunk(b"IEND", b"")


SVG = b"""<svg xmlns="http://www.w3.org/2000/svg" width="99" height="99">
<script>alert(1)</script><image href="https://example.org/a.png" /></svg>"""
NO_PICTURE = "This file is no picture that this browser can read."
REFUSED = (
    ("picture", given_file("a.png", huge_png(20_000, 10_000), "image/png"),
     "This picture has 200 million pixels, and 50 are the most."),
    ("picture", given_file("a.png", SVG, "image/png"), NO_PICTURE),
    ("picture", given_file("a.svg", SVG, "image/svg+xml"),
     "Drawings (SVG) are not read. Save it as PNG."),
    ("picture", given_file("a.jpg", b"no picture", "image/jpeg"), NO_PICTURE),
    ("picture", given_file("a.mp4", b"no film", "video/mp4"),
     "This file is no film that this browser can play."),
    ("picture", given_file("a.png", huge_png(900, 20), "image/png"),
     "This picture is longer than 3 to 1. Crop it."),
    ("file", given_file("none", b""), "The message is empty. Type a text, or choose a file."),
    ("key", given_file("key", b"k"), "This file is no key: a key has 16 to 4096 bytes."),
)  # fmt: skip
"""What is chosen, its file, and what the page says, never the same twice in a row."""


@pytest.mark.slow
def test_what_is_no_good_is_refused_in_one_sentence(sender: Page, tmp_path: Path) -> None:
    for place, file, said in REFUSED:
        sender.set_input_files(f"#{place}", file)
        if place != "picture":
            sender.locator("#save").click()
        wait_for(sender, lambda said=said: text_of(sender, "status") == said)
        assert not sender.evaluate("document.getElementById('save').disabled")
        if place == "file":
            sender.set_input_files("#file", [])
    sender.set_input_files("#key", [])
    with (tmp_path / "huge").open("wb") as huge:
        huge.truncate(10**9)
    for place, said in (("picture", "too large"), ("file", "too long")):
        sender.set_input_files(f"#{place}", tmp_path / "huge")
        if place == "file":
            sender.locator("#save").click()
        wait_for(sender, lambda said=said: said in text_of(sender, "status"))
    sender.set_input_files("#file", [])
    sender.fill("#text", "")
    sender.locator("#save").click()
    wait_for(sender, lambda: "is empty" in text_of(sender, "status"))


@pytest.mark.slow
def test_the_later_of_text_and_file_is_sent(sender: Page, tmp_path: Path) -> None:
    sender.fill("#text", "typed")
    sender.set_input_files("#file", given_file("menu.txt", b"chosen"))
    assert "\u201cmenu.txt\u201d is sent in place of the text" in text_of(sender, "cost")
    assert "The message has 6 of" in text_of(sender, "numbers")
    n_bits = PRESETS["hidden"].layout.n_bits  # which the page offers first
    for message in (b"chosen", b"typed again"):
        rows = encode(message, n_bits)
        assert save(sender, tmp_path / "saved.html")["bits"] == ["".join(map(str, r)) for r in rows]
        sender.fill("#text", "typed again")
    assert "The message has 11 of" in text_of(sender, "numbers")


@pytest.mark.slow
def test_a_player_without_a_loop_leads_to_the_page_that_sends(sender: Page, address: str) -> None:
    said: list[str] = []
    sender.on("console", lambda message: said.append(message.text))
    sender.goto(address.replace("send.html", "player.html"))
    wait_for(sender, lambda: sender.url == address)
    assert said == []


@pytest.mark.slow
def test_a_large_picture_is_shrunk_to_the_usual_display(sender: Page, tmp_path: Path) -> None:
    write_image(tmp_path / "large.png", np.zeros((3000, 4000), np.uint8))
    sender.set_input_files("#picture", tmp_path / "large.png")
    wait_for(sender, lambda: sender.evaluate("[preview.width, preview.height]") == [1440, 1080])
    loop = save(sender, tmp_path / "saved.html")
    assert [loop["width"], loop["height"]] == [1440, 1080]


def profiled_png(drawn: Image) -> bytes:
    """A PNG that says that its numbers are of Display P3 (a chunk cICP, PNG 3)."""
    _, data = cv2.imencode(".png", drawn[:, :, ::-1])
    png, after = data.tobytes(), 8 + 25  # signature and header
    return png[:after] + png_chunk(b"cICP", bytes((12, 13, 0, 1))) + png[after:]


def animated_gif() -> bytes:
    """Two pictures of 16 x 16 pixels."""
    first, second = (PIL.Image.new("L", (16, 16), level) for level in (255, 0))
    first.save(data := io.BytesIO(), "GIF", save_all=True, append_images=[second], duration=100)
    return data.getvalue()


@pytest.mark.slow
def test_what_is_special_about_a_picture_is_said_or_done(sender: Page, tmp_path: Path) -> None:
    """Animations, small and dark pictures are said; Display P3 becomes sRGB."""
    dark = picture() // 12
    bmp = cv2.imencode(".bmp", dark[:, :, ::-1])[1].tobytes()
    sender.set_input_files("#picture", given_file("d.bmp", bmp, "image/bmp"))
    wait_for(sender, lambda: "This picture is dark" in text_of(sender, "cost"))
    share, hidden = carried_share(dark, "hidden"), PRESETS["hidden"]
    found = re.search(r"about ([\d,]+) bits a second", text_of(sender, "numbers"))
    assert found is not None
    rate = int(found[1].replace(",", "")) / (hidden.layout.n_bits * hidden.state_hz / 2)
    assert rate == pytest.approx(share, abs=0.05)  # each browser shrinks pictures in its way
    sender.select_option("#preset", "robust")
    assert "This picture is dark" not in text_of(sender, "cost")
    sender.set_input_files("#picture", given_file("a.gif", animated_gif(), "image/gif"))
    said = "Only the first picture of this animation is shown. This picture is small"
    wait_for(sender, lambda: text_of(sender, "status").startswith(said))
    drawn = np.full((384, 512, 3), (200, 90, 90), np.uint8)
    sender.set_input_files("#picture", given_file("a.png", profiled_png(drawn), "image/png"))
    wait_for(sender, lambda: text_of(sender, "status") == "")
    wait_for(sender, lambda: sender.evaluate("preview.width") == 512)
    pixel = sender.evaluate("[...preview.getContext('2d').getImageData(9, 9, 1, 1).data]")
    assert np.abs(np.subtract(pixel[:3], (216, 81, 86))).max() <= 2


@pytest.mark.slow
def test_numbers_that_are_none_are_refused(sender: Page) -> None:
    sender.locator("details").last.evaluate("(element) => { element.open = true; }")
    sender.set_input_files("#key", given_file("key", KEY))
    counter = sender.locator("#counter")
    counter.press_sequentially("e")  # which a browser gives as ""
    if not counter.evaluate("(element) => element.validity.badInput"):
        counter.press_sequentially("e")  # on a busy machine the first one may get lost
    sender.locator("#save").click()
    wait_for(sender, lambda: text_of(sender, "status").startswith("The counter is a whole number"))
    sender.set_input_files("#key", [])
    sender.fill("#reader", "example.org")
    sender.locator("#save").click()
    wait_for(sender, lambda: "begins with https://" in text_of(sender, "status"))


@pytest.mark.slow
def test_a_browser_that_hides_pixels_is_not_believed(sender: Page) -> None:
    sender.evaluate("""() => {
        const get = CanvasRenderingContext2D.prototype.getImageData;
        CanvasRenderingContext2D.prototype.getImageData = function (...given) {
            const image = get.apply(this, given);
            image.data.forEach((_, i, all) => (all[i] = 37 * i));
            return image;
        };
    }""")
    sender.locator("#save").click()
    wait_for(sender, lambda: "Allow this page to read canvases" in text_of(sender, "status"))


@pytest.mark.slow
def test_readers_are_told_the_address_and_by_a_code_that_can_be_switched_off(
    sender: Page, open_window: OpenWindow, tmp_path: Path
) -> None:
    assert sender.input_value("#reader") == ""  # of a page that is on this device alone
    sender.locator("details").last.evaluate("(element) => { element.open = true; }")
    assert sender.locator("#local").is_visible()
    sender.fill("#reader", "https://example.org/read/")
    loop = save(sender, tmp_path / "player.html")
    assert loop["reader"] == "https://example.org/read/"
    page = open_window(1000, 700)
    page.add_init_script(SIXTY_HZ)
    page.goto((tmp_path / "player.html").as_uri())
    wait_for(page, lambda: page.evaluate("Boolean(window.player?.ready)"))
    assert "Open https://example.org/read/ on a phone" in page.inner_text("p")
    shot = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert cv2.QRCodeDetector().detectAndDecode(shot)[0] == "https://example.org/read/"
    boxes = [page.locator(name).bounding_box() for name in ("canvas:not(#code)", "#code")]
    assert boxes[0]["x"] + boxes[0]["width"] <= boxes[1]["x"] + 1  # nothing of it is covered
    height = boxes[0]["height"]
    page.keyboard.press("q")
    assert not page.locator("#code").is_visible()
    assert page.locator("canvas:not(#code)").bounding_box()["height"] >= height
    sender.reload()
    assert sender.input_value("#reader") == "https://example.org/read/"  # remembered
    sender.locator("details").last.evaluate("(element) => { element.open = true; }")
    sender.uncheck("#code")
    assert "code" not in save(sender, tmp_path / "player.html")


@pytest.mark.slow
def test_buttons_and_errors_are_in_view_on_a_phone(sender: Page) -> None:
    for where in ("0", "document.documentElement.scrollHeight"):
        sender.evaluate(f"scrollTo(0, {where})")
        for name in ("#show", "#status"):
            sender.set_input_files("#picture", given_file("a.jpg", b"none", "image/jpeg"))
            wait_for(sender, lambda: text_of(sender, "status") == NO_PICTURE)
            box = sender.locator(name).bounding_box()
            assert box["y"] >= 0 and box["y"] + box["height"] <= 844
    assert sender.input_value("#picture") == ""  # what is not shown is not named


# How it is shown


@pytest.mark.slow
def test_what_flickers_is_shown_once_somebody_agreed(sender: Page) -> None:
    def player() -> Any:
        sender.locator("#show").click()
        wait_for(sender, lambda: len(sender.frames) == 2)
        wait_for(sender, lambda: sender.frames[1].evaluate("Boolean(window.player?.ready)"))
        return sender.frames[1]

    sender.select_option("#preset", "hidden")
    assert player().evaluate("player.playing")
    sender.keyboard.press("Escape")
    wait_for(sender, lambda: len(sender.frames) == 1)
    sender.select_option("#preset", "robust")
    first = player()
    assert not first.evaluate("player.playing")
    assert "flickers visibly" in first.inner_text("p")
    assert sender.evaluate("document.fullscreenElement.id") == "stage"
    assert sender.evaluate("document.querySelector('main').inert")  # the page behind it
    sender.mouse.click(200, 300)
    assert first.evaluate("player.playing")
    sender.keyboard.press("Escape")
    wait_for(sender, lambda: len(sender.frames) == 1)
    assert "15.0 states a second" in text_of(sender, "status")
    assert not sender.evaluate("document.querySelector('main').inert")
    assert player().evaluate("player.playing")  # it does not ask again
    sender.mouse.click(200, 300)
    wait_for(sender, lambda: len(sender.frames) == 1)


@pytest.mark.slow
def test_presets_are_seen_beside_each_other(address: str, open_window: OpenWindow) -> None:
    page = open_window(1280, 900)
    page.add_init_script(SIXTY_HZ)
    page.goto(address.replace("send.html", "about.html"))
    page.locator("#look").click()
    wait_for(page, lambda: len(page.frames) == 3)
    robust, hidden = page.frames[1:]
    for frame, is_playing, name in ((robust, False, "robust"), (hidden, True, "hidden")):
        wait_for(
            page, lambda frame=frame: frame.evaluate("typeof player === 'object' && player.ready")
        )
        assert frame.evaluate("player.playing") is is_playing  # what flickers asks first
        assert frame.evaluate("loop.state_hz") == PRESETS[name].state_hz
    boxes = [frame.frame_element().bounding_box() for frame in (robust, hidden)]
    assert boxes[0]["y"] == boxes[1]["y"]


@pytest.mark.slow
@cases(
    ("index.html", "No camera was found"),
    ("index.html?film=none", "The film cannot be read"),
    ("index.html?film=demo.mkv", "Message received"),
    ("send.html", ""),
    ("send.html?save", "among your downloads"),
    ("send.html?show", ""),
    ("about.html", ""),
)
def test_nobody_is_shut_out(name: str, says: str, address: str, browser: Browser) -> None:
    """Names, contrast and order, as axe-core checks them in each page and state, and no overflow.

    The page that reads has a worker that finds a long address in every film.
    """
    long = "https://example.org/" + "a" * 500
    with open_page(browser, worker=answering(arrived(long))) as page:
        page.goto(address.replace("send.html", name))
        for summary in page.locator("summary").all():
            summary.click()
        if name.startswith("send.html?"):
            page.locator(f"#{name.partition('?')[2]}").click()
        wait_for(page, lambda: says in page.inner_text("body"))
        wait_for(page, lambda: len(page.frames) == (2 if "show" in name else 1))
        page.evaluate((WEB / "node_modules" / "axe-core" / "axe.min.js").read_text())
        for width, scheme in product((320, 390, 1280), ("light", "dark")):
            page.set_viewport_size({"width": width, "height": 844})
            page.emulate_media(color_scheme=scheme)
            found = page.evaluate("axe.run()")
            assert [(each["id"], each["nodes"]) for each in found["violations"]] == []
            assert len(found["passes"]) >= 11
            assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.slow
def test_the_page_that_sends_is_small(site: Path) -> None:
    names = [
        "send.html",
        "noon.jpg",
        "style.css",
        "send.js",
        "sending.js",
        "player.html",
        "icon.svg",
    ]
    assert sum((site / name).stat().st_size for name in names) <= 300_000


# From the playing page through a camera of a few lines


def states_of(page: Page, player: Path) -> Iterator[Image]:
    """Gray levels of what a window of 640 x 480 shows of two loops or more of a file's states."""
    page.goto(player.resolve().as_uri())
    wait_for(page, lambda: page.evaluate("Boolean(window.player?.ready)"))
    page.evaluate("player.pause(), player.step(-player.state)")
    for number in range(max(96, page.evaluate("4 * loop.bits.length"))):
        page.evaluate(SEEK, number)
        image = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
        yield np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
        page.keyboard.press("ArrowRight")


def filmed(states: Iterator[Image]) -> Iterator[Image]:
    """A film of 640 x 480, two frames of each state: slanted, blurred and noisy."""
    rng, H = np.random.default_rng(7), homography_from_corners(CORNERS, 640, 480)
    for state in (state for state in states for _ in range(2)):
        frame = cv2.warpPerspective(state, H, (640, 480), borderValue=60.0)
        noisy = cv2.GaussianBlur(frame, (0, 0), 0.6) + rng.normal(0, 1.5, frame.shape)
        yield noisy.round().clip(0, 255).astype(np.uint8)


SEEK = """(number) => new Promise((resolve) => {
    film.video.onseeked = () => {
        film.fresh = true;
        player.show(player.state);
        resolve();
    };
    film.video.currentTime = (number / loop.state_hz) % film.video.duration;
})"""
"""Script that lets a film's player show the picture of a state's time."""


@pytest.fixture(scope="module")
def reader(address: str, browser: Browser) -> Page:
    """The page that reads, at first the film that comes with it."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.goto(f"{address.removesuffix('send.html')}?film=demo.mkv")
    return page


@pytest.mark.slow
def test_the_film_that_comes_with_the_page_is_read(reader: Page) -> None:
    wait_for(reader, lambda: text_of(reader, "status") == "Message received")
    assert text_of(reader, "message") == MESSAGE


@pytest.mark.slow
def test_what_the_page_shows_is_read_by_both_receivers(
    sender: Page, reader: Page, open_window: OpenWindow, tmp_path: Path
) -> None:
    sender.fill("#text", "a")
    sender.select_option("#preset", "robust")
    sender.set_input_files("#picture", write_moving(tmp_path / "given.webm", 640, 480))
    wait_for(sender, lambda: sender.evaluate("[preview.width, preview.height]") == [640, 480])
    save(sender, tmp_path / "player.html")

    fps = 2 * PRESETS["robust"].state_hz
    states = states_of(open_window(640, 480), tmp_path / "player.html")
    receiver = Receiver(fps, models=["robust"])
    arrived, frames = None, []
    for number, frame in enumerate(filmed(states)):
        frames.append(frame)
        if arrived is None:
            events = receiver.push(frame, number / fps)
            arrived = number if any(event["event"] == "message" for event in events) else None
        elif number >= arrived + 20:  # the page may need a little more
            break
    write_film(tmp_path / "film.mkv", frames, fps)
    assert arrived is not None and events[-1]["text"] == "a"
    reader.set_input_files("#film", tmp_path / "film.mkv")
    wait_for(reader, lambda: text_of(reader, "message") == "a")
    with reader.expect_download() as saved:
        reader.locator("#keep").click()
    assert saved.value.path().read_bytes() == b"a"
