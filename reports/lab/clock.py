"""Measure how often a clock is found where there is none: python -m reports.lab.clock.

The receiver believes a clock whose evidence exceeds a bound, set by
`export.receive.timing.synchronise.needed_evidence`. Here it looks for a clock in windows of toggles
without one: noise, noise that lasts over several frames, toggles of a real clock in shuffled order,
and simulated films of displays, with patches and with pilots, that stand still. Then it looks for
clocks in noise, to say from which strength on they are found.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import astuple, dataclass, replace
from functools import partial

import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from data_gen.film.codec import CodecSettings, through_codec
from data_gen.film.frame import VideoFrame
from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from export.receive.timing.clock import DisplayClock, embedded_share
from export.receive.timing.fit import ClockFit, ToggleWindow
from export.receive.timing.synchronise import needed_evidence
from export.receive.timing.toggles import PatchToggles, Toggles, make_toggles
from export.receive.tracking.follow import Follower
from export.receive.tracking.patches import Tracker
from link.cli import read_flags, run_cli
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
STRENGTHS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Toggles between the states, in standard deviations of the noise of a usual place."""
OLD_R2 = 0.5
"""Share of the unweighted variance that a clock must explain by the simpler rule with which
evidence is compared."""


@dataclass(frozen=True)
class ClockConfig:
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
    seed: int = 0
    """Seed of all draws."""
    jobs: int = 2
    """Number of processes."""


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


def film_still_display(item: tuple[str, int], config: ClockConfig) -> StillFilm:
    """Film a display that stands still, and follow it.

    Even films are lossless and odd ones pass through H.264; the hand moves once and then six times
    as much as usual.

    Args:
        item: key of `STILL`, and number of the film.
        config: seed, frames a second and length.
    """
    kind, number = item
    layout = STILL[kind]
    source = Source(layout, "test", config.seed)
    pictures = shuffled_pictures(source)
    picture = pictures[number % len(pictures)].rgb
    settings = VideoSettings(
        scene=SceneSettings(coverage=0.35, pictures=pictures, free=0.03),
        fps=config.fps,
        seconds=config.film_seconds,
        hand=6.0 if number // 2 % 2 else 1.0,
    )
    shown = embed(picture, np.zeros(layout.n_bits, np.intp), layout, 3).original
    rng = np.random.default_rng([config.seed, number])
    frames = film([shown], layout, source.pair("canon-lg"), 45.0, settings, rng)
    codec = CodecSettings("h264" if number % 2 else "none")
    toggles = make_toggles(layout)
    times, values = [], []
    for time, rectified in _followed(through_codec(frames, codec, config.fps), layout):
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


def draw_windows(
    kind: str, films: Mapping[str, Sequence[StillFilm]], rng: np.random.Generator, fps: float
) -> Window:
    """Draw a window without a clock of a kind that `KINDS` names."""
    if kind in STILL:
        return films[kind][int(rng.integers(len(films[kind])))].window(rng)
    if kind == "shuffled":
        return shuffled_clock(rng, fps)
    slow = {"noise": (0.0,) * 5, "codec": (SLOW, SLOW, 0.0, 0.0, 0.3), "slow": (0.95,) * 5}
    return noisy_clock(rng, fps, 0.0, slow[kind])


KINDS = {
    "noise": "noise of each frame's own",
    "codec": "noise that lasts, as a codec's does",
    "slow": "noise that wanders",
    "shuffled": "toggles in shuffled order",
    "patches": "films of a display with patches that stands still",
    "pilots": "films of a display with pilots that stands still",
}
"""Kinds of windows without a clock, and how the table calls them."""


def false_strengths(
    chunk: tuple[str, int, int], config: ClockConfig, films: Mapping[str, Sequence[StillFilm]]
) -> list[float]:
    """Evidence, as a share of what is needed, in windows without a clock.

    Args:
        chunk: kind of the windows, number of the chunk, and number of windows in it.
        config: seed and frames a second.
        films: films of displays that stand still, by the keys of `STILL`.
    """
    one_thread()
    kind, number, windows = chunk
    rng = np.random.default_rng([config.seed, list(KINDS).index(kind), number])
    drawn = (draw_windows(kind, films, rng, config.fps) for _ in range(windows))
    return [window.search(config.fps)[1] for window in drawn]


def found_clocks(strength: float, config: ClockConfig) -> list[tuple[float, bool, bool]]:
    """Look for clocks in noise: the window's seconds, found by evidence, and found by `OLD_R2`."""
    one_thread()
    rng = np.random.default_rng([config.seed, 99, round(100 * strength)])
    results = []
    for _ in range(config.found):
        window = noisy_clock(rng, config.fps, strength, (SLOW, SLOW, 0.0, 0.0, 0.3))
        fit, share = window.search(config.fps)
        clock = np.array([astuple(fit.clock)])
        wave = embedded_share(clock, window.times - window.times.mean(), PLACES)[0].T
        wave = wave - wave.mean(axis=0)
        toggles = window.toggles - window.toggles.mean(axis=0)
        power = (wave**2).sum() * (toggles**2).sum()
        old = max(float((wave * toggles).sum()), 0) ** 2 / max(float(power), 1e-12)
        results.append((window.seconds, share >= 1, old >= OLD_R2))
    return results


def _chunks(windows: int) -> Iterator[tuple[str, int, int]]:
    for kind in KINDS:
        for number, start in enumerate(range(0, windows, 100)):
            yield kind, number, min(100, windows - start)


def main() -> None:
    """Print both tables."""
    config = read_flags(lambda: tyro.cli(ClockConfig, description=__doc__))
    at_least(1, windows=config.windows, found=config.found, jobs=config.jobs, films=config.films)
    if not config.film_seconds > max(SECONDS):
        raise ParameterError("film_seconds", f"need more than {max(SECONDS):g}")
    with ProcessPoolExecutor(config.jobs) as pool:
        film_it = partial(film_still_display, config=config)
        films = {
            kind: list(pool.map(film_it, [(kind, number) for number in range(config.films)]))
            for kind in STILL
        }
        chunks = list(_chunks(config.windows))
        look = partial(false_strengths, config=config, films=films)
        strengths: dict[str, list[float]] = {kind: [] for kind in KINDS}
        searched = tqdm(pool.map(look, chunks), "windows, by the hundred", len(chunks))
        for (kind, _, _), shares in zip(chunks, searched, strict=True):
            strengths[kind] += shares
        found = list(pool.map(partial(found_clocks, config=config), STRENGTHS))
    print(false_lock_table(strengths).markdown(), end="\n\n")
    print(detection_table(found).markdown())


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


def detection_table(found: list[list[tuple[float, bool, bool]]]) -> Table:
    """Show which share of clocks were found, by strength and length of the window."""
    rows = []
    for strength, results in zip(STRENGTHS, found, strict=True):
        row = [f"{strength:g}"]
        for seconds in SECONDS:
            drawn = [r[1:] for r in results if r[0] == seconds]
            now, before = np.mean(drawn, axis=0) if drawn else (None, None)
            row.append("–" if now is None else f"{now:.0%} ({before:.0%})")
        rows.append(row)
    heads = ["toggle over noise", *[f"{seconds:g} s" for seconds in SECONDS]]
    return Table(heads, rows, "Share of clocks found, and in brackets by the bound before:")


if __name__ == "__main__":
    run_cli(main)
