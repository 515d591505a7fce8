"""Rules for thresholds: learned in each frame pair, or fixed as in the paper."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from link.errors import choose
from reports.engine.methods import Method

PROTOCOLS: dict[str, dict[str, dict[str, Any]]] = {
    "fair": {},
    "paper": {
        "naive": {"threshold": 2.5},
        "two_step": {"threshold": 2.5},
        "hidden_ratex": {"threshold": "constant"},
    },
}
"""Fields of the decoders by protocol and method; what is not named keeps the decoder's default.
"fair" learns every threshold in each frame pair. "paper" keeps 2.5 gray levels, half of kappa = 5,
for every kappa and view, and half of kappa for hidden ratex, which is nearest to the paper's tables
among the ways to read it that were tried (docs/answered.md)."""


def apply_protocol(protocol: str, methods: Sequence[Method]) -> list[Method]:
    """Give methods the options of a protocol.

    >>> apply_protocol("paper", [Method("naive"), Method("oorc")])[0].options
    (('threshold', 2.5),)
    >>> apply_protocol("fair", [Method("phi", by_pairs=True)])[0].by_pairs
    True

    Args:
        protocol: a key of `PROTOCOLS`.
        methods: methods of the paper, or others, which stay as they are.

    Raises:
        InputError: the protocol is unknown (the message lists those that are known).
    """
    options = choose(PROTOCOLS, protocol, "protocol")
    return [
        replace(m, options=m.options + tuple(sorted(options.get(m.name, {}).items())))
        for m in methods
    ]
