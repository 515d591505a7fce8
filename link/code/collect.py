"""The collector turns scores of frames, in the order they were seen, into their loop's message.

Coarse and fine grids are framed in different ways, and the number of message blocks of a frame says
in which (`link.code.framing`). So there is a collector for each.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from link.code.collect_coarse import CoarseCollector
from link.code.collect_fine import FineCollector
from link.code.framing import is_fine
from link.code.message import MAX_SCORE as MAX_SCORE
from link.code.message import Message as Message


class Collector(Protocol):
    """Collects frames until the message is whole, and then until another one is.

    A message is returned once. It is returned again only after another one was.
    """

    @property
    def progress(self) -> float:
        """Information received, as a share of what is needed: about 1 when the message is whole.

        It is 1 while the display goes on showing a message that was returned.
        """
        ...

    @property
    def decoding(self) -> bool:
        """Whether decoding is under way, which `go_on` goes on with."""
        ...

    def start_run(self) -> None:
        """Say that the next frame's distance to the earlier ones is not known."""
        ...

    def add(self, scores: NDArray[np.float64], count: int, work: float = np.inf) -> Message | None:
        """Add one frame, and try to decode.

        Args:
            scores: (n_bits,) log-likelihood ratios, positive for 1; 0 for an erasure.
            count: number of the frame on the display, from any start; rising within a run.
            work: units of work after which decoding is left to `go_on`.

        Returns:
            the message where it is whole now and not the one that was returned last, else None.
        """
        ...

    def go_on(self, work: float = np.inf) -> Message | None:
        """Go on with decoding that is under way.

        Decoding a long message takes as long as several camera frames, so it may be done in steps.
        It goes on with what was collected when it began. Coarse grids decode at once, and have
        nothing to go on with.

        Args:
            work: units of work (`link.code.rateless.GRAPH_WORK`) after which no further step is
                taken; without it, decoding goes on until it ends.

        Returns:
            the message where it is whole now and not the one that was returned last, else None.
        """
        ...


def make_collector(n_bits: int) -> Collector:
    """Make the collector for frames of a number of message blocks.

    Args:
        n_bits: message blocks of a frame.

    Raises:
        InputError: the frames have too few blocks for a signature.

    The receiver joins the loop at its third frame and does not know how long the loop is:

    >>> from link.code.framing import encode
    >>> loop = encode(b"Hello", n_bits=59)
    >>> collector, message = make_collector(n_bits=59), None
    >>> for count in range(len(loop)):
    ...     message = message or collector.add(9.0 * loop[(count + 2) % len(loop)] - 4.5, count)
    >>> message.text
    'Hello'
    """
    return FineCollector(n_bits) if is_fine(n_bits) else CoarseCollector(n_bits)
