"""The loop that a display shows: message and pictures -> frame pairs, one at a time."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from export.send.pictures import Pictures, fit
from link.code.framing import capacity
from link.embed import embed, psnr, ssim
from link.errors import InputError
from link.frames import Displayed
from link.layout import Layout

MAX_PAIRS = 4096


@dataclass
class Loop:
    """Frame pairs of a loop; each shows its original, then its embedded frame.

    Message frames come in turn, and so do pictures. Every picture is shown once; then pictures
    start again until the message is whole, so that the number of pairs is a multiple of the
    message's frames: the end of the loop runs into its start as any frame into the next, and a
    receiver may join at any moment.
    """

    layout: Layout
    kappa: int
    bits: NDArray[np.uint8]
    """(frames, n_bits) 0 or 1, of `link.code.framing.encode`."""
    pictures: Pictures
    pyramid_level: int = 0
    seen: list[tuple[float, float]] = field(default_factory=list)
    """PSNR in dB and SSIM of each pair that `pairs` gave."""

    def pairs(self) -> Iterator[Displayed]:
        """The frame pairs.

        Raises:
            InputError: a picture is no good, the loop is too long, or see `link.embed.embed`.
        """
        self.seen = []
        for number, picture in enumerate(self._pictures()):
            if number == MAX_PAIRS:
                raise InputError(
                    f"a loop holds at most {MAX_PAIRS} frame pairs; "
                    "give fewer pictures or a shorter video"
                )
            picture = fit(picture, self.layout.width, self.layout.height)
            bits = self.bits[number % len(self.bits)]
            pair = embed(picture, bits, self.layout, self.kappa, self.pyramid_level)
            self.seen.append(
                (psnr(pair.original, pair.embedded), ssim(pair.original, pair.embedded))
            )
            yield pair

    def states(self) -> Iterator[NDArray[np.uint8]]:
        """(height, width, 3) uint8, encoded RGB, as the display shows them one after another."""
        for pair in self.pairs():
            yield pair.original
            yield pair.embedded

    def _pictures(self) -> Iterator[NDArray[np.uint8]]:
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
        """What was sent, after all `pairs` were taken: counts, seconds, bit/s, PSNR and SSIM.

        Args:
            message_bytes: length of the message.
            state_hz: states (original or embedded frames) shown in a second.
        """
        frames, pairs = len(self.bits), len(self.seen)
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
