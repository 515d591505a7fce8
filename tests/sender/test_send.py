"""The sender: what it writes holds the message, exactly, and wrong input gives one line."""

import base64
import json
import math
import re
import shutil
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import av
import cv2
import numpy as np
import pytest
from conftest import Command, Finished, Refuses, cases, run_process, slow
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from picture_files import Picture, profiled_pictures, saved, turned_pictures
from PIL import Image

import sender.__main__ as send_cli
from link.code import framing
from link.code.authenticate import sign, verify
from link.code.collect import make_collector
from link.embed import with_head_room
from link.errors import InputError
from link.images import fit_picture, write_image
from link.images.files import read_image
from link.images.video import read_video, write_video
from link.layout import MODULATIONS, Layout, make_layout
from link.loop import Loop
from link.pilot_code import PilotCode
from link.presets import DEFAULT_PRESET, PRESETS
from sender.hiding import MESSAGE_SEED, SECONDS, Hiding, Onlooker
from sender.pictures import note_coarse, open_pictures
from sender.player import write_player
from sender.visibility.flicker import contrast_over_threshold, high_end, random_message
from sender.visibility.viewing import PICTURE_LEVELS, Viewing
from sender.write import write_states

LAYOUT = make_layout(5, 6, 120, 80, 2)
GRID = ("--rows", 5, "--cols", 6, "--width", 120, "--height", 80, "--ratex", 2)
FLAGS = ("--preset", "paper", *GRID)
MESSAGE = "héllo"
SENT = framing.encode(MESSAGE.encode(), LAYOUT.n_bits)


def noise(height: int, width: int, seed: int = 0) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def read_bits(pair: tuple[NDArray[np.uint8], NDArray[np.uint8]], layout: Layout) -> list[int]:
    """Hard decisions by subtracting, one pixel from the middle of each message block."""
    added = pair[1].astype(int) - pair[0]
    bits = []
    for row, col in np.argwhere(layout.message_mask):
        top, bottom, left, right = layout.cell_box(int(row), int(col))
        bits.append(int(added[(top + bottom) // 2, (left + right) // 2, 0] > 0))
    return bits


def pairs_of(states: list[NDArray[np.uint8]]) -> list[tuple[Any, Any]]:
    return list(zip(states[::2], states[1::2], strict=True))


def unpacked(text: str, channels: int = 1) -> NDArray[np.intp]:
    """Numbers of the page, (N, channels)."""
    steps = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8)
    return np.cumsum(steps.reshape(-1, channels), axis=0, dtype=np.intp) % 256


def read_player(file: Path) -> dict[str, Any]:
    """The loop that the page holds."""
    held = re.findall(
        r'<script type="application/json" id="loop">(.*?)</script>', file.read_text(), re.DOTALL
    )
    assert len(held) == 1
    loop: dict[str, Any] = json.loads(held[0])
    return loop


def player_states(file: Path) -> list[NDArray[np.uint8]]:
    """The states that a page computes, by its rule, written here in numpy once more."""
    loop = read_player(file)
    width, height, rows, cols = (loop[name] for name in ("width", "height", "rows", "cols"))
    y, x = np.indices((height, width))
    offsets = unpacked(loop["offsets"], 3).reshape(2, 2, -1, 3) - 128
    patches = unpacked(loop["patches"]).reshape(height, width) if loop["patches"] else 0
    states = []
    for number, (picture, bits) in enumerate(zip(loop["shown"], loop["bits"], strict=True)):
        known, following = loop["known"][number % len(loop["known"])], iter(bits)
        letters = [next(following) if letter == "." else letter for letter in known]
        blocks = np.array(letters, np.intp).reshape(rows, cols)
        if loop["steps"][picture]:
            blocks += 2 * unpacked(loop["steps"][picture]).reshape(rows, cols)
        numbers = blocks[y * rows // height, x * cols // width]
        numbers = np.where(patches > 0, patches, numbers)
        packed = loop["pictures"][picture]
        channels = len(unpacked(packed)) // (width * height)
        levels = unpacked(packed, channels).reshape(height, width, channels)
        for half in offsets[number % 2]:
            state = levels + half[16 * numbers + 4 * (y % 4) + x % 4]
            assert state.min() >= 0
            assert state.max() <= 255  # so a page may add all channels at once
            states.append(state.astype(np.uint8))
    return states


def folder_states(folder: Path) -> list[NDArray[np.uint8]]:
    return [read_image(file) for file in sorted(folder.glob("state_*.png"))]


READ = {"": folder_states, ".html": player_states, ".avi": read_video, ".mkv": read_video}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    write_image(folder / "picture.png", noise(80, 120))
    for number in range(SENT.shape[0] + 2):
        write_image(folder / "many" / f"{number:02d}.png", noise(80, 120, number))
    (folder / "key").write_bytes(bytes(range(32)))
    (folder / "layout.json").write_text(json.dumps(LAYOUT.to_dict()))
    video = folder / "clip.avi"
    write_video(video, (np.full((80, 120, 3), number, np.uint8) for number in range(60)), 30)
    return folder


def notes(done: Finished) -> list[str]:
    """What is said on stderr, but of flicker, and that the pictures of these tests are small."""
    usual = ("looks coarse", "picture is dark", "the flicker is plain to see", "the blocks flash")
    return [line for line in done.stderr.splitlines() if not any(map(line.__contains__, usual))]


def report(done: Finished) -> Any:
    assert notes(done)[1:] == []
    assert re.match(r"note: [\d.]+ states a second need a camera of \d+ frames", notes(done)[0])
    assert len(done.stdout.splitlines()) == 1
    return json.loads(done.stdout)


Send = Callable[..., Any]


@pytest.fixture
def send(inputs: Path, command: Command) -> Send:
    """Write `MESSAGE` over a picture into ``out``, with more words; what the command reports."""

    def run(out: Path, *words: object, over: str = "picture.png") -> Any:
        line = (inputs / over, "--message", MESSAGE, "--out", out, *words)
        return report(command(send_cli.main, *line))

    return run


@pytest.mark.parametrize("kind", [slow(kind) if kind == ".mkv" else kind for kind in READ])
def test_every_output_holds_the_message(kind: str, tmp_path: Path, send: Send) -> None:
    out = tmp_path / f"sent{kind}"
    said = send(out, *FLAGS)
    states = list(READ[kind](out))
    assert [read_bits(pair, LAYOUT) for pair in pairs_of(states)] == SENT.tolist()
    assert list(tmp_path.iterdir()) == [out]  # no temporary file
    assert said["frames"] == said["pairs"] == len(SENT)
    assert said["message_bytes"] == len(MESSAGE.encode()) <= said["capacity_bytes"]
    assert said["capacity_bytes"] == framing.capacity(len(SENT), LAYOUT.n_bits)
    assert said["loop_seconds"] == said["message_seconds"] == round(2 * len(SENT) / 15, 3)
    assert said["bound_bit_per_s"] == LAYOUT.n_bits * 15 / 2 > said["message_bit_per_s"] > 0
    assert said["layout"] == LAYOUT.to_dict()
    errors = [np.mean((a.astype(float) - b) ** 2) for a, b in pairs_of(states)]
    assert said["psnr_db"] == pytest.approx(10 * np.log10(255**2 / np.mean(errors)), abs=0.006)
    assert 0.9 < said["ssim"] < 1


@pytest.mark.slow
def test_the_folder_says_what_was_sent(inputs: Path, tmp_path: Path, command: Command) -> None:
    out = tmp_path / "sent"
    out.mkdir()  # an empty folder will do
    done = command(
        send_cli.main,
        *(inputs / "picture.png", "--file", inputs / "layout.json", "--out", out),
        *("--layout", inputs / "layout.json", "--hold", 6),
    )
    said = report(done)
    assert json.loads((out / "sent.json").read_text()) | {"out": str(out)} == said
    assert said["state_hz"] == 10
    collector = make_collector(LAYOUT.n_bits)
    received = None
    for count, pair in enumerate(pairs_of(folder_states(out))):
        received = received or collector.add(
            8.0 * (2 * np.array(read_bits(pair, LAYOUT)) - 1), count
        )
    assert received.data == (inputs / "layout.json").read_bytes()


def test_a_key_adds_stamp_and_tag_to_the_message_and_nothing_else(
    inputs: Path, tmp_path: Path, send: Send
) -> None:
    send(tmp_path / "sent", *FLAGS, "--key", inputs / "key", "--counter", 5)
    signed = sign(MESSAGE.encode(), bytes(range(32)), 5)
    bits = framing.encode(signed, LAYOUT.n_bits, signed=True)
    shown = pairs_of(folder_states(tmp_path / "sent"))
    assert [read_bits(pair, LAYOUT) for pair in shown] == bits.tolist()
    before = int(time.time())
    send(tmp_path / "timed", *FLAGS, "--key", inputs / "key")
    shown = pairs_of(folder_states(tmp_path / "timed"))
    scores = np.array([read_bits(pair, LAYOUT) for pair in shown]) * 16.0 - 8
    received = framing.decode(scores)
    assert received is not None and received.signed
    found = verify(received.data, bytes(range(32)))
    assert before <= found.stamp <= time.time()


def test_a_folder_shows_every_picture_and_whole_messages(
    inputs: Path, tmp_path: Path, send: Send
) -> None:
    out = tmp_path / "sent"
    said = send(out, *FLAGS, over="many")
    assert said["pairs"] == 2 * said["frames"] == 2 * len(SENT)
    pictures = [with_head_room(read_image(f), 3) for f in sorted((inputs / "many").iterdir())]
    pairs = pairs_of(folder_states(out))
    mask = np.kron(LAYOUT.message_mask, np.ones((16, 20), bool))
    for number, pair in enumerate(pairs):
        np.testing.assert_array_equal(pair[0][mask], pictures[number % len(pictures)][mask])
        assert read_bits(pair, LAYOUT) == SENT[number % len(SENT)].tolist()


@cases(7.5, 45)
def test_a_video_shows_each_state_the_frame_of_its_time(state_hz: float, inputs: Path) -> None:
    shown = [int(frame[0, 0, 0]) for frame in open_pictures(inputs / "clip.avi", state_hz)()]
    count = 2 * math.ceil(2 * state_hz / 2)  # of two seconds, in whole frame pairs
    assert shown == [min(59, int(30 * k / state_hz + 1e-3)) for k in range(count)]


def test_images_of_a_folder_stay_for_seconds(
    inputs: Path, tmp_path: Path, refuses: Refuses
) -> None:
    pictures = list(open_pictures(inputs / "many", 15, seconds=0.4)())
    assert len(pictures) == 3 * (len(SENT) + 2)
    assert pictures[0] is pictures[2] and pictures[2] is not pictures[3]
    line = f"{inputs / 'many'} --message Hi --out x.mkv --seconds"
    for seconds in (0.01, 4000):
        refuses("sender.__main__", f"{line} {seconds}", "--seconds", "frame pair")
    refuses(
        "sender.__main__",
        f"{inputs / 'picture.png'} --message Hi --out x.mkv --seconds 1",
        "folder",
    )


@cases((32, 63), (70, 126))
def test_states_played_over_and_over_go_on_with_the_code(frames: int, pairs: int) -> None:
    layout = make_layout(4, 4, 64, 48, modulation="antipodal", pilots=4, code=PilotCode())
    bits = np.random.default_rng(0).integers(0, 2, (frames, layout.n_bits), np.uint8)
    gray = np.full((48, 64, 3), 128, np.uint8)
    states = list(Loop(layout, 4, bits, lambda: iter([gray])).states())
    assert len(states) == 2 * pairs
    played = 3 * states
    for pair, (one, other) in enumerate(pairs_of(played)):
        original, embedded = (one, other)[:: layout.code.sign(pair)]
        assert read_bits((original, embedded), layout) == bits[pair % pairs % frames].tolist()


@pytest.mark.slow
def test_both_states_of_a_pair_show_a_film_at_their_times(tmp_path: Path, send: Send) -> None:
    said = send(tmp_path / "sent.mkv", *FLAGS, "--kappa", 1, over="clip.avi")  # 15 states a second
    states = list(read_video(tmp_path / "sent.mkv"))
    assert len(states) == 2 * said["pairs"] and said["pairs"] % len(SENT) == 0
    mask = np.kron(LAYOUT.message_mask, np.ones((16, 20), bool))
    levels = with_head_room(np.arange(60, dtype=np.uint8), 1)
    for number, state in enumerate(states):
        added = state[mask][:, 0].astype(int) - levels[2 * (number % 30)]
        assert set(np.unique(added)) == ({0, 1} if number % 2 else {0})


@pytest.mark.slow
def test_a_films_sound_goes_beside_its_states(
    inputs: Path, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = write_film_with_sound(tmp_path / "film.mp4")
    line = ("--message", "Hi", *FLAGS, "--out")
    command(send_cli.main, film, *line, tmp_path / "sent.mkv")
    with av.open(tmp_path / "sent.mkv") as sent:
        packets = [p for p in sent.demux() if p.pts is not None]
        ends = [
            max(float((p.pts + p.duration) * p.time_base) for p in packets if p.stream.type == kind)
            for kind in ("video", "audio")
        ]
    assert ends[0] == pytest.approx(ends[1], abs=0.2)
    assert len(list(read_video(tmp_path / "sent.mkv"))) / 15 == pytest.approx(ends[0], abs=0.1)
    assert "without its sound" in command(send_cli.main, film, *line, tmp_path / "a.avi").stderr
    monkeypatch.setattr("sender.sound.av", None)
    assert "pip install" in command(send_cli.main, film, *line, tmp_path / "b.mkv").stderr


def write_film_with_sound(file: Path) -> Path:
    """Write a second of gray at 25 frames a second, with a tone."""
    with av.open(file, "w") as out:
        seen, heard = out.add_stream("libx264", 25), out.add_stream("aac", 48000)
        seen.width, seen.height, seen.pix_fmt, heard.layout = 128, 96, "yuv420p", "mono"
        for number in range(25):
            image = np.full((96, 128, 3), 40 + 5 * number, np.uint8)
            out.mux(seen.encode(av.VideoFrame.from_ndarray(image, "rgb24")))
        tone = np.sin(np.arange(48000, dtype=np.float32) / 20)[None]
        sound = av.AudioFrame.from_ndarray(tone, "fltp", "mono")
        sound.sample_rate, sound.pts = 48000, 0
        out.mux(heard.encode(sound))
        for stream in (seen, heard):
            out.mux(stream.encode())
    return file


def test_a_player_holds_each_picture_once(tmp_path: Path, send: Send) -> None:
    out = tmp_path / "sent.html"
    send(out, *FLAGS, "--hold", 6)
    loop = read_player(out)
    assert [loop[key] for key in ("width", "height", "state_hz")] == [120, 80, 10]
    assert len(loop["pictures"]) == 1
    assert loop["shown"] == [0] * len(SENT)
    assert loop["bits"] == ["".join(map(str, bits)) for bits in SENT.tolist()]
    assert (loop["rows"], loop["cols"], loop["kappa"]) == (5, 6, 3)
    text = out.read_text()
    policy = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    policy += "media-src blob:"
    assert f'content="{policy}"' in text
    assert "http" not in re.sub(r"http-equiv", "", text)
    assert not re.search(r"(?:src|href)=|@import|url\(|innerHTML", text)


# Presets


@pytest.mark.slow
@cases(None, "robust")
def test_a_preset_says_all_and_no_flag_is_needed(
    name: str | None, tmp_path: Path, send: Send
) -> None:
    said = send(tmp_path / "sent.html", *(("--preset", name) if name else ()))
    preset = PRESETS[name or DEFAULT_PRESET]
    assert said["preset"] == (name or DEFAULT_PRESET)
    assert said["layout"] == preset.layout.to_dict()
    assert (said["kappa"], said["state_hz"]) == (preset.kappa, preset.state_hz)
    assert read_player(tmp_path / "sent.html")["state_hz"] == preset.state_hz
    assert said["needs_camera_fps"] == preset.needs_camera_fps == 30
    assert (said["visibility_block"] <= 1) == (preset is PRESETS["hidden"])
    assert 0 < said["message_bit_per_s"] < said["bound_bit_per_s"]


@pytest.mark.slow
def test_flags_change_a_preset(inputs: Path, tmp_path: Path, send: Send) -> None:
    words = ("--preset", "hidden", "--width", 256, "--height", 192)
    words += ("--size", "256x192", "--fit", "stretch")
    more = ("--rows", 24, "--cols", 32, "--kappa", 2, "--hold", 2, "--distance", 0.6)
    said = send(tmp_path / "a", *words, *more)
    code = PRESETS["hidden"].layout.code
    layout = make_layout(24, 32, 256, 192, modulation="antipodal", pilots="auto", code=code)
    assert said["layout"] == layout.to_dict()
    assert (said["kappa"], said["state_hz"]) == (2, 30)
    seen = Hiding(layout, 30, Onlooker(distance=0.6), even=True).seen(2)
    assert said["visibility_block"] == round(seen, 3)
    patches = ("--ratex", 2, "--modulation", "on_off", "--refresh", 50)
    said = send(tmp_path / "b.html", *words, *patches)
    assert said["layout"] == make_layout(48, 64, 256, 192, ratex=2).to_dict()
    assert said["state_hz"] == 50  # one refresh a state comes closest to 60
    layout_of = ("--preset", "hidden", "--layout", inputs / "layout.json")
    said = send(tmp_path / "c.mkv", *layout_of)
    assert (said["layout"], said["kappa"]) == (LAYOUT.to_dict(), 1)


@cases(
    ((), (120, 80, "cover", False)),
    (("--fit", "stretch"), (120, 80, "stretch", False)),
    (("--size", "160x300", "--fit", "cover"), (160, 300, "cover", True)),
    ids=["usual", "fit", "upright"],
)
def test_a_display_has_its_own_size(
    words: tuple[str, ...], display: tuple[int, int, str, bool], tmp_path: Path, send: Send
) -> None:
    said = send(tmp_path / "sent", *FLAGS, *words)
    assert tuple(said["display"].values()) == display
    assert said["layout"] == LAYOUT.to_dict()
    states = folder_states(tmp_path / "sent")
    assert {state.shape for state in states} == {(display[1], display[0], 3)}
    height, width = sorted(display[:2])
    turned = replace(LAYOUT, width=width, height=height)
    if display[2] != "contain":  # black lies beside no picture
        lying = [np.rot90(state, -1) if display[3] else state for state in states]
        assert [read_bits(pair, turned) for pair in pairs_of(lying)] == SENT.tolist()


@pytest.mark.parametrize("size", ["1920", "0x5", "8000x8000"])
def test_a_size_that_no_display_has_is_refused(size: str, inputs: Path, refuses: Refuses) -> None:
    words = (inputs / "picture.png", "--message", MESSAGE, "--out", "sent", "--size", size)
    refuses("sender.__main__", words, "--size: need WIDTHxHEIGHT in pixels")


@pytest.mark.slow
def test_what_the_picture_changes_by_is_reported(tmp_path: Path, send: Send) -> None:
    """Patches replace the picture and lift blacks; a change of one level leaves it as it is."""
    patched = send(tmp_path / "a", *FLAGS)
    pilots = ("--ratex", 0, "--pilots", "0.2", "--modulation", "antipodal", "--kappa", 1)
    kept = send(tmp_path / "b", *FLAGS[:-2], *pilots)
    assert kept["delta_e_mean"] <= kept["delta_e_95"] < 0.3
    assert 1 < patched["delta_e_mean"] < patched["delta_e_95"]


def animate(file: Path, levels: tuple[int, ...]) -> Path:
    """Write plain pictures of these levels that follow one another."""
    first, *rest = (Image.fromarray(np.full((96, 128, 3), level, np.uint8)) for level in levels)
    first.save(file, save_all=True, append_images=rest, duration=100)
    return file


@cases((".png", np.uint16), (".webp", np.uint8))
def test_what_is_transparent_is_white_and_told_once(
    suffix: str, kind: type, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    most = np.iinfo(kind).max
    image = np.zeros((96, 128, 4), kind)  # black beneath
    image[:, :64, 3] = most
    image[:48, :, 3] = most // 2
    name = tmp_path / f"a{suffix}"
    assert cv2.imwrite(str(name), image, [cv2.IMWRITE_WEBP_QUALITY, 101])
    pictures = open_pictures(name, 10)
    picture = next(pictures())
    assert abs(int(picture[0, 0, 0]) - 128) <= 1
    assert picture[90, 10].tolist() == [0, 0, 0]
    assert picture[90, 120].tolist() == [255, 255, 255]
    shutil.copy(name, tmp_path / f"b{suffix}")
    assert len(list(open_pictures(tmp_path, 10)())) == 2
    said = capsys.readouterr().err.splitlines()
    assert said == 2 * [f"note: {name}: what is transparent is shown as white"]
    image[..., 3] = most
    assert cv2.imwrite(str(name), image)
    assert not next(open_pictures(name, 10)()).any()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "picture", [*turned_pictures(), *profiled_pictures()], ids=lambda picture: picture.name
)
def test_pictures_are_shown_as_a_viewer_shows_them(picture: Picture, tmp_path: Path) -> None:
    for name in ("without an ending", picture.name):
        (tmp_path / name).write_bytes(picture.data)
        shown = next(open_pictures(tmp_path / name, 10)())
        assert shown.shape == picture.shown.shape
        assert abs(shown.astype(int) - picture.shown).max() <= picture.tolerance


JPEG = saved(Image.new("RGB", (128, 96)), "JPEG")
NO_KIND = "is not read; save it as JPEG or PNG"
NO_WHITE = "its white is not known.* 8 or 16 bits"


@cases(
    ("a.heic", bytes(4) + b"ftypheic" + bytes(500), f"HEIC {NO_KIND}"),
    ("a.jpg", bytes(4) + b"ftypmif1" + bytes(500), f"HEIC {NO_KIND}"),
    (
        "a.svg",
        b'<?xml version="1.0"?>\n<svg xmlns="http://www.w3.org/2000/svg"/>',
        f"SVG {NO_KIND}",
    ),
    ("pages.pdf", b"%PDF-1.4\n" + bytes(99) + 3 * JPEG, "not a readable video"),
    ("a.tif", saved(Image.fromarray(np.ones((96, 128), np.float32)), "TIFF"), NO_WHITE),
    ("b.tif", saved(Image.fromarray(np.ones((96, 128), np.int32)), "TIFF"), NO_WHITE),
)
def test_kinds_that_are_not_read_are_named(
    name: str, data: bytes, says: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=f"{name}: {says}"):
        open_pictures(tmp_path / name, 10)


def test_a_picture_that_is_much_enlarged_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    note_coarse((300, 300), (512, 512))
    assert capsys.readouterr().err == ""
    note_coarse((50, 40), (512, 410))
    said = capsys.readouterr().err
    assert "a picture of 50x40 is shown as 512x410 pixels, and looks coarse" in said


@pytest.mark.parametrize("suffix", [".webp", ".png"])
def test_an_animation_that_would_lose_its_pictures_is_refused(suffix: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="an animation; save one picture of it, or all as GIF"):
        open_pictures(animate(tmp_path / f"moves{suffix}", (30, 90)), 15)
    assert len(list(open_pictures(animate(tmp_path / f"still{suffix}", (30,)), 15)())) == 1


shapes = st.tuples(st.integers(4, 9), st.integers(5, 9))
known = st.one_of(
    st.builds(lambda count: {"ratex": count}, st.sampled_from([0, 1, 2, 3, 5])),
    st.builds(lambda count: {"pilots": count}, st.integers(2, 8)),
)
"""Patches or pilots of a layout."""


@settings(max_examples=20)
@given(
    shapes,
    known,
    st.sampled_from(list(MODULATIONS)),
    st.tuples(st.integers(0, 40), st.integers(0, 40)),
    st.binary(min_size=1, max_size=12),
    st.integers(1, 64),
    st.booleans(),
)
def test_any_layout_survives_folder_and_player(
    shape: tuple[int, int],
    known: dict[str, int],
    modulation: str,
    more: tuple[int, int],
    message: bytes,
    kappa: int,
    even: bool,
) -> None:
    rows, cols = shape
    size = 8 * cols + more[0], 8 * rows + more[1]
    layout = make_layout(rows, cols, *size, modulation=modulation, **known)
    if layout.n_bits < framing.MIN_BITS:
        return
    picture = noise(layout.height, layout.width, len(message))

    def pictures() -> Iterator[NDArray[np.uint8]]:
        yield picture

    bits = framing.encode(message, layout.n_bits)
    even = even and modulation == "antipodal"
    loop = Loop(layout, kappa, bits, pictures, size, even=even)
    with TemporaryDirectory() as folder:
        out = Path(folder) / "page.html"
        write_player(out, loop, 15, {})
        write_states(Path(folder), loop.states())
        states = folder_states(Path(folder))
        np.testing.assert_array_equal(player_states(out), states)
    assert [read_bits(pair, layout) for pair in pairs_of(states)] == bits.tolist()


def test_fit_cuts_evenly_and_does_not_stretch() -> None:
    wide = np.zeros((60, 200, 3), np.uint8)
    wide[:, 60:140] = 255
    assert fit_picture(wide, 80, 60).min() == 255
    tall = np.zeros((200, 60), np.uint8)
    tall[80:120] = 255
    assert fit_picture(tall, 30, 20).min() == 255
    same = noise(40, 50)
    np.testing.assert_array_equal(fit_picture(same, 50, 40), same)
    checks = (np.indices((64, 64)).sum(axis=0) % 2 * 254).astype(np.uint8)
    assert np.unique(fit_picture(checks, 32, 32)).tolist() == [127]  # averaged, not aliased


# Visibility

SHOWN = ("--preset", "paper", "--rows", 12, "--cols", 16, "--width", 256, "--height", 192,
         "--modulation", "antipodal", "--pilots", "auto", "--hold", 1,
         "--size", "256x192", "--fit", "cover")  # fmt: skip


@pytest.mark.slow
def test_the_sender_says_how_visible_the_message_is(tmp_path: Path, send: Send) -> None:
    said = send(tmp_path / "a", *SHOWN, "--kappa", 2)
    assert json.loads((tmp_path / "a" / "sent.json").read_text()) | {"out": said["out"]} == said
    seen = []
    for level in PICTURE_LEVELS:
        viewing = Viewing(12, 16, 2, aspect=256 / 192, picture_level=level)
        shown = random_message(viewing, "antipodal", np.random.default_rng(MESSAGE_SEED), SECONDS)
        seen.append(
            [
                high_end(contrast_over_threshold(shown, viewing, where))
                for where in ("block", "screen")
            ]
        )
    block, screen = np.max(seen, axis=0).round(3)
    assert (said["visibility_block"], said["visibility_screen"]) == (block, screen)
    assert 0 < said["visibility_moving"] < 1
    keys = ("visibility_block", "visibility_screen")
    other = {}
    for number, flags in enumerate(
        [
            ("--kappa", 2),
            ("--kappa", 2, "--refresh", 120, "--hold", 2),  # light is held: no change
            ("--kappa", 1),
            ("--kappa", 2, "--distance", 6),
            ("--kappa", 2, "--luminance", 20),
            ("--kappa", 2, "--diagonal", 6),
            ("--kappa", 2, "--hold", 4),
        ]
    ):
        said = send(tmp_path / f"{number}.html", *SHOWN, *flags)
        other[number] = [said[key] for key in keys]
    assert other[0] == other[1] == [block, screen]
    for number in (2, 3, 4, 5):
        assert other[number][0] < block
    assert other[6][0] > block


def test_the_largest_kappa_below_a_visibility_is_taken(tmp_path: Path, send: Send) -> None:
    limit = 10
    said = send(tmp_path / "a", *SHOWN, "--visibility", limit)
    kappa = said["kappa"]
    assert 1 < kappa < 64
    layout = Layout.from_dict(said["layout"])
    hiding = Hiding(layout, 60, Onlooker())
    assert said["visibility_block"] == round(hiding.seen(kappa), 3) <= limit
    assert hiding.seen(kappa + 1) > limit
    same = send(tmp_path / "b", *SHOWN, "--kappa", kappa)
    assert {**same, "out": said["out"]} == said


@cases(("hidden", 16, 0.63, True), slow("hidden", 90, 0.97, False), slow("robust", 20, 0.97, False))
def test_what_a_picture_carries_is_said(
    preset: str, level: int, share: float, dark: bool, tmp_path: Path, command: Command
) -> None:
    write_image(tmp_path / "a.png", np.full((96, 128, 3), level, np.uint8))
    words = (tmp_path / "a.png", "--message", "hi", "--preset", preset, "--out")
    done = command(send_cli.main, *words, tmp_path / "a.html")
    said = report(done)
    assert said["carried_share"] == pytest.approx(share, abs=0.03)
    assert said["expected_bit_per_s"] == pytest.approx(share * said["bound_bit_per_s"], rel=0.06)
    assert ("the picture is dark" in done.stderr) == dark
    done = command(send_cli.main, *words, tmp_path / "b.html", "--kappa", 5)
    assert "carried_share" not in report(done)  # which is known of the preset's change alone


@cases(("hidden", 1, ""), ("robust", 3, "seen"), ("paper", 3, "seen"), ("paper", 40, "flashes"))
def test_flicker_is_warned_of(name: str, kappa: int, found: str) -> None:
    preset = PRESETS[name]
    onlooker = Onlooker(distance=preset.distance_m)
    assert Hiding(preset.layout, preset.state_hz, onlooker, preset.even).flicker(kappa) == found
    if found == "flashes":  # six states are three flashes a second, which is safe
        assert Hiding(preset.layout, 6, onlooker).flicker(kappa) == "seen"


def test_every_kappa_is_taken_where_nothing_is_seen() -> None:
    far = Onlooker(diagonal=1, luminance=1, distance=10_000)
    layout = make_layout(modulation="antipodal", ratex=0)
    assert Hiding(layout, 1000, far).largest_kappa(1.0) == 64


@pytest.mark.parametrize("state_hz", [slow(1e-9), 1000])
@pytest.mark.parametrize("modulation", MODULATIONS)
def test_any_rate_and_any_onlooker_has_a_visibility(state_hz: float, modulation: str) -> None:
    layout = make_layout(modulation=modulation)
    for onlooker in (Onlooker(0.1, 1, 10_000), Onlooker(10_000, 100_000, 0.01)):
        hiding = Hiding(layout, state_hz, onlooker)
        assert 0 < hiding.seen(3) < hiding.seen(3, "screen") < np.inf


@pytest.mark.slow
def test_opencv_adds_no_lines_of_its_own(inputs: Path, tmp_path: Path) -> None:
    """In a process of its own."""
    film = tmp_path / "text.mp4"
    film.write_bytes(b"\0\0\0\x18ftypmp42" + bytes(400))
    line = [sys.executable, "-m", "sender", film, "--message", "hi", "--out", tmp_path / "x"]
    done = run_process(*line, status=2)
    assert len(done.stderr.splitlines()) == 1
    assert str(film) in done.stderr


def test_a_video_that_does_not_read_back_bit_for_bit_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("link.images.video.LOSSLESS", "MJPG")
    with pytest.raises(InputError, match="bit for bit"):
        write_video(tmp_path / "x.avi", iter([noise(80, 120)]), 15)
    monkeypatch.setattr("link.images.video.LOSSLESS", "none")
    with pytest.raises(InputError, match="cannot write none video"):
        write_video(tmp_path / "y.avi", iter([noise(80, 120)]), 15)


DISPLAYS_HZ = (48, 50, 59.94, 60, 72, 75, 85, 90, 100, 120, 144, 165, 170, 200, 240, 280, 360)
"""Refresh rates of displays that are sold."""


def test_receivers_know_the_rate_at_which_a_display_shows_a_code() -> None:
    hidden = PRESETS["hidden"]
    for refresh in DISPLAYS_HZ:
        rate = send_cli.states_per_second(hidden.state_hz, None, refresh, ".html")
        hidden.layout.code.check_rate(rate)
