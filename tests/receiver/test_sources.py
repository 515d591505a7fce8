"""When each camera frame was taken: times of files, numbers of folders, and repeated frames."""

import os
from fractions import Fraction
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import ClassVar

import cv2
import numpy as np
import pytest
from conftest import cases
from streams import states_of, write_film

from export.runtime import Decoder
from link.errors import InputError
from link.images import write_image
from link.images.video import VideoReader, read_video, write_video
from link.layout import make_layout
from link.types import Image
from models import PRETRAINED
from receiver.receiver import Receiver
from receiver.repeats import Repeats
from receiver.sources import open_source

LAYOUT = make_layout()
TEXT = b"hidden"
SEEN = (0, 1, 2, 4, 5, 6, 8, 9, 10, 11, 13, 14, 15, 16, 17, 18)
"""Numbers of the frames that a film with gaps holds."""


def write_timed(
    path: Path, frames: list[Image], times: list[float], codec: str = "libx264", **options: str
) -> Path:
    """A film whose frames have the times given, by PyAV."""
    av = pytest.importorskip("av")
    base = Fraction(1, 90000)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30, options=options)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.time_base = stream.codec_context.time_base = base
        for image, time in zip(frames, times, strict=True):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = round(time / base), base
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def grays(numbers: tuple[int, ...]) -> list[Image]:
    """Even images whose level tells their number."""
    return [np.full((48, 64, 3), 40 + 8 * number, np.uint8) for number in numbers]


@cases(("film.mkv", {}), ("late.mp4", {"bf": "0"}))
def test_a_file_with_missing_frames_keeps_their_times(
    name: str, options: dict[str, str], tmp_path: Path
) -> None:
    start = 2.5 if name == "late.mp4" else 0.0
    times = [start + number / 30 for number in SEEN]
    path = write_timed(tmp_path / name, grays(SEEN), times, **options)
    source = open_source(str(path))
    frames = list(source.frames)
    assert [frame.time for frame in frames] == pytest.approx([n / 30 for n in SEEN], abs=1e-3)
    levels = [int(frame.image[24, 32, 1]) for frame in frames]
    assert levels == pytest.approx([40 + 8 * number for number in SEEN], abs=2)
    assert source.fps == pytest.approx(30, rel=0.02)


def test_fps_overrides_the_times_of_a_file(tmp_path: Path) -> None:
    path = write_timed(tmp_path / "slow.mp4", grays(SEEN), [number / 30 for number in SEEN])
    source = open_source(str(path), fps=240)
    assert [frame.time for frame in source.frames] == [k / 240 for k in range(len(SEEN))]
    assert source.fps == 240


def test_times_of_a_variable_rate_are_those_of_the_file(tmp_path: Path) -> None:
    gaps = np.random.default_rng(0).uniform(0.02, 0.06, len(SEEN) - 1)
    times = [0.0, *np.cumsum(gaps).tolist()]
    path = write_timed(tmp_path / "film.mp4", grays(SEEN), times)
    reader = VideoReader(path)
    assert [time for _, time in reader.timed_frames()] == pytest.approx(times, abs=1e-4)
    assert 15 < reader.rate < 50


class ToldTimes:
    """A video whose frames are black and whose times are what a test says."""

    times: tuple[float, ...] = ()

    def __init__(self, *_: object) -> None:
        self.number = -1

    def isOpened(self) -> bool:  # noqa: N802 (OpenCV's name)
        return True

    def grab(self) -> bool:
        self.number += 1
        return self.number < len(self.times)

    def read(self) -> tuple[bool, Image]:
        return self.grab(), np.zeros((16, 16, 3), np.uint8)

    def get(self, what: int) -> float:
        stated = {cv2.CAP_PROP_FRAME_WIDTH: 16, cv2.CAP_PROP_FRAME_HEIGHT: 16, cv2.CAP_PROP_FPS: 20}
        if what == cv2.CAP_PROP_POS_MSEC:
            return 1000 * self.times[min(max(self.number, 0), len(self.times) - 1)]
        return stated.get(what, 0)

    def release(self) -> None:
        pass


@cases(
    ((0, 0, 0, 0), (0, 0.05, 0.1, 0.15)),
    ((float("nan"),) * 4, (0, 0.05, 0.1, 0.15)),
    ((-1e300, 1e300, float("inf"), 0), (0, 0.05, 0.1, 0.15)),
    ((0, 0.05, 0.02, 0.15), (0, 0.05, 0.1, 0.15)),  # one is wrong, and the next are right
    ((0, 0.05, 0, 0.05), (0, 0.05, 0.1, 0.15)),  # two files joined
    ((0, 0.05, 0.2, 0.25), (0, 0.05, 0.2, 0.25)),
)
def test_times_that_cannot_be_are_replaced(
    told: tuple[float, ...],
    used: tuple[float, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "film.mp4").touch()
    monkeypatch.setattr(ToldTimes, "times", told)
    monkeypatch.setattr(cv2, "VideoCapture", ToldTimes)
    source = open_source(str(tmp_path / "film.mp4"))
    assert [frame.time for frame in source.frames] == pytest.approx(used)
    assert source.fps == pytest.approx(20)


class FakeCamera(ToldTimes):
    """A camera of five old frames, which stamps them, and then gives nothing more."""

    times = (50.0, 50.1, 50.2, 50.3, 50.4)
    asked: ClassVar[list[tuple[int, float]]] = []

    def set(self, what: int, value: float) -> None:
        self.asked.append((what, value))
        raise cv2.error("this camera cannot be asked")


def test_a_camera_is_asked_for_what_reads_well_and_says_what_it_gives(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", FakeCamera)
    source = open_source("/dev/video3", camera_size=(640, 480))
    mjpg = cv2.VideoWriter.fourcc(*"MJPG")
    size = (cv2.CAP_PROP_FRAME_WIDTH, 640), (cv2.CAP_PROP_FRAME_HEIGHT, 480)
    assert FakeCamera.asked == [(cv2.CAP_PROP_FOURCC, mjpg), *size, (cv2.CAP_PROP_FPS, 120)]
    assert "camera 3: 16x16, 20 frames a second" in capsys.readouterr().err
    frames = list(source.frames)
    for frame in frames:  # the newest, at the time of its stamp however late it was read
        assert frame.time == pytest.approx(int(frame.name.removeprefix("frame ")) / 10)
    assert frames[-1].time == pytest.approx(0.4)
    assert "camera 3 returns no more frames; is it unplugged?" in capsys.readouterr().err
    for as_it_is in (np.zeros((16, 16, 2), np.uint8), np.zeros((16, 16, 3), np.float32)):
        monkeypatch.setattr(FakeCamera, "read", lambda _, image=as_it_is: (True, image))
        with pytest.raises(InputError, match="camera 0: returns no frames"):
            list(open_source("0").frames)


def test_a_film_at_an_address_is_read_whole(tmp_path: Path) -> None:
    write_film(tmp_path / "film.mkv", grays((1, 2, 3)), codec="FFV1")
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}"
        times = [frame.time for frame in open_source(f"{address}/film.mkv").frames]
        assert times == pytest.approx([0, 1 / 30, 2 / 30], abs=0.001)
        with pytest.raises(InputError, match=f"{address}/none: cannot be opened; check the addr"):
            open_source(f"{address}/none")
        server.shutdown()


@cases(
    ("-", "pipes and devices are not read"),
    ("/dev/null", "pipes and devices are not read"),
    ("/dev/video9", "camera 9: cannot be opened"),
    ("gopher://host/x", "gopher://host/x: no such .* stream .http"),
    ("none", "none: no such folder, video file, camera number or device"),
)
def test_what_is_no_source_is_refused(name: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        open_source(name)


@cases(
    ("list.avi", "ffconcat version 1.0\nfile secret.avi\n"),
    ("list.m3u8", "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nsecret.avi\n"),
    ("list.sdp", "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nt=0 0\nm=video 5004 RTP/AVP 96\n"),
    ("text.avi", "a screen full of text\n" * 500),
)
def test_a_file_that_leads_to_others_is_no_video(name: str, content: str, tmp_path: Path) -> None:
    write_video(tmp_path / "secret.avi", grays((0, 1)), 30)
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=f"{name}: not a readable video"):
        open_source(str(tmp_path / name))


def test_a_name_of_images_in_order_is_the_name_of_one_file(tmp_path: Path) -> None:
    for name in ("%03d.png", "000.png", "001.png"):
        write_image(tmp_path / name, np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(InputError, match="one image is no film"):
        open_source(str(tmp_path / "%03d.png"))


@pytest.mark.parametrize("name", ["12:30.avi", "crypto:x.mkv", os.fsdecode(b"\xff.avi")])
def test_a_video_may_have_any_name(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_video(Path(name), grays((0, 1)), 30)
    assert [np.ptp(frame) for frame in read_video(Path(name))] == [0, 0]
    assert os.listdir() == [name]


def test_frames_of_a_few_pixels_are_refused(tmp_path: Path) -> None:
    write_video(tmp_path / "small.avi", [np.zeros((16, 16, 3), np.uint8)], 30)
    open_source(str(tmp_path / "small.avi"))
    pixel = cv2.imencode(".jpg", np.zeros((2, 2, 3), np.uint8))[1].tobytes()
    (tmp_path / "tiny.mjpeg").write_bytes(pixel * 3)
    with pytest.raises(InputError, match=r"tiny\.mjpeg: image is 2x2, need at least 16x16"):
        open_source(str(tmp_path / "tiny.mjpeg"))


@cases(
    (("f_0007", "f_0008", "f_0011"), (0, 1, 4)),
    (("f8", "f9", "f10", "f12"), (0, 1, 2, 4)),
    (("2026 frame 3 ", "2026 frame 5 "), (0, 2)),
    (("a7", "b3", "c9"), (0, 1, 2)),
    (("f1" + "0" * 200, "f2" + "0" * 200), (0, 1)),
)
def test_the_names_of_a_folder_number_its_frames(
    names: tuple[str, ...], numbers: tuple[int, ...], tmp_path: Path
) -> None:
    for level, name in enumerate(names):
        write_image(tmp_path / f"{name}.png", np.full((16, 16, 3), level, np.uint8))
    for fps, rate in ((None, 30), (15.0, 15)):
        frames = list(open_source(str(tmp_path), fps).frames)
        assert [frame.time for frame in frames] == pytest.approx([n / rate for n in numbers])
        assert [int(frame.image[0, 0, 0]) for frame in frames] == list(range(len(names)))


def noisy_film(count: int, noise: float = 1.5) -> list[Image]:
    """A display that stands still before a camera that stands still: only noise differs."""
    rng = np.random.default_rng(1)
    picture = cv2.resize(rng.integers(20, 230, (6, 8, 3)).astype(np.uint8), (320, 240))
    seen = [picture + noise * rng.standard_normal(picture.shape) for _ in range(count)]
    return [np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in seen]


def test_repeated_frames_are_recognised() -> None:
    numbers = [n for n in range(40) for _ in range(2 if n % 7 == 6 else 1)]
    film, repeats = noisy_film(40), Repeats()
    told = [repeats.is_repeat(film[number]) for number in numbers]
    again = [number == before for number, before in zip(numbers, [-1, *numbers], strict=False)]
    assert told[8:] == again[8:]


@pytest.mark.parametrize("modulation", ["on_off", "antipodal"])
def test_a_recording_of_the_screen_has_no_repeats(modulation: str) -> None:
    layout = make_layout(modulation=modulation)
    states, repeats = states_of(TEXT, layout, np.random.default_rng(5)), Repeats()
    for number in range(60):
        assert not repeats.is_repeat(states[number // 4 % len(states)])


@pytest.mark.slow
def test_a_recording_of_the_screen_is_read() -> None:
    states = states_of(TEXT, LAYOUT, np.random.default_rng(5))
    receiver = Receiver(Decoder(PRETRAINED / "decoder.onnx"), 60)
    for number in range(480):
        step = receiver.push(states[number // 4 % len(states)], number / 60)
        if step.message is not None:
            break
    assert step.message.data == TEXT
    assert receiver.timing.count["track"] == receiver.frames  # none was skipped
