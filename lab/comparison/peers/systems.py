"""Our decoders and other systems on the same pictures and through the same draws of the channel."""

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from data_gen.channel.camera import jpeg
from data_gen.channel.stills import capture
from data_gen.frame_pair import Cell, FramePair, Source, shuffled_pictures
from lab.comparison.peers.adapters import Peer
from link.embed import with_head_room
from link.frames import Displayed, Rectified
from link.images.quality import psnr, ssim
from reports.engine.backends import one_thread
from reports.engine.methods import Method

DRAWS_OF_KAPPA = 5
"""Kappa of the cells whose draws of the channel are used for every system."""
JPEG_QUALITY = 90
"""Quality of the JPEG compression that stands for a channel, in OpenCV's scale up to 100."""
NO_CHANNEL, JPEG = "no channel", f"JPEG {JPEG_QUALITY}"
"""Names of the conditions in which nothing is filmed."""
Scores = NDArray[np.float64]
"""(n_bits,) scores of message bits; a positive score means 1."""


@dataclass(frozen=True)
class MarkedPicture:
    """What a system displays, and the picture without the message."""

    clean: NDArray[np.uint8]
    """(height, width, 3) uint8, encoded RGB: the picture without the message."""
    displayed: Displayed
    """Both frames that are displayed, and the message."""


@dataclass(frozen=True)
class Reception:
    """What reaches a system in one condition."""

    condition: str
    """Name of the condition: no channel, JPEG, or the view in degrees."""
    pair: str | None
    """Camera-display pair; None where nothing was filmed."""
    view_deg: float | None
    """Angle between the camera and the normal of the display, degrees; None likewise."""
    frames: Rectified
    """Both captured frames, rectified."""


@dataclass(frozen=True)
class Reading:
    """One message as a system read it."""

    method: str
    """Name of the system."""
    strength: str
    """How strongly it embeds."""
    condition: str
    """Name of the condition, as in `Reception`."""
    frames_used: int
    """Number of captured frames from which the message was read."""
    pair: str | None
    """Camera-display pair; None where nothing was filmed."""
    view_deg: float | None
    """Angle between the camera and the normal of the display, degrees; None likewise."""
    index: int
    """Number of the picture."""
    psnr: float
    """Peak signal-to-noise ratio of the displayed message, dB."""
    ssim: float
    """Structural similarity of the pictures with and without the message, at most 1."""
    decode_s: float
    """Processor time of the reading, seconds."""
    scores: list[float]
    """Scores of the message bits to six digits; positive means 1."""
    bits: list[int]
    """Message bits, 0 or 1."""


class System(Protocol):
    """A way to hide bits in what is displayed, and to read them from a rectified capture."""

    @property
    def name(self) -> str:
        """What tables call the system."""
        ...

    @property
    def strength(self) -> str:
        """How strongly it embeds, in its own unit."""
        ...

    def show(self, source: Source, index: int) -> MarkedPicture:
        """Embed message number ``index`` in picture number ``index``."""
        ...

    def read(self, pair: Rectified, filmed: bool) -> Iterator[tuple[int, Scores, float]]:
        """Read a capture in each way that the system knows.

        Args:
            pair: both frames.
            filmed: whether they were filmed, and so differ.

        Yields:
            number of frames used, scores (positive means 1), and processor time in seconds.
        """
        ...


@dataclass(frozen=True)
class StillSystem:
    """A peer: one marked picture is displayed, and filmed twice."""

    peer: Peer
    """What marks and reads the picture."""

    @property
    def name(self) -> str:
        """Name of the peer."""
        return self.peer.name

    @property
    def strength(self) -> str:
        """Strength of the peer."""
        return self.peer.strength

    def show(self, source: Source, index: int) -> MarkedPicture:
        """Mark a picture with the head room that ours has; both frames show it."""
        pictures = shuffled_pictures(source)
        clean = with_head_room(pictures[index % len(pictures)].rgb, DRAWS_OF_KAPPA)
        bits = np.random.default_rng([source.seed, index]).integers(0, 2, self.peer.n_bits)
        marked = self.peer.embed(clean, bits)
        return MarkedPicture(clean, Displayed(marked, marked, bits, source.layout, DRAWS_OF_KAPPA))

    def read(self, pair: Rectified, filmed: bool) -> Iterator[tuple[int, Scores, float]]:
        """Read one frame, and, where they were filmed, the mean of the two."""
        yield 1, *timed_scores(partial(self.peer.extract, pair.original))
        if filmed:
            mean = np.rint((pair.original.astype(np.float64) + pair.embedded) / 2)
            yield 2, *timed_scores(partial(self.peer.extract, mean.astype(np.uint8)))


@dataclass(frozen=True)
class PairSystem:
    """A decoder of this repository: two frames are displayed in turn, and filmed once each."""

    method: Method
    """What decodes the frame pair."""
    kappa: int
    """Gray levels added to a block that carries a 1."""

    @property
    def name(self) -> str:
        """Name of the method."""
        return self.method.name

    @property
    def strength(self) -> str:
        """Value of kappa in words."""
        return f"κ {self.kappa}"

    def show(self, source: Source, index: int) -> MarkedPicture:
        """Take the original and the embedded frame of a frame pair."""
        cell = Cell("canon-lg", 0.0, self.kappa)  # the channel decides nothing of what is shown
        displayed = FramePair(source, cell, index, self.method.card.equalised).displayed
        return MarkedPicture(displayed.original, displayed)

    def read(self, pair: Rectified, filmed: bool) -> Iterator[tuple[int, Scores, float]]:
        """Decode both frames."""
        scores, seconds = timed_scores(lambda: self.method.build().decode(pair).scores)
        yield 2, scores, seconds


def timed_scores(read: Callable[[], Scores]) -> tuple[Scores, float]:
    """Call ``read``, and add the seconds of processor time: others may share the machine."""
    started = time.process_time()
    scores = read()
    return scores, time.process_time() - started


@dataclass(frozen=True)
class PeerTask:
    """One system, and the captures from which it shall read."""

    source: Source
    """Pictures, layout, seed and channel."""
    pairs: tuple[str, ...]
    """Camera-display pairs."""
    views: tuple[float, ...]
    """Angles between the camera and the normal of the display, degrees."""
    frames: int
    """Number of pictures."""
    system: System
    """What embeds and reads."""
    packages: dict[str, str] = field(default_factory=dict)
    """Versions of the other systems' packages, on which what they read depends."""


def read_messages(task: PeerTask) -> list[dict[str, Any]]:
    """Let one system embed and read: without a channel, after JPEG, and filmed.

    What is filmed has the draws of the same index in the cell of `DRAWS_OF_KAPPA`, whatever the
    system.

    Returns:
        the fields of a `Reading` for each message and each way to read it.
    """
    one_thread()
    system, readings = task.system, []
    for index in range(task.frames):
        shown = system.show(task.source, index)
        visible = psnr(shown.clean, shown.displayed.embedded)
        similar = ssim(shown.clean, shown.displayed.embedded)
        for reception in receptions(task, shown, index):
            found = system.read(reception.frames, reception.pair is not None)
            for frames_used, scores, seconds in found:
                reading = Reading(
                    method=system.name,
                    strength=system.strength,
                    condition=reception.condition,
                    frames_used=frames_used,
                    pair=reception.pair,
                    view_deg=reception.view_deg,
                    index=index,
                    psnr=visible,
                    ssim=similar,
                    decode_s=round(seconds, 6),
                    scores=[float(f"{score:.6g}") for score in scores],
                    bits=shown.displayed.bits.tolist(),
                )
                readings.append(asdict(reading))
    return readings


def receptions(task: PeerTask, shown: MarkedPicture, index: int) -> Iterator[Reception]:
    """Send what is displayed through every condition, and rectify what comes."""
    displayed = shown.displayed
    frames = Rectified(displayed.original, displayed.embedded, displayed.layout, displayed.kappa)
    yield Reception(NO_CHANNEL, None, None, frames)
    original = jpeg(displayed.original, JPEG_QUALITY)
    embedded = jpeg(displayed.embedded, JPEG_QUALITY)
    yield Reception(JPEG, None, None, replace(frames, original=original, embedded=embedded))
    for name in task.pairs:
        for view in task.views:
            rng = FramePair(task.source, Cell(name, view, DRAWS_OF_KAPPA), index).channel_rng()
            captured = capture(displayed, task.source.pair(name), view, rng)
            yield Reception(f"{view:g}°", name, view, captured.rectified())
