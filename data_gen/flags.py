"""Flags that several commands share: what a display shows, and who films it from where.

A command's configuration inherits them, so that a flag is declared and explained in one place. A
new choice about the layout is a field of `LayoutFlags`, one about the channel a field of
`SourceFlags`, and a word in their methods.
"""

from dataclasses import dataclass
from pathlib import Path

from data_gen.channel.optics import check_view
from data_gen.effects import parse_settings
from data_gen.frame_pair import Cell, Source
from link.embed import check_kappa
from link.errors import at_least
from link.layout import Layout, make_layout
from link.pilot_code import PLAIN, PilotCode


@dataclass(frozen=True, kw_only=True)
class LayoutFlags:
    """Layout of a command: what the display's pictures carry where, and how bits change them.

    >>> LayoutFlags(rows=24, cols=32, modulation="antipodal", pilots="auto").layout().pilots
    38
    """

    rows: int = 8
    """Rows of message blocks."""
    cols: int = 8
    """Columns of message blocks."""
    width: int = 512
    """Width of the displayed picture, pixels."""
    height: int = 384
    """Height of the displayed picture, pixels."""
    ratex: int | None = None
    """Number of ratex patches: 0, 1, 2, 3 or 5; by default 5, or 0 beside pilots."""
    modulation: str = "on_off"
    """How bits change blocks: "on_off" brightens a 1 and leaves a 0 as it is, as in the paper;
    "antipodal" brightens a 1 and darkens a 0."""
    pilots: str = "0"
    """Share of the blocks that carry known bits in place of ratex patches, or "auto"."""
    code: bool = False
    """Whether frame pairs show their states in the order of the usual code; beside pilots."""

    def layout(self) -> Layout:
        """Return the layout of the displayed pictures.

        Raises:
            InputError: the grid does not fit the picture, or has no room for the ratex patches.
        """
        return make_layout(
            self.rows,
            self.cols,
            self.width,
            self.height,
            self.ratex,
            self.modulation,
            self.pilots,
            PilotCode() if self.code else PLAIN,
        )


@dataclass(frozen=True, kw_only=True)
class SourceFlags(LayoutFlags):
    """Pictures, layout and channel of a command that simulates.

    >>> SourceFlags(rows=4, cols=4, ratex=2, set=("drift=0.1",)).source().parameters
    (('drift', 0.1),)
    """

    seed: int = 0
    """Seed of every random draw."""
    pictures: Path | None = None
    """Folder with your own pictures, in place of the built-in ones, or a video. Frame pairs show
    pictures of it that are a second apart; films play it at its own rate."""
    without: tuple[str, ...] = ()
    """Effects of the channel to switch off, such as drift or moire (data_gen/effects.json)."""
    even: bool = False
    """Whether blocks change more where the picture hides more; kappa is then the least change."""
    set: tuple[str, ...] = ()
    """Parameters of the channel to set, such as drift=0.1 jpeg_quality=70
    (data_gen/parameters.py)."""

    def source(self, split: str = "test") -> Source:
        """Return where pictures, messages and channel draws come from.

        Args:
            split: split whose pictures and channel draws are used, "train" or "test".

        Raises:
            InputError: the layout is impossible, the seed negative, or a setting is not written as
                name=value. Names and values of the channel are checked by `Source.pair`.
        """
        at_least(0, seed=self.seed)
        return Source(
            layout=self.layout(),
            split=split,
            seed=self.seed,
            pictures=self.pictures,
            without=self.without,
            parameters=parse_settings(self.set),
            even=self.even,
        )


@dataclass(frozen=True, kw_only=True)
class CellFlags(SourceFlags):
    """What `SourceFlags` holds, and one camera that films one display from one side."""

    pair: str = "canon-lg"
    """Camera and display: canon|nikon|sony - imac|lg|samsung."""
    view: float = 0.0
    """Angle of observation, degrees from the display's normal."""
    kappa: int = 5
    """Gray levels of [0, 255] added where a bit is 1."""
    split: str = "test"
    """Split whose pictures and channel draws are used: "train" or "test"."""

    def cell(self) -> Cell:
        """Return pair, view and kappa.

        Raises:
            ParameterError: the view or kappa is out of its range.
        """
        return Cell(self.pair, check_view(self.view, "view"), check_kappa(self.kappa))
