"""One simulated frame pair: its picture, its message, its channel, and what the camera stores.

Train and test are split twice: by picture (`data_gen.pictures.library.load_pictures`) and by
channel draw, since the split's name seeds every draw.
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from data_gen.channel.stills import capture
from data_gen.effects import switch_off, with_parameter
from data_gen.pairs import get_pair
from data_gen.parameters import Pair
from data_gen.pictures.library import Picture, load_folder, load_pictures
from link.embed import embed
from link.frames import Captured, Displayed
from link.images.equalise import equalise
from link.layout import Layout
from link.observation import Observation
from link.strength import block_steps


@dataclass(frozen=True)
class Cell:
    """One condition of the comparison."""

    pair: str
    """Name of the camera-display pair, such as "canon-lg"."""
    view_deg: float
    """Angle of observation, degrees from the display's normal."""
    kappa: int
    """Number of gray levels of [0, 255] added where a bit is 1."""


@dataclass(frozen=True)
class Source:
    """Source of the pictures, messages and channel draws of a cell."""

    layout: Layout
    """Layout of the displayed pictures."""
    split: str = "test"
    """Split whose pictures and channel draws are used: "train" or "test"."""
    seed: int = 0
    """Seed of every random draw."""
    pictures: Path | None = None
    """Folder or video of the user's own pictures, in place of the built-in ones of the split."""
    without: tuple[str, ...] = ()
    """Names of the effects in `effects.EFFECTS` that are switched off."""
    parameters: tuple[tuple[str, Any], ...] = ()
    """Names of parameters of the channel, and the values to which they are set."""
    even: bool = False
    """Whether blocks change by what makes all of them equally visible (`link.strength`), of which
    kappa is the least."""

    def pair(self, name: str) -> Pair:
        """Return the camera-display pair with this source's effects and parameters.

        Raises:
            InputError: a pair, effect or parameter is unknown, or a value is out of its range.
        """
        pair = switch_off(get_pair(name), self.without)
        for parameter, value in self.parameters:
            pair = with_parameter(pair, parameter, value)
        return pair

    def observe(self, cell: Cell, index: int, equalised: bool) -> Captured:
        """Make a frame pair, with what is known of it, for the comparison of decoders.

        Args:
            cell: pair, view and kappa.
            index: number of the frame pair in its cell.
            equalised: whether equalised pictures without ratex patches are shown.
        """
        return FramePair(self, cell, index, equalised).captured


def shuffled_pictures(source: Source) -> Sequence[Picture]:
    """Return the source's pictures; photographs and drawings are mixed in every prefix."""
    return _shuffled(source.split, source.pictures, source.layout.width, source.layout.height)


@lru_cache(maxsize=4)
def _shuffled(split: str, folder: Path | None, width: int, height: int) -> Sequence[Picture]:
    if folder is not None:
        return load_folder(folder, width, height)
    pictures = load_pictures(split, width, height)
    order = np.random.default_rng(zlib.crc32(split.encode())).permutation(len(pictures))
    return [pictures[i] for i in order]


@dataclass(frozen=True)
class FramePair:
    """Frame pair number ``index`` of a cell: what the display shows, and what the camera stores.

    Everything is made when it is first asked for, and once. The draw depends on seed, split, cell
    and index alone, so frame pairs can be made in any order, by any number of processes. Number i
    shows picture i modulo the number of pictures.

    >>> from link.layout import make_layout
    >>> pair = FramePair(Source(make_layout()), Cell("canon-lg", view_deg=45.0, kappa=3), index=0)
    >>> pair.captured.original.shape
    (576, 768, 3)
    >>> pair.rectified.original.shape
    (384, 512, 3)

    Properties raise an `InputError` where the camera-display pair or the folder of pictures is
    unknown, or kappa or the view out of range.
    """

    source: Source
    """Source of picture, message and channel draw."""
    cell: Cell
    """Pair, view and kappa."""
    index: int
    """Number of the frame pair in its cell, from 0."""
    equalised: bool = False
    """Whether the equalised picture is shown without ratex patches, as the method hidden_ratex
    wants it; pose, exposure and motion are those of the same index with patches."""

    @property
    def layout(self) -> Layout:
        """The source's layout, without ratex patches where its picture is ``equalised``."""
        return replace(self.source.layout, ratex=()) if self.equalised else self.source.layout

    @cached_property
    def picture(self) -> Picture:
        """The picture that carries the message."""
        pictures = shuffled_pictures(self.source)
        return pictures[self.index % len(pictures)]

    @cached_property
    def displayed(self) -> Displayed:
        """Both frames as the display shows them."""
        picture, layout = self.picture.rgb, self.layout
        bits = self._generators()[0].integers(0, 2, layout.n_bits)
        return embed(
            equalise(picture) if self.equalised else picture,
            bits,
            layout,
            self.cell.kappa,
            steps=block_steps(picture, layout) if self.source.even else None,
        )

    @cached_property
    def captured(self) -> Captured:
        """Both frames as the camera stores them, with the grid's corners and the true bits."""
        source, cell = self.source, self.cell
        pair = source.pair(cell.pair)
        captured = capture(self.displayed, pair, cell.view_deg, self._generators()[1])
        meta = {
            "picture": self.picture.name,
            "seed": source.seed,
            "simulated": True,
            "split": source.split if source.pictures is None else "own",
            "equalised": self.equalised,
            **({"without": list(source.without)} if source.without else {}),
            **({"parameters": dict(source.parameters)} if source.parameters else {}),
        }
        return replace(captured, meta={**captured.meta, **meta})

    @cached_property
    def rectified(self) -> Observation:
        """Both captured frames resampled to the layout's frame, as decoders take them."""
        return self.captured.rectified()

    def _generators(self) -> tuple[np.random.Generator, np.random.Generator]:
        """Return new generators of the message and of the channel."""
        cell = self.cell
        name = f"{self.source.split}/{cell.pair}/{cell.view_deg:g}/{cell.kappa}/{self.index}"
        seed = np.random.SeedSequence([self.source.seed, zlib.crc32(name.encode())])
        message, channel = (np.random.default_rng(child) for child in seed.spawn(2))
        return message, channel
