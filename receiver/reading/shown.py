"""Frame pairs as they were read: their scores, and what the camera saw of their two states."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from link.frames import SoftBits
from link.observation import Observation
from link.types import Image
from models.pairwise import compose_pair
from receiver.reading.states import DisplayState, block_purity


@dataclass(frozen=True, eq=False)
class States:
    """A frame pair whose two states were put together from camera frames."""

    original: DisplayState
    """First state of the pair."""
    embedded: DisplayState
    """Second state of the pair."""
    blocks: NDArray[np.bool_]
    """(rows, cols) blocks that hold bits of the message."""

    @property
    def images(self) -> tuple[Image, Image]:
        """The original and the embedded state, an `Image` each of the layout's size."""
        return self.original.image, self.embedded.image

    @cached_property
    def purity(self) -> NDArray[np.floating]:
        """(n_bits,) how purely exposures fell into one state at each message block, in [0, 1]."""
        purer = np.minimum(self.original.purity, self.embedded.purity)
        return block_purity(purer, self.blocks)

    @property
    def frames(self) -> tuple[int, int]:
        """Numbers of camera frames of which each state was put together."""
        return self.original.frames, self.embedded.frames


@dataclass(frozen=True, eq=False)
class InWindow:
    """A frame pair that was read in a window of film."""

    window: Observation
    """The window."""
    place: int
    """Place of the frame pair among those of the window."""

    @cached_property
    def _composed(self) -> tuple[Image, Image, NDArray[np.float32]]:
        return compose_pair(self.window, self.place)

    @property
    def images(self) -> tuple[Image, Image]:
        """Both states as decoders of frame pairs get them, gray images of the layout's size."""
        return self._composed[:2]

    @property
    def purity(self) -> NDArray[np.floating]:
        """(n_bits,) purity of the less pure state at each message block, in [0, 1]."""
        return self._composed[2][self.window.layout.message_mask]

    @cached_property
    def frames(self) -> tuple[int, int]:
        """Numbers of frames that show more of each state; even mixtures count for none."""
        mixture = self.window.mixture
        shares = mixture.shares.mean((2, 3))[mixture.pair == self.place]
        return int((shares < 0).sum()), int((shares > 0).sum())


Shown = States | InWindow
"""What camera frames show of the two states of a frame pair."""


@dataclass(frozen=True, eq=False)
class ReadPair:
    """A frame pair and its scores."""

    number: int
    """Number of the frame pair on the display, counted from an arbitrary start."""
    soft: SoftBits
    """Scores, 0 for erased blocks."""
    shown: Shown
    """States of the pair, composed of camera frames."""
    mixed: float = 0.0
    """Share in [0, 1] of the blocks' trust that mixed exposures cost."""
