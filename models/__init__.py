"""Decoders by name, with a card for each. Importing this package imports no torch.

The module of a decoder is imported when the decoder is first built.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, Protocol

from link.errors import InputError, choose
from link.frames import SoftBits
from link.layout import Layout
from link.observation import Observation
from link.presets import PRESETS

PRETRAINED = Path(__file__).parent / "pretrained" / "ratex"
"""Folder of the shipped checkpoint of ``learned`` for layouts with ratex patches; it was trained on
all nine camera-display pairs."""
PRETRAINED_PILOTS = PRETRAINED.with_name("pilots")
"""Folder of the shipped checkpoint of ``learned`` for layouts with pilots, of any grid."""
FILM_GRAPH = PRETRAINED.with_name("film") / "film.onnx"
"""The shipped film decoder (`models.film.decoder`), which serves all layouts that it can read."""
REGION_GRAPH = PRETRAINED.with_name("region") / "region.onnx"
"""The shipped map of where displays toggle (`models.region.region`), by which they are found."""


def shipped_checkpoint(layout: Layout) -> Path:
    """Choose the shipped checkpoint of ``learned`` that reads a layout."""
    return PRETRAINED_PILOTS if layout.pilots else PRETRAINED


@dataclass(frozen=True)
class Card:
    """All that is known of a method before it decodes anything."""

    target: str
    """Module and class of the method, as "module:class"; imported when it is first built."""
    colour: str
    """Colour in every chart, as "#rrggbb"; people with the common kinds of colour blindness can
    tell it from the others."""
    marker: str = "o"
    """Marker in every chart, as matplotlib names it."""
    frames: Literal["pair", "window", "both"] = "pair"
    """What it takes: still frame pairs alone, windows of film alone, or both. Films reach those
    that take frame pairs alone as pairs that are put together from their frames
    (`models.pairwise`)."""
    equalised: bool = False
    """Whether a simulated display shows it equalised pictures without patches, where the layout has
    ratex patches."""
    llr: bool = False
    """Whether its scores are natural log-likelihood ratios of the bits."""
    checkpoint: Callable[[Layout], Path] | None = None
    """Chooses, by the layout, the folder of the checkpoint that it loads where no other is named;
    None for untrained ones."""


DECODERS = {
    "naive": Card("models.paper.naive:Naive", "#8a8f98", "o"),
    "two_step": Card("models.paper.two_step:TwoStep", "#3a9fd6", "s"),
    "oorc": Card("models.paper.oorc:OORC", "#1166b0", "D", frames="both"),
    "hidden_ratex": Card("models.paper.hidden_ratex:HiddenRatex", "#b8589a", "^", equalised=True),
    "blind": Card("models.blind.blind:Blind", "#0a9468", "v", equalised=True, llr=True),
    "phi": Card(
        "models.phi.methods:Phi",
        "#7b61c9",
        "o",
        frames="both",
    ),
    "learned": Card(
        "models.phi.methods:Learned",
        "#d4520a",
        "s",
        llr=True,
        checkpoint=shipped_checkpoint,
    ),
    "linear": Card("models.film.methods:LinearFilm", "#6b8e23", "P", frames="window", llr=True),
    "film": Card(
        "models.film.methods:Film",
        "#b8336a",
        "X",
        frames="window",
        llr=True,
        checkpoint=lambda layout: FILM_GRAPH.parent,  # it serves all layouts
    ),
}
"""Cards of all decoders, by the name that ``evaluate.py --methods`` takes."""
OF_PAIRS = tuple(name for name, card in DECODERS.items() if card.frames != "window")
"""Names of the decoders that read still frame pairs."""


def find_card(name: str) -> Card:
    """Find the card of a decoder by its name, or that of a class anywhere, by its place.

    A class outside of `DECODERS` is named by "package.module:Class", which Python must be able to
    import. It may have a `Card` of its own as its attribute ``card``.

    Raises:
        InputError: the name is unknown, or nothing can be imported there.

    >>> find_card("models.paper.naive:Naive").llr
    False
    """
    if ":" not in name:
        return choose(DECODERS, name, "method")
    module, _, attribute = name.partition(":")
    try:
        found = getattr(import_module(module), attribute)
    except (ImportError, AttributeError, SyntaxError, TypeError, ValueError) as error:
        raise InputError(
            f"method {name!r} cannot be imported: {error}; name it as package.module:Class, and "
            "its folder in PYTHONPATH"
        ) from None
    if not hasattr(found, "decode"):
        raise InputError(f"method {name!r}: has no decode; docs/extend.md says what a decoder is")
    card = getattr(found, "card", None)
    return card if isinstance(card, Card) else Card(name, "#55606e", marker="P")


def shipped_graphs() -> dict[Layout, Path]:
    """Name the exported decoder that ships with the project for the layout of each preset.

    Returns:
        .onnx files by layout, from the coarsest grid on.

    >>> [path.name for path in shipped_graphs().values()]
    ['decoder.onnx', '24x32.onnx', '48x64.onnx', '96x128.onnx']
    """
    layouts = {preset.layout for preset in PRESETS.values()}
    return {
        layout: PRETRAINED_PILOTS / f"{layout.rows}x{layout.cols}.onnx"
        if layout.pilots
        else PRETRAINED / "decoder.onnx"
        for layout in sorted(layouts, key=lambda layout: layout.rows * layout.cols)
    }


def find_graph(name: str) -> Path:
    """Find an exported decoder by its path, or by the name of the preset for which one ships.

    >>> find_graph("hidden").name, find_graph("runs/mine.onnx").name
    ('48x64.onnx', 'mine.onnx')
    """
    return shipped_graphs()[PRESETS[name].layout] if name in PRESETS else Path(name)


class BlockDecoder(Protocol):
    """The one interface of all decoders: calibrate on an observation alone and score its blocks."""

    def decode(self, observation: Observation) -> SoftBits:
        """Score the message blocks of all frame pairs of an observation; positive means bit 1.

        Raises:
            UnsuitedError: the observation lacks what the decoder needs, such as ratex patches, or
                is a film and the decoder reads frame pairs.
        """
        ...


def make_decoder(name: str, **options: Any) -> BlockDecoder:
    """Build the decoder called ``name``.

    Args:
        name: a key of `DECODERS`, or "package.module:Class".
        **options: fields of that decoder's dataclass, such as ``C`` or ``checkpoint``.

    Raises:
        InputError: the name is unknown; the message lists the valid ones.

    >>> make_decoder("oorc", C=10.0)
    OORC(degree=4, C=10.0)
    """
    module, _, attribute = find_card(name).target.partition(":")
    decoder: BlockDecoder = getattr(import_module(module), attribute)(**options)
    return decoder
