"""The study that sets the page's receiver beside Python's."""

import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from lab.films import browser, page
from lab.films.browser import open_chromium, serve_folder
from lab.films.page import FilmRead, PageFlags, PageTake, Read, page_table, read_films, stages_table
from lab.films.y4m import read_y4m, write_y4m
from lab.study import Workshop
from link.code.framing import encode
from link.errors import InputError
from reports.engine.backends import Backend


def read(data: str | None, time: float, **stages: float) -> Read:
    return Read(data, time, frames=10, seconds=0.5, stages=stages, waited=time / 2)


def films() -> list[FilmRead]:
    python = read("yes", 2.0, track=0.1)
    reads = [read("yes", 3.0, track=0.2), read(None, 9.0, track=0.2), read("no!", 2.0, track=0.2)]
    fields = "robust", "canon-lg", 0.0, "yes", python
    return [FilmRead(*fields, found, replace(found, time=found.time + 1)) for found in reads]


def cells_of(table: page.Table) -> list[str]:
    row = table.markdown().splitlines()[-1]
    return [cell.strip() for cell in row.strip("|").split("|")]


def test_what_did_not_come_and_what_is_wrong_count_apart() -> None:
    cells = cells_of(page_table(films(), "node"))
    assert cells[:2] == ["robust", "3"]
    assert cells[2].startswith("3 (") and cells[3].startswith("1 (")
    assert cells[4] == "1"
    assert cells[7] == "1.25 (1.00 – 1.50)"
    assert cells[8:] == ["20", "20"]


def test_before_a_camera_the_page_gets_ready_first() -> None:
    cells = cells_of(page_table(films(), "chromium"))
    assert cells[:10] == cells_of(page_table(films(), "node"))
    assert cells[10:] == ["1.5", "4.0"]


def test_stages_are_given_a_frame() -> None:
    row = stages_table(films()).markdown().splitlines()[-1]
    assert row == "| robust | track | 10.00 | 20.00 | 2.0 |"


def test_what_was_read_can_be_stored() -> None:
    for film in films():
        assert FilmRead.from_stored(asdict(film)) == film


def test_a_film_is_read_as_it_was_written(tmp_path) -> None:
    frames = list(np.random.default_rng(0).integers(0, 256, (3, 5, 7)).astype(np.uint8))
    file = tmp_path / "film.y4m"
    with file.open("wb") as stream:
        write_y4m(stream, frames, 30)
    np.testing.assert_array_equal(list(read_y4m(file)), frames)
    data = file.read_bytes()
    assert len(data) == data.index(b"\n") + 1 + 3 * (6 + 5 * 7 + 2 * 3 * 4)
    file.write_bytes(data[: data.index(b"FRAME", data.index(b"FRAME") + 5) + 20])
    assert len(list(read_y4m(file))) == 1
    file.write_bytes(b"RIFF")
    with pytest.raises(InputError, match="no film that this program wrote"):
        list(read_y4m(file))


@pytest.mark.parametrize("way", page.WAYS)
def test_films_that_were_read_are_not_read_again(way, tmp_path, monkeypatch) -> None:
    (tmp_path / "site").mkdir()
    asked = []

    def reading(take: PageTake) -> dict[str, object]:
        asked.append((take.way, take.setting, take.number))
        return asdict(films()[take.number])

    monkeypatch.setattr(page, "read_film", reading)
    flags = PageFlags(by=way, films=1, settings=("robust",))

    def read(films: int) -> list[FilmRead]:
        workshop = Workshop(tmp_path, Backend())
        return read_films(replace(flags, films=films), workshop, tmp_path / "site")

    assert read(1) == films()[:1]
    assert read(2) == films()[:2]
    assert asked == [(way, "robust", 0), (way, "robust", 1)]
    (tmp_path / "site" / "page.js").write_text("changed")
    assert read(1) == films()[:1]
    assert len(asked) == (3 if way == "chromium" else 2)
    (tmp_path / "site" / "worker.js").write_text("changed")
    assert read(1) == films()[:1]
    assert len(asked) == (4 if way == "chromium" else 3)


def test_films_of_both_ways_differ_in_length_alone(monkeypatch) -> None:
    monkeypatch.setattr(page, "film_message", lambda take: take)
    takes = {way: PageTake(way, "hidden", 3, 0, Path(), None).film() for way in page.WAYS}
    for way, take in takes.items():
        config = take.settings
        pairs = len(encode(bytes(100), config.layout.n_bits))
        assert config.loops * 2 * pairs / config.state_hz == pytest.approx(page.FILM_S[way])
    first, other = (replace(take.settings, loops=1.0) for take in takes.values())
    assert replace(takes["node"], settings=first) == replace(takes["chromium"], settings=other)


def test_a_film_that_is_kept_is_filmed_once(tmp_path, monkeypatch) -> None:
    written_at = []

    def write(stream, grays, fps: float) -> None:
        written_at.append(fps)
        stream.write(b"film")

    monkeypatch.setattr(page, "code_digest", lambda *modules: "")
    monkeypatch.setattr(page, "write_y4m", write)
    for kept in (None, tmp_path / "kept"):
        take = PageTake("node", "robust", 0, 0, Path(), kept)
        for _ in range(2):
            with page.film_file(take, take.film()) as path:
                assert path.read_text() == "film"
            assert path.exists() == (kept is not None)
    assert written_at == [30, 30, 30]


SEEN = """async () => {
  const [track] = (await navigator.mediaDevices.getUserMedia({ video: true })).getVideoTracks();
  const frames = new MediaStreamTrackProcessor({ track }).readable.getReader(), seen = [];
  while (seen.length < 5) {
    const { value: frame } = await frames.read(), data = new Uint8Array(frame.allocationSize());
    await frame.copyTo(data);
    seen.push([frame.timestamp, data[0]]);
    frame.close();
  }
  return seen;
}"""
"""Takes five frames of the camera: their times, in microseconds, and their first pixels."""


@pytest.mark.slow
def test_the_camera_gives_frames_of_the_film_at_their_times(tmp_path, open_window) -> None:
    (tmp_path / "index.html").touch()
    with (film := tmp_path / "other.y4m").open("wb") as stream:
        write_y4m(stream, (np.full((48, 64), 2 * number, np.uint8) for number in range(120)), 30)
    window = open_window(100, 100)
    window.add_init_script(page.CAMERA.read_text(encoding="utf-8"))
    with serve_folder(tmp_path, {"film.y4m": film, "camera.js": page.CAMERA}) as address:
        window.goto(address)
        seen = np.array(window.evaluate(SEEN))
    assert (np.diff(seen[:, 0]) > 0).all()
    np.testing.assert_array_equal(seen[:, 1], 2 * np.rint(seen[:, 0] * 30 / 1e6))


def test_what_is_missing_for_the_camera_is_said_in_one_line(monkeypatch) -> None:
    monkeypatch.setattr(browser.shutil, "which", lambda _: None)
    with pytest.raises(InputError, match=r"no Chromium: .* apt install chromium"), open_chromium():
        pass
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)
    with pytest.raises(InputError, match=r"Playwright is missing.*pip install"), open_chromium():
        pass
