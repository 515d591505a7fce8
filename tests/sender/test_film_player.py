"""The player of films in a real browser: what it shows over each picture is what Python embeds."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import wait_for
from conftest import Command, OpenWindow, Refuses, cases
from moving import write_moving
from playwright.sync_api import Page
from test_player import CANVAS, EXACT, pixels_of

import sender.__main__ as send_cli
import sender.player as player_module
from link.code import framing
from link.layout import make_layout
from link.loop import Loop
from link.types import Image
from sender.player import write_film_player

MESSAGE = b"Hi"
GIVEN_PICTURE = """() => {
    const { gl } = painter, { videoWidth: width, videoHeight: height } = film.video;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
    const picture = gl.getParameter(gl.TEXTURE_BINDING_2D);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, picture, 0);
    const read = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, read);
    let text = "";
    for (let i = 0; i < read.length; i += 4096) {
        text += String.fromCharCode(...read.subarray(i, i + 4096));
    }
    return [btoa(text), width, height];
}"""
"""Script that gives the picture of the film from which the card makes states, from its top."""
SEEK = """(time) => new Promise((resolve) => {
    const { video } = film;
    const presented = (_, { mediaTime }) => {
        if (Math.abs(mediaTime - time) > 0.2) {
            return void video.requestVideoFrameCallback(presented);
        }
        film.fresh = true;
        resolve();
    };
    video.pause();
    video.requestVideoFrameCallback(presented);
    video.currentTime = time;
})"""
"""Script that seeks and waits until that picture is presented, which may be later than `seeked`."""


def shown_over(page: Page, time: float, state: int) -> tuple[Image, Image]:
    """Give the film's picture at a time, and what the page shows over it as one of its states."""
    page.evaluate(SEEK, time)
    text = page.evaluate(f"(player.show({state}), ({CANVAS})())")
    given, width, height = page.evaluate(GIVEN_PICTURE)
    picture = np.frombuffer(base64.b64decode(given), np.uint8).reshape(height, width, 4)[..., :3]
    return picture, pixels_of(page, [text])[0]


def film_loop(case: str, size: tuple[int, int], given: tuple[int, int], **more: Any) -> Loop:
    """A loop of `EXACT` for a film of a size that is shown at another."""
    kappa, words, extra = EXACT[case]
    layout = make_layout(5, 6, 122, 84, **words)
    bits = framing.encode(MESSAGE, layout.n_bits)
    blank = np.zeros((given[1], given[0], 3), np.uint8)
    pictures = lambda: iter([blank])  # noqa: E731
    return Loop(layout, kappa, bits, pictures, display_size=size, moving=True, **more, **extra)


@cases(
    ("antipodal, ratex, even", (84, 122), (84, 160), "cover"),
    ("on_off, ratex", (122, 84), (122, 84), "contain"),
)
def test_states_over_a_films_pictures_are_those_of_python(
    case: str,
    size: tuple[int, int],
    given: tuple[int, int],
    fit: str,
    open_window: OpenWindow,
    tmp_path: Path,
) -> None:
    """Of a film of the size ``given``, shown at another."""
    film = write_moving(tmp_path / "film.webm", *given)
    loop = film_loop(case, size, given, fit=fit)
    write_film_player(tmp_path / "player.html", loop, film, 15, {})
    page = open_window(*size)
    page.goto((tmp_path / "player.html").as_uri())
    wait_for(page, "window.player && player.ready")
    seen = set()
    for number, time in enumerate((0.1, 0.6, 1.1, 1.6)):
        picture, shown = shown_over(page, time, number)
        seen.add(picture.tobytes())
        pair = loop.carrier(number // 2, picture).displayed()
        frame = (pair.original, pair.embedded)[number % 2]
        np.testing.assert_array_equal(shown, loop.placement.display_frame(frame, loop.layout))
    assert len(seen) == 4


@cases("inside", "beside")
def test_a_film_lies_in_the_page_or_in_scripts_beside_it(
    place: str,
    open_window: OpenWindow,
    tmp_path: Path,
    command: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if place == "beside":
        monkeypatch.setattr(player_module, "EMBEDDED_BYTES", 1000)
        monkeypatch.setattr(player_module, "PART_BYTES", 3000)
    film = write_moving(tmp_path / "film.webm", 160, 96)
    out = tmp_path / "out"
    out.mkdir()
    line = (film, "--message", "Hi", "--preset", "robust", "--out", out / "player.html")
    said = json.loads(command(send_cli.main, *line).stdout)
    assert said["pairs"] == said["frames"]
    parts = sorted(file.name for file in out.iterdir() if file.suffix == ".js")
    assert parts == [f"player.film-{n:02d}.js" for n in range(len(parts))]
    assert (len(parts) > 2) == (place == "beside")
    assert ("'self' file:" in (out / "player.html").read_text()) == (place == "beside")
    page = open_window(512, 384)
    page.goto((out / "player.html").as_uri())
    wait_for(page, "window.player && player.ready")
    page.keyboard.press(" ")  # as it flickers
    wait_for(page, "player.playing && film.video.currentTime > 0.2")


@pytest.mark.slow
def test_films_that_a_player_does_not_take_are_refused_in_one_line(
    tmp_path: Path, refuses: Refuses, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = write_moving(tmp_path / "film.webm", 160, 96)
    line = f"{film} --message Hi --out p.html --preset robust"
    monkeypatch.setattr(player_module, "MAX_FILM_BYTES", 1000)
    refuses("sender.__main__", line, "cut it or compress it", began=True)
    cut = tmp_path / "cut.webm"
    cut.write_bytes(film.read_bytes()[:200])
    refuses("sender.__main__", line.replace("film.webm", "cut.webm"), "cut.webm")
    cut.write_bytes(film.read_bytes()[: film.stat().st_size // 3])
    monkeypatch.setattr(player_module, "MAX_FILM_BYTES", 2**31)
    line = line.replace("film.webm", "cut.webm")
    refuses("sender.__main__", line, "the video breaks off before the 2.0 s", began=True)
