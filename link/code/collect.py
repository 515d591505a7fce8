"""The collector turns scores of frames, in the order they were seen, into their loop's message.

Coarse and fine grids are framed in different ways, and the number of message blocks of a frame says
in which (`link.code.framing`). So there is a collector for each.
"""

from link.code.collect_coarse import CoarseCollector
from link.code.collect_fine import FineCollector
from link.code.framing import is_fine
from link.code.message import MAX_SCORE as MAX_SCORE
from link.code.message import Message as Message

Collector = CoarseCollector | FineCollector
"""Collects frames until the message is whole, and then until another one is.

A message is returned once. It is returned again only after another one was. Both have the same
methods, which `FineCollector` explains.
"""


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
