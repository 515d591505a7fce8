"""The loop that a display shows: a message and pictures become frame pairs, one at a time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from link.code.framing import capacity
from link.embed import embed
from link.errors import InputError
from link.frames import Displayed
from link.images import fit_picture
from link.images.quality import psnr, ssim
from link.layout import Layout

MAX_PAIRS = 4096
"""Largest number of frame pairs in a loop."""
MEASURED_PAIRS = 100
"""Number of frame pairs, from a loop's first on, of which PSNR and SSIM are taken. That takes
longer than making a pair."""

Pictures = Callable[[], Iterator[NDArray[np.uint8]]]
"""Pictures of any size, (H, W, 3) uint8, encoded RGB; each call begins with the first picture."""


@dataclass
class Loop:
    """Frame pairs of a loop; each shows its original, then its embedded frame.

    Message frames come in turn, and so do pictures. Every picture is shown once; then pictures
    start again until the message is whole, so that the number of pairs is a multiple of the
    message's frames: the end of the loop runs into its start as any frame into the next, and a
    receiver may join at any moment.

    >>> from link.code.framing import encode
    >>> from link.layout import make_layout
    >>> layout = make_layout(rows=5, cols=5, width=80, height=80, ratex=2)
    >>> gray = np.full((80, 80, 3), 128, np.uint8)
    >>> loop = Loop(layout, 3, encode(b"Hi", layout.n_bits), lambda: iter([gray]))
    >>> states = list(loop.states())
    >>> (len(loop.bits), len(states), states[0].shape)
    (9, 18, (80, 80, 3))
    """

    layout: Layout
    """Grid of blocks and ratex patches that the display shows."""
    kappa: int
    """Gray levels added where a bit is 1."""
    bits: NDArray[np.uint8]
    """(frames, n_bits) bits of the message, 0 or 1, as `link.code.framing.encode` returns them."""
    pictures: Pictures
    """Pictures that carry the message; each is cut and resized to the layout's frame."""
    pyramid_level: int = 0
    """Softness of the blocks' edges, which blur over about 2**level pixels; 0 for hard edges."""
    seen: list[tuple[float, float]] = field(default_factory=list)
    """PSNR in decibels and SSIM of the frame pairs given so far, of at most `MEASURED_PAIRS`."""
    given: int = 0
    """Number of frame pairs that `pairs` has given so far."""

    def pairs(self) -> Iterator[Displayed]:
        """Give the frame pairs of one loop, one after another.

        Raises:
            InputError: a picture is no good, the loop is too long, or kappa, the bits or the
                pyramid level do not fit the layout.
        """
        self.seen, self.given = [], 0
        for number, picture in enumerate(self._pictures()):
            if number == MAX_PAIRS:
                raise InputError(
                    f"a loop holds at most {MAX_PAIRS} frame pairs; "
                    "give fewer pictures or a shorter video"
                )
            picture = fit_picture(picture, self.layout.width, self.layout.height)
            bits = self.bits[number % len(self.bits)]
            pair = embed(picture, bits, self.layout, self.kappa, self.pyramid_level)
            if number < MEASURED_PAIRS:
                likeness = psnr(pair.original, pair.embedded), ssim(pair.original, pair.embedded)
                self.seen.append(likeness)
            self.given += 1
            yield pair

    def states(self) -> Iterator[NDArray[np.uint8]]:
        """Give the frames of one loop as the display shows them one after another.

        Each is (height, width, 3) uint8, encoded RGB. Original and embedded frames alternate.

        Raises:
            InputError: a picture is no good, the loop is too long, or kappa, the bits or the
                pyramid level do not fit the layout.
        """
        for pair in self.pairs():
            yield pair.original
            yield pair.embedded

    def _pictures(self) -> Iterator[NDArray[np.uint8]]:
        """Every picture once, and then again until the message is whole."""
        given = 0
        for picture in self.pictures():
            given += 1
            yield picture
        while True:
            for picture in self.pictures():
                if given % len(self.bits) == 0:
                    return
                given += 1
                yield picture

    def report(self, message_bytes: int, state_hz: float) -> dict[str, Any]:
        """Say what was sent, after all `pairs` were taken: counts, seconds, bit/s, PSNR and SSIM.

        Args:
            message_bytes: length of the message.
            state_hz: states (original or embedded frames) shown in a second.

        Returns:
            values of JSON's types by name; seconds, bits a second and decibels as the names say.
        """
        frames, pairs = len(self.bits), self.given
        message_s = 2 * frames / state_hz
        noise = np.mean([10 ** (-db / 10) for db, _ in self.seen])
        return {
            "frames": frames,
            "pairs": pairs,
            "bits_per_frame": self.layout.n_bits,
            "message_bytes": message_bytes,
            "capacity_bytes": capacity(frames, self.layout.n_bits),
            "state_hz": round(state_hz, 3),
            "message_seconds": round(message_s, 3),
            "loop_seconds": round(2 * pairs / state_hz, 3),
            "message_bit_per_s": round(8 * message_bytes / message_s, 2),
            "bound_bit_per_s": round(self.layout.n_bits * state_hz / 2, 2),
            "psnr_db": round(float(-10 * np.log10(noise)), 2) if noise > 0 else None,
            "ssim": round(float(np.mean([similarity for _, similarity in self.seen])), 4),
            "kappa": self.kappa,
            "layout": self.layout.to_dict(),
        }
