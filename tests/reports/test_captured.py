"""Own films and photographs become captures with the right truth, or are refused."""

import functools
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from conftest import Command, cases
from numpy.typing import NDArray

import evaluate
from data_gen.channel.stills import capture
from data_gen.film.codec import through_codec
from data_gen.film.message import FilmSettings, Take, film_message
from data_gen.pairs import get_pair
from data_gen.pictures.library import load_pictures
from link.captures import read_manifest
from link.embed import embed
from link.errors import InputError
from link.frames import Captured, SoftBits
from link.images import write_image
from link.images.files import read_image
from link.layout import Layout, make_layout
from link.observation import Observation
from link.presets import PRESETS
from receiver.reading.reader import DecodedPair
from receiver.reading.shown import States
from receiver.reading.states import DisplayState
from reports.captured import door
from reports.captured.door import (
    Recordings,
    bench_part,
    check_film,
    open_recordings,
    photographed,
)
from reports.captured.evidence import film_evidence
from reports.captured.receive import Cut, Reception, stretches
from reports.captured.sent import Sent, read_sent, sent_bits
from reports.captured.truth import match_loop
from reports.engine.records import read_predictions
from sender import __main__ as send
from sender.bench import PARTS

Bits = NDArray[np.integer]
LOOP = np.random.default_rng(3).integers(0, 2, (28, 59))
OTHER = np.random.default_rng(4).integers(0, 2, (28, 59))


def read(bits: Bits, wrong: float = 0.03, seed: int = 0) -> NDArray[np.float64]:
    """Scores of bits of which a share is wrong, as sure as that share says."""
    rng = np.random.default_rng(seed)
    sure = np.log((1 - wrong) / wrong)
    flipped = rng.random(bits.shape) < wrong
    return np.where((bits > 0) ^ flipped, sure, -sure)


def shown(start: int, count: int, loop: Bits = LOOP) -> Bits:
    return loop[(start + np.arange(count)) % len(loop)]


# What a part of a film shows


@pytest.mark.parametrize("start", [0, 21])
@pytest.mark.parametrize("wrong", [0.001, 0.25])
def test_a_film_may_start_anywhere(start: int, wrong: float) -> None:
    found = match_loop(read(shown(start, 9), wrong), LOOP)
    assert (found.kind, found.place) == ("fits", start)
    np.testing.assert_array_equal(found.bits, shown(start, 9))


@pytest.mark.parametrize("at", [1, 8])
@pytest.mark.parametrize("to", [0, 17])
def test_a_cut_within_a_part_is_seen(at: int, to: int) -> None:
    bits = np.concatenate([shown(3, at), shown(3 + at + 1 + to, 9 - at)])
    assert match_loop(read(bits), LOOP).kind == "jumps"


@pytest.mark.parametrize("wrong", [0.1, 0.28])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_cut_that_shifts_the_code_is_seen_by_a_decoder_that_expects_more_wrong_bits(
    wrong: float, backwards: bool
) -> None:
    """Behind the cut the code's signs are those of another place: states seem to be exchanged."""
    rng = np.random.default_rng(5)
    loop = rng.integers(0, 2, (32, 700))
    signs = rng.integers(0, 2, (8, 1))
    bits = np.concatenate([shown(3, 24, loop), shown(3 + 24 + 7, 8, loop) ^ signs])
    careful = read(bits, wrong) / 2  # it expects 25 % and 38 %
    along = slice(None, None, -1 if backwards else 1)
    assert match_loop(careful[along], loop[along]).kind == "jumps"
    assert match_loop((read(shown(3, 32, loop), wrong) / 2)[along], loop[along]).kind == "fits"


@pytest.mark.parametrize(
    "bits",
    [
        shown(0, 9, OTHER),
        1 - shown(4, 9),  # the two states the other way round
        shown(4, 9)[::-1],
        np.repeat(shown(4, 3), 3, axis=0),  # each frame pair held for three
    ],
)
def test_what_fits_no_part_is_no_truth(bits: Bits) -> None:
    assert match_loop(read(bits), LOOP).kind in ("other", "jumps")


def test_what_is_not_read_is_no_truth() -> None:
    noise = np.random.default_rng(0).normal(size=(9, 59)) * 0.2
    assert match_loop(noise, LOOP).kind == "unclear"
    assert match_loop(np.zeros((9, 59)), LOOP).kind == "unclear"


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ([shown(0, 9), shown(9, 9), shown(18, 9)], None),
        ([shown(0, 9), shown(20, 9), shown(3, 9)], None),  # cut between two parts
        ([shown(0, 9), shown(0, 9, OTHER), shown(20, 9)], None),  # a cut makes one part strange
        ([shown(0, 9), shown(9, 9), shown(0, 9, OTHER)], "from 2.0 s on it is read well"),
        ([shown(0, 9, OTHER), shown(0, 9)], "from 0.0 s on it is read well"),
        ([shown(0, 9), *[shown(k, 9, OTHER) for k in (0, 9)], shown(3, 9)], "from 1.0 s"),
        ([np.concatenate([shown(0, 4), shown(15, 5)])], "does not go on as the loop"),
    ],
)
def test_films_are_right_or_refused(parts: list[Bits], words: str | None) -> None:
    scores = [read(part) for part in parts]
    cuts = [Cut(at, at + 1.0, make_layout(), part, None) for at, part in enumerate(scores)]
    matches = [match_loop(part, LOOP) for part in scores]
    if words is None:
        check_film(Path("film.mp4"), cuts, matches)
        for match, part in zip(matches, parts, strict=True):
            if match.kind == "fits":
                np.testing.assert_array_equal(match.bits, part)
    else:
        with pytest.raises(InputError, match=words):
            check_film(Path("film.mp4"), cuts, matches)


def test_frame_pairs_that_were_decoded_late_keep_the_time_at_which_they_were_shown() -> None:
    """The first ones wait until the clock is found, and those after a break count anew."""
    layout = make_layout()
    state = DisplayState(np.zeros((8, 8), np.uint8), np.ones((2, 2)), 1)
    shown = States(state, state, layout.message_mask)
    decoded = [(0, 0.8), (1, 0.8), (2, 0.9), (3, 0.9), (4, 1.0), (5, 1.2), (40, 2.5)]
    soft = SoftBits(np.ones(layout.n_bits))
    pairs = [DecodedPair(number, time, soft, shown, 0.0) for number, time in decoded]
    times = [[p.time for p in cut.pairs] for cut in stretches(pairs, layout, state_hz=10.0)]
    np.testing.assert_allclose(times[0], 0.2 * np.arange(6), atol=1e-9)
    np.testing.assert_allclose(times[1], [2.3])
    kept = stretches(pairs, layout, state_hz=None)
    assert [p.time for cut in kept for p in cut.pairs] == [time for _, time in decoded]


# What was sent


@pytest.mark.slow
def test_player_and_states_say_the_same(tmp_path: Path, command: Command) -> None:
    preset = "robust"
    layout = PRESETS[preset].layout
    picture = load_pictures("test", layout.width, layout.height)[0].rgb
    write_image(tmp_path / "picture.png", picture)
    flags = [tmp_path / "picture.png", "--message", "Hi", "--preset", preset, "--out"]
    command(send.main, *flags, tmp_path / "sent")
    command(send.main, *flags, tmp_path / "sent.html")
    (player,) = read_sent(tmp_path / "sent.html")
    (states,) = read_sent(tmp_path / "sent" / "sent.json")
    assert (player.layout, player.kappa) == (states.layout, states.kappa) == (layout, player.kappa)
    rounds = np.arange(len(states.bits)) % len(player.bits)
    np.testing.assert_array_equal(states.bits, player.bits[rounds])


@pytest.mark.parametrize("kappa", [1, 10])
def test_bits_are_read_from_the_states(tmp_path: Path, layout: Layout, kappa: int) -> None:
    rng = np.random.default_rng(kappa)
    picture = load_pictures("test", layout.width, layout.height)[1].rgb
    states = embed(picture, rng.integers(0, 2, layout.n_bits), layout, kappa)
    paths = [tmp_path / "a.png", tmp_path / "b.png"]
    for path, state in zip(paths, (states.original, states.embedded), strict=True):
        write_image(path, state)
    assert np.array_equal(sent_bits(paths, layout, kappa), states.bits)


@pytest.mark.parametrize("content", ["", "<html>", '<script type="application/json" id="loop">{}'])
def test_what_is_no_player_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "player.html").write_text(content)
    with pytest.raises(InputError, match="is no player"):
        read_sent(tmp_path / "player.html")


# Photographs


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Sent]:
    """Photographs of four frame pairs from a tripod, and what was sent."""
    folder, layout = tmp_path_factory.mktemp("photos"), make_layout()
    picture = load_pictures("test", layout.width, layout.height)[0].rgb
    bits = np.random.default_rng(1).integers(0, 2, (4, layout.n_bits))
    for number, own in enumerate(bits):
        rng = np.random.default_rng(7)  # the camera stands still
        taken = capture(embed(picture, own, layout, 3), get_pair("canon-lg"), 30.0, rng)
        for kind in ("original", "embedded"):
            name = f"{2 * number + (kind == 'embedded')}.png"
            write_image(folder / name, getattr(taken, kind))
    return folder, Sent(layout, 3, bits, "")


@pytest.mark.slow
def test_photographs_in_order_become_captures(photos: tuple[Path, Sent]) -> None:
    folder, sent = photos
    found = photographed(folder, sent)
    assert all(isinstance(each, Captured) for each in found)
    np.testing.assert_array_equal([each.bits for each in found], sent.bits)


@pytest.mark.slow
@cases(
    ([0, 1, 2, 3, 5, 6, 7, 7], 5),  # fifth missing, last doubled
    ([0, 1, 3, 2, 4, 5, 6, 7], 3),  # pair of states turned round
    ([4, 3, 6, 1, 0, 5, 2, 7], 1),  # shuffled
)
def test_photographs_out_of_order_are_refused(
    order: list[int], first: int, photos: tuple[Path, Sent], tmp_path: Path
) -> None:
    folder, sent = photos
    for place, number in enumerate(order):
        (tmp_path / f"{place}.png").write_bytes((folder / f"{number}.png").read_bytes())
    with pytest.raises(InputError, match=f"no. {first} "):
        photographed(tmp_path, sent)


@pytest.mark.slow
@pytest.mark.parametrize("change", ["other message", "too few"])
def test_photographs_of_something_else_are_refused(
    change: str, photos: tuple[Path, Sent], tmp_path: Path
) -> None:
    folder, sent = photos
    if change == "other message":
        with pytest.raises(InputError, match=r"no\. 1 "):
            photographed(folder, replace(sent, bits=1 - sent.bits[::-1]))
        return
    write_image(tmp_path / "1.png", read_image(folder / "1.png"))
    with pytest.raises(InputError, match="1 photographs of 8 states"):
        photographed(tmp_path, sent)


# A film from end to end


@pytest.mark.slow
def test_a_film_is_evaluated_and_goes_on_where_it_was_cut_off(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    kappa = PRESETS["robust"].kappa
    settings = FilmSettings(
        preset="robust", kappa=kappa, n_bytes=40, coverage=(0.5, 0.6), size=(800, 450)
    )
    filmed = film_message(Take(settings, "canon-lg", 10.0, 0, 0))
    frames = tmp_path / "film_10deg"
    for frame in through_codec(filmed.frames, settings.codec, settings.fps):
        if frame.time_s > 1.8:
            break
        number = round(frame.time_s * settings.fps)  # frames that were lost are gaps
        write_image(frames / f"{number:03d}.png", frame.rgb)
    sent = Sent(settings.layout, settings.kappa, filmed.bits.astype(np.int64), "digest")
    monkeypatch.setattr("reports.captured.door.read_sent", lambda path: (sent,))
    monkeypatch.setattr(door, "watch", functools.cache(door.watch))  # which two runs would do
    out = tmp_path / "run"
    run = ["--captures", frames, "--sent", tmp_path / "player.html", "--out", out, "--jobs", 1]
    run += ["--methods", "naive", "oorc"]
    command(evaluate.main, *run)
    rows = json.loads((out / "metrics.json").read_text())["rows"]
    assert {row["method"]: row["accuracy"] > 0.75 for row in rows} == {"naive": True, "oorc": True}
    assert {(row["pair"], row["view_deg"]) for row in rows} == {("film_10deg", 10.0)}
    entries = read_manifest(out / "captures")
    assert all(entry.meta["film"] == "film_10deg" for entry in entries)
    spans = [(entry.meta["time_s"], entry.meta["end_s"]) for entry in entries]
    assert len(spans) > 1, spans
    assert all(begin > end for (_, end), (begin, _) in pairwise(spans)), "windows share frames"
    predictions = out / "predictions.jsonl"
    before = predictions.read_bytes()
    predictions.write_bytes(before[: len(before) // 2])
    command(evaluate.main, *run)
    assert predictions.read_bytes() == before
    page = (out / "report.html").read_text()
    assert "What the receiver saw" in page
    evidence = film_evidence(out / "captures", read_predictions(predictions), out, pictures=False)
    assert 0.3 < evidence.bits_s["film_10deg"] / evidence.blocks_s <= 1
    other = replace(sent, bits=1 - sent.bits)
    monkeypatch.setattr("reports.captured.door.read_sent", lambda path: (other,))
    done = command(evaluate.main, *run[:4], "--out", tmp_path / "other", status=2)
    assert "does not show what --sent holds" in done.stderr


@pytest.mark.slow
def test_a_bench_says_what_each_part_shows(tmp_path: Path, command: Command) -> None:
    command(send.main, "--bench", "--out", tmp_path / "bench.html")
    parts = {part.part: part for part in read_sent(tmp_path / "bench.html")}
    assert list(parts) == list(PARTS)
    assert (parts["fast"].layout, parts["fast"].kappa) == (PRESETS["fast"].layout, 3)
    assert parts["hidden, 30 states"].state_hz == 30
    hidden, stronger = parts["hidden"], parts["hidden, kappa 2"]  # told apart by their bits
    layout = hidden.layout
    gray = np.zeros((layout.height, layout.width), np.uint8)
    window = Observation.still(gray, gray, layout)
    scores = read(stronger.bits[:1])
    reception = Reception([Cut(at, at + 1.0, layout, scores, window) for at in (0, 1)])
    assert bench_part(reception, stronger)[1] == 2.0
    assert bench_part(reception, hidden)[1] == 0.0


def test_of_several_films_those_that_are_not_read_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout = make_layout()
    gray = np.zeros((layout.height, layout.width), np.uint8)
    cut = Cut(0.0, 1.0, layout, read(shown(0, 1)), Observation.still(gray, gray, layout))
    receptions = {"dark": Reception([], {"silence": "no display"}), "good": Reception([cut])}
    monkeypatch.setattr("reports.captured.door.watch", lambda film, *_: receptions[film.name])
    dark, good = (
        (Path(name), (Sent(layout, 3, LOOP.astype(np.int64), ""),)) for name in receptions
    )
    notes = Recordings((dark, good), False, {}).record(tmp_path / "both")
    assert notes == ["left out: dark: no display"]
    assert [entry.meta["film"] for entry in read_manifest(tmp_path / "both")] == ["good"]
    (tmp_path / "both" / "films.json").write_text('{"notes": 5}')
    with pytest.raises(InputError, match=r"films\.json: .*array"):
        Recordings((), False, {}).record(tmp_path / "both")
    with pytest.raises(InputError, match="dark: no display"):
        Recordings((dark,), False, {}).record(tmp_path / "one")


def test_a_place_without_films_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such film"):
        open_recordings(tmp_path / "no", tmp_path, False, {})
