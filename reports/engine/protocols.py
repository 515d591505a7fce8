"""What the paper leaves open, as named variants: thresholds, kappa of the ratex, votes."""

import json
from dataclasses import dataclass, field
from typing import Any

from data_gen.pairs import FITTED_FILE
from link.errors import choose
from reports.engine.methods import Method

LEARNED = json.loads(FITTED_FILE.read_text())["meta"]["learned_thresholds"]
"""Thresholds that `reports.lab.calibrate` learned once for all captures, or for the frontal
ones."""


@dataclass(frozen=True)
class Protocol:
    """Options of the paper's methods; what is not named keeps the tuned default."""

    description: str
    options: dict[str, dict[str, Any]] = field(default_factory=dict)
    ratex_kappa: int | None = None
    """Gray levels by which ratex patches toggle; None for the message's kappa."""


HALF_KAPPA = {"hidden_ratex": {"threshold": "constant"}}

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
        {m: {"threshold": value} for m, value in LEARNED["once"].items()},
    ),
    "frontal": Protocol(
        "the same, of the frontal captures",
        {m: {"threshold": value} for m, value in LEARNED["frontal"].items()},
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
        {m: {"train_on": "pixel"} for m in ("naive", "two_step", "oorc")},
    ),
    "ratex10": Protocol("as fair, and the ratex patches toggle by 10, as § Methods says", {}, 10),
}


def apply(protocol: str, methods: list[Method]) -> list[Method]:
    """The methods as a protocol sets them; an unknown name lists the valid ones."""
    options = choose(PROTOCOLS, protocol, "protocol").options
    return [
        Method(m.name, m.options + tuple(sorted(options.get(m.name, {}).items())), m.label)
        for m in methods
    ]
