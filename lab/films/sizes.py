"""Whether a picture is read at any size and of any proportions, and what even strength brings.

Each film shows a picture that fills a display of the given size. The display's pixels are filmed as
they are; the layout's own size is only that at which the receiver works. Films of one pair, view
and number have the same seed at all sizes, but other draws, because a room is drawn around the
display's shape.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from data_gen.pairs import PAIRS
from lab.films.delivery import deliveries
from lab.films.trial import MAX_LOOPS, Delivery, FilmSettings, check_filmed, check_settings
from lab.study import Results, Study, StudyFlags, Workshop
from link.code.framing import frames_needed
from link.errors import at_least, choose, each_once
from link.presets import PRESETS
from reports.render.tables import Table, percent, share_interval
from reports.score.intervals import wilson
from reports.score.reliability import binned_information, merge_bins


@dataclass(frozen=True)
class SizesFlags(StudyFlags):
    """Messages from films of displays of other sizes and proportions (simulated)."""

    presets: tuple[str, ...] = ("hidden", "robust", "fast")
    """Names of presets; each is filmed with two camera frames a state."""
    sizes: tuple[tuple[int, int], ...] = ((512, 384), (1920, 1080), (1080, 1920))
    """Widths and heights of displays, pixels, which the picture fills."""
    even: tuple[bool | None, ...] = (None,)
    """Whether blocks change more where the picture hides more; None for as the preset says."""
    pairs: tuple[str, ...] = tuple(PAIRS)
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    runs: int = 1
    """Number of runs for each preset, size, pair and view."""
    n_bytes: int = 100
    """Length of the message, bytes."""
    seconds: float = 5.0
    """Seconds of film after which a run is given up."""

    def film(self, name: str, size: tuple[int, int], even: bool | None) -> FilmSettings:
        """Return how a preset is shown and filmed."""
        preset = choose(PRESETS, name, "name in --presets")
        frames = frames_needed(self.n_bytes, preset.layout.n_bits, "n_bytes")
        return FilmSettings(
            kappa=preset.kappa,
            preset=name,
            state_hz=preset.state_hz,
            fps=2 * preset.state_hz,
            n_bytes=self.n_bytes,
            even=even,
            display_size=size,
            loops=min(MAX_LOOPS, self.seconds * preset.state_hz / 2 / frames),
        )


@dataclass(frozen=True)
class SizeSeries:
    """Films of one preset on a display of one size, from one angle."""

    preset: str
    """Name of the preset."""
    size: tuple[int, int]
    """Width and height of the display, pixels."""
    even: bool | None
    """Whether blocks changed more where the picture hides more; None for as the preset says."""
    view: float
    """Angle between the camera and the normal of the display, degrees."""
    runs: list[Delivery]
    """Every run."""


@dataclass(frozen=True)
class SizesContent:
    """What was measured."""

    series: list[SizeSeries]
    """One entry for each preset, size, strength and view."""


def sizes_blocks(results: Mapping[str, Results[SizesContent]]) -> dict[str, str]:
    """Tabulate all series of all stored results."""
    heads = (
        "preset", "display", "strength", "view", "read", "95 % interval", "wrong messages",
        "seconds, median", "longest", "bits wrong %, median film",
        "information, bits a block and pair",
    )  # fmt: skip
    words = {None: "preset's", True: "even", False: "alike"}
    rows = []
    for series in (each for stored in results.values() for each in stored.content.series):
        runs = pd.DataFrame([vars(run) for run in series.runs])
        came, decided = runs[runs["delivered"]], int(runs["bits"].sum())
        read = runs[runs["bits"] > 0]
        bins = merge_bins([run.bins for run in series.runs])
        rows.append(
            [
                series.preset,
                "{} × {}".format(*series.size),
                words[series.even],
                f"{series.view:g}°",
                f"{len(came)} of {len(runs)}",
                f"{share_interval(*wilson(len(came), len(runs)), 0)} %",
                str(int(runs["wrong"].sum())),
                f"{came['seconds'].median():.2f}" if len(came) else "–",
                f"{came['seconds'].max():.2f}" if len(came) else "–",
                percent((read["bits_wrong"] / read["bits"]).median()) if len(read) else "–",
                f"{binned_information(bins, decided):.3f}",
            ]
        )
    title = (
        "Simulated hand-held video at 1280 × 720 of displays that a picture fills; picture, room, "
        "pose, clocks (±1 %) and start in the loop drawn anew in each run (`python -m lab sizes`):"
    )
    return {"sizes": Table(heads, rows, title).markdown()}


def check_sizes(flags: SizesFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, runs=flags.runs)
    each_once(presets=flags.presets, sizes=flags.sizes)
    check_filmed(flags.pairs, flags.views)
    for name in flags.presets:
        for size in flags.sizes:
            check_settings(flags.film(name, size, None))


def measure_sizes(flags: SizesFlags, workshop: Workshop) -> SizesContent:
    """Film and receive every preset at every size from every angle."""
    found = []
    for name in flags.presets:
        for size in flags.sizes:
            for even in flags.even:
                film = flags.film(name, size, even)
                for view in flags.views:
                    runs = deliveries(film, flags.pairs, (view,), flags.runs, flags.seed, workshop)
                    found.append(SizeSeries(name, size, even, view, runs))
    return SizesContent(found)


def label_of_sizes(flags: SizesFlags) -> str:
    """Name results after their presets and sizes."""
    sizes = [f"{width}x{height}" for width, height in flags.sizes]
    words = [*flags.presets, *sizes, *(["strength"] if len(flags.even) > 1 else [])]
    return "_".join(words)


STUDY = Study(
    name="sizes",
    flags=SizesFlags,
    content=SizesContent,
    measure=measure_sizes,
    blocks=sizes_blocks,
    page=Path("docs/receiver.md"),
    check=check_sizes,
    label=label_of_sizes,
)
"""The study that `python -m lab sizes` runs."""
