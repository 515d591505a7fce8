"""A decoder that is compared, with its options."""

from collections.abc import Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import PydanticUserError, TypeAdapter, ValidationError

from link.errors import InputError, choose, each_once
from link.frames import SoftBits
from link.layout import Layout
from link.observation import Observation
from models import BlockDecoder, Card, find_card, make_decoder
from models.pairwise import decode_by_pairs

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


@dataclass(frozen=True)
class ByPairs:
    """A decoder of frame pairs that reads films as well, pair by pair (`models.pairwise`)."""

    decoder: BlockDecoder
    """The decoder."""

    def decode(self, observation: Observation) -> SoftBits:
        """Score the message blocks of a frame pair, or of all pairs of a window of film."""
        if observation.is_pair:
            return self.decoder.decode(observation)
        return decode_by_pairs(self.decoder, observation)


@dataclass(frozen=True)
class Method:
    """A method by name, with its options: cheap to send to another process."""

    name: str
    """A key of `models.DECODERS`, or "package.module:Class" for one that lives elsewhere."""
    options: tuple[tuple[str, Any], ...] = ()
    """Fields of the decoder's dataclass, as (name, value)."""
    label: str = field(default="")
    """Name of the method in tables; by default its name, or that of its class alone."""
    by_pairs: bool = False
    """Whether it reads films pair by pair even where its class reads windows."""

    def __post_init__(self) -> None:
        assert self.card
        if not self.label:
            object.__setattr__(self, "label", self.name.rpartition(":")[2])

    @property
    def card(self) -> Card:
        """All that is known of the method."""
        return find_card(self.name)

    def checkpoint(self, layout: Layout) -> Path | None:
        """Folder of its checkpoint: the one among its options, or what ships for the layout."""
        shipped = self.card.checkpoint and self.card.checkpoint(layout)
        return dict(self.options).get("checkpoint", shipped)

    def build(self) -> BlockDecoder:
        """The decoder, which reads films by pairs that are put together if it reads pairs alone."""
        decoder = make_decoder(self.name, **dict(self.options))
        return ByPairs(decoder) if self.by_pairs or self.card.frames == "pair" else decoder


def methods_for(names: Sequence[str], checkpoint: Path | None = None) -> list[Method]:
    """The named methods; ``learned`` gets the checkpoint, or takes what ships for each layout.

    Args:
        names: keys of `models.DECODERS` or "package.module:Class", each perhaps with options, as
            in "oorc:C=0.1" or "linear:degree=4,smooth=false".
        checkpoint: folder of the checkpoint of ``learned``.

    Raises:
        InputError: a name is unknown or there twice, or an option is none of its method.

    >>> methods_for(["oorc", "oorc:C=0.1"])[1].options
    (('C', 0.1),)
    """
    methods = []
    for text in names:
        name, options = _with_options(text)
        if name == "learned" and checkpoint is not None:
            options = (("checkpoint", checkpoint), *options)
        methods.append(Method(name, options, label=text if "=" in text else ""))
    each_once(methods=[method.label for method in methods])
    return methods


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


def _with_options(text: str) -> tuple[str, tuple[tuple[str, Any], ...]]:
    """Take a method's name and its options apart."""
    name, colon, settings = text.rpartition(":")
    if not colon or "=" not in settings:
        return text, ()
    decoder = make_decoder(name)
    kinds: dict[str, Any] = get_type_hints(type(decoder)) if is_dataclass(decoder) else {}
    options = []
    for setting in settings.split(","):
        key, _, value = setting.partition("=")
        kind = choose(kinds, key, f"option of {name}")
        try:
            options.append((key, TypeAdapter(kind).validate_strings(value)))
        except (PydanticUserError, ValidationError) as error:
            why = error.errors()[0]["msg"] if isinstance(error, ValidationError) else "no text can"
            raise InputError(f"method {text!r}: {key} cannot be {value!r}: {why}") from None
    return name, tuple(options)
