"""Which picture, message and channel draw make up frame pair number ``index`` of a cell.

Train and test are split twice: by picture (`pictures.load_pictures`) and by channel draw, since the
split's name seeds every draw.
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_gen.channel.composition import capture
from data_gen.effects import switch_off, with_parameter
from data_gen.pairs import get_pair
from data_gen.parameters import Pair
from data_gen.pictures.library import Picture, load_folder, load_pictures
from link.embed import embed
from link.equalise import equalise
from link.frames import Captured, Displayed
from link.layout import Layout


@dataclass(frozen=True)
class Cell:
    """One condition of the comparison."""

    pair: str
    view_deg: float
    kappa: int


@dataclass(frozen=True)
class Source:
    """Where the pictures, messages and channel draws of a cell come from."""

    layout: Layout
    split: str = "test"
    """"train" or "test"."""
    seed: int = 0
    pyramid_level: int = 0
    """Coarser pyramid level at which the message is added; 0 for plain blocks."""
    pictures: Path | None = None
    """The user's own folder, in place of the built-in pictures of the split."""
    ratex_kappa: int | None = None
    """Gray levels by which ratex patches toggle; None for the message's kappa."""
    without: tuple[str, ...] = ()
    """Effects of the channel switched off, of `effects.EFFECTS`."""
    parameters: tuple[tuple[str, Any], ...] = ()
    """Parameters of the channel set to other values, by name."""

    def pair(self, name: str) -> Pair:
        """The pair as this source films it; raises an `InputError` for a name or value."""
        pair = switch_off(get_pair(name), self.without)
        for parameter, value in self.parameters:
            pair = with_parameter(pair, parameter, value)
        return pair


def shuffled_pictures(source: Source) -> Sequence[Picture]:
    """The source's pictures, in an order in which every prefix mixes photographs and drawings."""
    return _shuffled(source.split, source.pictures, source.layout.width, source.layout.height)


@lru_cache(maxsize=4)
def _shuffled(split: str, folder: Path | None, width: int, height: int) -> Sequence[Picture]:
    if folder is not None:
        return load_folder(folder, width, height)
    pictures = load_pictures(split, width, height)
    order = np.random.default_rng(zlib.crc32(split.encode())).permutation(len(pictures))
    return [pictures[i] for i in order]


@dataclass(frozen=True)
class Take:
    """One frame pair before it is filmed."""

    displayed: Displayed
    picture: str
    """Name of the picture."""
    channel_rng: np.random.Generator
    """Draws pose, exposure, motion and noise."""


def prepare(
    source: Source,
    cell: Cell,
    index: int,
    hidden: bool = False,
    bits: NDArray[np.intp] | None = None,
) -> Take:
    """What the display shows as frame pair ``index`` of a cell; arguments as of `simulate`.

    ``bits`` (n_bits,) take the place of the drawn message and change no other draw.
    """
    name = f"{source.split}/{cell.pair}/{cell.view_deg:g}/{cell.kappa}/{index}"
    seeds = np.random.SeedSequence([source.seed, zlib.crc32(name.encode())]).spawn(2)
    message_rng, channel_rng = (np.random.default_rng(seed) for seed in seeds)
    pictures = shuffled_pictures(source)
    picture = pictures[index % len(pictures)]
    layout = replace(source.layout, ratex=()) if hidden else source.layout
    displayed = embed(
        equalise(picture.rgb) if hidden else picture.rgb,
        message_rng.integers(0, 2, layout.n_bits) if bits is None else bits,
        layout,
        cell.kappa,
        source.pyramid_level,
        source.ratex_kappa,
    )
    return Take(displayed, picture.name, channel_rng)


def simulate(source: Source, cell: Cell, index: int, hidden: bool = False) -> Captured:
    """Film frame pair ``index`` of a cell.

    The draw depends on seed, split, cell and index alone, so cells can be made in any order, by any
    number of processes. Index i shows picture i modulo the number of pictures.

    Args:
        source: pictures and seed.
        cell: the condition.
        index: 0, 1, 2, ...
        hidden: show the equalised picture with no ratex patch, for the method hidden_ratex; pose,
            exposure and motion are those of the same index with patches.

    Raises:
        InputError: the pair or the picture folder is unknown, or kappa or the view out of range.
    """
    pair = source.pair(cell.pair)
    take = prepare(source, cell, index, hidden)
    captured = capture(take.displayed, pair, cell.view_deg, take.channel_rng)
    meta = {
        "picture": take.picture,
        "seed": source.seed,
        "simulated": True,
        "split": source.split if source.pictures is None else "own",
        "equalised": hidden,
        **({"without": list(source.without)} if source.without else {}),
        **({"parameters": dict(source.parameters)} if source.parameters else {}),
    }
    return replace(captured, meta={**captured.meta, **meta})
