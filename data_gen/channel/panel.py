"""What a panel's pixels send out while a shutter is open: refreshes, dither, response and pulses.

The panel writes the picture ``refresh_hz`` times a second, in the order of ``Display.scan``. The
player holds a state for whole refreshes. A six-bit panel shows a level between two of its own by
turns, refresh by refresh (frame-rate control). Pixels follow with a lag that depends on their level
and on whether they become brighter or darker, and the light may come in pulses. Everything is mixed
on the display, as linear light, before a camera's optics see it.

Left out: variable refresh, local dimming, overdrive, and dither finer than a pixel of the picture.
"""

from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.channel.display import Light
from data_gen.channel.shutter import pulsed_gain
from data_gen.channel.timing import Times, state_shares
from data_gen.parameters import RGB, Display
from link.images import as_rgb
from link.types import Image

GRID_PX = 4
"""Number of display pixels between the points at which shares are computed."""
KEPT_LIGHTS = 32
"""Number of pictures whose emitted light is kept at once."""
LEAST_SHARE = 2e-3
"""Share of an exposure below which what was shown earlier counts as what was shown next."""
DITHER = np.array([[0, 2], [3, 1]], np.uint8)
"""Offsets of a block of 2 x 2 pixels, in levels of eight bits, before a six-bit panel rounds them
down: each of the four offsets occurs in each block at each refresh."""
DITHER_ORDER = (0, 2, 1, 3)
"""Numbers that successive refreshes add to the offsets, modulo 4. Each pixel has all four in four
refreshes, and those that differ most follow each other."""
LEVELS_OF_TABLE = (0, 128, 255)
"""Levels for which a display states how fast its pixels follow."""


class Panel:
    """A panel that shows states, and the light that it sends out in one exposure after another.

    Args:
        display: rates, response and pulses of the panel.
        size: width and height of the picture, pixels.
        state_of: gives the picture of a state by its number, which may be negative.
        light_of: gives the light of a picture, (H, W, 3) float32.
        state_hz: number of states a second. A panel that refreshes more slowly refreshes as often.
        phase: phase of the pulses at time 0, in periods.
    """

    def __init__(
        self,
        display: Display,
        size: tuple[int, int],
        state_of: Callable[[int], Image],
        light_of: Callable[[Image], Light],
        state_hz: float,
        phase: float,
    ) -> None:
        self._display, self._size = display, size
        self._state_of, self._light_of = state_of, light_of
        self._state_hz, self._phase = state_hz, phase
        self._refresh_hz = max(display.refresh_hz, state_hz)
        x, y = (np.arange(0, side + GRID_PX, GRID_PX, dtype=np.float64) for side in size)
        self.points = np.stack(np.meshgrid(x, y), axis=-1)
        """Points of the display, (h, w, 2) as x and y in pixels, at which shares are computed."""
        self._written = self._writing_times()
        self._kept = lru_cache(KEPT_LIGHTS)(self._lit)

    def exposed(self, opens: Times, shutter_s: float) -> tuple[Light, dict[int, float]]:
        """Return the mean light during an exposure, and the share of each state in it.

        Args:
            opens: (h, w) seconds by the display's clock at which the shutter opens for each of
                `points`.
            shutter_s: exposure time, seconds.

        Returns:
            (H, W, 3) float32 linear light, and the states' shares, which sum to 1.
        """
        size, written = self._size, self._written
        fast, slow = _extremes(self._display)
        first, quick = self._cumulative(opens - written, shutter_s, fast)
        start, late = first, quick
        if slow > fast:
            start, late = self._cumulative(opens - written, shutter_s, slow)
            before = np.ones((first - start, *opens.shape), np.float32)
            quick = np.concatenate([before, quick])
        shown = [self._picture(start + number) for number in range(len(late))]
        light = np.zeros_like(shown[-1][0])
        shares: dict[int, float] = {}
        after, part_after = np.zeros(size[::-1], np.float32), 0.0
        for number in reversed(range(len(late))):
            if number and shown[number] is shown[number - 1]:
                continue  # the refresh changes nothing
            if number == 0:
                reached, part = np.ones(size[::-1], np.float32), 1.0
            elif slow > fast:
                ease = _ease(self._display, shown[number - 1][1], shown[number][1])
                reached = refine_grid(late[number], size)
                reached += ease * (refine_grid(quick[number], size) - reached)
                eased = float(ease.mean())
                part = float(eased * quick[number].mean() + (1 - eased) * late[number].mean())
            else:
                reached, part = refine_grid(quick[number], size), float(quick[number].mean())
            weight = reached - after
            cv2.accumulateProduct(shown[number][0], cv2.merge([weight] * 3), light)
            state = self._state_number(start + number)
            shares[state] = shares.get(state, 0.0) + part - part_after
            after, part_after = reached, part
        if self._display.pwm_depth > 0:
            pulses = opens - written if self._display.pwm_scans else opens
            begins = self._phase + self._display.pwm_hz * pulses
            gain = refine_grid(pulsed_gain(self._display, shutter_s, begins), size)
            light *= cv2.merge([gain] * 3)
        # Changes are added up, so a fast fall that follows a slow rise may end below dark.
        return np.maximum(light, 0.0, out=light), dict(sorted(shares.items()))

    def _cumulative(
        self, times: Times, shutter_s: float, response_s: float
    ) -> tuple[int, NDArray[np.float32]]:
        """Return the first refresh, and (R, h, w) shares of it and of all later ones together.

        The first one stands for all that came before it, so that its own shares are 1.
        """
        first, shares = state_shares(times, shutter_s, self._refresh_hz, response_s)
        later = np.cumsum(shares[::-1], axis=0)[::-1]
        kept = next(k for k in reversed(range(len(later))) if later[k].min() > 1 - LEAST_SHARE)
        return first + kept, later[kept:].astype(np.float32)

    def _writing_times(self) -> Times:
        """Return the seconds from the start of a refresh to the writing of each of ``points``."""
        right, down = np.moveaxis(self.points / self._size, -1, 0)
        shares = {"down": down, "up": 1 - down, "right": right, "left": 1 - right}
        scan = self._display.scan
        return np.asarray(shares.get(scan, 0 * down) / self._refresh_hz)

    def _state_number(self, refresh: int) -> int:
        """Number of the state that a refresh shows."""
        return int(np.floor(refresh * self._state_hz / self._refresh_hz + 1e-6))

    def _picture(self, refresh: int) -> tuple[Light, NDArray[np.uint8]]:
        """Return the light of what a refresh shows, and its green levels, kept or made anew."""
        turn = refresh % len(DITHER_ORDER) if self._display.frc_bits else 0
        return self._kept(self._state_number(refresh), turn)

    def _lit(self, state: int, turn: int) -> tuple[Light, NDArray[np.uint8]]:
        """Make the light and the green levels of a state in one of the turns of the dither."""
        picture = as_rgb(self._state_of(state))
        if self._display.frc_bits:
            picture = dithered(picture, self._display.frc_bits, turn)
        return self._light_of(picture), np.ascontiguousarray(picture[:, :, 1])


def dithered(picture: NDArray[np.uint8], bits: int, turn: int) -> NDArray[np.uint8]:
    """Return the levels that a panel with frame-rate control shows in one refresh.

    >>> level = np.full((2, 2, 3), 101, np.uint8)  # a quarter of the way from 100 to 104
    >>> dithered(level, 2, 0)[:, :, 0].tolist()  # 25 and 26 of 63, as levels of 255
    [[101, 101], [105, 101]]

    Args:
        picture: (H, W, 3) uint8 levels that the player asks for.
        bits: number of bits, 1 or 2, that the panel lacks.
        turn: number of the refresh, 0 to 3.

    Returns:
        (H, W, 3) uint8 levels; the panel's highest is 255, and the mean over four turns is right
        up to the rounding of its levels and up to its top level.
    """
    steps = 2**bits
    top = 255 // steps
    native = np.round(np.arange(top + 1) * 255 / top).astype(np.uint8)
    shown = np.empty_like(picture)
    for (y, x), place in np.ndenumerate(DITHER):
        offset = (place + DITHER_ORDER[turn]) % 4 >> (2 - bits)
        table = native[np.minimum((np.arange(256) + offset) // steps, top)]
        shown[y::2, x::2] = table[picture[y::2, x::2]]
    return shown


def refine_grid(coarse: NDArray[np.floating], size: tuple[int, int]) -> Light:
    """Interpolate values (h, w) at `Panel.points` to (H, W) float32, linearly."""
    scale = np.diag([GRID_PX, GRID_PX, 1.0])[:2]
    return np.asarray(
        cv2.warpAffine(coarse.astype(np.float32), scale, size, borderMode=cv2.BORDER_REPLICATE)
    )


def _extremes(display: Display) -> tuple[float, float]:
    """Return the smallest and the largest time constant of the pixels, seconds."""
    constants = display.rise_s + display.fall_s
    return min(constants), max(constants)


@lru_cache(maxsize=32)
def _ease_table(constants: RGB, fast: float, slow: float) -> Light:
    """Return, by level, the share of the fastest response of which the slowest makes up the rest.

    The mixture has the same mean lag as an exponential of the level's own constant.
    """
    own = np.interp(np.arange(256), LEVELS_OF_TABLE, constants)
    return np.asarray((slow - own) / (slow - fast), np.float32)


def _ease(display: Display, before: NDArray[np.uint8], now: NDArray[np.uint8]) -> Light:
    """Return the share (H, W) of the fastest response in a change from levels to other levels."""
    fast, slow = _extremes(display)
    between = cv2.addWeighted(before, 0.5, now, 0.5, 0)
    rising = cv2.LUT(between, _ease_table(display.rise_s, fast, slow))
    falling = cv2.LUT(between, _ease_table(display.fall_s, fast, slow))
    return np.asarray(np.where(now >= before, rising, falling), np.float32)
