"""How often a clock is found where there is none, and from which strength on it is found.

The receiver believes a clock whose evidence exceeds a bound, set by
`export.receive.timing.synchronise.needed_evidence`. Here it looks for a clock in windows of toggles
without one: noise, noise that lasts over several frames, toggles of a real clock in shuffled order,
and simulated films of displays, with patches and with pilots, that stand still. Then it looks for
clocks in noise, to say from which strength on they are found.
"""

from collections.abc import Iterable, Iterator
from dataclasses import astuple, dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from data_gen.film.codec import CodecSettings, through_codec
from data_gen.film.frame import VideoFrame
from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from export.pilots.clock import DisplayClock, embedded_share
from export.receive.timing.fit import ClockFit, ToggleWindow
from export.receive.timing.synchronise import needed_evidence
from export.receive.timing.toggles import PatchToggles, Toggles, make_toggles
from export.receive.tracking.follow import Follower
from export.receive.tracking.patches import Tracker
from lab.study import Study, StudyFlags, Tables, Workshop, blocks_of_tables
from link.embed import embed
from link.errors import ParameterError, at_least
from link.geometry import frame_corners, transform
from link.layout import Layout, make_layout
from link.presets import PRESETS
from link.types import Array
from reports.engine.backends import one_thread
from reports.render.tables import Table
from reports.score.intervals import wilson

PLACES = PatchToggles(make_layout()).places
"""Centres of the ratex patches of the 8 x 8 layout on the display."""
STILL = {"patches": make_layout(), "pilots": PRESETS["robust"].layout}
"""Layouts of the displays that stand still, by the kind of their windows."""
SECONDS = (1.0, 1.5, 2.0, 3.0, 4.0)
"""Lengths of windows, seconds; the receiver's grow from the first to the last."""
SLOW = 0.65
"""Correlation from frame to frame of noise from a video codec."""
CHUNK = 100
"""Number of windows in which one task looks for a clock."""
STRENGTHS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Toggles between the states, in standard deviations of the noise of a usual place."""


@dataclass(frozen=True)
class ClockFlags(StudyFlags):
    """False locks in windows without a clock, and locks in windows with one (simulated)."""

    windows: int = 4000
    """Number of windows of each kind without a clock."""
    found: int = 200
    """Number of windows of each strength with a clock."""
    fps: float = 30.0
    """Number of frames that the camera takes a second."""
    films: int = 4
    """Number of films of each display that stands still; windows of them are drawn many times."""
    film_seconds: float = 12.0
    """Length of each of these films, seconds."""


@dataclass(frozen=True)
class Window:
    """Toggles of some frames."""

    times: Array
    """(n,) seconds."""
    toggles: Array
    """(n, P) gray levels."""
    seconds: float
    """Length of the window."""
    places: Array
    """(P, 2) places of the display, in [0, 1]."""

    def search(self, fps: float) -> tuple[ClockFit, float]:
        """Look for a clock; return it, and its evidence as a share of what is needed."""
        fit = ToggleWindow(self.times, self.toggles, self.places, fps).search()
        return fit, fit.evidence / needed_evidence(self.seconds, fps)


def noisy_clock(
    rng: np.random.Generator, fps: float, strength: float, correlations: tuple[float, ...]
) -> Window:
    """Draw a window of a random clock in noise whose deviation differs from place to place.

    Args:
        rng: source of all draws.
        fps: frames of the camera in a second.
        strength: toggle between the states, in deviations of the noise of a usual place.
        correlations: correlation of each place's noise from one frame to the next.
    """
    seconds = float(rng.choice(SECONDS))
    times = np.arange(int(seconds * fps) + 1) / fps
    state_hz = rng.uniform(0.2, 0.9) * fps
    across, down = rng.uniform(-0.5, 0.5, 2) / fps
    shutter = rng.uniform(0.2, 0.9) / fps
    clock = DisplayClock(1 / state_hz, rng.uniform(0, 2 / state_hz), across, down, shutter)
    wave = embedded_share(np.array([astuple(clock)]), times, PLACES)[0].T
    lag = np.array(correlations)
    fresh = rng.normal(size=wave.shape)
    noise = fresh.copy()
    for now in range(1, len(times)):
        noise[now] = lag * noise[now - 1] + np.sqrt(1 - lag**2) * fresh[now]
    deviation = np.exp(rng.normal(0, 0.5, len(PLACES)))
    return Window(times, strength * wave + deviation * noise, seconds, PLACES)


def shuffled_clock(rng: np.random.Generator, fps: float) -> Window:
    """Draw a window of a random clock with little noise, and shuffle its frames."""
    window = noisy_clock(rng, fps, float(rng.uniform(2, 12)), (0.0,) * 5)
    return replace(window, toggles=rng.permutation(window.toggles))


@dataclass(frozen=True)
class StillFilm:
    """A film of a display that stands still."""

    times: Array
    """(n,) seconds."""
    values: Array
    """(n, V) what `Toggles.measure` says of each frame."""
    toggles: Toggles
    """What measured them."""

    def window(self, rng: np.random.Generator) -> Window:
        """Draw a window, in which patches or pilots change places and signs at random.

        Without a clock one sign and one place are as good as another, so that one film gives many
        windows.
        """
        seconds = float(rng.choice(SECONDS))
        start = rng.uniform(self.times[0], self.times[-1] - seconds)
        chosen = (self.times >= start) & (self.times <= start + seconds)
        count = self.values.shape[1]
        drawn = (rng.choice([-1.0, 1.0], count) * self.values[chosen])[:, rng.permutation(count)]
        toggles = self.toggles.over_time(drawn)
        return Window(self.times[chosen], toggles, seconds, self.toggles.places)


@dataclass(frozen=True)
class StillSettings:
    """How displays that stand still are filmed."""

    fps: float
    """Number of frames that the camera takes a second."""
    films: int
    """Number of films of each display."""
    seconds: float
    """Length of each film, seconds."""
    seed: int
    """Seed of all draws."""


@dataclass(frozen=True)
class Chunk:
    """Some windows of one kind."""

    kind: str
    """Key of `KINDS`."""
    number: int
    """Number of the chunk among those of its kind."""
    windows: int
    """Number of windows."""
    still: StillSettings
    """Films of which windows of displays that stand still are drawn."""


@cache
def film_still_display(kind: str, number: int, settings: StillSettings) -> StillFilm:
    """Film a display that stands still, and follow it.

    Even films are lossless and odd ones pass through H.264; the hand moves once and then six times
    as much as usual.

    Args:
        kind: key of `STILL`.
        number: number of the film.
        settings: seed, frames a second and length.
    """
    layout = STILL[kind]
    source = Source(layout, "test", settings.seed)
    pictures = shuffled_pictures(source)
    picture = pictures[number % len(pictures)].rgb
    video = VideoSettings(
        scene=SceneSettings(coverage=0.35, pictures=pictures, free=0.03),
        fps=settings.fps,
        seconds=settings.seconds,
        hand=6.0 if number // 2 % 2 else 1.0,
    )
    shown = embed(picture, np.zeros(layout.n_bits, np.intp), layout, 3).original
    rng = np.random.default_rng([settings.seed, number])
    frames = film([shown], layout, source.pair("canon-lg"), 45.0, video, rng)
    codec = CodecSettings("h264" if number % 2 else "none")
    toggles = make_toggles(layout)
    times, values = [], []
    for time, rectified in _followed(through_codec(frames, codec, settings.fps), layout):
        times.append(time)
        values.append(toggles.measure(rectified))
    return StillFilm(np.array(times), np.array(values), toggles)


def _followed(
    frames: Iterable[VideoFrame], layout: Layout
) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Follow the display through a film: times of frames in which it is, and the display in them.

    Pilots that do not toggle cannot be found, so where such a display is in the first frame, and
    in one before which it was lost, is taken from the truth.
    """
    tracker = Tracker(layout) if layout.ratex else None
    follower = Follower(layout)
    display = frame_corners(layout.width, layout.height)
    for frame in frames:
        if tracker is not None:
            tracked = tracker.follow(frame.rgb, frame.time_s)
            rectified = None if tracked is None else tracked.rectified
        else:
            step = follower.step(frame.rgb)
            known = transform(frame.H_captured_from_display, display)
            corners = known if step is None else step[0]
            rectified = follower.rectified(frame.rgb, corners)
            if rectified is not None and step is None:
                follower.begin(frame.rgb, corners, rectified)
            follower.advance(corners)
        if rectified is not None:
            yield frame.time_s, rectified


def draw_window(kind: str, still: StillSettings, rng: np.random.Generator) -> Window:
    """Draw a window without a clock of a kind that `KINDS` names."""
    if kind in STILL:
        return film_still_display(kind, int(rng.integers(still.films)), still).window(rng)
    if kind == "shuffled":
        return shuffled_clock(rng, still.fps)
    slow = {"noise": (0.0,) * 5, "codec": (SLOW, SLOW, 0.0, 0.0, 0.3), "slow": (0.95,) * 5}
    return noisy_clock(rng, still.fps, 0.0, slow[kind])


KINDS = {
    "noise": "noise of each frame's own",
    "codec": "noise that lasts, as a codec's does",
    "slow": "noise that wanders",
    "shuffled": "toggles in shuffled order",
    "patches": "films of a display with patches that stands still",
    "pilots": "films of a display with pilots that stands still",
}
"""Kinds of windows without a clock, and how the table calls them."""


def false_strengths(chunk: Chunk) -> list[float]:
    """Find the evidence, as a share of what is needed, in windows without a clock."""
    one_thread()
    rng = np.random.default_rng([chunk.still.seed, list(KINDS).index(chunk.kind), chunk.number])
    drawn = (draw_window(chunk.kind, chunk.still, rng) for _ in range(chunk.windows))
    return [window.search(chunk.still.fps)[1] for window in drawn]


def found_clocks(noise: "Noise") -> list[tuple[float, bool]]:
    """Look for clocks in noise: the window's seconds, and whether the clock was found."""
    one_thread()
    rng = np.random.default_rng([noise.seed, 99, round(100 * noise.strength)])
    results = []
    for _ in range(noise.windows):
        window = noisy_clock(rng, noise.fps, noise.strength, (SLOW, SLOW, 0.0, 0.0, 0.3))
        results.append((window.seconds, window.search(noise.fps)[1] >= 1))
    return results


@dataclass(frozen=True)
class Noise:
    """Windows with a clock in noise."""

    strength: float
    """Toggles between the states, in standard deviations of the noise of a usual place."""
    windows: int
    """Number of windows."""
    fps: float
    """Number of frames that the camera takes a second."""
    seed: int
    """Seed of all draws."""


def check_clock(flags: ClockFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, windows=flags.windows, found=flags.found, films=flags.films)
    if not flags.film_seconds > max(SECONDS):
        raise ParameterError("film_seconds", f"need more than {max(SECONDS):g}")


def measure_clock(flags: ClockFlags, workshop: Workshop) -> Tables:
    """Look for clocks in all windows."""
    still = StillSettings(flags.fps, flags.films, flags.film_seconds, flags.seed)
    chunks = {
        f"{kind} {number}": Chunk(kind, number, min(CHUNK, flags.windows - start), still)
        for kind in KINDS
        for number, start in enumerate(range(0, flags.windows, CHUNK))
    }
    found = workshop.each(false_strengths, chunks)
    strengths: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for name, chunk in chunks.items():
        strengths[chunk.kind] += found[name]
    noises = {f"{s:g}": Noise(s, flags.found, flags.fps, flags.seed) for s in STRENGTHS}
    clocks = list(workshop.each(found_clocks, noises).values())
    return Tables({"clock": [false_lock_table(strengths), detection_table(clocks)]})


def false_lock_table(strengths: dict[str, list[float]]) -> Table:
    """Show how many windows without a clock had enough evidence of one."""
    rows = []
    every = [share for shares in strengths.values() for share in shares]
    named = [(KINDS[kind], shares) for kind, shares in strengths.items()]
    for name, shares in [*named, ("all", every)]:
        false = sum(share >= 1 for share in shares)
        rows.append(
            [
                name,
                f"{len(shares):,}",
                str(false),
                f"{1e4 * wilson(false, len(shares))[1]:.1f}",
                f"{np.quantile(shares, 0.99):.2f}",
                f"{max(shares):.2f}",
            ]
        )
    heads = ["window", "windows", "false locks", "of 10,000, at most (95 %)"]
    heads += ["strength, 99 % quantile", "largest"]
    return Table(heads, rows)


def detection_table(found: list[list[tuple[float, bool]]]) -> Table:
    """Show which share of clocks were found, by strength and length of the window."""
    rows = []
    for strength, results in zip(STRENGTHS, found, strict=True):
        row = [f"{strength:g}"]
        for seconds in SECONDS:
            drawn = [is_found for length, is_found in results if length == seconds]
            row.append(f"{np.mean(drawn):.0%}" if drawn else "–")
        rows.append(row)
    heads = ["toggle over noise", *[f"{seconds:g} s" for seconds in SECONDS]]
    return Table(heads, rows, "Share of clocks found:")


STUDY = Study(
    name="clock",
    flags=ClockFlags,
    content=Tables,
    measure=measure_clock,
    blocks=blocks_of_tables,
    check=check_clock,
)
"""The study that `python -m lab clock` runs."""
