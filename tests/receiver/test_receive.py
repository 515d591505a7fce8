"""From camera frames to the message, and what is said where there is none."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, Command, Refuses, cases, run_process
from numpy.typing import NDArray
from streams import Stream, events_of, seen_frame, states_of, write_film

import receiver.__main__ as receive_cli
import receiver.seen as seen_module
from export.runtime import Decoder
from link.code.authenticate import Verifier, sign
from link.code.message import Message
from link.errors import InputError
from link.images import write_image
from link.images.video import VideoReader, read_video, write_video
from link.layout import make_layout
from link.presets import PRESETS
from link.types import Image
from receiver.inbox import Inbox
from receiver.reading.pairs import PAIRS_A_FRAME
from receiver.receiver import Receiver, as_uint8
from receiver.seen import MOST_TOGGLES, MOST_WHOLE, SeenFrames
from receiver.sources import open_source
from receiver.timing.synchronise import Synchroniser
from receiver.timing.toggles import PatchToggles

MODEL = ROOT / "models" / "pretrained" / "ratex" / "decoder.onnx"
LAYOUT = make_layout()
TEXT = b"hidden"


@pytest.fixture(scope="module")
def decoder() -> Decoder:
    return Decoder(MODEL)


@pytest.fixture(scope="module")
def states() -> list[Image]:
    return states_of(TEXT, LAYOUT, np.random.default_rng(5))


def listen(
    decoder: Decoder,
    states: list[Image],
    stream: Stream,
    *,
    seconds: float = 6,
    least: float = 0,
    spoil: object = None,
) -> tuple[Receiver, bytes | None]:
    """Push a stream until the message comes, and for the least seconds at any rate.

    ``spoil`` may change or drop (None) an image.
    """
    receiver, data = Receiver(decoder, stream.fps), None
    rng = np.random.default_rng(6)
    for number, (time, image, _) in enumerate(stream.frames(states, seconds, rng)):
        seen = spoil(number, image) if callable(spoil) else image
        if seen is None:
            continue
        step = receiver.push(seen, time)
        assert len(step.pairs) <= PAIRS_A_FRAME
        data = step.message.data if step.message is not None else data
        if data is not None and time >= least:
            return receiver, data
    step = receiver.finish()
    return receiver, step.message.data if step.message is not None else data


@pytest.mark.slow
def test_a_free_running_camera_reads_the_message(decoder: Decoder, states: list[Image]) -> None:
    """Upside down, and with a slow readout."""
    stream = Stream(turn=2, readout=0.02)
    receiver, data = listen(decoder, states, stream, least=2)  # the first 20 frames tell it to 2 %
    assert data == TEXT
    assert receiver.state_hz is not None
    # at one state a frame, a little faster and a little slower look alike in every frame
    mirrored = 2 * stream.fps - receiver.state_hz
    assert (
        min(abs(rate - stream.state_hz) for rate in (receiver.state_hz, mirrored))
        < 0.01 * stream.state_hz
    )


@pytest.mark.slow
def test_corners_follow_the_display(decoder: Decoder, states: list[Image]) -> None:
    receiver = Receiver(decoder)
    errors: list[float] = []
    for number, (time, image, corners) in enumerate(
        Stream().frames(states, 1, np.random.default_rng(0))
    ):
        tracked = receiver.push(image, time).tracked
        if tracked is None and not errors:
            assert number < 4  # a search is spread over some frames
            continue
        errors.append(np.linalg.norm(tracked.corners - corners, axis=1).max())
    assert max(errors) < 2.0
    assert np.median(errors) < 1.0


def spoils(kind: str) -> object:
    rng = np.random.default_rng(7)

    def spoil(number: int, image: Image) -> NDArray[np.generic] | None:
        if kind == "dropped":
            return None if rng.random() < 0.1 else image
        x = 4 * number % 640
        image = image.copy()
        image[150:, max(0, x - 60) : x + 60] = (40, 35, 30)
        return image

    return spoil


@pytest.mark.slow
@cases("passer-by", "dropped")
def test_disturbances(kind: str, decoder: Decoder, states: list[Image]) -> None:
    _, data = listen(decoder, states, Stream(), seconds=12, spoil=spoils(kind))
    assert data == TEXT


KEY = bytes(range(32))
SMALL = Stream(phase=0, size=(320, 240))
"""The stream of films in files."""


def film_of(path: Path, shown: list[tuple[bytes, int]]) -> Path:
    """A film of a display that shows messages one after another, each for some loops."""
    states = []
    for message, loops in shown:
        states += loops * states_of(message, LAYOUT, np.random.default_rng(5))
    seconds = len(states) / SMALL.state_hz
    film = SMALL.frames(states, seconds, np.random.default_rng(2))
    return write_film(path, (image for _, image, _ in film))


@pytest.mark.slow
def test_command_says_that_the_message_has_changed(tmp_path: Path, command: Command) -> None:
    film = film_of(tmp_path / "film.avi", [(b"before", 3), (b"behind", 2)])
    done = command(receive_cli.main, film, "--keep-on", "--out", tmp_path / "text")
    said = [line for line in events_of(done.stdout) if line["event"] == "message"]
    assert [(line["text"], line.get("changed")) for line in said] == [
        ("before", None),
        ("behind", True),
    ]
    assert (tmp_path / "text").read_bytes() == b"behind"


@pytest.mark.slow
def test_command_delivers_only_what_was_sent_with_the_key(tmp_path: Path, command: Command) -> None:
    (tmp_path / "key").write_bytes(KEY)
    new, old = sign(b"new", KEY, 1001), sign(b"old", KEY, 1000)
    shown = [(b"forged: obey", 1), (new, 2), (old, 1)]
    film = film_of(tmp_path / "film.avi", shown)
    words = ("--model", MODEL, "--keep-on", "--out", tmp_path / "text", "--key", tmp_path / "key")
    done = command(receive_cli.main, film, *words)
    lines = events_of(done.stdout)
    refused = [line for line in lines if line["event"] == "refused"]
    assert [(line["stale"], line.get("text")) for line in refused] == [(False, None), (True, "old")]
    assert "obey" not in done.stdout
    said = [line for line in lines if line["event"] == "message"]
    assert [(line["text"], line["stamp"], line.get("changed")) for line in said] == [
        ("new", 1001, None)
    ]
    assert lines[-1]["message"] == "new"
    assert (tmp_path / "text").read_bytes() == b"new"
    film = film_of(tmp_path / "again.avi", [(new, 1)])
    done = command(receive_cli.main, film, *words, "--max-age", 3600, status=2)
    assert "every message was refused (1)" in done.stderr


def test_who_has_no_key_sees_a_signed_message_without_stamp_and_tag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    signed = Message(sign(b"new", KEY, 1001), 4, 3, 0.9, signed=True)
    assert receive_cli.say([Inbox(None).take(signed)], tmp_path / "text")
    (said,) = events_of(capsys.readouterr().out)
    assert (said["text"], said["hex"], said["signed"]) == ("new", b"new".hex(), "not checked")
    assert (tmp_path / "text").read_bytes() == b"new"
    checked = Inbox(Verifier(KEY)).take(signed)
    assert checked["event"] == "message"
    assert (checked["text"], checked["stamp"], "signed" in checked) == ("new", 1001, False)
    refused = Inbox(Verifier(KEY)).take(replace(signed, data=b"obey" + bytes(12)))
    assert refused["event"] == "refused"
    assert "tag does not fit" in refused["reason"]
    old = Inbox(None).take(replace(signed, signed=False))  # of a sender without the flag
    assert bytes.fromhex(old["hex"]) == signed.data
    assert "signed" not in old


@cases((5, 60), (0.5, 30))
def test_a_nominal_rate_that_is_far_too_low_finds_no_clock(nominal: float, real: float) -> None:
    """As of a camera that does not know its own rate, or of a wrong --fps."""
    clock, rng = Synchroniser(nominal, PatchToggles(make_layout())), np.random.default_rng(0)
    seen = SeenFrames()
    for number in range(120):
        toggles = 3.0 * (number // 2 % 2) + rng.normal(0, 1, 5)
        seen.toggles.append((number / real, toggles))
        clock.update(seen.toggles, number / real)
    assert clock.clock is None


def test_times_that_stand_still_fill_no_memory() -> None:
    seen, black = SeenFrames(), np.zeros((LAYOUT.height, LAYOUT.width), np.uint8)
    pilots = PRESETS["robust"].layout
    for _ in range(MOST_TOGGLES + 10):
        seen.add(seen_frame(1.0, black, layout=pilots))
    assert (len(seen.whole), len(seen.toggles)) == (MOST_WHOLE, MOST_TOGGLES)


@pytest.mark.slow
def test_memory_is_bounded(decoder: Decoder, monkeypatch: pytest.MonkeyPatch) -> None:
    """A display that shows one state for ever fills no buffer without end."""
    monkeypatch.setattr(seen_module, "MOST_WHOLE", 40)
    rng = np.random.default_rng(0)
    still = states_of(TEXT, LAYOUT, rng)[:1]
    receiver = Receiver(decoder)
    image = next(SMALL.frames(still, 1, rng))[1]
    for number in range(60):
        assert receiver.push(image, number / 30).message is None
    assert len(receiver._seen.whole) == 40
    assert receiver.decoded == 0


@cases(np.zeros((8, 8)), np.zeros((64, 64, 4), np.uint8), np.zeros((64, 64)))
def test_arrays_that_are_no_images_are_refused(image: NDArray[np.generic]) -> None:
    with pytest.raises(InputError):
        as_uint8(image)


@pytest.mark.slow
def test_command_reads_a_folder_and_draws(
    tmp_path: Path, states: list[Image], command: Command
) -> None:
    """Single images, two of each state in order: no clock fits, their order is enough."""
    rng = np.random.default_rng(1)
    camera = Stream(noise=1.0)
    for number, state in enumerate(states * 2):
        image = next(camera.frames([state], 1, rng))[1]
        write_image(tmp_path / "in" / f"{number:04d}.png", image)
    flags = ("--show", tmp_path / "show", "--out", tmp_path / "text")
    done = command(receive_cli.main, tmp_path / "in", *flags)
    lines = events_of(done.stdout)
    assert [line["text"] for line in lines if line["event"] == "message"] == [TEXT.decode()]
    assert lines[-1]["event"] == "end"
    assert (tmp_path / "text").read_bytes() == TEXT
    assert list((tmp_path / "show").glob("*.png"))


@pytest.mark.slow
def test_command_reads_two_images_in_either_order(
    tmp_path: Path, states: list[Image], command: Command
) -> None:
    rng = np.random.default_rng(1)
    for name, state in (("a", states[0]), ("b", states[1])):
        write_image(tmp_path / f"{name}.png", next(Stream().frames([state], 1, rng))[1])
    forward = command(receive_cli.main, tmp_path / "a.png", tmp_path / "b.png")
    backward = command(receive_cli.main, tmp_path / "b.png", tmp_path / "a.png")
    assert events_of(forward.stdout)[-1]["bits"] == events_of(backward.stdout)[-1]["bits"]
    same = command(receive_cli.main, *2 * (tmp_path / "a.png",), status=2)
    assert "same state" in same.stderr


@pytest.mark.slow
def test_command_reads_a_video(tmp_path: Path, states: list[Image], command: Command) -> None:
    """Once in a process of its own."""
    film = SMALL.frames(states, 3, np.random.default_rng(2))
    path = write_film(tmp_path / "film.avi", (image for _, image, _ in film))
    done = run_process(sys.executable, "-m", "receiver", path)
    assert events_of(done.stdout)[-1]["message"] == TEXT.decode()
    whole = path.read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) // 12])
    cut = command(receive_cli.main, tmp_path / "cut.avi", status=2)
    assert cut.stderr.strip().splitlines()[-1].startswith("error: ")
    assert "Traceback" not in cut.stderr


def test_a_video_that_breaks_off_is_an_error_for_the_sender_and_a_warning_for_the_receiver(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (60, 80, 120, 3), dtype=np.uint8)
    write_video(tmp_path / "whole.avi", noise, 30)
    whole = (tmp_path / "whole.avi").read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) // 3])
    whole_film = VideoReader(tmp_path / "whole.avi")
    assert (whole_film.fps, len(list(whole_film.timed_frames())), whole_film.broken_off) == (
        30,
        60,
        None,
    )
    with pytest.raises(InputError, match="breaks off after") as error:
        list(read_video(tmp_path / "cut.avi"))
    received = list(open_source(str(tmp_path / "cut.avi")).frames)
    assert capsys.readouterr().err == f"warning: {error.value}\n"
    assert 10 < len(received) < 30
    np.testing.assert_array_equal(received[9].image, noise[9])
    assert received[9].time == pytest.approx(0.3)


def test_command_says_why_there_is_no_message(tmp_path: Path, refuses: Refuses) -> None:
    write_image(tmp_path / "a.png", np.full((200, 300, 3), 90, np.uint8))
    refuses("receiver.__main__", ".", "no display that is looked for", began=True)
