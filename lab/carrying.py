"""Which share of a frame pair's bits a camera learns over each gray level.

Each film shows random bits over a picture of patches of known gray levels, in a random order, which
covers 40 % of a simulated hand-held video. A receiver reads it, frame pairs or windows of film as
always. What its scores tell of the bits over a level is their mutual information with the sent
ones, for each sent bit: scores of like confidence count by how often they are right, and blocks
that were erased tell nothing. `sender/carrying.py` has the table.
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import VideoSettings, film
from data_gen.pairs import get_pair, pair_names
from export.film_graph import FilmGraph
from export.runtime import Decoder
from lab.films.rates import nearest_frame
from lab.study import Results, Study, StudyFlags, Workshop
from link.errors import each_known, each_once, in_range
from link.layout import Layout
from link.loop import Loop, LoopStates
from link.presets import PRESETS
from models import FILM_GRAPH, shipped_graphs
from receiver.receiver import Receiver
from reports.render.tables import Table
from reports.score.reliability import scored_information
from sender.carrying import CARRIED

LEVELS = (0, 8, 16, 24, 32, 48, 80, 160)
"""Gray levels of the patches."""
PATCHES = 6, 8
"""Number of rows and columns of patches; each level has equally many."""
COVERAGE = 0.4
"""Share of the camera's image that the display covers."""
FRAMES_A_STATE = (1, 2)
"""Numbers of camera frames that are taken of each state, in films of their own."""
SHOWN = 8
"""Number of frame pairs of random bits that are shown in a loop."""


@dataclass(frozen=True)
class CarryingFlags(StudyFlags):
    """Which share of the bits comes through over each gray level (simulated)."""

    presets: tuple[str, ...] = tuple(CARRIED)
    """Presets with pilots, keys of PRESETS in link/presets.py."""
    pairs: tuple[str, ...] = ("today",)
    """Camera-display pairs."""
    seconds: float = 1.2
    """Length of each film, seconds."""


@dataclass(frozen=True)
class PatchFilm:
    """One film of a picture of patches."""

    preset: str
    """What the display shows."""
    pair: str
    """Camera-display pair."""
    frames_a_state: int
    """Number of camera frames for each state."""
    seconds: float
    """Length, seconds."""
    seed: int
    """Seed of all draws."""


@dataclass(frozen=True)
class Told:
    """What the scores of one film tell."""

    preset: str
    """What the display showed."""
    pairs: int
    """Number of frame pairs that were decoded; 0 where the display was not found."""
    shares: list[float]
    """By the levels, the information in a bit, 0 to 1; empty where nothing was decoded."""


@dataclass(frozen=True)
class CarryingContent:
    """What was measured."""

    films: list[Told]
    """Every film."""


def patch_picture(layout: Layout, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Draw the gray level of each block, (rows, cols), in patches of many blocks."""
    order = rng.permutation(np.resize(LEVELS, PATCHES[0] * PATCHES[1]))
    size = layout.rows // PATCHES[0], layout.cols // PATCHES[1]
    return np.kron(order.reshape(PATCHES), np.ones(size)).astype(np.uint8)


def read_patches(shot: PatchFilm) -> Told:
    """Film patches and read them."""
    preset = PRESETS[shot.preset]
    layout, rng = preset.layout, np.random.default_rng(zlib.crc32(repr(shot).encode()))
    levels = patch_picture(layout, rng)
    block = layout.height // layout.rows, layout.width // layout.cols, 3
    picture = np.kron(levels[..., None], np.ones(block, np.uint8))
    bits = rng.integers(0, 2, (SHOWN, layout.n_bits), np.uint8)
    loop = Loop(layout, preset.kappa, bits, lambda: iter([picture]), even=preset.even)
    fps = shot.frames_a_state * preset.state_hz
    scene = SceneSettings(coverage=COVERAGE, free=0.03)
    settings = VideoSettings(scene, fps, preset.state_hz, seconds=shot.seconds)
    pair, shown = get_pair(shot.pair), loop.shown_layout
    receiver = Receiver(Decoder(shipped_graphs()[layout], 1), fps, FilmGraph(FILM_GRAPH, 1))
    scores = []
    for frame in film(LoopStates(loop), shown, pair, 0.0, settings, rng):
        scores += [each.soft.scores for each in receiver.push(frame.rgb, frame.time_s).pairs]
    scores += [each.soft.scores for each in receiver.finish().pairs]
    shares = []
    if scores:
        told, sent = np.array(scores), np.array([nearest_frame(each, bits) for each in scores])
        for level in LEVELS:
            here = levels[layout.message_mask] == level
            shares.append(scored_information(told[:, here], sent[:, here]))
    return Told(shot.preset, len(scores), shares)


def measure_carrying(flags: CarryingFlags, workshop: Workshop) -> CarryingContent:
    """Film and read every preset by every pair, with one and two frames a state."""
    shots = {
        f"{preset} {pair} {frames}": PatchFilm(preset, pair, frames, flags.seconds, flags.seed)
        for preset, pair, frames in product(flags.presets, pair_names(flags.pairs), FRAMES_A_STATE)
    }
    inputs = [*shipped_graphs().values(), FILM_GRAPH]
    return CarryingContent(list(workshop.each(read_patches, shots, inputs).values()))


def carrying_blocks(results: Mapping[str, Results[CarryingContent]]) -> dict[str, str]:
    """Tabulate the mean of the films by level and preset, with its interval."""
    (stored,) = results.values()
    films = stored.content.films
    rows, heads = [[str(level)] for level in LEVELS], ["gray level"]
    for preset in dict.fromkeys(told.preset for told in films):
        of_preset = [told for told in films if told.preset == preset]
        read = [told.shares for told in of_preset if told.shares]
        pairs = sum(told.pairs for told in of_preset)
        heads.append(f"{preset}: {pairs} frame pairs of {len(read)} in {len(of_preset)} films")
        for number, row in enumerate(rows):
            row.append(mean_and_half(np.array([shares[number] for shares in read])))
    title = (
        "Share of a bit that the scores of a frame pair tell (simulated), mean of the films in "
        "which the display was found and 95 % interval of the mean by Student's t, as if films "
        "were independent."
    )
    return {"carrying": Table(heads, rows, title).markdown()}


def mean_and_half(values: NDArray[np.float64]) -> str:
    """Write the mean of independent values, and half its 95 % interval, if there are two.

    >>> mean_and_half(np.array([0.5, 0.7, 0.6]))
    '0.60 ± 0.25'
    """
    if len(values) < 2:
        return "–"
    half = values.std(ddof=1) / np.sqrt(len(values)) * student.ppf(0.975, len(values) - 1)
    return f"{values.mean():.2f} ± {half:.2f}"


def check_carrying(flags: CarryingFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    each_known(CARRIED, presets=flags.presets)
    each_once(pairs=pair_names(flags.pairs))
    in_range(flags, seconds=(0.1, 60, " seconds"))


STUDY = Study(
    name="carrying",
    flags=CarryingFlags,
    content=CarryingContent,
    measure=measure_carrying,
    blocks=carrying_blocks,
    check=check_carrying,
)
"""The study that `python -m lab carrying` runs."""
