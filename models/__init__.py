"""Decoders by name. Importing this package imports no torch; the modules load on use."""

from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from link.errors import choose
from link.frames import Rectified, SoftBits

PRETRAINED = Path(__file__).parent / "neural" / "pretrained"
"""The shipped checkpoint of ``learned``, trained on all pairs."""
DECODERS = {
    "naive": "models.classical.naive:Naive",
    "two_step": "models.classical.two_step:TwoStep",
    "oorc": "models.classical.oorc:OORC",
    "hidden_ratex": "models.classical.hidden_ratex:HiddenRatex",
    "blind": "models.classical.blind:Blind",
    "phi": "models.neural.methods:Phi",
    "learned": "models.neural.methods:Learned",
    "cnn": "models.neural.cnn:Cnn",
}


class Decoder(Protocol):
    """The one interface of all methods: calibrate on this frame pair alone, score its blocks."""

    needs_ratex: bool
    """True where the method trains on ratex patches; the others are shown equalised pictures."""

    def decode(self, pair: Rectified) -> SoftBits:
        """Score every message block; positive means bit 1."""
        ...


def make_decoder(name: str, **options: Any) -> Decoder:
    """Build the decoder called ``name``.

    Args:
        name: a key of `DECODERS`.
        **options: fields of that decoder's dataclass, such as ``C`` or ``checkpoint``.

    Raises:
        InputError: the name is unknown (the message lists the valid ones).
    """
    module, _, attribute = choose(DECODERS, name, "method").partition(":")
    decoder: Decoder = getattr(import_module(module), attribute)(**options)
    return decoder
