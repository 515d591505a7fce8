"""How a display toggles over the frames of a film: in one wave, or as its code says.

Where pilots always toggle with the same signs, a frequency says how (`receiver.pilots.signal`).
Where they follow a code (`link.pilot_code`), it takes a clock (`receiver.pilots.code`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, astuple, dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from link.clock import DisplayClock, embedded_share
from link.layout import Layout
from link.pilot_code import PLAIN, PilotCode
from link.pilots import pilot_centres, pilot_signs, standing_out
from link.types import Array, Gray, Map, Real
from receiver.pilots.code import CodeSearch
from receiver.pilots.motion import GridMaps
from receiver.pilots.signal import LEAST_DEVIATION, common_phase, pilot_evidence
from receiver.pilots.waves import waves

LEAST_WAVE = 1e-3
"""Power of the toggling that the frames of one period hold below which they tell nothing: one frame
alone has none, and rounding leaves a little. Chosen by hand between 0 and what two frames have."""
UNCLEAR = 0.85
"""Share of what a clock explains from which a rival is about as good, so that more frames are
awaited. Chosen by hand."""
MOST_FRAMES = 64
"""Largest number of frames, the newest, in which a code is looked for. It bounds the work, and
pictures move over longer times. Chosen by hand."""


@lru_cache(maxsize=2)
def code_search(layout: Layout, code: PilotCode, at: tuple[float, ...], fps: float) -> CodeSearch:
    """Make a search for a code in frames at positions; layouts are equal whatever theirs is."""
    signs, places = pilot_signs(layout), pilot_centres(layout)
    return CodeSearch(code, signs, places, np.array(at), 1.0, fps)


def over_deviation(views: Real) -> NDArray[np.float32]:
    """Divide what differs from the mean over time, along axis 0, by its usual deviation."""
    mean, usual = mean_and_deviation(views)
    return np.asarray((views - mean) / usual, np.float32)


def mean_and_deviation(views: Real | Gray) -> tuple[Map, Map]:
    """Find the mean over time, along axis 0, and the usual deviation plus `LEAST_DEVIATION`.

    It goes from view to view: memory for the deviations of all would take longer to get than to
    fill.
    """
    mean = views.mean(axis=0, dtype=np.float32)
    squares = np.zeros_like(mean)
    for view in views:
        squares += (view - mean) ** 2
    return mean, np.sqrt(squares / np.float32(len(views))) + np.float32(LEAST_DEVIATION)


@dataclass(frozen=True, eq=False)
class Wave:
    """A display whose pilots always toggle with the same signs."""

    frequency: float
    """Frequency at which it toggles, in periods for each nominal frame."""

    @property
    def clear(self) -> bool:
        """Return true: the phase is left open."""
        return True

    def amplitudes(self, series: NDArray[np.float32], at: Sequence[float]) -> NDArray[np.complex64]:
        """Measure how each place toggles, over its deviation.

        Args:
            series: (frames, h, w) maps of a display, as of `over_deviation`.
            at: positions of the frames, in nominal frames since a reference.

        Returns:
            (h, w) complex amplitudes, real where the phase is known.
        """
        turns = waves(at, np.array([self.frequency]), np.zeros(1))[0].round(12)
        return np.asarray(np.tensordot(turns.astype(np.complex64), series, axes=1), np.complex64)

    def period_changes(self, maps: GridMaps, views: Gray, at: Sequence[float]) -> Iterator[Map]:
        """Measure by how much each pixel changed in each period of the toggling, a frame pair.

        The phase of the toggling, which may slope across the display, is that of the pilots. A
        period begins where the first state of a frame pair does, so that the bits of different
        frame pairs are kept apart.

        Args:
            maps: geometry of the maps.
            views: (T, h, w) gray levels of T frames, rectified to the maps.
            at: (T,) positions of the frames, in nominal frames since a reference.

        Yields:
            (h, w) changes in a frame pair, positive where a pixel's embedded frame is brighter than
            its original; over each pixel's usual deviation.
        """
        layout, places = maps.layout, np.asarray(at, np.float64)
        shown = (maps.within(view.astype(np.float32)) for view in views)
        pilots = [standing_out(view, layout).flat[layout.pilot_blocks] for view in shown]
        turns = waves(places, np.array([self.frequency]), np.zeros(1))[0]
        (across, down), angle = common_phase(turns @ np.array(pilots), layout)
        x, y = (place / 2 for place in maps.places())
        turned = np.exp(-1j * (across * x + down * y[:, None] + angle)).astype(np.complex64)
        periods = self.frequency * (places - places[0])
        begun = np.floor(periods + angle / (2 * np.pi) - 0.25 + 1e-6)
        _, usual = mean_and_deviation(views)
        for number in np.unique(begun):
            taken = begun == number
            wave = np.exp(-2j * np.pi * periods[taken])
            wave -= wave.mean()
            power = float((np.abs(wave) ** 2).sum())
            if power < LEAST_WAVE:
                continue
            real, imaginary = (
                np.tensordot(part.astype(np.float32), views[taken], axes=1)
                for part in (wave.real / np.sqrt(power), wave.imag / np.sqrt(power))
            )
            yield np.asarray((real * turned.real - imaginary * turned.imag) / usual, np.float32)

    def clock_in_seconds(self, fps: float, origin: float) -> DisplayClock | None:
        """Return None: a wave comes again with each frame pair, which tells no number."""
        return None


@dataclass(frozen=True, eq=False)
class CodedToggling:
    """A display whose frame pairs follow a code."""

    clock: DisplayClock
    """Clock that says when the display shows which state, in nominal frames since the reference."""
    code: PilotCode
    """Code of the display."""
    clear: bool = False
    """Whether this clock explains clearly more than any other that was tried."""

    def _waves(self, at: Sequence[float], x: Array, y: Array) -> NDArray[np.float32]:
        """Work out what a block of bit 1 shows, from -1 to 1: (T, h, 1) or (T, 1, w).

        Args:
            at: (T,) positions of the frames.
            x: (w,) places from left to right, in [0, 1].
            y: (h,) places from top to bottom, in [0, 1].
        """
        down = self.clock.delay_x == 0
        along = y if down else x
        places = np.full((len(along), 2), 0.5)
        places[:, int(down)] = along
        shares = embedded_share(np.array([astuple(self.clock)]), np.asarray(at), places, self.code)
        shown = (2 * shares[0].T - 1).astype(np.float32)
        return np.asarray(shown[:, :, None] if down else shown[:, None, :])

    def amplitudes(self, series: NDArray[np.float32], at: Sequence[float]) -> NDArray[np.complex64]:
        """Measure as `Wave.amplitudes` does: (h, w), real."""
        x, y = ((np.arange(side) + 0.5) / side for side in series.shape[:0:-1])
        return np.asarray((series * self._waves(at, x, y)).sum(axis=0), np.complex64)

    def period_changes(self, maps: GridMaps, views: Gray, at: Sequence[float]) -> Iterator[Map]:
        """Measure as `Wave.period_changes` does."""
        x, y = ((place + 1) / 2 for place in maps.places())
        shown, (mean, usual) = self._waves(at, x, y), mean_and_deviation(views)
        middle = np.asarray(at) + self.clock.centre
        numbers = np.floor((middle - self.clock.start) / self.clock.period / 2)
        for number in np.unique(numbers):
            taken = numbers == number
            power = float((shown[taken] ** 2).sum(axis=0).mean())
            if power >= LEAST_WAVE:
                change = ((views[taken] - mean) / usual * shown[taken]).sum(axis=0)
                yield np.asarray(change / np.sqrt(power), np.float32)

    def clock_in_seconds(self, fps: float, origin: float) -> DisplayClock | None:
        """Give the clock by the camera's time, seconds.

        Args:
            fps: nominal number of frames of the camera in a second.
            origin: time of the reference, seconds.
        """
        seconds = {name: frames / fps for name, frames in asdict(self.clock).items()}
        return DisplayClock(**{**seconds, "start": origin + seconds["start"]})


TogglePattern = Wave | CodedToggling
"""How a display toggles over the frames of a film."""


def find_toggling(
    values: Sequence[NDArray[np.floating]], layout: Layout, at: Sequence[float], fps: float
) -> tuple[float, TogglePattern]:
    """Tell how surely values over time toggle with the pilots' signs, in any way.

    Args:
        values: T arrays (P,), one for each of T frames.
        layout: with P pilots.
        at: (T,) positions of the frames, rising.
        fps: nominal number of frames in a second.

    Returns:
        evidence: natural logarithm of the probability that chance does as well, with the sign
            turned; all ways that were tried are paid for.
        toggling: the way in which they toggle most surely.
    """
    if layout.code == PLAIN:
        evidence, frequency = pilot_evidence(values, layout, at)
        return evidence, Wave(frequency)
    places, picked = tuple(at)[-MOST_FRAMES:], values[-MOST_FRAMES:]
    (lock,) = code_search(layout, layout.code, places, fps).strongest(np.array(picked))
    return lock.evidence, CodedToggling(lock.clock, layout.code, lock.rival < UNCLEAR)
