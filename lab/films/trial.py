"""What a receiver makes of films of messages (`data_gen.film.message`), frame by frame.

`FilmReading` gives the frames to a receiver, and compares what is read with what was sent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_gen.channel.optics import check_view
from data_gen.film.frame import VideoFrame
from data_gen.film.message import MessageFilm, Take
from data_gen.pairs import pair_names
from link.errors import each_once
from models import shipped_graphs
from receiver.decoders import PairDecoder, WindowDecoder
from receiver.receiver import Receiver, ReceiverStep


def graph_of(take: Take) -> Path:
    """Name the exported decoder that ships for what the display of a film shows."""
    return shipped_graphs()[take.settings.layout]


@dataclass(frozen=True)
class Delivery:
    """What became of one message."""

    pair: str
    """Camera-display pair."""
    view_deg: float
    """Angle between the camera and the normal of the display, degrees."""
    run: int
    """Number of the run among those of the pair and view."""
    picture: str
    """Name of the picture that carried the message."""
    delivered: bool
    """Whether the message came."""
    wrong: bool
    """Whether a message came that was not sent."""
    seconds: float
    """Time of the film until then, or until the run was given up, seconds."""
    bits: int
    """Number of bits that were decided on the way."""
    bits_wrong: int
    """Number of these that are wrong, each frame pair held against the one that it fits best."""


class FilmReading:
    """What a receiver reads of a film, frame by frame.

    Args:
        filmed: the film, whose truth is compared with what is read; its frames are not taken.
        decoder: decoder of the receiver.
        film: film decoder of the receiver; None where it reads frame pairs alone.
    """

    def __init__(
        self,
        filmed: MessageFilm,
        decoder: PairDecoder,
        film: WindowDecoder | None = None,
    ) -> None:
        self._filmed = filmed
        self._receiver = Receiver(decoder, filmed.take.settings.fps, film)
        self._received: bytes | None = None
        self._wrong = self._decided = 0
        self._time = 0.0

    @property
    def ended(self) -> bool:
        """Whether a message came."""
        return self._received is not None

    def push(self, frame: VideoFrame) -> None:
        """Give the receiver the next frame and its time."""
        self._time = frame.time_s
        self._note(self._receiver.push(frame.rgb, frame.time_s))

    def _note(self, step: ReceiverStep) -> None:
        """Compare what the receiver read with what was shown."""
        for scores in (pair.soft.scores for pair in step.pairs):
            shown = nearest_frame(scores, self._filmed.bits)
            self._wrong += int(((scores > 0) != shown).sum())
            self._decided += len(shown)
        if step.message is not None:
            self._received = step.message.data

    def finish(self) -> None:
        """Read what is left when the film has ended."""
        self._note(self._receiver.finish())

    def delivery(self) -> Delivery:
        """Say what became of the message, once the film is over or the message has come."""
        if not self.ended:
            self.finish()
        take = self._filmed.take
        return Delivery(
            pair=take.pair,
            view_deg=take.view,
            run=take.run,
            picture=self._filmed.picture,
            delivered=self._received == self._filmed.message,
            wrong=self.ended and self._received != self._filmed.message,
            seconds=self._time,
            bits=self._decided,
            bits_wrong=self._wrong,
        )


def nearest_frame(scores: NDArray[np.float64], bits: NDArray[np.integer]) -> NDArray[np.integer]:
    """Choose the frame pair of a loop that the scores of a frame pair fit best.

    >>> nearest_frame(np.array([2.0, -1.0, 3.0]), np.array([[0, 1, 0], [1, 0, 0]])).tolist()
    [1, 0, 0]

    Args:
        scores: (n_bits,) scores of the bits; positive means 1.
        bits: (loop frames, n_bits) of 0 or 1.

    Returns:
        (n_bits,) bits of that frame pair.
    """
    return np.asarray(bits[((scores > 0) != bits).sum(axis=1).argmin()])


def check_filmed(pairs: Sequence[str], views: Sequence[float]) -> None:
    """Raise an `InputError` for camera-display pairs and views that cannot be filmed."""
    each_once(pairs=pair_names(pairs), views=views)
    for view in views:
        check_view(view, "views")
