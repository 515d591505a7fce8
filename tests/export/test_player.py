"""The player in a real browser: screenshots taken while it plays show exactly what was sent."""

import base64
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import ROOT, OpenWindow, slow
from numpy.typing import NDArray
from playwright.sync_api import Page

from export.receive.receiver import Receiver
from export.runtime import Decoder
from export.send.player import write_player
from link.code import framing
from link.code.collect import make_collector
from link.layout import Layout, make_layout
from link.loop import Loop

PRETRAINED = ROOT / "models" / "neural" / "pretrained" / "decoder.onnx"
MESSAGE = b"Hi"
PATIENCE_S = 60.0


def make_loop(layout: Layout, kappa: int, picture: NDArray[np.uint8]) -> Loop:
    bits = framing.encode(MESSAGE, layout.n_bits)
    return Loop(layout, kappa, bits, lambda: iter([picture]))


@pytest.fixture(scope="module")
def small() -> Loop:
    """Noise, in which every wrong pixel shows."""
    layout = make_layout(5, 6, 120, 80, 2)
    picture = np.random.default_rng(0).integers(0, 256, (80, 120, 3), dtype=np.uint8)
    return make_loop(layout, 5, picture)


@pytest.fixture(scope="module")
def player(small: Loop, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("player") / "player.html"
    write_player(file, small, 15)
    return file


def wait_for(page: Page, condition: str) -> None:
    """Wait until an expression is true; Playwright's own way is refused by the page's policy."""
    deadline = time.monotonic() + PATIENCE_S
    while not page.evaluate(condition):
        assert time.monotonic() < deadline, f"never came true: {condition}"
        time.sleep(0.02)


def load(page: Page, player: Path) -> None:
    """Open a player, and wait until it can play."""
    page.goto(player.resolve().as_uri())
    wait_for(page, "window.player && player.ready")


def start(page: Page, player: Path) -> None:
    """Open a player and play without waiting for the reader."""
    load(page, player)
    page.evaluate("player.play()")


def screenshot(page: Page) -> NDArray[np.uint8]:
    """What the window shows now, (H, W, 3) uint8, encoded RGB, in device pixels."""
    image = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def cut_out(page: Page, layout: Layout, shot: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture in a screenshot, in device pixels; around it all but a line below is black."""
    script = """(() => {
        const [{ x, y }, below] = [canvas, line].map((part) => part.getBoundingClientRect());
        return [x, y, player.scale, devicePixelRatio, below.height ? below.y : innerHeight];
    })()"""
    x, y, scale, ratio, below = page.evaluate(script)
    left, top = round(x * ratio), round(y * ratio)
    box = slice(top, top + scale * layout.height), slice(left, left + scale * layout.width)
    assert below * ratio >= box[0].stop
    around = shot.copy()
    around[box] = 0
    around[int(below * ratio) :] = 0
    assert not around.any()
    return shot[box]


WINDOWS = {
    "desktop": (300, 200, 1.0, 2),
    "dense": (300, 200, 2.0, 5),
    "125 %": (400, 300, 1.25, 4),
    "phone upright": (205, 365, 2.625, 4),
    "phone on its side": (240, 135, 3.0, 5),
}
QUICK = ("desktop", "phone upright")


@pytest.mark.parametrize("name", [name if name in QUICK else slow(name) for name in WINDOWS])
def test_screenshots_while_it_plays_are_the_states_bit_for_bit(
    name: str, open_window: OpenWindow, player: Path, small: Loop
) -> None:
    width, height, ratio, scale = WINDOWS[name]
    page = open_window(width, height, ratio, mobile="phone" in name)
    start(page, player)
    assert page.evaluate("player.scale") == scale
    enlarged = [np.kron(s, np.ones((scale, scale, 1), np.uint8)) for s in small.states()]
    wanted = {state.tobytes() for state in enlarged}
    seen: set[bytes] = set()
    deadline = time.monotonic() + PATIENCE_S
    while seen != wanted and time.monotonic() < deadline:
        shown = cut_out(page, small.layout, screenshot(page)).tobytes()
        assert shown in wanted, "a screenshot shows no state that was sent"
        seen.add(shown)
    assert seen == wanted


def test_an_upright_picture_is_shown_upright(open_window: OpenWindow, tmp_path: Path) -> None:
    """The grid lies on its side beneath it; every pixel is where the states have it."""
    layout = make_layout(5, 6, 120, 80, 2)
    picture = np.random.default_rng(0).integers(0, 256, (120, 80, 3), dtype=np.uint8)
    bits = framing.encode(MESSAGE, layout.n_bits)
    loop = Loop(layout, 5, bits, lambda: iter([picture]), 0, (80, 120), "contain")
    write_player(tmp_path / "player.html", loop, 15)
    page = open_window(200, 300, 1.25)
    start(page, tmp_path / "player.html")
    scale = page.evaluate("player.scale")
    wanted = [np.kron(state, np.ones((scale, scale, 1), np.uint8)) for state in loop.states()]
    page.evaluate("player.pause()")
    for number in (0, 1, len(wanted) - 1):
        page.evaluate(f"player.show({number}), document.body.classList.add('clear')")
        shown = cut_out(page, layout.resized(80, 120), screenshot(page))
        np.testing.assert_array_equal(shown, wanted[number])


CANVAS = """() => {
    const { data } = context.getImageData(0, 0, loop.width, loop.height);
    let text = "";
    for (let i = 0; i < data.length; i += 4096) {
        text += String.fromCharCode(...data.subarray(i, i + 4096));
    }
    return btoa(text);
}"""
"""Script that gives what the canvas holds."""


def pixels_of(page: Page, texts: list[str]) -> list[NDArray[np.uint8]]:
    """What `CANVAS` gave, as images (H, W, 3)."""
    width, height = page.evaluate("[loop.width, loop.height]")
    images = [np.frombuffer(base64.b64decode(text), np.uint8) for text in texts]
    return [image.reshape(height, width, 4)[:, :, :3] for image in images]


def assert_shown(shown: list[NDArray[np.uint8]], wanted: list[NDArray[np.uint8]]) -> None:
    for number, (image, state) in enumerate(zip(shown, wanted, strict=True)):
        np.testing.assert_array_equal(image, state, f"state {number}")


def ramp(height: int, width: int) -> NDArray[np.uint8]:
    """From black to white, so that offsets meet both ends of what may be shown."""
    row = np.linspace(0, 255, width).round().astype(np.uint8)
    return np.stack([np.tile(row, (height, 1)), np.tile(row[::-1], (height, 1))] * 2, 2)[:, :, :3]


EXACT: dict[str, tuple[int, int, dict[str, Any]]] = {
    "on_off, ratex": (5, 0, {"ratex": 5}),
    "antipodal, ratex, odd": (5, 0, {"ratex": 2, "modulation": "antipodal"}),
    "antipodal, pilots, least": (1, 0, {"pilots": 4, "modulation": "antipodal"}),
    "antipodal, pilots, most": (64, 0, {"pilots": 4, "modulation": "antipodal"}),
    "antipodal, chroma": (9, 0, {"pilots": 4, "modulation": "antipodal", "colour": "chroma"}),
    "on_off, chroma": (3, 0, {"pilots": 4, "colour": "chroma"}),
    "antipodal, ratex, soft": (9, 1, {"ratex": 2, "modulation": "antipodal"}),
    "on_off, soft": (6, 1, {"pilots": 4}),
}
"""Kappa, pyramid level and what else a layout has, by what the page must show exactly."""
SOON = ("antipodal, chroma", "antipodal, ratex, soft")


@pytest.mark.parametrize("case", [name if name in SOON else slow(name) for name in EXACT])
def test_the_page_computes_what_is_embedded_to_the_gray_level(
    case: str, open_window: OpenWindow, tmp_path: Path
) -> None:
    kappa, level, more = EXACT[case]
    layout = make_layout(5, 6, 121, 83, **more)  # no whole blocks
    noise = np.random.default_rng(0).integers(0, 256, (83, 121, 3), dtype=np.uint8)
    gray = np.repeat(noise[:, :, :1], 3, axis=2)
    bits = framing.encode(b"!", layout.n_bits)
    loop = Loop(layout, kappa, bits, lambda: iter([noise, ramp(83, 121), gray]), level)
    write_player(tmp_path / "player.html", loop, 15)
    page = open_window(300, 200)
    page.goto((tmp_path / "player.html").as_uri())
    wait_for(page, "states.number === 0")
    sent = list(loop.states())
    assert len(sent) > 6
    script = f"Array.from({{ length: {len(sent)} }}, (_, k) => (player.show(k), ({CANVAS})()))"
    assert_shown(pixels_of(page, page.evaluate(script)), sent)


# The clock, on displays whose refreshes the test makes

REFRESHES = """
    window.asked = [];
    window.requestAnimationFrame = (call) => asked.push(call);
    window.clock = 1000;
    window.refresh = (gap) => {
        clock += gap;
        for (const call of asked.splice(0)) call(clock);
    };
"""
"""Script that takes the place of the browser's refreshes."""


def at_display(page: Page, player: Path, hz: float, state_hz: float) -> None:
    """Open a player on a display of ``hz`` refreshes a second, ask for a rate, and play."""
    page.add_init_script(REFRESHES)
    page.goto(player.resolve().as_uri())
    wait_for(page, "asked.length > 0")
    page.evaluate(
        f"loop.stateHz = {state_hz}; for (let k = 0; k < 1.2 * {hz}; k++) refresh(1000 / {hz})"
    )
    page.evaluate("player.play()")


def after_refreshes(page: Page, gaps: list[float]) -> list[NDArray[np.uint8]]:
    """What the canvas holds after each of some refreshes, by the milliseconds before it."""
    return pixels_of(
        page, page.evaluate(f"(gaps) => gaps.map((gap) => (refresh(gap), ({CANVAS})()))", gaps)
    )


def test_each_refresh_shows_the_next_state(
    open_window: OpenWindow, player: Path, small: Loop
) -> None:
    page = open_window(300, 200)
    at_display(page, player, 60, state_hz=60)
    sent = list(small.states())
    assert page.evaluate("[player.hold, player.rate, player.kept]") == [1, pytest.approx(60), True]
    shown = after_refreshes(page, [1000 / 60] * (2 * len(sent) - 1))
    assert_shown(shown, [*sent[1:], *sent])
    assert page.evaluate("stats.dropped") == 0


def test_a_late_refresh_is_told_below_the_picture_and_the_states_keep_time(
    open_window: OpenWindow, player: Path, small: Loop
) -> None:
    page = open_window(300, 200)
    at_display(page, player, 60, state_hz=60)
    sent = list(small.states())
    late = [*[1000 / 60] * 4, 50.0, *[1000 / 60] * 3, 34.0, *[1000 / 60] * 40]
    number, wanted = 0, []
    for gap in late:
        number += round(gap * 60 / 1000)
        wanted.append(sent[number % len(sent)])
    assert_shown(after_refreshes(page, late), wanted)
    assert page.evaluate("stats.dropped") == 3
    said = "60.0 states/s, 3 refreshes skipped"
    assert page.evaluate("[line.textContent, getComputedStyle(line).display]") == [said, "block"]
    assert page.evaluate("getComputedStyle(note).display") == "none"
    boxes = "[canvas, line].map((part) => part.getBoundingClientRect())"
    script = f"{boxes}.map(({{ top, bottom }}) => [top, bottom])"
    (_, bottom), (top, end) = page.evaluate(script)
    assert bottom <= top < end <= 200


@pytest.mark.parametrize(
    ("hz", "asked", "hold", "word"),
    [
        (120, 120, 1, ""),
        (60, 120, 1, "60.0 states/s, not 120 as asked"),
        slow(120, 60, 2, ""),
        slow(59.94, 60, 1, ""),
        slow(60, 15, 4, ""),
        slow(240, 15, 16, ""),
        slow(30, 60, 1, "30.0 states/s, not 60 as asked"),
        slow(144, 60, 2, "72.0 states/s, not 60 as asked"),
    ],
)
def test_the_rate_is_the_nearest_that_the_display_has(
    hz: float, asked: float, hold: int, word: str, open_window: OpenWindow, player: Path
) -> None:
    page = open_window(300, 200)
    at_display(page, player, hz, asked)
    assert page.evaluate("player.hold") == hold
    page.evaluate(f"for (let k = 0; k < {6 * hold}; k++) refresh(1000 / {hz})")
    assert page.evaluate("[player.count, stats.dropped]") == [6, 0]
    said, told = page.evaluate("[line.textContent, note.textContent]")
    assert word in said
    assert ("as asked" in told) == ("as asked" in said) == bool(word)


@pytest.mark.slow
def test_on_another_display_the_loop_goes_on_where_it_is(
    open_window: OpenWindow, player: Path
) -> None:
    page = open_window(300, 200)
    at_display(page, player, 60, state_hz=60)
    page.evaluate("for (let k = 0; k < 7; k++) refresh(1000 / 60); player.pause()")
    page.evaluate("for (let k = 0; k < 300; k++) refresh(1000 / 120); player.play()")
    assert page.evaluate("[player.hold, player.count]") == [2, 7]
    page.evaluate("for (let k = 0; k < 6; k++) refresh(1000 / 120)")
    assert page.evaluate("player.count") == 10


# The clock, on the browser's own refreshes


@pytest.mark.slow
def test_at_60_states_a_second_canvas_and_screenshots_are_the_states_in_order(
    open_window: OpenWindow, small: Loop, tmp_path: Path
) -> None:
    write_player(tmp_path / "player.html", small, 60)
    page = open_window(300, 200)
    start(page, tmp_path / "player.html")
    sent = list(small.states())
    page.evaluate(f"""window.log = [], window.read = {CANVAS}, (function look() {{
        log.push([stats.refreshes, read()]);
        if (log.length < 90) requestAnimationFrame(look);
    }})()""")
    wait_for(page, "log.length === 90")
    refreshes, texts = zip(*page.evaluate("log.slice(1)"), strict=True)
    hold = page.evaluate("player.hold")
    assert_shown(pixels_of(page, list(texts)), [sent[n // hold % len(sent)] for n in refreshes])
    assert len(set(refreshes)) == len(refreshes)  # every refresh counts
    skipped = refreshes[-1] - refreshes[0] + 1 - len(refreshes)
    assert skipped <= page.evaluate("stats.dropped")
    wanted = {np.kron(state, np.ones((2, 2, 1), np.uint8)).tobytes() for state in sent}
    for _ in range(5):
        assert cut_out(page, small.layout, screenshot(page)).tobytes() in wanted


@pytest.mark.slow
def test_a_page_of_a_fine_grid_is_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("link.loop.ssim", lambda *_: 1.0)  # not asked for, and half of the time
    rng = np.random.default_rng(0)
    layout = make_layout(48, 64, modulation="antipodal", pilots="auto")
    noise = rng.integers(0, 256, (384, 512, 3), dtype=np.uint8)  # which nothing packs
    bits = rng.integers(0, 2, (100, layout.n_bits), dtype=np.uint8)
    write_player(tmp_path / "player.html", Loop(layout, 1, bits, lambda: iter([noise])), 60)
    page = (tmp_path / "player.html").stat().st_size
    assert page < 1_000_000
    assert page - 4 / 3 * noise.size < 100_000  # little more than the picture


@pytest.mark.slow
def test_each_state_stays_for_its_refreshes(
    open_window: OpenWindow, player: Path, small: Loop
) -> None:
    page = open_window(300, 200)
    start(page, player)
    page.evaluate("window.log = [], player.draw = player.show, 0")
    page.evaluate("player.show = (k) => { log.push([stats.refreshes, k]); player.draw(k); }, 0")
    wait_for(page, "log.length > 40")
    log, dropped = page.evaluate("[log, stats.dropped]")
    refreshes, states = np.array(log).T
    count = 2 * len(small.bits)
    np.testing.assert_array_equal(states, refreshes // 4 % count)
    late = (refreshes % 4).sum()  # only a refresh that the browser skipped delays a change
    assert late <= dropped
    held = np.diff(refreshes - refreshes % 4)
    assert (held % 4 == 0).all()
    assert np.mean(held == 4) > 0.5


@pytest.mark.slow
def test_a_skipped_refresh_is_counted_and_the_rate_kept(
    open_window: OpenWindow, player: Path
) -> None:
    page = open_window(300, 200)
    start(page, player)
    wait_for(page, "stats.refreshes > 20")
    script = """new Promise((done) => requestAnimationFrame((first) => {
        const before = { ...stats };
        const until = performance.now() + 250;
        while (performance.now() < until);
        setTimeout(() => requestAnimationFrame((last) => requestAnimationFrame(() =>
            done([before, { ...stats }, (last - first) / 1000])
        )), 200);
    }))"""
    before, after, seconds = page.evaluate(script)
    assert after["dropped"] - before["dropped"] >= 0.2 * before["hz"]
    passed = after["refreshes"] - before["refreshes"]
    assert passed == pytest.approx(seconds * after["hz"], abs=4)


@pytest.mark.slow
def test_it_starts_by_itself_and_nothing_covers_the_picture(
    open_window: OpenWindow, player: Path
) -> None:
    page = open_window(300, 200)
    load(page, player)
    assert "states/s" in page.evaluate("document.querySelector('p').textContent")
    wait_for(page, "player.playing")
    script = "getComputedStyle(document.querySelector('p')).display"
    assert page.evaluate(script) == "none"
    page.evaluate("player.pause()")
    assert page.evaluate(script) == "block"
    at = page.evaluate("player.count")
    time.sleep(0.2)
    assert page.evaluate("player.count") == at


@pytest.mark.slow
def test_a_window_that_is_too_small_is_told(open_window: OpenWindow, player: Path) -> None:
    page = open_window(100, 200)
    start(page, player)
    assert "needs 120 × 80 pixels" in page.evaluate("document.querySelector('p').textContent")
    assert page.evaluate("stats.refreshes") == 0
    page.set_viewport_size({"width": 300, "height": 200})
    wait_for(page, "stats.refreshes > 0")


@pytest.fixture(scope="module")
def slow_player(decoder: Decoder, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pretrained decoder's layout, a smooth picture, 3 states a second."""
    layout = decoder.layout
    coarse = np.random.default_rng(4).uniform(0, 255, (7, 9, 3)).astype(np.float32)
    picture = cv2.resize(coarse, (layout.width, layout.height)).round().astype(np.uint8)
    file = tmp_path_factory.mktemp("slow") / "player.html"
    write_player(file, make_loop(layout, 3, picture), 3)
    return file


@pytest.fixture(scope="module")
def decoder() -> Decoder:
    return Decoder(PRETRAINED)


@pytest.mark.slow
def test_screenshots_decode_to_the_message(
    open_window: OpenWindow, slow_player: Path, decoder: Decoder
) -> None:
    page = open_window(640, 480)
    start(page, slow_player)
    collector, message = make_collector(decoder.layout.n_bits), None
    shots: dict[int, NDArray[np.uint8]] = {}
    deadline = time.monotonic() + PATIENCE_S
    while message is None and time.monotonic() < deadline:
        before = page.evaluate("player.count")
        shot = screenshot(page)
        if page.evaluate("player.count") != before or before in shots:
            continue  # taken while the state changed
        shots[before] = cut_out(page, decoder.layout, shot)
        if before % 2 == 1 and before - 1 in shots:
            soft = decoder.decode(shots[before - 1], shots[before])
            message = collector.add(soft.scores, before // 2)
    assert message is not None
    assert message.data == MESSAGE


@pytest.mark.slow
def test_the_receiver_reads_a_film_of_screenshots(
    open_window: OpenWindow, slow_player: Path, decoder: Decoder
) -> None:
    """It finds the display, its clock, the frame pairs and their place in the loop by itself."""
    page = open_window(700, 520)
    start(page, slow_player)
    receiver, message = Receiver(decoder, fps=10), None
    deadline = time.monotonic() + PATIENCE_S
    while message is None and time.monotonic() < deadline:
        before = page.evaluate("performance.now()")
        shot = screenshot(page)
        middle = (before + page.evaluate("performance.now()")) / 2
        message = receiver.push(shot, middle / 1000).message
    message = message or receiver.finish().message
    assert message is not None
    assert message.data == MESSAGE
