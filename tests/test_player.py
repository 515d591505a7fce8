"""The player in a real browser: screenshots taken while it plays show exactly what was sent."""

import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import OpenWindow, slow
from numpy.typing import NDArray
from playwright.sync_api import Page

from export.receive.receiver import Receiver
from export.runtime import Decoder
from export.send.player import write_player
from link.code import framing
from link.code.collect import Collector
from link.layout import Layout, make_layout
from link.loop import Loop

PRETRAINED = Path(__file__).parents[1] / "models" / "neural" / "pretrained" / "decoder.onnx"
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
    write_player(file, small.pairs(), hold=4)
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
    """The picture in a screenshot, in device pixels; all around it is black."""
    script = "(({x, y}) => [x, y, player.scale, devicePixelRatio])(canvas.getBoundingClientRect())"
    x, y, scale, ratio = page.evaluate(script)
    left, top = round(x * ratio), round(y * ratio)
    box = slice(top, top + scale * layout.height), slice(left, left + scale * layout.width)
    around = shot.copy()
    around[box] = 0
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


@pytest.mark.slow
@pytest.mark.parametrize("colour", ["gray", "chroma"])
def test_what_an_embedded_frame_takes_away_is_exact_too(
    colour: str, small: Loop, open_window: OpenWindow, tmp_path: Path
) -> None:
    layout = make_layout(5, 6, 120, 80, 0, "antipodal", colour=colour)
    loop = Loop(layout, 9, framing.encode(MESSAGE, layout.n_bits), small.pictures)
    write_player(tmp_path / "player.html", loop.pairs(), hold=4)
    page = open_window(300, 200)
    load(page, tmp_path / "player.html")
    for number, state in enumerate(loop.states()):
        show = f"player.pause(), player.show({number})"  # in one step, or it plays on meanwhile
        read = "Array.from(context.getImageData(0, 0, loop.width, loop.height).data)"
        pixels = np.array(page.evaluate(f"{show}, {read}"), np.uint8).reshape(80, 120, 4)
        np.testing.assert_array_equal(pixels[:, :, :3], state)


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
    write_player(file, make_loop(layout, 3, picture).pairs(), hold=20)
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
    collector, message = Collector(decoder.layout.n_bits), None
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
