"""The player in a real browser: screenshots taken while it plays show exactly what was sent.

Where there is no graphics card, software runs the same program of WebGL2.
"""

import base64
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from browser import PATIENCE_S, wait_for
from conftest import OpenWindow, cases
from numpy.typing import NDArray
from playwright.sync_api import Page

from link.code import framing
from link.embed import block_changes
from link.layout import Layout, block_index, make_layout
from link.loop import Loop
from link.types import Array, Image
from sender.compact import Compact
from sender.player import write_player

MESSAGE = b"Hi"


def make_loop(layout: Layout, kappa: int, *pictures: Image, **more: Any) -> Loop:
    bits = framing.encode(MESSAGE, layout.n_bits)
    return Loop(layout, kappa, bits, lambda: iter(pictures), **more)


def noise(height: int, width: int) -> Image:
    """A picture in which every wrong pixel shows."""
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)


@pytest.fixture(scope="module")
def small() -> Loop:
    return make_loop(make_layout(5, 6, 120, 80, 2), 5, noise(80, 120))


@pytest.fixture(scope="module")
def player(small: Loop, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("player") / "player.html"
    write_player(file, small, 15, {})
    return file


def load(page: Page, player: Path) -> None:
    """Open a player, and wait until it can play."""
    page.goto(player.resolve().as_uri())
    wait_for(page, "window.player && player.ready")


def start(page: Page, player: Path) -> None:
    """Open a player that plays with nothing over the picture."""
    load(page, player)
    page.evaluate("document.body.classList.add('rest')")


WITHOUT_CARD = """
    const given = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, how) {
        return kind === "webgl2" ? null : given.call(this, kind, how);
    };
"""
"""Script that takes WebGL2 away."""


def screenshot(page: Page) -> Image:
    """What the window shows now, (H, W, 3) uint8, encoded RGB, in device pixels."""
    image = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def cut_out(page: Page, shot: Image) -> Image:
    """The picture in a screenshot, in device pixels; around it all is black."""
    script = "(({ x, y, width, height }) => [x, y, width, height])(canvas.getBoundingClientRect())"
    ratio = page.evaluate("devicePixelRatio")
    left, top, width, height = (round(ratio * length) for length in page.evaluate(script))
    box = slice(top, top + height), slice(left, left + width)
    around = shot.copy()
    around[box] = 0
    assert not around.any()
    return shot[box]


WINDOWS = {
    "phone upright": (40, 80, 3.0, 1),
    "phone upright, by the processor": (205, 365, 2.625, 4),
}
"""Width and height in CSS pixels, device pixels for each of them, and for each of the picture's."""


@pytest.mark.slow
@pytest.mark.parametrize("name", WINDOWS)
def test_screenshots_while_it_plays_are_the_states_bit_for_bit(
    name: str, open_window: OpenWindow, player: Path, small: Loop
) -> None:
    width, height, ratio, scale = WINDOWS[name]
    page = open_window(width, height, ratio, mobile=True)
    if "processor" in name:
        page.add_init_script(WITHOUT_CARD)
    start(page, player)
    assert ("without" in page.evaluate("painter.word")) == ("processor" in name)
    enlarged = [np.kron(s, np.ones((scale, scale, 1), np.uint8)) for s in small.states()]
    wanted = {state.tobytes() for state in enlarged}
    seen: set[bytes] = set()
    deadline = time.monotonic() + PATIENCE_S
    while len(seen) < 4:
        shown = cut_out(page, screenshot(page)).tobytes()
        assert shown in wanted, "a screenshot shows no state that was sent"
        seen.add(shown)
        assert time.monotonic() < deadline, "it does not play"


CANVAS = """() => {
    const { width, height } = canvas, { gl } = painter, row = 4 * width;
    const read = gl ? new Uint8Array(row * height) : context().data;
    function context() { return canvas.getContext("2d").getImageData(0, 0, width, height); }
    if (gl) gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, read);
    let text = "";
    for (let y = 0; y < height; y++) {
        const at = row * (gl ? height - 1 - y : y);
        text += String.fromCharCode(...read.subarray(at, at + row));
    }
    return btoa(text);
}"""
"""Script that gives what the canvas holds, before the browser takes it to the display."""


def pixels_of(page: Page, texts: list[str]) -> list[Image]:
    """What `CANVAS` gave, as images (H, W, 3)."""
    width, height = page.evaluate("[canvas.width, canvas.height]")
    images = [np.frombuffer(base64.b64decode(text), np.uint8) for text in texts]
    return [image.reshape(height, width, 4)[:, :, :3] for image in images]


def drawn_states(page: Page, player: Path, count: int) -> list[Image]:
    """Open a player, and draw its first ``count`` states."""
    page.goto(player.resolve().as_uri())
    wait_for(page, "window.player && painter && room")
    script = f"Array.from({{ length: {count} }}, (_, k) => (player.show(k), ({CANVAS})()))"
    return pixels_of(page, page.evaluate(script))


def assert_shown(shown: list[Image], wanted: list[Image]) -> None:
    for number, (image, state) in enumerate(zip(shown, wanted, strict=True)):
        np.testing.assert_array_equal(image, state, f"state {number}")


def ramp(height: int, width: int) -> Image:
    """From black to white, so that offsets meet both ends of what may be shown."""
    row = np.linspace(0, 255, width).round().astype(np.uint8)
    return np.stack([np.tile(row, (height, 1)), np.tile(row[::-1], (height, 1))] * 2, 2)[:, :, :3]


EXACT: dict[str, tuple[int, dict[str, Any], dict[str, Any]]] = {
    "on_off, ratex": (5, {"ratex": 5}, {}),
    "antipodal, ratex, odd": (5, {"ratex": 2, "modulation": "antipodal"}, {}),
    "antipodal, pilots, most": (64, {"pilots": 4, "modulation": "antipodal"}, {}),
    "antipodal, ratex, even": (5, {"ratex": 2, "modulation": "antipodal"}, {"even": True}),
}
"""Kappa, and what else a layout and a loop have, by what the page must show exactly."""


def exact_loop(case: str, *, upright: bool = False) -> Loop:
    """A loop of `EXACT` over three pictures, with no whole blocks."""
    kappa, words, more = EXACT[case]
    layout = make_layout(5, 6, 121, 83, **words)
    height, width = (121, 83) if upright else (83, 121)
    random = noise(height, width)
    gray = np.repeat(random[:, :, :1], 3, axis=2)
    size = (width, height)
    pictures = random, ramp(height, width), gray
    return make_loop(layout, kappa, *pictures, display_size=size, fit="contain", **more)


WAYS = ("by the graphics card", "without the graphics card")
"""How states are drawn; each case is drawn both ways, once wide and once upright."""


@pytest.mark.parametrize("upright", [False, True])
@pytest.mark.parametrize("case", EXACT)
def test_the_page_computes_what_is_embedded_to_the_gray_level(
    case: str, upright: bool, open_window: OpenWindow, tmp_path: Path
) -> None:
    by = WAYS[(list(EXACT).index(case) + upright) % 2]
    loop = exact_loop(case, upright=upright)
    write_player(tmp_path / "player.html", loop, 15, {})
    page = open_window(*loop.placement.display_size)
    if "without" in by:
        page.add_init_script(WITHOUT_CARD)
    sent = list(loop.states())
    assert len(sent) > 6
    assert_shown(drawn_states(page, tmp_path / "player.html", len(sent)), sent)
    assert by in page.evaluate("painter.word")


def offsets_at(loop: Loop, width: int, height: int) -> Iterator[NDArray[np.intp]]:
    """What is added to the picture in each state that is shown at another size, (H, W, 3)."""
    rule = Compact(loop.shown_layout, loop.kappa)

    def spread(numbers: NDArray[Any]) -> NDArray[np.intp]:
        rows, cols = numbers.shape
        return np.asarray(
            numbers[block_index(height, rows)[:, None], block_index(width, cols)], np.intp
        )

    patches = spread(rule.patches)
    y, x = np.indices((height, width)) % 4
    for carrier in loop.carriers():
        cells = np.asarray(block_changes(carrier.bits, loop.layout) > 0, np.intp)
        cells = cells if carrier.steps is None else 2 * carrier.steps + cells
        numbers = np.where(patches > 0, patches, spread(cells))
        for offsets in rule.offsets[int(carrier.turned)]:
            yield offsets[numbers, y, x]


def resized(picture: Image, width: int, height: int) -> Array:
    """A picture at another size, by a triangle as wide as the larger of both sizes' pixels."""

    def weights(given: int, wanted: int) -> Array:
        ratio = given / wanted
        centres = (np.arange(wanted) + 0.5) * ratio - 0.5
        reach = np.ceil(max(ratio, 1))
        near = np.arange(-reach, given + reach)
        rows = np.maximum(1 - np.abs(near - centres[:, None]) / max(ratio, 1), 0)
        matrix = np.zeros((wanted, given))
        np.add.at(matrix.T, np.clip(near, 0, given - 1).astype(int), rows.T)
        return matrix / matrix.sum(axis=1, keepdims=True)

    tall, wide = weights(picture.shape[0], height), weights(picture.shape[1], width)
    return np.asarray(np.einsum("ij,jkc,lk->ilc", tall, picture, wide, optimize=True))


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(EXACT)))
def test_in_other_windows_the_display_s_own_pixels_change_as_they_should(
    number: int, open_window: OpenWindow, tmp_path: Path
) -> None:
    """All states of a picture lie around one resized picture, exactly."""
    upright, window = number % 2 > 0, ((300, 200), (97, 73), (121, 82))[number % 3]
    loop = exact_loop(list(EXACT)[number], upright=upright)
    write_player(tmp_path / "player.html", loop, 15, {})
    page = open_window(*(window[::-1] if upright else window))
    carriers = list(loop.carriers())
    states = drawn_states(page, tmp_path / "player.html", 2 * len(carriers))
    states = [np.rot90(state, -1) if upright else state for state in states]
    height, width = states[0].shape[:2]
    assert width == window[0] or height == window[1]
    rule = Compact(loop.shown_layout, loop.kappa)
    offsets = list(offsets_at(loop, width, height))
    for number in range(3):
        chosen = [k for k in range(len(states)) if k // 2 % 3 == number]
        lowest = np.min([offsets[k] for k in chosen], axis=0)
        highest = np.max([offsets[k] for k in chosen], axis=0)
        around = [states[k].astype(int) - offsets[k] for k in chosen]
        carrier = carriers[number]
        wanted = resized(rule.picture(carrier.picture, carrier.steps), width, height)
        wanted = np.clip(wanted, -lowest, 255 - highest)
        assert np.abs(around[0] - wanted).max() < 0.51
        assert_shown(around, [around[0]] * len(around))


@cases(
    ("given[6][40] ^= 1", "it changes gray levels"),
    ("for (const end = performance.now() + 70; performance.now() < end;);", "it takes "),
)
def test_a_graphics_card_that_changes_levels_or_is_slow_is_not_used(
    fault: str, word: str, open_window: OpenWindow, player: Path, small: Loop
) -> None:
    page = open_window(300, 200)
    page.add_init_script(f"""
        const read = WebGL2RenderingContext.prototype.readPixels;
        WebGL2RenderingContext.prototype.readPixels = function (...given) {{
            read.apply(this, given);
            {fault};
        }};
    """)
    sent = list(small.states())
    assert_shown(drawn_states(page, player, len(sent)), sent)
    wait_for(page, "player.ready")
    page.keyboard.press("i")
    said = f"120 × 80 pixels, drawn without the graphics card ({word}"
    assert said in page.evaluate("line.textContent")


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
    wait_for(page, "asked.length > 0 && room")
    page.evaluate(
        f"loop.state_hz = {state_hz}; while (!player.ready) refresh(1000 / {hz});"
        "stats.refreshes = stats.dropped = 0; player.show(0);"
    )


def after_refreshes(page: Page, gaps: list[float]) -> list[Image]:
    """What the canvas holds after each of some refreshes, by the milliseconds before it."""
    return pixels_of(
        page, page.evaluate(f"(gaps) => gaps.map((gap) => (refresh(gap), ({CANVAS})()))", gaps)
    )


def test_a_late_refresh_is_told_and_the_states_keep_time(
    open_window: OpenWindow, player: Path, small: Loop
) -> None:
    page = open_window(120, 80)
    at_display(page, player, 60, state_hz=60)
    sent = list(small.states())
    late = [*[1000 / 60] * 4, 50.0, *[1000 / 60] * 3, 34.0, *[1000 / 60] * 40]
    number, wanted = 0, []
    for gap in late:
        number += round(gap * 60 / 1000)
        wanted.append(sent[number % len(sent)])
    assert_shown(after_refreshes(page, late), wanted)
    assert page.evaluate("stats.dropped") == 3
    assert page.evaluate("getComputedStyle(line).display") == "none"
    page.keyboard.press("I")
    assert page.evaluate("getComputedStyle(line).display") == "block"
    assert "/ 1 = 59.98 states/s, 3 refreshes skipped" in page.evaluate("line.textContent")


@cases(
    (60, 120, 1, "60.0 states a second, not 120 as asked"),
    (75, 15, 5, ""),
)
def test_the_rate_is_the_least_that_is_not_slower_and_that_the_display_has(
    hz: float, asked: float, hold: int, word: str, open_window: OpenWindow, player: Path
) -> None:
    page = open_window(120, 80)
    at_display(page, player, hz, asked)
    assert page.evaluate("[player.hold, player.rate]") == [hold, pytest.approx(hz / hold)]
    page.evaluate(f"for (let k = 0; k < {6 * hold}; k++) refresh(1000 / {hz})")
    assert page.evaluate("[player.count, stats.dropped]") == [6, 0]
    page.evaluate(f"refresh({3 * hold * 1000 / hz})")  # three states pass at once
    assert page.evaluate("[player.count, stats.dropped]") == [9, 3 * hold - 1]
    said = page.evaluate("note.textContent")
    assert word in said
    assert ("as asked" in said) == bool(word)


@pytest.mark.slow
def test_on_another_display_the_loop_goes_on_where_it_is(
    open_window: OpenWindow, player: Path
) -> None:
    page = open_window(120, 80)
    at_display(page, player, 60, state_hz=60)
    page.evaluate("for (let k = 0; k < 7; k++) refresh(1000 / 60); player.pause()")
    page.evaluate("for (let k = 0; k < 300; k++) refresh(1000 / 120); player.play()")
    assert page.evaluate("[player.hold, player.count]") == [2, 7]
    page.evaluate("for (let k = 0; k < 6; k++) refresh(1000 / 120)")
    assert page.evaluate("player.count") == 10


# The clock, on the browser's own refreshes, which are few in windows of less than 100 x 100 pixels


@pytest.mark.slow
def test_at_60_states_a_second_canvas_and_screenshots_are_the_states_in_order(
    open_window: OpenWindow, small: Loop, tmp_path: Path
) -> None:
    write_player(tmp_path / "player.html", small, 60, {})
    page = open_window(120, 160)
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
    wanted = {state.tobytes() for state in sent}
    for _ in range(5):
        assert cut_out(page, screenshot(page)).tobytes() in wanted


@pytest.mark.slow
def test_a_page_of_a_fine_grid_is_small(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    layout = make_layout(48, 64, modulation="antipodal", pilots="auto")
    noise = rng.integers(0, 256, (384, 512, 3), dtype=np.uint8)  # which nothing packs
    bits = rng.integers(0, 2, (100, layout.n_bits), dtype=np.uint8)
    write_player(tmp_path / "player.html", Loop(layout, 1, bits, lambda: iter([noise])), 60, {})
    page = (tmp_path / "player.html").stat().st_size
    assert page - 4 / 3 * noise.size - bits.size < 50_000  # little more than picture and bits


# People


@pytest.mark.slow
def test_it_starts_by_itself_and_text_and_pointer_go_when_nothing_moves(
    open_window: OpenWindow, player: Path
) -> None:
    page = open_window(300, 200)
    load(page, player)
    assert page.evaluate("player.playing")
    assert "point its camera at the picture" in page.evaluate("note.textContent")
    assert page.title() == "OORC: hidden camera–display communication"
    seen = "[getComputedStyle(note).display, getComputedStyle(document.body).cursor]"
    wait_for(page, f"{seen}.join() === 'none,none'")
    for move in (
        lambda: (page.mouse.move(50, 60), page.mouse.move(60, 60)),
        lambda: page.keyboard.press("a"),
        lambda: page.keyboard.press("Space"),
    ):
        page.evaluate("document.body.classList.add('rest')")  # as it does by itself after a while
        assert page.evaluate(seen) == ["none", "none"]
        move()
        assert page.evaluate(seen) == ["block", "auto"]
    assert "Paused" in page.evaluate("note.textContent")


def test_keys_work_with_caps_lock_and_arrows_show_the_states_one_after_another(
    open_window: OpenWindow, player: Path, small: Loop
) -> None:
    page = open_window(120, 160)
    at_display(page, player, 60, state_hz=15)
    sent = list(small.states())
    page.keyboard.press("I")
    assert "= 15.00 states/s" in page.evaluate("line.textContent")
    page.keyboard.press("Shift+I")
    assert page.evaluate("line.hidden")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("player.count") == 0  # only while it pauses
    page.keyboard.press("Space")
    assert page.evaluate("note.checkVisibility()")
    for key, number in [("Left", -1), ("Left", -2), ("Right", -1), ("Right", 0), ("Right", 1)]:
        page.keyboard.press(f"Arrow{key}")
        assert not page.evaluate("note.checkVisibility()")
        assert page.evaluate("shown") == number % len(sent)
        np.testing.assert_array_equal(cut_out(page, screenshot(page)), sent[number])
    page.keyboard.press("Space")
    page.evaluate("for (let k = 0; k < 4; k++) refresh(1000 / 60)")
    assert page.evaluate("shown") == 2
    page.keyboard.press("F")
    wait_for(page, "document.fullscreenElement")


def test_a_picture_is_as_large_as_a_turned_window_allows_and_survives_the_card_s_loss(
    open_window: OpenWindow, player: Path
) -> None:
    page = open_window(300, 150, 2)
    start(page, player)
    sizes = "[canvas.width, canvas.height, document.documentElement.scrollWidth]"
    assert page.evaluate(sizes) == [450, 300, 300]
    page.set_viewport_size({"width": 150, "height": 300})
    wait_for(page, "canvas.width === 300")
    assert page.evaluate(sizes) == [300, 200, 150]
    assert cut_out(page, screenshot(page)).std() > 20
    page.evaluate("window.lost = painter.gl.getExtension('WEBGL_lose_context'), lost.loseContext()")
    wait_for(page, "painter.gl.isContextLost()")
    page.evaluate("lost.restoreContext()")
    wait_for(page, "!painter.gl.isContextLost()")
    wait_for(page, "canvas.width === 300")
    page.evaluate("player.pause(), document.body.classList.add('rest')")
    assert cut_out(page, screenshot(page)).std() > 20


def test_flicker_that_is_seen_is_played_when_somebody_agrees(
    open_window: OpenWindow, small: Loop, tmp_path: Path
) -> None:
    write_player(tmp_path / "player.html", small, 15, {15: "seen"})
    page = open_window(300, 200)
    load(page, tmp_path / "player.html")
    assert not page.evaluate("player.playing")
    assert "flickers visibly" in page.inner_text("p")
    page.keyboard.press(" ")
    assert page.evaluate("player.playing")
    assert "flickers" not in page.inner_text("p")


@cases((0,), (4,))
def test_a_display_that_begins_to_save_power_is_noticed_within_a_second(
    seconds: int, open_window: OpenWindow, small: Loop, tmp_path: Path
) -> None:
    """Half of the refreshes come, from the beginning or later; what is seen then is not played."""
    write_player(tmp_path / "player.html", small, 60, {60: "", 50: "", 30: "seen", 15: "flashes"})
    page = open_window(300, 200)
    at_display(page, tmp_path / "player.html", 60 if seconds else 30, state_hz=60)
    if seconds:
        page.evaluate(f"for (let k = 0; k < {60 * seconds}; k++) refresh(1000 / 60)")
        assert page.evaluate("[player.playing, player.rate]") == [True, pytest.approx(60)]
        page.evaluate("for (let k = 0; k < 20; k++) refresh(1000 / 30)")
    assert page.evaluate("[player.playing, player.warning, stats.hz]") == [
        False,
        "seen",
        pytest.approx(30, 0.01),
    ]
    said = page.inner_text("p")
    assert "flickers visibly" in said and "30.0 states a second, not 60" in said
    assert page.evaluate("note.checkVisibility()")
    page.evaluate("for (let k = 0; k < 40; k++) refresh(1000 / 60)")
    assert page.evaluate("player.playing")  # by itself, as nobody sees it any more
    page.evaluate("for (let k = 0; k < 40; k++) refresh(1000 / 30)")
    page.keyboard.press(" ")
    assert page.evaluate("player.playing")
    page.evaluate("for (let k = 0; k < 20; k++) refresh(1000 / 15)")
    assert page.evaluate("[player.playing, player.warning]") == [False, "flashes"]  # worse
