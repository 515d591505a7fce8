"""Video codecs of phones: frames are compressed, and come back as a receiver decodes them.

`through_codec` does both in memory, so that one film can be passed through several codecs.
`write_film` writes the same compressed frames to a file with the times at which they were
taken: a lost frame leaves a gap, and a jittering sensor a variable frame rate. Both need PyAV
(``pip install -e '.[codec]'``), which brings FFmpeg with x264 and x265.

Frames are stored as phones store them: 4:2:0 subsampling, the matrix of ITU-R BT.709, levels from
16 to 235, a key frame each second, and no frame that is predicted from later ones. A target rate is
all that steers the encoder; it looks some frames ahead, as x264 and x265 do, and spends more bits
on some frames than on others. One thread encodes and one decodes, so that the same frames always
give the same result.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Literal, cast

import numpy as np

from data_gen.film.frame import VideoFrame
from link.errors import InputError, ParameterError, choose
from link.images import replaced

try:
    import av
except ModuleNotFoundError:
    av = None  # type: ignore[assignment]

ENCODERS = {"h264": "libx264", "hevc": "libx265"}
"""Encoder in FFmpeg by the name of a codec."""
PROFILES = {"h264": "high", "hevc": "main"}
"""Profile, in which phones encode, by the name of a codec."""
EFFORT = "veryfast"
"""Preset of x264 and x265, which says how much the encoder may compute."""
KEY_FRAMES_S = 1.0
"""Time from one key frame to the next, seconds."""
COMPRESSED_SUFFIXES = (".mp4", ".mov", ".mkv")
"""Endings of the files that `write_film` writes."""
TICKS_HZ = 90_000
"""Ticks of presentation times in a second, as usual in MP4; other numbers are rounded to them."""
BT709 = 1
"""Number that ITU-T H.273 gives to the primaries, transfer function and matrix of BT.709."""
LIMITED, FULL = 1, 2
"""Numbers of FFmpeg for levels that run from 16 to 235, and from 0 to 255."""
BICUBIC_ROUNDED = 0x4 | 0x40000
"""Flags of FFmpeg's scaler: bicubic subsampling, with levels that are rounded and not cut off."""
NO_PIXELS = np.empty((0, 0, 3), np.uint8)
"""Pixels of a frame that waits in the codec."""
ODD = "{}: need an even width and height, got {}x{}; change --size"
"""Message for frames that cannot be subsampled by 4:2:0."""


@dataclass(frozen=True)
class CodecSettings:
    """A video codec between the camera and the receiver."""

    name: str = "none"
    """Codec: "h264", "hevc", or "none" to store every level as it is."""
    kbits: float = 8000.0
    """Mean rate that the encoder aims at, in thousands of bits a second."""

    @property
    def on(self) -> bool:
        """Whether frames are compressed at all."""
        return self.name != "none"

    def check(self) -> None:
        """Check the settings, and that their codec can be used here.

        Raises:
            InputError: a setting is out of its range, which the message names, or a codec is on and
                PyAV is not installed.
        """
        known = ("none", *ENCODERS)
        if self.name not in known:
            raise ParameterError("codec.name", f"need {', '.join(known)}, got {self.name!r:.40}")
        if not 50 <= self.kbits <= 500_000:
            raise ParameterError("codec.kbits", f"need 50 to 500000 kbit/s, got {self.kbits:g}")
        if self.on and av is None:
            raise InputError(f"codec {self.name}: PyAV is missing; pip install -e '.[codec]'")


def through_codec(
    frames: Iterable[VideoFrame], settings: CodecSettings, fps: float
) -> Iterator[VideoFrame]:
    """Pass a film through a codec: the same frames and times, with what a receiver sees of them.

    A codec holds frames back, to look ahead.

    >>> rgb = np.full((64, 96, 3), 90, np.uint8)
    >>> film = [VideoFrame(rgb, k, k / 30, 0.0, np.eye(3), {}, True, False) for k in (0, 1, 3)]
    >>> seen = list(through_codec(film, CodecSettings("h264", kbits=1000), 30.0))
    >>> [frame.number for frame in seen], bool(abs(seen[2].rgb.astype(int) - 90).max() <= 2)
    ([0, 1, 3], True)

    Args:
        frames: frames of one film, as `data_gen.film.stream.film` gives them: all of one size, even
            in width and height, with times that rise.
        settings: the codec; "none" passes the frames on as they are.
        fps: nominal number of frames a second.

    Raises:
        InputError: a setting is out of its range, PyAV is not installed, or odd width or height.
    """
    settings.check()
    if not settings.on:
        yield from frames
        return
    encoder, decoder = _context(ENCODERS[settings.name], "w"), _context(settings.name, "r")
    decoder.thread_count = 1
    waiting: dict[int, VideoFrame] = {}
    start_s = 0.0

    def decoded(packets: "Iterable[av.Packet[av.VideoStream] | None]") -> Iterator[VideoFrame]:
        """Give decoded frames the truth of those that went in at the same time."""
        for packet in packets:
            for one in decoder.decode(packet):
                rgb = one.to_ndarray(format="rgb24", dst_color_range=FULL)  # by its tags
                yield replace(waiting.pop(_ticks_of(one)), rgb=np.asarray(rgb, np.uint8))

    for frame in frames:
        if not encoder.width:
            _open(encoder, settings, fps, frame)
            decoder.extradata, start_s = encoder.extradata, frame.time_s
        coded = _coded_frame(frame, start_s)
        waiting[_ticks_of(coded)] = replace(frame, rgb=NO_PIXELS)
        yield from decoded(encoder.encode(coded))
    if encoder.width:
        yield from decoded([*encoder.encode(None), None])


def write_film(
    path: Path, frames: Iterable[VideoFrame], settings: CodecSettings, fps: float
) -> None:
    """Write a film as a compressed video file with the times at which its frames were taken.

    The file's time 0 is that of the first frame, as in the files of phones.
    The file has its name only once it is whole; nothing else is left where that fails.

    Args:
        path: ends in one of `COMPRESSED_SUFFIXES`.
        frames: frames of one film, as `data_gen.film.stream.film` gives them.
        settings: a codec that is on.
        fps: nominal number of frames a second.

    Raises:
        InputError: a setting is out of its range, PyAV is not installed, odd width or height, or a
            full disk.
    """
    settings.check()
    encoder = choose(ENCODERS, settings.name, "codec")
    with (
        replaced(path, path.suffix) as temporary,
        # an absolute name, because FFmpeg takes what stands before a colon for a protocol
        av.open(str(temporary.absolute()), "w") as container,
    ):
        stream, start_s = None, 0.0
        for frame in frames:
            if stream is None:
                start_s = frame.time_s
                added = container.add_stream(encoder, rate=_rate(fps))
                stream = cast("av.VideoStream", added)
                _open(stream.codec_context, settings, fps, frame)
            container.mux(stream.encode(_coded_frame(frame, start_s)))
        if stream is None:
            raise InputError(f"{path}: no frame was filmed; film longer, or lose fewer")
        container.mux(stream.encode(None))


def _rate(fps: float) -> Fraction:
    return Fraction(fps).limit_denominator(1001)


def _context(name: str, mode: Literal["r", "w"]) -> "av.VideoCodecContext":
    """Make an encoder ("w") or a decoder ("r") that works in memory."""
    return cast("av.VideoCodecContext", av.CodecContext.create(name, mode))


def _open(
    context: "av.VideoCodecContext", settings: CodecSettings, fps: float, first: VideoFrame
) -> None:
    """Open an encoder's context, in memory or of a file, for frames like the first one."""
    height, width = first.rgb.shape[:2]
    if width % 2 or height % 2:
        raise InputError(ODD.format(settings.name, width, height))
    context.width, context.height, context.pix_fmt = width, height, "yuv420p"
    context.time_base, context.framerate = Fraction(1, TICKS_HZ), _rate(fps)
    context.bit_rate = round(1000 * settings.kbits)
    context.gop_size = max(1, round(KEY_FRAMES_S * fps))
    context.max_b_frames = 0
    context.color_range = LIMITED
    context.colorspace = context.color_primaries = context.color_trc = BT709
    context.thread_count = 1
    # as in files: headers stand apart, and do not count towards the rate
    context.flags |= av.codec.context.Flags.global_header
    options = {"preset": EFFORT, "profile": PROFILES[settings.name]}
    if settings.name == "hevc":
        options["x265-params"] = "log-level=none:pools=none:frame-threads=1:scenecut=0"
    else:
        options["sc_threshold"] = "0"
        if width % 256:
            # x264's macroblock tree reads 16 blocks of 16 pixels at a time; beyond the end of such
            # rows that is whatever memory holds, which differs from run to run
            options["mbtree"] = "0"
    context.options = options
    try:
        context.open()
    except av.error.FFmpegError as error:
        problem = f"the encoder takes no such settings ({error.strerror}); change them"
        raise InputError(f"codec {settings.name}: {problem}") from None


def _coded_frame(frame: VideoFrame, start_s: float) -> "av.VideoFrame":
    """Convert a frame's pixels to 4:2:0, and give them the time since ``start_s``, in seconds."""
    coded = av.VideoFrame.from_ndarray(frame.rgb, format="rgb24")
    coded = coded.reformat(
        format="yuv420p",
        dst_colorspace="ITU709",
        interpolation=BICUBIC_ROUNDED,
        src_color_range=FULL,
        dst_color_range=LIMITED,
    )
    coded.pts, coded.time_base = round((frame.time_s - start_s) * TICKS_HZ), Fraction(1, TICKS_HZ)
    return coded


def _ticks_of(coded: "av.VideoFrame") -> int:
    """Presentation time of a decoded frame, which the codec passes on as it was given."""
    if coded.pts is None:
        raise RuntimeError("the decoder lost a frame's time")
    return coded.pts
