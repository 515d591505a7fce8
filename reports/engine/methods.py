"""A decoder that is compared, with its options, and the layouts that it suits."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from link.embed import embed
from link.errors import InputError, UnsuitedError, each_once
from link.frames import SoftBits
from link.layout import Layout
from link.observation import Mixture, Observation
from models import BlockDecoder, Card, find_card, make_decoder
from models.film.window import reads_films
from models.pairwise import decode_by_pairs


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
    """What tables call it; the name where none is given, or that of the class alone."""

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
        return ByPairs(decoder) if self.card.frames == "pair" else decoder


def methods_for(names: Sequence[str], checkpoint: Path | None = None) -> list[Method]:
    """The named methods; ``learned`` gets the checkpoint, or takes what ships for each layout."""
    options = {"learned": (("checkpoint", checkpoint),)} if checkpoint is not None else {}
    methods = [Method(name, options.get(name, ())) for name in names]
    each_once(methods=[method.label for method in methods])
    return methods


def suited_to_films(methods: Sequence[Method], layout: Layout) -> tuple[list[Method], list[str]]:
    """Find the methods that can decode films of a layout, by letting them decode a part of one.

    This is a window of frames, or a frame pair where films are read by these.

    Returns:
        the methods that suit, and a line for each that is left out.

    Raises:
        InputError: no method suits.
    """
    if not reads_films(layout):
        return suited_methods([m for m in methods if m.card.frames != "window"], layout)
    suited, notes = [], []
    gray = np.full((layout.height, layout.width), 128, np.uint8)
    shares = np.zeros((4, 1, layout.rows, layout.cols), np.float32)
    shares[::2], shares[1::2] = -0.5, 0.5
    mixture = Mixture(shares, np.array([[0], [0], [1], [1]]), 2)
    trial = Observation((gray, gray, gray, gray), layout, mixture)
    for method in methods:
        try:
            method.build().decode(trial)
            suited.append(method)
        except UnsuitedError as error:
            notes.append(f"{method.label}: left out, {error}")
    if not suited:
        raise InputError(f"no method suits these films; {'; '.join(notes)}")
    return suited, notes


def suited_methods(methods: Sequence[Method], layout: Layout) -> tuple[list[Method], list[str]]:
    """Find the methods that can decode frame pairs of a layout, by letting them decode one.

    Ratex patches suit every method. Methods that are shown pictures without ratex patches suit
    every layout. So these are not tried.

    Args:
        methods: all that are asked for.
        layout: layout of the frame pairs.

    Returns:
        the methods that suit, and a line for each that is left out.

    Raises:
        InputError: no method suits.
    """
    suited, notes = [], []
    picture = np.random.default_rng(0).integers(0, 256, (layout.height, layout.width, 3), np.uint8)
    shown = embed(picture, np.zeros(layout.n_bits), layout, kappa=5)
    pair = Observation.still(shown.original, shown.embedded, layout, shown.kappa)
    for method in methods:
        try:
            if method.card.frames == "window":
                raise UnsuitedError("it reads films (--films)")
            if not (layout.ratex or method.card.equalised):
                method.build().decode(pair)
            suited.append(method)
        except UnsuitedError as error:
            notes.append(f"{method.label}: left out, {error}")
    if not suited:
        raise InputError(f"no method suits this layout; {'; '.join(notes)}")
    return suited, notes
