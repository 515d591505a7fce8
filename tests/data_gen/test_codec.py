"""Films through video codecs: in memory and in files, with the times of their frames."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from conftest import Command, Refuses, cases, slow

from data_gen.film import codec
from data_gen.film.codec import CodecSettings, through_codec, write_film
from data_gen.film.frame import VideoFrame
from data_gen.video import main
from link.errors import InputError
from link.images.files import read_image
from link.images.video import read_video
from link.types import Image

FPS = 30.0
SIZE = (160, 96)
FINE = CodecSettings("h264", kbits=5000)
"""Far more than this small film needs."""


def drifting(count: int = 12, noise: float = 0.0, lost: tuple[int, ...] = ()) -> list[VideoFrame]:
    """A smooth picture that drifts by a pixel a frame; some numbers may be lost."""
    rng = np.random.default_rng(0)
    coarse = rng.uniform(20, 235, (6, 12, 3)).astype(np.float32)
    picture = cv2.resize(coarse, (SIZE[0] + count, SIZE[1]), interpolation=cv2.INTER_CUBIC)
    frames = []
    for number in range(count):
        view = picture[:, number : number + SIZE[0]]
        view = view + noise * rng.standard_normal(view.shape, np.float32)
        rgb = np.clip(view + 0.5, 0, 255).astype(np.uint8)
        truth = (number, number / FPS, 0.1 * number, np.eye(3), {number: 1.0}, True, False)
        frames.append(VideoFrame(rgb, *truth))
    return [frame for frame in frames if frame.number not in lost]


def psnr(frames: list[VideoFrame], seen: list[VideoFrame]) -> float:
    """Of luma, in dB; colours lose more, to 4:2:0."""
    errors = [
        cv2.cvtColor(a.rgb, cv2.COLOR_RGB2GRAY).astype(float)
        - cv2.cvtColor(b.rgb, cv2.COLOR_RGB2GRAY)
        for a, b in zip(frames, seen, strict=True)
    ]
    return float(10 * np.log10(255**2 / np.mean(np.square(errors))))


def decoded(path: Path) -> list[av.VideoFrame]:
    with av.open(str(path)) as container:
        return list(container.decode(video=0))


@pytest.mark.parametrize("name", ["h264", "hevc"])
def test_frames_come_back_with_their_truth(name: str) -> None:
    frames = drifting(lost=(3, 4, 8))
    seen = list(through_codec(frames, replace(FINE, name=name), FPS))
    assert psnr(frames, seen) > 38
    for one, other in zip(frames, seen, strict=True):
        assert other.rgb.shape == one.rgb.shape and other.rgb.dtype == np.uint8
        assert other.truth("x") == one.truth("x")


def test_no_codec_passes_frames_on_as_they_are() -> None:
    frames = drifting()
    assert list(through_codec(frames, CodecSettings(), FPS)) == frames


def test_a_film_is_taken_frame_by_frame() -> None:
    """A study may break off, and an endless film does not fill the memory."""
    taken = []

    def frames() -> Iterator[VideoFrame]:
        for frame in drifting(120):
            taken.append(frame.number)
            yield frame

    first = next(through_codec(frames(), FINE, FPS))
    assert first.number == 0
    assert len(taken) < 60


def test_black_and_white_stay_and_the_range_is_tagged(tmp_path: Path) -> None:
    rgb = np.zeros((96, 160, 3), np.uint8)
    rgb[:, 80:] = 255
    frames = [replace(frame, rgb=rgb) for frame in drifting(4)]
    (*_, last) = through_codec(frames, FINE, FPS)
    assert np.abs(last.rgb[:, :72].astype(int)).max() <= 3
    assert np.abs(last.rgb[:, 88:].astype(int) - 255).max() <= 3
    write_film(tmp_path / "film.mp4", frames, FINE, FPS)
    first = decoded(tmp_path / "film.mp4")[0]
    luma = np.frombuffer(first.planes[0], np.uint8)
    assert (first.color_range, first.colorspace) == (1, 1)
    assert abs(int(luma.max()) - 235) <= 3
    assert abs(int(luma[: SIZE[0] // 2].min()) - 16) <= 3


def test_colours_keep_their_hue() -> None:
    """A matrix that is not the one in the tags would turn saturated colours by many levels."""
    rgb = np.zeros((96, 160, 3), np.uint8)
    for number, colour in enumerate([(200, 40, 40), (40, 200, 40), (40, 40, 200), (200, 200, 40)]):
        rgb[:, 40 * number : 40 * number + 40] = colour
    (*_, last) = through_codec([replace(f, rgb=rgb) for f in drifting(4)], FINE, FPS)
    for number in range(4):
        middle = np.s_[20:76, 40 * number + 12 : 40 * number + 28]
        assert np.abs(last.rgb[middle].astype(int) - rgb[middle]).max() <= 5


@cases((".mp4", "h264"), (".mov", "h264"), (".mkv", "hevc"))
def test_a_file_holds_what_memory_gives_and_the_times(
    suffix: str, name: str, tmp_path: Path
) -> None:
    frames = drifting(lost=(0, 3, 7))
    late = np.random.default_rng(1).uniform(-0.01, 0.01, len(frames))
    frames = [replace(f, time_s=f.time_s + s) for f, s in zip(frames, late, strict=True)]
    settings = replace(FINE, kbits=500, name=name)
    file = tmp_path / f"film{suffix}"
    write_film(file, frames, settings, FPS)
    assert [path.name for path in tmp_path.iterdir()] == [file.name]
    seen = list(through_codec(frames, settings, FPS))
    for image, frame in zip(read_video(file), seen, strict=True):
        assert np.array_equal(image, frame.rgb)
    times = [float(one.time) for one in decoded(file)]
    expected = [frame.time_s - frames[0].time_s for frame in frames]
    ticks = 1e-3 if suffix == ".mkv" else 1 / codec.TICKS_HZ
    np.testing.assert_allclose(np.array(times) - times[0], expected, rtol=0, atol=1.1 * ticks)


def test_key_frames_come_each_second(tmp_path: Path) -> None:
    write_film(tmp_path / "film.mp4", drifting(70), FINE, FPS)
    keys = [number for number, one in enumerate(decoded(tmp_path / "film.mp4")) if one.key_frame]
    assert keys == [0, 30, 60]


@pytest.mark.slow
def test_the_rate_is_kept_and_costs_quality(tmp_path: Path) -> None:
    frames = drifting(60, noise=6.0)
    found = []
    for kbits in (400, 1600):
        settings, file = replace(FINE, kbits=kbits), tmp_path / f"{kbits}.mp4"
        write_film(file, frames, settings, FPS)
        written = file.stat().st_size * 8 / 1000 * FPS / len(frames)
        assert written == pytest.approx(kbits, rel=0.25)
        found.append(psnr(frames, list(through_codec(frames, settings, FPS))))
    assert found[0] < found[1] - 1


def test_what_a_codec_cannot_hold_is_refused(tmp_path: Path) -> None:
    odd = [replace(frame, rgb=frame.rgb[:95]) for frame in drifting()]
    with pytest.raises(InputError, match="need an even width and height, got 160x95"):
        list(through_codec(odd, FINE, FPS))
    with pytest.raises(InputError, match="need an even width and height"):
        write_film(tmp_path / "film.mp4", odd, FINE, FPS)
    with pytest.raises(InputError, match="unknown codec 'none'"):
        write_film(tmp_path / "film.mp4", drifting(), CodecSettings(), FPS)
    with pytest.raises(InputError, match="no frame was filmed"):
        write_film(tmp_path / "film.mp4", [], FINE, FPS)
    (tmp_path / "film.mp4").mkdir()
    with pytest.raises(InputError, match=r"film.mp4: is a folder or a device"):
        write_film(tmp_path / "film.mp4", drifting(), FINE, FPS)
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]


def test_a_film_that_breaks_off_leaves_nothing(tmp_path: Path) -> None:
    def frames() -> Iterator[VideoFrame]:
        yield from drifting()
        raise InputError("the camera is unplugged")

    with pytest.raises(InputError, match="unplugged"):
        write_film(tmp_path / "film.mp4", frames(), FINE, FPS)
    assert not list(tmp_path.iterdir())


def test_without_pyav_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, refuses: Refuses
) -> None:
    monkeypatch.setattr(codec, "av", None)
    CodecSettings().check()
    with pytest.raises(InputError, match=r"pip install -e '\.\[codec\]'"):
        next(through_codec(drifting(), FINE, FPS))
    said = refuses("data_gen.video", "--message hi --out x.mp4")
    assert said == "error: codec h264: PyAV is missing; pip install -e '.[codec]'"


def test_an_encoder_that_refuses_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(codec, "EFFORT", "hasty")
    with pytest.raises(InputError, match=r"^codec h264: the encoder takes no such settings"):
        list(through_codec(drifting(), FINE, FPS))


@cases("h264", slow("hevc"))
def test_the_same_film_comes_back_whatever_the_memory_holds(name: str) -> None:
    rng, held, seen = np.random.default_rng(5), [], set()
    for _ in range(12):  # with the macroblock tree of x264, one film in five differed
        held = [*held[-60:], *(np.empty(n, np.uint8) for n in rng.integers(16, 3_000_000, 20))]
        film = through_codec(drifting(9, noise=4), CodecSettings(name, 900), FPS)
        seen.add(b"".join(frame.rgb.tobytes() for frame in film))
    assert len(seen) == 1


SHORT = ("--message", "hi", "--seconds", "0.3", "--size", "160", "96", "--width", "128")
SHORT += ("--height", "96", "--rows", "4", "--cols", "6", "--ratex", "2", "--drop", "0.3")
SHORT += ("--jitter-s", "0.004", "--codec.kbits", "900")


def test_the_command_writes_a_film_with_times(tmp_path: Path, command: Command) -> None:
    command(main, *SHORT, "--out", tmp_path / "a.mp4")
    done = command(main, *SHORT, "--codec.name", "h264", "--out", tmp_path / "a")
    lines = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert len(lines) == json.loads(done.stdout)["camera_frames"] < 9
    times = np.array([float(one.time) for one in decoded(tmp_path / "a.mp4")])
    truth = np.array([line["time_s"] for line in lines])
    np.testing.assert_allclose(times - times[0], truth - truth[0], rtol=0, atol=1e-4)
    assert np.ptp(truth * FPS - [line["number"] for line in lines]) > 0.01
    images: list[Image] = [read_image(f) for f in sorted((tmp_path / "a").glob("*.png"))]
    for image, frame in zip(images, read_video(tmp_path / "a.mp4"), strict=True):
        assert np.array_equal(image, frame)
