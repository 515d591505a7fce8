"""How much a hidden message changes the picture, for somebody who looks at it; about two minutes.

Ten photographs and drawings are shown at full HD by each preset. What is compared with the picture
is its mean over the time of one loop.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from data_gen.pictures.library import load_pictures
from export.send.likeness import Likeness, colour_difference
from lab.study import Study, StudyFlags, Tables, Workshop, blocks_of_tables
from link.code.framing import encode
from link.loop import Loop
from link.presets import PRESETS
from reports.render.tables import Table

PICTURES = {
    "test": (
        "photo/astronaut/0", "photo/coffee/0", "photo/china/0", "photo/rocket/0",
        "photo/hubble_deep_field/0", "slide/4", "slide/5", "map/3", "poster/3",
    ),
    "train": ("photo/flower/0",),
}  # fmt: skip
"""Names of the pictures by their split. Half are dark or white paper: a night sky (hubble), dark
and white slides, a dark map, a mostly black poster."""
SIZE = (1920, 1080)
"""Width and height of the display, in pixels."""
MESSAGE = b"See oorc.example/menu for the menu of today, 24 November"
"""Message that is hidden, a sentence with an address."""


@dataclass(frozen=True)
class FidelityFlags(StudyFlags):
    """Compare the mean over time of what is shown with the picture."""


@dataclass(frozen=True)
class Shown:
    """A picture that a preset shows."""

    preset: str
    """Name of the preset."""
    picture: str
    """Name of the picture in its split."""
    split: str
    """Split of the picture, "train" or "test"."""


def changed_colours(shown: Shown) -> dict[str, float]:
    """Hide a message in a picture, and compare the mean over time with the picture.

    Returns:
        mean and 95th percentile of CIEDE2000 over the pixels, and the largest difference, in gray
        levels, of a channel.
    """
    preset = PRESETS[shown.preset]
    pictures = {each.name: each.rgb for each in load_pictures(shown.split, *SIZE)}
    picture = pictures[shown.picture]
    bits = encode(MESSAGE, preset.layout.n_bits)
    loop = Loop(
        preset.layout,
        preset.kappa,
        bits,
        lambda: iter([picture]),
        display_size=SIZE,
        even=preset.even,
    )
    mean = Likeness.of(loop).time_mean
    by_mean, high = colour_difference(mean, picture)
    return {"mean": by_mean, "high": high, "levels": float(np.abs(mean - picture).max())}


def measure_fidelity(flags: FidelityFlags, workshop: Workshop) -> Tables:
    """Compare every picture that every preset shows."""
    items = {
        f"{preset} {picture}": Shown(preset, picture, split)
        for preset in PRESETS
        for split, names in PICTURES.items()
        for picture in names
    }
    found = workshop.each(changed_colours, items)
    table = pd.DataFrame([asdict(item) | found[name] for name, item in items.items()])
    heads = [
        "preset", "pictures", "mean", "of the pictures, least – largest", "below it 95 % of pixels",
        "of the pictures, least – largest", "largest change of a channel, levels",
    ]  # fmt: skip
    rows = []
    for name, group in table.groupby("preset", sort=False):
        cells = []
        for column in ("mean", "high"):
            values = group[column]
            cells += [f"{values.mean():.2f}", f"{values.min():.2f} – {values.max():.2f}"]
        rows.append([f"`{name}`", str(len(group)), *cells, f"{group['levels'].max():.1f}"])
    return Tables({"fidelity": [Table(heads, rows)]})


STUDY = Study(
    name="fidelity",
    flags=FidelityFlags,
    content=Tables,
    measure=measure_fidelity,
    blocks=blocks_of_tables,
    page=Path("docs/visibility.md"),
)
"""The study that `python -m lab fidelity` runs."""
