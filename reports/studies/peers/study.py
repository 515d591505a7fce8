"""Ours and the others on the same pictures and the same draws of the channel."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.channel.stills import capture
from data_gen.frame_pair import Cell, FramePair, Source, shuffled_pictures
from link.embed import with_head_room
from link.frames import Displayed, Rectified
from link.quality import psnr, ssim
from reports.engine.backends import one_thread
from reports.engine.predict import Method
from reports.studies.peers.adapters import Peer

DRAWS_OF_KAPPA = 5
"""Every system is filmed with the channel draws of the cell with this kappa."""
JPEG_QUALITY = 90
NO_CHANNEL, JPEG = "no channel", f"JPEG {JPEG_QUALITY}"
Scores = NDArray[np.float64]


@dataclass(frozen=True)
class Shown:
    """What is displayed, and what it is compared with."""

    clean: NDArray[np.uint8]
    """(height, width, 3) uint8, encoded: the picture without the message."""
    displayed: Displayed


class System(Protocol):
    """A way to hide bits in what is displayed, and to read them from a rectified capture."""

    @property
    def name(self) -> str:
        """Of the system."""
        ...

    @property
    def strength(self) -> str:
        """How strongly it embeds."""
        ...

    def show(self, source: Source, index: int) -> Shown:
        """Picture and message number ``index``."""
        ...

    def read(self, pair: Rectified, filmed: bool) -> Iterator[tuple[int, Scores, float]]:
        """Each way to read a capture: frames used, scores (positive means 1), processor seconds."""
        ...


@dataclass(frozen=True)
class Still:
    """A peer: one picture is displayed, and filmed twice."""

    peer: Peer

    @property
    def name(self) -> str:
        """The peer's."""
        return self.peer.name

    @property
    def strength(self) -> str:
        """The peer's."""
        return self.peer.strength

    def show(self, source: Source, index: int) -> Shown:
        """The marked picture, with the head room that ours has, as both frames."""
        pictures = shuffled_pictures(source)
        clean = with_head_room(pictures[index % len(pictures)].rgb, DRAWS_OF_KAPPA)
        bits = np.random.default_rng([source.seed, index]).integers(0, 2, self.peer.n_bits)
        marked = self.peer.embed(clean, bits)
        return Shown(clean, Displayed(marked, marked, bits, source.layout, DRAWS_OF_KAPPA))

    def read(self, pair: Rectified, filmed: bool) -> Iterator[tuple[int, Scores, float]]:
        """One frame, and, where it was filmed, the mean of the two."""
        yield 1, *timed(partial(self.peer.extract, pair.original))
        if filmed:
            mean = np.rint((pair.original.astype(np.float64) + pair.embedded) / 2)
            yield 2, *timed(partial(self.peer.extract, mean.astype(np.uint8)))


@dataclass(frozen=True)
class Ours:
    """A decoder of this repository: two frames are displayed in turn, and filmed once each."""

    method: Method
    kappa: int

    @property
    def name(self) -> str:
        """Of the method."""
        return self.method.name

    @property
    def strength(self) -> str:
        """Kappa."""
        return f"κ {self.kappa}"

    def show(self, source: Source, index: int) -> Shown:
        """The original and the embedded frame."""
        hidden = not self.method.build().needs_ratex
        displayed = FramePair(source, Cell("canon-lg", 0.0, self.kappa), index, hidden).displayed
        return Shown(displayed.original, displayed)

    def read(self, pair: Rectified, filmed: bool) -> Iterator[tuple[int, Scores, float]]:
        """Both frames."""
        scores, seconds = timed(lambda: self.method.build().decode(pair).scores)
        yield 2, scores, seconds


def timed(read: Any) -> tuple[Scores, float]:
    """What ``read`` returns, and the processor seconds it took: others may share the machine."""
    started = time.process_time()
    scores = read()
    return scores, time.process_time() - started


def measure(
    source: Source, pairs: Sequence[str], views: Sequence[float], frames: int, system: System
) -> list[dict[str, Any]]:
    """Predictions of one system: without a channel, after JPEG, and filmed.

    Args:
        source: pictures, layout, seed and channel; what is filmed has the draws of the same index
            in the cell of `DRAWS_OF_KAPPA`, whatever the system.
        pairs: by name.
        views: degrees.
        frames: pictures.
        system: what embeds and reads.

    Returns:
        entries as of predictions.jsonl, with strength, condition, frames_used, psnr, ssim and
        decode_s too.
    """
    one_thread()
    lines = []
    for index in range(frames):
        shown = system.show(source, index)
        visible = {
            "psnr": psnr(shown.clean, shown.displayed.embedded),
            "ssim": ssim(shown.clean, shown.displayed.embedded),
        }
        for condition, pair, view, rectified in received(source, shown, pairs, views, index):
            for frames_used, scores, seconds in system.read(rectified, pair is not None):
                lines.append(
                    {
                        "method": system.name,
                        "strength": system.strength,
                        "condition": condition,
                        "frames_used": frames_used,
                        "pair": pair,
                        "view_deg": view,
                        "index": index,
                        **visible,
                        "decode_s": round(seconds, 6),
                        "scores": [float(f"{score:.6g}") for score in scores],
                        "bits": shown.displayed.bits.tolist(),
                    }
                )
    return lines


def received(
    source: Source, shown: Shown, pairs: Sequence[str], views: Sequence[float], index: int
) -> Iterator[tuple[str, str | None, float | None, Rectified]]:
    """(condition, pair, view, rectified frames) of every condition."""
    shot = shown.displayed
    as_shown = Rectified(shot.original, shot.embedded, shot.layout, shot.kappa)
    yield NO_CHANNEL, None, None, as_shown
    original, embedded = compress(shot.original), compress(shot.embedded)
    yield JPEG, None, None, replace(as_shown, original=original, embedded=embedded)
    for name in pairs:
        for view in views:
            rng = FramePair(source, Cell(name, view, DRAWS_OF_KAPPA), index).channel_rng()
            captured = capture(shot, source.pair(name), view, rng)
            yield f"{view:g}°", name, view, captured.rectified()


def compress(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """To JPEG and back."""
    bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    back = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return np.asarray(cv2.cvtColor(back, cv2.COLOR_BGR2RGB), np.uint8)
