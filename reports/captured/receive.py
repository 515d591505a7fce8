"""Films as a receiver sees them, cut into observations: for own films and simulated ones alike.

The receiver finds, follows and times the display. Where the film decoder reads the layout, its
windows of frames are kept, and elsewhere the frame pairs that were put together. So they hold what
the receiver found of corners and clock, with its errors.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from link.captures import KnownWindow
from link.frames import Captured, SoftBits
from link.layout import Layout
from link.observation import Observation
from link.types import Array, Image
from models import FILM_GRAPH, make_decoder, shipped_graphs
from models.film.window import reads_films
from models.pairwise import compose_pair, trust_of_purity
from receiver.decoders import PairDecoder, WindowDecoder
from receiver.diagnosis import explain_silence
from receiver.reading.reader import DecodedPair
from receiver.receiver import Receiver

STRETCH = 8
"""Number of successive frame pairs whose place in the loop is found together, of a layout that is
read by frame pairs: one of 59 bits is too short to tell."""
LOOKS_S = 0.1
"""Seconds of film from one look at the display's place to the next that is kept for the report."""


class LearnedPairs:
    """Reads frame pairs of a layout for which no graph ships, by the checkpoint that ships.

    Args:
        layout: layout with patches or pilots.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._decoder = make_decoder("learned")

    def prepare(self) -> None:
        """Do nothing: it is ready."""

    def decode(self, original: Image, embedded: Image, /) -> SoftBits:
        """Score the message bits of two rectified frames, an `Image` each."""
        return self._decoder.decode(Observation.still(original, embedded, self.layout))


@lru_cache(maxsize=4)
def open_readers(layout: Layout) -> tuple[PairDecoder, WindowDecoder | None]:
    """Open the decoders by which films of a layout are followed, once in each process."""
    graph = shipped_graphs().get(layout)
    pairs = Decoder(graph, 1, OWN_TIME_LIMIT_S) if graph else LearnedPairs(layout)
    return pairs, FilmGraph(FILM_GRAPH, 1) if reads_films(layout) else None


@dataclass(frozen=True)
class Cut:
    """A part that was cut from a film, and its scores: a window, or successive frame pairs."""

    begin_s: float
    """Time at which it begins, seconds of the film."""
    end_s: float
    """Time at which it ends, seconds of the film."""
    layout: Layout
    """Layout of the display."""
    scores: Array
    """(P, n_bits) log-likelihood ratios of its frame pairs, 0 where a bit was not read."""
    window: Observation | None
    """T frames of P frame pairs; None for frame pairs that were put together."""
    pairs: tuple[DecodedPair, ...] = ()
    """The P frame pairs that were put together; none for a window."""

    def known(self, bits: NDArray[np.integer], *, ends: bool) -> list[KnownWindow | Captured]:
        """Give the observations, with the bits that they show.

        Args:
            bits: (P, n_bits) what was sent.
            ends: whether the frame pairs at both ends of a window count, of which a part is seen.
        """
        if self.window is not None:
            bits = bits.copy()
            if not ends and len(bits) > 3:
                bits[[0, -1]] = -1
            meta: dict[str, object] = {"time_s": round(self.begin_s, 3)}
            meta["end_s"] = round(self.end_s, 3)
            return [KnownWindow(self.window, bits, None, meta)]
        return [_still(self.layout, pair, own) for pair, own in zip(self.pairs, bits, strict=True)]


def _still(layout: Layout, pair: DecodedPair, bits: NDArray[np.integer]) -> Captured:
    """Make a capture of a frame pair; bits of blocks that its frames mix or miss are unknown."""
    seen = trust_of_purity(pair.shown.purity) > 0
    whole = layout.corners
    meta: dict[str, object] = {"time_s": round(pair.time, 3)}
    return Captured(*pair.shown.images, layout, whole, whole, np.where(seen, bits, -1), meta=meta)


def pair_of_window(window: KnownWindow, number: int) -> Captured:
    """Put a frame pair of a window together from its frames, as decoders of frame pairs get it.

    Args:
        window: the window.
        number: place of the frame pair among those of the window.
    """
    original, embedded, _ = compose_pair(window.observation, number)
    layout, bits = window.layout, np.asarray(window.bits[number], np.intp)
    whole = layout.corners
    return Captured(original, embedded, layout, whole, whole, bits, window.kappa, meta=window.meta)


@dataclass
class Reception:
    """Parts of a film, and measurements of the receiver on it."""

    cuts: list[Cut] = field(default_factory=list)
    """Windows, or stretches of frame pairs, in order."""
    seen: dict[str, object] = field(default_factory=dict)
    """Frames, display, clock and exposure, as JSON has them, for the report."""


class _Keeper:
    """Decodes windows by the film decoder, and keeps them.

    Args:
        decoder: the film decoder.
        apart: whether windows that share a frame with the last one kept are left out.
    """

    def __init__(self, decoder: WindowDecoder, apart: bool) -> None:
        self._decoder, self._apart = decoder, apart
        self.cuts: list[Cut] = []

    def prepare(self) -> None:
        self._decoder.prepare()

    def decode(self, observation: Observation) -> SoftBits:
        soft = self._decoder.decode(observation)
        begin, end = observation.times[0], observation.times[-1]
        if not (self._apart and self.cuts and begin <= self.cuts[-1].end_s):
            scores = soft.scores.reshape(observation.mixture.count, -1)
            self.cuts.append(Cut(begin, end, observation.layout, scores, observation))
        return soft


def receive_film(
    frames: Iterable[tuple[Image, float]], fps: float, layout: Layout, *, apart: bool
) -> Reception:
    """Receive a film, and cut it.

    Args:
        frames: frames of the film, an `Image` and its time in seconds each.
        fps: nominal number of frames a second.
        layout: layout of the display that is looked for.
        apart: whether windows are left out that share frames with others.

    Returns:
        what was seen; no cuts where the display was not found.
    """
    pair_decoder, film = open_readers(layout)
    keeper = _Keeper(film, apart) if film is not None else None
    receiver = Receiver(pair_decoder, fps, keeper)
    pairs: list[DecodedPair] = []
    places: list[dict[str, object]] = []
    size = 0, 0
    for image, time in frames:
        size = image.shape[1], image.shape[0]
        step = receiver.push(image, time)
        pairs += step.pairs
        if step.tracked and (not places or time - float(str(places[-1]["time_s"])) >= LOOKS_S):
            corners = step.tracked.corners.round(1).tolist()
            places.append({"time_s": round(time, 3), "corners": corners})
    pairs += receiver.finish().pairs
    watched = receiver.observations
    seen: dict[str, object] = {
        "fps": round(fps, 3),
        "size": list(size),
        "frames": watched.frames,
        "found": watched.found,
        "state_hz": watched.state_hz and round(watched.state_hz, 3),
        "exposed": round(watched.exposed, 3),
        "level": watched.level and round(watched.level, 1),
        "clipped": round(watched.clipped, 4),
        "cut": watched.cut,
        "places": places,
        "silence": explain_silence(watched),
    }
    return Reception(keeper.cuts if keeper else stretches(pairs, layout, watched.state_hz), seen)


def stretches(pairs: list[DecodedPair], layout: Layout, state_hz: float | None) -> list[Cut]:
    """Group frame pairs of successive numbers, `STRETCH` to nearly twice as many in a group.

    A frame pair is decoded when it is over, or later where the clock was found after it. So its
    time here is when the display began to show it, by its number and the soonest one of its row.

    Args:
        pairs: frame pairs in the order in which they were decoded.
        layout: layout of the display.
        state_hz: number of states that the display shows in a second; None where no clock was
            found, and frame pairs keep the time at which they were decoded.
    """
    runs: list[list[DecodedPair]] = []
    for pair in pairs:
        if not runs or pair.number != runs[-1][-1].number + 1:
            runs.append([])
        runs[-1].append(pair)
    cuts = []
    for run in runs:
        if state_hz is not None:
            shown_s = 2 / state_hz
            end_of_0 = min(pair.time - pair.number * shown_s for pair in run)
            run = [replace(p, time=max(0.0, end_of_0 + (p.number - 1) * shown_s)) for p in run]
        count = max(1, len(run) // STRETCH)
        for part in np.array_split(np.arange(len(run)), count):
            mine = tuple(run[at] for at in part)
            scores = np.stack([pair.soft.scores for pair in mine])
            cuts.append(Cut(mine[0].time, mine[-1].time, layout, scores, None, mine))
    return cuts
