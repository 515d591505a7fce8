"""Ways to read what the paper leaves open: thresholds, kappa of the ratex patches, and votes."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from data_gen.pairs import FITTED_FILE
from link.errors import choose
from reports.engine.methods import Method

LEARNED = json.loads(FITTED_FILE.read_text())["meta"]["learned_thresholds"]
"""Thresholds in gray levels that `reports.lab.calibrate` learned on the ratex patches: "once" on
those of all captures, "frontal" on those of the captures at 0 degrees; each by method."""
HALF_KAPPA = {"hidden_ratex": {"threshold": "constant"}}
"""Options by which hidden ratex decides at half of kappa."""


@dataclass(frozen=True)
class Protocol:
    """One way to read the paper, as options of its methods."""

    description: str
    """What it does, for tables."""
    options: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Fields of the decoders by method; what is not named keeps the decoder's default."""
    ratex_kappa: int | None = None
    """Gray levels by which ratex patches toggle; None for as many as the message does."""


PROTOCOLS: dict[str, Protocol] = {
    "fair": Protocol("every threshold learned in each frame pair, tuned on training captures"),
    "paper": Protocol(
        "naive and two-step keep 2.5 gray levels (half of κ = 5) for every κ and view; hidden "
        "ratex takes half of κ; OORC is retrained in each frame pair",
        {"naive": {"threshold": 2.5}, "two_step": {"threshold": 2.5}, **HALF_KAPPA},
    ),
    "constant": Protocol(
        "naive keeps 2 captured gray levels, two-step and hidden ratex take half of κ",
        {"naive": {"threshold": 2.0}, "two_step": {"threshold_kappa": 0.5}, **HALF_KAPPA},
    ),
    "once": Protocol(
        "naive and two-step keep what one SVM learns on the ratex patches of all captures",
        {method: {"threshold": value} for method, value in LEARNED["once"].items()},
    ),
    "frontal": Protocol(
        "naive and two-step keep what one SVM learns on the ratex patches of the frontal captures",
        {method: {"threshold": value} for method, value in LEARNED["frontal"].items()},
    ),
    "vote": Protocol(
        "as paper, and each pixel of a block votes",
        {
            "naive": {"threshold": 2.5, "pooling": "vote"},
            "two_step": {"threshold": 2.5, "pooling": "vote"},
            "oorc": {"pooling": "vote"},
            **HALF_KAPPA,
        },
    ),
    "pixel": Protocol(
        "every threshold learned in each frame pair, on single ratex pixels",
        {method: {"train_on": "pixel"} for method in ("naive", "two_step", "oorc")},
    ),
    "ratex10": Protocol(
        "as fair, and the ratex patches toggle by 10, as § Methods says", ratex_kappa=10
    ),
}
"""Protocols by name; `reports.studies.prediction` compares them with the paper's tables."""


def apply_protocol(protocol: str, methods: Sequence[Method]) -> list[Method]:
    """Give methods the options of a protocol.

    >>> apply_protocol("paper", [Method("naive"), Method("oorc")])[0].options
    (('threshold', 2.5),)

    Args:
        protocol: a key of `PROTOCOLS`.
        methods: methods of the paper, or others, which stay as they are.

    Raises:
        InputError: the protocol is unknown (the message lists those that are known).
    """
    options = choose(PROTOCOLS, protocol, "protocol").options
    return [
        Method(m.name, m.options + tuple(sorted(options.get(m.name, {}).items())), m.label)
        for m in methods
    ]
