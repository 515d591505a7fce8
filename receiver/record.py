"""Windows of film as a receiver hands them to its film decoder, kept with the bits that they show.

Other decoders are compared on them, and the film decoder is trained on them: they hold what the
receiver found of corners and clock, with its errors.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from link.frames import SoftBits
from link.observation import Observation
from link.types import Array, Image
from receiver.decoders import PairDecoder, WindowDecoder
from receiver.receiver import Receiver

MOST_UNLIKE = 0.375
"""Largest share of wrong bits that a window's best match with the loop may leave. Chance leaves a
half, less the little that the best of all places in the loop gains."""


class WindowRecorder:
    """Decodes windows by another decoder, and keeps them.

    Args:
        decoder: decoder of the windows.
    """

    def __init__(self, decoder: WindowDecoder) -> None:
        self._decoder = decoder
        self.kept: list[tuple[Observation, SoftBits]] = []
        """Windows in the order in which they came, with their scores."""

    def prepare(self) -> None:
        """Have the decoder get ready."""
        self._decoder.prepare()

    def decode(self, observation: Observation) -> SoftBits:
        """Score the message bits of a window, and keep it."""
        soft = self._decoder.decode(observation)
        self.kept.append((observation, soft))
        return soft


@dataclass(frozen=True)
class KnownWindow:
    """A window of film, and the bits that it shows."""

    observation: Observation
    """T frames of P frame pairs."""
    bits: NDArray[np.integer]
    """(P, n_bits) bits that were sent, 0 or 1."""


def record_windows(
    frames: Iterable[tuple[Image, float]],
    fps: float,
    decoders: tuple[PairDecoder, WindowDecoder],
    loop: NDArray[np.integer],
    most: int,
) -> list[KnownWindow]:
    """Receive a film, and keep some of its windows with the bits that they show.

    Args:
        frames: frames of the film, an `Image` and its time in seconds each.
        fps: nominal number of frames a second.
        decoders: decoder of frame pairs for the layout that is shown, and the film decoder.
        loop: (loop pairs, n_bits) bits of the loop that the display shows.
        most: largest number of windows that are kept, spread evenly over those of the film.

    Returns:
        the windows; none where the display was not found. A window whose place in the loop is not
        clear is left out.
    """
    pairs, film = decoders
    recorder = WindowRecorder(film)
    receiver = Receiver(pairs, fps, recorder)
    for image, time in frames:
        receiver.push(image, time)
    receiver.finish()
    chosen = np.unique(np.linspace(0, len(recorder.kept) - 1, most).round().astype(int))
    windows = []
    for observation, soft in (recorder.kept[at] for at in chosen if recorder.kept):
        bits = shown_bits(soft.scores.reshape(observation.mixture.count, -1), loop)
        if bits is not None:
            windows.append(KnownWindow(observation, bits))
    return windows


def shown_bits(scores: Array, loop: NDArray[np.integer]) -> NDArray[np.integer] | None:
    """Find the part of a loop that successive frame pairs show.

    Args:
        scores: (P, n_bits) scores of the frame pairs.
        loop: (loop pairs, n_bits) bits of the loop, 0 or 1.

    Returns:
        (P, n_bits) bits of the frame pairs; None where no part of the loop fits clearly.

    >>> loop = np.array([[0, 1, 1], [1, 0, 1]])
    >>> shown_bits(np.array([[2.0, -1.0, 3.0], [-1.0, 1.0, 2.0]]), loop).tolist()
    [[1, 0, 1], [0, 1, 1]]
    """
    decided = scores > 0
    numbers = np.arange(len(decided)) + np.arange(len(loop))[:, None]  # (loop pairs, P)
    unlike = (decided[:, None] != loop.astype(bool)).mean(2)  # (P, loop pairs)
    misfits = unlike[np.arange(len(decided)), numbers % len(loop)].mean(1)
    best = int(misfits.argmin())
    if misfits[best] > MOST_UNLIKE:
        return None
    return np.asarray(loop[numbers[best] % len(loop)])
